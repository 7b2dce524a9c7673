"""Linear blocks of one equation: integral, derivative, lags, delay."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from tsmblocks.blocks.shared import check_limits, limited
from tsmblocks.common.errors import ParameterError
from tsmblocks.model.block import Block, Input, Output, Past, block, option, parameter, state


@block
class Integrator(Block):
    r"""Time integral of a signal, with limits and an optional reset.

    .. math:: \dot z = K u \text{ unless it leads past a limit}, \qquad y = \min(\max(z, l), h)

    With ``reset=True`` there is a port ``reset``: where it is above 0.5 at the start of a step (with ``locate=True`` at
    the located instant) the integral is set to its initial state, with ``target=True`` to the value at the port ``to``.
    With ``enable=True`` there is a port ``enable``: at 0.5 and below the integral is held.
    """

    source = "definition"
    symbol = "∫"
    symbol_with_values = "{gain:∫}"

    gain: float = parameter(default=1.0, about="factor on the input", by_definition=1.0)
    low: float = parameter(default=-math.inf, about="smallest output", unit="?u*s", finite=False)
    high: float = parameter(default=math.inf, about="largest output", unit="?u*s", finite=False)
    reset: bool = option(default=False, about="whether there is a port that resets the integral")
    target: bool = option(default=False, about="whether a port gives the value to which it is reset")
    enable: bool = option(default=False, about="whether there is a port that holds the integral while it is off")
    unit: str = option(
        default="", about="unit of the output if the gain has a unit; empty means that of the input times s"
    )

    u = Input("any signal", unit="?u")
    y = Output("its time integral", unit="?u*s", unit_option="unit")
    integral: float = state(default=0.0, about="the integral; starts and is reset here", unit="?u*s")

    def check(self) -> None:
        check_limits(self)
        if self.target and not self.reset:
            raise ParameterError("Integrator: target=True gives the value of a reset, so it needs reset=True.")
        if not self.low <= self.integral <= self.high:
            raise ParameterError(
                f"Integrator.integral must start within its limits, {self.low:g} to {self.high:g}, "
                f"got {self.integral:g}."
            )

    @property
    def inports(self) -> dict[str, Input]:
        more = {"reset": Input("above 0.5 resets the integral")} if self.reset else {}
        if self.target:
            more["to"] = Input("value to which the integral is reset", unit="?u*s", unit_option="unit")
        if self.enable:
            more["enable"] = Input("at 0.5 and below the integral is held")
        return {**{k: self._in_unit(p) for k, p in {**super().inports, **more}.items()}}

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        rate = self.gain * u.u
        if self.enable:
            rate = ca.if_else(u.enable > 0.5, rate, 0.0)
        above_low = ca.if_else(x.integral <= self.low, ca.fmax(rate, 0.0), rate)
        return dict(integral=ca.if_else(x.integral >= self.high, ca.fmin(rate, 0.0), above_low))

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if not self.reset:
            return {}
        return dict(integral=ca.if_else(u.reset > 0.5, u.to if self.target else self.integral, x.integral))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=limited(self, x.integral))


@block
class Derivative(Block):
    r"""Exact time derivative of a signal, without a filter and without a delay.

    .. math:: y = \dot u

    It is formed by differentiating the equations that make the signal; a signal held between
    samples has no derivative, so use FilteredDerivative there.
    """

    source = "definition"
    symbol = "d/dt"

    u = Input("signal made of states, time and smooth inputs", unit="?u")
    rate = Input("its time derivative; formed exactly when nothing drives it", unit="?u/s", rate_of="u")
    y = Output("time derivative of the signal", unit="?u/s")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.rate)


@block
class FilteredDerivative(Block):
    r"""Filtered derivative, for measured signals: the derivative behind a first-order lag.

    .. math:: y = \dot z = \frac{u - z}{T}, \qquad \frac{Y(s)}{U(s)} = \frac{s}{T s + 1}

    Where the signal does not start at zero, start ``smooth`` at its first value.
    """

    source = "Åström and Hägglund, PID Controllers (1995), section 3.3"
    symbol = "s/(Ts+1)"
    symbol_with_values = "s/({time_constant:s}+1)"

    time_constant: float = parameter(default=0.01, about="time constant of the filter", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("its filtered derivative", unit="?u/s")
    smooth: float = state(default=0.0, about="the signal after the filter", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(smooth=(u.u - x.smooth) / self.time_constant)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.derivatives(t, x, u)["smooth"])


@block
class FirstOrderLag(Block):
    r"""First-order lag: after a step of the input, the output approaches its final value exponentially.

    .. math:: T \dot z = K u - z, \qquad y = z, \qquad \frac{Y(s)}{U(s)} = \frac{K}{T s + 1}
    """

    source = "definition"
    symbol = "K/(Ts+1)"
    symbol_with_values = "{gain}/({time_constant:s}+1)"

    gain: float = parameter(default=1.0, about="output over input at rest")
    time_constant: float = parameter(default=0.05, about="time to 63 % of a step", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal, lagging", unit="?y")
    value: float = state(default=0.0, about="the output", unit="?y")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(value=(self.gain * u.u - x.value) / self.time_constant)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.value)


@block
class SecondOrderLag(Block):
    r"""Second-order lag: the output follows the input as a damped oscillator does.

    .. math::

        \ddot z = \omega^2 (K u - z) - 2 \zeta \omega \dot z, \qquad y = z, \qquad
        \frac{Y(s)}{U(s)} = \frac{K \omega^2}{s^2 + 2 \zeta \omega s + \omega^2}

    The defaults are a motor position loop of 20 Hz.
    """

    source = "definition"
    symbol = "Kω²/(s²+…)"
    symbol_with_values = "Kω²/(s²+2ζωs+ω²)\nK {gain}, ω {omega}, ζ {zeta}"

    gain: float = parameter(default=1.0, about="output over input at rest")
    omega: float = parameter(default=125.66370614359172, about="natural frequency", unit="rad/s", above=0.0)
    zeta: float = parameter(default=0.7, about="damping ratio", at_least=0.0)

    u = Input("any signal", unit="?u")
    y = Output("the signal, lagging", unit="?y")
    value: float = state(default=0.0, about="the output", unit="?y")
    rate: float = state(default=0.0, about="its rate", unit="?y/s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        pull = self.omega * self.omega * (self.gain * u.u - x.value)
        return dict(value=x.rate, rate=pull - 2 * self.zeta * self.omega * x.rate)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.value)


@block
class Delay(Block):
    r"""Delay: the signal at a fixed time before the present.

    .. math:: y(t) = u(t - T)

    It is interpolated by the cubic through four instants. A signal that is constant within steps (samples, a relay, a
    Step) is not smoothed: its jumps are kept. Of a held input the output is the mean of the delayed signal over each
    step, which is the signal itself where T is a whole number of steps and the input changes at steps. In a signal that
    also moves, a jump is spread over one step.
    """

    source = "definition"
    symbol = "e^(-Ts)"
    symbol_with_values = "e^(-{time}s)"

    time: float = parameter(default=0.01, about="length of the delay", unit="s", above=0.0)
    initial: float = parameter(default=0.0, about="value of the signal before the run began", unit="?u")
    u = Input("any signal", unit="?u")
    past = Past("the signal one delay ago", of="u", by="time", initial="initial")
    y = Output("the delayed signal", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.past)
