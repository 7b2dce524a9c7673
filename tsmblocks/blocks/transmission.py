"""Blocks on a wire that add one effect to the signal, which passes bit for bit at strength zero.

Every output is the input plus the strength times something finite, and every strength is zero by default. Inserted in a
wire of a diagram, such a block therefore changes nothing until its strength is set or fitted.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.model.block import Block, Input, Output, block, option, parameter, state


@block
class Slack(Block):
    r"""A signal that grows more slowly beyond an edge: a tendon that goes slack.

    .. math:: y = u - s \min(u - e, 0) \quad \text{(low)}, \qquad y = u - s \max(u - e, 0) \quad \text{(high)}

    Beyond the edge the slope is 1 - s: at 1 nothing passes there, at 0 everything does.
    """

    source = "definition; a one-sided dead zone, in which a given share is lost"
    symbol = "slack"

    share: float = parameter(default=0.0, about="share of the slope lost beyond the edge", at_least=0.0, at_most=1.0)
    edge: float = parameter(default=0.0, about="value at which the signal begins to be lost", unit="?u")
    side: str = option(default="low", about="on which side of the edge it is lost", choices=("low", "high"))
    u = Input("any signal", unit="?u")
    y = Output("the signal, less the part lost beyond the edge", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        beyond = ca.fmin(u.u - self.edge, 0.0) if self.side == "low" else ca.fmax(u.u - self.edge, 0.0)
        return dict(y=u.u - self.share * beyond)


@block
class AsymmetricGain(Block):
    r"""A gain that differs between positive and negative values: a valve, a cell, or a drive with two directions.

    .. math:: y = u + \tfrac{1}{2} d\, |u|

    The slope is 1 + d/2 for positive and 1 - d/2 for negative values.
    """

    source = "definition"
    symbol = "two slopes"

    difference: float = parameter(
        default=0.0, about="slope for positive values less that for negative ones", at_least=-2.0, at_most=2.0
    )
    u = Input("any signal", unit="?u")
    y = Output("the signal with two slopes", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + 0.5 * self.difference * ca.fabs(u.u))


@block
class Bend(Block):
    r"""A nonlinear characteristic: powers two to five added to the signal.

    .. math:: y = u + k_2 e^2 + k_3 e^3 + k_4 e^4 + k_5 e^5, \qquad e = u - c
    """

    source = "definition; Taylor series of a static characteristic"
    symbol = "bend"

    quadratic: float = parameter(default=0.0, about="k2, per unit of the signal: bends both ends to one side")
    cubic: float = parameter(default=0.0, about="k3, per unit of the signal squared: bends the ends apart")
    quartic: float = parameter(default=0.0, about="k4, per unit of the signal cubed: bends both ends more sharply")
    quintic: float = parameter(default=0.0, about="k5, per unit to the fourth: bends the ends apart more sharply")
    centre: float = parameter(default=0.0, about="value c about which it is bent", unit="?u")

    u = Input("any signal", unit="?u")
    y = Output("the signal after the characteristic", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        away = u.u - self.centre
        square = away * away
        even = self.quadratic * square + self.quartic * (square * square)
        odd = self.cubic * (square * away) + self.quintic * (square * square * away)
        return dict(y=u.u + even + odd)


@block
class Bow(Block):
    r"""A characteristic that is steeper, or flatter, about one point than at both ends.

    .. math:: y = u + a \tanh\left(\frac{u - c}{d}\right)
    """

    source = "definition"
    symbol = "bow"

    size: float = parameter(default=0.0, about="value added far from the centre", unit="?u")
    width: float = parameter(default=0.3, about="distance d over which it builds up", unit="?u", above=0.0)
    centre: float = parameter(default=0.0, about="value c about which the slope differs", unit="?u")
    u = Input("any signal", unit="?u")
    y = Output("the signal after the characteristic", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.size * ca.tanh((u.u - self.centre) / self.width))


@block
class Ripple(Block):
    r"""An error that is periodic in the signal itself: eccentricity, cogging, teeth.

    .. math:: y = u + a \cos n u + b \sin n u + a_2 \cos 2 n u + b_2 \sin 2 n u
    """

    source = "definition; first two harmonics of an error that is periodic in the position"
    symbol = "ripple"

    cosine: float = parameter(default=0.0, about="amplitude a of the cosine", unit="?u")
    sine: float = parameter(default=0.0, about="amplitude b of the sine", unit="?u")
    cosine2: float = parameter(default=0.0, about="amplitude a2 of the second harmonic's cosine", unit="?u")
    sine2: float = parameter(default=0.0, about="amplitude b2 of the second harmonic's sine", unit="?u")
    cycles: float = parameter(default=1.0, about="phase n [rad] per unit of u; periods per turn of an angle", above=0.0)

    u = Input("any signal", unit="?u")
    y = Output("the signal with the ripple added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        phase = self.cycles * u.u
        first = self.cosine * ca.cos(phase) + self.sine * ca.sin(phase)
        return dict(y=u.u + first + (self.cosine2 * ca.cos(2 * phase) + self.sine2 * ca.sin(2 * phase)))


@block
class Creep(Block):
    r"""A share of the signal that follows with a lag: creep of a sheath or a tendon.

    .. math:: T \dot z = u - z, \qquad y = u + s z
    """

    source = "Findley, Lai and Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976), chapter 5"
    symbol = "creep"

    share: float = parameter(default=0.0, about="creep, as a share of the immediate response")
    time_constant: float = parameter(default=10.0, about="time to 63 % of the creep", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the creep added", unit="?u")
    late: float = state(default=0.0, about="the signal, lagging", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(late=(u.u - x.late) / self.time_constant)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.share * x.late)


@block
class BroadCreep(Block):
    r"""A share of the signal that follows over decades of time: creep of polymers and piezo actuators.

    .. math:: y = u + \frac{s}{4} \sum_{k=1}^{4} z_k, \qquad T_k \dot z_k = u - z_k, \qquad
        T_k = T_1 \left(\frac{T_4}{T_1}\right)^{(k-1)/3}

    After a step it grows about as the logarithm of time, from the fastest time constant to the slowest.
    """

    source = "Findley, Lai and Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976), chapter 5"
    symbol = "log creep"

    share: float = parameter(default=0.0, about="creep, as a share of the immediate response")
    fastest: float = parameter(default=1.0, about="shortest time constant T1", unit="s", above=0.0)
    slowest: float = parameter(default=100.0, about="longest time constant T4", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the creep added", unit="?u")
    late1: float = state(default=0.0, about="the signal, lagging by T1", unit="?u")
    late2: float = state(default=0.0, about="the signal, lagging by T2", unit="?u")
    late3: float = state(default=0.0, about="the signal, lagging by T3", unit="?u")
    late4: float = state(default=0.0, about="the signal, lagging by T4", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        spread = self.slowest / self.fastest
        times = [self.fastest * spread ** (k / 3) for k in range(4)]
        return {name: (u.u - late) / time for name, late, time in zip(x._fields, x, times, strict=True)}

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.share / 4 * (x.late1 + x.late2 + x.late3 + x.late4))


@block
class RateDependence(Block):
    r"""A term in the rate of the signal, linear or a power of it: viscous loss.

    .. math:: y = u + c\, v \left(v^2 + v_0^2\right)^{(n - 1)/2}, \qquad v = \dot u

    With :math:`n = 1` it is :math:`u + c v`, with another exponent :math:`c |v|^n` away from rest. The
    rate is formed exactly where nothing drives its port.
    """

    source = "definition; the power law of viscous fluids, rounded at rest"
    symbol = "+ c|v|ⁿ"

    coefficient: float = parameter(default=0.0, about="c; for n = 1 a time in s, negative for a part that lags")
    exponent: float = parameter(default=1.0, about="power n of the rate", at_least=0.2, at_most=4.0)
    smoothing: float = parameter(default=1e-3, about="rate below which the power is linear", unit="?u/s", above=0.0)
    u = Input("any signal", unit="?u")
    v = Input("its rate", unit="?u/s", rate_of="u")
    y = Output("the signal and the term in its rate", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        square = u.v * u.v + self.smoothing * self.smoothing
        return dict(y=u.u + self.coefficient * (u.v * square ** ((self.exponent - 1) / 2)))


@block
class Resonance(Block):
    r"""A share of the signal that resonates: an elastic tendon with a load at its end.

    .. math:: \ddot z = \omega^2 (u - z) + 2 \zeta \omega (f \dot u - \dot z), \qquad y = u + s (z - u)

    At s = 0 the signal passes, at 1 it is the oscillator's. The damper acts against the ground at f = 0 and against the
    moving base at f = 1. The state ``rate`` is :math:`\dot z - 2 \zeta \omega f (u - z)`: so no rate of u is needed.
    """

    source = "definition; base excitation as in Inman, Engineering Vibration, section 2.4"
    symbol = "resonance"

    share: float = parameter(default=0.0, about="share of the signal that resonates", at_least=0.0, at_most=1.0)
    omega: float = parameter(default=20.0, about="natural frequency", unit="rad/s", above=0.0)
    zeta: float = parameter(default=0.2, about="damping ratio", at_least=0.0)
    feed: float = parameter(default=0.0, about="share f of the damper on the base", at_least=0.0, at_most=1.0)

    u = Input("any signal", unit="?u")
    y = Output("the signal, a share of it resonating", unit="?u")
    swing: float = state(default=0.0, about="the oscillator", unit="?u")
    rate: float = state(default=0.0, about="its rate, less the part damped by the base", unit="?u/s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        damping = 2 * self.zeta * self.omega
        swing = x.rate + damping * self.feed * (u.u - x.swing)
        pull = self.omega * self.omega * (u.u - x.swing)
        return dict(swing=swing, rate=pull - damping * (1 - self.feed) * swing)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.share * (x.swing - u.u))


@block
class ParallelResonance(Block):
    r"""A mode in parallel with a model: a further oscillator, driven by the same input x, adds to the output.

    .. math:: \ddot z = \omega^2 (x - z) - 2 \zeta \omega \dot z, \qquad y = u + g z + h \dot z / \omega

    A linear system of higher order is a sum of such modes.
    """

    source = "partial fractions; Ljung, System Identification (1999), section 4.2"
    symbol = "+ mode"

    gain: float = parameter(default=0.0, about="share g of the oscillator in the output")
    rate_gain: float = parameter(default=0.0, about="share h of its rate, divided by omega")
    omega: float = parameter(default=20.0, about="natural frequency", unit="rad/s", above=0.0)
    zeta: float = parameter(default=0.05, about="damping ratio", at_least=0.0)

    u = Input("output of the model in parallel", unit="?u")
    x = Input("input of the model", unit="?x")
    y = Output("both together", unit="?u")
    swing: float = state(default=0.0, about="the oscillator", unit="?x")
    rate: float = state(default=0.0, about="its rate", unit="?x/s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        pull = self.omega * self.omega * (u.x - x.swing)
        return dict(swing=x.rate, rate=pull - 2 * self.zeta * self.omega * x.rate)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.gain * x.swing + self.rate_gain * x.rate / self.omega)
