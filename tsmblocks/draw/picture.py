"""What a drawing is made of: boxes, wires and texts with coordinates, as values. It knows no diagram.

Lengths are pixels, x to the right and y downwards. Everything that carries a wire lies on a grid of
``GRID`` pixels, so two wires either share a line or stand at least that far apart.
"""

from __future__ import annotations

import re
import unicodedata
from itertools import accumulate

import attrs

Point = tuple[float, float]
Extent = tuple[float, float, float, float]
"""Left, top, right and bottom."""

GRID = 10
PITCH = 20
"""Distance of neighbouring ports, parallel wires and feedback channels [pixels]."""
RADIUS = 15
"""Radius of the circle of a sum or a product [pixels]."""

FRAME = 4
"""Distance of the two frames around a diagram inside a diagram [pixels]."""
NAME, SYMBOL, SMALL, TITLE = 12, 15, 10, 16
"""Font sizes of names, symbols, ports and signals, and the title [pixels]."""
LIGHT = {
    "paper": "#ffffff",
    "ink": "#1a1a1a",
    "soft": "#5a5a5a",
    "signal": "#1d4ed8",
    "accent": "#c2410c",
    "accent-fill": "#fff1e8",
}
"""Colours by what they mean: background, lines, small print, signals, highlighted blocks and their inside."""
DARK = {
    "paper": "#161718",
    "ink": "#ececec",
    "soft": "#a9a9a9",
    "signal": "#8ab4ff",
    "accent": "#ff9a57",
    "accent-fill": "#3a2213",
}
"""The same colours on a dark page."""

_WIDTHS = {
    "'ijlI": 0.3,
    "J,. /:;\\|f-`": 0.38,
    "₀₁₂₃₄₅₆₇₈₉ₓ²³": 0.45,
    "()[]trs!z_*": 0.53,
    "DGHNOQUX&": 0.8,
    "w#+<=>^~×÷ω−→M": 0.87,
    "m@%W…—": 1.02,
}
_WIDTH = {c: width for chars, width in _WIDTHS.items() for c in chars}
"""Widths of DejaVu Sans, the widest of the usual sans-serif fonts, in units of the size, rounded up; else 0.7."""


def text_width(text: str, size: float) -> float:
    """An upper estimate of the width of a text that needs no font."""
    return size * sum(map(_character_width, text))


def _character_width(c: str) -> float:
    if unicodedata.combining(c):
        return 0.0
    return 1.05 if unicodedata.east_asian_width(c) in "WF" else _WIDTH.get(c, 0.7)


def fitted(text: str, size: float, width: float) -> str:
    """The text, cut with an ellipsis where it would be wider than ``width``."""
    widths = [0.0, *accumulate(map(_character_width, text))]
    if size * widths[-1] <= width:
        return text
    end = _character_width("…")
    kept = next((k for k in range(len(text), 0, -1) if size * (widths[k] + end) <= width), 0)
    return text[:kept].rstrip() + "…"


def wrapped(text: str, size: float, width: float, most: int) -> list[str]:
    """The text in lines of at most ``width``, broken at spaces, and a longer word at underscores and capitals.

    Beyond ``most`` lines it is cut with an ellipsis.
    """
    lines = [""]
    for word in re.findall(r" *[^ ]+", text) or [text]:
        whole = text_width(word.lstrip(), size) <= width
        for part in [word] if whole else re.findall(r" *(?:[A-Z]?[^_ A-Z]+_*|[A-Z]|_+)", word):
            if text_width(lines[-1] + part, size) <= width or not lines[-1]:
                lines[-1] += part
            else:
                lines.append(part.lstrip())
    if len(lines) > most:
        lines = [*lines[: most - 1], "".join(lines[most - 1 :])]
    return [fitted(line, size, width) for line in lines]


@attrs.frozen
class Label:
    """A line of text. ``y`` is its baseline; ``anchor`` says which point of the text ``x`` is.

    ``kind`` is ``name``, ``symbol``, ``port``, ``sign``, ``terminal``, ``signal``, ``title`` or ``source``.
    """

    text: str
    x: float
    y: float
    size: float
    kind: str
    anchor: str = "middle"

    @property
    def weight(self) -> str:
        """Weight of the font."""
        return "bold" if self.kind in ("title", "sign") else "normal"

    def colour(self, accent: bool) -> str:
        """Name of the colour of the text; ``accent`` where its block is highlighted."""
        if accent and self.kind in ("name", "symbol"):
            return "accent"
        return {"source": "soft", "port": "soft", "signal": "signal", "terminal": "signal"}.get(self.kind, "ink")

    @property
    def extent(self) -> Extent:
        """Left, top, right and bottom of the text, estimated."""
        width = text_width(self.text, self.size)
        left = self.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor] * width
        return left, self.y - 0.8 * self.size, left + width, self.y + 0.22 * self.size

    def moved(self, dx: float, dy: float) -> Label:
        """The same text elsewhere."""
        return attrs.evolve(self, x=self.x + dx, y=self.y + dy)


def _shifted(point: Point, dx: float, dy: float) -> Point:
    return point[0] + dx, point[1] + dy


@attrs.frozen
class Box:
    """One block or terminal: its outline and the texts and strokes that belong to it.

    ``shape`` is ``box``, ``double`` (a diagram inside the diagram), ``round`` (sum, product), ``tall``
    (a sum of many inputs), ``triangle`` (gain) or ``terminal``; ``about`` is the tooltip; ``accent`` where it
    is highlighted; ``turned`` where signals run through it to the left.
    """

    name: str
    shape: str
    x: float
    y: float
    width: float
    height: float
    labels: tuple[Label, ...] = ()
    strokes: tuple[tuple[Point, Point], ...] = ()
    about: str = ""
    accent: bool = False
    turned: bool = False

    @property
    def extent(self) -> Extent:
        """Left, top, right and bottom of the outline."""
        return self.x, self.y, self.x + self.width, self.y + self.height

    @property
    def colours(self) -> tuple[str, str]:
        """Names of the colours of the outline and of its inside."""
        return ("accent", "accent-fill") if self.accent else ("ink", "paper")

    @property
    def corners(self) -> tuple[Point, Point, Point]:
        """Corners of a triangle, the last where its signal leaves."""
        left, top, right, bottom = self.extent
        base, tip = (right, left) if self.turned else (left, right)
        return (base, bottom), (base, top), (tip, (top + bottom) / 2)

    @property
    def rim(self) -> float:
        """Radius of the corners; the first and the last port of a tall sum stand where they end."""
        return PITCH / 2 if self.shape == "tall" else 2.0

    def moved(self, dx: float, dy: float) -> Box:
        """The same box elsewhere."""
        strokes = tuple((_shifted(a, dx, dy), _shifted(b, dx, dy)) for a, b in self.strokes)
        labels = tuple(label.moved(dx, dy) for label in self.labels)
        return attrs.evolve(self, x=self.x + dx, y=self.y + dy, labels=labels, strokes=strokes)


@attrs.frozen
class Arrow:
    """An arrowhead: its tip, and the direction it points in."""

    x: float
    y: float
    dx: int
    dy: int

    @property
    def corners(self) -> tuple[Point, Point, Point]:
        """Tip and the two corners behind it."""
        back, half = 8.5, 3.5
        x, y = self.x - back * self.dx, self.y - back * self.dy
        across = (half * self.dy, half * self.dx)
        return (self.x, self.y), (x - across[0], y - across[1]), (x + across[0], y + across[1])


@attrs.frozen
class Wire:
    """One signal: where it comes from and goes to, and the lines it is drawn with.

    ``dots`` mark branch points, ``taps`` the places where an output of the diagram is read off.
    """

    signal: str
    targets: tuple[str, ...]
    lines: tuple[tuple[Point, ...], ...]
    arrows: tuple[Arrow, ...] = ()
    dots: tuple[Point, ...] = ()
    taps: tuple[Point, ...] = ()
    labels: tuple[Label, ...] = ()
    about: str = ""
    accent: bool = False

    @property
    def colour(self) -> str:
        """Name of the colour of its lines: the accent colour in an algebraic loop."""
        return "accent" if self.accent else "ink"

    def moved(self, dx: float, dy: float) -> Wire:
        """The same wire elsewhere."""
        return attrs.evolve(
            self,
            lines=tuple(tuple(_shifted(p, dx, dy) for p in line) for line in self.lines),
            arrows=tuple(attrs.evolve(a, x=a.x + dx, y=a.y + dy) for a in self.arrows),
            dots=tuple(_shifted(p, dx, dy) for p in self.dots),
            taps=tuple(_shifted(p, dx, dy) for p in self.taps),
            labels=tuple(label.moved(dx, dy) for label in self.labels),
        )


@attrs.frozen
class Picture:
    """A drawing as a value, which ``to_svg``, ``to_png`` and ``to_pdf`` render."""

    title: str
    width: float
    height: float
    boxes: tuple[Box, ...]
    wires: tuple[Wire, ...]
    labels: tuple[Label, ...] = ()
