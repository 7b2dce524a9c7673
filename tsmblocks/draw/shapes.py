"""Size, ports and texts of a block in the drawing."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

import attrs

from tsmblocks.draw.graph import SUMS, End, Node, sign_of, symbol_of
from tsmblocks.draw.picture import GRID, NAME, PITCH, RADIUS, SMALL, SYMBOL, Box, Label, Point, fitted, text_width
from tsmblocks.model.diagram import Diagram

LONGEST = 170
"""Width at which a name is cut [pixels]; the whole name is in the tooltip."""
LINE = 14
"""Distance of lines of text in a box [pixels]."""
SWITCHED = {"enable": "enabled", "trigger": "triggered"}
"""Word in the box of a diagram that is switched, by what switches it."""


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
    """Sizes and ports of nodes, given the sides on which wires enter circles."""

    nodes: Mapping[str, Node]
    sides: Mapping[End, str]
    _sizes: dict[str, Size] = attrs.field(init=False, factory=dict)

    def entered(self, node: Node) -> set[str]:
        """Sides on which wires enter a node."""
        return {self.sides.get((node.key, port), "") for port in node.ins}

    def size(self, key: str) -> Size:
        """The size of a node, or of a wire that passes."""
        if key not in self.nodes:
            return PASSING
        if key not in self._sizes:
            self._sizes[key] = _size(self.nodes[key], self.entered(self.nodes[key]))
        return self._sizes[key]

    def offset(self, end: End, side: str) -> float:
        """Height of a port relative to the middle of its node, downwards positive; 0 for a wire that passes."""
        node = self.nodes.get(end[0])
        if node is None:
            return 0.0
        if side == "in" and node.round:
            return {"left": 0.0, "top": -30.0, "bottom": 30.0}[self.sides[end]]
        ports = list(node.ports(side))
        if node.shape == "tall" and side == "in":
            ports.sort(key=lambda p: self.sides[node.key, p])
        return (ports.index(end[1]) - (len(ports) - 1) / 2) * PITCH if end[1] in ports else 0.0


def _size(node: Node, entered: Collection[str]) -> Size:
    name = text_width(fitted(node.name, NAME, LONGEST), NAME)
    if node.shape == "terminal":
        left, right = (name + 14, 0.0) if node.key.startswith(">") else (0.0, name + 14)
        return Size(8, 8, GRID, GRID, left, right)
    if node.round:
        below = 40 if "top" in entered or "bottom" in entered else 20
        half = max(RADIUS + 16, name / 2 + 4, name + 10 if "top" in entered and "bottom" in entered else 0)
        return Size(2 * RADIUS, 2 * RADIUS, 40, below, half, half)
    ports = max(len(node.ins), len(node.outs), 1)
    if node.shape == "tall":
        height, half = PITCH * ports + PITCH * (ports % 2), max(24, name / 2 + 4)
        return Size(44, height, height / 2 + 20, height / 2, half, half)
    lines, letters, _ = _face(node)
    height = PITCH * -(-max(ports * PITCH, LINE * len(lines) + 12, 40) // PITCH)
    texts = max(text_width(line, letters) for line in lines) + 20 + _widest(node, "in") + _widest(node, "out")
    width = 2 * -(-max(60, texts) // 2) + (8 if node.shape == "double" else 0)
    half = max(width / 2, name / 2 + 4)
    return Size(width, height, height / 2 + 20, height / 2, half, half)


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


def _face(node: Node) -> tuple[list[str], float, bool]:
    """The lines written in a box, the size of their letters, and whether they are the two parts of a fraction."""
    if isinstance(node.block, Diagram):
        kinds = (b.switches for b in node.block.blocks.values() if not isinstance(b, Diagram))
        switched = [f"({SWITCHED[kind]})" for kind in kinds if kind]
        return [*_wrapped(node.block.title or "diagram"), *switched], SMALL + 1, False
    symbol = symbol_of(node.block)
    if fraction(symbol):
        return list(fraction(symbol)), 13, True
    if text_width(symbol, SYMBOL) <= 110:
        return [symbol], SYMBOL, False
    return _wrapped(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", symbol)), SMALL + 1, False


def fraction(symbol: str) -> tuple[str, ...]:
    """Numerator and denominator of a symbol such as ``1/(Ts+1)``; nothing for any other."""
    depth, cuts = 0, []
    for k, c in enumerate(symbol):
        depth += (c == "(") - (c == ")")
        if c == "/" and depth == 0:
            cuts.append(k)
    parts = (symbol[: cuts[0]], symbol[cuts[0] + 1 :]) if len(cuts) == 1 else ()
    return tuple(_bare(p) for p in parts) if all(p and p == p.strip() for p in parts) else ()


def _bare(text: str) -> str:
    """Without parentheses around the whole."""
    inner = text[1:-1]
    return inner if text[:1] == "(" and text[-1:] == ")" and "(" not in inner and ")" not in inner else text


def _wrapped(text: str) -> list[str]:
    """At most three lines of small text."""
    lines: list[str] = []
    for word in text.split():
        if lines and text_width(f"{lines[-1]} {word}", SMALL + 1) <= 140:
            lines[-1] += " " + word
        else:
            lines.append(word)
    if len(lines) > 3:
        lines = [*lines[:2], lines[2] + "…"]
    return [fitted(line, SMALL + 1, 140) for line in lines]


def box(outlines: Outlines, node: Node, middle: Point, *, turned: bool, accent: bool) -> Box:
    """The node drawn around a point; ``turned`` in a feedback path, where signals run to the left."""
    x, y = middle
    size = outlines.size(node.key)
    left, top = x - size.width / 2, y - size.height / 2
    strokes: tuple[tuple[Point, Point], ...] = ()
    if node.shape == "terminal":
        side, anchor = (-8, "end") if node.key.startswith(">") else (8, "start")
        labels = [Label(fitted(node.name, NAME, LONGEST), x + side, y + 4, NAME, "terminal", anchor)]
    else:
        labels = [_name(node, middle, top, outlines.entered(node))]
        labels += _ports(outlines, node, left, left + size.width, y, turned) + _signs(outlines, node, x, left, y)
        shift = (_widest(node, "in") - _widest(node, "out")) / (-2 if turned else 2)
        lines, letters, stacked = _face(node)
        first, pitch = (y - 5, 19.0) if stacked else (y + 0.36 * letters - LINE * (len(lines) - 1) / 2, float(LINE))
        labels += [Label(line, x + shift, first + pitch * k, letters, "symbol") for k, line in enumerate(lines)]
        half = max(text_width(line, letters) for line in lines) / 2
        strokes = (((x + shift - half, y), (x + shift + half, y)),) if stacked else ()
    return Box(
        node.name, node.shape, left, top, size.width, size.height, tuple(labels), strokes, _tooltip(node), accent
    )


def _name(node: Node, middle: Point, top: float, entered: Collection[str]) -> Label:
    """Above the box; beside or below a circle that is entered from above."""
    (x, y), text = middle, fitted(node.name, NAME, LONGEST)
    if node.round and "top" in entered:
        if "bottom" in entered:
            return Label(text, x + 6, y - RADIUS - 5, NAME, "name", "start")
        return Label(text, x, y + RADIUS + 14, NAME, "name")
    return Label(text, x, top - 6, NAME, "name")


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
    place = {
        "left": (x - RADIUS - 6, y - 6, "end"),
        "top": (x - 5, y - RADIUS - 4, "end"),
        "bottom": (x + 6, y + RADIUS + 11, "start"),
    }
    labels = []
    for port in node.ins if node.shape in ("round", "tall") and symbol_of(node.block) in SUMS else ():
        end, sign = (node.key, port), sign_of(node, port)
        if node.round:
            at, height, anchor = place[outlines.sides[end]]
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
