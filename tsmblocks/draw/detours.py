"""Which wires of a drawing in rows keep to its left margin, instead of running to the right end of a row and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import attrs

from tsmblocks.draw.picture import Box, Extent, Point, Wire

CLEAR = 12
"""Room on both sides of a vertical wire that is led out of a row below it [pixels]."""


@attrs.frozen(eq=False)
class Level:
    """A horizontal wire that crosses cuts, from ``left`` to ``right`` in the wide drawing.

    ``plain`` where its signal has no corner, tap or end between the two ends; ``rises`` where every part of the signal
    that continues at the left end goes up.
    """

    y: float
    left: float
    right: float
    plain: bool
    rises: bool


@attrs.frozen(eq=False)
class Detours:
    """Heights of wires in the wide drawing that keep to the left margin.

    ``passing`` has for each row those that pass beside it, and ``dropped`` for each gap below a row those that leave
    the row downwards, where they would turn to the right.
    """

    passing: tuple[frozenset[float], ...]
    dropped: tuple[frozenset[float], ...]

    @classmethod
    def of(
        cls, boxes: Iterable[Box], wires: Sequence[Wire], starts: Sequence[float], crossed: Sequence[list[float]]
    ) -> Detours:
        """The detours that cross no wire which was not crossed before; ``crossed`` has the heights of wires at cuts."""
        taken = [box.extent for box in boxes] + [label.extent for box in boxes for label in box.labels]
        taken += [label.extent for wire in wires for label in wire.labels]
        pieces = (piece for wire in wires for line in wire.lines for piece in pairwise(line))
        taken += [(min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1])) for a, b in pieces]
        levels = [level for wire in wires for level in _levels(wire, starts)]
        inner = (
            _passing(levels, starts[row : row + 2], crossed[row - 1], crossed[row]) for row in range(1, len(crossed))
        )
        passing = (frozenset[float](), *inner, frozenset[float]())
        dropped = []
        for row, heights in enumerate(crossed):
            across = {level.y: level for level in levels if level.left < starts[row + 1] < level.right}
            own = [y for y in heights if y not in passing[row]]
            dropped.append(_dropped(taken, across, starts[row], own, passing[row]))
        return cls(passing, tuple(dropped))


def _levels(wire: Wire, starts: Sequence[float]) -> Iterator[Level]:
    """The horizontal parts of a wire that lead from one row to another."""
    corners = [*wire.dots, *wire.taps, *(point for line in wire.lines for point in line)]
    for line in wire.lines:
        for a, b in pairwise(line):
            (left, y), (right, _) = sorted((a, b))
            if a[1] != b[1] or not any(left < start < right for start in starts):
                continue
            plain = not any(left < x < right and at == y for x, at in corners)
            ends = [_beyond(one, left, y) for one in wire.lines]
            yield Level(y, left, right, plain, all(up for end in ends for up in end) and any(ends))


def _beyond(line: Sequence[Point], x: float, y: float) -> list[bool]:
    """For each part of a line that leaves a point to the left, up or down: whether it goes up."""
    ways = [(a, b) for a, b in (*pairwise(line), *pairwise(line[::-1])) if a == (x, y)]
    return [b[0] == x and b[1] < y for _, b in ways if b[0] <= x]


def _passing(
    levels: Sequence[Level], ends: Sequence[float], above: Sequence[float], below: Sequence[float]
) -> frozenset[float]:
    """Of the lowest wires at both ends of a row those that only pass it; several only where they move outwards."""
    found: list[float] = []
    whole = {level.y for level in levels if level.plain and level.left < ends[0] and ends[1] < level.right}
    for one, other in zip(above[::-1], below[::-1], strict=False):
        if one != other or one not in whole or (found and len(below) < len(above)):
            break
        found.append(one)
    return frozenset(found)


def _dropped(
    taken: Sequence[Extent],
    across: dict[float, Level],
    start: float,
    heights: Sequence[float],
    passing: Iterable[float],
) -> frozenset[float]:
    """Of the lowest wires that leave a row those that can turn down at their left end, with nothing below it."""
    found, gone = list[float](), set(passing)
    for y in heights[::-1]:
        level = across.get(y)
        if level is None or not (level.plain and level.rises and level.left >= start):
            break
        below = (one for one in taken if one[3] > y and not (one[1] == one[3] and one[1] in gone))
        if any(one[0] - CLEAR < level.left < one[2] + CLEAR for one in below):
            break
        if any(across[other].left >= level.left for other in found):
            break  # it would cross one that was led out
        found.append(y)
        gone.add(y)
    return frozenset(found)
