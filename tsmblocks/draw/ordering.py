"""The order of blocks and passing wires in each column, with few crossings. It has no coordinates."""

from __future__ import annotations

from bisect import bisect_right, insort

import attrs

from tsmblocks.draw.graph import End, Graph, Net

FLOOR = "_"
"""Key of the feedback channels below all blocks, as the end of a link."""
LOW = 1e9
"""Position below all others."""
SWEEPS = 8
"""Passes to the right and to the left in which the columns are sorted. Chosen: more seldom save a crossing."""
LARGE = 400
"""Links beyond which fewer sweeps are made, so that a huge diagram is still drawn in seconds."""


@attrs.frozen(eq=False)
class Link:
    """A signal between two neighbouring columns; ``main`` when it belongs to the main chain."""

    net: Net
    left: End
    right: End
    main: bool = False


@attrs.define(eq=False)
class Rows:
    """Keys of each column from top to bottom, and the links of each gap (gap ``k`` is left of column ``k``).

    A signal that passes a column stands in it with a key that begins with ``~``.
    """

    columns: list[list[str]]
    gaps: list[list[Link]]

    @property
    def place(self) -> dict[str, int]:
        """The place of each key in its column."""
        return {key: k for column in self.columns for k, key in enumerate(column)}


def rows(graph: Graph) -> Rows:
    """Columns in a good order, with the links between them."""
    found = _rows(graph)
    best = (_crossings(graph, found), [list(c) for c in found.columns])
    few = sum(map(len, found.gaps)) > LARGE
    for first in (0,) if few else (0, 1):
        found.columns = [c[::-1] if first else list(c) for c in best[1]]
        for sweep in range(first, first + (2 if few else SWEEPS)):
            _sweep(graph, found, rightwards=sweep % 2 == 0)
            while _swap(graph, found) and not few:
                pass
            crossings = _crossings(graph, found)
            if crossings < best[0]:
                best = (crossings, [list(c) for c in found.columns])
    found.columns = best[1]
    return found


def main_chain(graph: Graph) -> set[tuple[str, str]]:
    """Edges of the longest chain of blocks ahead; one that ends at an output of the diagram wins a tie."""
    edges = [
        (net.source[0], key)
        for net in graph.nets
        for key, _ in net.ahead
        if net.source[0] in graph.column and key in graph.column
    ]
    edges.sort(key=lambda e: graph.column[e[0]])
    length: dict[str, float] = {}
    before: dict[str, str] = {}
    ends = {net.source[0] for net in graph.nets if net.outputs}
    for u, v in edges:
        if length.get(u, 0) + 1 > length.get(v, 0):
            length[v], before[v] = length.get(u, 0) + 1, u
    chain = set[tuple[str, str]]()
    last = max(length, key=lambda k: length[k] + 0.5 * (k in ends or k.startswith("<")), default="")
    while last in before:
        chain.add((before[last], last))
        last = before[last]
    return chain


def _rows(graph: Graph) -> Rows:
    count = max(graph.column.values(), default=0) + 1
    found = Rows([[] for _ in range(count)], [[] for _ in range(count + 1)])
    for key, column in graph.column.items():
        found.columns[column].append(key)
    chain = main_chain(graph)
    for k, net in enumerate(graph.nets):
        if net.source[0] not in graph.column:
            continue
        start = graph.column[net.source[0]]
        reach = {end: graph.column[end[0]] for end in net.ahead if end[0] in graph.column}
        straight = [c for (key, _), c in reach.items() if (net.source[0], key) in chain]
        left = net.source
        for column in range(start + 1, max(reach.values(), default=start) + 1):
            for end in [end for end, c in reach.items() if c == column]:
                found.gaps[column].append(Link(net, left, end, (net.source[0], end[0]) in chain))
            if column < max(reach.values()):
                through = (f"~{k}~{column}", "")
                found.columns[column].append(through[0])
                found.gaps[column].append(Link(net, left, through, column < max(straight, default=0)))
                left = through
    for loop in graph.loops:
        first, last = loop.nets[0], loop.nets[-1]
        found.gaps[graph.column[first.source[0]] + 1].append(Link(first, first.source, (FLOOR, "")))
        for end in last.back:
            found.gaps[graph.column[end[0]]].append(Link(last, (FLOOR, ""), end))
    return found


def _rank(graph: Graph, end: End, side: str) -> float:
    """Relative height of a port on its box, between 0 and 1; the ports of a circle are free."""
    node = graph.nodes.get(end[0])
    free = node is None or node.shape in ("round", "tall")
    ports = () if free or node is None else node.ports(side)
    return (ports.index(end[1]) + 1) / (len(ports) + 1) if end[1] in ports else 0.5


def _position(graph: Graph, place: dict[str, int], end: End, side: str, floor: float) -> float:
    return floor if end[0] == FLOOR else place[end[0]] + _rank(graph, end, side)


def _crossings(graph: Graph, found: Rows) -> int:
    """Pairs of links that cross."""
    total, place = 0, found.place
    for links in found.gaps:
        ends = sorted(
            (_position(graph, place, a.left, "out", LOW), _position(graph, place, a.right, "in", LOW)) for a in links
        )
        seen: list[float] = []
        for _, right in ends:
            total += len(seen) - bisect_right(seen, right)
            insort(seen, right)
    return total


def _linked(graph: Graph, found: Rows, place: dict[str, int], c: int, left: bool, floor: float) -> list[list[float]]:
    """For each key of a column, positions of what it is linked to on the left or on the right."""
    linked: dict[str, list[float]] = {key: [] for key in found.columns[c]}
    for link in found.gaps[c] if left else found.gaps[c + 1]:
        here, there, side = (link.right, link.left, "out") if left else (link.left, link.right, "in")
        if here[0] in linked:
            linked[here[0]].append(_position(graph, place, there, side, floor))
    return list(linked.values())


def _sweep(graph: Graph, found: Rows, rightwards: bool) -> None:
    """Sort every column by the mean place of what each key is linked to on one side."""
    count, place = len(found.columns), found.place
    for c in range(count) if rightwards else reversed(range(count)):
        floor = len(found.columns[c - 1 if rightwards else min(c + 1, count - 1)])
        linked = zip(found.columns[c], _linked(graph, found, place, c, rightwards, floor), strict=True)
        mean = {key: sum(v) / len(v) if v else float(place[key]) for key, v in linked}
        found.columns[c].sort(key=mean.__getitem__)
        place |= {key: k for k, key in enumerate(found.columns[c])}


def _swap(graph: Graph, found: Rows) -> bool:
    """Exchange neighbours wherever that removes crossings; returns whether it ever did."""
    place, changed = found.place, False
    for c, column in enumerate(found.columns):
        sides = [_linked(graph, found, place, c, left, LOW) for left in (True, False)]
        for k in range(len(column) - 1):
            pairs = [(p, q) for side in sides for p in side[k] for q in side[k + 1]]
            if sum(p < q for p, q in pairs) < sum(p > q for p, q in pairs):
                column[k], column[k + 1] = column[k + 1], column[k]
                for side in sides:
                    side[k], side[k + 1] = side[k + 1], side[k]
                changed = True
        place |= {key: k for k, key in enumerate(column)}
    return changed
