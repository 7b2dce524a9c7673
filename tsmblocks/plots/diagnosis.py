"""Figures of diagnoses: errors and residuals before and after, in one figure or a panel at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.common.errors import TsmError, near
from tsmblocks.data import heading
from tsmblocks.diagnosis.presentation import by_excess, darkness, display_unit, gap_rows, output_traces, profile, strips
from tsmblocks.diagnosis.result import Diagnosis, Gap, Segment, Trace
from tsmblocks.diagnosis.text import column_titles
from tsmblocks.diagnosis.verdict_text import worst_gap
from tsmblocks.plots.panels import COLOURS, INK, PALE, SMALL, axes, dress, head, sheet

BEFORE, AFTER, NOISE = COLOURS[1], COLOURS[0], COLOURS[2]
BELOW: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.16), **SMALL}
"""Place of a legend below a panel."""


def plot_diagnosis(diagnosis: Diagnosis, ax: Any = None) -> Any:
    """Errors as bars, residuals of the worst experiment, its loop, and the residual over the best coordinate.

    A row of panels for each segment, drawn for its output that is furthest above its noise; ``ax`` may be four axes
    for each, row by row.
    """
    rows = diagnosis.segments
    figure, panels = sheet(ax, len(rows), 4, width=16.0, height=3.6, widths=(1.2, 1.6, 1.0, 1.1))
    for row, segment in zip(panels, rows, strict=True):
        gap = worst_gap(segment)
        trace = _worst(segment, gap)
        _bars(row[0], segment, gap)
        _traces(row[1], trace, gap)
        _loop(row[2], trace, diagnosis)
        _along(row[3], segment, gap, diagnosis)
        head(row[0], f"{segment.name}: {segment.verdict}", weight="bold")
        head(row[1], trace.experiment)
    names = ", ".join(e.name for e in diagnosis.effects)
    if ax is None:
        figure.suptitle(f"{diagnosis.diagram}: {names or diagnosis.verdict}", x=0.01, ha="left", fontsize=11)
    return figure


def plot_gap(diagnosis: Diagnosis, ax: Any = None) -> Any:
    """Rms error of each experiment on validation data, before and after; hollow bars: on fitted data; line: noise.

    Of the segment that the verdict is about.
    """
    segment = diagnosis.worst
    (panel,) = axes(ax, 1, height=1.2 + 0.4 * (1 + len(diagnosis.experiments)))
    _bars(panel, segment, worst_gap(segment))
    return panel.figure


def plot_disagreement(diagnosis: Diagnosis, experiment: str = "", ax: Any = None) -> Any:
    """The residual over time before and after, and blocks of time as a strip: the darker, the larger it is.

    Of the experiment that is worst, or the one named. Raises TsmError for a name that is none.
    """
    segment = diagnosis.worst
    gap = worst_gap(segment)
    (panel,) = axes(ax, 1, height=3.2)
    _traces(panel, _worst(segment, gap, experiment), gap)
    return panel.figure


def plot_coordinate(diagnosis: Diagnosis, ax: Any = None) -> Any:
    """Mean residual in bins of the coordinate that predicts it best, with standard errors, before and after."""
    segment = diagnosis.worst
    (panel,) = axes(ax, 1, height=3.2)
    _along(panel, segment, worst_gap(segment), diagnosis)
    return panel.figure


def _worst(segment: Segment, gap: Gap, experiment: str = "") -> Trace:
    traces = by_excess(output_traces(segment, gap.output))
    if not experiment:
        return traces[0]
    matching = [one for one in traces if one.experiment == experiment]
    if not matching:
        hint = near(experiment, [one.experiment for one in traces])
        raise TsmError(f"there is no experiment '{experiment}' in this diagnosis.{hint}")
    return matching[0]


def _bars(panel: Any, segment: Segment, gap: Gap) -> None:
    k, unit = display_unit(gap.unit)
    rows, names, last = gap_rows(segment, gap), column_titles(segment), len(gap.held_out) - 1
    tall = 0.8 / len(gap.held_out)
    for step, name in enumerate(names):
        places = np.arange(len(rows)) + step * tall - 0.4 + tall / 2
        errors = [k * values[step] for _, values, _ in rows]
        pale = 0.5 if 0 < step < last else 1.0
        panel.barh(places, errors, 0.9 * tall, color=AFTER if step else BEFORE, alpha=pale, label=name)
        if step in (0, last):
            own = [k * train[1 if step else 0] for _, _, train in rows]
            panel.barh(places, own, 0.9 * tall, fill=False, edgecolor=INK, lw=0.8, label="" if step else "as fitted")
    panel.axvline(k * gap.noise_floor, color=NOISE, ls="--", lw=1.2, label="noise")
    panel.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    panel.invert_yaxis()
    panel.locator_params(axis="x", nbins=4)
    dress(panel, heading(f"rms of {gap.output} on validation data", unit), legend={**BELOW, "ncols": 2})


def _traces(panel: Any, trace: Trace, gap: Gap) -> None:
    k, unit = display_unit(trace.unit)
    noise = 2 * k * gap.noise_floor
    panel.axhspan(-noise, noise, color=NOISE, alpha=0.25, lw=0, label="noise (± 2 rms)")
    before, after = k * (trace.measured - trace.before), k * (trace.measured - trace.after)
    panel.plot(trace.t, before, color=BEFORE, lw=0.8, label="before")
    if not np.array_equal(before, after):
        panel.plot(trace.t, after, color=AFTER, lw=0.8, label="after")
    reach = max(float(np.abs(before).max()), noise)
    for start, stop, *squares in strips(trace):
        for low, square, colour in zip((1.22 * reach, 1.12 * reach), squares, (BEFORE, AFTER), strict=True):
            panel.fill_between([start, stop], low, low + 0.09 * reach, color=colour, alpha=darkness(square), lw=0)
    dress(panel, "t [s]", heading(f"residual of {trace.output}", unit), legend={**BELOW, "ncols": 3})


def _loop(panel: Any, trace: Trace, diagnosis: Diagnosis) -> None:
    k, unit = display_unit(trace.unit)
    x, label = trace.t, "t [s]"
    if len(trace.drive):
        k_in, unit_in = display_unit(diagnosis.base.unit(trace.drive_name))
        x, label = k_in * trace.drive, heading(trace.drive_name, unit_in)
    here = _worst_stretch(trace)
    for name, y, colour, width in (
        ("measured", trace.measured, PALE, 4.0),
        ("before", trace.before, BEFORE, 1.0),
        ("after", trace.after, AFTER, 1.0),
    ):
        panel.plot(x[here], k * y[here], color=colour, lw=width, label=name)
    head(panel, f"{trace.t[here][0]:.3g} s to {trace.t[here][-1]:.3g} s")
    panel.locator_params(axis="x", nbins=5)
    dress(panel, label, heading(trace.output, unit), legend=SMALL)


def _worst_stretch(trace: Trace) -> slice:
    """The samples of the block of time that was worst, and of those beside it: all cycles at once cannot be read."""
    rows = trace.excess
    if len(rows) < 3:
        return slice(None)
    worst = int(np.argmax(rows[:, 2]))
    first, last = rows[max(worst - 1, 0), 0], rows[min(worst + 1, len(rows) - 1), 1]
    return slice(int(np.searchsorted(trace.t, first)), int(np.searchsorted(trace.t, last, side="right")))


def _along(panel: Any, segment: Segment, gap: Gap, diagnosis: Diagnosis) -> None:
    curve = profile(segment, gap.output, segment.where[0].coordinate, diagnosis.base) if segment.where else None
    if curve is None:
        panel.text(0.5, 0.5, "no coordinate predicts the residual", ha="center", color=INK, transform=panel.transAxes)
        panel.set_axis_off()
        return
    k, unit = display_unit(curve.error_unit)
    k_in, unit_in = display_unit(curve.unit)
    x = k_in * curve.x
    if segment.effects:
        panel.plot(x, k * curve.explained, color=AFTER, ls="--", lw=1.2, label="reported effects")
        panel.errorbar(x, k * curve.after, k * curve.error_after, fmt="o", ms=3, color=AFTER, lw=1, label="after")
    panel.errorbar(x, k * curve.before, k * curve.error_before, fmt="o", ms=3, color=BEFORE, lw=1, label="before")
    panel.axhline(0.0, color=INK, lw=0.6)
    dress(panel, heading(curve.coordinate, unit_in), heading("mean residual", unit), legend=SMALL)
