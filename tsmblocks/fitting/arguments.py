"""What a fit is asked for: names, pairs by name, flags. Each kind is checked here, with one wording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tsmblocks.common.errors import ParameterError, RunError, in_words


def names(what: str, given: Any, example: str) -> list[str]:
    """A name, or several, as a list without repeats. Raises ParameterError for anything else."""
    if isinstance(given, str):
        return [given]
    if isinstance(given, Mapping) or not isinstance(given, Iterable):
        raise ParameterError(f"{what} takes names such as {example!r}, got {in_words(given)}.")
    listed = list(given)
    for name in listed:
        if not isinstance(name, str):
            raise ParameterError(f"{what} takes names such as {example!r}, got {in_words(name)}.")
    return list(dict.fromkeys(listed))


def by_name(what: str, given: Any, example: str) -> dict[str, Any]:
    """A mapping from names, empty for None. Raises ParameterError for anything else."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what} must be a mapping by name, such as {{{example}}}, got {in_words(given)}.")
    for name in given:
        if not isinstance(name, str):
            raise ParameterError(f"{what} takes names, such as {{{example}}}, got {in_words(name)}.")
    return dict(given)


def flag(what: str, value: Any) -> bool:
    """True or False. Raises RunError for anything else."""
    if not isinstance(value, (bool, np.bool_)):
        raise RunError(f"{what} must be True or False, got {in_words(value)}.")
    return bool(value)


def text(what: str, value: Any) -> None:
    """Raise RunError for what is no text."""
    if not isinstance(value, str):
        raise RunError(f"{what} must be a text, got {in_words(value)}.")


def progress(given: Any, told: str = "stage, evaluations and rms") -> None:
    """Raises RunError for what is no function to tell progress to; ``told`` is what such a function is told."""
    if given is not None and not callable(given):
        raise RunError(f"progress must be a function of {told}, got {in_words(given)}.")
