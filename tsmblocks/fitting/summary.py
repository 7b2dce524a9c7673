"""From the ends of searches to a result: intervals, what is held, what is left open, what to beware of."""

from __future__ import annotations

import functools

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.data import Record, cautions
from tsmblocks.engine.equations import Equations
from tsmblocks.fitting.identifiability import Undetermined, sizes, undetermined
from tsmblocks.fitting.input_checks import runs_ahead, standing
from tsmblocks.fitting.optimizer import Found
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.result import Estimate, Fit
from tsmblocks.fitting.score import Differences, between
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.statistics import Uncertainty, intervals, uncertainty
from tsmblocks.fitting.step_size import halved, shift_note, shifts
from tsmblocks.model.diagram import Diagram

TOUCHING = 1e-7
"""Distance from a bound, as a share of the parameter's size, that counts as none."""
VERDICTS = {"no influence": "no influence", "combination": "not determined", "uncertain": "uncertain"}
"""What a table says of a parameter that the data leave open, by kind."""
NEXT_TO_NOTHING = 1.0
"""Fit [%] up to which a diagram says hardly more than a constant would."""
SAME = 1.0
"""Costs that differ by less than this many variances of a sample belong to one optimum."""


def summed_up(problem: Problem, setup: Setup, method: str, found: list[Found]) -> Fit:
    """The result of a fit from the ends of its searches, best first."""
    best, unknowns = found[0], problem.unknowns
    theta = best.theta
    differences = between(setup, [unknowns.parameters(theta, e) for e in range(len(setup.trials))])
    r, jacobian = problem.jacobian(theta) if best.reach is None else problem.secants(theta, best.reach)
    steep = ~np.isfinite(jacobian).all(axis=0)
    if steep.any():
        name = np.array(unknowns.names)[steep][0]
        raise RunError(
            f"the search ended where the slope of the outputs along {name} is no number, as that of a "
            "square root at zero. Start elsewhere, or bound it away."
        )
    where, rows = held(problem, theta)
    prior = np.diag(problem.prior_slopes(theta)[1]) if len(problem.priors.which) else None
    fixed = rows if len(rows) else None
    known = uncertainty(
        jacobian, r, problem.segments, prior=prior, noise=None if prior is None else problem.noise, held=fixed
    )
    if best.blur is not None:  # anything between two jumps is as good
        known = attrs.evolve(known, covariance=known.covariance + np.diag(best.blur**2 / 3))
    scales = _sizes(problem, theta, jacobian)
    open_ = undetermined(
        jacobian,
        r,
        unknowns.names,
        theta,
        known,
        scales=scales,
        prior=prior,
        held=fixed,
        low=unknowns.low,
        high=unknowns.high,
    )
    diagrams = {name: _fitted(setup.diagram, problem, theta, e) for e, name in enumerate(unknowns.experiments)}
    variance = max(2 * best.cost / max(problem.samples, 1), problem.rounding)
    agreeing = sum(abs(f.cost - best.cost) <= SAME * variance for f in found)
    seen = _Seen(theta, r, jacobian, known, prior, fixed)
    notes = [
        *setup.notes,
        *_of_the_step(problem, setup, seen),
        *_remarks(setup, differences),
        *_of_what_is_known(setup, [item.parameter for item in unknowns.items]),
    ]
    return Fit(
        next(iter(diagrams.values())),
        diagrams,
        _estimates(problem, setup, theta, known, where, open_),
        differences,
        known.covariance,
        open_,
        tuple(where.values()),
        method,
        tuple(found),
        agreeing,
        setup.trials[0].times.h,
        setup.trials[0].rule.name,
        setup.trials[0].hold,
        {trial.name: trial.record for trial in setup.trials},
        tuple(notes),
    )


@attrs.frozen(eq=False)
class _Seen:
    """A problem where the search ended: unknowns, residuals, their derivatives, and what these tell."""

    theta: np.ndarray
    r: np.ndarray
    J: np.ndarray
    known: Uncertainty
    prior: np.ndarray | None
    held: np.ndarray | None


def _of_the_step(problem: Problem, setup: Setup, seen: _Seen) -> list[str]:
    """Words of warning where the intervals do not cover the error of the step."""
    try:
        fine, _ = halved(problem, setup)
    except RunError:  # more steps than fit into memory
        return []
    low, high = intervals(seen.theta, seen.known.covariance, seen.known.freedom)
    off = shifts(seen.r, fine.residuals(seen.theta), seen.J, (high - low) / 2, prior=seen.prior, held=seen.held)
    return shift_note(problem.unknowns.names, off, setup.trials[0].times.h)


def _sizes(problem: Problem, theta: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """What counts as all of each unknown; of one that began at zero, what moves the outputs as far as they went."""
    low, high, start = problem.unknowns.low, problem.unknowns.high, problem.unknowns.start
    made, feel = sizes(theta, start, low, high), np.linalg.norm(jacobian, axis=0)
    whole = problem.size * np.sqrt(problem.samples)
    open_ = (start == 0) & ~np.isfinite(high - low) & (feel > 0) & (whole > 0)
    natural = whole / np.where(open_, feel, 1.0)
    return np.where(open_ & (natural < made), np.maximum(np.abs(theta), natural), made)


def _fitted(diagram: Diagram, problem: Problem, theta: np.ndarray, e: int) -> Diagram:
    """The diagram of an experiment. A block that refuses the numbers together says so."""
    settings = problem.unknowns.settings(theta, e)
    try:
        return diagram.with_parameters(settings)
    except ParameterError as error:
        raise ParameterError(
            f"the fit ended where a block refuses its numbers: {error} A constraint would keep it away from there."
        ) from None


def held(problem: Problem, theta: np.ndarray) -> tuple[dict[int | str, str], np.ndarray]:
    """What holds the result: words by unknown (or by name of a constraint), and the gradients (m, n)."""
    words: dict[int | str, str] = {}
    rows = []
    for k, item in enumerate(problem.unknowns.items):
        near = TOUCHING * max(abs(theta[k]), 1e-3)
        for bound, side in ((item.low, "lower"), (item.high, "upper")):
            if abs(theta[k] - bound) <= near:
                words[k] = f"the {side} bound of {item.name} ({bound:.4g})"
                rows.append(np.eye(len(theta))[k])
    if problem.limits.names:
        values, slopes = problem.limits.values(theta), problem.limits.slopes(theta)
        for name, value, slope, equal in zip(problem.limits.names, values, slopes, problem.limits.equal, strict=True):
            if equal or abs(value) <= TOUCHING * max(float(np.abs(slope * theta).max(initial=0.0)), 1e-3):
                words[name] = f"the constraint {name}"
                rows.append(slope)
    return words, np.array(rows).reshape(len(rows), len(theta))


def _estimates(
    problem: Problem,
    setup: Setup,
    theta: np.ndarray,
    known: Uncertainty,
    where: dict[int | str, str],
    open_: tuple[Undetermined, ...],
) -> tuple[Estimate, ...]:
    low, high = intervals(theta, known.covariance, known.freedom)
    verdicts = {name: VERDICTS[u.kind] for u in open_ for name in u.names}
    fields = numbers(setup.diagram)
    made = []
    for k, item in enumerate(problem.unknowns.items):
        side = "lower" if theta[k] == item.low or abs(theta[k] - item.low) < abs(theta[k] - item.high) else "upper"
        verdict = f"at its {side} bound" if k in where else verdicts.get(item.name, "")
        said = k not in where and 0 < known.errors[k] < np.inf
        verdict = verdict or ("held by a constraint" if known.errors[k] == 0 else "")
        made.append(
            Estimate(
                item.name,
                float(theta[k]),
                float(known.errors[k]) if said else float("nan"),
                float(low[k]) if said else float("nan"),
                float(high[k]) if said else float("nan"),
                item.unit,
                item.about,
                item.start,
                verdict,
                is_start(fields.get(item.parameter, [])),
            )
        )
    return tuple(made)


def rough_inputs(record: Record, eq: Equations) -> tuple[str, ...]:
    """What to mind of the inputs whose rate drives a model, a sentence for each that is noisy or goes in steps."""
    rates = {f.name.removeprefix("d/dt " * f.order): None for f in eq.u if f.order and not f.block}
    return _cautions(record, tuple(rates))


@functools.lru_cache(maxsize=32)
def _cautions(record: Record, names: tuple[str, ...]) -> tuple[str, ...]:
    """What to mind of inputs (kept, since one recording is fitted many times)."""
    return cautions(record, names)


def _of_what_is_known(setup: Setup, free: list[str]) -> list[str]:
    """Numbers that were freed though data sheets say them: counts of an encoder have a valley for each of them."""
    fields = numbers(setup.diagram)
    return [
        f"{name} is as a rule known. A search finds such a number only from close by, and its interval is that of "
        "where this one ended: compare what is left with what the number on the data sheet leaves."
        for name in dict.fromkeys(free)
        if any(f.known for f in fields[name])
    ]


def _remarks(setup: Setup, differences: Differences) -> list[str]:
    """Inputs that never move or are mostly noise, clocks that may differ, models that say less than a constant."""
    said = []
    for trial in setup.trials:
        still = [k for k in setup.diagram.inports if np.ptp(trial.record[k]) == 0]
        said += [f"{trial.name}: the input {k} never changes, so it excites nothing." for k in still]
        said += [f"{trial.name}: {text}" for text in rough_inputs(trial.record, trial.eq)]
        said += [f"{trial.name}: {text}" for text in standing(trial.record, setup.diagram.inports, trial.hold)]
        begins = trial.record.t[0]
        if not setup.diagram.inports and begins != 0:
            said.append(
                f"{trial.name}: nothing that was measured drives the diagram. Its sources run by the clock "
                f"of the recording, and it is at rest until that begins, at {begins:g} s."
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
