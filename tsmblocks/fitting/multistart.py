"""Search ranges of a fit: a finite one for each number, and places spread evenly over all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, in_words

DECADES = 2.0
"""How far a range of a positive number reaches to each side of its value, where no bound does. Chosen."""
WIDE = 100.0
"""Ratio of the ends of a positive range from which it is searched in the logarithm. Chosen."""


@attrs.frozen
class Range:
    """The interval one number is searched in, both ends included; ``log`` searches in its logarithm.

    Raises ParameterError for ends that are not finite or not in order, and for a logarithm of a value that is not
    positive. ``name`` is the name in messages.
    """

    low: float
    high: float
    log: bool = False
    name: str = ""

    def __attrs_post_init__(self) -> None:
        what = f"the search range of '{self.name}'" if self.name else "a search range"
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ParameterError(
                f"{what} must have finite ends, the lower one first, got {self.low:g} to {self.high:g}."
            )
        if self.log and self.low <= 0:
            raise ParameterError(
                f"{what} is searched in the logarithm, so both ends must be positive, "
                f"got {self.low:g} to {self.high:g}."
            )


class Box:
    """Ranges side by side: places ``theta`` in their own units, and as shares 0 to 1 of each range."""

    def __init__(self, ranges: Sequence[Range]) -> None:
        if not ranges:
            raise ParameterError("a search needs at least one number to look for, got no ranges.")
        self.ranges = tuple(ranges)
        self.low, self.high = (np.array([getattr(r, end) for r in ranges], dtype=float) for end in ("low", "high"))
        self._log = np.array([r.log for r in ranges])

    def thetas(self, shares: np.ndarray) -> np.ndarray:
        """Places of shape (..., unknowns) in their own units, inside the ranges whatever rounding does."""
        low, high = self._stretched(self.low), self._stretched(self.high)
        made = low + shares * (high - low)
        made = np.where(self._log, np.exp(np.where(self._log, made, 0.0)), made)
        return np.clip(made, self.low, self.high)

    def shares(self, thetas: np.ndarray) -> np.ndarray:
        """The opposite of ``thetas``."""
        low, high = self._stretched(self.low), self._stretched(self.high)
        return np.clip((self._stretched(thetas) - low) / (high - low), 0.0, 1.0)

    def inside(self, thetas: object, what: str) -> np.ndarray:
        """Places given from outside, as an array (places, unknowns).

        Raises ParameterError for a place outside a range, or of another length; ``what`` names the place.
        """
        try:
            made = np.atleast_2d(np.asarray(thetas, dtype=float))
        except (TypeError, ValueError):
            made = np.empty((0, 0, 0))
        if made.ndim != 2 or made.shape[1] != len(self.ranges):
            raise ParameterError(
                f"{what} must have one number for each of the {len(self.ranges)} ranges, got {in_words(thetas)}."
            )
        wrong = np.argwhere(~((made >= self.low) & (made <= self.high)))
        if len(wrong):
            row, k = wrong[0]
            named = f"'{self.ranges[k].name}'" if self.ranges[k].name else f"number {k}"
            raise ParameterError(
                f"{what} has {named} at {made[row, k]:g}, outside its search range {self.low[k]:g} to {self.high[k]:g}."
            )
        return made

    def _stretched(self, thetas: np.ndarray) -> np.ndarray:
        """The logarithm of a range that is searched in it."""
        return np.where(self._log, np.log(np.where(self._log, thetas, 1.0)), thetas)


def search_range(value: float, low: float = -math.inf, high: float = math.inf, *, name: str = "") -> Range:
    """A finite range around ``value`` for a number declared to lie in ``low`` to ``high``, which may be infinite.

    Positive (``low`` >= 0) and open above: two decades to each side of ``value``, no further than ``low``,
    in the logarithm; 0 to 1 where ``value`` is 0. Open below, or to both sides: from -w to w with
    w = max(10 abs(value), 1), no further than a bound that is declared. Both bounds finite: the bounds,
    in the logarithm from a ratio of 100; one of more than four decades is narrowed to two to each side.
    Raises ParameterError for a value outside the bounds, or bounds without room between them.
    """
    what = f"'{name}'" if name else "a number to search for"
    if not (low <= value <= high and math.isfinite(value)):
        raise ParameterError(f"{what} is {value:g}, which does not lie within its bounds {low:g} to {high:g}.")
    if low == high:
        raise ParameterError(f"{what} has no room between its bounds {low:g} and {high:g}; keep it as it is instead.")
    if low >= 0 and value > 0 and (math.isinf(high) or (low > 0 and high / low > 10 ** (2 * DECADES))):
        least, most = max(low, value / 10**DECADES), min(high, value * 10**DECADES)
    elif math.isinf(low) or math.isinf(high):
        w = max(10 * abs(value), 1.0)
        least, most = max(low, -w), min(high, w)
    else:
        least, most = low, high
    return Range(least, most, least > 0 and most / least >= WIDE, name)


def spread(ranges: Sequence[Range], count: int, seed: int) -> np.ndarray:
    """Places spread over the ranges by Latin hypercube, shape (count, unknowns); same seed, same places.

    Each range is cut into ``count`` equal parts (of its logarithm where it says so) and each part is met once.
    Source: McKay, Beckman and Conover, Technometrics 21 (1979) 239.
    """
    if count < 1:
        raise ParameterError(f"the number of places must be at least 1, got {count}.")
    box = Box(ranges)
    return box.thetas(hypercube(np.random.default_rng(seed), count, len(box.ranges)))


def hypercube(rng: np.random.Generator, count: int, unknowns: int) -> np.ndarray:
    """Shares 0 to 1 of shape (count, unknowns), one in each of ``count`` equal parts of every column."""
    cells = rng.permuted(np.tile(np.arange(count), (unknowns, 1)), axis=1).T
    return (cells + rng.random((count, unknowns))) / count
