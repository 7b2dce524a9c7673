"""The figures of a report: errors as bars, measured and simulated signals, residuals over time and a coordinate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from tsmblocks.data import heading
from tsmblocks.diagnosis.presentation import Profile, darkness, digits, display_unit, gap_rows, strips
from tsmblocks.diagnosis.segment import Gap, Segment, Trace
from tsmblocks.diagnosis.text import column_titles
from tsmblocks.draw.picture import fitted, text_width
from tsmblocks.html import charts
from tsmblocks.html.charts import LEFT, RIGHT, TEXT, Frame, ends

BAR, PITCH, SPACE = 8, 12, 6
"""Height of a bar, distance of bars, in which a number fits, and more space between experiments [pixels]."""
KINDS = ("measured", "before", "after")
"""Classes of lines, which give their colours."""
QUIET = ("measured", "after")
"""The same where nothing is missing: the model as it is has the colour of one that is right."""
OF_BARS = (("ink", "the same model on the data it was fitted to", "hollow"), ("floor", "noise floor", "dash"))
"""What else the colours of bars mean, beside those of the models."""
OF_LINES = (("measured", "measured", "line"), ("noise", "noise, ± 2 rms", "fill"))
"""What else the colours of signals and residuals mean."""
CORNERS = 4
"""Corners of a loop for each point that a line over time has."""


# ---- errors ---------------------------------------------------------------------------------------


def gap_bars(segment: Segment, gap: Gap) -> Markup:
    """Rms error of each experiment on held-out data before and after each effect; hollow bars: on fitted data."""
    k, unit = display_unit(gap.unit)
    rows, count = gap_rows(segment, gap), len(gap.held_out)
    names = min(max(text_width(name, TEXT) for name, _, _ in rows) + 8, 112)
    tall = count * PITCH + SPACE
    top, bottom = 24.0, 24.0 + tall * len(rows)
    largest = max(max(*values, *train) for _, values, train in rows)
    frame = Frame(names, top, RIGHT - 40, bottom, (0.0, k * max(largest, gap.noise_floor) * 1.02), (0.0, 1.0))
    parts = [charts.x_axis(frame, heading(f"rms of {gap.output}", unit))]
    for place, (name, values, train) in enumerate(rows):
        y, kind = top + tall * place + SPACE / 2, "" if place else "strong"
        parts.append(charts.text(names - 6, y + count * PITCH / 2 + 4, fitted(name, TEXT, names - 8), "end", kind))
        parts += _bars(frame, y, k, values, train, quiet=segment.verdict == "none")
    x = frame.across(k * gap.noise_floor)
    parts.append(charts.rule(x, top - 4, x, bottom, "line floor"))
    label = f"noise {digits(k * gap.noise_floor)}"
    parts.append(charts.text(max(x, text_width(label, TEXT) / 2), top - 9, label, "middle", "floor"))
    parts.sort(key=lambda one: one.startswith("<text"))  # numbers above the line of the noise
    words = f"rms error of {gap.output} on held-out data, {' then '.join(column_titles(segment))}"
    return charts.chart(parts, bottom + 34, words)


def _bars(
    frame: Frame, y: float, k: float, values: tuple[float, ...], train: tuple[float, float], *, quiet: bool
) -> list[str]:
    """The bars of one experiment: base first, a hollow one where the same model was fitted."""
    parts, last = [], len(values) - 1
    for step, value in enumerate(values):
        top, end = y + step * PITCH + (PITCH - BAR) / 2, frame.across(k * value)
        kind = "before" if not (step or quiet) else "after" if step == last else "between"
        parts.append(charts.box(frame.left, top, end - frame.left, BAR, f"fill {kind}"))
        edge = end
        if step in (0, last):
            edge = frame.across(k * train[1 if step else 0])
            parts.append(charts.box(frame.left, top + 0.5, edge - frame.left, BAR - 1, "hollow"))
        parts.append(charts.text(max(end, edge) + 4, top + BAR, digits(k * value), kind="small"))
    return parts


# ---- one experiment ------------------------------------------------------------------------------


def signals_chart(trace: Trace, count: int, *, loop: bool = False, quiet: bool = False) -> Markup:
    """The measured signal and those of the base and the final model, over time or as a loop over the input.

    ``count`` is that of the points of a line over time; ``quiet`` that nothing is missing.
    """
    k, unit = display_unit(trace.unit)
    x, x_label, limits = _abscissa(trace, loop=loop)
    kinds = QUIET if quiet else KINDS
    signals = [k * y for y in (trace.measured, *_models(trace))]
    frame = Frame(LEFT, 22, RIGHT, 150, limits, charts.spread(*signals))
    parts = [charts.axes(frame, x_label, heading(trace.output, unit))]
    parts += [_line(frame, x, y, count, kind, loop=loop) for kind, y in zip(kinds, signals, strict=False)]
    words = f"{trace.output} of {trace.experiment} over time, measured and simulated"
    return charts.chart(parts, 184, f"{trace.output} over {trace.drive_name} in {trace.experiment}" if loop else words)


def residual_chart(trace: Trace, noise: float, count: int, *, loop: bool = False, quiet: bool = False) -> Markup:
    """The residual before and after, the noise as a band, over time or as a loop over the input.

    Over time the excess of each block of time is drawn above it; a loop over the input is one that the model lacks.
    """
    k, unit = display_unit(trace.unit)
    x, x_label, limits = _abscissa(trace, loop=loop)
    kinds = QUIET[1:] if quiet else KINDS[1:]
    residuals = [k * (trace.measured - y) for y in _models(trace)]
    frame = Frame(LEFT, 22 if loop else 46, RIGHT, 150, limits, charts.spread(*residuals, zero=True))
    parts = [charts.axes(frame, x_label, ""), charts.band(frame, -2 * k * noise, 2 * k * noise, "noise")]
    parts.append(charts.text(2, 12, heading(f"residual of {trace.output}", unit)))
    for kind, y in zip(kinds, residuals, strict=False):
        parts.append(_line(frame, x, y, count, f"{kind} thin", loop=loop))
    if loop:
        return charts.chart(parts, 184, f"residual of {trace.output} over {trace.drive_name} in {trace.experiment}")
    parts += _strip(trace, frame, kinds)
    return charts.chart(parts, 184, f"residual of {trace.output} in {trace.experiment} over time")


def _abscissa(trace: Trace, *, loop: bool) -> tuple[np.ndarray, str, tuple[float, float]]:
    """Values along x, their label, and the ends of the axis."""
    if not loop:
        return trace.t, "t [s]", ends(trace.t)
    k, unit = display_unit(trace.drive_unit)
    return k * trace.drive, heading(trace.drive_name, unit), charts.spread(k * trace.drive)


def _line(frame: Frame, x: np.ndarray, y: np.ndarray, count: int, kind: str, *, loop: bool) -> str:
    corners = charts.traced(frame, x, y, CORNERS * count) if loop else charts.thinned(x, y, count)
    return charts.line(frame, *corners, kind)


def _strip(trace: Trace, frame: Frame, kinds: Sequence[str]) -> list[str]:
    """A row of blocks before, and one after if an effect is reported: the darker, the further above the noise."""
    parts, rows = [], list(zip((20, 31), kinds, _models(trace), strict=False))
    for start, stop, *squares in strips(trace):
        x, end = np.clip(frame.across(np.array([start, stop])), frame.left, frame.right)
        for (y, kind, _), square in zip(rows, squares, strict=False):
            opacity = f' fill-opacity="{darkness(square):.2f}"'
            parts.append(charts.box(x, y, end - x - 0.5, 9, f"fill {kind}", opacity))
            parts.append(charts.box(x, y, end - x - 0.5, 9, "cell"))
    for y, kind, _ in rows:
        parts.append(charts.text(LEFT - 4, y + 8, kind if len(rows) > 1 else "model", "end", "small"))
    return parts


def _models(trace: Trace) -> list[np.ndarray]:
    """The output of the base model, and that of the final model where it is another."""
    return [trace.before] if np.array_equal(trace.before, trace.after) else [trace.before, trace.after]


# ---- along a coordinate --------------------------------------------------------------------------


def residual_over_coordinate(curve: Profile, *, explained: bool, quiet: bool = False) -> Markup:
    """Mean residual in bins of a coordinate with standard errors, before and after, and the effects' contribution."""
    k, unit = display_unit(curve.error_unit)
    k_in, unit_in = display_unit(curve.unit)
    x, before, after = k_in * curve.x, k * curve.before, k * curve.after
    wide = [before, before - k * curve.error_before, before + k * curve.error_before]
    frame = Frame(LEFT, 22, RIGHT, 170, charts.spread(x), charts.spread(*wide, after, zero=True))
    parts = [charts.axes(frame, heading(curve.coordinate, unit_in), heading("mean residual", unit))]
    zero = frame.up(0.0)
    parts.append(charts.rule(LEFT, zero, RIGHT, zero, "zero"))
    if explained:
        parts.append(charts.line(frame, x, k * curve.explained, "explained"))
    parts.append(charts.points(frame, x, before, k * curve.error_before, "after" if quiet else "before"))
    if explained:
        parts.append(charts.points(frame, x, after, k * curve.error_after, "after"))
    return charts.chart(parts, 204, f"mean residual over {curve.coordinate}")
