"""Blocks on a wire whose effect depends on the time: drifts, jumps, changes of a gain, oscillations.

As those of a transmission, they pass the signal bit for bit at strength zero.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from tsmblocks.model.block import Block, Input, Output, block, parameter, state


def after(t: Any, time: Any, width: Any) -> Any:
    r"""Share of a change that is complete at time ``t`` [s], from 0 long before ``time`` to 1 long after it.

    .. math:: H(t) = \tfrac12 \left[1 + \tanh\frac{t - t_0}{w}\right]
    """
    return (1 + ca.tanh((t - time) / width)) / 2


def between(t: Any, first: Any, last: Any, width: Any) -> Any:
    """Share of a change at time ``t`` [s] that begins at ``first`` and ends at ``last``: 1 between them, 0 outside."""
    return after(t, first, width) - after(t, last, width)


def settled(t: Any, since: Any, time_constant: Any) -> Any:
    r"""Share of a change that is complete at time ``t`` [s], where it begins at ``since`` and settles.

    .. math:: S(t) = 1 - e^{-(t - t_0)/T} \quad (t \ge t_0), \qquad 0 \text{ before}
    """
    return 1 - ca.exp(-ca.fmax(t - since, 0.0) / time_constant)


@block
class Drift(Block):
    r"""An error that grows with time, linearly and quadratically: a sensor that warms up.

    .. math:: y = u + r (t - t_0) + c (t - t_0)^2
    """

    source = "definition"
    symbol = "+ rt"

    rate: float = parameter(default=0.0, about="rate of the drift", unit="?u/s")
    curve: float = parameter(default=0.0, about="quadratic drift", unit="?u/s^2")
    since: float = parameter(default=0.0, about="instant from which the time is counted", unit="s", known=True)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the drift added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        passed = t - self.since
        return dict(y=u.u + self.rate * passed + self.curve * (passed * passed))


@block
class Jump(Block):
    r"""An error that appears at one instant and stays: lost counts, a tendon that slips.

    .. math:: y = u + s H(t), \qquad H(t) = \tfrac12 \left[1 + \tanh\frac{t - t_0}{w}\right]
    """

    source = "definition; a step rounded over a short time, so that its instant can be fitted"
    symbol = "jump"

    size: float = parameter(default=0.0, about="height of the jump", unit="?u")
    time: float = parameter(default=1.0, about="instant of the jump", unit="s")
    width: float = parameter(default=0.01, about="time over which the change is rounded", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the jump added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.size * after(t, self.time, self.width))


@block
class GainChange(Block):
    r"""A gain that changes at one instant and stays: a tendon that is bent again.

    .. math:: y = u \left[1 + c H(t)\right], \qquad H(t) = \tfrac12 \left[1 + \tanh\frac{t - t_0}{w}\right]
    """

    source = "definition"
    symbol = "gain(t)"

    change: float = parameter(default=0.0, about="gain after the change less that before, which is 1")
    time: float = parameter(default=1.0, about="instant of the change", unit="s")
    width: float = parameter(default=0.01, about="time over which the change is rounded", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the present gain", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.change * (after(t, self.time, self.width) * u.u))


@block
class GainDrift(Block):
    r"""A gain that changes steadily: a tendon that stretches, a sensor that warms up.

    .. math:: y = u \left[1 + r (t - t_0)\right]
    """

    source = "definition"
    symbol = "(1 + rt)"

    rate: float = parameter(default=0.0, about="change of the gain in each second, as a share of it", unit="1/s")
    since: float = parameter(default=0.0, about="instant from which the time is counted", unit="s", known=True)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the present gain", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.rate * (t - self.since) * u.u)


@block
class SettlingOffset(Block):
    r"""An error that builds up and settles: a sensor that warms up.

    .. math:: y = u + s \left[1 - e^{-(t - t_0)/T}\right]
    """

    source = "definition; the step response of a first-order lag"
    symbol = "+ (1 - e⁻ᵗ)"

    size: float = parameter(default=0.0, about="error in the end", unit="?u")
    time_constant: float = parameter(default=10.0, about="time T to 63 % of it", unit="s", above=0.0)
    since: float = parameter(default=0.0, about="instant at which it begins", unit="s", known=True)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the error added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.size * settled(t, self.since, self.time_constant))


@block
class SettlingGain(Block):
    r"""A gain that changes and settles: a motor, a pump or an amplifier that warms up.

    .. math:: y = u \left\{1 + c \left[1 - e^{-(t - t_0)/T}\right]\right\}
    """

    source = "definition; the step response of a first-order lag"
    symbol = "gain(t)"

    change: float = parameter(default=0.0, about="gain in the end less that at the beginning, which is 1")
    time_constant: float = parameter(default=10.0, about="time T to 63 % of the change", unit="s", above=0.0)
    since: float = parameter(default=0.0, about="instant at which it begins", unit="s", known=True)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the present gain", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.change * (settled(t, self.since, self.time_constant) * u.u))


@block
class HeatedGain(Block):
    r"""A gain that changes with the heat that its signal makes: the resistance of a coil, the force of a magnet.

    .. math:: y = u (1 + c \theta), \qquad T \dot\theta = (u/s)^2 - \theta
    """

    source = "definition; one thermal mass that loses heat in proportion to its temperature"
    symbol = "gain(u²)"

    change: float = parameter(default=0.0, about="change of the gain, of 1, where the signal stays at its scale")
    scale: float = parameter(default=1.0, about="signal s that heats to a temperature of 1", unit="?u", above=0.0)
    time_constant: float = parameter(default=10.0, about="thermal time constant T", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the present gain", unit="?u")
    heat: float = state(default=0.0, about="temperature above the surroundings, 1 where the signal stays at its scale")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(heat=((u.u / self.scale) ** 2 - x.heat) / self.time_constant)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.change * (x.heat * u.u))


@block
class TemporaryOffset(Block):
    r"""An error, a load or a flow that begins at one instant and ends at another: a touch, an open valve.

    .. math:: y = u + s \left[H(t; t_0) - H(t; t_1)\right], \qquad
        H(t; t_k) = \tfrac12 \left[1 + \tanh\frac{t - t_k}{w}\right]
    """

    source = "definition; two steps rounded over a short time, so that their instants can be fitted"
    symbol = "temporary"

    size: float = parameter(default=0.0, about="value added from one instant to the other", unit="?u")
    time: float = parameter(default=1.0, about="instant t0 at which it begins", unit="s")
    until: float = parameter(default=2.0, about="instant t1 at which it ends", unit="s")
    width: float = parameter(default=0.01, about="time over which both changes are rounded", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the offset added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.size * between(t, self.time, self.until, self.width))


@block
class TemporaryGain(Block):
    r"""A gain that changes at one instant and is as before from another on: a door left open, a slipping clutch.

    .. math:: y = u \left\{1 + c \left[H(t; t_0) - H(t; t_1)\right]\right\}, \qquad
        H(t; t_k) = \tfrac12 \left[1 + \tanh\frac{t - t_k}{w}\right]
    """

    source = "definition"
    symbol = "gain(t)"

    change: float = parameter(default=0.0, about="gain between the two instants less that outside, which is 1")
    time: float = parameter(default=1.0, about="instant t0 at which it begins", unit="s")
    until: float = parameter(default=2.0, about="instant t1 at which it ends", unit="s")
    width: float = parameter(default=0.01, about="time over which both changes are rounded", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the present gain", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.change * (between(t, self.time, self.until, self.width) * u.u))


@block
class Disturbance(Block):
    r"""An external oscillation, independent of the signal: breathing, mains, a fan.

    .. math:: y = u + a \cos 2 \pi f (t - t_0) + b \sin 2 \pi f (t - t_0)
    """

    source = "definition"
    symbol = "+ sin ft"

    cosine: float = parameter(default=0.0, about="amplitude a of the cosine", unit="?u")
    sine: float = parameter(default=0.0, about="amplitude b of the sine", unit="?u")
    frequency: float = parameter(default=1.0, about="frequency f", unit="Hz", above=0.0)
    since: float = parameter(default=0.0, about="instant from which the time is counted", unit="s", known=True)
    u = Input("any signal", unit="?u")
    y = Output("the signal with the oscillation added", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        phase = 2 * math.pi * self.frequency * (t - self.since)
        return dict(y=u.u + self.cosine * ca.cos(phase) + self.sine * ca.sin(phase))
