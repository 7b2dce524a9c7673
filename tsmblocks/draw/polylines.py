"""Wires as lines: pieces put together, corners kept, branch points found. It has coordinates only."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

from tsmblocks.draw.picture import Point

Piece = tuple[float, float, float, float]


def traced(pieces: Iterable[Piece]) -> tuple[tuple[tuple[Point, ...], ...], tuple[Point, ...]]:
    """Lines with their corners, and the points where lines of the same signal branch off."""
    around = _neighbours(list(pieces))
    knots = [p for p in around if len(around[p]) != 2]
    done = set[frozenset[Point]]()
    lines: list[tuple[Point, ...]] = []
    for start in knots + [p for p in around if p not in knots]:  # rings without a knot come last
        for following in around[start]:
            if frozenset((start, following)) not in done:
                line = _line(start, following, around, done)
                lines.append(_corners(line))
    return tuple(lines), tuple(p for p in knots if len(around[p]) > 2)


def _neighbours(pieces: list[Piece]) -> dict[Point, list[Point]]:
    """Every end of a piece, with the next ends along the pieces it lies on."""
    ends = sorted({p for x1, y1, x2, y2 in pieces for p in ((x1, y1), (x2, y2))})
    around: dict[Point, list[Point]] = {p: [] for p in ends}
    for x1, y1, x2, y2 in pieces:
        low, high = (min(x1, x2), min(y1, y2)), (max(x1, x2), max(y1, y2))
        on = [p for p in ends if low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1]]
        for a, b in itertools.pairwise(on):
            if b not in around[a]:
                around[a].append(b)
                around[b].append(a)
    return {p: sorted(others) for p, others in around.items() if others}


def _line(start: Point, following: Point, around: dict[Point, list[Point]], done: set[frozenset[Point]]) -> list[Point]:
    """Points from ``start`` on, up to the next branch or end; what was passed is added to ``done``."""
    line = [start, following]
    done.add(frozenset((start, following)))
    while len(around[line[-1]]) == 2:
        onward = [p for p in around[line[-1]] if frozenset((line[-1], p)) not in done]
        if not onward:
            break
        done.add(frozenset((line[-1], onward[0])))
        line.append(onward[0])
    return line


def _corners(line: list[Point]) -> tuple[Point, ...]:
    """The line without the points at which it only goes straight on."""
    kept = [line[0]]
    for before, here, after in zip(line, line[1:], line[2:], strict=False):
        if (before[0] == here[0]) != (here[0] == after[0]):
            kept.append(here)
    return (*kept, line[-1])
