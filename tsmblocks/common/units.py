"""Unit labels: their meaning, equality, and the factor between them.

Labels only: quantities inside equations are plain numbers in the unit of their port. Radian is a dimension of its own,
which it is not in general unit libraries: a wire that joins ``rad`` to ``1``, or ``rad/s`` to ``1/s``, is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

from tsmblocks.common.errors import TsmError, near

Dimension = tuple[tuple[str, int], ...]

_SIZES: tuple[tuple[dict[str, int], dict[str, float]], ...] = (
    ({}, {"1": 1.0, "%": 0.01}),
    ({"rad": 1}, {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi}),
    ({"rad": 1, "s": -1}, {"rpm": 2 * math.pi / 60}),
    ({"s": 1}, {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}),
    ({"s": -1}, {"Hz": 1.0, "kHz": 1e3}),
    ({"m": 1}, {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}),
    ({"kg": 1}, {"kg": 1.0, "g": 1e-3}),
    ({"A": 1}, {"A": 1.0, "mA": 1e-3}),
    ({"K": 1}, {"K": 1.0}),
    ({"kg": 1, "m": 1, "s": -2}, {"N": 1.0, "mN": 1e-3, "kN": 1e3}),
    ({"kg": 1, "m": 2, "s": -2}, {"Nm": 1.0, "J": 1.0}),
    ({"kg": 1, "m": 2, "s": -3}, {"W": 1.0}),
    ({"kg": 1, "m": 2, "s": -3, "A": -1}, {"V": 1.0, "mV": 1e-3}),
    ({"kg": 1, "m": 2, "s": -3, "A": -2}, {"ohm": 1.0}),
    ({"kg": 1, "m": 2, "s": -2, "A": -2}, {"H": 1.0, "mH": 1e-3}),
)
"""Units of each quantity, which is given by its powers of the base units: label -> size in these."""
_BASE = {label: (size, powers) for powers, sizes in _SIZES for label, size in sizes.items()}
_SPELLINGS = {
    "1": ("", "-"),
    "deg": ("°", "degree", "degrees"),
    "rad": ("radian", "radians"),
    "s": ("sec", "second", "seconds"),
    "ohm": ("Ohm", "Ω"),
    "um": ("µm",),
    "us": ("µs",),
}
_ALIAS = {other: label for label, others in _SPELLINGS.items() for other in others}


class Unit(NamedTuple):
    """A parsed label: ``value_in_SI = factor * value``; ``dimension`` as sorted powers."""

    factor: float
    dimension: Dimension


class UnitError(TsmError):
    """A label that is not a unit, or two units that do not convert."""


@cache
def parse(label: str) -> Unit:
    """Parse ``rad/s``, ``N*m``, ``m/s^2``, ``1/(V*s)``. Raises UnitError with the near miss.

    ``N/m*s`` is refused, since it can mean ``N/(m*s)`` and ``N*s/m``.
    """
    factor, powers = 1.0, dict[str, int]()
    for word, sign in _words(label):
        name, _, power = word.replace("**", "^").replace("²", "^2").partition("^")
        name = _ALIAS.get(name, name)
        if name not in _BASE or not re.fullmatch(r"(-?\d)?", power):
            raise UnitError(f"'{label}' is not a unit known here.{near(name, _BASE)}")
        n = sign * int(power or 1)
        scale, base = _BASE[name]
        factor *= scale**n
        for key, exponent in base.items():
            powers[key] = powers.get(key, 0) + n * exponent
    if not 1e-60 < factor < 1e60:  # powers of powers; a product of a few such would overflow
        raise UnitError(f"'{label}' is not a unit known here: its size cannot be held.")
    return Unit(factor, tuple(sorted((k, n) for k, n in powers.items() if n)))


def _words(label: str) -> Iterator[tuple[str, int]]:
    """The factors of a label, each with 1 in the numerator and -1 in the denominator. Raises UnitError."""
    text = label.strip().replace("μ", "µ")  # the Greek letter for the sign of the same look
    text = re.sub(r"^\(([^()]*)\)$", r"\1", _ALIAS.get(text, text))
    for k, part in enumerate(p.strip() for p in text.split("/")):
        inside = re.fullmatch(r"\(([^()]+)\)", part)
        words = re.split(r"[*·. ]+", (inside[1] if inside else part).strip())
        if k and len(words) > 1 and not inside and not set("()") & set(part):
            over = text.partition("/")[0].strip()
            both = f"{over}/({'*'.join(words)}) or {'*'.join([over, *words[1:]])}/{words[0]}"
            raise UnitError(f"'{label}' can be read in two ways. Write {both}.")
        yield from ((word, -1 if k else 1) for word in words)


def factor(source: str, target: str) -> float:
    """The number that converts a value in ``source`` to ``target`` by multiplication.

    Raises UnitError when the two measure different quantities.
    """
    a, b = parse(source), parse(target)
    if a.dimension != b.dimension:
        raise UnitError(f"'{source}' does not convert to '{target}'.{_turns(a, b)}")
    return a.factor / b.factor


def _turns(a: Unit, b: Unit) -> str:
    """A hint where two units differ by an angle alone: ``1/min`` is a rate of anything."""
    without = [tuple(one for one in unit.dimension if one[0] != "rad") for unit in (a, b)]
    return " Revolutions per minute are rpm, those per second rev/s." if without == [(("s", -1),)] * 2 else ""


def same(a: str, b: str) -> bool:
    """Whether two labels denote the same unit, up to rounding of the factor."""
    x, y = parse(a), parse(b)
    return x.dimension == y.dimension and math.isclose(x.factor, y.factor, rel_tol=1e-12)


DISPLAY_UNITS = {"rad": "deg", "rad/s": "deg/s", "rad/s^2": "deg/s^2"}
"""Unit -> unit in which it is displayed."""


def display_unit(label: str) -> tuple[float, str]:
    """Factor and unit for display: angles and their rates in degrees, anything else unchanged."""
    wanted = DISPLAY_UNITS.get(label, label)
    return (factor(label, wanted) if wanted != label else 1.0), wanted


def times(label: str, power_of: str, exponent: int = 1) -> str:
    """A readable label for ``label * power_of**exponent`` (used for rates and integrals)."""
    if label in ("", "1"):
        return power_of if exponent == 1 else f"1/{power_of}"
    if exponent == 1:
        over, slash, under = label.partition("/")
        return label.removesuffix(f"/{power_of}") if under == power_of else f"{over}*{power_of}{slash}{under}"
    if label.endswith(f"*{power_of}"):
        return label.removesuffix(f"*{power_of}")
    match = re.fullmatch(rf"(.*)/{re.escape(power_of)}(?:\^(\d+))?", label)
    return f"{match[1]}/{power_of}^{int(match[2] or 1) + 1}" if match else f"{label}/{power_of}"


_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?\s*", re.DOTALL)


def split_heading(text: str) -> tuple[str, str]:
    """Name and unit of ``"x_in [deg]"`` or ``"x_in (deg)"``; the unit is ``""`` when none is given."""
    match = _HEADING.fullmatch(text)
    assert match is not None  # every part is optional
    return match[1], (match[2] or match[3] or "").strip()


def heading(name: str, unit: str) -> str:
    """``name [unit]``, or the name alone when no unit is known."""
    return f"{name} [{unit}]" if unit else name


def unambiguous_heading(name: str, unit: str) -> str:
    """The heading; with empty brackets where a name alone would be split: ``f(x) []`` is not ``f`` in ``x``."""
    plain = heading(name, unit)
    return plain if split_heading(plain) == (name, unit) else f"{name} [{unit}]"
