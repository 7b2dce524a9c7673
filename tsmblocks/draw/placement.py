"""Heights: which side of a circle a wire enters, and how high each block is placed. It has no widths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from tsmblocks.draw import simplex
from tsmblocks.draw.graph import End, Graph
from tsmblocks.draw.ordering import FLOOR, Link, Rows
from tsmblocks.draw.picture import GRID
from tsmblocks.draw.shapes import BELOW, Outlines

MAIN, PASSING, ALONE, BRANCH = 64, 24, 12, 4
"""Cost of a step in the main chain, a wire past blocks, a wire without branches, a branch. Chosen by eye."""
MOST = 2_000_000
"""Work spent on heights, in rules times exchanges: one or two seconds; only huge diagrams need more."""


def placed(graph: Graph, found: Rows, with_values: bool = True) -> tuple[Outlines, dict[str, int]]:
    """Outlines and heights. A first pass of heights determines from which side the circles are entered."""
    first = Outlines(graph.nodes, sides(graph, found, {}), with_values)
    outlines = Outlines(graph.nodes, sides(graph, found, heights(first, found)), with_values)
    return outlines, heights(outlines, found)


def sides(graph: Graph, found: Rows, y: Mapping[str, int]) -> dict[End, str]:
    """The side on which each input of a circle is entered: ``left``, ``top``, ``bottom`` or ``below``.

    Inputs of a tall sum get their rank as text instead, so that they can be sorted. What comes from
    further up enters further up; feedback comes from below, beside another if it must
    (``below``). ``y`` are heights as far as known.
    """
    place = found.place
    chosen: dict[End, str] = {}
    entering: dict[str, list[Link]] = {}
    for link in (link for links in found.gaps for link in links):
        node = graph.nodes.get(link.right[0])
        if node is not None and node.shape in ("round", "tall"):
            entering.setdefault(node.key, []).append(link)
    for key, links in entering.items():
        node = graph.nodes[key]
        links.sort(key=lambda a: (place.get(a.left[0], 1e9), _out_rank(graph, a.left), a.right[1]))
        if node.shape == "tall":
            chosen |= {a.right: f"{k:03}" for k, a in enumerate(links)}
        else:
            chosen |= dict(zip((a.right for a in links), _around(links, y), strict=True))
    for loop in graph.loops:  # a circle in a feedback path has no links; it is not drawn there
        for key in loop.blocks:
            chosen |= {(key, port): "left" for port in graph.nodes[key].ins}
    return chosen


def _out_rank(graph: Graph, end: End) -> int:
    node = graph.nodes.get(end[0])
    return node.outs.index(end[1]) if node is not None and end[1] in node.outs else 0


def _around(links: list[Link], y: Mapping[str, int]) -> tuple[str, ...]:
    """Sides for the inputs of a circle, from top to bottom."""
    fed_back = [link.left[0] == FLOOR for link in links]
    if len(links) == 1:
        return ("left",)
    if len(links) == 3:
        return ("left", "bottom", "below") if fed_back[1] else ("top", "left", "bottom")
    if fed_back[1] or links[0].main or links[1].main:
        return ("top", "left") if links[1].main and not fed_back[1] else ("left", "bottom")
    here = y.get(links[0].right[0], 0)
    steps = [abs(y.get(link.left[0], 0) - here) for link in links]
    return ("top", "left") if steps[1] < steps[0] else ("left", "bottom")


def heights(outlines: Outlines, found: Rows) -> dict[str, int]:
    """The middle of every key, in pixels on the grid, with as few bends as the order allows."""
    number = {key: k for k, key in enumerate(itertools.chain.from_iterable(found.columns), 1)}
    rules, start = _columns(outlines, found, number)
    for links in found.gaps:
        for link in links:
            if FLOOR in (link.left[0], link.right[0]):
                continue
            a, b = (round(outlines.offset(*end) / GRID) for end in ((link.left, "out"), (link.right, "in")))
            u, v = number[link.left[0]], number[link.right[0]]
            up, down = _costs(link, links, outlines.sides)
            middle = len(start)
            start.append(min(start[u] + a, start[v] + b))
            rules += [simplex.Rule(middle, u, -a, up), simplex.Rule(middle, v, -b, down)]
    y = simplex.positions(len(start), rules, start, pivots=max(200, MOST // (1 + len(rules))))
    top = min((y[k] for k in number.values()), default=0)
    return {key: (y[k] - top) * GRID for key, k in number.items()}


def _columns(outlines: Outlines, found: Rows, number: Mapping[str, int]) -> tuple[list[simplex.Rule], list[int]]:
    """Distances within the columns, and the heights when every column is packed from the top."""
    rules, start = [], [0] * (len(number) + 1)
    for column in found.columns:
        for above, key in zip(["", *column], column, strict=False):
            before, apart = number.get(above, 0), _apart(outlines, above, key) if above else 0
            start[number[key]] = start[before] + apart
            rules.append(simplex.Rule(before, number[key], apart, 0))
    return rules, start


def _apart(outlines: Outlines, above: str, below: str) -> int:
    """Grid steps between two neighbours in a column: the room each keeps for itself, and some between."""
    room = math.ceil(outlines.size(above).below / GRID) + math.ceil(outlines.size(below).above / GRID)
    return room + (0 if above.startswith("~") else 1 if below.startswith("~") else 2)


def _costs(link: Link, links: list[Link], chosen: Mapping[End, str]) -> tuple[int, int]:
    """Costs of a step upwards and of one downwards, from left to right.

    A wire that enters a circle from above may start as high as it likes, so that costs little. Where
    a long wire has to bend, it rather does so at its end than at its start.
    """
    side = chosen.get(link.right, "")
    if side in ("top", *BELOW):
        return (BRANCH, 1) if side == "top" else (1, BRANCH)
    if link.main:
        return MAIN, MAIN
    onward, passed = link.right[0].startswith("~"), link.left[0].startswith("~")
    if onward and passed:
        return PASSING, PASSING
    alone = sum(other.net is link.net for other in links) == 1
    cost = (ALONE if alone else BRANCH) + (not passed) + onward
    return cost, cost
