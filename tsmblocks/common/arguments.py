"""Checks of arguments: each kind of value is checked by one function, with one wording.

``what`` is the name of the argument in messages; a value that passes is returned in its plain type.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tsmblocks.common.errors import ParameterError, RunError, TsmError, in_words


def is_number(value: Any) -> bool:
    """Whether a value is a finite number; True and False are not."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:  # an integer of hundreds of digits
        return False


def as_number(what: str, value: Any, error: type[TsmError] = RunError) -> float:
    """A finite number. Raises ``error`` for anything else, NaN and infinity included."""
    if not is_number(value):
        raise error(f"{what} must be a finite number, got {in_words(value)}.")
    return float(value)


def as_positive(what: str, value: Any) -> float:
    """A duration above zero, in s. Raises RunError."""
    if not is_number(value) or value <= 0:
        raise RunError(f"{what} must be a positive number of seconds, got {in_words(value)}.")
    return float(value)


def as_integer(what: str, value: Any, least: int) -> int:
    """An integer of at least ``least``. Raises RunError."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
        raise RunError(f"{what} must be a whole number of at least {least}, got {in_words(value)}.")
    return int(value)


def as_bool(what: str, value: Any) -> bool:
    """True or False. Raises RunError."""
    if not isinstance(value, (bool, np.bool_)):
        raise RunError(f"{what} must be True or False, got {in_words(value)}.")
    return bool(value)


def as_text(what: str, value: Any) -> str:
    """A text. Raises RunError."""
    if not isinstance(value, str):
        raise RunError(f"{what} must be a text, got {in_words(value)}.")
    return value


def as_callback(given: Any, arguments: str) -> Any:
    """A progress callback called with these ``arguments``; for None one that does nothing. Raises RunError."""
    if given is not None and not callable(given):
        raise RunError(f"progress must be a function of {arguments}, got {in_words(given)}.")
    return given or (lambda *_: None)


def as_list(names: Iterable[str] | str | None) -> list[str]:
    """Names as a list: a single name, or anything that is not iterable, as a list of one; None as an empty list."""
    if names is None or isinstance(names, str):
        return [] if names is None else [names]
    try:
        return list(names)
    except TypeError:  # a number, or an array without dimension
        return [names]  # type: ignore[list-item]


def as_names(what: str, given: Any, example: str) -> list[str]:
    """A name, or several, as a list without repeats. Raises ParameterError for anything else."""
    if not isinstance(given, str) and (isinstance(given, Mapping) or not isinstance(given, Iterable)):
        raise ParameterError(f"{what} takes names such as {example!r}, got {in_words(given)}.")
    listed = as_list(given)
    for name in listed:
        if not isinstance(name, str):
            raise ParameterError(f"{what} takes names such as {example!r}, got {in_words(name)}.")
    return list(dict.fromkeys(listed))


def as_mapping(what: str, given: Any, example: str) -> dict[str, Any]:
    """A mapping from names, empty for None. Raises ParameterError for anything else."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what} must be a mapping by name, such as {{{example}}}, got {in_words(given)}.")
    for name in given:
        if not isinstance(name, str):
            raise ParameterError(f"{what} takes names, such as {{{example}}}, got {in_words(name)}.")
    return dict(given)
