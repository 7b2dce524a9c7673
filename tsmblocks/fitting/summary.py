"""From the outcome of searches to a result: confidence intervals, active constraints, identifiability, remarks."""

from __future__ import annotations

import functools

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.common.interpolation import AUTO, hold_of_each
from tsmblocks.common.tables import listed
from tsmblocks.data import Record, cautions
from tsmblocks.engine.equations import Equations
from tsmblocks.fitting.above_noise import is_far, material_residuals, output_noise
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.held_inputs import alternative, held_input_notes
from tsmblocks.fitting.identifiability import NO_INFLUENCE, Undetermined, sizes, undetermined
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.input_checks import runs_ahead
from tsmblocks.fitting.input_noise import filtered_problem, input_noise_note
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.optimizer import OptimizerResult, is_same_optimum
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.fitting.residual_cause import fixed_in_doubt
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.result import Estimate, Fit
from tsmblocks.fitting.scale_notes import scale_notes
from tsmblocks.fitting.score import Differences, simulated_differences
from tsmblocks.fitting.setup import Setup, simulated_as
from tsmblocks.fitting.statistics import Uncertainty, intervals, uncertainty
from tsmblocks.fitting.step_size import COVERED, halved, limit_note, shift_note, shifts
from tsmblocks.model.diagram import Diagram

TOUCHING = 1e-7
"""Distance from a bound, relative to the parameter, that counts as none. Chosen."""
UNCERTAIN_VERDICT, OPEN_VERDICT = "uncertain", "not determined"
"""Verdicts on parameters with an interval that is wide, and without one."""
POOR = 50.0
"""Explained variation [%] below which the parameters before the fit may have led astray. Chosen."""
FEW_PER_PARAMETER = 3
"""Samples of all outputs for each parameter below which they are few. Chosen: the noise is then known to a fifth."""
NEXT_TO_NOTHING = 1.0
"""Explained variation [%] up to which a diagram explains hardly more than a constant. Chosen."""
DRIVES = 1.02
"""Mean square with filtered inputs over that without, above which their fast part drives the outputs, as that of a
command does, and is no noise. Chosen: filtering of noise never adds as much."""
MAX_DERIVATIVE_RATIO = 1e3
"""Derivative over the finite difference that was taken instead [norms] from which the outputs are erratic. Chosen: at
jumps and kinks of a simulation that resolves the motion they are alike but for a few times."""


@attrs.frozen(eq=False)
class _Optimum:
    """A problem where the search ended: unknowns, residuals, Jacobian, active constraints, and what these give.

    ``active`` holds words by unknown (or by name of a constraint), ``rows`` the gradients of what is active.
    """

    theta: np.ndarray
    residuals: np.ndarray
    jacobian: Jacobian
    active: dict[int | str, str]
    rows: np.ndarray | None
    prior: np.ndarray | None
    known: Uncertainty
    undetermined: tuple[Undetermined, ...]


def summarise(
    problem: Problem,
    setup: Setup,
    method: str,
    searches: list[OptimizerResult],
    known: Uncertainty | None = None,
    *,
    followed: bool = False,
) -> Fit:
    """The result of a fit from the outcomes of its searches, best first.

    ``known`` is the uncertainty that it reports; by default that of a fit whose active bounds are held. ``followed`` is
    whether finer steps were tried where the parameters call for them.
    """
    left_out, residuals, jacobian = _first_with_derivatives(problem, searches)
    best, unknowns = searches[left_out], problem.unknowns
    differences = simulated_differences(
        setup, [unknowns.parameters(best.theta, e) for e in range(len(setup.experiments))]
    )
    optimum = _optimum(problem, best, residuals, jacobian, known)
    diagrams = {name: _fitted(setup.diagram, problem, best.theta, e) for e, name in enumerate(unknowns.experiments)}
    simulation = simulated_as(setup, [_starts_of(problem, setup, best.theta, e) for e in range(len(diagrams))])
    diagrams = {name: diagram.with_simulation(simulation) for name, diagram in diagrams.items()}
    first, far = setup.experiments[0], _is_far(setup, differences)
    return Fit(
        diagram=next(iter(diagrams.values())),
        diagrams=diagrams,
        estimates=_estimates(problem, setup, optimum),
        differences=differences,
        covariance=optimum.known.covariance,
        undetermined=optimum.undetermined,
        active=tuple(optimum.active.values()),
        method=method,
        searches=(best, *searches[:left_out], *searches[left_out + 1 :]),
        agreeing=sum(is_same_optimum(problem, best, end) for end in searches),
        step=min(setup.steps.values()),
        integrator=first.rule.name,
        hold=setup.hold,
        records={experiment.name: experiment.record for experiment in setup.experiments},
        notes=(
            *setup.notes,
            *_left_out_notes(left_out, len(searches)),
            *_few_samples_notes(problem),
            *limit_note(problem, optimum.theta, followed=followed),
            *_erratic_note(problem, best, jacobian),
            *_step_notes(problem, setup, optimum),
            *scale_notes(setup, growth=min(d.fit_percent for d in differences) < POOR),
            *_data_notes(setup, differences),
            *_held_input_notes(problem, setup, optimum, far=far),
            *_input_noise_notes(problem, setup, optimum),
            *_known_parameter_notes(setup, [item.parameter for item in unknowns.items]),
        ),
        fixed_in_doubt=_fixed_in_doubt(problem, setup, optimum) if far else {},
    )


def _left_out_notes(left_out: int, count: int) -> list[str]:
    """A note where searches ended lower than the best of those that have derivatives there."""
    return [
        f"{left_out} of {count} searches ended at a lower residual, but where the outputs have no finite derivatives, "
        "as for friction that changes within a step: give a smaller step."
    ] * bool(left_out)


def _erratic_note(problem: Problem, best: OptimizerResult, differences: Jacobian) -> list[str]:
    """A warning where derivatives are many times the differences over a step that were taken instead of them."""
    if best.difference_steps is None:
        return []
    exact = problem.jacobian(best.theta)[1].norms
    norms = zip(problem.unknowns.names, exact, differences.norms, strict=True)
    erratic = [name for name, derivative, difference in norms if derivative > MAX_DERIVATIVE_RATIO * difference]
    if not erratic:
        return []
    return [
        f"the outputs change erratically with {listed(erratic, 3)}: more by tiny changes than by those of a hundredth. "
        "The simulation does not resolve a part of the motion, such as a friction that holds; intervals are rough, and "
        "parameters that act in combination only are not found. Give a smaller step, or bounds."
    ]


def _starts_of(problem: Problem, setup: Setup, theta: np.ndarray, e: int) -> dict[str, float]:
    """Initial states of experiment ``e`` alone: found, or given by the diagram's file."""
    unknowns, known = problem.unknowns, numbers(setup.diagram)
    own = dict(unknowns.starts[e]) if unknowns.starts else {}
    for k in unknowns.columns(e):
        item = unknowns.items[k]
        if item.experiment and is_start(known[item.parameter]):
            own[item.parameter] = float(theta[k])
    return own


def _first_with_derivatives(problem: Problem, searches: list[OptimizerResult]) -> tuple[int, np.ndarray, Jacobian]:
    """The first of the searches that ended where the outputs have derivatives; the residuals and these.

    Raises RunError, naming a parameter, where none did.
    """
    steep = ""
    for k, one in enumerate(searches):
        residuals, jacobian = problem.jacobian(one.theta, one.difference_steps)
        if jacobian.is_finite.all():
            return k, residuals, jacobian
        steep = steep or problem.unknowns.names[int(np.argmin(jacobian.is_finite))]
    raise RunError(
        f"the search ended where the derivative of the outputs with respect to {steep} is not finite, as for a "
        "square root at zero, or for friction that changes within a step. Start elsewhere, exclude this value by a "
        "bound, or give a smaller step."
    )


def _optimum(
    problem: Problem, best: OptimizerResult, residuals: np.ndarray, jacobian: Jacobian, known: Uncertainty | None = None
) -> _Optimum:
    """What is known where the best search ended, with the residuals and derivatives there."""
    theta, unknowns = best.theta, problem.unknowns
    active, gradients = active_constraints(problem, theta)
    rows = gradients if len(gradients) else None
    prior = np.diag(problem.prior_derivatives(theta)[1]) if len(problem.priors.which) else None
    noise = None if prior is None else problem.noise
    if known is None:
        known = uncertainty(jacobian, residuals, problem.segments, prior=prior, noise=noise, held=rows)
    if best.plateau is not None:  # anything between two jumps is as good
        known = attrs.evolve(known, covariance=known.covariance + np.diag(best.plateau**2 / 3))
    open_ = undetermined(
        jacobian,
        residuals,
        unknowns.names,
        theta,
        known,
        scales=unknown_sizes(problem, theta, jacobian),
        prior=prior,
        held=rows,
        low=unknowns.low,
        high=unknowns.high,
        nearest=best.plateau is None and best.status != "interrupted",
        units=[item.unit for item in unknowns.items],
    )
    return _Optimum(theta, residuals, jacobian, active, rows, prior, known, open_)


def _step_notes(problem: Problem, setup: Setup, at: _Optimum) -> list[str]:
    """Warnings where the confidence intervals do not cover the error of the step."""
    if (fine := halved(problem, setup)) is None:
        return []
    return shift_note(problem.unknowns.names, _moved(at, fine[0].residuals(at.theta)), setup.experiments[0].times.h)


def _is_far(setup: Setup, differences: Differences) -> bool:
    """Whether the residual of an output is far above its noise."""
    records = {experiment.name: experiment.record for experiment in setup.experiments}
    inputs = setup.diagram.inports
    return any(is_far(own, output_noise(own, records, inputs)[0]) for own in material_residuals(differences))


def _fixed_in_doubt(problem: Problem, setup: Setup, at: _Optimum) -> dict[str, tuple[str, ...]]:
    """Fixed parameters that may cause a residual far above the noise, by output."""
    space = column_space(at.jacobian, SQUARED_EFFECT_TOLERANCE, held=at.rows)
    return fixed_in_doubt(problem, setup, at.theta, at.residuals, space)


def _input_noise_notes(problem: Problem, setup: Setup, at: _Optimum) -> list[str]:
    """Warnings where the confidence intervals do not cover the noise of the inputs and nothing else reports it."""
    if any(rough_inputs(one.record, one.eq) for one in setup.experiments):
        return []
    filtered, inputs = filtered_problem(problem, setup)
    if not inputs:
        return []
    residuals = filtered.residuals(at.theta)
    other = alternative(at.jacobian, at.residuals, residuals, problem.segments, at.rows, len(setup.outputs))
    if other is not None and other.rest > DRIVES * square(at.residuals):  # a command
        return []
    return input_noise_note(problem.unknowns.names, _moved(at, residuals), inputs, COVERED)


def _held_input_notes(problem: Problem, setup: Setup, at: _Optimum, *, far: bool) -> list[str]:
    """Notes on inputs whose hold was not given, where the outputs show that they are held between samples."""
    given = hold_of_each(setup.given_hold, list(setup.diagram.inports))
    open_ = [name for name, hold in given.items() if hold == AUTO]
    return list(held_input_notes(problem, setup, at.theta, at.residuals, at.jacobian, at.rows, open_, far=far))


def _moved(at: _Optimum, residuals: np.ndarray) -> np.ndarray:
    """How far each number moves, in half widths of its interval, in a version of the problem with these residuals."""
    low, high = intervals(at.theta, at.known.covariance, at.known.freedom)
    return shifts(at.residuals, residuals, at.jacobian, (high - low) / 2, prior=at.prior, held=at.rows)


def unknown_sizes(problem: Problem, theta: np.ndarray, jacobian: Jacobian) -> np.ndarray:
    """Magnitude of each unknown; of one that started at zero, what changes the outputs by their own norm."""
    made = sizes(theta, problem.unknowns.start, problem.unknowns.low, problem.unknowns.high)
    natural = natural_sizes(problem, jacobian)
    return np.where((natural > 0) & (natural < made), np.maximum(np.abs(theta), natural), made)


def natural_sizes(problem: Problem, jacobian: Jacobian) -> np.ndarray:
    """What changes the outputs by their own norm of each unknown that started at zero; 0 of all others."""
    low, high, start = problem.unknowns.low, problem.unknowns.high, problem.unknowns.start
    sensitivity, whole = jacobian.norms, problem.size * np.sqrt(problem.samples)
    open_ = (start == 0) & ~np.isfinite(high - low) & (sensitivity > 0) & (whole > 0)
    return np.where(open_, whole / np.where(open_, sensitivity, 1.0), 0.0)


def _fitted(diagram: Diagram, problem: Problem, theta: np.ndarray, e: int) -> Diagram:
    """The diagram of an experiment. Raises the message of a block that refuses its parameters."""
    settings = problem.unknowns.settings(theta, e)
    try:
        return diagram.with_parameters(settings)
    except ParameterError as error:
        raise ParameterError(
            f"the fit ended where a block refuses its parameters: {error} Exclude them by bounds or a constraint."
        ) from None


def active_constraints(problem: Problem, theta: np.ndarray) -> tuple[dict[int | str, str], np.ndarray]:
    """Active bounds and constraints: words by unknown (or by name of a constraint), and their gradients (m, n)."""
    words: dict[int | str, str] = {}
    rows = []
    for k, item in enumerate(problem.unknowns.items):
        near = TOUCHING * max(abs(theta[k]), abs(item.start))  # relative: a parameter may have any size
        for bound, side in ((item.low, "lower"), (item.high, "upper")):
            if abs(theta[k] - bound) <= near:
                words[k] = f"the {side} bound of {item.name} ({bound:.4g})"
                rows.append(np.eye(len(theta))[k])
    constraints = problem.constraints
    values, jacobian = constraints.values(theta), constraints.jacobian(theta)
    for name, value, row, equal in zip(constraints.names, values, jacobian, constraints.equal, strict=True):
        if equal or abs(value) <= TOUCHING * max(float(np.abs(row * theta).max(initial=0.0)), 1e-3):
            words[name] = f"the constraint {name}"
            rows.append(row)
    return words, np.array(rows).reshape(len(rows), len(theta))


def _estimates(problem: Problem, setup: Setup, at: _Optimum) -> tuple[Estimate, ...]:
    """Each unknown with its confidence interval."""
    theta, known = at.theta, at.known
    low, high = intervals(theta, known.covariance, known.freedom)
    open_ = {name for u in at.undetermined if u.exact for name in u.names}
    free = np.array([k not in at.active for k in range(len(theta))])
    alone = np.array([name not in open_ for name in problem.unknowns.names])
    has_error = free & alone & np.isfinite(known.errors) & (known.errors > 0)
    errors, low, high = (np.where(has_error, v, np.nan) for v in (known.errors, low, high))
    verdicts = {name: _verdict(u) for u in sorted(at.undetermined, key=lambda u: u.exact) for name in u.names}
    fields = numbers(setup.diagram)
    made = []
    for k, item in enumerate(problem.unknowns.items):
        if not free[k]:
            lower = theta[k] == item.low or abs(theta[k] - item.low) < abs(theta[k] - item.high)
            verdict = f"at its {'lower' if lower else 'upper'} bound"
        else:
            verdict = verdicts.get(item.name, "") or ("held by a constraint" if known.errors[k] == 0 else "")
        start = is_start(fields.get(item.parameter, []))
        value, error, lowest, highest = (float(v[k]) for v in (theta, errors, low, high))
        made.append(
            Estimate(item.name, value, error, lowest, highest, item.unit, item.about, item.start, verdict, start)
        )
    return tuple(made)


def _verdict(found: Undetermined) -> str:
    """The verdict on a parameter: not determined where it has no interval, uncertain where it has a wide one."""
    if found.kind == NO_INFLUENCE:
        return NO_INFLUENCE
    return OPEN_VERDICT if found.exact else UNCERTAIN_VERDICT


def rough_inputs(record: Record, eq: Equations) -> tuple[str, ...]:
    """Cautions on inputs whose rate drives a model, a sentence for each that is noisy or quantised."""
    rates = (f.name.removeprefix("d/dt " * f.order) for f in eq.u if f.order and not f.block)
    return _cautions(record, tuple(dict.fromkeys(rates)))


_cautions = functools.lru_cache(maxsize=32)(cautions)
"""Cautions on inputs (kept, since one recording is fitted many times)."""


def _known_parameter_notes(setup: Setup, free: list[str]) -> list[str]:
    """Free parameters that data sheets give: the counts of an encoder have a minimum for each of them."""
    fields = numbers(setup.diagram)
    return [
        f"{name} is usually known. A search finds such a parameter only from a start nearby, and its interval holds "
        "only around the value found: compare the residual with that for the value on the data sheet."
        for name in dict.fromkeys(free)
        if any(f.known and not f.factor and f.by_definition is None for f in fields[name])
    ]


def _few_samples_notes(problem: Problem) -> list[str]:
    """A note on samples that are few for the parameters."""
    samples, count = problem.samples, len(problem.unknowns.items)
    if samples >= FEW_PER_PARAMETER * count:
        return []
    return [
        f"{samples} samples are few for {count} parameter{'s' if count > 1 else ''}: they hardly show what the model "
        "lacks, and the intervals rest on noise that is itself uncertain. Give more samples, or free fewer parameters."
    ]


def _data_notes(setup: Setup, differences: Differences) -> list[str]:
    """Inputs that never move or are mostly noise, clocks that may differ, models that explain less than a constant."""
    said = []
    for experiment in setup.experiments:
        name, record = experiment.name, experiment.record
        still = [k for k in setup.diagram.inports if np.ptp(record[k]) == 0]
        said += [f"{name}: the input {k} never changes, so it excites nothing." for k in still]
        said += [f"{name}: {text}" for text in rough_inputs(record, experiment.eq)]
        if not setup.diagram.inports and record.t[0] != 0:
            said.append(
                f"{name}: no measured signal drives the diagram. Its sources use the time of the recording, and it is "
                f"at rest until the recording begins, at {record.t[0]:g} s."
            )
    said += [
        f"{d.experiment}: the diagram explains {d.output} {'no' if d.fit_percent <= 0 else 'hardly'} better than "
        "its mean does."
        for d in differences
        if d.fit_percent <= NEXT_TO_NOTHING
    ]
    for d in differences:
        ahead = (runs_ahead((k, d.output), d.t, x, d.measured, d.simulated) for k, (x, _) in d.inputs.items())
        said += [f"{d.experiment}: {text}" for text in ahead if text]
    return said
