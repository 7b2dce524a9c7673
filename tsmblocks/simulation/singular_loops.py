"""Linear algebraic loops that become singular between two steps, where their solution passes through infinity."""

from __future__ import annotations

import functools
import warnings

import attrs
import numpy as np

from tsmblocks.engine.equations import Equations

JUMP = 4.0
"""A determinant jumps where it changes by more than this many times its changes just before and after. Chosen: a smooth
one changes by about as much from step to step."""


class LoopWarning(UserWarning):
    """The gain of a linear algebraic loop passes 1 between two steps, so its signals pass through infinity there."""


def with_determinants(eq: Equations, y: tuple[int, ...]) -> tuple[Equations, tuple[int, ...]]:
    """Equations with the determinants of loops whose gain changes as further signals, and these after the signals y."""
    more = _extended(eq)
    return more, (*y, *range(len(eq.y), len(more.y)))


@functools.lru_cache(maxsize=64)
def _extended(eq: Equations) -> Equations:
    """The equations with more signals (kept, since equations are compared by identity)."""
    if eq.watched is None:
        return eq
    names = tuple(f"determinant {k}" for k in range(len(eq.watched.paths)))
    return attrs.evolve(eq, y=(*eq.y, *names), rhs=eq.watched.rhs, forms=eq.watched.forms)


def without_determinants(eq: Equations, rows: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The rows of a run with determinants without these; warns of the first loop that passes its pole."""
    if eq.watched is None:
        return rows
    count = len(eq.watched.paths)
    for path, one in zip(eq.watched.paths, rows[:, -count:].T, strict=True):
        crossings = _crossings(one)
        if len(crossings):
            k = crossings[0]
            warnings.warn(
                f"diagram '{eq.title}': the gain of the algebraic loop {' -> '.join(path)} passes 1 between "
                f"t = {t[k]:g} s and {t[k + 1]:g} s, so its signals pass through infinity there. The results after "
                "that are meaningless unless the gain jumps. Keep it below 1, or break the loop with a block that "
                "has a state.",
                LoopWarning,
                stacklevel=4,
            )
            break
    return np.ascontiguousarray(rows[:, :-count])


def _crossings(values: np.ndarray) -> np.ndarray:
    """Places before which a series is on one side of zero and after which on the other, other than by a jump."""
    changes = np.abs(np.diff(values, prepend=np.nan, append=np.nan))
    around = np.fmax(changes[:-2], changes[2:])
    smooth = ~(changes[1:-1] > JUMP * around)
    return np.flatnonzero((values[:-1] * values[1:] < 0) & smooth)
