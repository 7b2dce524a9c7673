"""The default method: Gauss-Newton with Levenberg-Marquardt damping, in bounds and under constraints.

Each step is a quadratic programme on the exact derivatives of the simulation, so bounds and
constraints are part of the step and not a penalty beside it.
"""

from __future__ import annotations

from typing import NamedTuple

import attrs
import numpy as np

from tsmblocks.fitting.optimizer import (
    CONSTRAINT_TOLERANCE,
    OptimizerResult,
    ProgressCallback,
    linearised_constraints,
    no_progress,
    within_bounds,
)
from tsmblocks.fitting.quadratic_program import Infeasible, quadratic_step
from tsmblocks.fitting.residuals import Problem

FIRST_DAMPING, LEAST_DAMPING = 1e-3, 1e-13
"""First and least damping, relative to the diagonal of the matrix. Chosen: the least is next to rounding."""
GAIN_TOLERANCE = 1e-8
"""Predicted gain of a step, in variances of one sample, below which the search has converged.

Chosen: such a step changes no printed digit.
"""
ROUNDING = 1e-14
"""Predicted gain relative to the cost that is lost in rounding. Chosen: about 100 times the precision of a double."""
DIFFERENCE_STEPS = (1e-1, 1e-2)
"""Steps of finite differences relative to each unknown, where exact derivatives lead to no descent. Chosen."""
LARGEST_CHANGE = 1e3
"""Largest change of an unknown in one step, in multiples of its magnitude. Chosen: no limit to ordinary steps."""
LEAST_GAIN = 1e-6
"""Gain relative to the cost below which finite differences are given up. Chosen."""
MOST_DAMPINGS = 16
"""Dampings that are tried before the search counts as stalled. Chosen."""


@attrs.define(eq=False)
class _State:
    """The current point of the search, with cost and derivatives.

    ``penalty`` weights constraint violations in the merit function. ``steps`` are those of finite differences, None for
    exact derivatives.
    """

    theta: np.ndarray
    cost: float
    gradient: np.ndarray
    matrix: np.ndarray
    damping: float = FIRST_DAMPING
    penalty: float = 0.0
    evaluations: int = 2  # values with derivatives count as two runs
    steps: np.ndarray | None = None
    tolerance: float = GAIN_TOLERANCE


class _Step(NamedTuple):
    """A trial step: its end and the predicted gain."""

    theta: np.ndarray
    predicted: float


def gauss_newton(
    problem: Problem,
    start: np.ndarray,
    *,
    iterations: int = 100,
    progress: ProgressCallback = no_progress,
    tolerance: float = GAIN_TOLERANCE,
    coarse: bool = True,
    steps: np.ndarray | None = None,
) -> OptimizerResult:
    """Search downhill from ``start``, which must be in the bounds and simulate to finite numbers.

    Ends when the predicted gain of a step is below ``tolerance`` variances of one sample, by default far below any
    standard error. With ``steps`` (unknowns,) derivatives are differences over that far; without, where they lead to no
    descent, ``coarse`` continues with such differences. After Ctrl-C the best so far is returned.
    Source: Nocedal and Wright, Numerical Optimization (2006), 10.3 and 18; damping as Nielsen, IMM-REP-1999-05.
    """
    state = _State(start, *problem.normal(start, steps), steps=steps, tolerance=tolerance)
    history, status = [state.cost], "limit"
    try:
        status = _search(problem, state, history, iterations, progress)
        for share in DIFFERENCE_STEPS if coarse and steps is None and status == "stalled" else ():
            wide = share * _magnitudes(problem, state, start)
            rough = attrs.evolve(state, steps=wide, damping=FIRST_DAMPING)
            rough.cost, rough.gradient, rough.matrix = problem.normal(rough.theta, wide)
            ended = _search(problem, rough, history, iterations, progress)
            if rough.cost >= state.cost * (1 - LEAST_GAIN):  # differences find no descent either
                break
            state, status = rough, ended
    except KeyboardInterrupt:
        status = "interrupted"
    return OptimizerResult(
        state.theta, state.cost, status, len(history) - 1, state.evaluations, tuple(history), state.steps
    )


def _magnitudes(problem: Problem, state: _State, start: np.ndarray) -> np.ndarray:
    """Magnitude of each unknown; of one that is and was zero, the change that moves the outputs by their norm, or 1."""
    sensitivity, signal_norm = np.sqrt(np.diag(state.matrix)), problem.size * np.sqrt(problem.samples) or 1.0
    size = np.maximum(np.abs(state.theta), np.abs(start))
    has_effect = np.isfinite(sensitivity) & (sensitivity > 1e-150)
    return np.where(size > 0, size, np.where(has_effect, signal_norm / np.where(has_effect, sensitivity, 1.0), 1.0))


def _search(problem: Problem, state: _State, history: list[float], iterations: int, progress: ProgressCallback) -> str:
    """Iterate until the search ends; returns the status."""
    for _ in range(iterations):
        ended = _iterate(problem, state)
        history.append(state.cost)
        progress("gauss-newton", state.evaluations, state.cost)
        if ended:
            return ended
    return "limit"


def _iterate(problem: Problem, state: _State) -> str:
    """One step, with more damping until it reduces the merit; the status where the search ends, else ``""``."""
    grow = 2.0
    for _ in range(MOST_DAMPINGS):
        step = _step(problem, state, state.damping)
        if step is None:
            return "stalled"
        if _negligible(problem, state, step):
            undamped = _step(problem, state, LEAST_DAMPING)  # only the damping may have made it negligible
            return "converged" if undamped is None or _negligible(problem, state, undamped) else "stalled"
        # Most steps are good, so derivatives are computed at once; of a step in doubt the cost alone.
        new = problem.normal(step.theta, state.steps) if grow == 2.0 else None
        cost = new[0] if new is not None else problem.cost(step.theta)
        state.evaluations += 2 if new is not None else 1
        gained = _merit(problem, state, state.theta, state.cost) - _merit(problem, state, step.theta, cost)
        if gained > 1e-4 * step.predicted:
            if new is None:
                state.evaluations += 2
            state.theta = step.theta
            state.cost, state.gradient, state.matrix = new or problem.normal(step.theta, state.steps)
            share = min(gained / step.predicted, 2.0)
            state.damping = max(state.damping * max(1 / 5, 1 - (2 * share - 1) ** 3), LEAST_DAMPING)
            return ""
        state.damping, grow = max(state.damping, 1e-9) * grow, 2 * grow
    return "stalled"


def _step(problem: Problem, state: _State, damping: float) -> _Step | None:
    """The step of the damped quadratic model, in variables scaled by the sensitivity of the outputs."""
    sensitivity = np.sqrt(np.diag(state.matrix))
    if not np.isfinite(state.matrix).all():
        return None
    signal_norm, initial = problem.size * np.sqrt(problem.samples) or 1.0, np.abs(problem.unknowns.start)
    # Unknowns on which the outputs hardly depend must stay near their values; one that started at zero need not.
    longest = np.where(initial > 0, LARGEST_CHANGE * np.maximum(np.abs(state.theta), initial) / signal_norm, np.inf)
    size = np.where(
        sensitivity > 1e-150, np.minimum(1 / np.maximum(sensitivity, 1e-150), longest), np.maximum(initial, 1e-6)
    )
    rows, bounds, equal = linearised_constraints(problem, state.theta)
    matrix = state.matrix * size[:, None] * size  # one after the other: the product of two sizes may overflow
    damped = matrix + damping * np.eye(len(size))
    try:
        scaled, multipliers = quadratic_step(damped, state.gradient * size, rows * size, bounds, equal)
    except (Infeasible, np.linalg.LinAlgError):
        return None
    own = multipliers[len(multipliers) - len(problem.constraints.names) :]
    state.penalty = max(state.penalty, 2 * float(np.abs(own).max(initial=0.0)))
    d = scaled * size
    predicted = -float(state.gradient @ d + 0.5 * d @ state.matrix @ d)
    violation = problem.violation(state.theta)
    return _Step(within_bounds(problem, state.theta + d), predicted + state.penalty * violation)


def _negligible(problem: Problem, state: _State, step: _Step) -> bool:
    """Whether the predicted gain of a step is negligible."""
    if problem.violation(state.theta) > CONSTRAINT_TOLERANCE:
        return False
    variance = 2 * state.cost / max(problem.samples, 1)
    unchanged = np.abs(step.theta - state.theta) <= 1e-12 * np.maximum(np.abs(state.theta), 1e-12)
    return bool(
        step.predicted <= max(state.tolerance * variance, ROUNDING * state.cost, problem.rounding) or unchanged.all()
    )


def _merit(problem: Problem, state: _State, theta: np.ndarray, cost: float) -> float:
    """Cost plus the penalty of constraint violations."""
    violation = problem.violation(theta)
    return cost + state.penalty * violation if np.isfinite(cost) and np.isfinite(violation) else np.inf
