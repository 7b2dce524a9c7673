"""Estimates as texts: a value and half its confidence interval, rounded to what the uncertainty leaves."""

from __future__ import annotations

import math

from tsmblocks.common.displayed_units import display_unit

SIGNIFICANT = 2
"""Digits of an uncertainty, with which the value is rounded. Source: GUM (JCGM 100:2008), 7.2.6."""
NEGLIGIBLE = 1e-3
"""Share of its uncertainty below which a value is zero. Chosen: its digits say nothing any more."""
LARGEST_PLAIN = 1e5
"""Magnitude below which numbers are written without a power of ten. Chosen: as engineers write them."""
MOST_DECIMALS = 6
"""Decimals from which a number is written with a power of ten. Chosen."""


def decimals(value: float, half: float) -> int:
    """Decimals of an estimate with ``half`` an interval: to the second digit of that, and one digit at least."""
    of_half = SIGNIFICANT - 1 - math.floor(math.log10(half))
    if not abs(value) > NEGLIGIBLE * half:
        return of_half
    return max(of_half, -math.floor(math.log10(abs(value))))


def plus_minus(value: float, half: float, unit: str = "") -> str:
    """An estimate with half its interval, angles in degrees: ``0.157 ± 0.011 deg``. ``half`` is finite, above zero.

    Very small and very large ones share a power of ten: ``(5.047 ± 0.041)e-4 V``.
    """
    k, shown = display_unit("" if unit == "1" else unit)
    value, half = k * value, k * half
    places, largest = decimals(value, half), max(abs(value), half)
    if places <= MOST_DECIMALS and (decimals(0.0, half) >= 0 or largest < LARGEST_PLAIN):
        return f"{_pair(value, half)} {shown}".rstrip()
    power = math.floor(math.log10(largest))
    return f"({_pair(value / 10.0**power, half / 10.0**power)})e{power} {shown}".rstrip()


def _pair(value: float, half: float) -> str:
    return f"{fixed(value, decimals(value, half))} ± {fixed(half, decimals(0.0, half))}"


def fixed(value: float, places: int) -> str:
    """A number rounded to so many decimals, fewer than none being tens, hundreds, …; no negative zero."""
    return f"{round(value, places):z.{max(places, 0)}f}"


def to_digits(value: float, digits: int = 2) -> str:
    """A number in so many digits, without a power of ten where it is of ordinary size: ``400``, not ``4e+02``."""
    return f"{float(f'{value:.{digits}g}'):g}"


def to_digits_below(value: float, digits: int = 2) -> str:
    """A positive number in so many digits, rounded down: what is given as a largest value must hold."""
    if not 0 < value < math.inf:
        return to_digits(value, digits)
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return to_digits(math.floor(value / unit * (1 + 1e-9)) * unit, digits)


def significant(value: float, digits: int = 4) -> str:
    """A number with so many significant digits, trailing zeros included, as a column of a table has them."""
    return f"{value:#.{digits}g}".rstrip(".")
