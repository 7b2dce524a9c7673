"""Vertical wires between two columns: their order, so that no two share a line and few cross.

It works on the heights of pins only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import attrs

from tsmblocks.draw.picture import GRID


@attrs.define(eq=False)
class Trunk:
    """The vertical part of a signal in one gap, and the heights at which it goes on to the left and right."""

    owner: Any
    left: list[float]
    right: list[float]
    track: int = 0
    after: list[Trunk] = attrs.field(factory=list)

    @property
    def low(self) -> float:
        """Smallest height, the upper end: heights grow downwards."""
        return min(self.left + self.right)

    @property
    def high(self) -> float:
        """Largest height, the lower end."""
        return max(self.left + self.right)

    @property
    def straight(self) -> bool:
        """Whether the signal passes the gap without any vertical part."""
        return self.low == self.high


def arrange(trunks: list[Trunk], taken: Iterable[float] = ()) -> list[Trunk]:
    """The trunks with their tracks, counted from the left; some may have been split in two.

    Where one signal comes in from the left at the height at which another leaves to the right, the
    first must turn off before the other begins. If two signals demand that of each other, one of them is
    led over a free height in between, not one of those ``taken`` by wires that pass.
    """
    levels = {*taken, *(y for t in trunks for y in t.left + t.right)}
    trunks = _unlocked([t for t in trunks if not t.straight], levels)
    order = _sorted(trunks)
    for k, trunk in enumerate(order):
        trunk.track = max((o.track + 1 for o in order[:k] if _near(o, trunk) or _before(o, trunk)), default=0)
    return order


def _before(a: Trunk, b: Trunk) -> bool:
    """Whether ``a`` must stand left of ``b``."""
    return b in a.after or (a.owner is not b.owner and not set(a.left).isdisjoint(b.right))


def _near(a: Trunk, b: Trunk) -> bool:
    return a.low < b.high + GRID and b.low < a.high + GRID


def _crossed(a: Trunk, b: Trunk) -> int:
    """Crossings when ``a`` stands left of ``b``."""
    return sum(b.low < y < b.high for y in a.right) + sum(a.low < y < a.high for y in b.left)


def _unlocked(trunks: list[Trunk], levels: set[float]) -> list[Trunk]:
    """Split trunks until none has to stand both left and right of others."""
    while True:
        locked = _on_cycle(trunks)
        if locked is None:
            return trunks
        free = _free_height(locked, levels)
        levels.add(free)
        second = Trunk(locked.owner, [free], locked.right, after=locked.after)
        first = Trunk(locked.owner, locked.left, [free], after=[second])
        for other in trunks:
            if locked in other.after:
                other.after = [first if o is locked else o for o in other.after]
        trunks = [o for o in trunks if o is not locked] + [first, second]


def _on_cycle(trunks: list[Trunk]) -> Trunk | None:
    """A trunk on a cycle of ``_before``, with wires on both sides; None where there is no cycle."""
    left = list(trunks)
    while left:
        loose = list(_loose(left))
        if not loose:
            both = (t for t in left if t.left and t.right)
            return next(t for t in both if any(_before(t, o) for o in left if o is not t))
        left = [t for t in left if t not in loose]
    return None


def _loose(trunks: list[Trunk]) -> Iterator[Trunk]:
    """Trunks that need not stand right of another."""
    return (t for t in trunks if not any(_before(o, t) for o in trunks if o is not t))


def _free_height(trunk: Trunk, levels: set[float]) -> float:
    """A height between two pins of the trunk, as far from all other wires as there is room."""
    low, high = int(trunk.low), int(trunk.high)
    choices = range(low + GRID // 2, high, GRID)
    return max(choices, key=lambda y: (min(abs(y - other) for other in levels), -abs(2 * y - low - high)))


def _sorted(trunks: list[Trunk]) -> list[Trunk]:
    """A topological order by ``_before``, improved by moving one trunk at a time while that saves crossings."""
    order: list[Trunk] = []
    left = sorted(trunks, key=lambda t: (t.low, t.high))
    while left:
        order.append(next(_loose(left)))
        left.remove(order[-1])
    changed = True
    while changed:
        changed = False
        for trunk in list(order):
            k = order.index(trunk)
            best = min(_moves(order, k, -1), _moves(order, k, 1))
            if best[0] < 0:
                order.insert(best[1], order.pop(k))
                changed = True
    return order


def _moves(order: list[Trunk], k: int, way: int) -> tuple[int, int]:
    """Crossings saved (below zero) by moving trunk ``k`` to the left (-1) or right (1), and the place best for it."""
    best, more, at = (0, k), 0, k + way
    while 0 <= at < len(order):
        left, right = (order[at], order[k]) if way < 0 else (order[k], order[at])
        if _before(left, right):
            break
        more += _crossed(right, left) - _crossed(left, right)
        best, at = min(best, (more, at)), at + way
    return best
