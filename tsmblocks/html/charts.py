"""Small charts as SVG text: axes, lines, bands, bars and points, coloured by classes of the page they stand on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from typing import Any

import attrs
import numpy as np
from markupsafe import Markup

from tsmblocks.common.errors import without_controls

WIDTH = 360
"""Width of a chart, which is that of a phone; on wider screens charts stand beside each other."""
LEFT, RIGHT = 46, WIDTH - 10
"""Usual edges of the part in which data are drawn [pixels]; left of it are the numbers of the y axis."""
TEXT = 11
"""Size of the texts."""
TOLERANCE = 0.3
"""Tolerance of a simplified curve [pixels]."""
TICKS = 6
"""Ticks of an axis, at most and about."""


@attrs.frozen
class Frame:
    """The part of a chart in which data stand: edges in pixels and the data at them."""

    left: float
    top: float
    right: float
    bottom: float
    x: tuple[float, float]
    y: tuple[float, float]

    def across(self, x: Any) -> Any:
        """Pixels of data along x, a number or an array."""
        low, high = self.x
        return self.left + (np.asarray(x, dtype=float) - low) / (high - low) * (self.right - self.left)

    def up(self, y: Any) -> Any:
        """Pixels of data along y."""
        low, high = self.y
        return self.bottom - (np.asarray(y, dtype=float) - low) / (high - low) * (self.bottom - self.top)


TINY = 1e-300
"""Range below which a signal is drawn as a constant."""
ROOM = 0.05
"""Share of a range that is left free above and below a signal."""


def spread(*signals: np.ndarray, zero: bool = False) -> tuple[float, float]:
    """The range of some signals with a little room; ``zero`` has it hold zero."""
    every = np.concatenate([np.ravel(s) for s in signals if np.size(s)] or [np.zeros(1)])
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    size = high - low or abs(high) or 1.0
    if not size >= TINY:  # room would be lost in rounding
        size = 1.0
    return low - ROOM * size, high + ROOM * size


def ends(t: np.ndarray) -> tuple[float, float]:
    """First and last instant, apart from each other."""
    first, last = (float(t[0]), float(t[-1])) if len(t) else (0.0, 1.0)
    return first, last if last > first else first + 1.0


def ticks(low: float, high: float, most: int = TICKS) -> list[float]:
    """Round numbers between two ends."""
    rough = (high - low) / most
    unit = 10 ** math.floor(math.log10(rough))
    step = next(unit * k for k in (1, 2, 5, 10) if unit * k >= rough * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def chart(parts: Sequence[str], height: float, words: str) -> Markup:
    """A whole chart; ``words`` say what it shows to those who do not see it."""
    label = escape(without_controls(words))
    return Markup(
        f'<svg class="chart" viewBox="0 0 {WIDTH} {_n(height)}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )


def axes(frame: Frame, x_label: str, y_label: str, *, numbers: bool = True) -> str:
    """Grid, numbers and labels; without ``numbers`` none below, where another chart stands under this one."""
    parts = []
    for value in ticks(*frame.y, most=5):
        y = frame.up(value)
        parts += [rule(frame.left, y, frame.right, y, "grid"), text(frame.left - 4, y + 4, tick_label(value), "end")]
    parts.append(x_axis(frame, x_label, numbers=numbers))
    if y_label:
        parts.append(text(2, frame.top - 10, y_label))
    return "".join(parts)


def x_axis(frame: Frame, label: str, *, numbers: bool = True) -> str:
    """Grid, numbers and label of the x axis."""
    parts = []
    for value in ticks(*frame.x):
        x = frame.across(value)
        parts.append(rule(x, frame.top, x, frame.bottom, "grid"))
        if numbers:
            parts.append(text(x, frame.bottom + 14, tick_label(value), "middle"))
    if numbers and label:
        parts.append(text(frame.right, frame.bottom + 28, label, "end"))
    return "".join(parts)


def tick_label(value: float) -> str:
    """A number at a tick."""
    return f"{0.0 if abs(value) < 1e-12 else value:.6g}".replace("-", "−")


def line(frame: Frame, x: np.ndarray, y: np.ndarray, kind: str) -> str:
    """A line of class ``kind``, broken where a number is missing; it is cut at a tenth of a pixel."""
    if not len(x):
        return ""
    across, up = frame.across(x), np.clip(frame.up(y), frame.top - 2, frame.bottom + 2)
    pieces, old, begin = list[str](), "", True
    for a, b in zip(across, up, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            begin = True
            continue
        here = f"{_n(a)} {_n(b)}"
        if here != old or begin:
            pieces.append(("M" if begin else " ") + here)
        begin, old = False, here
    return f'<path class="line {kind}" d="{"".join(pieces)}"/>'


def band(frame: Frame, low: float, high: float, kind: str) -> str:
    """A band across the whole width between two values."""
    top, bottom = np.clip(frame.up([high, low]), frame.top, frame.bottom)
    return box(frame.left, top, frame.right - frame.left, bottom - top, kind)


def area(frame: Frame, x: np.ndarray, low: np.ndarray, high: np.ndarray, kind: str) -> str:
    """What lies between two lines over the same ``x``, none of them missing."""
    across = frame.across(np.concatenate([x, x[::-1]]))
    up = np.clip(frame.up(np.concatenate([high, low[::-1]])), frame.top, frame.bottom)
    corners = " ".join(f"{_n(a)},{_n(b)}" for a, b in zip(across, up, strict=True))
    return f'<polygon class="{kind}" points="{corners}"/>'


def points(frame: Frame, x: np.ndarray, y: np.ndarray, error: np.ndarray, kind: str) -> str:
    """Dots with bars of their standard error, where there is one."""
    parts = []
    for a, b, low, high in zip(frame.across(x), frame.up(y), frame.up(y - error), frame.up(y + error), strict=True):
        if math.isfinite(low):
            parts.append(rule(a, low, a, high, f"line {kind}"))
        parts.append(f'<circle class="dot {kind}" cx="{_n(a)}" cy="{_n(b)}" r="2.6"/>')
    return "".join(parts)


def box(x: float, y: float, width: float, height: float, kind: str, more: str = "") -> str:
    """A rectangle of a class."""
    return (
        f'<rect class="{kind}" x="{_n(x)}" y="{_n(y)}" width="{_n(max(width, 0))}" '
        f'height="{_n(max(height, 0))}"{more}/>'
    )


def rule(x: float, y: float, x2: float, y2: float, kind: str) -> str:
    """A straight line of a class."""
    return f'<path class="{kind}" d="M{_n(x)} {_n(y)} {_n(x2)} {_n(y2)}"/>'


def text(x: float, y: float, words: str, anchor: str = "start", kind: str = "") -> str:
    """A text; ``anchor`` is which end of it ``x`` is."""
    where = "" if anchor == "start" else f' text-anchor="{anchor}"'
    own = f' class="{kind}"' if kind else ""
    return f'<text{own} x="{_n(x)}" y="{_n(y)}"{where}>{escape(without_controls(words), quote=False)}</text>'


def thinned(t: np.ndarray, y: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """About ``count`` samples for a line of the same look: of each interval the lowest and the highest, in order."""
    if len(t) <= count:
        return t, y
    edges = np.linspace(0, len(t), max(count // 2, 1) + 1).astype(int)
    kept = []
    for start, stop in pairwise(edges):
        part = y[start:stop]
        if len(part) and np.isfinite(part).any():
            kept += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    return t[kept], y[kept]


def traced(frame: Frame, x: np.ndarray, y: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The corners of any curve, at most ``count``, so that it is drawn within a few pixels of itself.

    Points that are omitted lie within ``TOLERANCE`` pixels of the line drawn, which is doubled until few are left.
    """
    points = np.column_stack([frame.across(x), frame.up(y)])
    if not np.isfinite(points).all():
        return x, y
    off = TOLERANCE
    kept = _corners(points, off)
    while len(kept) > max(count, 2):
        off *= 2
        kept = _corners(points, off)
    return x[kept], y[kept]


def _corners(points: np.ndarray, off: float) -> np.ndarray:
    """Indices of the points (n, 2) that a simplified line keeps: the method of Ramer, Douglas and Peucker."""
    kept = np.zeros(len(points), dtype=bool)
    kept[[0, -1]] = True
    todo = [(0, len(points) - 1)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        way, part = points[last] - points[first], points[first + 1 : last] - points[first]
        length = float(np.hypot(*way))
        along = np.clip(part @ way / length**2, 0.0, 1.0) if length > 0 else np.zeros(len(part))
        away = np.hypot(*(part - along[:, None] * way).T)
        far = int(np.argmax(away))
        if away[far] > off:
            kept[first + 1 + far] = True
            todo += [(first, first + 1 + far), (first + 1 + far, last)]
    return np.flatnonzero(kept)


def sampled(count: int, *signals: np.ndarray) -> list[np.ndarray]:
    """The same ``count`` samples of several signals, evenly spaced."""
    length = len(signals[0])
    kept = np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int))
    return [s[kept] for s in signals]


def _n(value: float) -> str:
    short = f"{value:.1f}"
    return short[:-2] if short.endswith(".0") else short
