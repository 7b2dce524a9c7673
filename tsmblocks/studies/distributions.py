"""Distributions of a parameter: uniform, log-uniform, normal, truncated normal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import ParameterError, in_words


def _finite(value: Any) -> float:
    return as_number("a number of Uniform or Normal", value, ParameterError)


def _bound(value: Any) -> float:
    return value if isinstance(value, float) and math.isinf(value) else _finite(value)


@attrs.frozen
class Uniform:
    """A uniform distribution of a parameter.

    Raises ParameterError when the bounds are not in order, or not finite.

    Parameters
    ----------
    low, high : float
        Its bounds, in the unit of the parameter.
    log : bool, default False
        Whether the logarithm is uniform; then ``low`` is above 0.
    """

    low: float = attrs.field(converter=_finite)
    high: float = attrs.field(converter=_finite)
    log: bool = False

    def __attrs_post_init__(self) -> None:
        if not self.low < self.high or not math.isfinite(self.high - self.low):
            raise ParameterError(f"low must be below high, got low={self.low:g}, high={self.high:g}.")
        if self.log and self.low <= 0:
            raise ParameterError(f"Uniform with log=True needs low > 0, got low={self.low:g}.")

    def quantile(self, q: np.ndarray) -> np.ndarray:
        """Return quantiles of the distribution.

        Parameters
        ----------
        q : ndarray
            Probabilities, from 0 to 1.

        Returns
        -------
        ndarray
            The values, of the shape of ``q``.
        """
        if self.log:
            return self.low * (self.high / self.low) ** q
        return self.low + (self.high - self.low) * q


@attrs.frozen
class Normal:
    """A normal distribution of a parameter, truncated at bounds.

    Raises ParameterError when a number is not finite, or the bounds are not in order.

    Parameters
    ----------
    mean, deviation : float
        Mean and standard deviation (above 0) before it is truncated.
    low, high : float, default -inf and inf
        Bounds.
    """

    mean: float = attrs.field(converter=_finite)
    deviation: float = attrs.field(converter=_finite)
    low: float = attrs.field(default=-math.inf, converter=_bound)
    high: float = attrs.field(default=math.inf, converter=_bound)

    def __attrs_post_init__(self) -> None:
        if not self.deviation > 0 or not math.isfinite(self.mean + self.deviation):
            raise ParameterError(f"Normal needs a deviation > 0, got mean={self.mean:g}, deviation={self.deviation:g}.")
        if not self.low < self.high:
            raise ParameterError(f"Normal needs low < high, got low={self.low:g}, high={self.high:g}.")

    def quantile(self, q: np.ndarray) -> np.ndarray:
        """Return quantiles of the distribution. Raises ParameterError when no probability lies between the bounds.

        Parameters
        ----------
        q : ndarray
            Probabilities, from 0 to 1.

        Returns
        -------
        ndarray
            The values, of the shape of ``q``.
        """
        from scipy.special import ndtr, ndtri

        below, above = (float(ndtr((end - self.mean) / self.deviation)) for end in (self.low, self.high))
        if not below < above:
            raise ParameterError(
                f"Normal(mean={self.mean:g}, deviation={self.deviation:g}) has nothing between "
                f"{self.low:g} and {self.high:g}."
            )
        values = self.mean + self.deviation * ndtri(below + (above - below) * q)
        return np.clip(values, self.low, self.high)


Distribution = Uniform | Normal
"""A distribution of a parameter."""


def uniform_between(name: str, low: Any, high: Any, log: bool = False) -> Uniform:
    """A uniform distribution between two bounds. Raises ParameterError that names the parameter."""
    try:
        return Uniform(low, high, log=log)
    except ParameterError as error:
        raise ParameterError(f"bounds of '{name}': {error}") from None


def distributions(given: Any) -> dict[str, Distribution]:
    """The distribution of each parameter; a pair is uniform. Raises ParameterError."""
    if not isinstance(given, Mapping) or not given:
        raise ParameterError(
            f"no parameter varies: write {{'tsm.theta': (4, 6)}} or {{'tsm.theta': Normal(5, 0.5)}}, got "
            f"{in_words(given)}."
        )
    made: dict[str, Distribution] = {}
    for name, one in given.items():
        if isinstance(one, (tuple, list)) and len(one) == 2:
            one = uniform_between(str(name), *one)
        if not isinstance(one, (Uniform, Normal)):
            raise ParameterError(f"'{name}' varies by (low, high), Uniform or Normal, got {in_words(one)}.")
        made[str(name)] = one
    return made
