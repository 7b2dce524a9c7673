"""Charts of the reference: signals over time, and one signal over another, as SVG text coloured by the page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tsmblocks.html import charts
from tsmblocks.html.charts import LEFT, RIGHT, Frame
from tsmblocks.html.pages import part

LINES = ("measured", "after", "before", "between")
"""Classes of the lines, in the order in which signals are named: inputs first."""
POINTS = 500
"""Samples of a line."""
TALL = 150
"""Height of the part of a chart in which data are drawn [pixels]."""
BELOW = 38
"""Distance of the label of the x axis below the data [pixels]: clear of the ticks in the letters of small charts."""
COLOURS = 256
"""Colours of a picture of curves. Chosen: edges stay smooth, and a file is a third as large."""
ALIKE = 8.0
"""Ratio of two ranges up to which signals share an axis."""


def over_time(t: np.ndarray, signals: Mapping[str, np.ndarray], labels: Mapping[str, str]) -> str:
    """Signals over time [s]; those of another unit or a much smaller range have an axis of their own.

    ``labels`` are the signals' names with their units.
    """
    groups: list[list[str]] = []
    for name in signals:
        same = labels[name].removeprefix(name)  # the unit
        home = next(
            (g for g in groups if labels[g[0]].removeprefix(g[0]) == same and _alike(signals[g[0]], signals[name])),
            None,
        )
        home.append(name) if home else groups.append([name])
    parts, top = [], 24.0
    for place, group in enumerate(groups):
        last = place == len(groups) - 1
        span = charts.spread(*(signals[k] for k in group))
        frame = Frame(LEFT, top, RIGHT, top + TALL, (float(t[0]), float(t[-1])), span)
        parts.append(charts.axes(frame, "t [s]" if last else "", ", ".join(labels[k] for k in group), numbers=last))
        parts += [_line(frame, t, signals, name) for name in group]
        top = frame.bottom + 30
    return charts.chart(parts, top + 6, f"{', '.join(labels.values())} over time")


def over_another(x: np.ndarray, y: np.ndarray, labels: tuple[str, str]) -> str:
    """One signal over another."""
    frame = Frame(LEFT, 24.0, RIGHT, 24.0 + 1.6 * TALL, charts.spread(x), charts.spread(y))
    across, up = charts.sampled(1200, x, y)
    below = charts.text(RIGHT, frame.bottom + BELOW, labels[0], "end")
    parts = [charts.axes(frame, "", labels[1]), below, charts.line(frame, across, up, "after")]
    return charts.chart(parts, frame.bottom + BELOW + 6, f"{labels[1]} over {labels[0]}")


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    a, b = (float(np.abs(s).max()) for s in (one, other))
    return max(a, b) <= ALIKE * min(a, b) or max(a, b) == 0


def _line(frame: Frame, t: np.ndarray, signals: Mapping[str, np.ndarray], name: str) -> str:
    across, up = charts.thinned(t, signals[name], POINTS)
    return charts.line(frame, across, up, LINES[list(signals).index(name) % len(LINES)])


def side_by_side(charts_made: list[str], names: list[str]) -> str:
    """Charts beside each other on a wide page, with the colours of the signals above them."""
    colours = [(LINES[k % len(LINES)], name) for k, name in enumerate(names)]
    return (part("key", colours) if len(names) > 1 else "") + part("figures", charts_made)


def lighten(path: Path) -> None:
    """Write a picture again with a palette of ``COLOURS``."""
    from PIL import Image

    with Image.open(path) as picture:
        made = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    made.save(path, optimize=True)
