"""Noise of outputs as it is given: a number, a number with its unit, for every output or by name."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.arguments import is_number
from tsmblocks.common.errors import ParameterError, in_words, near
from tsmblocks.data import Record
from tsmblocks.model.diagram import Diagram

_TEXT = re.compile(
    r"(?:(?P<name>[A-Za-z_]\w*)\s*=)?\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>.*)"
)


@attrs.frozen
class Floor:
    """A noise floor for one output (``""``: for all that it measures), in ``unit`` (``""``: none was given)."""

    output: str
    value: float
    unit: str

    @property
    def text(self) -> str:
        """The floor as it is written in an argument."""
        return f"{self.value:g}{self.unit}"


def parsed(text: str, what: str = "noise_floor") -> Floor:
    """A floor out of ``0.05``, ``0.05deg`` or ``x_out = 0.05 deg``. Raises ParameterError for anything else."""
    found = _TEXT.fullmatch(text.strip())
    if not found:
        raise ParameterError(
            f"{what}: {in_words(text)} is not VALUE, VALUE with a unit, or OUTPUT=VALUE, such as 0.05deg or "
            "x_out=0.05deg."
        )
    one = Floor(found["name"] or "", float(found["value"]), found["unit"].strip())
    if not 0 < one.value < np.inf:
        raise ParameterError(f"{what}: {in_words(text)} is not finite and above 0.")
    try:
        units.parse(one.unit)
    except units.UnitError as error:
        raise ParameterError(f"{what}={one.text}: {error}") from None
    return one


def given_floors(
    given: Any, diagram: Diagram, records: Mapping[str, Record], outputs: Sequence[str], what: str = "noise_floor"
) -> dict[str, tuple[float, str]]:
    """The floors that were given, by output: in the diagram's unit (the recording's where it has none), and in words.

    Raises ParameterError for one that is none, and for a number without a unit where it could be in several.
    """
    made: dict[str, tuple[float, str]] = {}
    in_use = {k: diagram.unit(k) or next((r.unit(k) for r in records.values() if k in r), "") for k in outputs}
    for one in _each(given, what):
        if one.output and one.output not in outputs:
            raise ParameterError(f"{what}: '{one.output}' is not compared here.{near(one.output, outputs)}")
        names = [one.output] if one.output else list(outputs)
        if not one.unit:
            _refuse_several(one, {k: in_use[k] for k in names if in_use[k]}, what)
        found = {k: size for k in names if (size := _size(one, k, in_use[k], records, what)) is not None}
        if not found:
            wanted = ", ".join(f"{k} [{in_use[k]}]" for k in names)
            raise ParameterError(f"{what}={one.text}: '{one.unit}' cannot be converted to the unit of {wanted}.")
        twice = [k for k in found if k in made]
        if twice:
            raise ParameterError(f"{what} gives {twice[0]} two values; name each output once.")
        made |= found
    return made


def _refuse_several(one: Floor, in_use: Mapping[str, str], what: str) -> None:
    """Raise ParameterError where a number without a unit is for outputs in different ones."""
    if any(not units.same(a, b) for a, b in itertools.pairwise(in_use.values())):
        where = ", ".join(f"{k} in {unit}" for k, unit in in_use.items())
        each = " ".join(f"'{k}={one.text}{unit}'" for k, unit in in_use.items())
        raise ParameterError(
            f"{what}={one.text} has no unit, and the outputs differ: {where}. Give one for each: {each}."
        )


def _each(given: Any, what: str) -> Iterator[Floor]:
    """The floors one by one, out of a number, a text, a list of them, or a mapping by output."""
    if isinstance(given, Mapping):
        for name, value in given.items():
            yield attrs.evolve(_one(value, what, f" of '{name}'"), output=str(name))
    elif given is not None:
        for value in given if isinstance(given, (list, tuple)) else [given]:
            yield _one(value, what, "")


def _one(value: Any, what: str, whose: str) -> Floor:
    if isinstance(value, Floor):
        return value
    if isinstance(value, str):
        return parsed(value, what)
    if not is_number(value) or not value > 0:
        raise ParameterError(
            f"{what}{whose} must be a positive number, or one with its unit such as '0.05deg', got {in_words(value)}."
        )
    return Floor("", float(value), "")


def _size(one: Floor, name: str, unit: str, records: Mapping[str, Record], what: str) -> tuple[float, str] | None:
    """A floor in the ``unit`` an output is compared in, and in words; None where it measures something else."""
    words = f"{one.value:g} {one.unit or unit}".rstrip()
    if one.unit:
        try:
            return one.value * (units.factor(one.unit, unit) if unit else 1.0), words
        except units.UnitError:
            return None
    for experiment, record in records.items():  # a number without a unit must mean the same in both
        own = record.unit(name) if name in record else ""
        if own and unit and not units.same(own, unit):
            raise ParameterError(
                f"{what}={one.text} has no unit, and {name} is in {own} in the recording "
                f"'{experiment}' but compared in {unit}: write '{one.text}{own}' or "
                f"'{one.text}{unit}'."
            )
    return one.value, words
