"""Jumps of a sampled signal, such as those of a staircase command or of a switched heater, beneath noise."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tsmblocks.data.quantization import quantum_of

LEVEL_SAMPLES = 8
"""Samples on either side of a jump in which the signal is at a level. Chosen: with fewer the levels are not known."""
CLEAR = 5.0
"""Height of a jump [standard deviation of the samples about it and a slope]. Chosen: noise does not reach it."""
MIN_QUANTA = 3.0
"""Height of a jump at least, in steps of a quantised signal. Chosen: rounding makes lower ones of a slow motion."""
EDGE = 2
"""Samples on either side of the middle of a jump that may lie between its levels. Chosen: a motion has more."""
SUDDEN = 0.5
"""Share of its height that a jump makes within two samples. Chosen: a motion spreads it over more."""
UNUSUAL = 5.0
"""Height of a jump [typical difference of neighbouring samples]. Chosen: slow noise does not reach it."""
NORMAL_MEDIAN = 0.6745
"""Median of the magnitude of a normal variable of unit variance."""
BETWEEN = 4.0
"""Distance from both levels [standard deviation about them] from which a sample lies between them. Chosen."""


def jumps(x: np.ndarray) -> np.ndarray:
    """The jumps of a signal (n,) as a staircase (n,) that begins at zero; all zeros where there are none.

    Less its jumps, a signal can be filtered without smearing them.
    """
    result = np.zeros(len(x))
    if len(x) < 2 * LEVEL_SAMPLES:
        return result
    height, spread = _beside_slope(x)
    steps = np.abs(np.diff(x))
    least = max(UNUSUAL * float(np.median(steps)) / NORMAL_MEDIAN, 1e-9 * float(np.ptp(x)))
    clear = (height > np.maximum(CLEAR * spread, least)) & (_sudden(x) > SUDDEN * height)
    if clear.any():
        clear &= height > MIN_QUANTA * (quantum_of(x) or 0.0)
    for k in _highest(np.where(clear, height, 0.0)):
        before, after = x[k : k + LEVEL_SAMPLES], x[k + LEVEL_SAMPLES : k + 2 * LEVEL_SAMPLES]
        result[k + LEVEL_SAMPLES - EDGE :] += _one_jump(before, after, len(x) - k - LEVEL_SAMPLES + EDGE)
    return result


def _beside_slope(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height of a jump in the middle of each two neighbouring windows, beside a slope, and the deviation about both."""
    count = 2 * LEVEL_SAMPLES
    places = np.arange(count)
    basis = np.stack([np.ones(count), places - places.mean(), np.where(places < LEVEL_SAMPLES, 0.0, 1.0)], axis=1)
    windows = sliding_window_view(x, count)
    coefficients = windows @ np.linalg.pinv(basis).T
    squares = np.sum((windows - coefficients @ basis.T) ** 2, axis=1)
    return np.abs(coefficients[:, 2]), np.sqrt(squares / (count - basis.shape[1]))


def _sudden(x: np.ndarray) -> np.ndarray:
    """The largest change within two samples at the middle of each two neighbouring windows of levels."""
    last = LEVEL_SAMPLES - 1  # of the first window
    n = len(x) - 2 * LEVEL_SAMPLES + 1
    pairs = [(last - 1, last + 1), (last, last + 1), (last, last + 2)]
    result: np.ndarray = np.max([np.abs(x[b : b + n] - x[a : a + n]) for a, b in pairs], axis=0)
    return result


def _highest(height: np.ndarray) -> list[int]:
    """Where each jump is highest; of several within the samples of one level the highest."""
    found, taken = list[int](), ~(height > 0)
    for k in np.argsort(-height, kind="stable").tolist():
        if not taken[k]:
            found.append(k)
            taken[max(k - LEVEL_SAMPLES + 1, 0) : k + LEVEL_SAMPLES] = True
    return found


def _one_jump(before: np.ndarray, after: np.ndarray, count: int) -> np.ndarray:
    """A jump (count,) from the level of the samples before it to that of those after it, from its first edge sample."""
    rest_before, rest_after = before[:-EDGE], after[EDGE:]
    low, high = float(np.median(rest_before)), float(np.median(rest_after))
    near = BETWEEN * float(np.sqrt((rest_before.var() + rest_after.var()) / 2))
    edge = np.concatenate([before[-EDGE:], after[:EDGE]])
    share = np.where(np.arange(2 * EDGE) < EDGE, 0.0, 1.0)
    if high == low:
        return np.zeros(count)
    between = (np.abs(edge - low) > near) & (np.abs(edge - high) > near)
    share[between] = np.clip((edge[between] - low) / (high - low), 0.0, 1.0)
    result = np.full(count, high - low)
    result[: 2 * EDGE] *= share
    return result
