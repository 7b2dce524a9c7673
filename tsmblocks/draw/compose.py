"""From a diagram to a picture: graph, order, placement, routing, and the frame around the drawing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tsmblocks.common.arguments import as_bool, as_number
from tsmblocks.common.errors import TsmError
from tsmblocks.draw import placement, routing
from tsmblocks.draw.annotations import Loops, drawn_loops, highlighted, nested, wire_texts
from tsmblocks.draw.folding import extents, folded
from tsmblocks.draw.graph import End, Net, graph
from tsmblocks.draw.ordering import rows
from tsmblocks.draw.picture import SMALL, TITLE, Box, Label, Picture, Point, Wire, text_width, wrapped
from tsmblocks.draw.polylines import traced
from tsmblocks.draw.routing import Plan
from tsmblocks.draw.shapes import MOST_LINES, box
from tsmblocks.model.diagram import Diagram, required_diagram

MARGIN = 24
WRAP = 1800.0
"""Width beyond which a drawing goes on in a new row [pixels]. Chosen: some twenty blocks, on a wide screen."""
NARROWEST = 480.0
"""Width at which a title is wrapped, when the drawing itself is narrower [pixels]."""


def layout(
    diagram: Diagram,
    *,
    highlight: Iterable[str] = (),
    values: Mapping[str, Any] | None = None,
    loops: Iterable[Any] = (),
    inside: str = "",
    parameters: bool = True,
    wrap: float = WRAP,
) -> Picture:
    """The diagram drawn: a value that holds every box, line and text with its coordinates.

    Signals flow from left to right, feedback runs below the blocks. Arguments and errors are those of ``to_svg``.
    Equal diagrams with their blocks in the same order give equal pictures.
    """
    diagram = nested(required_diagram(diagram, "drawn", TsmError), inside)
    title = ": ".join(filter(None, (inside, diagram.title)))
    accent = highlighted(diagram, highlight)
    marked = drawn_loops(diagram, loops)
    accent |= marked.blocks
    drawn = graph(diagram, marked.noted(wire_texts(diagram, values)))
    found = rows(drawn)
    outlines, heights = placement.placed(drawn, found, as_bool("parameters", parameters))
    plan = routing.routed(Plan(drawn, found, outlines, dict(heights)))
    for channel in plan.channels:
        plan.y |= dict.fromkeys(channel.loop.blocks, channel.y)
    turned = {key for loop in drawn.loops for key in loop.blocks}
    boxes = [
        box(outlines, node, (plan.x[key], plan.y[key]), turned=key in turned, accent=key in accent)
        for key, node in drawn.nodes.items()
    ]
    wires = [_wire(diagram, plan, net, net.source[0] in turned, marked) for net in drawn.nets]
    width = as_number("wrap", wrap, TsmError) - 2 * MARGIN
    return _framed(title, diagram.source, *folded(boxes, [wire for wire in wires if wire.lines], plan.cuts, width))


def _wire(diagram: Diagram, plan: Plan, net: Net, turned: bool, marked: Loops) -> Wire:
    key, way = net.source[0], -1 if turned else 1
    x = plan.x[key] + way * plan.outlines.size(key).width / 2
    y = plan.leaves(net.source)
    pieces, text = plan.pieces[net], routing.note(net)
    if text and not pieces:
        pieces.append((x, y, x + way * routing.stub(net), y))
    lines, dots = traced(pieces)
    start = x + way * (14 if net.tapped else 6)
    label = Label(text, start, y - 5, SMALL, "signal", "end" if turned else "start")
    taps: tuple[Point, ...] = ((x + 7, y),) if net.tapped else ()
    pairs = [pair for loop in plan.graph.loops for pair in zip(loop.nets, loop.blocks, strict=False)]
    returned = [(key, plan.graph.nodes[key].ins[0]) for one, key in pairs if one is net]
    targets = tuple(map(_end_name, (*net.ahead, *returned, *net.back)))
    signal = _end_name(net.source)
    unit = diagram.unit(signal)
    about = f"{signal}{f' [{unit}]' if unit else ''} → {', '.join(targets) or 'nothing'}{marked.about(net.source)}"
    accent = net.source in marked.signals
    return Wire(signal, targets, lines, tuple(plan.arrows[net]), dots, taps, (label,) if text else (), about, accent)


def _end_name(end: End) -> str:
    return ".".join(filter(None, (end[0].lstrip("<>"), end[1])))


def _framed(title: str, source: str, boxes: list[Box], wires: list[Wire]) -> Picture:
    """Everything moved to the right and below the title, with a margin around it."""
    found = extents(boxes, wires) or [(0.0,) * 4]
    lefts, tops, rights, bottoms = zip(*found, strict=True)
    left, top, right, bottom = min(lefts), min(tops), max(rights), max(bottoms)
    heads, y = [], float(MARGIN)
    for text, high, kind in ((title, TITLE, "title"), (source, SMALL + 1, "source")):
        for line in wrapped(" ".join(text.split()), high, max(right - left, NARROWEST), MOST_LINES) if text else ():
            y += high
            heads.append(Label(line.strip(), MARGIN, y, high, kind, "start"))
            y += 6
    y += 18 if heads else 0
    width = max([right - left, *(text_width(h.text, h.size) for h in heads)]) + 2 * MARGIN
    dx, dy = round(MARGIN - left), round(y - top)
    return Picture(
        title,
        float(round(width + 1)),
        float(round(dy + bottom + MARGIN)),
        tuple(b.moved(dx, dy) for b in boxes),
        tuple(w.moved(dx, dy) for w in wires),
        tuple(heads),
    )
