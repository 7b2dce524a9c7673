"""What is written in a block: its symbol, with the values of its parameters where the block says how."""

from __future__ import annotations

import re
import string
from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Any

import attrs

from tsmblocks.common import displayed_units
from tsmblocks.draw.picture import SMALL, SYMBOL, fitted, text_width, wrapped
from tsmblocks.model.diagram import Diagram

LINE = 14
"""Distance of lines of text in a box [pixels]."""
FRACTION = 13
"""Size of the parts of a fraction [pixels]."""
WIDEST_SYMBOL, WIDEST_FRACTION, WIDEST_TEXT = 110, 200, 140
"""Widths beyond which a symbol is wrapped, values in a fraction are not shown, and a title is cut [pixels]."""
FORMULA, IN_A_FORMULA = re.compile(r"[(/^]"), re.compile(r"(?<![a-z]{2})-|-(?![a-z]{2})", re.IGNORECASE)
"""Signs by which a symbol is a formula, and hyphens in it that denote a minus: not those inside of words."""
SWITCHED = {"enable": "enabled", "trigger": "triggered"}
"""Word in the box of a diagram that is switched, by what switches it."""


UnitOf = Callable[[str], str]
"""The unit of a parameter of a block, by its name; nothing where none is known."""


@attrs.frozen
class Face:
    """The lines in a box, each with the size of its letters; ``stacked`` where the first two make a fraction."""

    lines: tuple[tuple[str, float], ...]
    stacked: bool = False

    @property
    def width(self) -> float:
        """Width of the widest line."""
        return max(text_width(text, size) for text, size in self.lines)

    @property
    def bar(self) -> float:
        """Height of the line in a fraction relative to the middle of the box, downwards positive."""
        return -LINE * (len(self.lines) - 2) / 2

    @property
    def baselines(self) -> list[float]:
        """Baseline of each line relative to the middle of the box, downwards positive."""
        if self.stacked:
            return [self.bar - 5, *(self.bar + 14 + LINE * k for k in range(len(self.lines) - 1))]
        first = 0.36 * self.lines[0][1] - LINE * (len(self.lines) - 1) / 2
        return [first + LINE * k for k in range(len(self.lines))]


def symbol_of(block: Any) -> str:
    """The text in the box without values: the block's symbol, else its class name; with a minus in formulas."""
    symbol = str(getattr(block, "symbol", "") or type(block).__name__)
    return IN_A_FORMULA.sub("−", symbol) if FORMULA.search(symbol) else symbol


def face(block: Any, with_values: bool, unit_of: UnitOf) -> Face:
    """What is written in the box of a block, or of a diagram inside the diagram."""
    if isinstance(block, Diagram):
        kinds = (b.switches for b in block.blocks.values() if not isinstance(b, Diagram))
        switched = [f"({SWITCHED[kind]})" for kind in kinds if kind]
        return _small([*_words(block.title or "diagram"), *switched])
    values = values_of(block, unit_of) if with_values else ""
    symbol, *more = values.split("\n") if values else [symbol_of(block)]
    parts, below = fraction(symbol), tuple((fitted(text, SMALL, 2 * WIDEST_TEXT), float(SMALL)) for text in more)
    if parts and with_values and max(text_width(part, FRACTION) for part in parts) > WIDEST_FRACTION:
        parts = fraction(symbol_of(block))
    if parts:
        return Face((*((part, float(FRACTION)) for part in parts), *below), stacked=True)
    if text_width(symbol, SYMBOL) <= WIDEST_SYMBOL:
        return Face(((symbol, float(SYMBOL)), *below))
    return _small([*_words(symbol), *more])


def values_of(block: Any, unit_of: UnitOf) -> str:
    """The text in the box with the values of parameters; nothing where the block has no such text.

    ``{half_width:unit}`` is a value with its unit, ``{low:value}`` the same without, angles in degrees.
    """
    pattern = str(getattr(block, "symbol_with_values", ""))
    try:
        pattern = re.sub(r"\{(\w+):(unit|value)\}", lambda one: _shown(block, one[1], one[2], unit_of), pattern)
        return Numbers().vformat(pattern, (), block.parameters | block.options).strip() if pattern else ""
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):  # the author's pattern does not fit the block
        return ""


def _shown(block: Any, name: str, how: str, unit_of: UnitOf) -> str:
    """A parameter as displayed; of a unit that depends on a signal of unknown unit only what is known: ``/s``."""
    declared = block.fields()[name].unit
    factor, unit = displayed_units.display_unit(unit_of(name))
    unit = unit or re.sub(r"^\?\w+", "", declared if "/?" not in declared else "")
    return f"{number(factor * getattr(block, name))} {unit if how == 'unit' else ''}".strip()


class Numbers(string.Formatter):
    """Values as a drawing shows them: ``{K}`` a number, ``{num:s}`` a polynomial in s, ``{tau:s}`` a multiple of it."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """One value."""
        if not format_spec:
            return _joined(value) if isinstance(value, Sequence) and not isinstance(value, str) else number(value)
        return polynomial(value if isinstance(value, Sequence) else (value, 0.0), format_spec)


def _joined(values: Sequence[Any]) -> str:
    return ", ".join(map(number, values))


def number(value: Any) -> str:
    """A number of four digits with a proper minus; text as it is."""
    if isinstance(value, str):
        return value
    return re.sub(r"e([+-])0*", r"e\1", f"{float(value):.4g}").replace("e+", "e").replace("-", "−")


SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def polynomial(coefficients: Sequence[float], variable: str) -> str:
    """A polynomial as people write it, the highest power first: ``0.02s²+s+1``."""
    terms = []
    for power, value in zip(reversed(range(len(coefficients))), coefficients, strict=True):
        if value == 0:
            continue
        digits = number(abs(value))
        exponent = "" if power == 1 else str(power).translate(SUPERSCRIPTS)
        text = digits if power == 0 else f"{'' if digits == '1' else digits}{variable}{exponent}"
        terms.append(("−" if value < 0 else "+") + text)
    return "".join(terms).removeprefix("+") or "0"


def fraction(symbol: str) -> tuple[str, ...]:
    """Numerator and denominator of a symbol such as ``1/(Ts+1)``; nothing for any other."""
    depth, cuts = 0, []
    for k, c in enumerate(symbol):
        depth += (c == "(") - (c == ")")
        if c == "/" and depth == 0:
            cuts.append(k)
    parts = (symbol[: cuts[0]], symbol[cuts[0] + 1 :]) if len(cuts) == 1 else ()
    return tuple(_bare(p) for p in parts) if all(p and p == p.strip() for p in parts) else ()


def _bare(text: str) -> str:
    """Without parentheses around the whole."""
    depths = list(accumulate((c == "(") - (c == ")") for c in text))
    return text[1:-1] if text[:1] == "(" and depths.index(0) == len(text) - 1 else text


def _words(text: str) -> list[str]:
    """At most three lines of small text."""
    return wrapped(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", " ".join(text.split())), SMALL + 1, WIDEST_TEXT, 3)


def _small(lines: Sequence[str]) -> Face:
    return Face(tuple((line.strip(), float(SMALL + 1)) for line in lines))
