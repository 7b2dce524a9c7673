"""Unit labels: their meaning, equality, and the factor between them.

Labels only: quantities inside equations are plain numbers in the unit of their port. Radian is a separate dimension,
which it is not in general unit libraries: a wire that joins ``rad`` to ``1``, or ``rad/s`` to ``1/s``, is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
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


def per(above: str, below: str) -> str:
    """A label over another one, that in parentheses where it is a product or a quotient: ``m/(m/s^2)``."""
    if "(" in below:
        return quotient(above, below)
    return f"{above}/({below})" if re.search(r"[/*·. ]", below) else f"{above}/{below}"


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


_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?\s*", re.DOTALL)


def split_heading(text: str) -> tuple[str, str]:
    """Name and unit of ``"x_in [deg]"`` or ``"x_in (deg)"``; the unit is ``""`` when none is given.

    Round brackets that hold no unit belong to the name: ``x (cmd)``, and ``angle (m2)``, which is that of motor 2.
    """
    match = _HEADING.fullmatch(text)
    assert match is not None  # every part is optional
    if match[3] is not None and (not is_unit(match[3]) or re.fullmatch(r"\s*\w+[23]\s*", match[3])):
        return text.strip(), ""
    return match[1], (match[2] or match[3] or "").strip()


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


def heading(name: str, unit: str) -> str:
    """``name [unit]``, or the name alone when no unit is known."""
    return f"{name} [{unit}]" if unit else name


def unambiguous_heading(name: str, unit: str) -> str:
    """The heading; with empty brackets where a name alone would be split: ``f(x) []`` is not ``f`` in ``x``."""
    plain = heading(name, unit)
    return plain if split_heading(plain) == (name, unit) else f"{name} [{unit}]"
