"""From a diagram and recordings to a problem: names read, experiments prepared, a step chosen."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import arguments
from tsmblocks.common.arguments import as_positive
from tsmblocks.common.errors import DataError, ParameterError, RunError, in_words
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.data import Record
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.methods import method_named
from tsmblocks.fitting.constraints import constraints as read_constraints
from tsmblocks.fitting.constraints import ties as read_ties
from tsmblocks.fitting.experiments import Experiment, compared, grid_step, lies_on_grid, prepare
from tsmblocks.fitting.holds import common_holds, hold_notes, in_one_word
from tsmblocks.fitting.noise import given_floors
from tsmblocks.fitting.parameter_vector import Unknown, Unknowns, constraint_functions, with_ties
from tsmblocks.fitting.parameters import chosen, given_bounds, is_start, numbers, unknown, with_initial_values
from tsmblocks.fitting.recordings import Data, recordings, windows, with_adopted_units, without_units
from tsmblocks.fitting.residuals import Priors, Problem
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.model.simulation import Simulation
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import equations, parameter_vector

FINEST = 64
"""Simulation steps between two samples beyond which a step is no longer refined. Chosen."""
SETTLED = 1e-3
"""Largest change of the outputs by halving the step, relative to the measured signals. Chosen."""


DEFAULT_METHOD = "rk4"
"""Runge-Kutta method, where neither a caller nor the diagram's file says another."""


@attrs.frozen(eq=False)
class Setup:
    """A diagram beside its recordings, ready to be simulated: shared by fits and scores."""

    diagram: Diagram
    eq: Equations
    experiments: tuple[Experiment, ...]
    outputs: tuple[str, ...]
    notes: tuple[str, ...]
    finer: tuple[Experiment | None, ...] = ()  # the same at half the step, where that was tried
    given_hold: Hold = AUTO

    @property
    def hold(self) -> Hold:
        """Interpolation of inputs between samples, for all or by input; ``"auto"`` where experiments differ."""
        return in_one_word(common_holds((one.record, one.hold) for one in self.experiments))

    @property
    def steps(self) -> dict[str, float]:
        """The step [s] of each experiment."""
        return {one.name: one.times.h for one in self.experiments}

    def prepared(
        self, e: int, *, record: Record | None = None, step: float | None = None, hold: Hold | None = None
    ) -> Experiment:
        """An experiment with another recording, another step in s, or other holds. Raises as ``prepare`` does."""
        one = self.experiments[e]
        return prepare(
            one.name,
            one.record if record is None else record,
            self.diagram,
            self.eq,
            outputs=self.outputs,
            rule=one.rule,
            step=step or one.times.h,
            hold=one.hold if hold is None else hold,
            window=(one.t[0], one.t[-1]),
            backend=one.backend,
        )


def set_up(
    diagram: Diagram,
    records: Mapping[str, Record],
    *,
    outputs: Iterable[str] | None = None,
    window: Any = None,
    step: float | None = None,
    integrator: str = "rk4",
    hold: Hold = AUTO,
    backend: str = "",
) -> Setup:
    """Every recording beside the diagram; without ``step``, one that resolves the diagram is found."""
    for what, word in (("integrator", integrator), ("backend", backend)):
        arguments.as_text(what, word)
    given = None if outputs is None else arguments.as_names("outputs", outputs, "x_out")
    known = diagram.simulation
    integrator = known.method or integrator if integrator == DEFAULT_METHOD else integrator
    hold = known.hold or hold if isinstance(hold, str) and hold == AUTO else hold
    eq, names, rule = equations(diagram), compared(records, diagram, given), method_named(integrator)
    p, parts, notes = parameter_vector(eq, diagram), windows(window, records), without_units(records, diagram, names)
    made, finer = list[Experiment](), list[Experiment | None]()
    common: Any = dict(diagram=diagram, eq=eq, outputs=names, rule=rule, hold=hold, backend=backend)
    for name, record in records.items():
        at_step = functools.partial(prepare, name, record, window=parts[name], **common)
        own_step = known.step_of(name) if step is None else step
        if own_step is None:
            experiment, half = _resolved(at_step, record, eq.periods, p, notes)
        else:
            experiment, half = at_step(step=as_positive("step", own_step)), None
        made.append(experiment)
        finer.append(half)
        notes += [f"{name}: {text}" for text in hold_notes(record, experiment.hold, hold)]
        if experiment.share is not None:
            own = grid_step(record.t)
            why = (
                f"the samples, {own:.4g} s apart, are no multiples of the step of {experiment.times.h:.4g} s"
                if lies_on_grid(record.t, own)
                else "the samples are unevenly spaced"
            )
            notes.append(f"{name}: {why}, so the simulation is interpolated between its steps.")
    return Setup(diagram, eq, tuple(made), names, tuple(notes), tuple(finer), hold)


def _least_division(own: float, periods: Sequence[float]) -> int:
    """Into how many steps to cut the ``own`` s between samples at least, so that sample periods are whole steps.

    1 where nothing up to ``FINEST`` does it.
    """
    shares = [Fraction(period / own).limit_denominator(FINEST) for period in periods]
    whole = all(math.isclose(share * own, period, rel_tol=1e-9) for share, period in zip(shares, periods, strict=True))
    parts = math.lcm(*(share.denominator for share in shares))
    return parts if whole and parts <= FINEST else 1


def _resolved(
    at_step: Callable[..., Experiment], record: Record, periods: Sequence[float], p: np.ndarray, notes: list[str]
) -> tuple[Experiment, Experiment | None]:
    """An experiment whose step is the sampling step, or that divided until dividing it further changes nothing.

    With it, the experiment at half that step, where there is one.
    """
    own, best, fault = grid_step(record.t), None, None
    divide = _least_division(own, periods)
    while divide <= FINEST:
        try:
            experiment = at_step(step=own / divide)
        except RunError as error:  # sample periods that this step does not divide, a delay shorter than it
            fault, divide = error, 2 * divide
            continue
        if best is not None and _change(best, experiment, p) < SETTLED:
            return best, experiment
        best, divide = experiment, 2 * divide
    if best is None:
        raise RunError(
            f"experiment '{record.name}': no step that divides the {own:g} s between samples is valid for the diagram: "
            f"{fault}"
        ) from None
    if np.isfinite(best.outputs(p)).all():
        notes.append(
            f"{best.name}: halving the step still changes the simulation by more than a thousandth of the measured "
            f"signal at {FINEST} steps between samples; a step can be given."
        )
    return best, None


def _change(coarse: Experiment, fine: Experiment, p: np.ndarray) -> float:
    """How much outputs differ between two steps, as a share of the measured ones; infinite if not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        a, b = coarse.outputs(p), fine.outputs(p)
        size = np.maximum(coarse.measured.std(axis=0), 1e-12 * np.abs(coarse.measured).max() + 1e-300)
        change = np.sqrt(np.mean((a - b) ** 2, axis=0)) / size
    return float(change.max()) if np.isfinite(change).all() else math.inf


def experiment_starts(setup: Setup) -> tuple[dict[str, float], ...]:
    """Initial states that the diagram's file gives for each experiment, by name."""
    known, names = setup.diagram.simulation, set(setup.eq.p)
    starts = (known.start_of(experiment.name) for experiment in setup.experiments)
    return tuple({k: v for k, v in own.items() if k in names} for own in starts)


def simulated_as(setup: Setup, starts: Sequence[Mapping[str, float]]) -> Simulation:
    """How the experiments were simulated, with the initial states, so that a file reproduces the simulation."""
    own = {experiment.name: values for experiment, values in zip(setup.experiments, starts, strict=True) if values}
    return Simulation(
        step=one_where_equal(setup.steps),
        method=setup.experiments[0].rule.name,
        hold=setup.hold,
        condition=setup.diagram.simulation.condition,
        start=own,
    )


def one_where_equal(steps: Mapping[str, float]) -> float | Mapping[str, float]:
    """The step [s] of all experiments where they share one, else those by experiment."""
    return next(iter(steps.values())) if len(set(steps.values())) == 1 else steps


# ---- the problem --------------------------------------------------------------------------------


def pose(
    diagram: Diagram,
    data: Data,
    *,
    free: Iterable[str] | None = None,
    bounds: Mapping[str, Any] | None = None,
    start: Mapping[str, float] | None = None,
    local: Iterable[str] = (),
    start_states: bool = False,
    constraints: Any = None,
    ties: Mapping[str, str] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    sigma: Any = None,
    outputs: Iterable[str] | None = None,
    window: Any = None,
    step: float | None = None,
    integrator: str = "rk4",
    hold: Hold = AUTO,
    backend: str = "",
) -> tuple[Problem, Setup]:
    """The problem that a fit solves, every name checked. Arguments as for ``fit``."""
    diagram = as_diagram(diagram).with_parameters(arguments.as_mapping("start", start, "'tsm.theta': 3.0"))
    start_states = arguments.as_bool("start_states", start_states)
    diagram = with_initial_values(diagram) if start_states else diagram
    records = recordings(data)
    diagram, adopted = with_adopted_units(diagram, records)
    known = numbers(diagram)
    names = chosen(diagram, free)
    own = [] if local is None else chosen(diagram, local, "local")
    if start_states:
        own += [name for name, fields in known.items() if is_start(fields) and name not in own]
    names = [k for k in known if k in {*names, *own}]
    # tying a name that is freed alone is a contradiction, while a pattern may cover tied ones
    exact = set() if free is None else set(arguments.as_names("free", free, "tsm.*"))
    tie = read_ties({} if ties is None else ties, list(known), [k for k in names if k in exact])
    followers = [name for name, _ in tie]
    names = [k for k in names if k not in followers]
    diagram = diagram.untied([*names, *followers])
    setup = set_up(
        diagram, records, outputs=outputs, window=window, step=step, integrator=integrator, hold=hold, backend=backend
    )
    setup = attrs.evolve(setup, notes=(*adopted, *setup.notes))
    starts = experiment_starts(setup)
    items = _items(diagram, names, own, bounds, dict(zip(records, starts, strict=True)))
    base = parameter_vector(setup.eq, diagram)
    unknowns = with_ties(Unknowns(items, setup.eq.p, base, tuple(records), starts if any(starts) else ()), tie)
    unknowns = _delays_of_a_step(unknowns, setup)
    checked = read_constraints([] if constraints is None else constraints, list(setup.eq.p))
    weights = _weights(setup, sigma)
    _in_range(setup, weights)
    limits, prior = constraint_functions(checked, unknowns), _priors(priors, unknowns)
    return Problem(unknowns, limits, setup.experiments, weights, prior), setup


def _items(
    diagram: Diagram,
    names: Sequence[str],
    own: Sequence[str],
    bounds: Mapping[str, Any] | None,
    experiments: Mapping[str, Mapping[str, float]],
) -> tuple[Unknown, ...]:
    known = numbers(diagram)
    if not names:
        raise ParameterError(f"nothing is free in this fit of '{diagram.title}': name parameters (free=['block.*']).")
    given = given_bounds(bounds, names, known)
    made: list[Unknown] = []
    for name in names:
        one = unknown(name, diagram, known[name], given.get(name))
        made += [_of_experiment(one, e, starts) for e, starts in experiments.items()] if name in own else [one]
    return tuple(made)


def _of_experiment(one: Unknown, experiment: str, starts: Mapping[str, float]) -> Unknown:
    """An unknown of one experiment, which starts where the diagram's file says for that recording."""
    start = min(max(starts.get(one.parameter, one.start), one.low), one.high)
    return attrs.evolve(one, experiment=experiment, start=start)


def _delays_of_a_step(unknowns: Unknowns, setup: Setup) -> Unknowns:
    """Bounds that keep delays from being shorter than a step where they may not be: such places cannot be run.

    A start that is too short stays as it is, so that the run reports the fault.
    """
    items, begin, eq = list(unknowns.items), unknowns.start, setup.eq
    for e, experiment in enumerate(setup.experiments if eq.q else ()):

        def lags(theta: np.ndarray, e: int = e) -> np.ndarray:
            return np.asarray(eq.lag(unknowns.parameters(theta, e))).ravel()

        now, shortest = lags(begin), np.array(eq.min_delay_steps) * experiment.times.h
        for k in unknowns.columns(e):
            longer = begin.copy()
            longer[k] = 2 * begin[k]
            then = lags(longer)
            follows = (now > 0) & (shortest > 0) & (np.abs(then - 2 * now) <= 1e-12 * np.abs(now))
            low = float(np.max(shortest[follows] * begin[k] / now[follows], initial=-math.inf))
            if items[k].low < low <= min(begin[k], items[k].high):
                items[k] = attrs.evolve(items[k], low=low)
    return attrs.evolve(unknowns, items=tuple(items))


def _weights(setup: Setup, sigma: Any) -> np.ndarray:
    """One over the deviation of each output: given, or what was measured where several outputs are to be weighed."""
    if sigma is not None:
        records = {experiment.name: experiment.record for experiment in setup.experiments}
        given = given_floors(sigma, setup.diagram, records, setup.outputs, "sigma")
        missing = [k for k in setup.outputs if k not in given]
        if missing:
            raise ParameterError(f"sigma is given for some outputs, but not for '{missing[0]}'.")
        return np.array([1 / given[k][0] for k in setup.outputs])
    if len(setup.outputs) == 1:
        return np.ones(1)
    spread = np.sqrt(np.mean([experiment.measured.var(axis=0) for experiment in setup.experiments], axis=0))
    return 1 / np.where(spread > 0, spread, 1.0)


def _in_range(setup: Setup, weights: np.ndarray) -> None:
    """Refuse measurements whose weighted squares overflow or underflow."""
    for experiment in setup.experiments:
        for name, size, weight in zip(setup.outputs, np.abs(experiment.measured).max(axis=0), weights, strict=True):
            if size > 0 and not 1e-140 < float(size) * float(weight) < 1e140:
                raise DataError(
                    f"experiment '{experiment.name}': {name} reaches {size:.3g}, {size * weight:.3g} after weighting, "
                    "and its square is out of range. Choose another unit"
                    f"{' or sigma' if weight != 1 else ''}."
                )


def _priors(given: Mapping[str, tuple[float, float]] | None, unknowns: Unknowns) -> Priors:
    priors = list[tuple[int, float, float]]()
    own = [item.parameter for item in unknowns.items]
    for name, pair in arguments.as_mapping("priors", given, "'tsm.theta': (5.0, 0.5)").items():
        hits = [k for k, item in enumerate(unknowns.items) if name in (item.parameter, item.name)]
        if not hits:
            raise ParameterError(f"priors: '{name}' is not free in this fit.{near_path(name, own)}")
        try:
            middle, width = (float(v) for v in pair)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(
                f"the prior of '{name}' must be a pair (mean, standard deviation), got {in_words(pair)}."
            ) from None
        if not (math.isfinite(middle) and 0 < width < math.inf):
            raise ParameterError(
                f"the prior of '{name}' needs a finite mean and a positive standard deviation, "
                f"got ({middle:g}, {width:g})."
            )
        if width < 1e-12 * max(abs(middle), 1e-100):
            raise ParameterError(
                f"the prior of '{name}' is so narrow ({width:g}) that it fixes the parameter. Set its value instead of "
                "freeing it."
            )
        priors += [(k, middle, width) for k in hits]
    which, mean, deviation = np.array(priors).reshape(-1, 3).T
    return Priors(which.astype(int), mean, deviation)
