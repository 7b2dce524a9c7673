"""The error of a fit due to the step of the simulation: how far the parameters move when the step is halved."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.common.rounding import to_digits
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.optimizer import OptimizerResult
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.statistics import moved
from tsmblocks.simulation.stability import RunStart, fastest_growing_pole

COVERED = 0.5
"""Change of a number by halving the step, in half widths of its interval, that the interval does not cover any more.

At a kink the error falls in proportion to the step, so the remaining error is as large again.
"""
STEP_MARGIN = 1.5
"""Ratio of steps within which the fastest pole is at the limit of stability. Chosen: nearer to it, a lag is simulated
so wrongly that a search ends somewhat below it."""
MOST_HALVINGS = 3
"""Times that a step is halved to follow the parameters, at most. Chosen: for the run time."""
FAR = 100.0
"""Such a change above which no figure is reported, only that it is larger. Chosen."""


def halved(problem: Problem, setup: Setup) -> tuple[Problem, Setup] | None:
    """The same problem simulated at half its step; None where that makes more steps than fit into memory."""
    finer = setup.finer or [None] * len(setup.experiments)
    try:
        fine = tuple(
            half or setup.prepared(e, step=experiment.times.h / 2)
            for e, (experiment, half) in enumerate(zip(setup.experiments, finer, strict=True))
        )
    except RunError:
        return None
    return attrs.evolve(problem, experiments=fine), attrs.evolve(setup, experiments=fine, finer=())


def state_at_limit(problem: Problem, theta: np.ndarray, margin: float = STEP_MARGIN) -> str:
    """The state whose pole is as fast as a step of ``margin`` times this one allows, ``""`` where there is none.

    A search cannot go further there: at a faster pole the simulation is unstable. The value found follows from the step
    and not from the data.
    """
    for e, experiment in enumerate(problem.experiments):
        run = RunStart(experiment.eq, problem.unknowns.parameters(theta, e), experiment.times.start)
        found = fastest_growing_pole(run, experiment.rule, margin * experiment.times.h)
        if found is not None:
            return found.state
    return ""


def following(
    problem: Problem, setup: Setup, end: OptimizerResult, search: Callable[[Problem, np.ndarray], OptimizerResult]
) -> tuple[Problem, Setup, OptimizerResult]:
    """The end of a search whose step is halved, and the search continued, while the step limits the parameters.

    Where they follow every step to its limit, no step is fine enough, and the first one stays.
    """
    first = problem, setup, end
    for _ in range(MOST_HALVINGS):
        if end.status == "interrupted" or not state_at_limit(problem, end.theta):
            return problem, setup, end
        if (fine := halved(problem, setup)) is None:
            return first
        problem, setup = fine
        if not np.isfinite(problem.cost(end.theta)):
            return first
        end = search(problem, end.theta)
    return first if state_at_limit(problem, end.theta) else (problem, setup, end)


def limit_note(problem: Problem, theta: np.ndarray, *, followed: bool = False) -> list[str]:
    """A warning where the step limits the search; ``followed`` is whether it did so at finer steps as well."""
    state = state_at_limit(problem, theta)
    if not state:
        return []
    step = problem.experiments[0].times.h
    if state_at_limit(problem, theta, 1 / STEP_MARGIN):  # it did go further, as a friction that holds lets it
        return [
            f"{state} changes faster than a step of {step:.3g} s can simulate, as where a steep friction holds: the "
            "parameters that set how fast may follow from the step. Compare a fit with a smaller step."
        ]
    finer = ", and so it does at finer steps" if followed else ""
    advice = (
        "Fix them, or give bounds; the model may lack an effect" if followed else "Give a smaller step, or fix them"
    )
    return [
        f"{state} changes as fast as a step of {step:.3g} s can simulate{finer}: the parameters that set how fast "
        f"follow from the step and not from the data. {advice}."
    ]


def shifts(
    one: np.ndarray,
    other: np.ndarray,
    J: np.ndarray | Jacobian,
    half_widths: np.ndarray,
    *,
    prior: np.ndarray | None = None,
    held: np.ndarray | None = None,
) -> np.ndarray:
    """How far each number moves from one simulation to another, shape (p,): half widths of its interval, or 0 without.

    ``one`` and ``other`` (N,) are the residuals with the same numbers, ``J`` (N, p) their derivatives. ``prior`` and
    ``held`` as for ``uncertainty``. An other simulation that diverges counts as an infinite change.
    """
    known = np.isfinite(half_widths) & (half_widths > 0)
    if not np.isfinite(other).all():
        return np.where(known, np.inf, 0.0)
    change = moved(J, other - one, prior=prior, held=held)
    return np.where(known, np.abs(change) / np.where(known, half_widths, 1.0), 0.0)


def shift_note(names: Sequence[str], changes: np.ndarray, step: float) -> list[str]:
    """A warning where the intervals do not cover the error of the step [s]; ``changes`` as of ``shifts``."""
    if not len(changes) or not changes.max() > COVERED:
        return []
    worst, others = int(np.argmax(changes)), int(np.sum(changes > COVERED)) - 1
    size = f"{to_digits(changes[worst])} times" if changes[worst] < FAR else f"more than {FAR:g} times"
    rest = f" and {others} other{'s' if others > 1 else ''} by more than half of theirs" if others else ""
    return [
        f"halving the step of {step:.3g} s moves {names[worst]} by {size} the half width of its interval{rest}: "
        "the intervals do not cover the error of the step; give a smaller step."
    ]
