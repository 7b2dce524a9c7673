"""Cards of studies: the range of each metric, and responses of many runs over time."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from markupsafe import Markup

from tsmblocks.common import units
from tsmblocks.common.tables import few
from tsmblocks.common.views import no_view
from tsmblocks.data import heading
from tsmblocks.html import charts
from tsmblocks.html.card import MOST_CHARTS, MOST_ROWS, card, listed, rows, table_number
from tsmblocks.html.charts import LEFT, RIGHT, Frame, ends
from tsmblocks.html.pages import part
from tsmblocks.studies.responses import Responses
from tsmblocks.studies.results import QUANTILES, Results

view = functools.singledispatch(no_view)
BARS = 24
"""Bars of a distribution."""
BANDS = ((0.05, 0.95), (0.25, 0.75))
"""Shares of the runs in the bands of an envelope."""
INSTANTS = 200
"""Instants at which an envelope is drawn."""


@view.register
def study_card(found: Results) -> str:
    """The results of a study: quantiles of each metric, the run where it is lowest, its distribution."""
    done = f"{len(found)} of {found.count} runs" if len(found) < found.count else f"{found.count} runs"
    cells = []
    for name in found.metrics:
        k, unit = units.display_unit(found.units[name])
        best = found.best(name) if np.isfinite(found[name]).any() else {}
        where = ", ".join(f"{one} {_value(best[one])}" for one in found.parameters if one in best)
        cells.append([heading(name, unit), *(table_number(k * v) for v in found.quantiles(name).values()), where])
    failed = int(found.failed.sum())
    said = [f"{failed} runs have a metric that is not a number (an unstable loop, say)."] if failed else []
    drawn = [_spread(found, name) for name in list(found.metrics)[:MOST_CHARTS]]
    return card(
        f"{found.title}: {found.kind}, {done}",
        f"over {few(found.parameters)}",
        rows(["l:metric", *QUANTILES, "l:lowest at"], cells),
        part("charts", drawn),
        listed(said),
    )


@view.register
def responses_card(found: Responses) -> str:
    """Responses of many runs: median and quantiles of each signal over time."""
    count = len(next(iter(found.signals.values()), ()))
    drawn = [_envelope(found, name) for name in list(found.signals)[:MOST_ROWS]]
    bands = part("key", [("c0", "median"), ("band", "5 to 95 %, and 25 to 75 %")])
    return card(f"{found.title}: responses of {count} runs", f"{len(found.t)} instants", part("charts", drawn), bands)


def _spread(found: Results, name: str) -> str:
    """The distribution of a metric, as bars."""
    k, unit = units.display_unit(found.units[name])
    values = k * found[name][np.isfinite(found[name])]
    if len(values) < 2:
        return ""
    counts, edges = np.histogram(values, bins=min(BARS, max(4, int(np.sqrt(len(values))))))
    frame = Frame(LEFT, 22, RIGHT, 100, (float(edges[0]), float(edges[-1])), (0.0, float(counts.max()) * 1.05))
    across = frame.across(edges)
    up = frame.up(counts)
    bars = [
        charts.box(x, y, end - x - 1, frame.bottom - y, "bar")
        for x, end, y in zip(across, across[1:], up, strict=False)
    ]
    return charts.chart([charts.axes(frame, heading(name, unit), "runs"), *bars], 132, f"distribution of {name}")


def _value(value: Any) -> str:
    return table_number(value) if isinstance(value, float) else str(value)


def _envelope(found: Responses, name: str) -> str:
    """Bands and median of one signal over time."""
    k, unit = units.display_unit(found.unit(name))
    t, *every = charts.sampled(INSTANTS, found.t, *(k * found[name]))
    y = np.array(every)
    y = y[np.isfinite(y).all(axis=1)]
    if not len(y):
        return Markup("<p>{}: no run is finite all along.</p>").format(name)
    frame = Frame(LEFT, 22, RIGHT, 120, ends(t), charts.spread(y))
    parts = [charts.axes(frame, "t [s]", heading(name, unit))]
    for shares in BANDS:
        low, high = np.quantile(y, shares, axis=0)
        parts.append(charts.area(frame, t, low, high, "band"))
    parts.append(charts.line(frame, t, np.median(y, axis=0), "c0"))
    return part("chart", charts.chart(parts, 152, f"{name} of {len(y)} runs over time"), (), "")
