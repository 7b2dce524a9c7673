"""The units in which values are displayed, and those of rates and integrals of displayed signals.

A label may say the unit of a recording in which its values are displayed; equations do not know of it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable

from tsmblocks.common.units import factor, is_unit, parse, per


class DisplayedUnit(str):
    """The label of a unit that is displayed in another one of the same quantity: that of a recording, for example."""

    shown: str

    def __new__(cls, label: str, shown: str) -> DisplayedUnit:
        """The label, to be displayed as ``shown``."""
        one = super().__new__(cls, label)
        one.shown = shown
        return one

    def __reduce__(self) -> tuple[type[DisplayedUnit], tuple[str, str]]:
        return DisplayedUnit, (str(self), self.shown)


DISPLAY_UNITS = {"rad": "deg"}
"""Unit -> unit in which it is displayed. Speeds in rad/s, mostly those of motors, are displayed as they are."""


def display_unit(label: str) -> tuple[float, str]:
    """Factor and unit for display: that of a recording where the label has one, angles in degrees, all else as it is.

    Rates of a signal (``times``, ``unit_over``) are displayed as the signal is: that of an angle in deg/s.
    """
    wanted = label.shown if isinstance(label, DisplayedUnit) else DISPLAY_UNITS.get(label, label)
    return (factor(label, wanted) if wanted != label else 1.0), wanted


def displayed_in(label: str, recorded: Iterable[str]) -> str:
    """The label, displayed in the first of some units that measures the same quantity; as it is where none does.

    An empty label is that of no unit, and no pure number that another one measures.
    """
    if not label or not is_unit(label):
        return label
    alike = (one for one in recorded if one and is_unit(one) and parse(one).dimension == parse(label).dimension)
    _, shown = display_unit(next(alike, label))
    return label if shown == display_unit(label)[1] else DisplayedUnit(str(label), shown)


def _derived(label: str, unit: Callable[[str], str]) -> str:
    """The unit of a quantity derived from a signal, displayed in the unit derived from that of the signal."""
    made, shown = unit(str(label)), unit(display_unit(label)[1])
    return made if shown == made else DisplayedUnit(made, shown)


def unit_over(label: str, below: str) -> str:
    """The label over another one, ``deg/min``; displayed as the label above is, and as a recorded signal below."""
    if isinstance(below, DisplayedUnit):
        return DisplayedUnit(per(label, below), per(display_unit(label)[1], below.shown))
    return _derived(label, lambda above: per(above, below))


def times(label: str, power_of: str, exponent: int = 1) -> str:
    """A readable label for ``label * power_of**exponent`` (used for rates and integrals).

    A rate is displayed as the signal is, an integral of a recorded signal too.
    """
    if isinstance(label, DisplayedUnit) or (power_of == "s" and exponent == -1):
        return _derived(label, lambda unit: _times(unit, power_of, exponent))
    return _times(label, power_of, exponent)


def _times(label: str, power_of: str, exponent: int) -> str:
    """As ``times``, of a plain label."""
    if label in ("", "1"):
        return power_of if exponent == 1 else f"1/{power_of}"
    if exponent == 1:
        over, slash, under = label.partition("/")
        if match := re.fullmatch(rf"{re.escape(power_of)}\^(\d+)", under):
            return f"{over}/{power_of}" + (f"^{int(match[1]) - 1}" if int(match[1]) > 2 else "")
        return label.removesuffix(f"/{power_of}") if under == power_of else f"{over}*{power_of}{slash}{under}"
    if label.endswith(f"*{power_of}"):
        return label.removesuffix(f"*{power_of}")
    match = re.fullmatch(rf"(.*)/{re.escape(power_of)}(?:\^(\d+))?", label)
    return f"{match[1]}/{power_of}^{int(match[2] or 1) + 1}" if match else f"{label}/{power_of}"


PREFIXED = ("s", "Hz", "m", "N", "A", "V", "W", "J", "Pa", "ohm", "H", "Nm")
"""Units that take a prefix on an axis."""
PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}
PLAIN_FROM, PLAIN_TO = 0.1, 1e4
"""Sizes between which a unit has no prefix. Chosen: 0.25 V and 2500 N are as easily read as 250 mV and 2.5 kN."""


def axis_unit(label: str, size: float) -> tuple[float, str]:
    """Factor and unit for an axis whose largest magnitude is ``size``: as displayed, with an SI prefix where it helps.

    Units that have a prefix already, powers and quotients with such a numerator keep it; seconds have no thousands.
    """
    k, wanted = display_unit(label)
    word = re.split(r"[^A-Za-z]", wanted, maxsplit=1)[0]
    size = abs(k * size)
    plain_size = size == 0 or not math.isfinite(size) or PLAIN_FROM <= size < PLAIN_TO
    if plain_size or word not in PREFIXED or wanted[len(word) :].startswith(("^", "²", "**")):
        return k, wanted
    prefix = max((one for one in PREFIXES if one <= size * (1 + 1e-9)), default=min(PREFIXES))
    if word == "s" and prefix > 1:
        return k, wanted
    return k / prefix, PREFIXES[prefix] + wanted
