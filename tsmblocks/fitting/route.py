"""The paper's own route: a genetic algorithm for a first guess, then Nelder-Mead, which needs no derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.genetic import evolve
from tsmblocks.fitting.merit import Constraints
from tsmblocks.fitting.multistart import Range
from tsmblocks.fitting.nelder_mead import polish
from tsmblocks.fitting.optimizer import MISSED, Found, Tell
from tsmblocks.fitting.residuals import Problem

END = 1e-3
"""Share of a range within which a search counts as leaning on its end."""


def genetic_route(
    problem: Problem,
    start: np.ndarray,
    ranges: Sequence[Range],
    *,
    seed: int,
    iterations: int | None = None,
    tell: Tell | None = None,
) -> Found:
    """Search the ranges, then go downhill from the best place found. Source: paper, section 4.

    A simplex cannot follow a constraint, nor leave the ranges: where it leans on one, Gauss-Newton goes on.

    ``iterations`` limits the generations, and the steps of the simplex after them; after Ctrl-C the best so
    far is returned. Raises RunError for equalities, which no random place meets.
    """
    if problem.limits.equal.any():
        name = np.array(problem.limits.names)[problem.limits.equal][0]
        raise RunError(
            f"method='ga' looks at random places, of which none meets the equality {name}. Write it as a "
            "tie, or take another method."
        )

    def told(stage: str) -> Callable[[int, float], None] | None:
        return None if tell is None else lambda count, cost: tell(stage, count, cost)

    missed = _missed(problem)
    evolved = evolve(
        problem.costs,
        ranges,
        seed=seed,
        generations=iterations,
        constraints=missed,
        start=start,
        progress=told("genetic"),
    )
    history = list(evolved.history)
    kept = Found(evolved.theta, evolved.cost, "interrupted", evolved.generations, evolved.evaluations, tuple(history))
    if evolved.interrupted:
        return kept
    try:
        found = polish(
            problem.costs,
            evolved.theta,
            ranges,
            iterations=iterations,
            constraints=missed,
            progress=told("nelder-mead"),
        )
    except KeyboardInterrupt:  # before the simplex stood
        return kept
    ended = Found(
        np.clip(found.theta, problem.unknowns.low, problem.unknowns.high),
        found.cost,
        found.status,
        evolved.generations + found.iterations,
        evolved.evaluations + found.evaluations,
        (*history, found.cost),
    )
    return ended if found.interrupted else _finished(problem, ended, ranges, tell)


def _finished(problem: Problem, ended: Found, ranges: Sequence[Range], tell: Tell | None) -> Found:
    """Go on by Gauss-Newton where a simplex cannot: along a constraint, and past a range that is no bound."""
    low, high = problem.unknowns.low, problem.unknowns.high
    walls = np.array(
        [
            (low[k] < r.low and theta - r.low <= END * (r.high - r.low))
            or (r.high < high[k] and r.high - theta <= END * (r.high - r.low))
            for k, (r, theta) in enumerate(zip(ranges, ended.theta, strict=True))
        ]
    )
    values, slopes = problem.limits.values(ended.theta), problem.limits.slopes(ended.theta)
    leaning = values <= END * np.abs(slopes * ended.theta).max(axis=1, initial=1e-12)
    if not (walls.any() or leaning.any()):
        return ended
    found = gauss_newton(problem, ended.theta, tell=tell)
    if not found.cost < ended.cost or problem.violation(found.theta) > MISSED:
        return ended
    return attrs.evolve(
        found,
        iterations=ended.iterations + found.iterations,
        evaluations=ended.evaluations + found.evaluations,
        history=(*ended.history, *found.history),
    )


def _missed(problem: Problem) -> Constraints | None:
    """By how much each set misses each constraint; None where there is none."""
    if not problem.limits.names:
        return None

    def missed(thetas: np.ndarray) -> np.ndarray:
        values = np.array([problem.limits.values(theta) for theta in thetas])
        return -values

    return missed
