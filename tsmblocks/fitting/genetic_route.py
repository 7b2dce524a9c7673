"""The paper's route to a fit: a genetic algorithm over the whole search range, then Nelder-Mead.

Both are those of ``global_search``, on the problem of a fit; Gauss-Newton continues where a simplex cannot.
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.global_search import FIRST_EDGE, Progress, SearchResult, Violations, evolve, polish
from tsmblocks.fitting.multistart import Range
from tsmblocks.fitting.optimizer import CONSTRAINT_TOLERANCE, OptimizerResult, ProgressCallback, no_progress
from tsmblocks.fitting.residuals import Problem

FIRST_EDGE_IN_BASIN = 0.01
"""``FIRST_EDGE`` after a search without constraints, which ends in a basin. Chosen: a sixth fewer evaluations."""
AT_END = 1e-3
"""Distance from an end of a search range, relative to the range, within which a search ended there. Chosen."""


def genetic_route(
    problem: Problem,
    start: np.ndarray,
    ranges: Sequence[Range],
    *,
    seed: int,
    iterations: int | None = None,
    progress: ProgressCallback = no_progress,
) -> OptimizerResult:
    """Search the ranges, then downhill from the best set. Source: paper, section 4.

    A simplex cannot follow a constraint, nor leave the ranges: where it ends on one, Gauss-Newton continues.

    ``iterations`` limits the generations, and the iterations of the simplex after them; after Ctrl-C the best so
    far is returned. Raises RunError for equalities, which no random set meets.
    """
    if problem.constraints.equal.any():
        name = np.array(problem.constraints.names)[problem.constraints.equal][0]
        raise RunError(
            f"method='ga' samples random parameter sets, none of which meets the equality {name}. Write it as a tie, "
            "or use another method."
        )
    constraints = _violations(problem) if problem.constraints.names else None
    evolved = evolve(
        problem.costs,
        ranges,
        seed=seed,
        generations=iterations,
        constraints=constraints,
        start=start,
        progress=_progress(progress, "genetic"),
    )
    first = _found(problem, evolved)
    if evolved.status == "interrupted":
        return first
    try:
        polished = polish(
            lambda thetas: np.array([problem.cost(theta) for theta in thetas]),  # one alone is quicker than in lanes
            evolved.theta,
            ranges,
            iterations=iterations,
            constraints=constraints,
            size=FIRST_EDGE_IN_BASIN if constraints is None else FIRST_EDGE,
            progress=_progress(progress, "nelder-mead"),
        )
    except KeyboardInterrupt:  # at its first evaluation
        return attrs.evolve(first, status="interrupted")
    ended = _after(first, _found(problem, polished))
    return ended if ended.status == "interrupted" else _continued(problem, ended, ranges, progress)


def _progress(progress: ProgressCallback, stage: str) -> Progress:
    return lambda count, cost: progress(stage, count, cost)


def _violations(problem: Problem) -> Violations:
    """By how much each set violates each constraint."""
    return lambda thetas: -np.array([problem.constraints.values(theta) for theta in thetas])


def _found(problem: Problem, ended: SearchResult) -> OptimizerResult:
    """The result in the terms of the other methods."""
    theta = np.clip(ended.theta, problem.unknowns.low, problem.unknowns.high)
    return OptimizerResult(theta, ended.cost, ended.status, ended.iterations, ended.evaluations, tuple(ended.history))


def _after(before: OptimizerResult, then: OptimizerResult) -> OptimizerResult:
    """The second of two searches, with the work of both."""
    return attrs.evolve(
        then,
        iterations=before.iterations + then.iterations,
        evaluations=before.evaluations + then.evaluations,
        history=(*before.history, *then.history),
    )


def _continued(
    problem: Problem, ended: OptimizerResult, ranges: Sequence[Range], progress: ProgressCallback
) -> OptimizerResult:
    """Continue by Gauss-Newton where a simplex cannot: along a constraint, and past a range that is no bound."""
    unknowns, theta = problem.unknowns, ended.theta
    low, high = np.array([r.low for r in ranges]), np.array([r.high for r in ranges])
    margin = AT_END * (high - low)
    at_end = ((unknowns.low < low) & (theta - low <= margin)) | ((high < unknowns.high) & (high - theta <= margin))
    values, slopes = problem.constraints.values(theta), problem.constraints.jacobian(theta)
    on_constraint = values <= AT_END * np.abs(slopes * theta).max(axis=1, initial=1e-12)
    if not (at_end.any() or on_constraint.any()):
        return ended
    try:
        found = gauss_newton(problem, theta, progress=progress)
    except KeyboardInterrupt:  # at its first evaluation
        return attrs.evolve(ended, status="interrupted")
    if not found.cost < ended.cost or problem.violation(found.theta) > CONSTRAINT_TOLERANCE:
        return ended
    return _after(ended, found)
