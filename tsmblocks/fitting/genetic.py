"""A real-coded genetic algorithm that prices a whole generation in one call.

The first half of the paper's route to a fit; ``nelder_mead`` is the second.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.fitting.merit import COST, MISSED, Constraints, Costs, Judge, ordered
from tsmblocks.fitting.multistart import Box, Range, hypercube

LANES = 32
"""Sets side by side in one run of the engine, so populations are multiples of it."""
CROSSING = 10.0
"""Distribution index of the crossover: the larger, the nearer children stay to their parents."""
CHANGING = 20.0
"""Distribution index of the mutation."""
CROWD = 4
"""Places tried at first, in generations. Fewer, and a wide basin without the optimum may win before it is seen."""
NARROW = 1e-6
"""Width of a population, as a share of each range, below which there is nothing left to search."""


@attrs.frozen(eq=False)
class Evolved:
    """Where a genetic search ended.

    ``theta`` (unknowns,) is the best place, ``cost`` its cost and ``missed`` the sum by which it misses the
    constraints (0: it meets them). ``history`` has the best cost after each generation, the first included,
    infinite until a place meets the constraints. ``population`` (sets, unknowns) is the last
    generation from best to worst, with ``costs`` (sets,), not finite ones as infinity. ``status`` is
    ``converged`` (the generation shrank to a point), ``stalled`` (the best stayed as it was), ``limit``
    (of generations or evaluations) or ``interrupted`` (by Ctrl-C).
    """

    theta: np.ndarray
    cost: float
    missed: float
    generations: int
    evaluations: int
    history: np.ndarray = attrs.field(repr=False)
    population: np.ndarray = attrs.field(repr=False)
    costs: np.ndarray = attrs.field(repr=False)
    status: str = "limit"

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended it."""
        return self.status == "interrupted"


@attrs.define(eq=False)
class _Generation:
    """Places from best to worst, as shares of the ranges, with their merits."""

    shares: np.ndarray
    merits: np.ndarray


def evolve(
    cost: Costs,
    ranges: Sequence[Range],
    *,
    seed: int | np.random.Generator,
    population: int | None = None,
    generations: int | None = None,
    constraints: Constraints | None = None,
    start: Any = None,
    progress: Callable[[int, float], None] | None = None,
    budget: int | None = None,
    patience: int = 15,
    tolerance: float = 1e-3,
) -> Evolved:
    """Search the ranges for the place of least cost.

    ``cost`` takes places (sets, unknowns) and gives costs (sets,); one that is not finite counts as worst.
    ``constraints`` gives by how much each is missed (sets, constraints), met at 0 or less. ``start`` holds
    places to include, one or several (the ``population`` of an earlier search). ``population`` is a multiple
    of 32, by default the nearest to 12 for each unknown and at least 64; the first generation is the best of
    four times as many places spread evenly. The search ends after ``generations`` (20, and 8 more for each
    unknown), before more than ``budget`` evaluations (but not before a first generation), or when the best cost
    fell by less than the share ``tolerance`` within ``patience`` generations. ``progress`` is told evaluations
    and best cost. Same seed, same result; Ctrl-C keeps the best so far.

    Tournaments of two, simulated binary crossover (Deb and Agrawal, Complex Systems 9 (1995) 115), polynomial
    mutation (Deb and Goyal, Comput. Sci. Inform. 26 (1996) 30); parents and children compete for places.
    Raises ParameterError for a population that is no multiple of 32 or a start outside the ranges, RunError
    when no place has a finite cost.
    """
    box, rng = Box(tuple(ranges)), np.random.default_rng(seed)
    size, most = _sizes(len(box.ranges), population, generations)
    judge, given = Judge(box, cost, constraints), None if start is None else box.shares(box.inside(start, "the start"))
    history: list[float] = []
    now, status = None, "limit"
    try:
        now = _first(judge, rng, size, given, budget)
        _keep(history, judge, now, progress)
        while len(history) <= most and (budget is None or judge.evaluations + size <= budget):
            now = _next(judge, rng, now)
            _keep(history, judge, now, progress)
            if np.ptp(now.shares, axis=0).max() <= NARROW:
                status = "converged"
                break
            if _stalled(history, patience, tolerance):
                status = "stalled"
                break
    except KeyboardInterrupt:
        if now is None:
            raise
        status = "interrupted"
    return _outcome(judge, now, history, status)


def _sizes(unknowns: int, population: int | None, generations: int | None) -> tuple[int, int]:
    """Places in a generation, and generations after the first."""
    size = LANES * max(2, round(12 * unknowns / LANES)) if population is None else population
    if size < LANES or size % LANES:
        raise ParameterError(
            f"the population must be a multiple of {LANES}, the sets that run side by side, got {size}."
        )
    return size, 20 + 8 * unknowns if generations is None else generations


def _outcome(judge: Judge, now: _Generation, history: list[float], status: str) -> Evolved:
    if np.isinf(now.merits[0, COST]):
        raise RunError(
            f"none of {judge.evaluations} places tried has a finite cost. Narrow the search ranges, or "
            "start where the simulation is stable."
        )
    thetas = judge.box.thetas(now.shares)
    return Evolved(
        thetas[0],
        float(now.merits[0, COST]),
        float(now.merits[0, MISSED]),
        max(len(history) - 1, 0),
        judge.evaluations,
        np.array(history),
        thetas,
        now.merits[:, COST].copy(),
        status,
    )


def _first(
    judge: Judge, rng: np.random.Generator, size: int, given: np.ndarray | None, budget: int | None
) -> _Generation:
    """The best of places spread evenly over the ranges, more of them than a generation holds."""
    count = min(CROWD * size, max(size, budget or CROWD * size))
    shares = hypercube(rng, count, len(judge.box.ranges))
    if given is not None:
        shares = np.concatenate([given, shares])[: max(count, len(given))]
    return _best(shares, judge.merits(shares), size)


def _next(judge: Judge, rng: np.random.Generator, now: _Generation) -> _Generation:
    """The better half of parents and children."""
    size = len(now.shares)
    children = _children(rng, now.shares)
    shares = np.concatenate([now.shares, children])
    merits = np.concatenate([now.merits, judge.merits(children)])
    return _best(shares, merits, size)


def _best(shares: np.ndarray, merits: np.ndarray, size: int) -> _Generation:
    order = ordered(merits)[:size]
    return _Generation(shares[order], merits[order])


def _children(rng: np.random.Generator, shares: np.ndarray) -> np.ndarray:
    """As many children as parents; the parents stand from best to worst."""
    size = len(shares)
    # Each parent is in two tournaments, so the best wins two places among those who cross and the worst none.
    rivals = np.concatenate([rng.permuted(np.arange(size)).reshape(-1, 2) for _ in range(2)])
    winners = shares[rivals.min(axis=1)]
    return _changed(rng, _crossed(rng, winners[: size // 2], winners[size // 2 :]))


def _crossed(rng: np.random.Generator, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Simulated binary crossover, cut off at the ends of the ranges. Shapes (pairs, unknowns); twice the rows out."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    gap = np.maximum(high - low, 1e-300)
    u = rng.random(a.shape)
    below = 0.5 * (low + high - _factor(u, 1 + 2 * low / gap) * gap)
    above = 0.5 * (low + high + _factor(u, 1 + 2 * (1 - high) / gap) * gap)
    swap = rng.random(a.shape) < 0.5
    first, second = np.where(swap, below, above), np.where(swap, above, below)
    # One number at least crosses over, otherwise the children are their parents and a run is wasted.
    cross = rng.random(a.shape) < 0.5
    cross[np.arange(len(a)), rng.integers(a.shape[1], size=len(a))] = True
    return np.clip(np.concatenate([np.where(cross, first, a), np.where(cross, second, b)]), 0.0, 1.0)


def _factor(u: np.ndarray, room: np.ndarray) -> np.ndarray:
    """How far apart children lie, in gaps of their parents, when there is ``room`` for at most so many gaps."""
    whole = 2.0 - room ** -(CROSSING + 1)
    near = (u * whole) ** (1 / (CROSSING + 1))
    far = (1 / np.maximum(2.0 - u * whole, 1e-300)) ** (1 / (CROSSING + 1))
    return np.where(u * whole <= 1.0, near, far)


def _changed(rng: np.random.Generator, shares: np.ndarray) -> np.ndarray:
    """Polynomial mutation of one number in each child on average, cut off at the ends of the ranges."""
    u, power = rng.random(shares.shape), 1 / (CHANGING + 1)
    down = (2 * u + (1 - 2 * u) * (1 - shares) ** (CHANGING + 1)) ** power - 1
    up = 1 - (2 * (1 - u) + (2 * u - 1) * shares ** (CHANGING + 1)) ** power
    change = rng.random(shares.shape) < 1 / shares.shape[1]
    return np.clip(np.where(change, shares + np.where(u < 0.5, down, up), shares), 0.0, 1.0)


def _keep(history: list[float], judge: Judge, now: _Generation, progress: Callable[[int, float], None] | None) -> None:
    """Note the best cost, infinite while constraints are missed; ``progress`` hears of it."""
    history.append(float(now.merits[0, COST]) if now.merits[0, MISSED] == 0 else np.inf)
    if progress is not None:
        progress(judge.evaluations, history[-1])


def _stalled(history: list[float], patience: int, tolerance: float) -> bool:
    """Whether the best cost fell by less than a share lately; while none meets the constraints it is no stall."""
    if len(history) <= patience or np.isinf(history[-1]):
        return False
    return history[-1 - patience] - history[-1] <= tolerance * abs(history[-1])
