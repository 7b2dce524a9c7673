"""Size, ports and texts of a block in the drawing."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.draw.graph import SUMS, End, Node, sign_of, symbol_of
from tsmblocks.draw.picture import GRID, NAME, PITCH, RADIUS, SMALL, SYMBOL, Box, Label, Point, fitted, text_width
from tsmblocks.model.diagram import Diagram

LONGEST = 170
"""Width at which a name is cut [pixels]; the whole name is in the tooltip."""
LINE = 14
"""Distance of lines of text in a box [pixels]."""


@attrs.frozen
class Size:
    """Width and height of an outline, and the room to keep free above and below its middle."""

    width: float
    height: float
    above: float
    below: float
    left: float
    right: float


def port_names(node: Node, side: str) -> tuple[str, ...]:
    """Ports whose name is written, because the block has several on that side."""
    if node.block is None or node.shape in ("round", "tall"):
        return ()
    wired, every = (node.ins, node.block.inports) if side == "in" else (node.outs, node.block.outports)
    usual = [k for k, p in every.items() if k in wired or not getattr(p, "rate_of", "")]
    return wired if len(usual) > 1 else ()


def face(node: Node) -> list[str]:
    """The lines written in a box: the symbol, the two parts of a fraction, or words on several lines."""
    if isinstance(node.block, Diagram):
        return _wrapped(node.block.title or "diagram", SMALL + 1, 140)
    symbol = symbol_of(node.block)
    if fraction(symbol):
        return list(fraction(symbol))
    if text_width(symbol, SYMBOL) <= 110:
        return [symbol]
    return _wrapped(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", symbol), SMALL + 1, 140)


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


def _wrapped(text: str, size: float, width: float, most: int = 3) -> list[str]:
    lines: list[str] = []
    for word in text.split():
        if lines and text_width(f"{lines[-1]} {word}", size) <= width:
            lines[-1] += " " + word
        else:
            lines.append(word)
    if len(lines) > most:
        lines = [*lines[: most - 1], lines[most - 1] + "…"]
    return [fitted(line, size, width) for line in lines]


def _face_size(node: Node) -> float:
    if isinstance(node.block, Diagram):
        return SMALL + 1
    symbol = symbol_of(node.block)
    return 13 if fraction(symbol) else SYMBOL if text_width(symbol, SYMBOL) <= 110 else SMALL + 1


def size(node: Node, sides: Mapping[End, str]) -> Size:
    """The size of a node, given the sides on which wires reach it."""
    name = text_width(fitted(node.name, NAME, LONGEST), NAME)
    if node.shape == "terminal":
        left, right = (name + 14, 0.0) if node.key.startswith(">") else (0.0, name + 14)
        return Size(8, 8, GRID, GRID, left, right)
    used = {side for (key, _), side in sides.items() if key == node.key}
    if node.round:
        below = 40 if used & {"top", "bottom"} else 20
        half = max(RADIUS + 16, name / 2 + 4, name + 10 if {"top", "bottom"} <= used else 0)
        return Size(2 * RADIUS, 2 * RADIUS, 40, below, half, half)
    ports = max(len(node.ins), len(node.outs), 1)
    if node.shape == "tall":
        height = PITCH * ports + PITCH * (ports % 2)
        return Size(44, height, height / 2 + 20, height / 2, max(24, name / 2 + 4), max(24, name / 2 + 4))
    lines, text = face(node), _face_size(node)
    need = max(ports * PITCH, LINE * len(lines) + 12, 40)
    height = 2 * PITCH * -(-need // (2 * PITCH)) if need > 40 else 40
    height = height - PITCH if height - PITCH >= need and height > 40 else height
    left, right = (_widest(port_names(node, side)) for side in ("in", "out"))
    width = max(60, max(text_width(line, text) for line in lines) + 20 + left + right)
    width = 2 * -(-width // 2) + (8 if node.shape == "double" else 0)
    half = max(width / 2, name / 2 + 4)
    return Size(width, height, height / 2 + 20, height / 2, half, half)


def _widest(names: tuple[str, ...]) -> float:
    return max((text_width(name, SMALL) + 8 for name in names), default=0.0)


def port_offset(node: Node, port: str, side: str, sides: Mapping[End, str]) -> float:
    """Height of a port relative to the middle of its node, downwards positive."""
    if side == "in" and node.round:
        return {"left": 0.0, "top": -30.0, "bottom": 30.0}[sides[node.key, port]]
    ports = list(node.ins if side == "in" else node.outs)
    if node.shape == "tall" and side == "in":
        ports.sort(key=lambda p: sides[node.key, p])
    if port not in ports:
        return 0.0
    return (ports.index(port) - (len(ports) - 1) / 2) * PITCH


def box(node: Node, middle: Point, sides: Mapping[End, str], turned: bool = False) -> Box:
    """The node drawn around a point; ``turned`` in a feedback path, where signals run to the left."""
    x, y = middle
    whole = size(node, sides)
    left, top = x - whole.width / 2, y - whole.height / 2
    labels: list[Label] = []
    strokes: list[tuple[Point, Point]] = []
    if node.shape == "terminal":
        into = node.key.startswith(">")
        side, anchor = (-8, "end") if into else (8, "start")
        labels.append(Label(fitted(node.name, NAME, LONGEST), x + side, y + 4, NAME, "terminal", anchor))
    else:
        labels.append(_name(node, middle, whole, sides))
        labels += _ports(node, left, left + whole.width, y, sides, turned)
        shift = _widest(port_names(node, "in")) - _widest(port_names(node, "out"))
        drawn, strokes = _face(node, x + (-shift if turned else shift) / 2, y)
        labels += drawn
    return Box(node.name, node.shape, left, top, whole.width, whole.height, tuple(labels), tuple(strokes), about(node))


def _name(node: Node, middle: Point, whole: Size, sides: Mapping[End, str]) -> Label:
    """Above the box; beside or below a circle that is entered from above."""
    (x, y), text = middle, fitted(node.name, NAME, LONGEST)
    used = {side for (key, _), side in sides.items() if key == node.key}
    if node.round and "top" in used:
        if "bottom" in used:
            return Label(text, x + 6, y - RADIUS - 5, NAME, "name", "start")
        return Label(text, x, y + RADIUS + 14, NAME, "name")
    return Label(text, x, y - whole.height / 2 - 6, NAME, "name")


def _face(node: Node, x: float, y: float) -> tuple[list[Label], list[tuple[Point, Point]]]:
    lines, text = face(node), _face_size(node)
    if node.block is not None and not isinstance(node.block, Diagram) and fraction(symbol_of(node.block)):
        half = max(text_width(line, text) for line in lines) / 2
        above, below = (Label(t, x, y + d, text, "symbol") for t, d in zip(lines, (-5, 14), strict=True))
        return [above, below], [((x - half, y), (x + half, y))]
    first = y + 0.36 * text - LINE * (len(lines) - 1) / 2
    return [Label(line, x, first + LINE * k, text, "symbol") for k, line in enumerate(lines)], []


def _ports(node: Node, left: float, right: float, y: float, sides: Mapping[End, str], turned: bool) -> list[Label]:
    """Names of ports inside a box, signs outside a circle."""
    labels = []
    inset = 5 if node.shape == "box" else 8
    for side in ("in", "out"):
        x, anchor = (left + inset, "start") if (side == "in") != turned else (right - inset, "end")
        labels += [
            Label(port, x, y + port_offset(node, port, side, sides) + 3.5, SMALL, "port", anchor)
            for port in port_names(node, side)
        ]
    if node.shape == "tall":
        labels += [
            Label(sign_of(node, p), left + 8, y + port_offset(node, p, "in", sides) + 4, NAME, "sign") for p in node.ins
        ]
    if node.round and symbol_of(node.block) in SUMS:
        x = (left + right) / 2
        place = {
            "left": (x - RADIUS - 6, y - 6, "end"),
            "top": (x - 5, y - RADIUS - 4, "end"),
            "bottom": (x + 6, y + RADIUS + 11, "start"),
        }
        for port in node.ins:
            at, height, anchor = place[sides[node.key, port]]
            labels.append(Label(sign_of(node, port), at, height, NAME + 1, "sign", anchor))
    return labels


def about(node: Node) -> str:
    """The tooltip: the block's class, summary and parameters."""
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
