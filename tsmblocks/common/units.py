"""Unit labels: their meaning, equality, and the factor between them.

Labels only: quantities inside equations are plain numbers in the unit of their port. Radian is a separate dimension,
which it is not in general unit libraries: a wire that joins ``rad`` to ``1``, or ``rad/s`` to ``1/s``, is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from typing import NamedTuple

from tsmblocks.common.errors import TsmError, in_words, near

Dimension = tuple[tuple[str, int], ...]

INCH, POUND, GRAVITY = 0.0254, 0.45359237, 9.80665
"""Inch [m], avoirdupois pound [kg] and standard gravity [m/s^2]: exact, by their definitions of 1959 and 1901."""

_SIZES: tuple[tuple[dict[str, int], dict[str, float]], ...] = (
    ({}, {"1": 1.0, "%": 0.01}),
    (
        {"rad": 1},
        {
            "rad": 1.0,
            "mrad": 1e-3,
            "urad": 1e-6,
            "deg": math.pi / 180,
            "arcmin": math.pi / 10800,
            "arcsec": math.pi / 648000,
            "rev": 2 * math.pi,
        },
    ),
    ({"rad": 1, "s": -1}, {"rpm": 2 * math.pi / 60}),
    ({"s": 1}, {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}),
    ({"s": -1}, {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}),
    ({"m": 1}, {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": INCH, "ft": 12 * INCH}),
    ({"m": 3}, {"l": 1e-3, "ml": 1e-6}),
    ({"kg": 1}, {"kg": 1.0, "g": 1e-3, "lb": POUND}),
    ({"A": 1}, {"A": 1.0, "mA": 1e-3, "uA": 1e-6}),
    ({"K": 1}, {"K": 1.0}),
    ({"degC": 1}, {"degC": 1.0}),  # apart from K, from which it differs by an offset
    (
        {"kg": 1, "m": 1, "s": -2},
        {
            "N": 1.0,
            "mN": 1e-3,
            "kN": 1e3,
            "MN": 1e6,
            "lbf": POUND * GRAVITY,
            "kip": 1e3 * POUND * GRAVITY,
            "kgf": GRAVITY,
        },
    ),
    (
        {"kg": 1, "m": -1, "s": -2},
        {
            "Pa": 1.0,
            "hPa": 1e2,
            "kPa": 1e3,
            "MPa": 1e6,
            "GPa": 1e9,
            "bar": 1e5,
            "mbar": 1e2,
            "atm": 101325.0,
            "psi": POUND * GRAVITY / INCH**2,
            "ksi": 1e3 * POUND * GRAVITY / INCH**2,
        },
    ),
    ({"kg": 1, "m": 2, "s": -2}, {"Nm": 1.0, "J": 1.0, "kJ": 1e3}),
    ({"kg": 1, "m": 2, "s": -3}, {"W": 1.0, "mW": 1e-3, "kW": 1e3, "hp": 550 * POUND * GRAVITY * 12 * INCH}),
    ({"kg": 1, "m": 2, "s": -3, "A": -1}, {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3}),
    ({"kg": 1, "m": 2, "s": -3, "A": -2}, {"ohm": 1.0}),
    ({"kg": 1, "m": 2, "s": -2, "A": -2}, {"H": 1.0, "mH": 1e-3}),
)
"""Units of each quantity, which is given by its powers of the base units: label -> size in these."""
_BASE = {label: (size, powers) for powers, sizes in _SIZES for label, size in sizes.items()}
NAMES = tuple(_BASE)
"""Every unit that has a name."""
_SPELLINGS = {
    "1": ("", "-"),
    "%": ("percent", "pct"),
    "deg": ("°", "degree", "degrees"),
    "rad": ("radian", "radians"),
    "s": ("sec", "second", "seconds"),
    "ohm": ("Ohm", "Ω"),
    "um": ("µm",),
    "us": ("µs",),
    "urad": ("µrad",),
    "uA": ("µA",),
    "uV": ("µV",),
    "h": ("hr", "hour", "hours"),
    "min": ("minute", "minutes"),
    "rev": ("turn", "turns", "revolution", "revolutions"),
    "rpm": ("RPM", "r/min", "U/min"),
    "in": ("inch", "inches", '"'),
    "ft": ("foot", "feet"),
    "m": ("meter", "meters", "metre", "metres"),
    "l": ("L", "liter", "litre"),
    "lb": ("lbs", "lbm", "pound", "pounds"),
    "lbf": ("lb_f", "lbs-force", "pound-force"),
    "kip": ("kips", "klbf"),
    "lbf*ft": ("ft-lb", "ft-lbf", "lb-ft", "lbf-ft"),
    "lbf*in": ("in-lb", "in-lbf", "lb-in", "lbf-in"),
    "N": ("newton", "newtons"),
    "degC": ("°C", "celsius", "Celsius"),
    "V": ("volt", "volts"),
    "A": ("amp", "amps", "ampere"),
    "bar": ("bars",),
}
_ALIAS = {other: label for label, others in _SPELLINGS.items() for other in others}


def by_quantity() -> dict[str, dict[str, float]]:
    """The units that have a name and their sizes, by the base unit of each quantity: ``{"m": {"m": 1.0, "km": …}}``."""
    return {base_unit(next(iter(sizes))): dict(sizes) for _, sizes in _SIZES}


def spellings() -> dict[str, tuple[str, ...]]:
    """What else may be written for a unit, or for a product of units such as ``lbf*ft``."""
    return {label: tuple(filter(None, others)) for label, others in _SPELLINGS.items()}


class Unit(NamedTuple):
    """A parsed label: ``value_in_SI = factor * value``; ``dimension`` as sorted powers."""

    factor: float
    dimension: Dimension


class UnitError(TsmError):
    """A label that is not a unit, or two units that do not convert."""


def parse(label: str) -> Unit:
    """Parse ``rad/s``, ``N*m``, ``m/s^2``, ``1/(V*s)``, ``m/(m/s^2)``. Raises UnitError with the near miss.

    ``N/m*s`` is refused, since it can mean ``N/(m*s)`` and ``N*s/m``. A number in front is a factor: ``0.0254*m^2``.
    """
    if not isinstance(label, str):
        raise UnitError(f"a unit must be text such as 'rad/s', got {in_words(label)}.")
    return _parsed(label)


@cache
def _parsed(label: str) -> Unit:
    """As ``parse``, of a text."""
    if scaled := re.fullmatch(r"(\d+(?:\.\d+)?(?:e[-+]?\d+)?)\*(.+)", label):
        return Unit(float(scaled[1]) * parse(scaled[2]).factor, parse(scaled[2]).dimension)
    factor, powers = 1.0, dict[str, int]()
    for word, sign in _words(label):
        name, power = _name_and_power(word)
        name = _ALIAS.get(name, name)
        if name not in _BASE or not re.fullmatch(r"(-?\d)?", power):
            raise UnitError(f"'{label}' is not a unit known here.{near(name, _BASE)}")
        n = sign * int(power or 1)
        scale, base = _BASE[name]
        factor *= scale**n
        for key, exponent in base.items():
            powers[key] = powers.get(key, 0) + n * exponent
    if not 1e-60 < factor < 1e60:  # powers of powers; a product of a few such would overflow
        raise UnitError(f"'{label}' is not a unit known here: its size is out of range.")
    return Unit(factor, _sorted({k: n for k, n in powers.items() if n}))


def _words(label: str) -> Iterator[tuple[str, int]]:
    """The factors of a label, each with 1 in the numerator and -1 in the denominator. Raises UnitError."""
    text = label.strip().replace("μ", "µ")  # the Greek letter for the sign of the same look
    text = re.sub(r"^\(([^()]*)\)$", r"\1", _ALIAS.get(text, text))
    if quotients := re.fullmatch(r"([^()]+)/\(([^()]+/[^()]+)\)", text):  # m/(m/s^2)
        yield from (*_words(quotients[1]), *((word, -sign) for word, sign in _words(quotients[2])))
        return
    for k, part in enumerate(p.strip() for p in text.split("/")):
        inside = re.fullmatch(r"\(([^()]+)\)", part)
        words = re.split(r"[*·. ]+", (inside[1] if inside else part).strip())
        if k and len(words) > 1 and not inside and not set("()") & set(part):
            over = text.partition("/")[0].strip()
            both = f"{over}/({'*'.join(words)}) or {'*'.join([over, *words[1:]])}/{words[0]}"
            raise UnitError(f"'{label}' can be read in two ways. Write {both}.")
        yield from ((word, -1 if k else 1) for word in words)


def _name_and_power(word: str) -> tuple[str, str]:
    """A unit and its power, of ``s^2``, ``s**2``, ``s²`` or ``s2``; the power is empty where there is none."""
    name, _, power = word.replace("**", "^").replace("²", "^2").replace("³", "^3").partition("^")
    plain = re.fullmatch(r"([A-Za-zµΩ]+)([23])", name)
    known = plain is not None and not power and (plain[1] in _BASE or plain[1] in _ALIAS)
    return (plain[1], plain[2]) if plain and known else (name, power)


def factor(source: str, target: str) -> float:
    """The factor that converts a value in ``source`` to ``target``. Raises UnitError for different quantities."""
    a, b = parse(source), parse(target)
    if a.dimension != b.dimension:
        raise UnitError(f"'{source}' does not convert to '{target}'.{_hint(a, b)}")
    return a.factor / b.factor


def _hint(a: Unit, b: Unit) -> str:
    """A hint where two units differ by an angle alone, as ``1/min`` does, or by the zero of a temperature."""
    if {a.dimension, b.dimension} == {(("K", 1),), (("degC", 1),)}:
        return " They differ by an offset: use one of them in the diagram and in the recordings."
    without = [tuple(one for one in unit.dimension if one[0] != "rad") for unit in (a, b)]
    return " Revolutions per minute are rpm, those per second rev/s." if without == [(("s", -1),)] * 2 else ""


def same(a: str, b: str) -> bool:
    """Whether two labels denote the same unit, up to rounding of the factor."""
    x, y = parse(a), parse(b)
    return x.dimension == y.dimension and math.isclose(x.factor, y.factor, rel_tol=1e-12)


def base_unit(label: str) -> str:
    """The unit of the same quantity without a factor: ``rad/s`` for ``deg/s``, ``m`` for ``mm``, ``Pa`` for ``psi``."""
    unit = parse(label)
    if unit.factor == 1:
        return label
    total = dict[str, int]()
    for word, sign in _words(label):
        name, power = _name_and_power(word)
        _, powers = _BASE[_ALIAS.get(name, name)]
        plain = next((k for k, (size, same_powers) in _BASE.items() if size == 1 and same_powers == powers), None)
        for key, n in {plain: 1}.items() if plain else powers.items():
            total[key] = total.get(key, 0) + sign * int(power or 1) * n
    return _spelled(total)


def _sorted(powers: dict[str, int]) -> Dimension:
    return tuple(sorted(powers.items()))


def per(above: str, below: str) -> str:
    """A label over another one, that in parentheses where it is a product or a quotient: ``m/(m/s^2)``."""
    if "(" in below:
        return quotient(above, below)
    return f"{above}/({below})" if re.search(r"[/*·. ]", below) else f"{above}/{below}"


def quotient(above: str, below: str) -> str:
    """A readable label for one unit over another, ``kN/mm``; empty where they are one, or one is not known."""
    if not above or not below or same(above, below):
        return ""
    powers = dict[str, int]()
    for label, side in ((above, 1), (below, -1)):
        for word, sign in _words(label):
            name, power = _name_and_power(word)
            powers[name] = powers.get(name, 0) + side * sign * int(power or 1)
    return _spelled(powers)


def _spelled(powers: Mapping[str, int]) -> str:
    """The label of a product of powers of units, in their order."""
    above = [k if n == 1 else f"{k}^{n}" for k, n in powers.items() if n > 0 and k != "1"]
    below = [k if n == -1 else f"{k}^{-n}" for k, n in powers.items() if n < 0 and k != "1"]
    under = f"({'*'.join(below)})" if len(below) > 1 else "".join(below)
    return f"{'*'.join(above) or '1'}{f'/{under}' if under else ''}"


def is_unit(label: str) -> bool:
    """Whether a label is a unit that is known here."""
    try:
        parse(label)
    except UnitError:
        return False
    return True


def is_one_of(unit: str, dimensions: Collection[Dimension]) -> bool:
    """Whether a unit is known, and has one of these dimensions."""
    return bool(unit) and is_unit(unit) and parse(unit).dimension in dimensions
