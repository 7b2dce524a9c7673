"""How much of an effect the base cannot absorb, and the amplitude at which that is as asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .kinds import Spec


def span(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span the same space."""
    scaled = columns / np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
    q, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return q[:, s > 1e-9 * s[0]]


def left_over(effect: np.ndarray, basis: np.ndarray) -> float:
    """Mean square of what is left of `effect` beside an orthonormal basis."""
    return float(np.mean((effect - basis @ (basis.T @ effect)) ** 2))


def amplitudes_for(
    reached: Callable[[np.ndarray], np.ndarray],
    specs: Sequence[Spec],
    scale: tuple[float, float, float],
    *,
    within: float = 0.06,
    rounds: int = 14,
) -> np.ndarray:
    """Amplitude of each case at which `reached(amplitudes)` is its size, or the amplitude that was given.

    Found by secants of the logarithms, kept in a bracket.
    `scale` is (first amplitude, largest, power at the start). Where the largest does not suffice, it stays.
    """
    first, largest, power = scale
    count, sizes = len(specs), np.array([s.size for s in specs])
    fixed = np.array([s.amplitude is not None for s in specs])
    a = np.array([first if s.amplitude is None else s.amplitude for s in specs])
    low, high = np.zeros(count), np.full(count, np.inf)
    if fixed.all():
        return a
    slope = np.full(count, power)
    e = np.maximum(reached(a), 1e-12)
    for _ in range(rounds):
        low, high = np.where(e < sizes, np.maximum(low, a), low), np.where(e > sizes, np.minimum(high, a), high)
        open_ = (np.abs(e / sizes - 1.0) > within) & ~((e < sizes) & (a >= largest)) & ~fixed
        if not open_.any():
            break
        move = np.clip(np.log(sizes / e) / slope, -1.4, 1.4)
        guess = np.minimum(a * np.exp(move), largest)
        middle = np.sqrt(np.where(low > 0, low, 1.0) * np.where(np.isfinite(high), high, 1.0))
        boxed = (low > 0) & np.isfinite(high)
        guess = np.where(boxed & ((guess <= low) | (guess >= high)), middle, guess)
        guess = np.where(open_, guess, a)
        seen = np.maximum(reached(guess), 1e-12)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.log(seen / e) / np.log(guess / a)
        slope = np.where(open_ & np.isfinite(found), np.clip(found, 0.3, 30.0), slope)
        a, e = guess, seen
    return a
