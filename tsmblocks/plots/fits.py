"""Figures of fits: measured and simulated signals, residuals and their autocorrelation, models compared.

A whole fit is one figure; each of its four panels can also be drawn alone:

    plot_residual(fit.differences["bend 60"], ax)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import cycle
from typing import Any

import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data import Record, heading, noise
from tsmblocks.fitting.comparison import Comparison, overall
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.score import Difference, Differences
from tsmblocks.fitting.statistics import autocorrelation
from tsmblocks.plots.panels import aligned, axes, decimal, dress, entitle, head, in_time, key, scaled, shared_key, sheet
from tsmblocks.plots.style import (
    INK,
    MEASURED,
    MODEL,
    NARROW,
    NOISE_BAND,
    RESIDUAL,
    WHITE_BAND,
    series,
    styled,
    width_of,
)

MOST = 8
"""Experiments and outputs drawn; more would be too small to read."""
SPACIOUS = 2
"""Experiments and outputs of which each has two lines of panels; of more, one."""
LAGS = 500
"""Samples up to which the autocorrelation is drawn."""
BAND_SHARE = 0.4
"""Share of the height of an autocorrelation that the band of white noise takes at most. Chosen: both are seen."""
MARKS = "osD^vPX*"
"""Markers of files, beside their colours."""


@styled
def plot_fit(fit: Fit | Differences, ax: Any = None, *, width: float | None = None) -> Any:
    """Measured and simulated signals over time, the residual, the loop over the input, and the autocorrelation.

    Four panels for each experiment and output, the first ``MOST`` of them; ``ax`` may be four axes for each.
    ``width`` [in] is that of a new figure.
    """
    differences = fit.differences if isinstance(fit, Fit) else fit
    rows = list(differences)[:MOST]
    layout, widths = ("AC/BD", (1.7, 1.0)) if len(rows) <= SPACIOUS else ("ABCD", (1.5, 1.4, 1.0, 0.9))
    height = 2.0 if len(rows) <= SPACIOUS else 1.6
    figure, panels = sheet(ax, len(rows), layout, height=height, width=width, widths=widths)
    for row, one in zip(panels, rows, strict=True):
        for panel, draw in zip(row, (_history, _residual, _loop, _autocorrelation), strict=True):
            draw(panel, one)
        head(row[0], f"{one.experiment}, {one.output}", weight="bold")
        title = _residual_title(one)  # without the name, which the axis has, where panels are narrow
        head(row[1], title if len(rows) <= SPACIOUS else title.removeprefix("residual: "))
    if len(rows) > SPACIOUS and figure.get_figwidth() >= NARROW:
        _name_once(panels)
    if ax is None:
        more = f" (the first {MOST} of {len(differences)})" if len(differences) > MOST else ""
        entitle(figure, f"{differences.title}{more}")
    shared_key(figure, panels[0], own=ax is None)
    aligned(figure, panels.flat, own=ax is None)
    return figure


def _name_once(panels: np.ndarray) -> None:
    """Leave out the name of an axis that the panel below has too."""
    for above, below in zip(panels[:-1].flat, panels[1:].flat, strict=True):
        if above.get_xlabel() == below.get_xlabel():
            above.set_xlabel("")


@styled
def plot_history(difference: Difference, ax: Any = None, *, width: float | None = None) -> Any:
    """What was measured and what was simulated, over time."""
    return _alone(_history, difference, ax, width)


@styled
def plot_residual(difference: Difference, ax: Any = None, *, width: float | None = None) -> Any:
    """The residual over time, with the band of twice the measured signal's noise.

    The noise is that of ``tsm.noise``: a residual inside the band cannot be reduced by a better model.
    """
    return _alone(_residual, difference, ax, width)


@styled
def plot_fitted_loop(difference: Difference, ax: Any = None, *, width: float | None = None) -> Any:
    """What was measured and simulated over the input; with several inputs or none, one over the other."""
    return _alone(_loop, difference, ax, min(width_of(width), NARROW), 0.7 * min(width_of(width), NARROW))


@styled
def plot_autocorrelation(difference: Difference, ax: Any = None, *, width: float | None = None) -> Any:
    """Autocorrelation of the residual over the lag in s; 95 % of the lags of white noise lie in the band."""
    return _alone(_autocorrelation, difference, ax, width)


def _alone(draw: Any, one: Difference, ax: Any, width: float | None, height: float = 2.3) -> Any:
    (panel,) = axes(ax, 1, height=height, width=width)
    draw(panel, one)
    key(panel)
    return panel.figure


def _residual_title(one: Difference) -> str:
    (rms, largest), unit = scaled(one.unit, one.rms, one.largest)
    return f"residual: rms {rms:.3g}, largest {largest:.3g} {unit}".rstrip()


def _measured_and_simulated(panel: Any, x: np.ndarray, one: Difference) -> str:
    """Both over ``x``; the label of their axis."""
    (measured, simulated), unit = scaled(one.unit, one.measured, one.simulated)
    panel.plot(x, measured, color=MEASURED, lw=2.5, label="measured")
    panel.plot(x, simulated, color=MODEL, label="simulated")
    return heading(one.output, unit)


def _history(panel: Any, one: Difference) -> None:
    t, label = in_time(one.t)
    dress(panel, label, _measured_and_simulated(panel, t, one))


def _residual(panel: Any, one: Difference) -> None:
    floor = _floor(one)
    (residual, band), unit = scaled(one.unit, one.residual, 2 * (floor or 0.0))
    t, label = in_time(one.t)
    if floor:
        panel.axhspan(-band, band, label="noise (± 2 rms)", **NOISE_BAND)
    panel.plot(t, residual, color=RESIDUAL, lw=0.7, label="residual")
    panel.axhline(0.0, color=INK, lw=0.6)
    dress(panel, label, heading("residual", unit))


def _floor(one: Difference) -> float | None:
    """The noise of the measured signal, in its unit; None where it cannot be estimated."""
    signals = {one.output: one.measured, **{name: values for name, (values, _) in one.inputs.items()}}
    try:
        return noise(Record(one.experiment, one.t, signals, {one.output: one.unit}), one.output).floor
    except DataError:
        return None


def _loop(panel: Any, one: Difference) -> None:
    if len(one.inputs) == 1:
        ((name, (signal, signal_unit)),) = one.inputs.items()
        (x,), unit = scaled(signal_unit, signal)
        dress(panel, heading(name, unit), _measured_and_simulated(panel, x, one), margin=0.03)
    else:
        (y, simulated), unit = scaled(one.unit, one.measured, one.simulated)
        panel.plot(simulated, y, color=MODEL)
        panel.axline((float(y.mean()), float(y.mean())), slope=1, color=INK, lw=0.6)
        dress(panel, heading(f"{one.output} simulated", unit), heading("measured", unit), margin=0.03)


def _autocorrelation(panel: Any, one: Difference) -> None:
    rho, band = autocorrelation(one.residual, LAGS)
    lag, unit = scaled("s", float(np.median(np.diff(one.t))) * np.arange(len(rho)))
    panel.axhspan(-band, band, label="95 % band, white noise", **WHITE_BAND)
    panel.plot(lag[0], rho, color=RESIDUAL, lw=0.7, label="residual")
    panel.axhline(0.0, color=INK, lw=0.6)
    largest = float(np.nanmax(np.abs(rho[1:]), initial=0.0))  # without lag 0: it is 1
    reach = min(max(1.1 * largest, band / BAND_SHARE), 1.05)
    panel.set_ylim(-reach, reach)
    dress(panel, heading("lag", unit), "autocorrelation")


# ---- models beside each other -------------------------------------------------------------------


@styled
def plot_comparison(comparison: Comparison, ax: Any = None, *, width: float | None = None) -> Any:
    """The error of every model, best on top, and loop and residual of the best.

    ``ax`` may be three axes; ``width`` [in] is that of a new figure.
    """
    height = max(1.7, 0.5 + 0.11 * len(comparison))
    figure, panels = sheet(ax, 1, "AA/BC", height=height, width=width, widths=(1.0, 1.4))
    errors, loop, residual = panels[0]
    _errors(errors, comparison)
    best = next(iter(comparison.best.held_out or comparison.best.train or []), None)
    if best is not None:
        _loop(loop, best)
        _residual(residual, best)
        part = " (held out)" if comparison.best.held_out else ""
        head(loop, f"{comparison.best.name}: {best.experiment}, {best.output}{part}")
        head(residual, _residual_title(best))
    shared_key(figure, panels[0], own=ax is None)
    aligned(figure, panels.flat, own=ax is None)
    return figure


def _errors(panel: Any, comparison: Comparison) -> None:
    """A dot for each model, and an open one for its error on fitted data."""
    rows = [(row, row.train) for row in comparison if row.train is not None][::-1]
    errors = np.array([row.figure for row, _ in rows])
    fitted = np.array([train.rms for _, train in rows])
    (errors, fitted), unit = scaled(comparison.unit, errors, fitted)
    label, places = _error_label([comparison]), range(len(rows))
    panel.plot(errors, places, "o", color=MODEL, ms=5, label=label)
    if label != "rms":
        panel.plot(fitted, places, "D", color=INK, mfc="none", ms=4, mew=0.7, label="rms in-sample")
    texts = [f"{error:.3g}" if np.isfinite(error) else "-" for error in errors]
    panel.set_yticks(places, [f"{row.name}  {text}" for (row, _), text in zip(rows, texts, strict=True)])
    panel.set_ylim(-0.6, len(rows) - 0.4)
    _over_models(panel, unit, label)


@styled
def plot_each(comparisons: Mapping[str, Comparison], ax: Any = None, *, width: float | None = None) -> Any:
    """The rms error of each model on every file, fitted to each file separately.

    ``comparisons`` has one for each file, by name. Models stand from best to worst over all files, each with a
    mark per file and a line at the root mean square.
    """
    ranked = [(name, rms) for name, rms in overall(comparisons)[::-1] if np.isfinite(rms)]
    (panel,) = axes(ax, 1, height=1.0 + 0.24 * len(ranked), width=width)
    (sizes,), unit = scaled(next(iter(comparisons.values())).unit, [rms for _, rms in ranked])
    k = float(sizes[-1] / ranked[-1][1]) if ranked and ranked[-1][1] else 1.0
    names = [name for name, _ in ranked]
    for (file, one), colour, mark in zip(comparisons.items(), cycle(series()), cycle(MARKS), strict=False):
        known = {row.name: k * row.figure for row in one if np.isfinite(row.figure)}
        panel.plot(list(known.values()), [names.index(name) for name in known], mark, color=colour, ms=4, label=file)
    for place, rms in enumerate(sizes):
        panel.plot([rms] * 2, [place - 0.35, place + 0.35], color=INK, lw=1.4, label="" if place else "all")
    panel.set_yticks(range(len(names)), [f"{name}  {rms:.3g}" for name, rms in zip(names, sizes, strict=True)])
    panel.set_ylim(-0.6, len(names) - 0.4)
    _over_models(panel, unit, _error_label(comparisons.values()))
    key(panel)
    return panel.figure


def _error_label(comparisons: Iterable[Comparison]) -> str:
    held_out = any(row.held_out is not None for one in comparisons for row in one)
    return "rms held-out" if held_out else "rms"


def _over_models(panel: Any, unit: str, label: str) -> None:
    """Errors on the x axis, logarithmic where the largest is ten times the smallest."""
    dress(panel, heading(label, unit or "of the spread"))
    drawn = np.concatenate([np.asarray(line.get_xdata(), dtype=float) for line in panel.lines])
    drawn = drawn[np.isfinite(drawn)]
    if not len(drawn):
        return
    if 0 < 10 * drawn.min() < drawn.max():
        panel.set_xscale("log")
        panel.margins(x=0.06)
        decimal(panel.xaxis)
    else:
        panel.set_xlim(0.0, 1.06 * drawn.max() or 1.0)
