"""Shared by several families of blocks: descriptions of options, checks, the limits ``low`` and ``high``."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from tsmblocks.common.errors import ParameterError

UNIT = "unit of the signal; empty means that of whatever it drives"
UNIT_IN = "unit of the input; empty means that of whatever drives it"
LONG_AGO = -1e9
"""Initial time [s] of the last step, before any run: in the first step nothing is limited by the time that passed.
Chosen finite, so that derivatives are."""


def check_limits(block: Any) -> None:
    """Raise ParameterError unless the lower limit is below the upper one: the ``check`` of a block with both."""
    if block.low >= block.high:
        raise ParameterError(f"{type(block).__name__} needs low < high, got low={block.low:g}, high={block.high:g}.")


def check_increasing(block: Any, name: str) -> None:
    """Raise ParameterError unless the numbers of a list increase."""
    for k, (a, b) in enumerate(pairwise(getattr(block, name))):
        if a >= b:
            places = f"{name}[{k}]={a:g} and {name}[{k + 1}]={b:g}"
            raise ParameterError(f"{type(block).__name__}.{name} must increase, but {places}.")


def anti_windup(block: Any) -> Any:
    """Rate of the anti-windup of a controller: none without integral action, which it would otherwise bring in."""
    return ca.if_else(ca.fabs(block.ki) > 0.0, block.kaw, 0.0)


def limited(block: Any, value: Any) -> Any:
    """A value within the limits of a block."""
    return ca.fmin(ca.fmax(value, block.low), block.high)
