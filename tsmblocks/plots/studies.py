"""Figures of studies: a tornado, a Pareto front, a heat map, distributions, scatters, and the envelope of responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tsmblocks.common.displayed_units import axis_unit
from tsmblocks.common.errors import DataError, RunError
from tsmblocks.data import heading
from tsmblocks.plots.panels import axes, dress, entitle, in_time, key, log_spaced, scale_as, scaled, sheet
from tsmblocks.plots.style import INK, MODEL, NARROW, PALE, RULE, styled, width_of
from tsmblocks.studies.influence import base_value
from tsmblocks.studies.results import Results

MOST = 12
"""Parameters in a tornado; more would be too small to read."""
BESIDE = 4
"""Numbers over which a metric is shown beside its distribution; ``plot_scatter`` shows any."""
BINS = 10
"""Intervals of a parameter with a median each."""
LOW, HIGH = "parameter at its low value", "at its high value"
BANDS = ((0.0, 1.0, "all"), (0.05, 0.95, "5 to 95 %"), (0.25, 0.75, "25 to 75 %"))
"""Shares of the runs that an envelope shows, the palest first."""


@styled
def plot_study(results: Results, metrics: Sequence[str] = (), ax: Any = None, *, width: float | None = None) -> Any:
    """The usual figure of the plan, a panel for each of the metrics (all by default).

    A heat map of a grid of two numbers, a curve of one number, a tornado of a sweep, else distributions, and beside
    each the metric over every number that varies (the first ``BESIDE``). ``ax`` may be one axes for each metric; a
    distribution then stands alone. ``width`` [in] is that of a new figure. Raises RunError for an unknown metric.
    """
    chosen = list(metrics) or list(results.metrics)
    for name in chosen:
        results[name]  # raises for an unknown one
    numbers = _numbers(results)
    alone = len(numbers) == len(results.parameters)
    draw: Callable[..., Any] = plot_distribution
    height = 2.0
    if results.kind == "sweep":
        draw, height = plot_tornado, _tornado_height(len(numbers))
    elif results.kind == "grid" and alone and len(numbers) == 2:
        draw, height = plot_heat_map, 2.6
    elif alone and len(numbers) == 1:
        draw = _curve
    elif ax is None:
        return _spread(results, chosen, numbers, width)
    panels = sheet(ax, len(chosen), "A", width=width, height=height)[1][:, 0]
    for panel, name in zip(panels, chosen, strict=True):
        draw(results, name, ax=panel)
    if ax is None:
        entitle(panels[0].figure, _title(results))
    return panels[0].figure


def _numbers(results: Results) -> list[str]:
    """The parameters that are numbers."""
    return [k for k, v in results.parameters.items() if v.dtype.kind == "f"]


def _spread(results: Results, chosen: Sequence[str], numbers: Sequence[str], width: float | None) -> Any:
    """A distribution of each metric, and the metric over each number that varies."""
    varied = [name for name in numbers if np.ptp(results[name]) > 0][:BESIDE] if len(results) else []
    letters = "ABCDE"[: 1 + len(varied)]
    layout = letters if len(varied) <= BESIDE // 2 else f"{'A' * len(varied)}/{letters[1:]}"
    figure, rows = sheet(None, len(chosen), layout, width=width, height=1.7)
    for panels, name in zip(rows, chosen, strict=True):
        plot_distribution(results, name, ax=panels[0])
        if varied:
            plot_scatter(results, name, varied, ax=panels[1:])
    entitle(figure, _title(results))
    return figure


def _tornado_height(count: int) -> float:
    return 0.8 + 0.24 * min(count, MOST)


@styled
def plot_tornado(results: Results, metric: str, ax: Any = None, *, width: float | None = None) -> Any:
    """How far each parameter moves a metric, the most influential on top; see ``Results.influence``.

    The end at a parameter's low value is pale, that at its high value dark.
    """
    influences = list(results.influence(metric).items())[:MOST]
    (panel,) = axes(ax, 1, height=_tornado_height(len(influences)), width=width)
    ends = np.array([both for _, both in influences], dtype=float).reshape(-1, 2)
    (ends, middle), unit = _scaled(results, metric, ends, base_value(results, metric))
    places = np.arange(len(influences))[::-1]
    for side, colour, up, label in ((0, PALE, 0.18, LOW), (1, MODEL, -0.18, HIGH)):
        panel.barh(places + up, ends[:, side] - middle, left=middle, height=0.36, color=colour, label=label)
    panel.axvline(float(middle), color=INK, lw=0.8)
    panel.set_yticks(places, [name for name, _ in influences])
    panel.set_ylim(-0.6, len(influences) - 0.4)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="y", visible=False)
    dress(panel, heading(metric, unit), margin=0.05)
    key(panel)
    return panel.figure


@styled
def plot_scatter(
    results: Results, metric: str, parameters: Sequence[str] = (), ax: Any = None, *, width: float | None = None
) -> Any:
    """A metric over each of some parameters (all numbers unless named), a point per run: one axes for each.

    The line is the median of the metric in each of ``BINS`` intervals with equally many runs: where it is flat, the
    parameter does nothing to the metric. Raises RunError for an unknown name.
    """
    names = list(parameters) or _numbers(results)
    (y,), unit = _scaled(results, metric, results[metric])
    xs = [results[name] for name in names]
    kept = np.flatnonzero(np.isfinite(y))
    layout = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[: len(names)]
    if ax is None and len(names) > BESIDE:
        layout = "/".join(layout[k : k + BESIDE].ljust(BESIDE, layout[-1]) for k in range(0, len(names), BESIDE))
    panels = sheet(ax, 1, layout, width=width, height=1.9)[1][0]
    for panel, name, x in zip(panels, names, xs, strict=True):
        panel.scatter(x[kept], y[kept], s=5, color=PALE, alpha=0.8, lw=0)
        bins = [k for k in np.array_split(kept[np.argsort(x[kept])], BINS) if len(k) > 1]
        panel.plot([np.median(x[k]) for k in bins], [np.median(y[k]) for k in bins], color=MODEL, lw=1.4)
        dress(panel, name, margin=0.05)
        scale_as(panel, x)
        if panel is not panels[0]:
            panel.set_ylim(panels[0].get_ylim())
    panels[0].set_ylabel(heading(metric, unit))
    return panels[0].figure


@styled
def plot_pareto(results: Results, x: str, y: str, ax: Any = None, *, width: float | None = None) -> Any:
    """Two metrics against each other, and the runs that no other beats in both. Raises RunError for an unknown one."""
    wide = min(width_of(width), NARROW)
    front = results.pareto(x, y)
    (panel,) = axes(ax, 1, height=0.72 * wide, width=wide)
    ((across,), x_unit), ((up,), y_unit) = (_scaled(results, name, results[name]) for name in (x, y))
    panel.scatter(across, up, s=6, color=PALE, alpha=0.8, lw=0, label="runs")
    panel.plot(across[front], up[front], "o-", color=MODEL, ms=3.5, label="no run beats these")
    dress(panel, heading(x, x_unit), heading(y, y_unit), margin=0.04)
    key(panel)
    return panel.figure


@styled
def plot_heat_map(
    results: Results,
    metric: str,
    x: str | None = None,
    y: str | None = None,
    ax: Any = None,
    *,
    width: float | None = None,
) -> Any:
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
    (values,), unit = _scaled(results, metric, results[metric])
    z = np.full((len(up), len(across)), np.nan)
    z[np.searchsorted(up, results[y][held]), np.searchsorted(across, results[x][held])] = values[held]
    z = np.where(np.isfinite(z), z, np.nan)
    (panel,) = axes(ax, 1, height=3.0, width=min(width_of(width), NARROW))
    _map(panel, across, up, z, heading(metric, unit))
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    return panel.figure


def _map(panel: Any, across: np.ndarray, up: np.ndarray, z: np.ndarray, label: str) -> None:
    """Draw a map with a cell around each value, and mark the smallest."""
    panel.set_facecolor(RULE)
    panel.grid(visible=False)
    image = panel.pcolormesh(_edges(across), _edges(up), z, cmap="viridis", shading="flat", rasterized=True)
    bar = panel.figure.colorbar(image, ax=panel, label=label)
    bar.outline.set_linewidth(0.6)
    if np.isfinite(z).any():
        k = np.unravel_index(np.nanargmin(z), z.shape)
        for colour, wide in ((INK, 3.5), ("white", 1.8)):
            panel.plot(across[k[1]], up[k[0]], "x", color=colour, ms=7, mew=wide)
    scale_as(panel, across, "x")
    scale_as(panel, up, "y")
    panel.spines[["top", "right"]].set_visible(True)


def _edges(values: np.ndarray) -> np.ndarray:
    """Edges of the cells around values, halfway to the next, in the logarithm where the axis is."""
    if len(values) == 1:
        return values[0] + np.array([-0.5, 0.5]) * (abs(values[0]) or 1.0)
    v = np.log(values) if log_spaced(values) else values
    half = np.diff(v) / 2
    edges = np.concatenate([[v[0] - half[0]], v[:-1] + half, [v[-1] + half[-1]]])
    return np.exp(edges) if v is not values else edges


@styled
def plot_distribution(results: Results, metric: str, ax: Any = None, *, width: float | None = None) -> Any:
    """The distribution of a metric over the runs, with median and 5 and 95 % quantiles."""
    (panel,) = axes(ax, 1, height=2.0, width=width)
    quantiles = results.quantiles(metric)
    ends = [quantiles[name] for name in ("5 %", "median", "95 %")]
    (values, (low, middle, high)), unit = _scaled(results, metric, results[metric], ends)
    values = values[np.isfinite(values)]
    if len(values):
        panel.hist(values, bins=min(60, max(8, int(np.sqrt(len(values))))), color=PALE)
    panel.axvline(middle, color=INK, lw=1.4, label=f"median {middle:.4g}")
    panel.axvline(low, color=INK, lw=0.8, ls="--", label=f"5 to 95 %: {low:.4g} to {high:.4g}")
    panel.axvline(high, color=INK, lw=0.8, ls="--")
    dress(panel, heading(metric, unit), "runs")
    key(panel)
    return panel.figure


@styled
def plot_envelope(
    responses: Any, signal: str, ax: Any = None, *, reference: str | None = None, width: float | None = None
) -> Any:
    """Range, 5 to 95 %, 25 to 75 % and median of a signal over the runs of ``studies.responses``.

    ``reference`` is another signal of them, drawn once. Raises RunError for an unknown signal.
    """
    (panel,) = axes(ax, 1, height=2.4, width=width)
    y = responses[signal]
    y = y[np.isfinite(y).all(axis=1)]
    if not len(y):
        raise DataError(f"no run has a finite '{signal}' all along.")
    (y,), unit = scaled(responses.unit(signal), y)
    t, t_label = in_time(responses.t)
    for k, (low, high, label) in enumerate(BANDS):
        between = np.quantile(y, [low, high], axis=0)
        panel.fill_between(t, *between, color=MODEL, alpha=0.15 + 0.12 * k, lw=0, label=label)
    panel.plot(t, np.median(y, axis=0), color=MODEL, lw=1.2, label="median")
    if reference is not None:
        factor, wanted = axis_unit(responses.unit(reference), float(np.abs(responses[reference][0]).max()))
        label = reference if wanted == unit else heading(reference, wanted)
        panel.plot(t, factor * responses[reference][0], color=INK, ls="--", label=label)
    dress(panel, t_label, heading(signal, unit))
    key(panel)
    if ax is None:
        entitle(panel.figure, f"{responses.title}: {len(y)} runs")
    return panel.figure


def _curve(results: Results, metric: str, ax: Any) -> Any:
    (name,) = _numbers(results)
    order = np.argsort(results[name])
    (values,), unit = _scaled(results, metric, results[metric])
    ax.plot(results[name][order], values[order], "o-", color=MODEL)
    dress(ax, name, heading(metric, unit), margin=0.03)
    scale_as(ax, results[name])


def _title(results: Results) -> str:
    return f"{results.title}: {results.kind} of {len(results)} runs"


def _scaled(results: Results, name: str, *values: Any) -> tuple[list[np.ndarray], str]:
    """Values of a metric as an axis shows them: angles in degrees; parameters as they are."""
    return scaled(results.units.get(name, ""), *values)
