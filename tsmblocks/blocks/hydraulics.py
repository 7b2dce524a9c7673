"""Blocks of tanks and other vessels: the overflow."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.model.block import Block, Input, Output, block, parameter


@block
class Overflow(Block):
    r"""Overflow of a vessel: the inflow less the flow over the rim, part of which may be caught elsewhere.

    .. math:: q = k \max(x - h, 0), \qquad y = u - q, \qquad y_{spilt} = s\, q

    A vessel of unit cross-section settles above its rim with the time constant 1/k; keep it above a third of the step.
    With a rim that is never reached the flow passes bit for bit.
    """

    source = "definition; a weir with a straight characteristic"
    symbol = "rim"
    symbol_with_values = "rim\n{rim}"

    rim: float = parameter(default=float("inf"), about="level h of the rim", unit="?x", finite=False)
    rate: float = parameter(default=1.0, about="flow k over the rim per level above it", above=0.0)
    caught: float = parameter(default=0.0, about="share s of the spilt flow that is caught", at_least=0.0, at_most=1.0)

    u = Input("flow into the vessel", unit="?u")
    x = Input("level in the vessel", unit="?x")
    y = Output("flow that stays in the vessel", unit="?u")
    spilt = Output("flow over the rim that is caught", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        over = self.rate * ca.fmax(u.x - self.rim, 0.0)
        return dict(y=u.u - over, spilt=self.caught * over)
