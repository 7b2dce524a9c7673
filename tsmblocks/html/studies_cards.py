"""Cards of studies: the range of each metric, and responses of many runs over time."""

from __future__ import annotations

import functools
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from tsmblocks.common import displayed_units
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
def study_card(results: Results) -> str:
    """The results of a study: quantiles of each metric, the run where it is lowest, its distribution."""
    done = f"{len(results)} of {results.count} runs" if len(results) < results.count else f"{results.count} runs"
    cells = []
    for name in results.metrics:
        k, unit = displayed_units.display_unit(results.units[name])
        best = results.best(name) if np.isfinite(results[name]).any() else {}
        where = ", ".join(f"{one} {_value(best[one])}" for one in results.parameters if one in best)
        cells.append([heading(name, unit), *(table_number(k * v) for v in results.quantiles(name).values()), where])
    failed = int(results.failed.sum())
    notes = [f"{failed} runs have a metric that is not a number (an unstable loop, say)."] if failed else []
    drawn = [_spread(results, name) for name in list(results.metrics)[:MOST_CHARTS]]
    return card(
        f"{results.title}: {results.kind}, {done}",
        f"over {few(results.parameters)}",
        rows(["l:metric", *QUANTILES, "l:lowest at"], cells, "Quantiles of each metric over all runs"),
        part("charts", drawn),
        listed(notes),
    )


@view.register
def responses_card(responses: Responses) -> str:
    """Responses of many runs: median and quantiles of each signal over time."""
    count = len(next(iter(responses.signals.values()), ()))
    drawn = [_envelope(responses, name) for name in list(responses.signals)[:MOST_ROWS]]
    bands = part("key", [("c0", "median"), ("band", "5 to 95 %, and 25 to 75 %")])
    return card(
        f"{responses.title}: responses of {count} runs", f"{len(responses.t)} instants", part("charts", drawn), bands
    )


def _spread(results: Results, name: str) -> str:
    """The distribution of a metric, as bars."""
    k, unit = displayed_units.display_unit(results.units[name])
    values = k * results[name][np.isfinite(results[name])]
    if len(values) < 2:
        return ""
    counts, edges = np.histogram(values, bins=min(BARS, max(4, int(np.sqrt(len(values))))))
    frame = Frame(LEFT, 22, RIGHT, 100, (float(edges[0]), float(edges[-1])), (0.0, float(counts.max()) * 1.05))
    sides = pairwise(frame.across(edges))
    bars = [
        charts.box(x, y, end - x - 1, frame.bottom - y, "bar")
        for (x, end), y in zip(sides, frame.up(counts), strict=True)
    ]
    return charts.chart([charts.axes(frame, heading(name, unit), "runs"), *bars], 132, f"distribution of {name}")


def _value(value: Any) -> str:
    return table_number(value) if isinstance(value, float) else str(value)


def _envelope(responses: Responses, name: str) -> str:
    """Bands and median of one signal over time."""
    k, unit = displayed_units.display_unit(responses.unit(name))
    t, *every = charts.sampled(INSTANTS, responses.t, *(k * responses[name]))
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
