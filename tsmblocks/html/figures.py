"""The figures of a report: errors as bars, measured and simulated signals, residuals over time and a coordinate."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from tsmblocks.data import heading
from tsmblocks.diagnosis.presentation import Profile, digits, display_unit, fitted_rms, output_traces, strips
from tsmblocks.diagnosis.result import Gap, Segment, Trace
from tsmblocks.diagnosis.text import column_titles
from tsmblocks.html import charts
from tsmblocks.html.charts import LEFT, RIGHT, Frame, ends
from tsmblocks.model.diagram import Diagram

BAR, SPACE = 9, 9
"""Height of a bar, and space between the bars of experiments."""
DARKEST = 4.0
"""Excess, in variances of the noise, at which a strip is as dark as it gets."""
KINDS = ("measured", "before", "after")
"""Classes of lines, which give their colours."""
CORNERS = 4
"""Corners of a loop for each point that a line over time has."""


# ---- errors ---------------------------------------------------------------------------------------


def gap_bars(segment: Segment, gap: Gap) -> Markup:
    """Rms error of each experiment on validation data before and after each effect; hollow bars: on fitted data."""
    k, unit = display_unit(gap.unit)
    fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
    rows = [("all", gap.held_out, (gap.train[0], gap.train[-1]))]
    if len(gap.experiments) > 1:
        rows += [(name, values, fitted[name]) for name, values in gap.experiments.items()]
    count = len(gap.held_out)
    names = min(max(charts.width_of(name) for name, _, _ in rows) + 8, 112)
    tall = count * BAR + SPACE
    top, bottom = 24.0, 24.0 + tall * len(rows)
    largest = max(max(*values, *train) for _, values, train in rows)
    frame = Frame(names, top, RIGHT - 40, bottom, (0.0, k * max(largest, gap.noise_floor) * 1.02), (0.0, 1.0))
    parts = [_grid(frame, heading(f"rms of {gap.output}", unit))]
    for place, (name, values, train) in enumerate(rows):
        y = top + tall * place + SPACE / 2
        parts.append(
            charts.text(
                names - 6, y + count * BAR / 2 + 4, charts.cut(name, names - 8), "end", "strong" if not place else ""
            )
        )
        parts += _bars(frame, y, k, values, train)
    x = float(frame.across(np.array(k * gap.noise_floor)))
    parts.append(charts.rule(x, top - 4, x, bottom, "line floor"))
    parts.append(charts.text(x, top - 9, f"noise {digits(k * gap.noise_floor)}", "middle", "floor"))
    words = f"rms error of {gap.output} on validation data, {' then '.join(column_titles(segment))}"
    return charts.chart(parts, bottom + 34, words)


def _bars(frame: Frame, y: float, k: float, values: tuple[float, ...], train: tuple[float, float]) -> list[str]:
    """The bars of one experiment: base first, a hollow one where the same model was fitted."""
    parts, count = [], len(values)
    for step, value in enumerate(values):
        end = float(frame.across(np.array(k * value)))
        kind = step_class(step, count)
        parts.append(charts.box(frame.left, y + step * BAR, end - frame.left, BAR - 1.5, f"fill {kind}"))
        own = train[0] if step == 0 else train[1] if step == count - 1 else None
        edge = end
        if own is not None:
            edge = float(frame.across(np.array(k * own)))
            parts.append(charts.box(frame.left, y + step * BAR + 0.5, edge - frame.left, BAR - 2.5, "hollow"))
        parts.append(charts.text(max(end, edge) + 4, y + step * BAR + BAR - 1.5, digits(k * value), kind="small"))
    return parts


def step_class(step: int, count: int) -> str:
    """The colour of a model: the base, the last one, or one between."""
    return "before" if step == 0 else "after" if step == count - 1 else "between"


def _grid(frame: Frame, label: str) -> str:
    parts = []
    for value in charts.ticks(*frame.x):
        x = float(frame.across(np.array(value)))
        parts.append(charts.rule(x, frame.top, x, frame.bottom, "grid"))
        parts.append(charts.text(x, frame.bottom + 14, charts.tick_label(value), "middle"))
    parts.append(charts.text(frame.right, frame.bottom + 28, label, "end"))
    return "".join(parts)


# ---- one experiment ------------------------------------------------------------------------------


def signals_over_time(trace: Trace, count: int) -> Markup:
    """The measured signal and those of the base and the final model, over time."""
    k, unit = display_unit(trace.unit)
    signals = [k * trace.measured, *(k * y for y in _models(trace))]
    frame = Frame(LEFT, 22, RIGHT, 150, ends(trace.t), charts.spread(*signals))
    parts = [charts.axes(frame, "t [s]", heading(trace.output, unit))]
    for kind, y in zip(KINDS, signals, strict=False):
        parts.append(charts.line(frame, *charts.thinned(trace.t, y, count), kind))
    return charts.chart(parts, 184, f"{trace.output} of {trace.experiment} over time, measured and simulated")


def residual_over_time(trace: Trace, noise: float, count: int) -> Markup:
    """The residual over time before and after, the noise as a band, and the excess of each block as a strip."""
    k, unit = display_unit(trace.unit)
    residuals = [k * (trace.measured - y) for y in _models(trace)]
    frame = Frame(LEFT, 46, RIGHT, 150, ends(trace.t), charts.spread(*residuals, zero=True))
    parts = [charts.axes(frame, "t [s]", ""), charts.band(frame, -2 * k * noise, 2 * k * noise, "noise")]
    parts.append(charts.text(2, 12, heading(f"residual of {trace.output}", unit)))
    for kind, y in zip(KINDS[1:], residuals, strict=False):
        parts.append(charts.line(frame, *charts.thinned(trace.t, y, count), f"{kind} thin"))
    parts += _strip(trace, frame)
    return charts.chart(parts, 184, f"residual of {trace.output} in {trace.experiment} over time")


def _strip(trace: Trace, frame: Frame) -> list[str]:
    """A row of blocks before, and one after if an effect is reported: the darker, the further above the noise."""
    parts, rows = [], list(zip((20, 31), KINDS[1:], _models(trace), strict=False))
    for start, stop, *squares in strips(trace):
        x, end = (float(v) for v in np.clip(frame.across(np.array([start, stop])), frame.left, frame.right))
        for (y, kind, _), square in zip(rows, squares, strict=False):
            dark = min(max((square - 1) / (DARKEST - 1), 0.0), 1.0)
            parts.append(charts.box(x, y, end - x - 0.5, 9, f"fill {kind}", f' fill-opacity="{dark:.2f}"'))
            parts.append(charts.box(x, y, end - x - 0.5, 9, "cell"))
    for y, kind, _ in rows:
        parts.append(charts.text(LEFT - 4, y + 8, kind, "end", "small"))
    return parts


def output_over_input(trace: Trace, diagram: Diagram, count: int) -> Markup:
    """The output over the input, measured and simulated."""
    k, unit = display_unit(trace.unit)
    k_in, unit_in = display_unit(diagram.unit(trace.drive_name))
    x, signals = k_in * trace.drive, [k * trace.measured, *(k * y for y in _models(trace))]
    frame = Frame(LEFT, 22, RIGHT, 150, charts.spread(x), charts.spread(*signals))
    parts = [charts.axes(frame, heading(trace.drive_name, unit_in), heading(trace.output, unit))]
    for kind, y in zip(KINDS, signals, strict=False):
        parts.append(charts.line(frame, *charts.traced(frame, x, y, CORNERS * count), kind))
    return charts.chart(parts, 184, f"{trace.output} over {trace.drive_name} in {trace.experiment}")


def residual_over_input(trace: Trace, diagram: Diagram, noise: float, count: int) -> Markup:
    """The residual over the input, before and after: a loop here is a loop that the model lacks."""
    k, unit = display_unit(trace.unit)
    k_in, unit_in = display_unit(diagram.unit(trace.drive_name))
    x, residuals = k_in * trace.drive, [k * (trace.measured - y) for y in _models(trace)]
    frame = Frame(LEFT, 22, RIGHT, 150, charts.spread(x), charts.spread(*residuals, zero=True))
    parts = [
        charts.axes(frame, heading(trace.drive_name, unit_in), ""),
        charts.band(frame, -2 * k * noise, 2 * k * noise, "noise"),
        charts.text(2, 12, heading(f"residual of {trace.output}", unit)),
    ]
    parts += [
        charts.line(frame, *charts.traced(frame, x, y, CORNERS * count), f"{kind} thin")
        for kind, y in zip(KINDS[1:], residuals, strict=False)
    ]
    return charts.chart(parts, 184, f"residual of {trace.output} over {trace.drive_name} in {trace.experiment}")


def _models(trace: Trace) -> list[np.ndarray]:
    """The output of the base model, and that of the final model where it is another."""
    return [trace.before] if np.array_equal(trace.before, trace.after) else [trace.before, trace.after]


# ---- along a coordinate --------------------------------------------------------------------------


def residual_over_coordinate(curve: Profile, *, explained: bool) -> Markup:
    """Mean residual in bins of a coordinate with standard errors, before and after, and the effects' contribution."""
    k, unit = display_unit(curve.error_unit)
    k_in, unit_in = display_unit(curve.unit)
    x, before, after = k_in * curve.x, k * curve.before, k * curve.after
    wide = [before, before - k * curve.error_before, before + k * curve.error_before]
    frame = Frame(LEFT, 22, RIGHT, 170, charts.spread(x), charts.spread(*wide, after, zero=True))
    parts = [charts.axes(frame, heading(curve.coordinate, unit_in), heading("mean residual", unit))]
    zero = float(frame.up(np.array(0.0)))
    parts.append(charts.rule(LEFT, zero, RIGHT, zero, "zero"))
    if explained:
        parts.append(charts.line(frame, x, k * curve.explained, "explained"))
    parts.append(charts.points(frame, x, before, k * curve.error_before, "before"))
    if explained:
        parts.append(charts.points(frame, x, after, k * curve.error_after, "after"))
    return charts.chart(parts, 204, f"mean residual over {curve.coordinate}")
