"""Shared by all methods of optimisation: their result, and a feasible starting point."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError
from tsmblocks.fitting.quadratic_program import Infeasible, quadratic_step
from tsmblocks.fitting.residuals import Problem

ProgressCallback = Callable[[str, int, float], None]
"""Called during a search with its stage, the number of evaluations, and the lowest cost."""

CONSTRAINT_TOLERANCE = 1e-9
"""Sum of constraint violations that counts as none. Chosen."""
SAME_OPTIMUM = 1.0
"""Costs that differ by less than this many variances of a sample belong to one optimum. Chosen."""


def no_progress(stage: str, evaluations: int, cost: float) -> None:
    """The callback of a search that is not watched."""


@attrs.frozen(eq=False)
class OptimizerResult:
    """The result of an optimisation.

    ``status`` is ``converged``, ``limit`` (of iterations), ``stalled`` (no descent, though the gradient is not zero: a
    kink, or rounding) or ``interrupted`` (by Ctrl-C). ``history`` holds the cost after each iteration, ``evaluations``
    the number of simulations of all experiments. ``difference_steps`` (unknowns,) are those of finite differences,
    where the outputs are nonsmooth and exact derivatives led to no descent; ``plateau`` (unknowns,) is how far each
    unknown may go to either side without a change of the outputs.
    """

    theta: np.ndarray
    cost: float
    status: str
    iterations: int
    evaluations: int
    history: tuple[float, ...] = attrs.field(default=(), repr=False)
    difference_steps: np.ndarray | None = attrs.field(default=None, repr=False)
    plateau: np.ndarray | None = attrs.field(default=None, repr=False)


def is_same_optimum(problem: Problem, best: OptimizerResult, other: OptimizerResult) -> bool:
    """Whether the result of another search belongs to the optimum of the best one."""
    variance = max(2 * best.cost / max(problem.samples, 1), problem.rounding)
    return abs(other.cost - best.cost) <= SAME_OPTIMUM * variance


def linearised_constraints(problem: Problem, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds and linearised constraints on a step d from ``theta``: rows (m, n) with rows d >= b, equal (m,)."""
    low, high, eye = problem.unknowns.low - theta, problem.unknowns.high - theta, np.eye(len(theta))
    below, above, constraints = np.isfinite(low), np.isfinite(high), problem.constraints
    rows = np.concatenate([eye[below], -eye[above], constraints.jacobian(theta)])
    bounds = np.concatenate([low[below], -high[above], -constraints.values(theta)])
    equal = np.zeros(len(bounds), dtype=bool)
    equal[len(bounds) - len(constraints.equal) :] = constraints.equal
    return rows, bounds, equal


def within_bounds(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """``theta`` put back inside its bounds, which rounding may leave."""
    return np.clip(theta, problem.unknowns.low, problem.unknowns.high)


def feasible_start(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """The nearest point found that meets bounds and constraints.

    Raises ParameterError, naming the constraints, when there seems to be none.
    """
    if problem.violation(theta) <= CONSTRAINT_TOLERANCE:
        return theta
    made = projected(problem, theta)
    if made is None:
        missed = zip(problem.constraints.names, problem.constraints.violations(theta), strict=True)
        said = "; ".join(
            f"{name} is {f'missed by {v:.3g}' if np.isfinite(v) else 'no number'}"
            for name, v in missed
            if not v <= CONSTRAINT_TOLERANCE
        )
        raise ParameterError(
            "no values of the free parameters within their bounds meet all constraints. At the starting point, "
            f"{said}. Relax a constraint or a bound, or free more "
            "parameters."
        )
    return made


def projected(problem: Problem, start: np.ndarray) -> np.ndarray | None:
    """Step by step to the nearest point, constraints linearised at each; None when that leads nowhere."""
    size = np.maximum(np.abs(start), 1e-2)
    theta, weight = start, np.diag(1 / size**2)
    for _ in range(60):
        rows, bounds, equal = linearised_constraints(problem, theta)
        if not (np.isfinite(rows).all() and np.isfinite(bounds).all()):
            return None
        try:
            step, _ = quadratic_step(weight, weight @ (theta - start), rows, bounds, equal)
        except Infeasible:
            return None
        share = 1.0
        while share > 1e-4 and problem.violation(within_bounds(problem, theta + share * step)) > (
            1 - 0.1 * share
        ) * max(problem.violation(theta), CONSTRAINT_TOLERANCE):
            share /= 2
        theta = within_bounds(problem, theta + share * step)
        if problem.violation(theta) <= CONSTRAINT_TOLERANCE:
            return theta
    return None
