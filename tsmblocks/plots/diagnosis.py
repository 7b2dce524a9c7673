"""Figures of diagnoses: errors and residuals before and after, in one figure or a panel at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.common.errors import TsmError, near
from tsmblocks.data import heading
from tsmblocks.diagnosis.presentation import by_excess, darkness, gap_rows, output_traces, profile, strips
from tsmblocks.diagnosis.reported_gap import worst_gap
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.segment import Gap, Segment, Trace
from tsmblocks.diagnosis.text import column_titles
from tsmblocks.plots.panels import aligned, axes, dress, entitle, head, in_time, key, scaled, shared_key, sheet
from tsmblocks.plots.style import BEFORE, INK, MEASURED, NOISE, NOISE_BAND, PALE, styled
from tsmblocks.plots.style import MODEL as AFTER

OUTCOMES = {"none": "no unmodelled effect detectable", "unknown": "error not explained"}
"""Verdicts on a segment without effects, in words."""
CELLS = "error by block of time"
"""Label of the strips above a residual: the darker a cell, the larger the error."""
LEAST_BARS = 3
"""Experiments for which there is room at least, so that the bars of one are not as high as the panel."""
BAR_EDGE: dict[str, Any] = {"fill": False, "edgecolor": INK, "lw": 0.6}
"""Arguments of the hollow bar of an error on fitted data."""


@styled
def plot_diagnosis(diagnosis: Diagnosis, ax: Any = None, *, width: float | None = None) -> Any:
    """Errors as bars, residuals of the worst experiment, its loop, and the residual over the best coordinate.

    Four panels for each segment, drawn for its output that is furthest above its noise; ``ax`` may be four axes
    for each, segment by segment. ``width`` [in] is that of a new figure.
    """
    rows = diagnosis.segments
    figure, panels = sheet(ax, len(rows), "AB/CD", width=width, height=2.1)
    for row, segment in zip(panels, rows, strict=True):
        gap = worst_gap(segment)
        trace = _worst(segment, gap)
        _bars(row[0], segment, gap)
        _traces(row[1], trace, gap, segment)
        _loop(row[2], trace, segment)
        _along(row[3], segment, gap)
        head(row[0], f"{segment.name}: {_outcome(segment)}", weight="bold")
        head(row[1], trace.experiment)
        head(row[2], f"{trace.experiment}, {_stretch_text(trace)}")
    shared_key(figure, panels.flat, own=ax is None)
    aligned(figure, panels.flat, own=ax is None)
    if ax is None:
        entitle(figure, diagnosis.diagram)
    return figure


def _outcome(segment: Segment) -> str:
    """What a segment lacks, in a few words."""
    return ", ".join(e.name for e in segment.effects) or OUTCOMES.get(segment.verdict, segment.verdict)


@styled
def plot_gap(diagnosis: Diagnosis, ax: Any = None, *, width: float | None = None) -> Any:
    """Rms error of each experiment on held-out data, before and after; hollow bars: on fitted data; line: noise.

    Of the segment that the verdict is about.
    """
    segment = diagnosis.worst
    (panel,) = axes(ax, 1, height=0.9 + 0.28 * (1 + len(diagnosis.experiments)), width=width)
    _bars(panel, segment, worst_gap(segment))
    key(panel)
    return panel.figure


@styled
def plot_disagreement(diagnosis: Diagnosis, experiment: str = "", ax: Any = None, *, width: float | None = None) -> Any:
    """The residual over time before and after, and blocks of time as a strip: the darker, the larger it is.

    Of the experiment that is worst, or the one named. Raises TsmError for a name that is none.
    """
    segment = diagnosis.worst
    gap = worst_gap(segment)
    (panel,) = axes(ax, 1, height=2.3, width=width)
    trace = _worst(segment, gap, experiment)
    _traces(panel, trace, gap, segment)
    key(panel, over=trace.experiment)
    return panel.figure


@styled
def plot_coordinate(diagnosis: Diagnosis, ax: Any = None, *, width: float | None = None) -> Any:
    """Mean residual in bins of the coordinate that predicts it best, with standard errors, before and after."""
    segment = diagnosis.worst
    (panel,) = axes(ax, 1, height=2.3, width=width)
    _along(panel, segment, worst_gap(segment))
    key(panel)
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
    rows, names, last = gap_rows(segment, gap), column_titles(segment), len(gap.held_out) - 1
    (errors, train, floor), unit = scaled(
        gap.unit, [values for _, values, _ in rows], [train for _, _, train in rows], gap.noise_floor
    )
    looks = _looks(segment)
    labels = [looks[0][0], *names[1:-1], looks[1][0]][: last + 1]
    tall = 0.8 / len(gap.held_out)
    for step, label in enumerate(labels):
        places = np.arange(len(rows)) + step * tall - 0.4 + tall / 2
        colour = looks[0][1] if not step else AFTER if step == last else PALE
        panel.barh(places, errors[:, step], 0.9 * tall, color=colour, label=label)
        if step in (0, last):
            own = train[:, 1 if step else 0]
            panel.barh(places, own, 0.9 * tall, label="" if step else "as fitted", **BAR_EDGE)
    panel.axvline(float(floor), color=NOISE, ls="--", lw=1.2, label="noise")
    panel.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    panel.set_ylim(max(len(rows), LEAST_BARS) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="y", visible=False)
    panel.locator_params(axis="x", nbins=5)
    dress(panel, heading(f"rms of {gap.output} on held-out data", unit))


def _looks(segment: Segment) -> tuple[tuple[str, str], tuple[str, str]]:
    """Label and colour of the base and of the final model: where nothing is missing, the base is the model."""
    return (("model", AFTER) if segment.verdict == "none" else ("before", BEFORE)), ("after", AFTER)


def _traces(panel: Any, trace: Trace, gap: Gap, segment: Segment) -> None:
    before, after = trace.measured - trace.before, trace.measured - trace.after
    changed = not np.array_equal(before, after)
    (before, after, noise), unit = scaled(trace.unit, before, after, 2 * gap.noise_floor)
    t, t_label = in_time(trace.t)
    panel.axhspan(-noise, noise, label="noise (± 2 rms)", **NOISE_BAND)
    looks = _looks(segment)[: 1 + changed]
    for (label, colour), residual in zip(looks, (before, after), strict=False):
        panel.plot(t, residual, color=colour, lw=0.7, label=label)
    reach, k = max(float(np.abs(before).max()), float(noise)), t[-1] / trace.t[-1] if trace.t[-1] else 1.0
    if len(trace.excess):
        panel.fill_between([t[0]] * 2, 1.22 * reach, color=looks[0][1], alpha=0.5, lw=0, label=CELLS)
    for start, stop, *squares in strips(trace):
        for low, square, (_, colour) in zip((1.22 * reach, 1.12 * reach), squares, looks, strict=False):
            across = [k * start, k * stop]
            panel.fill_between(across, low, low + 0.09 * reach, color=colour, alpha=darkness(square), lw=0)
    dress(panel, t_label, heading(f"residual of {trace.output}", unit))


def _loop(panel: Any, trace: Trace, segment: Segment) -> None:
    here = _worst_stretch(trace)
    x, label = in_time(trace.t[here])
    if len(trace.drive):
        (x,), unit_in = scaled(trace.drive_unit, trace.drive[here])
        label = heading(trace.drive_name, unit_in)
    curves, unit = scaled(trace.unit, *(y[here] for y in (trace.measured, trace.before, trace.after)))
    panel.plot(x, curves[0], color=MEASURED, lw=2.5, label="measured")
    changed = not np.array_equal(trace.before, trace.after)
    for (name, colour), y in zip(_looks(segment)[: 1 + changed], curves[1:], strict=False):
        panel.plot(x, y, color=colour, label=name)
    panel.locator_params(axis="x", nbins=5)
    dress(panel, label, heading(trace.output, unit), margin=0.03)


def _worst_stretch(trace: Trace) -> slice:
    """The samples of the block of time that was worst, and of those beside it: all cycles at once cannot be read."""
    rows = trace.excess
    if len(rows) < 3:
        return slice(None)
    worst = int(np.argmax(rows[:, 2]))
    first, last = rows[max(worst - 1, 0), 0], rows[min(worst + 1, len(rows) - 1), 1]
    return slice(int(np.searchsorted(trace.t, first)), int(np.searchsorted(trace.t, last, side="right")))


def _stretch_text(trace: Trace) -> str:
    t = trace.t[_worst_stretch(trace)]
    return f"{t[0]:.3g} to {t[-1]:.3g} s"


def _along(panel: Any, segment: Segment, gap: Gap) -> None:
    curve = profile(segment, gap.output, segment.where[0].coordinate) if segment.where else None
    if curve is None:
        panel.text(0.5, 0.5, "no coordinate predicts the residual", ha="center", color=INK, transform=panel.transAxes)
        panel.set_axis_off()
        return
    values = (curve.before, curve.error_before, curve.explained, curve.after, curve.error_after)
    (before, error_before, explained, after, error_after), unit = scaled(curve.error_unit, *values)
    (x,), unit_in = scaled(curve.unit, curve.x)
    if segment.effects:
        panel.plot(x, explained, color=AFTER, ls="--", label="reported effects")
        panel.errorbar(x, after, error_after, fmt="o", color=AFTER, lw=1, label="after")
    label, colour = _looks(segment)[0]
    panel.errorbar(x, before, error_before, fmt="o", color=colour, lw=1, label=label)
    panel.axhline(0.0, color=INK, lw=0.6)
    dress(panel, heading(curve.coordinate, unit_in), heading("mean residual", unit), margin=0.03)
