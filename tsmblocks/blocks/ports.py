"""Ports whose unit is an option of the block: sources, and blocks that turn one unit into another."""

from __future__ import annotations

from typing import Any

import attrs

from tsmblocks.block import Output
from tsmblocks.errors import ParameterError
from tsmblocks.units import UnitError, parse

UNIT = "unit of the signal; empty means that of whatever it drives"


def in_unit(block: Any) -> dict[str, Output]:
    """Declare the output of a block in the unit its option ``unit`` asks for."""
    declared = block._declared["y"]
    return {"y": attrs.evolve(declared, unit=block.unit or declared.unit)}


def check_unit(block: Any) -> None:
    """Raise ParameterError when the option ``unit`` of a block is not a unit."""
    try:
        parse(block.unit)
    except UnitError as error:
        raise ParameterError(f"{type(block).__name__}.unit: {error}") from None
