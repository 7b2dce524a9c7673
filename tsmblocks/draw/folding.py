"""A drawing that is too wide goes on in rows, one below the other. It knows boxes and lines, and where to cut."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterable, Sequence
from itertools import pairwise

import attrs

from tsmblocks.draw.detours import Detours
from tsmblocks.draw.picture import Box, Extent, Point, Wire

TRACK = 12
"""Distance of wires that lead from one row to the next [pixels]."""
EDGE = 16
"""Room between a row and the wires beside or below it [pixels]."""
CROSSING, ROW = 0.1, 4.0
"""Cost of a wire that is cut, and of a row, beside the squared share of the width that a row takes. Chosen: as few
rows as can be, and cuts through few wires rather than rows of one width."""
EMPTY = 40
"""Height of a band without anything but vertical wires, beyond which a row is compressed [pixels]."""


def extents(boxes: Iterable[Box], wires: Iterable[Wire]) -> list[Extent]:
    """Left, top, right and bottom of everything in a drawing."""
    found = [one for box in boxes for one in (box.extent, *(label.extent for label in box.labels))]
    for wire in wires:
        found += [label.extent for label in wire.labels]
        found += [(*point, *point) for line in wire.lines for point in line]
    return found


def folded(boxes: list[Box], wires: list[Wire], cuts: Sequence[float], limit: float) -> tuple[list[Box], list[Wire]]:
    """The same drawing, in rows of at most ``limit`` where it is wider; ``cuts`` are all x at which it can be cut.

    A column that is wider alone stays whole.
    """
    lefts, _, rights, _ = zip(*extents(boxes, wires) or [(0.0,) * 4], strict=True)
    left, right = min(lefts), max(rights)
    if right - left <= limit:
        return boxes, wires
    crossed = {x: _crossing(wires, x) for x in cuts}
    chosen = _chosen([x for x in cuts if left < x < right], left, right, limit, {x: len(y) for x, y in crossed.items()})
    if not chosen:
        return boxes, wires
    rows = Rows.of(boxes, wires, (left, *chosen), [crossed[x] for x in chosen])
    return [rows.box(box) for box in boxes], [rows.wire(wire) for wire in wires]


def _crossing(wires: Iterable[Wire], x: float) -> list[float]:
    """Heights at which wires cross a vertical line, from top to bottom."""
    lines = (line for wire in wires for line in wire.lines)
    return sorted({a[1] for line in lines for a, b in pairwise(line) if _between(a, x, b)})


def _between(a: Point, x: float, b: Point) -> bool:
    return min(a[0], b[0]) < x < max(a[0], b[0])


def _chosen(cuts: Sequence[float], left: float, right: float, limit: float, crossed: dict[float, int]) -> list[float]:
    """The cuts that leave rows of similar widths and few wires between them."""
    best: dict[float, tuple[float, list[float]]] = {left: (0.0, [])}
    for here in (*cuts, right):
        choices = []
        for start, (cost, before) in best.items():
            room = limit - 2 * TRACK * crossed.get(here, 0) - 2 * EDGE
            share = (here - start) / max(room, 1.0)
            over = 1e3 * (share - 1) if share > 1 else 0.0  # one column that is wider alone
            choices.append((cost + over + share**2 + CROSSING * crossed.get(here, 0) + ROW, [*before, here]))
        best[here] = min(choices)
    return best[right][1][:-1]


def _empty(spans: list[Point]) -> list[Point]:
    """Empty bands between the heights that are taken, from top to bottom: where each ends, and what it is too high."""
    found, reached = [], spans[0][0]
    for low, high in spans:
        if low - reached > EMPTY:
            found.append((low, float(int((low - reached - EMPTY) // 10 * 10))))
        reached = max(reached, high)
    return found


@attrs.frozen(eq=False)
class Rows:
    """Where each row begins in the wide drawing, how it is shifted, and the heights of the wires that leave it.

    ``bands`` are the empty ones that are left out of a row: where each ends, and by how much what is below moves up.
    """

    starts: tuple[float, ...]
    shifts: list[Point]
    crossed: list[list[float]]
    floors: list[float]
    bands: list[list[Point]]
    detours: Detours

    @classmethod
    def of(
        cls, boxes: Sequence[Box], wires: Sequence[Wire], starts: tuple[float, ...], crossed: list[list[float]]
    ) -> Rows:
        """The rows that begin at ``starts``, packed one below the other."""
        spans: list[list[Point]] = [[] for _ in starts]
        for left, top, right, bottom in extents(boxes, wires):
            spans[bisect(starts, (left + right) / 2) - 1].append((top, bottom))
        detours = Detours.of(boxes, wires, starts, crossed)
        for row, heights in enumerate(crossed):  # a wire may cross a row without an end in it
            for k in (row, row + 1):
                spans[k] += [(y, y) for y in heights if y not in detours.passing[k]]
        bands = [_empty(sorted(some)) for some in spans]
        indent = EDGE + TRACK * max(map(len, crossed))
        shifts, floors, y = [], [], 0.0
        for row, start in enumerate(starts):
            top, bottom = min(a for a, _ in spans[row]), max(b for _, b in spans[row])
            shifts.append(((indent if row else 0.0) - start, float(round(y - top))))
            floors.append(bottom + shifts[row][1] - sum(size for _, size in bands[row]))
            y = floors[row] + 2 * EDGE + TRACK * len(crossed[row] if row < len(crossed) else ())
        return cls(starts, shifts, crossed, floors, bands, detours)

    def shift(self, x: float, y: float) -> Point:
        """How far something at a point of the wide drawing moves."""
        return self._shift(self.row(x), y)

    def _shift(self, row: int, y: float) -> Point:
        dx, dy = self.shifts[row]
        return dx, dy - sum(size for end, size in self.bands[row] if end <= y)

    def row(self, x: float) -> int:
        """The row of something at ``x`` in the wide drawing."""
        return max(bisect(self.starts, x) - 1, 0)

    def box(self, box: Box) -> Box:
        """A block or terminal in its row."""
        return box.moved(*self.shift(box.x + box.width / 2, box.y))

    def point(self, point: Point) -> Point:
        """A point in its row."""
        dx, dy = self.shift(*point)
        return point[0] + dx, point[1] + dy

    def wire(self, wire: Wire) -> Wire:
        """A wire in all its rows."""
        return attrs.evolve(
            wire,
            lines=tuple(tuple(self._line(line)) for line in wire.lines),
            arrows=tuple(attrs.evolve(a, x=x, y=y) for a in wire.arrows for x, y in [self.point((a.x, a.y))]),
            dots=tuple(map(self.point, wire.dots)),
            taps=tuple(map(self.point, wire.taps)),
            labels=tuple(label.moved(*self.shift(label.x, label.y)) for label in wire.labels),
        )

    def _line(self, line: Sequence[Point]) -> list[Point]:
        found = [self.point(line[0])]
        for a, b in pairwise(line):
            found += self._across(a, b) if a[0] < b[0] else self._across(b, a)[::-1]
            found.append(self.point(b))
        return _straightened(found)

    def _across(self, a: Point, b: Point) -> list[Point]:
        """Corners of a horizontal wire from the row of its left end to that of its right end."""
        found: list[Point] = []
        first, y = self.row(a[0]), a[1]
        for row in range(first, self.row(b[0])):
            ends, lead = self._connection(row, y)
            if row == first and y in self.detours.dropped[row]:
                ends = [(self.point(a)[0], lead[0][1])]
            elif row > first and y in self.detours.passing[row]:
                ends = [(found.pop()[0], lead[0][1])]
            found += [*ends, *lead]
        return found

    def _connection(self, row: int, y: float) -> tuple[list[Point], list[Point]]:
        """Corners of a wire at the end of a row, and those from there to the start of the next.

        The highest runs outside on the right, lowest between the rows and inside on the left, so that none cross.
        """
        heights = self.crossed[row]
        place = heights.index(y)
        edge, start = self.starts[row + 1] + self.shifts[row][0], self.starts[row + 1] + self.shifts[row + 1][0]
        outside = len(heights) - len(self.detours.passing[row]) - len(self.detours.dropped[row])
        right = edge + EDGE / 2 + TRACK * (outside - 1 - place)
        left = start - EDGE / 2 - TRACK * place
        lane = self.floors[row] + EDGE + TRACK * (len(heights) - 1 - place)
        upper, lower = (y + self._shift(k, y)[1] for k in (row, row + 1))
        return [(right, upper), (right, lane)], [(left, lane), (left, lower)]


def _straightened(line: Sequence[Point]) -> list[Point]:
    """A line without corners at which it does not turn."""
    inner = zip(line, line[1:], line[2:], strict=False)
    turns = [b for a, b, c in inner if not (a[0] == b[0] == c[0] or a[1] == b[1] == c[1])]
    return [line[0], *turns, line[-1]]
