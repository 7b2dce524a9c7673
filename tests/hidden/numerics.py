"""Small numerical tools: linear filters with straight input between instants, sampling off the grid, sensors."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter, lfilter_zi


def filtered(num, den, u, step):
    """Response of a transfer function to columns `u` that run straight between instants, from rest at u[0].

    `num` and `den` hold one polynomial for all columns, or a list of one a column.
    """
    y = np.empty_like(u)
    if np.ndim(num[0]) == 0:
        num, den = [num] * u.shape[1], [den] * u.shape[1]
    known = {}
    for j in range(u.shape[1]):
        key = (tuple(num[j]), tuple(den[j]))
        if key not in known:
            b, a, _ = cont2discrete((num[j], den[j]), step, method="foh")
            known[key] = np.ravel(b), np.ravel(a), lfilter_zi(np.ravel(b), np.ravel(a))
        b, a, zi = known[key]
        y[:, j] = lfilter(b, a, u[:, j], zi=zi * u[0, j])[0]
    return y


def at_positions(y, where):
    """Columns of `y` at fractional rows `where`, by the cubic through four neighbours; held beyond both ends."""
    n = len(y)
    where = np.clip(where, 0.0, n - 1.0)
    k = np.clip(where.astype(np.int64), 1, n - 3)
    s = where - k
    column = np.arange(y.shape[1])[None, :]
    below, here, after, beyond = (y[k + i, column] for i in (-1, 0, 1, 2))
    return (
        -s * (s - 1) * (s - 2) / 6 * below
        + (s + 1) * (s - 1) * (s - 2) / 2 * here
        - (s + 1) * s * (s - 2) / 2 * after
        + (s + 1) * s * (s - 1) / 6 * beyond
    )


def delayed(y, rows):
    """Columns of `y` late by a (fractional) number of rows each; before the start the first value stands."""
    return at_positions(y, np.arange(len(y))[:, None] - rows[None, :])


def coloured(rng, count, rms, period, share=1 / 3, time_constant=0.05):
    """White noise plus a first-order coloured part that holds `share` of the power."""
    phi = np.exp(-period / time_constant)
    drive = rng.standard_normal(count) * np.sqrt(1.0 - phi * phi)
    slow = lfilter([1.0], [1.0, -phi], drive, zi=[phi * rng.standard_normal()])[0]
    return rms * (np.sqrt(1.0 - share) * rng.standard_normal(count) + np.sqrt(share) * slow)


def quantised(y, width):
    """Rounded to whole counts."""
    return width * np.round(y / width)


def smooth_step(t, at, width):
    """0 before, 1 after, along a straight ramp of the given width that starts at `at`."""
    return np.clip((t - at) / width, 0.0, 1.0)
