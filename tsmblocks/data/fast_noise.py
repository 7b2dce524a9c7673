"""Fast noise: noise that changes from sample to sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsmblocks.common.interpolation import polynomial_weights
from tsmblocks.data.slow_noise import Level

HIGH_FREQUENCIES = "high frequencies"
"""Method of a floor that was estimated from sample to sample. It misses slow noise: no model may be called wrong by
it alone."""

QUIET_PARTS = 16
"""Parts of a signal of which the quieter ones bound the fast noise from below. Chosen."""
MIN_PART_SAMPLES = 32
"""Samples of such a part at least. Chosen."""


class Estimate(NamedTuple):
    """A noise floor; as in Noise."""

    floor: float
    method: str
    samples: int
    freedom: int


def sample_to_sample_noise(t: np.ndarray, x: np.ndarray, side: int = 2) -> Estimate:
    """Error of a polynomial through the neighbours on each side, for white noise its rms; jumps are left out."""
    n = len(t) - 2 * side
    near = [j for j in range(2 * side + 1) if j != side]
    away = np.stack([t[j : j + n] for j in near], axis=1) - t[side : side + n, None]
    w = polynomial_weights(away)
    off = x[side : side + n] - np.sum(w * np.stack([x[j : j + n] for j in near], axis=1), axis=1)
    off = off / np.sqrt(1 + np.sum(w**2, axis=1))
    for _ in range(3):
        off = off[np.abs(off) <= 4 * np.sqrt(np.mean(off**2))]
    return Estimate(float(np.sqrt(np.mean(off**2))), HIGH_FREQUENCIES, len(t), len(off))


def fast_level(t: np.ndarray, x: np.ndarray) -> Level:
    """The noise from sample to sample; the residual of a smoother curve in the quieter parts is a lower bound.

    Noise is present everywhere, but only some parts of a motion are not followed by a curve. The values overlap, so
    that a third of them count as independent.
    """
    from scipy.special import chdtri

    found = sample_to_sample_noise(t, x)
    least = min([found.floor, *(sample_to_sample_noise(t, x, side).floor for side in (3, 4) if len(t) > 8 * side)])
    count = min(QUIET_PARTS, len(t) // MIN_PART_SAMPLES)
    if count > 1:
        parts = np.array_split(np.arange(len(t)), count)
        least = min(least, float(np.quantile([sample_to_sample_noise(t[k], x[k]).floor for k in parts], 0.25)))
    free = max(found.freedom / 3, 1.0)
    return Level(found.floor, least * float(np.sqrt(free / chdtri(free, 0.025))), np.inf, free, found.floor, None, None)
