"""Size, ports and texts of a block in the drawing."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import attrs

from tsmblocks.draw.faces import LINE, Face, face, symbol_of
from tsmblocks.draw.graph import SUMS, End, Node, sign_of
from tsmblocks.draw.picture import GRID, NAME, PITCH, RADIUS, SMALL, Box, Label, Point, fitted, text_width, wrapped
from tsmblocks.model.diagram import Diagram

LONGEST = 170
"""Width at which a name goes on in a new line [pixels]; the whole name is in the tooltip too."""
MOST_LINES = 3
"""Lines of a name at most."""
BELOW = ("bottom", "below")
"""Sides of a circle that are entered from below, the second where feedback enters on two inputs."""


@attrs.frozen
class Size:
    """Width and height of an outline, and the room to keep free around its middle."""

    width: float
    height: float
    above: float
    below: float
    left: float
    right: float


PASSING = Size(0, 0, GRID, GRID, 0, 0)
"""Of a wire that passes a column."""


@attrs.frozen(eq=False)
class Outlines:
    """Sizes and ports of nodes, given the sides on which wires enter circles.

    ``lanes`` are the distances from the middle at which wires enter a circle from below, where there are two.
    """

    nodes: Mapping[str, Node]
    sides: Mapping[End, str]
    with_values: bool = True
    lanes: dict[End, float] = attrs.field(init=False, factory=dict)
    _sizes: dict[str, Size] = attrs.field(init=False, factory=dict)

    def entered(self, node: Node) -> set[str]:
        """Sides on which wires enter a node."""
        return {self.sides.get((node.key, port), "") for port in node.ins}

    def size(self, key: str) -> Size:
        """The size of a node, or of a wire that passes."""
        if key not in self.nodes:
            return PASSING
        if key not in self._sizes:
            self._sizes[key] = self._size(self.nodes[key])
        return self._sizes[key]

    def face(self, node: Node) -> Face:
        """What is written in a node."""
        written = face(node.block, self.with_values, node.unit_of)
        if node.shape == "triangle":  # small letters, so that it stays short
            return attrs.evolve(written, lines=tuple((text, float(NAME)) for text, _ in written.lines))
        return written

    def offset(self, end: End, side: str) -> float:
        """Height of a port relative to the middle of its node, downwards positive; 0 for a wire that passes."""
        node = self.nodes.get(end[0])
        if node is None:
            return 0.0
        if side == "in" and node.round:
            return {"left": 0.0, "top": -30.0, "bottom": 30.0, "below": 50.0}[self.sides[end]]
        ports = list(node.ports(side))
        if node.shape == "tall" and side == "in":
            ports.sort(key=lambda p: self.sides[node.key, p])
        return (ports.index(end[1]) - (len(ports) - 1) / 2) * PITCH if end[1] in ports else 0.0

    def _size(self, node: Node) -> Size:
        lines = names(node)
        name, above = max(text_width(line, NAME) for line in lines), 20 + LINE * (len(lines) - 1)
        if node.shape == "terminal":
            left, right = (name + 14, 0.0) if node.key.startswith(">") else (0.0, name + 14)
            rows = GRID * math.ceil(len(lines) * LINE / 2 / GRID)
            return Size(8, 8, rows, rows, left, right)
        if node.round:
            return _circle_size(name, above - 20, self.entered(node))
        ports = max(len(node.ins), len(node.outs), 1)
        if node.shape == "tall":
            height, half = PITCH * ports + PITCH * (ports % 2), max(24, name / 2 + 4)
            return Size(44, height, height / 2 + above, height / 2, half, half)
        written = self.face(node)
        if node.shape == "triangle":
            height, width = 2 * PITCH, 2 * -(-max(44, _triangle_width(written, 2 * PITCH)) // 2)
        else:
            height = PITCH * -(-max(ports * PITCH, LINE * len(written.lines) + 12, 40) // PITCH)
            texts = written.width + 20 + _widest(node, "in") + _widest(node, "out")
            width = 2 * -(-max(60, texts) // 2) + (8 if node.shape == "double" else 0)
        half = max(width / 2, name / 2 + 4)
        return Size(width, height, height / 2 + above, height / 2, half, half)


def _circle_size(name: float, more: float, entered: set[str]) -> Size:
    """Room of a sum or product with a name of some width that takes ``more`` height than one line."""
    below = 60 if "below" in entered else 40 if entered & {"top", "bottom"} else 20
    under = "top" in entered and "bottom" not in entered
    half = max(RADIUS + 16, name / 2 + 4, name + 10 if "top" in entered and not under else 0)
    return Size(2 * RADIUS, 2 * RADIUS, 40 + (0 if under else more), below + (more if under else 0), half, half)


def _triangle_width(written: Face, height: float) -> float:
    """Width at which the text just fits between the sides of a triangle that is ``height`` high at its base."""
    size = written.lines[0][1]
    return (written.width + 5) / (1 - 1.05 * size / height)


def names(node: Node) -> list[str]:
    """The lines in which the name of a node is written."""
    return wrapped(node.name, NAME, LONGEST, MOST_LINES)


def _port_names(node: Node, side: str) -> tuple[str, ...]:
    """Ports whose name is written, because the block has several on that side."""
    if node.shape in ("round", "tall"):
        return ()
    wired, every = node.ports(side), node.block.inports if side == "in" else node.block.outports
    usual = [k for k, p in every.items() if k in wired or not getattr(p, "rate_of", "")]
    return wired if len(usual) > 1 else ()


def _widest(node: Node, side: str) -> float:
    """Room that the names of the ports on one side take in a box."""
    return max((text_width(name, SMALL) + 8 for name in _port_names(node, side)), default=0.0)


def box(outlines: Outlines, node: Node, middle: Point, *, turned: bool, accent: bool) -> Box:
    """The node drawn around a point; ``turned`` in a feedback path, where signals run to the left."""
    x, y = middle
    size = outlines.size(node.key)
    left, top = x - size.width / 2, y - size.height / 2
    drawn = Box(node.name, node.shape, left, top, size.width, size.height, accent=accent, turned=turned)
    if node.shape == "terminal":
        return attrs.evolve(drawn, labels=tuple(_terminal_name(node, middle)), about=_tooltip(node))
    labels = _name(node, middle, top, outlines.entered(node))
    labels += _ports(outlines, node, left, left + size.width, y, turned) + _signs(outlines, node, x, left, y)
    shift = (_widest(node, "in") - _widest(node, "out")) / (-2 if turned else 2)
    written = outlines.face(node)
    if node.shape == "triangle":  # its text stands near the base
        shift = (written.width + 10 - size.width) / (-2 if turned else 2)
    pairs = zip(written.lines, written.baselines, strict=True)
    labels += [Label(text, x + shift, y + down, letters, "symbol") for (text, letters), down in pairs]
    strokes: tuple[tuple[Point, Point], ...] = ()
    if written.stacked:
        half = max(text_width(text, letters) for text, letters in written.lines[:2]) / 2
        strokes = (((x + shift - half, y + written.bar), (x + shift + half, y + written.bar)),)
    return attrs.evolve(drawn, labels=tuple(labels), strokes=strokes, about=_tooltip(node))


def _stacked(lines: list[str], x: float, y: float, kind: str, anchor: str = "middle") -> list[Label]:
    """Lines of a name from a first baseline on."""
    return [Label(line, x, y + LINE * k, NAME, kind, anchor) for k, line in enumerate(lines)]


def _terminal_name(node: Node, middle: Point) -> list[Label]:
    """Left of an input and right of an output."""
    side, anchor = (-8, "end") if node.key.startswith(">") else (8, "start")
    lines = names(node)
    return _stacked(lines, middle[0] + side, middle[1] + 4 - LINE * (len(lines) - 1) / 2, "terminal", anchor)


def _name(node: Node, middle: Point, top: float, entered: Collection[str]) -> list[Label]:
    """Above the box; beside or below a circle that is entered from above."""
    (x, y), lines = middle, names(node)
    up = LINE * (len(lines) - 1)
    if node.round and "top" in entered:
        if "bottom" in entered:
            return _stacked(lines, x + 6, y - RADIUS - 5 - up, "name", "start")
        return _stacked(lines, x, y + RADIUS + 14, "name")
    return _stacked(lines, x, top - 6 - up, "name")


def _ports(outlines: Outlines, node: Node, left: float, right: float, y: float, turned: bool) -> list[Label]:
    """Names of ports inside a box."""
    labels = []
    inset = 5 if node.shape == "box" else 8
    for side in ("in", "out"):
        x, anchor = (left + inset, "start") if (side == "in") != turned else (right - inset, "end")
        for port in _port_names(node, side):
            height = y + outlines.offset((node.key, port), side) + 3.5
            labels.append(Label(port, x, height, SMALL, "port", anchor))
    return labels


def _signs(outlines: Outlines, node: Node, x: float, left: float, y: float) -> list[Label]:
    """Signs of the inputs of a sum, inside a tall one and outside a circle."""
    place = {"left": (x - RADIUS - 6, y - 6, "end"), "top": (x - 5, y - RADIUS - 4, "end")}
    labels = []
    for port in node.ins if node.shape in ("round", "tall") and symbol_of(node.block) in SUMS else ():
        end, sign = (node.key, port), sign_of(node, port)
        if node.round:
            lane = outlines.lanes.get(end, 0.0)
            under = (x + lane + (-6 if lane < 0 else 6), y + RADIUS + 11, "end" if lane < 0 else "start")
            at, height, anchor = place.get(outlines.sides[end], under)
            labels.append(Label(sign, at, height, NAME + 1, "sign", anchor))
        else:
            labels.append(Label(sign, left + 8, y + outlines.offset(end, "in") + 4, NAME, "sign"))
    return labels


def _tooltip(node: Node) -> str:
    """The block's class, summary and parameters."""
    block: Any = node.block
    if block is None:
        return f"{'input' if node.key.startswith('>') else 'output'} {node.name}"
    if isinstance(block, Diagram):
        return "\n".join(filter(None, (f"{node.name}: {block.title or 'diagram'}", block.source)))
    words = (type(block).__doc__ or "").strip().partition("\n")[0]
    lines = [f"{node.name}: {type(block).__name__}", words]
    for name, value in block.parameters.items():
        unit = block.fields()[name].unit
        shown = f"{value:.6g}" if isinstance(value, float) else fitted(str(value), 1, 40)
        lines.append(f"{name} = {shown}{f' {unit}' if unit and '?' not in unit else ''}")
    return "\n".join(filter(None, lines))
