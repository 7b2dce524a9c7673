"""What a block may declare: ports, states, and numbers with meaning, unit and bounds.

One declaration serves the message, the fit's default bounds, the file format, the axis label
and the generated bad-value test, so a fact about a block stands in its class and nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, in_words, near


@attrs.frozen
class Input:
    """A port a signal comes in by.

    ``unit`` may be a label (``"rad/s"``), ``""`` for anything, or hold a unit of the block's own
    (``"?u"``, ``"?u/s"``): ports with the same letter must then agree, whatever they carry.
    With ``rate_of`` the port is the time derivative of that port and may stay unconnected: it is
    then formed exactly, by differentiating the expression of the driving signal. A rate may have a rate.
    ``unit_option`` is the option of the block that says another unit, where it is not empty.
    """

    about: str
    unit: str = ""
    rate_of: str = ""
    unit_option: str = ""


@attrs.frozen
class Output:
    """A port a signal goes out by. ``unit`` and ``unit_option`` as for Input."""

    about: str
    unit: str = ""
    unit_option: str = ""


@attrs.frozen
class Tape:
    """A signal that the equations read and that ``tapes`` supplies as samples (noise, a recording)."""

    about: str


@attrs.frozen
class Past:
    """The value that port ``of`` had, ``by`` seconds ago (``by`` names a parameter).

    Before the run began the port is taken to have had the value of the parameter ``initial``, or with
    ``first`` its first value. ``by`` may not be shorter than a step, unless ``now``: then the present value
    takes part, any time from 0 on will do, and the block passes the port on at the same instant.
    """

    about: str
    of: str
    by: str
    initial: str
    now: bool = False
    first: bool = False


@attrs.frozen
class State:
    """A state: its start value (a number, or a symbol in the twin), meaning and unit."""

    start: Any
    about: str
    unit: str = ""


@attrs.frozen(eq=False)
class Samples:
    """A signal known at instants ``t`` [s] only; ``hold`` says what it is in between.

    ``hold`` is ``"zero"``, ``"linear"`` or ``"cubic"``. A run may not reach beyond the instants, save
    that a zero-order hold keeps its last value.
    """

    t: np.ndarray
    y: np.ndarray
    hold: str = "linear"


@attrs.frozen
class Field:
    """What is known of one field of a block besides its value."""

    kind: str  # "parameter", "option" or "state"
    about: str
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    finite: bool = True
    choices: tuple[Any, ...] = ()
    default: Any = None
    known: bool = False

    @property
    def low(self) -> float:
        """Lower bound, whether or not it may be reached itself."""
        return max(self.above, self.at_least)

    @property
    def high(self) -> float:
        """Upper bound, whether or not it may be reached itself."""
        return min(self.below, self.at_most)

    def allows(self, value: float) -> bool:
        """Whether one number lies within the bounds (NaN never does)."""
        if math.isinf(value):
            return not self.finite and value == (self.low if value < 0 else self.high)
        return self.above < value < self.below and self.at_least <= value <= self.at_most

    def bounds(self) -> str:
        """The bounds in interval notation."""
        left = f"({self.above:g}" if self.above >= self.at_least else f"[{self.at_least:g}"
        right = f"{self.below:g})" if self.below <= self.at_most else f"{self.at_most:g}]"
        return f"{left}, {right}"


def _field(default: Any, spec: Field) -> Any:
    default = default if type(default) is int and spec.kind == "option" else plain(default)
    return attrs.field(default=default, metadata={"tsm": attrs.evolve(spec, default=default)})


def parameter(
    *,
    default: Any,
    about: str,
    unit: str = "",
    above: float = -math.inf,
    below: float = math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    finite: bool = True,
    known: bool = False,
) -> Any:
    """A number (or a tuple of numbers, or of rows) that stays a symbol until the run.

    It can therefore be swept, fitted and differentiated. ``above``/``below`` exclude the bound
    itself, ``at_least``/``at_most`` include it; they apply to each element of a tuple.
    ``finite=False`` admits an infinity where no bound stands in its way (a limit that never acts).
    ``known`` is for what is read off a data sheet, or is a matter of choice: a fit leaves it as it is unless it is
    named.
    """
    return _field(default, Field("parameter", about, unit, above, below, at_least, at_most, finite, known=known))


def option(
    *,
    default: Any,
    about: str,
    unit: str = "",
    choices: tuple[Any, ...] = (),
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> Any:
    """A choice that shapes the equations (a sign string, an order, a period); never a symbol."""
    return _field(
        default, Field("option", about, unit, above=above, at_least=at_least, at_most=at_most, choices=choices)
    )


def state(*, default: float, about: str, unit: str = "") -> Any:
    """A state; the field's value is where it starts. It may be fitted like a parameter."""
    return _field(default, Field("state", about, unit))


# ---- values -----------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """Numbers as float, sequences and arrays as tuples; anything else as it came."""
    if isinstance(value, np.ndarray):
        value = value.tolist()  # of an array without a dimension, the number
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (list, tuple)):
        return tuple(plain(v) for v in value)
    if isinstance(value, (int, float, np.integer, np.floating)):
        try:
            return float(value)
        except OverflowError:  # a whole number of hundreds of digits
            return math.inf if value > 0 else -math.inf
    return value


def is_reference(value: Any) -> bool:
    """Whether a parameter stands for a number of the diagram's ``values`` table (``"$theta"``)."""
    return isinstance(value, str) and value.startswith("$")


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The single numbers of a parameter, with names: ``den`` gives ``den[0]``, ``den[1]``, …"""
    if isinstance(value, tuple):
        for k, v in enumerate(value):
            yield from leaves(v, f"{name}[{k}]")
    else:
        yield name, value


def map_leaves(f: Callable[[str, Any], Any], value: Any, name: str = "") -> Any:
    """The same nesting with ``f(name, leaf)`` in the place of each leaf."""
    if isinstance(value, tuple):
        return tuple(map_leaves(f, v, f"{name}[{k}]") for k, v in enumerate(value))
    return f(name, value)


# ---- checks ------------------------------------------------------------------------------------


def validate(owner: str, name: str, field: Field, value: Any) -> None:
    """Raise ParameterError unless ``value`` is of the kind of the default and within the bounds."""
    fault = _fault(name, field, value)
    if fault:
        unit = f" [{field.unit}]" if field.unit and "?" not in field.unit else ""
        raise ParameterError(f"{owner}.{fault} It is: {field.about}{unit}.")


def _fault(name: str, field: Field, value: Any) -> str:
    """What is wrong with the value of a field, as a sentence that begins with the field's name."""
    if field.kind == "option" and is_reference(value):
        return f"{name} is an option, and only a parameter can refer to values, got {in_words(value)}."
    if field.choices:
        known = value in field.choices
        return "" if known else f"{name} is {in_words(value)}, which is not a choice.{near(value, field.choices)}"
    wanted = type(field.default)
    if wanted is int:
        whole = isinstance(value, float) and value.is_integer() and field.allows(value)
        return "" if whole else f"{name} must be a whole number in {field.bounds()}, got {in_words(value)}."
    if field.kind == "option" and wanted is not float:
        words = {str: "text", bool: "true or false", tuple: "a list"}.get(wanted, "")
        return f"{name} must be {words}, got {in_words(value)}." if words and type(value) is not wanted else ""
    if isinstance(value, tuple) != (wanted is tuple):
        words = "a list of numbers" if wanted is tuple else "a number"
        return f"{name} must be {words}, got {in_words(value)}."
    faults = (_number_fault(leaf, field, number) for leaf, number in leaves(value, name) if not is_reference(number))
    return next(filter(None, faults), "")


def _number_fault(name: str, field: Field, number: Any) -> str:
    if not isinstance(number, float) or math.isnan(number):
        return f"{name} must be a number, got {in_words(number)}."
    if field.allows(number):
        return ""
    if math.isinf(number) and field.low < 0 < field.high and math.isinf(field.low if number < 0 else field.high):
        return f"{name} must be finite, got {number:g}."
    return f"{name} must lie in {field.bounds()}, got {number:g}."
