"""Blocks on a wire that add or change a hysteresis loop; at strength zero the signal passes bit for bit."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.blocks.changes import after
from tsmblocks.blocks.hysteresis import check_weights, plays
from tsmblocks.blocks.linear_systems import initial_states
from tsmblocks.model.block import Block, Input, Output, State, block, parameter, state


def _dahl_state(block: Any, t: Any, x: Any, u: Any) -> dict[str, Any]:  # noqa: ARG001 - the arguments of a method
    """Rate of a state that tends to 1 while travelling forwards and to -1 backwards (Dahl's law)."""
    return dict(z=(u.v - ca.fabs(u.v) * x.z) / block.distance)


@block
class Stretch(Block):
    r"""A signal less an elastic stretch that saturates with travel: a hysteresis loop by Dahl's law.

    .. math:: y = u - w z, \qquad \dot z = \frac{v - |v| z}{d}, \qquad v = \dot u

    ``DahlHysteresis`` of slope 1, for a signal of any unit, with :math:`\rho = w / d`.
    """

    source = "Dahl, AIAA J. 14 (1976) 1675"
    symbol = "− w z"

    half_width: float = parameter(default=0.0, about="loss after long travel in one direction", unit="?u")
    distance: float = parameter(default=0.1, about="travel over which the loop reverses", unit="?u", above=0.0)
    u = Input("any signal", unit="?u")
    v = Input("its rate", unit="?u/s", rate_of="u")
    y = Output("the signal less the stretch", unit="?u")
    z: float = state(default=0.0, about="side of the loop, from -1 to 1", unit="1")

    derivatives = _dahl_state

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u - self.half_width * x.z)


@block
class StribeckStretch(Block):
    r"""A signal less an elastic stretch that is larger at low speed: hysteresis by Stribeck friction.

    .. math:: y = u - \left(w + b\, e^{-(v / v_s)^2}\right) z, \qquad \dot z = \frac{v - |v| z}{d}, \qquad
        v = \dot u

    The friction in a sheath stretches the tendon; where it falls with the speed, so does the width of the loop, from
    w + b at low speed to w.
    """

    source = (
        "Dahl, AIAA J. 14 (1976) 1675, with the level of friction of Armstrong-Hélouvry et al., Automatica 30 (1994)"
    )
    symbol = "− w(v) z"

    half_width: float = parameter(
        default=0.0, about="loss after long travel in one direction, at high speed", unit="?u"
    )
    breakaway: float = parameter(default=0.0, about="additional loss at low speed", unit="?u")
    speed: float = parameter(
        default=0.1, about="Stribeck velocity, over which the additional loss falls", unit="?u/s", above=0.0
    )
    distance: float = parameter(default=0.1, about="travel over which the loop reverses", unit="?u", above=0.0)
    u = Input("any signal", unit="?u")
    v = Input("its rate", unit="?u/s", rate_of="u")
    y = Output("the signal less the stretch", unit="?u")
    z: float = state(default=0.0, about="side of the loop, from -1 to 1", unit="1")

    derivatives = _dahl_state

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        width = self.half_width + self.breakaway * ca.exp(-((u.v / self.speed) ** 2))
        return dict(y=u.u - width * x.z)


@block
class LoopChange(Block):
    r"""A hysteresis loop that appears at one instant and stays: friction in the sheath after it is bent again.

    .. math:: y = u + H(t) (g u + c z), \qquad \dot z = \frac{v - |v| z}{d}, \qquad
        H(t) = \tfrac12 \left[1 + \tanh\frac{t - t_0}{w}\right]

    with :math:`v = \dot u`. The state z runs from -1 to 1 with the direction of travel, so c is the
    half width of the new loop; with c < 0 the output trails the signal, with c > 0 it leads. With
    the loop the gain may change, by g.
    """

    source = "definition; the loop is that of Dahl, AIAA J. 14 (1976) 1675"
    symbol = "loop(t)"

    change: float = parameter(default=0.0, about="value added while travelling forwards, after the change", unit="?u")
    gain: float = parameter(default=0.0, about="change g of the gain")
    distance: float = parameter(default=0.1, about="travel over which the loop reverses", unit="?u", above=0.0)
    time: float = parameter(default=1.0, about="instant of the change", unit="s")
    width: float = parameter(default=0.01, about="time over which the change is rounded", unit="s", above=0.0)

    u = Input("any signal", unit="?u")
    v = Input("its rate", unit="?u/s", rate_of="u")
    y = Output("the signal with the loop added", unit="?u")
    z: float = state(default=0.0, about="side of the loop, from -1 to 1", unit="1")

    derivatives = _dahl_state

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + after(t, self.time, self.width) * (self.gain * u.u + self.change * x.z))


@block
class LoopAsymmetry(Block):
    r"""Asymmetry of a hysteresis loop: unequal slopes, and a state that prefers one side.

    .. math::

        y &= u + \frac{\Delta\alpha}{2} \tanh\!\left(\frac{v}{v_0}\right) x + z \\
        \dot z &= |v| (\delta - \theta z), \qquad v = \dot x

    Added to a symmetric transmission of x these are the unequal slopes and the :math:`\delta` of the paper's model.
    """

    source = "Paper, Eqs (8) and (9), the asymmetric terms alone"
    symbol = "± slopes"

    slope_difference: float = parameter(default=0.0, about="slope while x grows less that while it falls")
    delta: float = parameter(default=0.0, about="asymmetry of the loop, in output per travel")
    theta: float = parameter(default=5.0, about="decay of the state, per unit of travel", above=0.0)
    speed: float = parameter(default=1.0, about="rate over which the slope changes", unit="?x/s", above=0.0)

    u = Input("output of the symmetric transmission", unit="?u")
    x = Input("the displacement that drives it", unit="?x")
    v = Input("rate of the displacement", unit="?x/s", rate_of="x")
    y = Output("output with unequal branches", unit="?u")
    z: float = state(default=0.0, about="part of the output that is due to delta", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(z=ca.fabs(u.v) * (self.delta - self.theta * x.z))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.slope_difference * (ca.tanh(u.v / self.speed) * u.x / 2) + x.z)


@block
class PositionDependentLoop(Block):
    r"""A hysteresis loop whose width grows with the displacement: friction that depends on how far the tool is bent.

    .. math:: y = u + g z, \qquad \dot z = \frac{x v - |v| z}{d}, \qquad v = \dot x

    After travel :math:`d` in one direction, :math:`z` is the :math:`x` of that travel, with the sign of the motion:
    friction builds up where the tool is, and is kept until the tool has moved away.
    """

    source = "definition; the loop is that of Dahl, AIAA J. 14 (1976) 1675"
    symbol = "+ g x z"

    gain: float = parameter(
        default=0.0,
        about="half width that the loop gains per unit of x; negative where the output trails, as in friction",
    )
    distance: float = parameter(default=0.1, about="travel over which the loop reverses", unit="?x", above=0.0)

    u = Input("any signal", unit="?u")
    x = Input("the displacement that the width depends on", unit="?x")
    v = Input("rate of the displacement", unit="?x/s", rate_of="x")
    y = Output("the signal with the loop added", unit="?u")
    z: float = state(default=0.0, about="displacement at which the loop was met, signed by the motion", unit="?x")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(z=(u.v * u.x - ca.fabs(u.v) * x.z) / self.distance)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.gain * x.z)


@block
class NonlocalMemory(Block):
    r"""Several plays in parallel with the signal, so that inner loops remember where they began.

    .. math:: y = u + \sum_i w_i \left(P_i[u] - u\right), \qquad P_i = \max(u - r_i, \min(u + r_i, m_i))

    The memory :math:`m_i` is the play's value a step ago.
    """

    source = "Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989)"
    symbol = "+ Σ play"

    weights: tuple[float, ...] = parameter(default=(0.0, 0.0, 0.0), about="share of the signal behind each play")
    radii: tuple[float, ...] = parameter(default=(0.05, 0.15, 0.4), about="half of each slack", unit="?u", at_least=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal, shares of it behind plays", unit="?u")

    check = check_weights

    @property
    def states(self) -> dict[str, State]:
        return initial_states((), len(self.radii), "value a step ago of play", "m", "?u")

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return plays(self, x, u)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        moved = plays(self, x, u).values()
        return dict(y=u.u + sum(w * (p - u.u) for w, p in zip(self.weights, moved, strict=True)))
