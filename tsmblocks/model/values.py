"""Values of the fields of a block: one form of each, the single numbers in it, and the check by its declaration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from tsmblocks.common.errors import ParameterError, in_words, near

if TYPE_CHECKING:
    from tsmblocks.model.fields import Field

MOST_EXACT = 2**53
"""Size from which a double does not hold every whole number."""


def plain(value: Any) -> Any:
    """Numbers as float, sequences and arrays as tuples; anything else unchanged."""
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
    """Whether a parameter refers to an entry of the ``values`` table of its diagram (``"$theta"``)."""
    return isinstance(value, str) and value.startswith("$")


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The single numbers of a parameter, with names: ``den`` gives ``den[0]``, ``den[1]``, …"""
    if isinstance(value, tuple):
        for k, v in enumerate(value):
            yield from leaves(v, f"{name}[{k}]")
    else:
        yield name, value


def map_leaves(f: Callable[[str, Any], Any], value: Any, name: str = "") -> Any:
    """The same nesting, with each leaf replaced by ``f(name, leaf)``."""
    if isinstance(value, tuple):
        return tuple(map_leaves(f, v, f"{name}[{k}]") for k, v in enumerate(value))
    return f(name, value)


def validate(owner: str, name: str, field: Field, value: Any) -> None:
    """Raise ParameterError unless ``value`` is of the kind of the default and within the bounds."""
    fault = _fault(name, field, value)
    if fault:
        unit = f" [{field.unit}]" if field.unit and "?" not in field.unit else ""
        raise ParameterError(f"{owner}.{fault} It is: {field.about}{unit}.")


def _fault(name: str, field: Field, value: Any) -> str:
    """The fault of the value of a field, as a sentence that begins with the field's name."""
    if field.kind == "option" and is_reference(value):
        return f"{name} is an option, and only a parameter can refer to values, got {in_words(value)}."
    if field.choices:
        known = value in field.choices
        return "" if known else f"{name} is {in_words(value)}, which is not a choice.{near(value, field.choices)}"
    wanted = type(field.default)
    if wanted is int:
        whole = isinstance(value, float) and value.is_integer() and field.allows(value)
        if whole and abs(value) >= MOST_EXACT:
            return f"{name} is {in_words(value)}, a whole number too large to be held exactly."
        return "" if whole else f"{name} must be a whole number in {field.bounds()}, got {in_words(value)}."
    if field.kind == "option" and wanted is not float:
        words = {str: "text", bool: "true or false", tuple: "a list"}.get(wanted, "")
        return f"{name} must be {words}, got {in_words(value)}." if words and type(value) is not wanted else ""
    if isinstance(value, tuple) != (wanted is tuple):
        words = "a list of numbers" if wanted is tuple else "a number"
        return f"{name} must be {words}, got {in_words(value)}."
    if field.flat and any(isinstance(one, tuple) for one in value):
        return f"{name} must be one list of numbers, such as [1, 0.5], got {in_words(value)}."
    faults = (_number_fault(leaf, field, number) for leaf, number in leaves(value, name) if not is_reference(number))
    return next(filter(None, faults), "")


def _number_fault(name: str, field: Field, number: Any) -> str:
    """The fault of a single number, ``""`` where it is allowed."""
    if not isinstance(number, float) or math.isnan(number):
        return f"{name} must be a number, got {in_words(number)}."
    if field.allows(number):
        return ""
    if math.isinf(number) and field.low < 0 < field.high and math.isinf(field.low if number < 0 else field.high):
        return f"{name} must be finite, got {number:g}."
    return f"{name} must lie in {field.bounds()}, got {number:g}."
