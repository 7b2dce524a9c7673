"""The frame of a card, its style, and the charts of signals that several cards show."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape

import numpy as np

from tsmblocks.common import units
from tsmblocks.data import heading
from tsmblocks.html import charts
from tsmblocks.html.charts import WIDTH, Frame
from tsmblocks.html.document import key, table

COLOURS = ("#2b7fc4", "#d9661f", "#1f9a72", "#b8659b", "#b98900", "#6b8299")
"""Colours of lines, apart for colour-blind readers and far enough from white and from black paper."""
MOST_LINES, MOST_CHARTS, MOST_ROWS = 6, 4, 12
"""Lines of a chart, charts and rows of a table at most; the rest is counted."""
POINTS = 500
"""Points of one line at most."""
ROUNDED = 1e-12
"""Share of a signal's size that is nothing but rounding."""
LEFT, RIGHT = 46, WIDTH - 10
SIGNS = "".join(f".tsmblocks .c{k}{{stroke:var(--c{k})}}" for k in range(len(COLOURS)))
STYLE = (
    ".tsmblocks{"
    + "".join(f"--c{k}:{c};" for k, c in enumerate(COLOURS))
    + "--rule:color-mix(in srgb,currentColor 22%,transparent);--before:#d9661f;--after:#2b7fc4;--between:#8f9fae;"
    "--floor:#1f9a72;--noise:#1f9a7333;--band:#2b7fc433;--ink:currentColor;"
    "--measured:color-mix(in srgb,currentColor 50%,transparent);"
    "max-width:1000px;"
    "font:13px/1.45 system-ui,sans-serif;"
    "color:inherit;background:transparent;overflow-wrap:break-word}"
    ".tsmblocks p{margin:.3em 0;max-width:80ch}.tsmblocks .soft{opacity:.72}"
    ".tsmblocks ul{margin:.3em 0;padding-left:1.4em}"
    ".tsmblocks .scroll{overflow-x:auto}"
    ".tsmblocks table{border-collapse:collapse;margin:.4em 0;color:inherit;font-size:12px;"
    "font-variant-numeric:tabular-nums}"
    ".tsmblocks th,.tsmblocks td{padding:2px 12px 2px 0;text-align:right;border:0;border-bottom:1px solid var(--rule);"
    "background:transparent;vertical-align:top}.tsmblocks th{font-weight:600;opacity:.72}"
    ".tsmblocks th.l,.tsmblocks td.l{text-align:left}.tsmblocks tr.named td{font-weight:650}"
    ".tsmblocks .charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(320px,100%),1fr));gap:4px 16px}"
    ".tsmblocks svg.chart{width:100%;max-width:400px;height:auto;display:block}"
    ".tsmblocks svg.chart text{font:11px system-ui,sans-serif;fill:currentColor}"
    ".tsmblocks svg.chart text.small{font-size:9.5px}.tsmblocks svg.chart text.floor{fill:var(--floor)}"
    ".tsmblocks svg.chart text.strong{font-weight:600}"
    ".tsmblocks path.grid{stroke:var(--rule);stroke-width:.6;fill:none}"
    ".tsmblocks .line{fill:none;stroke-width:1.3;stroke-linejoin:round}"
    ".tsmblocks .line.measured{stroke:var(--measured);stroke-width:3.6}"
    ".tsmblocks .line.floor{stroke:var(--floor);stroke-width:1.6;stroke-dasharray:5 3}"
    ".tsmblocks .fill.before{fill:var(--before)}.tsmblocks .fill.after{fill:var(--after)}"
    ".tsmblocks .fill.between{fill:var(--between)}.tsmblocks .bar{fill:var(--c0)}.tsmblocks .band{fill:#2b7fc433}"
    ".tsmblocks .hollow{fill:none;stroke:currentColor;stroke-width:1}"
    ".tsmblocks .key{display:flex;flex-wrap:wrap;gap:2px 14px;font-size:12px}"
    ".tsmblocks .key span::before{content:'';display:inline-block;width:16px;height:9px;margin-right:5px;"
    "border-radius:2px;background:var(--c);border:1px solid var(--b,var(--c))}"
    ".tsmblocks .verdict{border-left:5px solid var(--after);padding:2px 12px;margin:.5em 0}"
    ".tsmblocks .verdict.unknown{border-color:var(--before)}.tsmblocks .verdict.none{border-color:var(--floor)}"
    ".tsmblocks math{font-size:15px;margin:0;width:fit-content}"
    ".tsmblocks mtd.right{text-align:right}.tsmblocks mtd.left{text-align:left}"
    ".tsmblocks pre{background:transparent;color:inherit;margin:.4em 0;padding:0;white-space:pre-wrap}" + SIGNS
)
"""The style sheet of every card: ink and paper are those of the page, so it is read on light and dark ones."""


def card(title: str, about: str, *parts: str) -> str:
    """A card; title and what it is about are text, the parts are HTML."""
    head = f"<p><b>{escape(title)}</b></p>" if title else ""
    said = f'<p class="soft">{escape(about)}</p>' if about else ""
    return f'<div class="tsmblocks"><style>{STYLE}</style>{head}{said}{"".join(parts)}</div>'


def rows(names: Sequence[str], cells: Sequence[Sequence[str]], kinds: Sequence[str] = (), most: int = MOST_ROWS) -> str:
    """A table of texts; a name that begins with ``l:`` is of a column that is flush left. What is too much is counted.

    ``kinds`` are classes of the rows.
    """
    shown = table(names, [[escape(cell) for cell in row] for row in cells[:most]], kinds[:most])
    return shown + (f'<p class="soft">… ({len(cells)} in all)</p>' if len(cells) > most else "")


def table_of(cells: Sequence[Sequence[str]], left: Collection[int], most: int = MOST_ROWS) -> str:
    """The rows of a printed table, the heading first; columns in which nothing stands are left out."""
    kept = [k for k in range(len(cells[0])) if any(row[k] for row in cells[1:])]
    head = [f"l:{cells[0][k]}" if k in left else cells[0][k] for k in kept]
    return rows(head, [[row[k] for k in kept] for row in cells[1:]], most=most)


def listed(texts: Iterable[str], title: str = "", most: int = MOST_ROWS) -> str:
    """Sentences as a list, nothing where there are none."""
    every = list(texts)
    lines = "".join(f"<li>{escape(text)}</li>" for text in every[:most])
    more = f"<li>… ({len(every)} in all)</li>" if len(every) > most else ""
    head = f"<p><b>{escape(title)}</b></p>" if title else ""
    return f"{head}<ul>{lines}{more}</ul>" if every else ""


def over_time(t: np.ndarray, signals: Mapping[str, tuple[np.ndarray, str]], words: str) -> str:
    """Charts of signals (values, unit) over time in s, one for each unit, angles in degrees."""
    groups: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name, (values, unit) in signals.items():
        k, shown = units.for_people(unit)
        groups.setdefault(shown, []).append((name, k * np.asarray(values, dtype=float)))
    drawn = [_chart(t, lines, unit, words) for unit, lines in list(groups.items())[:MOST_CHARTS]]
    left = len(groups) - len(drawn)
    more = f'<p class="soft">… and signals of {left} more units</p>' if left > 0 else ""
    return f'<div class="charts">{"".join(drawn)}</div>{more}'


def over_time_and_ranges(t: np.ndarray, signals: Mapping[str, tuple[np.ndarray, str]], words: str) -> tuple[str, str]:
    """Charts, and a table of ranges; angles in degrees."""
    cells = []
    for name, (values, unit) in signals.items():
        k, shown = units.for_people(unit)
        y = np.asarray(values, dtype=float)[np.isfinite(values)]
        figures = (y.min(), y.max(), values[-1]) if len(y) else (np.nan,) * 3
        size = float(np.abs(k * y).max(initial=0.0))
        cells.append([name, *(table_number(k * float(v), size) for v in figures), shown])
    return over_time(t, signals, words), rows(["l:signal", "min", "max", "last", "l:unit"], cells)


def _chart(t: np.ndarray, lines: Sequence[tuple[str, np.ndarray]], unit: str, words: str) -> str:
    shown = lines[:MOST_LINES]
    frame = Frame(LEFT, 22, RIGHT, 120, ends(t), charts.spread(*(y for _, y in shown)))
    parts = [charts.axes(frame, "t [s]", heading(shown[0][0] if len(shown) == 1 else "", unit).strip())]
    for k, (_, y) in enumerate(shown):
        parts.append(charts.line(frame, *charts.thinned(t, y, POINTS), f"c{k}"))
    names = [(f"--c{k}", name) for k, (name, _) in enumerate(shown)] if len(shown) > 1 else []
    more = f'<span class="soft">… ({len(lines)} in all)</span>' if len(lines) > len(shown) else ""
    said = f"{', '.join(name for name, _ in shown)} {words}"
    return f"<div>{charts.chart(parts, 152, said)}{key(names) if names else ''}{more}</div>"


def ends(t: np.ndarray) -> tuple[float, float]:
    """First and last instant, apart from each other."""
    first, last = (float(t[0]), float(t[-1])) if len(t) else (0.0, 1.0)
    return first, last if last > first else first + 1.0


def table_number(value: float, size: float = 0.0) -> str:
    """A number of a table; zero where it is nothing beside ``size``."""
    return f"{0.0 if abs(value) < ROUNDED * size else value:.4g}"
