"""The root of a system of equations, searched from a start and, where that fails, from others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError, in_words

RATE_TOLERANCE = 1e-9
"""Rate of a state, or residual of an output, that counts as zero: a share of the size of its terms ... Chosen."""
ABSOLUTE_TOLERANCE = 1e-12
"""... plus this much. Chosen: for terms of size zero."""
SHARES = (0.5, 0.1, 0.01, 0.0)
"""Shares of the start from which the search begins again. Chosen: limits are mostly left towards zero."""
DISTANCES = 10.0 ** np.arange(-3.0, 3.01, 0.1)
"""Distances from the start, in each unknown alone, at which the residual is looked at. Chosen: from a thousandth to a
thousand in the unit of the unknown, as close together as the narrowest range of a limit may be wide (a quarter)."""
MOST_SCANNED = 100
"""Unknowns that are varied one by one, at most. Chosen: some 0.2 s in all."""
BEST_SCANNED = 8
"""Of the points looked at those with the smallest residuals from which the search begins again. Chosen."""


@attrs.frozen(eq=False)
class Search:
    """The end of a search: the unknowns ``z``, and whether they are a root.

    If not, ``error`` is the residual of the ``worst`` equation after the search from the start itself, and ``idle``
    says which unknowns have no effect there, or at the start.
    """

    z: np.ndarray
    found: bool
    worst: int
    error: float
    idle: np.ndarray


def found_root(conditions: Any, begin: np.ndarray, count: int) -> Search:
    """The root of ``count`` equations nearest to a start, or of further starts the first that leads to one.

    ``conditions(z)`` gives residuals and their Jacobian first. Raises RunError where they are not finite at the start.
    """
    first = _judged(conditions, _nearest_root(conditions, begin, count), begin, count)
    if first.found or not len(begin):
        return first
    for other in _starts(conditions, begin):
        try:
            search = _judged(conditions, _nearest_root(conditions, other, count), begin, count)
        except (RunError, ValueError):  # not finite on the way
            continue
        if search.found:
            return search
    return first


def _judged(conditions: Any, z: np.ndarray, begin: np.ndarray, count: int) -> Search:
    """Whether a point is a root, to within the rounding of the terms that make up each equation."""
    residual, J = (np.asarray(part, dtype=float) for part in conditions(z)[:2])
    error = np.abs(residual.ravel())
    size = RATE_TOLERANCE * (np.abs(J) @ np.abs(z)) + ABSOLUTE_TOLERANCE
    worst = int(np.argmax(error / size)) if count else 0
    found = not count or bool(error[worst] <= size[worst])
    idle = np.logical_not(np.asarray(conditions(begin)[1], dtype=float).any(axis=0))
    return Search(z, found, worst, float(error[worst]) if count else 0.0, idle)


def _starts(conditions: Any, begin: np.ndarray) -> Iterator[np.ndarray]:
    """Further starts: towards zero, then where the residual is small when one unknown alone is varied."""
    yield from (share * begin for share in SHARES if begin.any())
    scanned: list[tuple[float, int, float]] = []
    for k in range(min(len(begin), MOST_SCANNED)):
        for value in (*(begin[k] - DISTANCES), *(begin[k] + DISTANCES)):
            size = np.linalg.norm(np.asarray(conditions(_with(begin, k, value))[0], dtype=float))
            scanned += [(float(size), k, float(value))] if np.isfinite(size) else []
    for _, k, value in sorted(scanned)[:BEST_SCANNED]:
        yield _with(begin, k, value)


def _with(z: np.ndarray, k: int, value: float) -> np.ndarray:
    other = z.copy()
    other[k] = value
    return other


def _nearest_root(conditions: Any, begin: np.ndarray, count: int) -> np.ndarray:
    """The root nearest to the initial guess: Newton steps of least norm, which leave undetermined states unchanged."""
    from scipy.optimize import least_squares

    def error(v: np.ndarray) -> np.ndarray:
        return np.asarray(conditions(v)[0], dtype=float).ravel()

    def jacobian(v: np.ndarray) -> np.ndarray:
        return np.asarray(conditions(v)[1], dtype=float)

    if not count or not len(begin):
        return begin
    z = begin
    for _ in range(50):
        r, J = error(z), jacobian(z)
        if not np.isfinite(r).all() or not np.isfinite(J).all():
            raise RunError(
                f"the equations are not finite at {in_words(z.round(6).tolist())}. Start elsewhere: start={{…}}."
            )
        step = np.linalg.lstsq(J, -r, rcond=1e-12)[0]
        if np.abs(step).max(initial=0.0) <= 1e-14 * max(1.0, float(np.abs(z).max())):
            return z
        shares = (0.5**k for k in range(12))
        share = next((k for k in shares if np.linalg.norm(error(z + k * step)) < np.linalg.norm(r)), None)
        if share is None:
            break
        z = z + share * step
    return np.asarray(least_squares(error, z, jacobian, xtol=1e-15, ftol=1e-15, gtol=1e-15).x)
