"""Figures of studies: a tornado, a Pareto front, a heat map, distributions, scatters, and the envelope of responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, RunError
from tsmblocks.data import heading
from tsmblocks.plots.panels import COLOURS, INK, INSIDE, LEGEND, PALE, axes, dress, head, sheet, shown, timed
from tsmblocks.studies.influence import base_value
from tsmblocks.studies.results import Results

MOST = 12
"""Parameters in a tornado; more would be too small to read."""
BESIDE = 4
"""Numbers over which a metric is shown beside its distribution; ``plot_scatter`` shows any."""
BINS = 10
"""Intervals of a parameter with a median each."""
BANDS = ((0.0, 1.0, "all"), (0.05, 0.95, "5 to 95 %"), (0.25, 0.75, "25 to 75 %"))
"""Shares of the runs that an envelope shows, the palest first."""


def plot_study(results: Results, metrics: Sequence[str] = (), ax: Any = None) -> Any:
    """The usual figure of the plan, a panel for each of the metrics (all by default).

    A heat map of a grid of two numbers, a curve of one number, a tornado of a sweep, else distributions, and beside
    each the metric over every number that varies (the first ``BESIDE``). ``ax`` may be one axes for each metric; a
    distribution then stands alone. Raises RunError for an unknown metric.
    """
    chosen = list(metrics) or list(results.metrics)
    for name in chosen:
        results[name]  # raises for an unknown one
    numbers = _numbers(results)
    alone = len(numbers) == len(results.parameters)
    draw: Callable[..., Any] = plot_distribution
    height = 2.6
    if results.kind == "sweep":
        draw, height = plot_tornado, 0.8 + 0.35 * min(len(numbers), MOST)
    elif results.kind == "grid" and alone and len(numbers) == 2:
        draw, height = plot_heat_map, 4.0
    elif alone and len(numbers) == 1:
        draw = _curve
    elif ax is None:
        return _spread(results, chosen, numbers)
    panels = sheet(ax, len(chosen), 1, width=8.0, height=height)[1][:, 0]
    for panel, name in zip(panels, chosen, strict=True):
        draw(results, name, ax=panel)
    if ax is None:
        head(panels[0], _title(results), 11)
    return panels[0].figure


def _numbers(results: Results) -> list[str]:
    """The parameters that are numbers."""
    return [k for k, v in results.parameters.items() if v.dtype.kind == "f"]


def _spread(results: Results, chosen: Sequence[str], numbers: Sequence[str]) -> Any:
    """A distribution of each metric, and the metric over each number that varies."""
    varied = [name for name in numbers if np.ptp(results[name]) > 0][:BESIDE] if len(results) else []
    widths = [2.0, *(1.0 for _ in varied)]
    figure, rows = sheet(None, len(chosen), len(widths), width=6.0 + 2.2 * len(varied), height=2.6, widths=widths)
    for panels, name in zip(rows, chosen, strict=True):
        plot_distribution(results, name, ax=panels[0])
        if varied:
            plot_scatter(results, name, varied, ax=panels[1:])
    figure.suptitle(_title(results), x=0.01, ha="left", fontsize=11)
    return figure


def plot_tornado(results: Results, metric: str, ax: Any = None) -> Any:
    """How far each parameter moves a metric, the most influential on top; see ``Results.influence``.

    The end at a parameter's low value is pale, that at its high value dark.
    """
    influences = list(results.influence(metric).items())[:MOST]
    (panel,) = axes(ax, 1, height=0.8 + 0.35 * len(influences))
    factor, unit = _display_unit(results, metric)
    middle = factor * base_value(results, metric)
    for k, (name, ends) in enumerate(reversed(influences)):
        for end, colour, up in zip(ends, (COLOURS[5], COLOURS[0]), (0.18, -0.18), strict=True):
            panel.barh(k + up, factor * end - middle, left=middle, height=0.36, color=colour)
        panel.annotate(f"{name} ", (0, k), xycoords=("axes fraction", "data"), ha="right", va="center", fontsize=9)
    panel.axvline(middle, color=INK, lw=0.8)
    panel.set_yticks([])
    dress(panel, f"{heading(metric, unit)}: pale at a parameter's low end, dark at its high end", margin=0.05)
    panel.grid(axis="y", visible=False)
    return panel.figure


def plot_scatter(results: Results, metric: str, parameters: Sequence[str] = (), ax: Any = None) -> Any:
    """A metric over each of some parameters (all numbers unless named), a point per run: one axes for each.

    The line is the median of the metric in each of ``BINS`` intervals with equally many runs: where it is flat, the
    parameter does nothing to the metric. Raises RunError for an unknown name.
    """
    names = list(parameters) or _numbers(results)
    y, unit = _shown(results, metric)
    xs = [results[name] for name in names]
    kept = np.flatnonzero(np.isfinite(y))
    panels = sheet(ax, 1, len(names), width=2.2 * len(names) + 1.5, height=2.8)[1][0]
    for panel, name, x in zip(panels, names, xs, strict=True):
        panel.scatter(x[kept], y[kept], s=6, color=COLOURS[5], alpha=0.7, lw=0)
        bins = [k for k in np.array_split(kept[np.argsort(x[kept])], BINS) if len(k) > 1]
        panel.plot([np.median(x[k]) for k in bins], [np.median(y[k]) for k in bins], color=INK, lw=1.4)
        dress(panel, name, margin=0.05)
        if panel is not panels[0]:
            panel.tick_params(labelleft=False)
            panel.set_ylim(panels[0].get_ylim())
    panels[0].set_ylabel(heading(metric, unit))
    return panels[0].figure


def plot_pareto(results: Results, x: str, y: str, ax: Any = None) -> Any:
    """Two metrics against each other, and the runs that no other beats in both. Raises RunError for an unknown one."""
    (panel,) = axes(ax, 1, height=4.0, width=5.5)
    front = results.pareto(x, y)
    (across, x_unit), (up, y_unit) = (_shown(results, name) for name in (x, y))
    panel.scatter(across, up, s=8, color="#9a9a9a", alpha=0.6, lw=0, label="runs")
    panel.plot(across[front], up[front], "o-", color=COLOURS[1], ms=4, lw=1.2, label="no run beats these")
    dress(panel, heading(x, x_unit), heading(y, y_unit), legend=INSIDE)
    return panel.figure


def plot_heat_map(results: Results, metric: str, x: str | None = None, y: str | None = None, ax: Any = None) -> Any:
    """A metric over a grid of two parameters, the first two unless named, at the smallest values of all others.

    The cross marks the smallest value. Raises RunError where the plan is no grid of numbers.
    """
    names = _numbers(results)
    if results.kind != "grid" or len(names) < 2:
        raise RunError("a heat map needs a grid of two numbers at least.")
    x = x or next(k for k in names if k != y)
    y = y or next(k for k in names if k != x)
    others = [k for k in results.parameters if k not in (x, y)]
    held = np.all([np.full(len(results), True), *(results[k] == results[k][0] for k in others)], axis=0)
    across, up = np.unique(results[x][held]), np.unique(results[y][held])
    values, unit = _shown(results, metric)
    z = np.full((len(up), len(across)), np.nan)
    z[np.searchsorted(up, results[y][held]), np.searchsorted(across, results[x][held])] = values[held]
    z = np.where(np.isfinite(z), z, np.nan)
    (panel,) = axes(ax, 1, height=4.0, width=6.0)
    panel.set_facecolor(PALE)
    image = panel.pcolormesh(across, up, z, cmap="viridis", shading="nearest", rasterized=True)
    panel.figure.colorbar(image, ax=panel, label=heading(metric, unit))
    if np.isfinite(z).any():
        k = np.unravel_index(np.nanargmin(z), z.shape)
        panel.plot(across[k[1]], up[k[0]], "x", color="white", ms=9, mew=2)
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    return panel.figure


def plot_distribution(results: Results, metric: str, ax: Any = None) -> Any:
    """The distribution of a metric over the runs, with median and 5 and 95 % quantiles."""
    (panel,) = axes(ax, 1, height=2.6)
    values, unit = _shown(results, metric)
    values = values[np.isfinite(values)]
    if len(values):
        panel.hist(values, bins=min(60, max(8, int(np.sqrt(len(values))))), color=COLOURS[5], alpha=0.8)
    factor, quantiles = _display_unit(results, metric)[0], results.quantiles(metric)
    low, middle, high = (factor * quantiles[name] for name in ("5 %", "median", "95 %"))
    panel.axvline(middle, color=INK, lw=1.4)
    for end in (low, high):
        panel.axvline(end, color=INK, lw=0.8, ls="--")
    dress(panel, f"{heading(metric, unit)}: median {middle:.4g}, 5 to 95 % {low:.4g} to {high:.4g}", "runs")
    return panel.figure


def plot_envelope(responses: Any, signal: str, ax: Any = None, *, reference: str | None = None) -> Any:
    """Range, 5 to 95 %, 25 to 75 % and median of a signal over the runs of ``studies.responses``.

    ``reference`` is another signal of them, drawn once. Raises RunError for an unknown signal.
    """
    (panel,) = axes(ax, 1, height=3.2)
    y, unit = shown(responses[signal], responses.unit(signal))
    y = y[np.isfinite(y).all(axis=1)]
    if not len(y):
        raise DataError(f"no run has a finite '{signal}' all along.")
    for k, (low, high, label) in enumerate(BANDS):
        between = np.quantile(y, [low, high], axis=0)
        panel.fill_between(responses.t, *between, color=COLOURS[0], alpha=0.15 + 0.12 * k, lw=0, label=label)
    panel.plot(responses.t, np.median(y, axis=0), color=COLOURS[0], lw=1.4, label="median")
    if reference is not None:
        wanted = shown(responses[reference], responses.unit(reference))[0][0]
        panel.plot(responses.t, wanted, color=INK, lw=1.0, ls="--", label=reference)
    dress(panel, ylabel=heading(signal, unit), legend=LEGEND)
    timed([panel], f"{responses.title}: {len(y)} runs" if ax is None else "")
    return panel.figure


def _curve(results: Results, metric: str, ax: Any) -> Any:
    (name,) = _numbers(results)
    order = np.argsort(results[name])
    values, unit = _shown(results, metric)
    ax.plot(results[name][order], values[order], "o-", color=COLOURS[0], ms=3, lw=1.2)
    dress(ax, name, heading(metric, unit))


def _title(results: Results) -> str:
    return f"{results.title}: {results.kind} of {len(results)} runs"


def _display_unit(results: Results, name: str) -> tuple[float, str]:
    """Factor and unit in which a metric is displayed: angles in degrees; parameters as they are."""
    return units.display_unit(results.units.get(name, ""))


def _shown(results: Results, name: str) -> tuple[np.ndarray, str]:
    return shown(results[name], results.units.get(name, ""))
