"""How much a metric depends on each parameter: the bars of a tornado plot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.errors import RunError

if TYPE_CHECKING:
    from tsmblocks.studies.results import Results

END_QUANTILES = (0.05, 0.95)
"""Quantiles of a parameter between which a regression is evaluated. Chosen: the ends of a 90 % interval."""


def influence(results: Results, metric: str) -> dict[str, tuple[float, float]]:
    """As ``Results.influence``."""
    names = [k for k, v in results.parameters.items() if v.dtype.kind == "f"]
    finite = np.isfinite(results[metric])
    if not names or finite.sum() < len(names) + 2:
        raise RunError(
            f"'{metric}' is finite in {finite.sum()} runs; the influences of its parameters take {len(names) + 2} "
            "at least."
        )
    X, y = np.column_stack([results[name][finite] for name in names]), results[metric][finite]
    if results.kind == "sweep":
        ends = _sweep_ends(X, y, np.array([results.own[name] for name in names]))
    else:
        ends = _regression_ends(X, y)
    middle = base_value(results, metric)
    order = sorted(ends, key=lambda k: -np.ptp([*ends[k], middle]))
    return {names[k]: ends[k] for k in order}


def base_value(results: Results, metric: str) -> float:
    """The reference value of a metric: for a sweep that of its first run, for other plans the mean."""
    finite = np.isfinite(results[metric])
    if results.kind == "sweep" and len(results) and results.runs[0] == 0 and finite[0]:
        return float(results[metric][0])
    return float(results[metric][finite].mean())


def _sweep_ends(X: np.ndarray, y: np.ndarray, own: np.ndarray) -> dict[int, tuple[float, float]]:
    """The metric at the ends of each parameter, in the runs in which all others keep their own values."""
    made = {}
    for k in range(X.shape[1]):
        alone = (np.delete(X, k, axis=1) == np.delete(own, k)).all(axis=1)
        if alone.any():
            x, values = X[alone, k], y[alone]
            made[k] = float(values[np.argmin(x)]), float(values[np.argmax(x)])
    return made


def _regression_ends(X: np.ndarray, y: np.ndarray) -> dict[int, tuple[float, float]]:
    """The metric at the ``END_QUANTILES`` of each parameter, by linear regression on all of them."""
    size = np.where(np.ptp(X, axis=0) > 0, X.std(axis=0), 1.0)
    slope = np.linalg.lstsq((X - X.mean(axis=0)) / size, y - y.mean(), rcond=None)[0] / size
    low, high = y.mean() + slope * (np.quantile(X, END_QUANTILES, axis=0) - X.mean(axis=0))
    return {k: (float(low[k]), float(high[k])) for k in range(len(slope))}
