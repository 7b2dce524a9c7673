"""Blocks that limit or round a signal or a motion: saturation, dead zone, end stops, rate limit, relay, quantiser."""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.blocks.shared import LONG_AGO, check_limits, limited
from tsmblocks.common.errors import ParameterError
from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter, state

FAR = 800.0
"""Distance from a limit, in softnesses, beyond which nothing is rounded. Derived: e^-800 is zero in doubles."""


@block
class Saturation(Block):
    r"""Saturation: hard limits of an actuator.

    .. math:: y = \min(\max(u, l), h)

    Between the limits l and h the signal passes unchanged. Where only one limit is given, the other is its opposite:
    ``Saturation(high=10.0)`` limits to ±10. An infinite one is no limit.

    The defaults are those of the paper's drive, which gives the motor between 0 and 24 V. A sine needs both
    directions, so 24 V is taken as the largest magnitude: with 0 to 24 V the motor never returns, and the diagram of
    Fig. 9(b) leaves an error of 110 deg peak to peak.
    """

    source = "Paper, section 5.1: between 0 and 24 V; taken in both directions"
    symbol = "sat"
    symbol_with_values = "sat\n{low:value} … {high:unit}"

    low: float = parameter(default=-24.0, about="least output", unit="?u", finite=False, opposite="high", acts_at="u")
    high: float = parameter(default=24.0, about="largest output", unit="?u", finite=False, opposite="low", acts_at="u")
    u = Input("wanted value", unit="?u")
    y = Output("value the actuator can give", unit="?u")

    check = check_limits

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=limited(self, u.u))


@block
class SoftSaturation(Block):
    r"""Soft saturation: limits of an actuator or a spring that are reached gradually.

    .. math:: y = u - s \ln\left(1 + e^{(u - h)/s}\right) + s \ln\left(1 + e^{(l - u)/s}\right)

    It tends to the hard limits l and h as s falls; with infinite limits the signal passes as it is.
    """

    source = "definition; Dugas and others, NIPS 13 (2000), the softplus function"
    symbol = "soft sat"
    symbol_with_values = "soft sat\n{low:value} … {high:unit}"

    low: float = parameter(default=-24.0, about="least output", unit="?u", finite=False, opposite="high", acts_at="u")
    high: float = parameter(default=24.0, about="largest output", unit="?u", finite=False, opposite="low", acts_at="u")
    softness: float = parameter(default=1.0, about="distance s from a limit where it begins", unit="?u", above=0.0)
    u = Input("wanted value", unit="?u")
    y = Output("value the actuator can give", unit="?u")

    check = check_limits

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        above, below = _rounding(u.u - self.high, self.softness), _rounding(self.low - u.u, self.softness)
        return dict(y=limited(self, u.u) - above + below)


def _softened(away: Any, softness: Any) -> Any:
    """The positive part of a signal, rounded; no exponential of a large number is ever formed."""
    return ca.fmax(away, 0.0) + _rounding(away, softness)


def _rounding(away: Any, softness: Any) -> Any:
    """By how much a corner is rounded, so far away from it."""
    return softness * _log_rounding(away, softness)


def _log_rounding(away: Any, softness: Any) -> Any:
    distance = ca.fmin(ca.fabs(away), FAR * softness)  # of an infinite limit, too, whose derivative would be NaN
    return ca.log1p(ca.exp(-distance / softness))


@block
class DeadZone(Block):
    r"""Dead zone: no output until the input leaves the zone.

    .. math:: y = \max(u - h, 0) + \min(u - l, 0)
    """

    source = "definition"
    symbol = "dead zone"
    symbol_with_values = "dead zone\n{low:value} … {high:unit}"

    low: float = parameter(default=-0.05, about="lower edge of the zone", unit="?u", opposite="high", acts_at="u")
    high: float = parameter(default=0.05, about="upper edge of the zone", unit="?u", opposite="low", acts_at="u")
    u = Input("any signal", unit="?u")
    y = Output("the part of the signal beyond the zone", unit="?u")

    def check(self) -> None:
        if self.low > self.high:
            raise ParameterError(f"DeadZone needs low <= high, got low={self.low:g}, high={self.high:g}.")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.fmax(u.u - self.high, 0.0) + ca.fmin(u.u - self.low, 0.0))


@block
class EndStops(Block):
    r"""End stops of a motion: a spring and a damper at each end, which never pull.

    .. math::

        y = f(x - h,\, v) - f(l - x,\, -v), \qquad
        f(p, v) = \max\left(k p + c \frac{p}{p + w} v,\ 0\right) \text{ for } p > 0, \text{ else } 0

    ``y`` is the force that the motion has to overcome; an equation of motion subtracts it. Damping sets in over the
    compression w, so that the force has no jump: with a small w the contact is that of Kelvin and Voigt, with a large
    one that of Hunt and Crossley. For a stop at one side only, the other limit is infinite.
    """

    source = "Hunt and Crossley, J. Appl. Mech. 42 (1975) 440: damping that grows with the compression"
    symbol = "stops"
    symbol_with_values = "stops\n{low:value} … {high:unit}"

    low: float = parameter(default=-1.0, about="position l of the lower stop", unit="?x", finite=False, acts_at="x")
    high: float = parameter(default=1.0, about="position h of the upper stop", unit="?x", finite=False, acts_at="x")
    stiffness: float = parameter(default=100.0, about="force k per compression", at_least=0.0)
    damping: float = parameter(default=0.0, about="force c per rate of compression", at_least=0.0)
    transition: float = parameter(
        default=0.01, about="compression w at half the damping", unit="?x", above=0.0, acts_at="x"
    )
    x = Input("position of what moves", unit="?x")
    v = Input("its rate", unit="?x/s", rate_of="x")
    y = Output("force to be overcome, positive at the upper stop", unit="?f")

    def check(self) -> None:
        if self.low > self.high:
            raise ParameterError(f"EndStops needs low <= high, got low={self.low:g}, high={self.high:g}.")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._contact(u.x - self.high, u.v) - self._contact(self.low - u.x, -u.v))

    def _contact(self, beyond: Any, rate: Any) -> Any:
        """The force of one stop, compressed so far and at this rate."""
        p = ca.fmax(beyond, 0.0)
        return p * ca.fmax(self.stiffness + self.damping / (p + self.transition) * rate, 0.0)


@block
class SoftDeadZone(Block):
    r"""Dead zone with rounded edges, in which the output rests near the centre.

    .. math:: y = c + s \ln\left(1 + e^{(u - c - w)/s}\right) - s \ln\left(1 + e^{(c - u - w)/s}\right)

    It tends to a dead zone from c - w to c + w as s falls; without a width the signal passes as it is.
    """

    source = "definition; Dugas and others, NIPS 13 (2000), the softplus function"
    symbol = "soft zone"
    symbol_with_values = "soft zone\n± {half_width:unit}"

    half_width: float = parameter(default=0.05, about="half width w of the zone", unit="?u", at_least=0.0)
    centre: float = parameter(default=0.0, about="centre c of the zone", unit="?u")
    softness: float = parameter(default=0.01, about="distance s over which an edge is rounded", unit="?u", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the signal without the zone", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        away, width = u.u - self.centre, self.half_width
        lost = ca.fmin(ca.fmax(away, -width), width)
        upper, lower = _log_rounding(away - width, self.softness), _log_rounding(away + width, self.softness)
        return dict(y=u.u - lost + self.softness * (upper - lower))  # one product, so that equal parts cancel exactly


@block
class RateLimit(Block):
    r"""Rate limit: the output follows the input no faster than the limits allow.

    .. math:: y(t) = \min(\max(u,\; y_k + f (t - t_k)),\; y_k + r (t - t_k))

    with :math:`y_k` the output at the start of the step, :math:`t_k`. A jump of the input at the end of a step counts
    in all of it, so that the output is up to one step early behind a held input. The defaults are a motor of 3 rad/s.
    With ``start="input"`` the first value passes as it is, with ``start="last"`` the output starts from the state
    ``last`` at time zero.
    """

    source = "definition"
    symbol = "rate limit"
    symbol_with_values = "rate limit\n{falling:value} … {rising:unit}"

    rising: float = parameter(default=3.0, about="fastest rise", unit="?u/s", above=0.0, opposite="falling")
    falling: float = parameter(default=-3.0, about="fastest fall, negative", unit="?u/s", below=0.0, opposite="rising")
    start: str = option(
        default="input", about="whether the output starts at the input or at last", choices=("input", "last")
    )
    u = Input("wanted value", unit="?u")
    y = Output("value within the rate limits", unit="?u")
    last: float = state(default=0.0, about="output at the start of the step", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        begin = LONG_AGO if self.start == "input" else 0.0
        return {**super().states, "time": State(begin, "start of the step", "s")}

    def _limited(self, t: Any, x: Any, u: Any) -> Any:
        passed = t - x.time
        slowest, fastest = x.last + self.falling * passed, x.last + self.rising * passed
        # As each step begins all three are equal, and the slope of the input continues.
        return ca.if_else(u.u > fastest, fastest, ca.if_else(u.u < slowest, slowest, u.u))

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(last=self._limited(t, x, u), time=t)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._limited(t, x, u))


@block
class SoftRateLimit(Block):
    r"""Soft rate limit: a drive that approaches its greatest speed gradually, and then catches up with a lag.

    .. math::

        \dot y = w - s \ln\left(1 + e^{(w - r)/s}\right) + s \ln\left(1 + e^{(f - w)/s}\right), \qquad
        w = \dot u + (u - y)/T

    with w held over each step as :math:`(u - y_k - (u_k - y_k) e^{-(t - t_k)/T})/(t - t_k)`. It tends to ``RateLimit``
    as s and T fall. The first value passes as it is; with limits that are never reached all others do too.
    """

    source = "definition; the soft limit is that of SoftSaturation"
    symbol = "soft rate"
    symbol_with_values = "soft rate\n{falling:value} … {rising:unit}"

    rising: float = parameter(default=3.0, about="fastest rise r", unit="?u/s", above=0.0, opposite="falling")
    falling: float = parameter(
        default=-3.0, about="fastest fall f, negative", unit="?u/s", below=0.0, opposite="rising"
    )
    softness: float = parameter(default=0.3, about="distance s from a limit where it begins", unit="?u/s", above=0.0)
    lag: float = parameter(default=0.03, about="time constant T with which it catches up", unit="s", above=0.0)

    u = Input("wanted value", unit="?u")
    y = Output("value within the rate limits", unit="?u")
    last: float = state(default=0.0, about="input at the start of the step", unit="?u")
    behind: float = state(default=0.0, about="input less output at the start of the step", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        return {**super().states, "time": State(LONG_AGO, "start of the step", "s")}

    def _behind(self, t: Any, x: Any, u: Any) -> Any:
        passed = ca.fmax(t - x.time, 1e-12)  # as a step begins nothing is divided by zero
        left = x.behind * ca.exp(-passed / self.lag)
        travel, softness = u.u - x.last + x.behind - left, self.softness * passed
        held = _softened(travel - self.rising * passed, softness) - _softened(self.falling * passed - travel, softness)
        return ca.if_else(x.time > 0.5 * LONG_AGO, left + held, x.behind)

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(last=u.u, behind=self._behind(t, x, u), time=t)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u - self._behind(t, x, u))


@block
class Relay(Block):
    r"""Two-point switch with hysteresis: it switches on at a larger input than it switches off.

    .. math::

        m_k = \begin{cases} 1 & u_k \ge a \\ 0 & u_k \le b \\ m_{k-1} & b < u_k < a \end{cases}, \qquad
        y = l + (h - l) m_k

    with :math:`u_k` the input at the start of the step. It switches there and holds within the step, up to a step late;
    with ``locate=True`` it switches at the located instant.
    """

    source = "definition"
    symbol = "relay"

    on: float = parameter(default=0.01, about="input a at and above which it is on", unit="?u")
    off: float = parameter(default=-0.01, about="input b at and below which it is off", unit="?u")
    high: float = parameter(default=24.0, about="output while on", unit="?y")
    low: float = parameter(default=-24.0, about="output while off", unit="?y")

    u = Input("any signal", unit="?u")
    y = Output("one of two values", unit="?y")
    active: float = state(default=0.0, about="1 while on, 0 while off", unit="1")

    def check(self) -> None:
        if self.off > self.on:
            raise ParameterError(f"Relay needs off <= on, got off={self.off:g}, on={self.on:g}.")

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        stays = ca.if_else(u.u <= self.off, 0.0, x.active)
        return dict(active=ca.if_else(u.u >= self.on, 1.0, stays))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        # From the memory only: stages that cross a level and return would act without a change of the memory.
        return dict(y=self.low + (self.high - self.low) * x.active)


@block
class Quantiser(Block):
    r"""Rounding to the nearest multiple of an interval.

    .. math:: y = q \left\lfloor \frac{u}{q} + \frac12 \right\rfloor
    """

    source = "definition"
    symbol = "round"
    symbol_with_values = "round\n{interval:unit}"

    interval: float = parameter(default=0.01, about="distance between two values", unit="?u", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("the rounded signal", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.interval * ca.floor(u.u / self.interval + 0.5))
