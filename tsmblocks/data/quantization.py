"""The step of a quantised signal, as encoders and converters make them."""

from __future__ import annotations

import numpy as np

MIN_VALUES = 8
"""Different values below which a signal is a switch or a staircase, not a converter's output. Chosen."""
MAX_GRID_DEVIATION = 0.05
"""Deviation of a value from the grid of steps, in steps, that printing and rounding may cause. Chosen."""


def quantum_of(x: np.ndarray) -> float | None:
    """Step of which all values of a signal are whole multiples (from its first), or None when there is none.

    A ramp or a triangle sampled evenly lies on such a grid too; all of its changes are of one size.
    """
    values = np.unique(x)
    if len(values) < MIN_VALUES:
        return None
    scale = float(np.abs(values).max())
    apart = np.diff(values)
    apart = apart[apart > 1e-9 * scale]
    changes = np.abs(np.diff(x))
    if not len(apart) or not _is_grid(values, float(apart.min())):
        return next((q for k in (2, 3) if len(apart) and _is_grid(values, q := float(apart.min()) / k)), None)
    q = _refined_step(values, float(apart.min()))
    return q if len(np.unique(np.round(changes / q))) > 1 else None


def _is_grid(values: np.ndarray, q: float) -> bool:
    """Whether nearly all values are whole multiples of a step from the first."""
    q = _refined_step(values, q)
    places = (values - values[0]) / q
    return bool(np.mean(np.abs(places - np.round(places)) < MAX_GRID_DEVIATION) > 0.99)


def _refined_step(values: np.ndarray, q: float) -> float:
    """Least-squares step, found over spans that double, so that the error of the first estimate cannot accumulate."""
    far = values - values[0]
    reach = 8.0
    while True:
        near = far <= reach * q
        places = np.round(far[near] / q)
        if places.any():
            q = float(places @ far[near] / (places @ places))
        if near.all() or reach > 1e12:
            return q
        reach *= 2
