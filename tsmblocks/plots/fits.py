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
from tsmblocks.fitting.compare import Comparison, overall
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.score import Difference, Differences
from tsmblocks.fitting.statistics import autocorrelation
from tsmblocks.plots.panels import COLOURS, INK, INSIDE, LEGEND, PALE, SMALL, axes, dress, head, sheet, shown

MOST = 8
"""Experiments and outputs drawn; more would be too small to read."""
LAGS = 500
"""Samples up to which the autocorrelation is drawn."""
MARKS = "osD^vPX*"
"""Markers of files, beside their colours."""


def plot_fit(fit: Fit | Differences, ax: Any = None) -> Any:
    """Measured and simulated signals over time, the residual, the loop over the input, and the autocorrelation.

    One row per experiment and output, the first ``MOST`` of them; ``ax`` may be four axes for each, row by row.
    """
    differences = fit.differences if isinstance(fit, Fit) else fit
    rows = list(differences)[:MOST]
    figure, panels = sheet(ax, len(rows), 4, width=15.0, height=2.8, widths=(1.5, 1.3, 1.0, 0.8))
    for row, one in zip(panels, rows, strict=True):
        for panel, draw in zip(row, (_history, _residual, _loop, _autocorrelation), strict=True):
            draw(panel, one)
        head(row[0], f"{one.experiment}, {one.output}", weight="bold")
        head(row[1], _residual_title(one))
        head(row[3], "autocorrelation")
    for above, below in zip(panels[:-1].flat, panels[1:].flat, strict=True):
        if above.get_xlabel() == below.get_xlabel():
            above.set_xlabel("")
    if ax is None:
        more = f" (the first {MOST} of {len(differences)})" if len(differences) > MOST else ""
        figure.suptitle(f"{differences.title}{more}", x=0.01, ha="left", fontsize=11)
    _legend(figure, panels[0], own=ax is None)
    return figure


def plot_history(difference: Difference, ax: Any = None) -> Any:
    """What was measured and what was simulated, over time."""
    return _alone(_history, difference, ax)


def plot_residual(difference: Difference, ax: Any = None) -> Any:
    """The residual over time, with the band of twice the measured signal's noise.

    The noise is that of ``tsm.noise``: a residual inside the band cannot be reduced by a better model.
    """
    return _alone(_residual, difference, ax)


def plot_fitted_loop(difference: Difference, ax: Any = None) -> Any:
    """What was measured and simulated over the input; with several inputs or none, one over the other."""
    return _alone(_loop, difference, ax)


def plot_autocorrelation(difference: Difference, ax: Any = None) -> Any:
    """Autocorrelation of the residual over the lag in s; 95 % of the lags of white noise lie in the band."""
    return _alone(_autocorrelation, difference, ax)


def _alone(draw: Any, one: Difference, ax: Any) -> Any:
    (panel,) = axes(ax, 1, height=3.2)
    draw(panel, one)
    if any(panel.get_legend_handles_labels()[1]):
        panel.legend(**LEGEND)
    return panel.figure


def _legend(figure: Any, panels: Any, *, own: bool) -> None:
    """One legend for all panels, each label once; on a figure of the caller one in each panel."""
    named: dict[str, Any] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            named.setdefault(label, handle)
        if not own and any(labels):
            panel.legend(**SMALL)
    if own:
        figure.legend(named.values(), named.keys(), ncols=len(named), loc="outside upper right", **INSIDE)


def _residual_title(one: Difference) -> str:
    d = one.in_degrees()
    return f"residual: rms {d.rms:.3g}, largest {d.largest:.3g} {d.unit}".rstrip()


def _measured_and_simulated(panel: Any, x: np.ndarray, one: Difference, width: float) -> str:
    """Both over ``x``; the label of their axis."""
    measured, unit = shown(one.measured, one.unit)
    panel.plot(x, measured, color=PALE, lw=4.0, label="measured")
    panel.plot(x, shown(one.simulated, one.unit)[0], color=COLOURS[0], lw=width, label="simulated")
    return heading(one.output, unit)


def _history(panel: Any, one: Difference) -> None:
    dress(panel, "t [s]", _measured_and_simulated(panel, one.t, one, 1.1))


def _residual(panel: Any, one: Difference) -> None:
    residual, unit = shown(one.residual, one.unit)
    floor = _floor(one)
    if floor:
        band = 2 * float(shown(np.array([floor]), one.unit)[0][0])
        panel.axhspan(-band, band, color=COLOURS[2], alpha=0.25, lw=0, label="noise (± 2 rms)")
    panel.plot(one.t, residual, color=COLOURS[1], lw=0.8, label="residual")
    panel.axhline(0.0, color=INK, lw=0.6)
    dress(panel, "t [s]", heading("residual", unit))


def _floor(one: Difference) -> float | None:
    """The noise of the measured signal, in its unit; None where it cannot be estimated."""
    signals = {one.output: one.measured, **{name: values for name, (values, _) in one.inputs.items()}}
    try:
        return noise(Record(one.experiment, one.t, signals, {one.output: one.unit}), one.output).floor
    except DataError:
        return None


def _loop(panel: Any, one: Difference) -> None:
    if len(one.inputs) == 1:
        ((name, signal),) = one.inputs.items()
        x, unit = shown(*signal)
        dress(panel, heading(name, unit), _measured_and_simulated(panel, x, one, 0.9))
    else:
        (y, unit), (simulated, _) = (shown(values, one.unit) for values in (one.measured, one.simulated))
        panel.plot(simulated, y, color=COLOURS[0], lw=0.9)
        panel.axline((float(y.mean()), float(y.mean())), slope=1, color=INK, lw=0.6)
        dress(panel, heading(f"{one.output} simulated", unit), heading("measured", unit))


def _autocorrelation(panel: Any, one: Difference) -> None:
    rho, band = autocorrelation(one.residual, LAGS)
    lag = float(np.median(np.diff(one.t))) * np.arange(len(rho))
    panel.axhspan(-band, band, color=PALE, lw=0, label="white noise")
    panel.plot(lag, rho, color=COLOURS[1], lw=1.0, label="residual")
    panel.axhline(0.0, color=INK, lw=0.6)
    panel.set_ylim(-1.05, 1.05)
    dress(panel, "lag [s]")


# ---- models beside each other -------------------------------------------------------------------


def plot_comparison(comparison: Comparison, ax: Any = None) -> Any:
    """The error of every model, best on top, and loop and residual of the best.

    ``ax`` may be three axes.
    """
    figure, panels = sheet(ax, 1, 3, width=15.0, height=4.0, widths=(1.2, 1.0, 1.3))
    errors, loop, residual = panels[0]
    _errors(errors, comparison)
    best = next(iter(comparison.best.held_out or comparison.best.train or []), None)
    if best is not None:
        _loop(loop, best)
        _residual(residual, best)
        part = " (held out)" if comparison.best.held_out else ""
        head(loop, f"{comparison.best.name}: {best.experiment}, {best.output}{part}")
        head(residual, _residual_title(best))
    _legend(figure, panels[0], own=ax is None)
    return figure


def _errors(panel: Any, comparison: Comparison) -> None:
    """A dot for each model, and an open one for its error on fitted data."""
    rows = [(row, row.train) for row in comparison if row.train is not None][::-1]
    k, unit = shown(np.ones(1), comparison.unit)
    errors = k * np.array([row.figure for row, _ in rows])
    label, places = _error_label([comparison]), range(len(rows))
    if label != "rms":
        fitted = k * np.array([train.rms for _, train in rows])
        panel.plot(fitted, places, "D", color=INK, mfc="none", ms=6, label="rms fitted")
    panel.plot(errors, places, "o", color=COLOURS[0], ms=8, label=label)
    texts = [f"{error:.3g}" if np.isfinite(error) else "-" for error in errors]
    panel.set_yticks(places, [f"{row.name}  {text}" for (row, _), text in zip(rows, texts, strict=True)])
    _over_models(panel, unit, label)


def plot_each(comparisons: Mapping[str, Comparison], ax: Any = None) -> Any:
    """The rms error of each model on every file, fitted to each file separately.

    ``comparisons`` has one for each file, by name. Models stand from best to worst over all files, each with a
    mark per file and a line at the root mean square.
    """
    ranked = [(name, rms) for name, rms in overall(comparisons)[::-1] if np.isfinite(rms)]
    (panel,) = axes(ax, 1, height=1.4 + 0.42 * len(ranked))
    (k,), unit = shown(np.ones(1), next(iter(comparisons.values())).unit)
    names = [name for name, _ in ranked]
    for (file, one), colour, mark in zip(comparisons.items(), cycle(COLOURS), cycle(MARKS), strict=False):
        known = {row.name: float(k) * row.figure for row in one if np.isfinite(row.figure)}
        panel.plot(list(known.values()), [names.index(name) for name in known], mark, color=colour, ms=6, label=file)
    for place, (_, rms) in enumerate(ranked):
        panel.plot([k * rms] * 2, [place - 0.35, place + 0.35], color=INK, lw=1.6, label="" if place else "all")
    panel.set_yticks(range(len(names)), [f"{name}  {k * rms:.3g}" for name, rms in ranked])
    _over_models(panel, unit, _error_label(comparisons.values()))
    panel.legend(**LEGEND)
    return panel.figure


def _error_label(comparisons: Iterable[Comparison]) -> str:
    held_out = any(row.held_out is not None for one in comparisons for row in one)
    return "rms held out" if held_out else "rms"


def _over_models(panel: Any, unit: str, label: str) -> None:
    """Errors on the x axis, logarithmic where the largest is ten times the smallest."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    dress(panel, heading(label, unit or "of the spread"))
    drawn = np.concatenate([np.asarray(line.get_xdata(), dtype=float) for line in panel.lines])
    if 0 < 10 * drawn.min() < drawn.max():
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.margins(x=0.06)
    else:
        panel.set_xlim(0.0, 1.06 * drawn.max() or 1.0)
