"""Blocks that delay a signal by any time, zero included: lag and dead time."""

from __future__ import annotations

from typing import Any

import attrs
import casadi as ca

from tsmblocks.model.block import Block, Input, Output, Past, State, block, option, parameter, state

BEFORE = -1e200
"""Initial time [s], so early that its state has decayed. Chosen: finite, so that derivatives are."""

ZERO_TIME = 1e-30
"""Time [s] below which a time constant counts as zero. Chosen: its inverse squared is finite."""

QUOTIENT_SHIFT = 1e-18
"""Added to numerator and denominator of a quotient with a limit at 0. Chosen: below the rounding of any other value."""


@block
class Lag(Block):
    r"""A first-order lag of any time constant, zero included, that is stable at any step.

    .. math:: T \dot y &= u - y

    Coded as its solution, with the input along the parabola through its values now, at the start of the
    step and a step earlier. With s the time since the start of the step, and of the step before it the
    length l and the mean rate m of the input,

    .. math::

        y &= u + w, \qquad w = w_k e^{-s/T} - (u - u_k) a + c \left[s a - 2 T (1 - a)\right] \\
        a &= \frac{T}{s} \left(1 - e^{-s/T}\right), \qquad c = \frac{u - u_k - m s}{s + l}

    At T = 0 the signal passes bit for bit, and the derivative of the output by T there is that of -T du/dt.
    The output starts at the first value of the input, from which ``behind`` takes it away; the first step runs along a
    line.
    """

    source = "definition; the exact response to a piecewise parabola"
    symbol = "1/(Ts+1)"
    symbol_with_values = "1/({time_constant:s}+1)"

    time_constant: float = parameter(default=0.0, about="time to 63 % of a step", unit="s", at_least=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal, lagging", unit="?u")
    behind: float = state(default=0.0, about="output less input at the start of the step", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        return {
            **super().states,
            "time": State(BEFORE, "start of the step", "s"),
            "last": State(0.0, "input there", "?u"),
            "slope": State(0.0, "mean rate of the input in the step before", "?u/s"),
            "length": State(-BEFORE, "length of the step before", "s"),
        }

    def _behind(self, t: Any, x: Any, u: Any) -> Any:
        passed, rise = t - x.time, u.u - x.last
        T, constant = self.time_constant, ca.fmax(self.time_constant, ZERO_TIME)
        ratio = ca.fmax(passed / constant, -0.5)  # time does not decrease
        left = ca.exp(-ratio)
        # Without lag the state decays at once, but not at the start of a step. Rounded down, this has derivative zero.
        lagging = T > ZERO_TIME
        still = ca.if_else(lagging, 0.0, ca.floor(left))
        left = ca.if_else(lagging, left, ca.floor(left))
        mean = (1 - still) * T / constant * (-ca.expm1(-(ratio + QUOTIENT_SHIFT)) / (ratio + QUOTIENT_SHIFT))
        bend = (rise - x.slope * passed) / ca.fmax(passed + x.length, ZERO_TIME)
        behind = x.behind * left - rise * mean + bend * (T * (1 - left) - 2 * T * (1 - mean))
        return ca.if_else(x.time > 0.5 * BEFORE, behind, x.behind)

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        passed = t - x.time
        # 1 where no time has passed, as at an event; rounded, since a comparison would itself be an event.
        again = ca.floor(ca.exp(-ca.fmax(passed / ZERO_TIME, -0.5)))
        length = ca.fmax(passed, -0.5) + again
        return dict(
            time=t,
            last=u.u,
            behind=self._behind(t, x, u),
            slope=(u.u - x.last) / length + again * x.slope,
            length=length + again * (x.length - length),
        )

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self._behind(t, x, u))


@block
class DeadTime(Block):
    r"""The signal delayed by any time: shorter than a step, or zero.

    .. math:: y(t) = u(t - T)

    It is interpolated by the cubic through four instants, of which the present is one where T is less than a step; so
    at T = 0 the signal passes bit for bit, and the derivative of the output by T is exact there too. Of a signal that
    is constant within steps (a held input, samples, a Step) the output is the mean of the delayed signal over each
    step, which states integrate exactly. Unlike Delay it has direct feedthrough and breaks no algebraic loop. Before
    the start, ``start="first"`` holds the first value of the input and ``start="value"`` the number ``initial``.
    """

    source = "definition"
    symbol = "u(t-T)"
    symbol_with_values = "u(t-{time})"

    time: float = parameter(default=0.0, about="length of the delay", unit="s", at_least=0.0)
    initial: float = parameter(default=0.0, about='value before the run began, with start="value"', unit="?u")
    start: str = option(
        default="first", about="whether the first input or initial holds before the start", choices=("first", "value")
    )
    u = Input("any signal", unit="?u")
    past = Past("the signal one delay ago", of="u", by="time", initial="initial", now=True)
    y = Output("the delayed signal", unit="?u")

    @property
    def past_ports(self) -> dict[str, Past]:
        return {"past": attrs.evolve(self._declared["past"], first=self.start == "first")}

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.past)
