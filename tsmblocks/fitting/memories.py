"""Initial values of memories: for a play started outside its slack the derivatives are zero.

After one step the memory of a play does not depend on how far outside its slack it began. So one step from far below
and from far above gives the edges between which its initial value matters.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsmblocks.engine.kernel import Steps
from tsmblocks.engine.session import start_memory
from tsmblocks.fitting.optimizer import OptimizerResult
from tsmblocks.fitting.residuals import Problem

FAR = 1e9
"""Initial value that is outside any slack, in multiples of what the memory and the parameters are. Chosen."""
FORGOTTEN = 1e-6
"""Share of that below which a value has been forgotten after one step. Chosen: between rounding and one."""
LOWER = 1e-9
"""Relative fall of the cost that counts as one. Chosen: above rounding."""
PLACES = 9
"""Places that are tried from edge to edge. Chosen: out of the slack there is no derivative that leads back inside."""
ZOOMS = 4
"""Halvings of the distance between places around the best one. Chosen: a memory may begin close to an edge."""
MOST_ROUNDS = 3
"""Searches after memories were moved, at most. Chosen: for the run time."""


def placed(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """The unknowns with each such memory where its experiment is simulated best: as it is, at an edge, or between them.

    Other unknowns stay as they are, and so does everything where no memory's initial value is unknown.
    """
    theta = theta.copy()
    for e in range(len(problem.experiments)):
        theta = _placed_in(problem, theta, e)
    return theta


def refined(problem: Problem, end: OptimizerResult, search: Callable[[np.ndarray], OptimizerResult]) -> OptimizerResult:
    """The end of a search, continued as long as other places of the memories lower its cost.

    The other parameters have moved since the memories were placed, and with them the edges.
    """
    for _ in range(MOST_ROUNDS):
        if end.status == "interrupted":
            break
        start = placed(problem, end.theta)
        if not problem.cost(start) < (1 - LOWER) * end.cost:
            break
        again = search(start)
        if not again.cost < (1 - LOWER) * end.cost:
            break
        end = again
    return end


def _placed_in(problem: Problem, theta: np.ndarray, e: int) -> np.ndarray:
    """The same for one experiment."""
    found = memory_edges(problem, theta, e)
    if not found:
        return theta
    low, high = np.array(list(found.values())).T
    best, cost = _searched(problem, e, theta, _cost(problem, theta, e), list(found), low, high)
    if len(found) > 1:  # together first, then one after the other
        for k, (one_low, one_high) in found.items():
            best, cost = _searched(problem, e, best, cost, [k], np.array([one_low]), np.array([one_high]))
    return best


def _searched(
    problem: Problem, e: int, best: np.ndarray, cost: float, which: list[int], low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """The best place found between the edges of ``which``, and its cost; as they are where nothing is better."""

    def tried(share: float) -> tuple[float, float, np.ndarray]:
        one = best.copy()
        one[which] = np.clip(low + share * (high - low), problem.unknowns.low[which], problem.unknowns.high[which])
        return _cost(problem, one, e), share, one

    found, width = min((tried(share) for share in np.linspace(0, 1, PLACES)), key=lambda one: one[0]), 1 / (PLACES - 1)
    for _ in range(ZOOMS):
        width /= 2
        nearby = [tried(share) for share in (found[1] - width, found[1] + width) if 0 <= share <= 1]
        found = min(found, *nearby, key=lambda one: one[0])
    return (found[2], found[0]) if found[0] < (1 - LOWER) * cost else (best, cost)


def _cost(problem: Problem, theta: np.ndarray, e: int) -> float:
    """Sum of the squared residuals of one experiment; infinite where they are not finite."""
    experiment = problem.experiments[e]
    with np.errstate(over="ignore", invalid="ignore"):
        outputs = experiment.outputs(problem.unknowns.parameters(theta, e))
        total = float(np.sum(problem.residuals_of(e, outputs[:, :, None]) ** 2))
    return total if np.isfinite(total) else np.inf


def memory_edges(problem: Problem, theta: np.ndarray, e: int) -> dict[int, tuple[float, float]]:
    """The edges of each memory of experiment ``e`` whose initial value is unknown in it, by index of the unknown.

    A memory may be driven by another, which is put in the middle of its own slack first.
    """
    unknowns, eq = problem.unknowns, problem.experiments[e].eq
    alone = len(problem.experiments) == 1
    own = {
        int(k): eq.d.index(unknowns.items[k].parameter)
        for k in unknowns.columns(e)
        if unknowns.items[k].parameter in eq.d and (alone or unknowns.items[k].experiment)
    }
    theta, edges = theta.copy(), dict[int, tuple[float, float]]()
    for _ in own:
        before = dict(edges)
        for k, place in own.items():
            low, high = (_after_a_step(problem, theta, e, k, place, side) for side in (-1, 1))
            if np.isfinite([low, high]).all() and low <= high:
                edges[k] = (low, high)
                theta[k] = (low + high) / 2
        if edges == before:
            break
    return edges


def _after_a_step(problem: Problem, theta: np.ndarray, e: int, k: int, place: int, side: int) -> float:
    """Memory number ``place`` one step after unknown ``k``, its initial value, was far off; NaN where it shows."""
    experiment, p = problem.experiments[e], problem.unknowns.parameters(theta, e)
    size = FAR * max(1.0, np.abs(experiment.rows[0]).max(initial=0.0), np.abs(p[np.isfinite(p)]).max(initial=0.0))
    start = theta.copy()
    start[k] = side * size
    kernel = experiment.kernel
    memory = start_memory(experiment.eq, kernel, problem.unknowns.parameters(start, e), experiment.times.h)
    steps = Steps(experiment.times.start, experiment.times.h, 0, 1, False, experiment.hits, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        kernel.advance(memory, experiment.rows[:2], np.empty((1, kernel.layout_y.size)), steps)
    value = float(memory.d[kernel.layout_d.offset[place]])
    return value if abs(value) < FORGOTTEN * size else np.nan
