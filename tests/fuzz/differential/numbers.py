"""Numbers that carry their rate in time, and the functions that the equations of the reference use on them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any


class Dual:
    """A value and its time derivative."""

    __slots__ = ("rate", "value")

    def __init__(self, value: float, rate: float) -> None:
        self.value, self.rate = value, rate

    def __add__(self, other: Any) -> Dual:
        return Dual(self.value + plain(other), self.rate + rate(other))

    def __sub__(self, other: Any) -> Dual:
        return Dual(self.value - plain(other), self.rate - rate(other))

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.value, -self.rate)

    def __mul__(self, other: Any) -> Dual:
        return Dual(self.value * plain(other), self.rate * plain(other) + self.value * rate(other))

    def __truediv__(self, other: Any) -> Dual:
        below = plain(other)
        return Dual(self.value / below, (self.rate - self.value / below * rate(other)) / below)

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual(other, 0.0) / self

    def __pow__(self, power: float) -> Dual:
        return Dual(self.value**power, power * self.value ** (power - 1) * self.rate)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.rate)

    __radd__, __rmul__ = __add__, __mul__


def plain(number: Any) -> float:
    """The value alone."""
    return number.value if isinstance(number, Dual) else number


def rate(number: Any) -> float:
    """The rate; zero for a plain number."""
    return number.rate if isinstance(number, Dual) else 0.0


def _lifted(function: Callable[[float], float], slope: Callable[[float], float]) -> Callable[[Any], Any]:
    """A function of one number for numbers with rates, too."""

    def lifted(a: Any) -> Any:
        return Dual(function(a.value), slope(a.value) * a.rate) if isinstance(a, Dual) else function(a)

    return lifted


def sign_of(a: float) -> float:
    """1, -1, or 0 at zero."""
    return float((a > 0) - (a < 0))


def _log1pexp(a: float) -> float:
    return max(a, 0.0) + math.log1p(math.exp(-abs(a)))


tanh = _lifted(math.tanh, lambda a: 1.0 - math.tanh(a) ** 2)
sin = _lifted(math.sin, math.cos)
cos = _lifted(math.cos, lambda a: -math.sin(a))
exp = _lifted(math.exp, math.exp)
magnitude = _lifted(abs, sign_of)
softplus = _lifted(_log1pexp, lambda a: 0.5 * (1.0 + math.tanh(0.5 * a)))
"""ln(1 + e^a), which cannot overflow."""


def larger(a: Any, b: Any) -> Any:
    """The larger of two numbers."""
    return a if plain(a) >= plain(b) else b


def smaller(a: Any, b: Any) -> Any:
    """The smaller of two numbers."""
    return a if plain(a) <= plain(b) else b


def sgn(a: Any) -> float:
    """1, -1, or 0 at zero: constant wherever it has a rate."""
    return sign_of(plain(a))


def floor(a: Any) -> float:
    """The whole number below: constant wherever it has a rate."""
    return float(math.floor(plain(a)))


def within(a: Any, low: float, high: float) -> Any:
    """A number between limits."""
    return smaller(larger(a, low), high)
