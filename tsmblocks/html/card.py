"""The frame of a card, its style, and the charts of signals that several cards show."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from tsmblocks.common import displayed_units
from tsmblocks.data import heading
from tsmblocks.html import charts
from tsmblocks.html.charts import LEFT, RIGHT, Frame, ends
from tsmblocks.html.pages import FLUSH_LEFT, part, rendered

MOST_LINES, MOST_CHARTS, MOST_ROWS = 6, 4, 12
"""Lines of a chart, charts and rows of a table at most; the rest is counted."""
POINTS = 500
"""Points of one line at most."""
ROUNDED = 1e-12
"""Share of a signal's size that is rounding. Chosen: some thousand units in the last place."""


def card(title: str, about: str, *parts: str) -> Markup:
    """A card; title and what it is about are text, the parts are ``Markup``."""
    return Markup(rendered("card.html", {"title": title, "about": about, "parts": parts}))


def rows(
    names: Sequence[str],
    cells: Sequence[Sequence[str]],
    caption: str,
    kinds: Sequence[str] = (),
    most: int | None = MOST_ROWS,
    count: int | None = None,
) -> Markup:
    """A table of texts with its caption; a name that begins with ``l:`` is of a column that is flush left.

    ``kinds`` are classes of the rows. Of more than ``most`` of them the rest is counted; they are ``count`` where cells
    were made of the first ones only.
    """
    return part("table", names, cells, caption, kinds, most, count)


def table_of(
    cells: Sequence[Sequence[str]], left: Collection[int], caption: str, most: int | None = MOST_ROWS
) -> Markup:
    """The rows of a printed table, the heading first; empty columns are left out."""
    kept = [k for k in range(len(cells[0])) if any(row[k] for row in cells[1:])]
    head = [f"{FLUSH_LEFT if k in left else ''}{cells[0][k] or 'remark'}" for k in kept]
    return rows(head, [[row[k] for k in kept] for row in cells[1:]], caption, most=most)


def listed(texts: Iterable[str], title: str = "") -> Markup:
    """Sentences as a list, nothing where there are none."""
    return part("bullets", list(texts), title, MOST_ROWS)


def over_time(t: np.ndarray, signals: Mapping[str, tuple[np.ndarray, str]], words: str) -> Markup:
    """Charts of signals (values, unit) over time in s, one for each unit, angles in degrees."""
    groups: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name, (values, unit) in signals.items():
        k, shown = displayed_units.display_unit(unit)
        groups.setdefault(shown, []).append((name, k * np.asarray(values, dtype=float)))
    drawn = [_chart(t, lines, unit, words) for unit, lines in list(groups.items())[:MOST_CHARTS]]
    left = len(groups) - len(drawn)
    return part("charts", drawn) + (part("remark", f"… and signals of {left} more units") if left > 0 else "")


def over_time_and_ranges(
    t: np.ndarray, signals: Mapping[str, tuple[np.ndarray, str]], words: str
) -> tuple[Markup, Markup]:
    """Charts, and a table of ranges; angles in degrees."""
    cells = []
    for name, (values, unit) in signals.items():
        k, shown = displayed_units.display_unit(unit)
        y = np.asarray(values, dtype=float)[np.isfinite(values)]
        figures = (y.min(), y.max(), values[-1]) if len(y) else (np.nan,) * 3
        size = float(np.abs(k * y).max(initial=0.0))
        cells.append([name, *(table_number(k * float(v), size) for v in figures), shown])
    return over_time(t, signals, words), rows(
        ["l:signal", "min", "max", "last", "l:unit"], cells, "Ranges of the signals"
    )


def _chart(t: np.ndarray, lines: Sequence[tuple[str, np.ndarray]], unit: str, words: str) -> Markup:
    shown = lines[:MOST_LINES]
    names = [name for name, _ in shown]
    kinds = [f"c{k}" for k in range(len(shown))]
    label = heading(names[0] if len(names) == 1 else "", unit).strip()
    curves = [(kind, y) for kind, (_, y) in zip(kinds, shown, strict=True)]
    drawn = time_chart(t, curves, label, f"{', '.join(names)} {words}")
    more = f"… ({len(lines)} in all)" if len(lines) > len(shown) else ""
    return part("chart", drawn, list(zip(kinds, names, strict=True)) if len(names) > 1 else [], more)


def time_chart(
    t: np.ndarray, lines: Sequence[tuple[str, np.ndarray]], label: str, words: str, *, zero: bool = False
) -> Markup:
    """A chart of lines (class, values) over time in s; ``zero`` is on its y axis too."""
    frame = Frame(LEFT, 22, RIGHT, 120, ends(t), charts.spread(*(y for _, y in lines), zero=zero))
    drawn = [charts.line(frame, *charts.thinned(t, y, POINTS), kind) for kind, y in lines]
    return charts.chart([charts.axes(frame, "t [s]", label), *drawn], 152, words)


def table_number(value: float, size: float = 0.0) -> str:
    """A number of a table; zero where it is rounding error beside ``size``."""
    return f"{0.0 if abs(value) < ROUNDED * size else value:.4g}"
