"""Cards of studies and tuning results: what metrics range over, and what was found."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.tables import few
from tsmblocks.data import heading
from tsmblocks.html import charts
from tsmblocks.html.card import LEFT, MOST_CHARTS, RIGHT, card, listed, number, rows
from tsmblocks.html.charts import Frame
from tsmblocks.metrics.metrics import named
from tsmblocks.studies.results import QUANTILES, Results
from tsmblocks.tuning.result import Tuned

BARS = 24
"""Bars of a distribution."""


def study_card(found: Results) -> str:
    """The results of a study: quantiles of each metric, the run where it is lowest, how it is spread."""
    done = f"{len(found)} of {found.count} runs" if len(found) < found.count else f"{found.count} runs"
    cells = []
    for name in found.metrics:
        k, unit = units.for_people(found.units[name])
        best = found.best(name) if np.isfinite(found[name]).any() else {}
        where = ", ".join(f"{one} {_value(best[one])}" for one in found.parameters if one in best)
        cells.append([heading(name, unit), *(number(k * v) for v in found.quantiles(name).values()), where])
    failed = int(found.failed.sum())
    said = [f"{failed} runs have a metric that is no number (an unstable loop, say)."] if failed else []
    drawn = [_spread(found, name) for name in list(found.metrics)[:MOST_CHARTS]]
    return card(
        f"{found.title}: {found.kind}, {done}",
        f"over {few(found.parameters)}",
        rows(["l:metric", *QUANTILES, "l:lowest at"], cells),
        f'<div class="charts">{"".join(drawn)}</div>',
        listed(said),
    )


def tuned_card(found: Tuned) -> str:
    """What tuning found: the parameters, and each metric in each case before and after."""
    at = found.at_bounds
    values = rows(
        ["l:parameter", "before", "tuned", "from", "to", "l:"],
        [
            (
                name,
                *map(number, (found.own[name], v, *found.bounds[name])),
                f"at its {at[name]} bound" if name in at else "",
            )
            for name, v in found.values.items()
        ],
    )
    people = {name: units.for_people(unit) for name, unit in found.units.items()}
    cells = [
        (case, found.title(name), number(k * found.before[case][name]), number(k * after[name]))
        for case, after in found.after.items()
        for name, (k, _) in people.items()
    ]
    k, unit = people[found.objective]
    worst = f"{named(found.objective)[0]} in the worst case: {_ends([k * v for v in found.worst], unit)}"
    return card(
        "Tuned", worst, values, rows(["l:case", "l:metric", "before", "tuned"], cells), listed(list(found.remarks))
    )


def _ends(values: list[float], unit: str) -> str:
    before, after = values
    return f"{number(before)} before, {number(after)} {unit} tuned"


def _spread(found: Results, name: str) -> str:
    """How often a metric takes which values, as bars."""
    k, unit = units.for_people(found.units[name])
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
    return charts.chart([charts.axes(frame, heading(name, unit), "runs"), *bars], 132, f"how {name} is spread")


def _value(value: Any) -> str:
    return number(value) if isinstance(value, float) else str(value)
