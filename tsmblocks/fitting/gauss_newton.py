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
from tsmblocks.fitting.quadratic_program import Infeasible, reduced_step
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
FAR_WORSE = 2.0
"""Cost after a step over that before from which the step went too far in what hardly matters. Chosen: ordinary steps
that fail, by the curvature of the outputs, end below it at some damping."""
LITTLE_EFFECT = 0.03
"""Change of the outputs by one unknown, in that of the whole step, below which it stays where it is after such a step.
Chosen: a thousandth of the predicted gain."""
MOST_DAMPINGS = 16
"""Dampings that are tried before the search counts as stalled. Chosen."""


class _Step(NamedTuple):
    """A trial step: its end and the predicted gain."""

    theta: np.ndarray
    predicted: float


@attrs.define(eq=False)
class _Search:
    """The current point of a search, with cost and derivatives.

    ``penalty`` weights constraint violations in the merit function. ``steps`` are those of finite differences, None for
    exact derivatives. A ``careful`` search leaves unknowns of little effect where they are after steps that go too far.
    """

    problem: Problem
    theta: np.ndarray
    cost: float
    gradient: np.ndarray
    matrix: np.ndarray
    steps: np.ndarray | None
    tolerance: float
    damping: float = FIRST_DAMPING
    penalty: float = 0.0
    careful: bool = False
    evaluations: int = 2  # values with derivatives count as two runs

    def run(self, history: list[float], iterations: int, progress: ProgressCallback) -> str:
        """Iterate until the search ends; returns the status."""
        for _ in range(iterations):
            ended = self.iterate()
            history.append(self.cost)
            progress("gauss-newton", self.evaluations, self.cost)
            if ended:
                return ended
        return "limit"

    def iterate(self) -> str:
        """One step, with more damping until it reduces the merit; the status where the search ends, else ``""``."""
        grow, kept = 2.0, np.zeros(len(self.theta), dtype=bool)
        for _ in range(MOST_DAMPINGS):
            step = self.step(self.damping, kept)
            if step is None:
                return "stalled"
            if self.negligible(step):
                undamped = self.step(LEAST_DAMPING)  # only the damping may have made it negligible
                return "converged" if undamped is None or self.negligible(undamped) else "stalled"
            # Most steps are good, so derivatives are computed at once; of a step in doubt the cost alone.
            new = self.problem.normal(step.theta, self.steps) if grow == 2.0 else None
            cost = new[0] if new is not None else self.problem.cost(step.theta)
            self.evaluations += 2 if new is not None else 1
            gained = self.merit(self.theta, self.cost) - self.merit(step.theta, cost)
            if gained > 1e-4 * step.predicted:
                if new is None:
                    self.evaluations += 2
                self.cost, self.gradient, self.matrix = new or self.problem.normal(step.theta, self.steps)
                self.theta = step.theta
                share = min(gained / step.predicted, 2.0)
                self.damping = max(self.damping * max(1 / 5, 1 - (2 * share - 1) ** 3), LEAST_DAMPING)
                return ""
            if self.careful and not cost <= FAR_WORSE * self.cost:
                kept = kept | self.of_little_effect(step)
            self.damping, grow = max(self.damping, 1e-9) * grow, 2 * grow
        return "stalled"

    def of_little_effect(self, step: _Step) -> np.ndarray:
        """The unknowns (n,) that change the outputs little in a step, however far they go in it.

        The initial states of what a play does not transmit yet have next to no effect at first, and go far for little.
        """
        moved = np.sqrt(np.diag(self.matrix)) * np.abs(step.theta - self.theta)
        return np.asarray(moved < LITTLE_EFFECT * np.sqrt(2 * max(step.predicted, 0.0)))

    def step(self, damping: float, kept: np.ndarray | None = None) -> _Step | None:
        """The step of the damped quadratic model, in variables scaled by the sensitivity of the outputs.

        Unknowns that are ``kept`` (n,) stay where they are.
        """
        problem, sensitivity = self.problem, np.sqrt(np.diag(self.matrix))
        if not np.isfinite(self.matrix).all():
            return None
        initial = np.abs(problem.unknowns.start)
        # Unknowns on which the outputs hardly depend must stay near their values; one that started at zero need not.
        nearby = LARGEST_CHANGE * np.maximum(np.abs(self.theta), initial) / _signal_norm(problem)
        longest = np.where(initial > 0, nearby, np.inf)
        size = np.where(
            sensitivity > 1e-150, np.minimum(1 / np.maximum(sensitivity, 1e-150), longest), np.maximum(initial, 1e-6)
        )
        if kept is not None:
            size = np.where(kept, 0.0, size)
        rows, bounds, equal = linearised_constraints(problem, self.theta)
        matrix = self.matrix * size[:, None] * size  # one after the other: the product of two sizes may overflow
        damped = matrix + damping * np.eye(len(size))
        try:
            scaled, multipliers = reduced_step(
                damped, self.gradient * size, rows * size, bounds, equal, problem.unknowns.own
            )
        except (Infeasible, np.linalg.LinAlgError):
            return None
        own = multipliers[len(multipliers) - len(problem.constraints.names) :]
        self.penalty = max(self.penalty, 2 * float(np.abs(own).max(initial=0.0)))
        d = scaled * size
        predicted = -float(self.gradient @ d + 0.5 * d @ self.matrix @ d)
        violation = problem.violation(self.theta)
        return _Step(within_bounds(problem, self.theta + d), predicted + self.penalty * violation)

    def negligible(self, step: _Step) -> bool:
        """Whether the predicted gain of a step is negligible."""
        problem = self.problem
        if problem.violation(self.theta) > CONSTRAINT_TOLERANCE:
            return False
        variance = 2 * self.cost / max(problem.samples, 1)
        unchanged = np.abs(step.theta - self.theta) <= 1e-12 * np.maximum(np.abs(self.theta), 1e-12)
        least = max(self.tolerance * variance, ROUNDING * self.cost, problem.rounding)
        return bool(step.predicted <= least or unchanged.all())

    def merit(self, theta: np.ndarray, cost: float) -> float:
        """Cost plus the penalty of constraint violations."""
        violation = self.problem.violation(theta)
        return cost + self.penalty * violation if np.isfinite(cost) and np.isfinite(violation) else np.inf

    def magnitudes(self, start: np.ndarray) -> np.ndarray:
        """Magnitude of each unknown; of one that is and was zero, what moves the outputs by their norm, or 1."""
        size, sensitivity = np.maximum(np.abs(self.theta), np.abs(start)), np.sqrt(np.diag(self.matrix))
        has_effect = np.isfinite(sensitivity) & (sensitivity > 1e-150)
        natural = np.where(has_effect, _signal_norm(self.problem) / np.where(has_effect, sensitivity, 1.0), 1.0)
        return np.where(size > 0, size, natural)


def _signal_norm(problem: Problem) -> float:
    """Norm of the weighted measured signals; 1 where they are all zero."""
    return problem.size * np.sqrt(problem.samples) or 1.0


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
    search = _Search(problem, start, *problem.normal(start, steps), steps, tolerance)
    history, status = [search.cost], "limit"
    try:
        status = search.run(history, iterations, progress)
        for share in DIFFERENCE_STEPS if coarse and steps is None and status == "stalled" else ():
            rough = attrs.evolve(search, steps=share * search.magnitudes(start), damping=FIRST_DAMPING)
            rough.cost, rough.gradient, rough.matrix = problem.normal(rough.theta, rough.steps)
            ended = rough.run(history, iterations, progress)
            if rough.cost >= search.cost * (1 - LEAST_GAIN):  # differences find no descent either
                break
            search, status = rough, ended
        if status == "stalled" and search.cost >= history[0] * (1 - LEAST_GAIN):  # it could not move at all
            search = attrs.evolve(search, careful=True, damping=FIRST_DAMPING)
            status = search.run(history, iterations, progress)
    except KeyboardInterrupt:
        status = "interrupted"
    evaluations = search.evaluations
    return OptimizerResult(
        search.theta, search.cost, status, len(history) - 1, evaluations, tuple(history), search.steps
    )
