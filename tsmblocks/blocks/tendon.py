"""Blocks of tendons that run in sheaths."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.blocks.hysteresis import play
from tsmblocks.model.block import Block, Input, Output, block, parameter, state


@block
class CapstanFriction(Block):
    r"""A tendon in a bent sheath, with friction in proportion to its tension.

    .. math::

        y = \max(u + w - h, \min(u + w + h, m)), \qquad
        w = T \left(\frac{e^c + e^{-c}}{2} - 1\right), \qquad h = |T| \frac{e^c - e^{-c}}{2}, \qquad
        T = u + T_0, \qquad c = \mu\varphi

    T is the tension at the driving end, the sum of the pretension and of what the drive adds. The other end rests while
    its tension is between T exp(-c) and T exp(c), where friction holds the tendon, and follows at both edges: a play in
    the logarithm of the tension, wide where the tendon is pulled and narrow where it is nearly slack. A force that
    pushes rubs as well, as in a push-pull cable; for a tendon that cannot push, put a Saturation in front. The input
    may be a displacement, where the tension is in proportion to it: the pretension is the displacement that slackens
    it.
    """

    source = "Euler's capstan equation; Kaneko, Yamashita and Tanie, Int. Conf. on Advanced Robotics (1991)"
    symbol = "capstan"
    symbol_with_values = "capstan\nμ = {mu:value}"

    mu: float = parameter(default=0.1, about="coefficient of friction μ", at_least=0.0)
    angle: float = parameter(
        default=1.5707963267948966, about="sum φ of the angles of all bends", unit="rad", at_least=0.0, known=True
    )
    pretension: float = parameter(default=1.0, about="pretension T_0", unit="?u")
    u = Input("tension added at the driving end", unit="?u")
    y = Output("tension added at the other end", unit="?u")
    m: float = state(default=0.0, about="output a step ago", unit="?u")

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(m=self._far_end(x, u))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._far_end(x, u))

    def _far_end(self, x: Any, u: Any) -> Any:
        tension, grip = u.u + self.pretension, ca.exp(self.mu * self.angle)
        away = tension * ((grip + 1 / grip) / 2 - 1)  # the middle of the band, from u: zero without friction
        return play(u.u + away, ca.fabs(tension) * (grip - 1 / grip) / 2, x.m)
