"""From a diagram to a picture: graph, order, placement, routing, and the frame around the drawing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tsmblocks.draw import placement, routing
from tsmblocks.draw.graph import End, Net, graph
from tsmblocks.draw.ordering import rows
from tsmblocks.draw.picture import SMALL, TITLE, Label, Picture, Point, Wire, fitted, text_width
from tsmblocks.draw.polylines import traced
from tsmblocks.draw.routing import Plan
from tsmblocks.draw.shapes import box, port_offset, size
from tsmblocks.draw.wire_values import notes
from tsmblocks.model.diagram import Diagram

MARGIN = 24
WIDEST = 900
"""Width at which a title or source line is cut, when the drawing itself is narrower."""


def layout(diagram: Diagram, *, values: Mapping[str, Any] | None = None) -> Picture:
    """The diagram drawn: a value that holds every box, line and text with its coordinates.

    Signals flow from left to right, feedback runs below the blocks. ``values`` as for ``to_svg``. Equal
    diagrams with their blocks in the same order give equal pictures.
    """
    drawn = graph(diagram, notes(diagram, values))
    found = rows(drawn)
    sides, heights = placement.placed(drawn, found)
    plan = routing.routed(Plan(drawn, found, sides, dict(heights)))
    for channel in plan.channels:
        plan.y |= dict.fromkeys(channel.loop.blocks, channel.y)
    turned = {key for loop in drawn.loops for key in loop.blocks}
    boxes = [box(node, (plan.x[key], plan.y[key]), sides, key in turned) for key, node in drawn.nodes.items()]
    wires = [_wire(diagram, plan, net, net.source[0] in turned) for net in drawn.nets]
    return _framed(diagram, boxes, [wire for wire in wires if wire.lines])


def _wire(diagram: Diagram, plan: Plan, net: Net, turned: bool) -> Wire:
    node = plan.graph.nodes[net.source[0]]
    way = -1 if turned else 1
    x = plan.x[node.key] + way * size(node, plan.sides).width / 2
    y = plan.y[node.key] + port_offset(node, net.source[1], "out", plan.sides)
    pieces, text = plan.pieces[net], routing.note(net)
    if text and not pieces:
        pieces.append((x, y, x + way * routing.stub(net), y))
    lines, dots = traced(pieces)
    start = x + way * (14 if net.tapped else 6)
    label = Label(text, start, y - 5, SMALL, "signal", "end" if turned else "start")
    taps: tuple[Point, ...] = ((x + 7, y),) if net.tapped else ()
    returned = [
        (key, plan.graph.nodes[key].ins[0])
        for loop in plan.graph.loops
        for one, key in zip(loop.nets, loop.blocks, strict=False)
        if one is net
    ]
    targets = tuple(map(_said, (*net.ahead, *returned, *net.back)))
    unit = diagram.unit(_said(net.source))
    about = f"{_said(net.source)}{f' [{unit}]' if unit else ''} → {', '.join(targets) or 'nothing'}"
    return Wire(_said(net.source), targets, lines, tuple(plan.arrows[net]), dots, taps, (label,) if text else (), about)


def _said(end: End) -> str:
    return ".".join(filter(None, (end[0].lstrip("<>"), end[1])))


def _framed(diagram: Diagram, boxes: list[Any], wires: list[Wire]) -> Picture:
    """Everything moved to the right and below the title, with a margin around it."""
    points = [p for w in wires for line in w.lines for p in line]
    spans = [b.extent for b in boxes] + [a.extent for o in (*boxes, *wires) for a in o.labels]
    left = min([s[0] for s in spans] + [p[0] for p in points], default=0.0)
    top = min([s[1] for s in spans] + [p[1] for p in points], default=0.0)
    right = max([s[2] for s in spans] + [p[0] for p in points], default=0.0)
    bottom = max([s[3] for s in spans] + [p[1] for p in points], default=0.0)
    heads, y = [], float(MARGIN)
    wide = max(right - left, WIDEST)
    for text, high, kind in ((diagram.title, TITLE, "title"), (diagram.source, SMALL + 1, "source")):
        if text:
            y += high
            heads.append(Label(fitted(" ".join(text.split()), high, wide), MARGIN, y, high, kind, "start"))
            y += 6
    y += 18 if heads else 0
    width = max([right - left, *(text_width(h.text, h.size) for h in heads)]) + 2 * MARGIN
    dx, dy = round(MARGIN - left), round(y - top)
    return Picture(
        diagram.title,
        float(round(width + 1)),
        float(round(dy + bottom + MARGIN)),
        tuple(b.moved(dx, dy) for b in boxes),
        tuple(w.moved(dx, dy) for w in wires),
        tuple(heads),
    )
