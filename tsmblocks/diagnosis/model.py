"""A diagram fitted to recordings: a diagnosis compares such models, the base and the base with effects."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.interrupt import checkpoint
from tsmblocks.data import Record
from tsmblocks.fitting.experiments import Window
from tsmblocks.fitting.fit import starting_points
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.memories import refined
from tsmblocks.fitting.nearest import nearest_of
from tsmblocks.fitting.noise import Floor
from tsmblocks.fitting.optimizer import OptimizerResult, feasible_start, no_progress, within_bounds
from tsmblocks.fitting.parameter_vector import Unknown
from tsmblocks.fitting.parameters import named_by, numbers, with_initial_values
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import FINEST, Setup, pose
from tsmblocks.fitting.step_size import MOST_HALVINGS, following, halved, state_at_limit
from tsmblocks.fitting.whitening import Whitening
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import equations

STARTING_POINTS = 6
"""Starting points of the fit of a base. Chosen: for the run time."""
MAX_ITERATIONS = 40
"""Gauss-Newton iterations of one optimisation at most. Chosen: an effect that needs more is not identifiable."""
ACTIVE_BOUND_TOLERANCE = 1e-6
"""Distance from a bound, relative to the parameter, within which it is active. Chosen: above rounding, below steps."""
COARSE_TOLERANCE = 0.3
"""Predicted fall of the sum of squares [noise variances] at which the optimisation of a candidate ends. Chosen: below a
thousandth of what decides between candidates."""
FINE_TOLERANCE = 1e-3
"""The same for models that further ones are built on, and that are reported. Chosen."""
MAX_QUICK_STEPS = 10_000
"""Steps of all experiments up to which the code of a candidate is compiled without optimisation. Chosen: a hundred runs
of its fit then take less time than the optimisation."""
SAME_OPTIMUM = 1.0
"""Difference of costs [noise variances] of two coarse searches that may be of one optimum. Chosen: as in fits."""

MAX_STEP_ERROR = 0.05
"""Mean square of what halving the step changes, up to which it is not material [that of the residual, or the noise
variance, whichever is larger]. Chosen: a model error of that size is not material either."""

ProgressCallback = Callable[[str, int, int], None]
"""Called with the stage, the number of steps done, and their total."""


@attrs.frozen
class ModelSettings:
    """How models are simulated and fitted: the same for the base and for every candidate.

    ``free`` are patterns of the base's parameters (None for all but initial states); ``sigma`` is the rms noise of each
    output, which residuals are divided by; ``step`` [s] is that of the simulation, None where it is still to be chosen;
    ``seed`` is that of random starting points. ``window`` is the part [s] of each experiment that is compared, None for
    all of it. ``bounds`` are those given for parameters of the base, by name or pattern; ``local`` are patterns of
    those that have a separate value in each experiment. ``whitening`` is that of the residuals of some experiments.
    """

    free: tuple[str, ...] | None
    sigma: Mapping[str, float]
    outputs: tuple[str, ...]
    start_states: bool = True
    step: float | None = None
    integrator: str = "rk4"
    hold: Hold = AUTO
    seed: int = 0
    window: Mapping[str, Window] | None = None
    bounds: Mapping[str, Any] = attrs.field(factory=dict)
    local: tuple[str, ...] = ()
    whitening: Mapping[str, Whitening] = attrs.field(factory=dict)

    def restricted_to(self, diagram: Diagram, outputs: tuple[str, ...], sigma: Mapping[str, float]) -> ModelSettings:
        """The same for a part of the diagram: of the patterns those that name something in it."""
        free = self.free
        if free is not None:
            free = tuple(p for p in free if named_by(p, diagram.parameters))
        known = diagram.parameters
        bounds = {p: pair for p, pair in self.bounds.items() if named_by(p, known)}
        local = tuple(p for p in self.local if named_by(p, known))
        hold = self.hold
        if isinstance(hold, Mapping):
            hold = {name: one for name, one in hold.items() if name in diagram.inports}
        return attrs.evolve(self, free=free, outputs=outputs, sigma=sigma, hold=hold, bounds=bounds, local=local)


@attrs.frozen(eq=False)
class Model:
    """A diagram with fitted parameters, and its residuals.

    ``theta`` (n,) are the unknowns of ``problem``, ``r`` (N,) the residuals divided by the noise and whitened where
    errors are correlated, ``J`` (N, n) their Jacobian.
    """

    diagram: Diagram
    problem: Problem = attrs.field(repr=False)
    setup: Setup = attrs.field(repr=False)
    theta: np.ndarray = attrs.field(repr=False)
    r: np.ndarray = attrs.field(repr=False)
    J: Jacobian = attrs.field(repr=False)

    @property
    def mean_square(self) -> float:
        """Mean square of the residuals [noise variances]."""
        return float(np.mean(self.r**2))

    @property
    def residual_rms(self) -> dict[str, float]:
        """Residual rms of each output, divided by its noise."""
        return self._rms(self.r)

    def residual_rms_beside(self, whitening: Mapping[str, Whitening]) -> dict[str, float]:
        """The same with another whitening, by experiment; without any where that is of other samples."""
        problem, differences = whitened_problem(self.problem, self.setup, whitening), self.differences
        rows = problem.rows
        same = all(len(one.directions) == len(differences[rows[e]]) for e, one in problem.whitening.items())
        return self._rms(problem.whitened(differences) if same else differences)

    def _rms(self, values: np.ndarray) -> dict[str, float]:
        """Rms by output of values (N,) in the order of residuals."""
        result, segments, count = {}, self.problem.segments, len(self.setup.outputs)
        for k, name in enumerate(self.setup.outputs):
            r = np.concatenate([values[part] for part in segments[k::count]])
            result[name] = float(np.sqrt(np.mean(r**2)))
        return result

    @property
    def differences(self) -> np.ndarray:
        """Simulation less measurement (N,), divided by the noise: the residuals without whitening."""
        return self.problem.restored(self.r)

    @property
    def values(self) -> dict[str, float]:
        """Each unknown by name (``parameter`` or ``parameter@experiment``)."""
        return dict(zip(self.problem.unknowns.names, self.theta.tolist(), strict=True))

    @property
    def is_local(self) -> np.ndarray:
        """Which unknowns belong to one experiment alone, shape (n,)."""
        return self.problem.unknowns.is_local

    @property
    def at_bound(self) -> np.ndarray:
        """Which unknowns lie at a bound, shape (n,)."""
        low, high = self.problem.unknowns.low, self.problem.unknowns.high
        near = ACTIVE_BOUND_TOLERANCE * np.maximum(np.abs(self.theta), 1e-12)
        return (self.theta - low <= near) | (high - self.theta <= near)

    @property
    def fitted_diagram(self) -> Diagram:
        """The diagram with the parameters common to all experiments."""
        return self.diagram.with_parameters(self.parameters())

    def signals(self, names: Iterable[str]) -> list[np.ndarray]:
        """Signals of the equations (n, signals) in each experiment, simulated once more."""
        return signals_at(self.problem, names, self.theta)

    def parameters(self, experiment: str = "") -> dict[str, float]:
        """The fitted values common to all experiments, or those of one experiment alone."""
        pairs = zip(self.problem.unknowns.items, self.theta, strict=True)
        return {item.parameter: float(value) for item, value in pairs if item.experiment == experiment}


def signals_at(problem: Problem, names: Iterable[str], theta: np.ndarray) -> list[np.ndarray]:
    """Signals of the equations (n, signals) in each experiment of a problem, simulated at ``theta``."""
    wanted, at = tuple(names), problem.unknowns.parameters
    return [
        attrs.evolve(one, columns=tuple(map(one.eq.y.index, wanted))).outputs(at(theta, e))
        for e, one in enumerate(problem.experiments)
    ]


def calibrate(
    diagram: Diagram, records: Mapping[str, Record], settings: ModelSettings, progress: Any = no_progress
) -> Model:
    """The base model, fitted from several starting points. Raises the errors of ``tsm.fit``."""
    problem, setup = pose_model(diagram, records, settings, settings.free)
    feasible = feasible_start(problem, problem.unknowns.start)
    search = functools.partial(gauss_newton, problem, iterations=MAX_ITERATIONS, progress=progress)
    coarse = functools.partial(search, tolerance=COARSE_TOLERANCE)
    starts = starting_points(problem, setup, feasible, STARTING_POINTS, settings.seed)
    ends = sorted((refined(problem, coarse(one), coarse) for one in starts), key=lambda end: end.cost)
    best = nearest_of(problem, setup, ends, SAME_OPTIMUM)[0]
    return with_sufficient_step(model_at(problem, setup, search(best.theta, tolerance=FINE_TOLERANCE)), settings)


def with_sufficient_step(model: Model, settings: ModelSettings) -> Model:
    """The model, optimised on at finer steps while the step limits its parameters; one that was given stays."""
    if settings.step is not None:
        return model
    search = functools.partial(gauss_newton, iterations=MAX_ITERATIONS, tolerance=FINE_TOLERANCE)
    problem, setup, found = following(model.problem, model.setup, end_at(model.problem, model.theta), search)
    return model if problem is model.problem else model_at(problem, setup, found)


def with_accurate_step(model: Model, settings: ModelSettings) -> Model:
    """The model, optimised on at finer steps while halving the step changes its residuals materially.

    An effect that switches, such as dry friction beside a dead zone, makes errors at a step at which the model without
    it is right: from those a search finds another optimum, or none. A step that was given stays, and so does the first
    one where parameters follow finer ones to their limits, as those do that make up for a large effect.
    """
    first, limited = model, 0
    while settings.step is None and all(one.record.step < FINEST * one.times.h for one in model.setup.experiments):
        checkpoint()
        if (half := halved(model.problem, model.setup)) is None:
            return model
        problem, setup = half
        change, allowed = problem.residuals(model.theta) - model.r, MAX_STEP_ERROR * max(model.mean_square, 1.0)
        if not np.isfinite(change).all() or float(np.mean(change**2)) <= allowed:
            return model
        material = [float(np.mean(change[rows] ** 2)) > allowed for rows in problem.rows]
        pairs = zip(material, setup.experiments, model.setup.experiments, strict=True)
        experiments = tuple(fine if changed else coarse for changed, fine, coarse in pairs)
        problem, setup = attrs.evolve(problem, experiments=experiments), attrs.evolve(setup, experiments=experiments)
        model = optimized(problem, setup, model.theta, FINE_TOLERANCE)
        limited += bool(state_at_limit(problem, model.theta))
        if limited > MOST_HALVINGS:
            return first
    return model


def nearest(model: Model, given: Mapping[str, float] | None = None) -> Model:
    """The model with the parameters nearest to those ``given``, of all that leave the same residuals.

    Without them nearest to where its search began.
    """
    (found,) = nearest_of(model.problem, model.setup, [end_at(model.problem, model.theta)], given=given)
    return model if found.theta is model.theta else model_at(model.problem, model.setup, found)


def end_at(problem: Problem, theta: np.ndarray) -> OptimizerResult:
    """Values of the unknowns as the end of a search."""
    return OptimizerResult(theta, problem.cost(theta), "converged", 0, 0)


def pose_model(
    diagram: Diagram,
    records: Mapping[str, Record],
    settings: ModelSettings,
    free: Iterable[str] | None,
    bounds: Mapping[str, Any] | None = None,
    local: Iterable[str] | None = None,
) -> tuple[Problem, Setup]:
    """The problem of fitting a diagram, weighted by the noise; ``local`` names unknowns of single experiments.

    Without ``local`` it is that of a base, with the bounds and the local parameters of the ``settings``.
    """
    known = {k: Floor(k, v, diagram.unit(k)) for k, v in settings.sigma.items()}
    problem, setup = pose(
        diagram,
        dict(records),
        free=free,
        bounds=settings.bounds if local is None else bounds,
        local=settings.local if local is None else local,
        start_states=settings.start_states and local is None,
        sigma=known,
        outputs=settings.outputs,
        window=settings.window,
        step=settings.step,
        integrator=settings.integrator,
        hold=settings.hold,
    )
    return whitened_problem(problem, setup, settings.whitening), setup


def whitened_problem(problem: Problem, setup: Setup, whitening: Mapping[str, Whitening]) -> Problem:
    """The problem with residuals that are whitened, by name of the experiment."""
    named = enumerate(one.name for one in setup.experiments)
    found = {e: whitening[name] for e, name in named if name in whitening}
    return attrs.evolve(problem, whitening=found) if found or problem.whitening else problem


def pose_extended(
    model: Model,
    diagram: Diagram,
    more: Iterable[str],
    records: Mapping[str, Record],
    settings: ModelSettings,
    bounds: Mapping[str, Any] | None = None,
    begins: Iterable[str] = (),
    own: Iterable[str] = (),
) -> tuple[Problem, Setup]:
    """The problem of a diagram with more blocks than a model: the model's unknowns, and ``more`` of the added blocks.

    Those of ``more`` that are named in ``own`` have a value in each experiment.

    Unknowns of the model that the diagram does not have, since one of its blocks is replaced, are left out. Initial
    states of the added blocks, and those named in ``begins``, are unknowns of each experiment, as those of the model
    are.
    """
    items = model.problem.unknowns.items
    diagram = with_initial_values(diagram) if settings.start_states else diagram
    known, had = diagram.parameters, {*model.setup.eq.x, *model.diagram.parameters}
    items = tuple(item for item in items if item.parameter in known)
    added, own = [k for k in more if k not in own], [k for k in more if k in own]
    free = list(dict.fromkeys([*(item.parameter for item in items if not item.experiment), *added]))
    local = list(dict.fromkeys([*(item.parameter for item in items if item.experiment), *own]))
    if settings.start_states:
        states = [*(k for k in equations(diagram).x if k in known), *_initial_lists(diagram), *begins]
        states = [k for k in states if k not in had or k in begins]
        local += [k for k in dict.fromkeys(states) if k not in local]
    diagram = diagram.with_simulation(attrs.evolve(diagram.simulation, step=model.setup.steps))
    settings = attrs.evolve(settings, step=None)  # those of the model, of each experiment its own
    problem, setup = pose_model(
        diagram, records, settings, free, {**_widest_bounds(items, known), **(bounds or {})}, local
    )
    problem = _with_own_bounds(problem, items)
    if sum(one.times.steps for one in setup.experiments) > MAX_QUICK_STEPS:
        return problem, setup
    quick = tuple(attrs.evolve(one, quick=True) for one in setup.experiments)
    return attrs.evolve(problem, experiments=quick), attrs.evolve(setup, experiments=quick)


def _widest_bounds(items: Iterable[Unknown], values: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Bounds of each parameter that hold those of every experiment, and the diagram's value where there are several."""
    widest = dict[str, tuple[float, float]]()
    for item in items:
        value = values[item.parameter]
        low, high = widest.get(item.parameter, (value, value) if item.experiment else (item.low, item.high))
        widest[item.parameter] = min(low, item.low), max(high, item.high)
    return widest


def _with_own_bounds(problem: Problem, items: Iterable[Unknown]) -> Problem:
    """The problem with the bounds that ``items`` of single experiments have."""
    own = {item.name: item for item in items if item.experiment}
    every = list(problem.unknowns.items)
    for k, one in enumerate(every):
        if one.name in own:
            low, high = own[one.name].low, own[one.name].high
            every[k] = attrs.evolve(one, low=low, high=high, start=min(max(one.start, low), high))
    return problem.with_items(every)


def _initial_lists(diagram: Diagram) -> list[str]:
    """Names of initial values that blocks hold in lists."""
    return [k for k, fields in numbers(diagram).items() if all(f.initial for f in fields)]


def optimized(
    problem: Problem,
    setup: Setup,
    start: np.ndarray,
    tolerance: float = COARSE_TOLERANCE,
    coarse: bool = True,
    iterations: int = MAX_ITERATIONS,
) -> Model:
    """The model at the end of a Gauss-Newton optimisation from ``start``; ``coarse`` allows finite differences."""
    feasible = within_bounds(problem, start)
    end = gauss_newton(problem, feasible, iterations=iterations, tolerance=tolerance, coarse=coarse)
    return model_at(problem, setup, end)


def converged(model: Model) -> Model:
    """The same model, optimised to the fine tolerance."""
    return optimized(model.problem, model.setup, model.theta, FINE_TOLERANCE)


def model_at(problem: Problem, setup: Setup, found: OptimizerResult) -> Model:
    """The model where an optimisation ended."""
    r, J = problem.jacobian(found.theta, found.difference_steps)
    return Model(setup.diagram, problem, setup, found.theta, r, J.with_finite_values())
