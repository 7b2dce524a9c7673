"""Motion distinguished from noise in the data of a method: transients, and paths that are too smooth."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.data.slow_noise import SHARES, Stretch, Weighted, mean_square, variance_of_mean, weighted, windows

TRANSIENT_LEVEL = 1e-3
"""Probability below which noise does not explain a beginning that is larger than the rest. Chosen."""
CONTINUED_LEVEL = 0.3
"""As TRANSIENT_LEVEL, once there is a transient. Chosen: its remainder is small beside the noise, while too much
left out costs no more than some of the data."""
LARGER_HEAD = 4.0
"""Mean square of a smooth beginning over that of the rest, from which it is a transient. Chosen."""
MAX_TRANSIENT = 0.65
"""Share of a stretch that may be left out as a transient. Chosen."""
SMOOTH_RATIO = 3.0
"""Growth of the mean square increment over twice the time, above which a path is smooth. Derived: it is 2 for
first-order noise and random walks and 4 for a smooth motion; chosen between them."""
FAR_ABOVE = 2.0
"""Mean square over that of the fast noise, from which a smooth path is looked for. Chosen."""
CLEAR_INCREMENTS = (3.0, 0.03)
"""Mean square increments, less those of the fast noise, over its mean square and over all, from which they show how
smooth a path is. Chosen."""
MIN_SMOOTH_SHARE = 0.02
"""Time in which a smooth path changes, as a share of the stretch, from which it is a motion. Chosen: smooth noise, as a
filter in the sensor leaves it, changes fifty times and more."""


def settled(stretches: Sequence[Stretch], fast: float) -> tuple[int, bool]:
    """Samples to leave out at the beginning of stretches that begin together, and whether the rest is stationary.

    The beginning is left out as long as it is larger than noise explains that is as in the second half of the rest, or
    is large beside the rest with a smooth path. ``fast`` is the rms of the fast noise.
    """
    n = min(len(s.x) for s in stretches)
    width, first, seen, models = n // 8, 0, 0, None
    if width < 4:
        return 0, True
    while True:
        if models is None:
            middle = (first + n) // 2
            models = weighted([s.cut(middle, n) for s in stretches])
            level = [_less_drift(s, middle) for s in stretches] if models.slope else stretches
        heads, tails = [s.cut(first, first + width) for s in level], [s.cut(first + width, n) for s in level]
        if _transient(heads, tails, models, fast, CONTINUED_LEVEL if first else TRANSIENT_LEVEL):
            if first + n // 16 > MAX_TRANSIENT * n:
                return first, not _transient(heads, tails, models, fast, TRANSIENT_LEVEL)
            first += n // 16
        elif seen == first:
            return first, True
        else:
            models, seen = None, first  # the transient was in the second half, too


def _less_drift(s: Stretch, middle: int) -> Stretch:
    """A stretch less the straight line that fits it best from the middle on."""
    at = np.arange(len(s.x)) - (middle + len(s.x)) / 2
    return attrs.evolve(s, x=s.x - at * (at[middle:] @ s.x[middle:] / (at[middle:] @ at[middle:])))


def smooth(stretches: Sequence[Stretch], fast: float) -> bool:
    """Whether the stretches are a motion rather than noise: far above the fast noise (rms), with a smooth path."""
    total = float(np.sqrt(mean_square(stretches)))
    if total**2 <= FAR_ABOVE * fast**2 or not total > 0:
        return False
    n = max(len(s.x) for s in stretches)
    lags = np.unique(np.round(2.0 ** np.arange(0, np.log2(max(n // 4, 2)), 0.5)).astype(int))
    grown = [_increments(stretches, int(k)) - 2 * fast**2 for k in lags]
    changed = next((k for k, d in zip(lags, grown, strict=True) if d >= total**2), n)
    if changed < MIN_SMOOTH_SHARE * n:
        return False
    for k, d in zip(lags, grown, strict=True):
        if d > max(CLEAR_INCREMENTS[0] * fast**2, CLEAR_INCREMENTS[1] * total**2):
            twice = _increments(stretches, 2 * int(k)) - 2 * fast**2
            return bool(d < 0.5 * total**2 and twice > SMOOTH_RATIO * d)
    return False


def _increments(stretches: Sequence[Stretch], k: int) -> float:
    """Mean square of the change over k samples."""
    parts = [s.x[k:] - s.x[:-k] for s in stretches if len(s.x) > k]
    return float(np.mean(np.concatenate(parts) ** 2)) if parts else 0.0


def _transient(
    heads: Sequence[Stretch], tails: Sequence[Stretch], models: Weighted, fast: float, chance: float
) -> bool:
    """Whether noise as it is in the rest does not explain the size of the beginning, or this moves smoothly."""
    from scipy.special import fdtrc

    rest = mean_square(tails)
    first = float(np.mean([np.mean((h.x - q.x.mean()) ** 2) for h, q in zip(heads, tails, strict=True)]))
    if not rest > 0:
        return first > 0
    if first > LARGER_HEAD * rest and smooth(heads, fast):
        return True
    seen, own = windows(heads[0], len(heads[0].x), models)
    _, other = windows(tails[0], len(tails[0].x), models)
    mean = SHARES * variance_of_mean(models.times, len(tails[0].x) * tails[0].step)[:, None]
    mean = np.minimum(mean, 0.9 * seen)
    a, b = (np.maximum(len(heads) * 2 * seen**2 / v, 1.0) for v in (own, other))
    larger = fdtrc(a, b, first / rest * (seen - mean) / (seen + mean))
    return models.mean(larger) < chance
