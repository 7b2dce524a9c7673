"""Ports whose unit is an option of the block: sources, and blocks that turn one unit into another."""

from __future__ import annotations

from typing import Any

import attrs

from tsmblocks.block import Input, Output
from tsmblocks.errors import ParameterError
from tsmblocks.units import UnitError, parse

UNIT = "unit of the signal; empty means that of whatever it drives"
UNIT_IN = "unit of the input; empty means that of whatever drives it"


def in_unit(block: Any) -> dict[str, Output]:
    """Declare the output of a block in the unit its option ``unit`` asks for."""
    declared = block._declared["y"]
    return {"y": attrs.evolve(declared, unit=block.unit or declared.unit)}


def from_unit(block: Any) -> dict[str, Input]:
    """Declare the input of a block in the unit its option ``unit_in`` asks for."""
    declared = block._declared["u"]
    return {"u": attrs.evolve(declared, unit=block.unit_in or declared.unit)}


def check_unit(block: Any, *others: str) -> None:
    """Raise ParameterError when the option ``unit`` of a block, or another one, is not a unit."""
    for name in ("unit", *others):
        try:
            parse(getattr(block, name))
        except UnitError as error:
            raise ParameterError(f"{type(block).__name__}.{name}: {error}") from None
