"""Blocks that limit or round a signal: saturation, dead zone, rate limit, relay, quantiser, lookup table."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.block import Block, Input, Output, block, parameter
from tsmblocks.errors import ParameterError


@block
class Saturation(Block):
    r"""Hard limit of an actuator.

    .. math:: y = \min(\max(u, l), h)
    """

    source = "Paper, section 5.1: the drive gives the motor up to 24 V, in both directions"
    symbol = "sat"

    low: float = parameter(default=-24.0, about="smallest output", unit="?u", finite=False)
    high: float = parameter(default=24.0, about="largest output", unit="?u", finite=False)

    u = Input("wanted value", unit="?u")
    y = Output("value the actuator can give", unit="?u")

    def check(self) -> None:
        if self.low >= self.high:
            raise ParameterError(f"Saturation needs low < high, got low={self.low:g}, high={self.high:g}.")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.fmin(ca.fmax(u.u, self.low), self.high))
