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
    numbers = {k: v for k, v in results.parameters.items() if v.dtype.kind == "f"}
    y, finite = results[metric], np.isfinite(results[metric])
    X = np.column_stack([numbers[k] for k in numbers]) if numbers else np.empty((len(y), 0))
    if not finite.sum() > X.shape[1] + 1 or not X.shape[1]:
        raise RunError(
            f"'{metric}' is finite in {int(finite.sum())} runs; the influences of its parameters take {X.shape[1] + 2} "
            "at least."
        )
    evaluate = _sweep_ends if results.kind == "sweep" else _regression_ends
    made = evaluate(results, X, y, finite, list(numbers))
    middle = base_value(results, metric)
    return dict(sorted(made.items(), key=lambda one: -np.ptp([*one[1], middle])))


def base_value(results: Results, metric: str) -> float:
    """A metric without changes: of a sweep that of its first run, of other plans the mean."""
    finite = np.isfinite(results[metric])
    if results.kind == "sweep" and len(results) and results.runs[0] == 0 and finite[0]:
        return float(results[metric][0])
    return float(results[metric][finite].mean())


def _sweep_ends(
    results: Results, X: np.ndarray, y: np.ndarray, finite: np.ndarray, names: list[str]
) -> dict[str, tuple[float, float]]:
    """The metric at the ends of each parameter, in the runs in which all others keep their own values."""
    own = np.array([results.own[name] for name in names])
    made = {}
    for k, name in enumerate(names):
        alone = finite & (np.delete(X, k, axis=1) == np.delete(own, k)).all(axis=1)
        if alone.any():
            x, values = X[alone, k], y[alone]
            made[name] = float(values[np.argmin(x)]), float(values[np.argmax(x)])
    return made


def _regression_ends(
    _: Results, X: np.ndarray, y: np.ndarray, finite: np.ndarray, names: list[str]
) -> dict[str, tuple[float, float]]:
    """The metric at the ``END_QUANTILES`` of each parameter, by linear regression on all of them."""
    X, y = X[finite], y[finite]
    size = np.where(np.ptp(X, axis=0) > 0, X.std(axis=0), 1.0)
    slope = np.linalg.lstsq((X - X.mean(axis=0)) / size, y - y.mean(), rcond=None)[0] / size
    ends = np.quantile(X, END_QUANTILES, axis=0) - X.mean(axis=0)
    return {
        name: (float(y.mean() + slope[k] * ends[0, k]), float(y.mean() + slope[k] * ends[1, k]))
        for k, name in enumerate(names)
    }
