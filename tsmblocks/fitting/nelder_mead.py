"""Nelder and Mead's simplex search, with the places an iteration may need priced in one call.

The second half of the paper's route to a fit. A batch of four runs costs about as much as one, so
reflection, expansion and both contractions are priced together; the result is that of the sequential
algorithm. The shrunk simplex has a call of its own: next to no iteration of a fit needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError, in_words
from tsmblocks.fitting.merit import COST, MISSED, Constraints, Costs, Judge, ordered
from tsmblocks.fitting.multistart import Box, Range

FLAT = 1e-7
"""Least to greatest extent of a simplex below which it cannot move in every direction any more."""
TINY = 1e-3
"""Share of ``xtol`` below which a search ends though costs differ: it lies at the edge of what can be simulated."""
NOTHING = 1e-14
"""Share of the costs of the first simplex that is lost in rounding, so that a least cost of 0 can be met."""


@attrs.frozen(eq=False)
class Polished:
    """Where a simplex search ended.

    ``theta`` (unknowns,) is the best place, ``cost`` its cost and ``missed`` the sum by which it misses the
    constraints (0: it meets them). ``path`` (iterations + 1, unknowns) has the best place after each iteration,
    ``calls`` how often the cost was called for ``evaluations`` places in all. ``status`` is ``converged``,
    ``limit`` (of iterations) or ``interrupted`` (by Ctrl-C).
    """

    theta: np.ndarray
    cost: float
    missed: float
    iterations: int
    evaluations: int
    calls: int
    restarts: int
    path: np.ndarray = attrs.field(repr=False)
    status: str = "limit"

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended it."""
        return self.status == "interrupted"


@attrs.frozen
class Factors:
    """How far each place tried lies from the centre, in steps from the worst place to the centre.

    ``expand`` beyond the reflection at 1, ``contract`` to either side, ``shrink`` what is left of the simplex.
    """

    expand: float = 2.0
    contract: float = 0.5
    shrink: float = 0.5


def factors(unknowns: int) -> Factors:
    """Those of Nelder and Mead up to four unknowns, above them those that adapt to their number.

    Source: Gao and Han, Comput. Optim. Appl. 51 (2012) 259.
    """
    if unknowns <= 4:
        return Factors()
    return Factors(1 + 2 / unknowns, 0.75 - 1 / (2 * unknowns), 1 - 1 / unknowns)


@attrs.define(eq=False)
class _Simplex:
    """Corners from best to worst, as shares of the ranges, with their merits."""

    corners: np.ndarray
    merits: np.ndarray

    @property
    def extent(self) -> float:
        """Farthest corner from the best, along any range."""
        return float(np.abs(self.corners[1:] - self.corners[0]).max())

    @property
    def flat(self) -> bool:
        """Whether the corners lie next to a plane."""
        s = np.linalg.svd(self.corners[1:] - self.corners[0], compute_uv=False)
        return bool(s[-1] <= FLAT * s[0])


def polish(
    cost: Costs,
    start: Any,
    ranges: Sequence[Range],
    *,
    constraints: Constraints | None = None,
    size: float | np.ndarray = 0.05,
    xtol: float = 1e-4,
    ftol: float = 1e-7,
    iterations: int | None = None,
    restarts: int = 5,
    progress: Callable[[int, float], None] | None = None,
) -> Polished:
    """Go downhill from ``start`` to the least cost nearby, within the ranges.

    ``cost``, ``constraints`` and ``progress`` are as for ``evolve``; places outside the ranges are moved onto
    their ends. ``size``, one for all or one for each unknown, is the edge of the first simplex as a share of
    the ranges. The search ends when the simplex is smaller than the share ``xtol`` of each range and its costs
    differ by less than the share ``ftol``, or after ``iterations`` (300 for each unknown). A simplex gone flat is
    built anew, smaller, around its best corner, at most ``restarts`` times and no longer than that helps.
    Ctrl-C keeps the best so far.

    Source: Nelder and Mead, Computer Journal 7 (1965) 308. Raises ParameterError for a start outside the
    ranges, RunError for one without a finite cost.
    """
    box = Box(tuple(ranges))
    judge, best = Judge(box, cost, constraints), box.shares(box.inside(start, "the start"))[0]
    rule, most = factors(len(best)), iterations if iterations is not None else 300 * len(best)
    edges, status, again = _edges(size, best), "limit", 0
    now, path, before = None, [best], None
    try:
        now = _around(judge, best, edges)
        path, floor = [now.corners[0]], NOTHING * _height(now, judge)
        while len(path) <= most:
            if again < restarts and now.flat and (before is None or tuple(now.merits[0]) < before):
                edges, again, before = edges / 4, again + 1, tuple(now.merits[0])
                now = _around(judge, now.corners[0], edges)
            elif now.extent <= (xtol if _level(now, ftol, floor) else TINY * xtol):
                status = "converged"
                break
            now = _step(judge, now, rule)
            path.append(now.corners[0])
            if progress is not None:
                progress(judge.evaluations, float(now.merits[0, COST]))
    except KeyboardInterrupt:
        if now is None:
            raise
        status = "interrupted"
    theta = box.thetas(now.corners[0])
    return Polished(
        theta,
        float(now.merits[0, COST]),
        float(now.merits[0, MISSED]),
        len(path) - 1,
        judge.evaluations,
        judge.calls,
        again,
        box.thetas(np.array(path)),
        status,
    )


def _edges(size: float | np.ndarray, best: np.ndarray) -> np.ndarray:
    made = np.asarray(size, dtype=float)
    if made.shape not in ((), best.shape) or not ((made > 0) & (made <= 0.5)).all():
        raise ParameterError(
            "the size of the first simplex must be a share of the ranges, above 0 and up to 0.5, one "
            f"for all or one for each of the {len(best)} unknowns, got {in_words(size)}."
        )
    return np.broadcast_to(made, best.shape)


def _around(judge: Judge, best: np.ndarray, edges: np.ndarray) -> _Simplex:
    """A simplex with edges along the ranges, each towards the side that has room."""
    inward = np.where(best + edges <= 1.0, edges, -edges)
    corners = np.clip(np.concatenate([best[None], best + np.diag(inward)]), 0.0, 1.0)
    return _sorted(corners, judge.merits(corners))


def _sorted(corners: np.ndarray, merits: np.ndarray) -> _Simplex:
    order = ordered(merits)
    return _Simplex(corners[order], merits[order])


def _step(judge: Judge, now: _Simplex, rule: Factors) -> _Simplex:
    """One iteration: the worst corner replaced, or all but the best drawn towards it."""
    corners, n = now.corners, len(now.corners) - 1
    centre, reach = corners[:-1].mean(axis=0), np.array([1.0, rule.expand, rule.contract, -rule.contract])[:, None]
    tried = np.clip((1 + reach) * centre - reach * corners[-1], 0.0, 1.0)
    merits = judge.merits(tried)
    taken = _choice([tuple(m) for m in merits], [tuple(m) for m in now.merits[[0, n - 1, n]]])
    if taken is None:
        drawn = corners[0] + rule.shrink * (corners[1:] - corners[0])
        return _sorted(np.concatenate([corners[:1], drawn]), np.concatenate([now.merits[:1], judge.merits(drawn)]))
    return _sorted(np.concatenate([corners[:-1], tried[[taken]]]), np.concatenate([now.merits[:-1], merits[[taken]]]))


def _choice(tried: list[tuple[float, ...]], known: list[tuple[float, ...]]) -> int | None:
    """Which place replaces the worst corner, or None to shrink.

    ``tried`` has the merits of reflection, expansion, contraction outside and inside; ``known`` those of the best,
    the last but one and the worst corner.
    """
    reflected, expanded, outside, inside = tried
    best, last, worst = known
    if reflected < best:
        return 1 if expanded < reflected else 0
    if reflected < last:
        return 0
    if reflected < worst:
        return 2 if outside <= reflected else None
    return 3 if inside < worst else None


def _level(now: _Simplex, ftol: float, floor: float) -> bool:
    """Whether all corners have next to the same merit."""
    costs = now.merits[:, COST]
    if np.isinf(costs[-1]) or now.merits[-1, MISSED] > now.merits[0, MISSED]:
        return False
    return bool(costs[-1] - costs[0] <= ftol * abs(costs[0]) + floor)


def _height(now: _Simplex, judge: Judge) -> float:
    """From the least to the greatest cost that is finite. Raises RunError when none is."""
    costs = now.merits[:, COST]
    if np.isinf(costs).all():
        raise RunError(
            f"none of the {judge.evaluations} places around the start has a finite cost. Begin where the "
            "simulation is stable."
        )
    return float(np.ptp(costs[np.isfinite(costs)]))
