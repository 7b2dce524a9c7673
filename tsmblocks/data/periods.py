"""Finding the period of a signal that repeats itself."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tsmblocks.common.interpolation import interpolation
from tsmblocks.data.grid import is_even, step_of

MAX_UNLIKENESS = 0.01
"""Normalised mean square difference d of a signal to itself one period later, up to which it repeats itself. Chosen:
below the threshold 0.1 of YIN, since mechanisms repeat better than voices."""
MIN_UNLIKENESS = 0.3
"""d that a signal reaches at some shorter lag: one that never differs from itself does not move. Chosen."""


def find_period(t: np.ndarray, x: np.ndarray) -> tuple[float, float] | None:
    r"""Period [s] of a signal and d of two periods, or None when it does not repeat itself twice.

    The period is the shortest lag :math:`\tau` beyond the first decay at which

    .. math:: d(\tau) = \frac{\sum_k (x_k - x_{k+\tau})^2}{\sum_k (x_k - \bar x)^2 + (x_{k+\tau} - \bar x)^2}

    is smallest and below ``MAX_UNLIKENESS``; between two samples it is refined with a spline.
    Source: the difference function of de Cheveigné and Kawahara, YIN, J. Acoust. Soc. Am. 111 (2002).
    """
    step = step_of(t)
    if not is_even(t):
        grid = np.arange(t[0], t[-1], step)
        t, x = grid, np.interp(grid, t, x)
    n, x = len(x), x - x.mean()
    if n < 16 or not np.ptp(x) > 0:
        return None
    x = x / np.ptp(x)
    unlike = _unlikeness(x, n // 2 + 1)
    away = np.flatnonzero(unlike > MIN_UNLIKENESS).min(initial=len(unlike))
    lag = np.arange(1, len(unlike) - 1)
    between = min(0.3 * float(unlike[1]), 0.05)  # what half a sample beside the period may add
    low = (unlike[1:-1] <= unlike[:-2]) & (unlike[1:-1] <= unlike[2:]) & (lag > away)
    low &= unlike[1:-1] < MAX_UNLIKENESS + between
    if not low.any():
        return None
    limit = 2 * float(unlike[lag[low]].min()) + 1e-3
    for k in [int(k) for k in lag[low] if unlike[k] <= limit + between][:5]:
        fine, rest = _refined(x, k)
        if rest < min(limit, MAX_UNLIKENESS):
            return fine * step, rest
    return None


def best_period(t: np.ndarray, signals: Iterable[np.ndarray]) -> float | None:
    """Period [s] of the signal that repeats itself best, or None when none does."""
    found = [p for x in signals if (p := find_period(t, x)) is not None]
    return min(found, key=lambda pair: pair[1])[0] if found else None


def refined_lag(t: np.ndarray, signals: Iterable[np.ndarray], lag: float) -> float:
    """The lag [s] near a given one, within a sample, at which the signal that repeats itself best does so best."""
    step = step_of(t)
    if not is_even(t):
        grid = np.arange(t[0], t[-1], step)
        signals, t = [np.interp(grid, t, x) for x in signals], grid
    whole = round(lag / step)
    found = [_refined(x - x.mean(), whole) for x in signals if np.ptp(x) > 0]
    return min(found, key=lambda pair: pair[1])[0] * step if found else lag


def unlikeness(t: np.ndarray, x: np.ndarray, lag: float) -> float:
    """d of ``find_period`` at one lag [s]."""
    kept = t + lag <= t[-1]
    now = x[kept] - x.mean()
    later = np.interp(t[kept] + lag, t, x) - x.mean()
    both = float(now @ now + later @ later)
    return float(np.sum((now - later) ** 2)) / both if both > 0 else 0.0


def _unlikeness(x: np.ndarray, most: int) -> np.ndarray:
    """d at the lags 0 to most, in samples."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = len(x)
    size = next_fast_len(2 * n)
    product = irfft(np.abs(rfft(x, size)) ** 2, size)[: most + 1]
    energy = np.r_[0.0, np.cumsum(x**2)]
    lags = np.arange(most + 1)
    both = energy[n - lags] + energy[n] - energy[lags]
    return np.maximum(both - 2 * product, 0.0) / np.maximum(both, 1e-300)


def _refined(x: np.ndarray, lag: int) -> tuple[float, float]:
    """Lag [samples] refined to a fraction, or the whole number when that fits as well, and d there."""
    from scipy.optimize import minimize_scalar

    n = len(x)
    at = np.arange(float(n))
    curve = interpolation(at, x, "cubic")
    inner = at[1 : n - lag - 1]
    if len(inner) < 8:
        return float(lag), float(_unlikeness(x, lag)[lag])
    now = x[1 : n - lag - 1]

    def unlike(shift: float) -> float:
        later = curve(inner + shift)
        return float(np.sum((later - now) ** 2) / max(float(later @ later + now @ now), 1e-300))

    found = minimize_scalar(unlike, bounds=(lag - 1, lag + 1), method="bounded", options={"xatol": 1e-6})
    whole = unlike(lag)
    return (float(lag), whole) if whole <= 1.01 * found.fun + 1e-15 else (float(found.x), float(found.fun))
