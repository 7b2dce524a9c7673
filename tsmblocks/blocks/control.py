"""Blocks that compensate and control: the paper's observer, slope, compensator and PID, and two general ones.

The formulas of the transmission come from the hysteresis family, so plant and compensator cannot differ.
"""

from __future__ import annotations

import math
from typing import Any

from tsmblocks.blocks.hysteresis import hysteresis_state, slope
from tsmblocks.blocks.shared import anti_windup, check_limits, limited
from tsmblocks.model.block import Block, Input, Output, block, parameter, state


@block
class HysteresisObserver(Block):
    r"""Estimate of the transmission's internal state from a rate alone (Fig. 7).

    .. math:: \dot{\hat\zeta} = A v - \theta |v| \hat\zeta + \delta |v|

    The paper prints it without the dot on the left. The paper drives it with the rate of the reference; driven
    with the measured rate of the motor it estimates better, because the motor moves the plant.
    """

    source = "Paper, Eq (12), Fig. 7"
    symbol = "ζ̂"

    A: float = parameter(default=-0.8745, about="gain from the rate to the internal state")
    theta: float = parameter(default=5.034, about="decay of the internal state with travel", unit="1/rad", above=0.0)
    delta: float = parameter(default=0.14522, about="asymmetry of the loop")
    v = Input("rate of the reference, or of the motor", unit="rad/s")
    y = Output("estimated internal state", unit="rad")
    zeta: float = state(default=0.0, about="estimated internal state", unit="rad")

    derivatives = hysteresis_state

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.zeta)


@block
class SmoothSlope(Block):
    r"""Slope of the transmission at a given rate, passing smoothly between its two values (Fig. 8).

    .. math:: y = \alpha_x(v) = \frac{\alpha_1 e^{2v} + \alpha_2}{e^{2v} + 1}

    Coded with tanh: equal, and it cannot overflow.
    """

    source = "Paper, Eq (13), Fig. 8"
    symbol = "αₓ(v)"

    alpha1: float = parameter(default=0.8972, about="slope while loading (v > 0)", above=0.0)
    alpha2: float = parameter(default=0.9487, about="slope while unloading (v < 0)", above=0.0)
    v = Input("rate of the reference", unit="rad/s")
    y = Output("slope of the transmission", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=slope(u.v, self.alpha1, self.alpha2))


@block
class FeedforwardCompensator(Block):
    r"""Motor command that should make the tool follow the reference, without a sensor at the tool.

    .. math::

        x_{FF} &= \frac{x_r - \hat\zeta}{\alpha_x(\dot x_r)} \\
        \dot{\hat\zeta} &= A \dot x_r - \theta |\dot x_r| \hat\zeta + \delta |\dot x_r|

    Not an exact inverse: the plant's state follows the rate of :math:`x_{FF}`, the estimate that
    of :math:`x_r`. With a perfect model it still leaves about 13 of 29 degrees.
    """

    source = "Paper, Eqs (11) to (13)"
    symbol = "(x-ζ̂)/αₓ"

    alpha1: float = parameter(default=0.8972, about="slope while loading (v > 0)", above=0.0)
    alpha2: float = parameter(default=0.9487, about="slope while unloading (v < 0)", above=0.0)
    A: float = parameter(default=-0.8745, about="gain from the rate to the internal state")
    theta: float = parameter(default=5.034, about="decay of the internal state with travel", unit="1/rad", above=0.0)
    delta: float = parameter(default=0.14522, about="asymmetry of the loop")

    x = Input("reference of the tool", unit="rad")
    v = Input("its rate", unit="rad/s", rate_of="x")
    y = Output("command for the motor", unit="rad")
    zeta: float = state(default=0.0, about="estimated internal state", unit="rad")

    derivatives = hysteresis_state

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=(u.x - x.zeta) / slope(u.v, self.alpha1, self.alpha2))


@block
class PID(Block):
    r"""Proportional, integral and filtered derivative action on an error.

    .. math:: y = k_P e + k_I \int e\,dt + k_D \frac{s}{1 + \tau s}\, e

    The pure derivative of (15) is not proper, so it is filtered. Keep ``tau`` above about 0.36 of the step of the run:
    below that the filter is unstable with rk4. By default the error passes unchanged; the paper's gains are kP = 1.5,
    kI = 2 and kD = 0.
    """

    source = "Paper, Eq (15)"
    symbol = "PID"
    symbol_with_values = "PID\nkp {kp}, ki {ki}, kd {kd}"

    kp: float = parameter(default=1.0, about="proportional gain")
    ki: float = parameter(default=0.0, about="integral gain", unit="1/s", factor="ki")
    kd: float = parameter(default=0.0, about="derivative gain", unit="s", factor="kd")
    tau: float = parameter(
        default=0.01, about="time constant of the derivative filter", unit="s", above=0.0, factor="kd"
    )

    e = Input("reference minus measurement", unit="?e")
    y = Output("control effort", unit="?y")
    integral: float = state(default=0.0, about="time integral of the error", unit="?e*s")
    smooth: float = state(default=0.0, about="error after the derivative filter", unit="?e")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(integral=u.e, smooth=(u.e - x.smooth) / self.tau)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        # Collected by input and states: the error, which a loop waits for, then enters by one product alone.
        steep = self.kd / self.tau
        return dict(y=(self.kp + steep) * u.e + (self.ki * x.integral - steep * x.smooth))


@block
class PIDController(Block):
    r"""PID with two degrees of freedom, output limits and anti-windup by back-calculation.

    .. math::

        w &= k_P (b\, r - y_m) + I + k_D \frac{s}{1 + \tau s} (c\, r - y_m), \qquad
        u = \min(\max(w, u_{low}), u_{high}) \\
        \dot I &= k_I (r - y_m) + k_{aw} (u - w)

    b and c weight the reference in the proportional and the derivative action. By default it has
    no limits and no integral action; without integral action (kI = 0) there is no anti-windup either.
    """

    source = "Åström and Hägglund, PID Controllers (1995), sections 3.4 and 3.5"
    symbol = "PID"
    symbol_with_values = "PID\nkp {kp}, ki {ki}, kd {kd}"

    kp: float = parameter(default=1.0, about="proportional gain")
    ki: float = parameter(default=0.0, about="integral gain", unit="1/s", factor="ki")
    kd: float = parameter(default=0.0, about="derivative gain", unit="s", factor="kd")
    tau: float = parameter(
        default=0.01, about="time constant of the derivative filter", unit="s", above=0.0, factor="kd"
    )
    b: float = parameter(default=1.0, about="weight of the reference in the proportional action")
    c: float = parameter(default=0.0, about="weight of the reference in the derivative action", factor="c")
    low: float = parameter(default=-math.inf, about="smallest output", unit="?u", finite=False)
    high: float = parameter(default=math.inf, about="largest output", unit="?u", finite=False)
    kaw: float = parameter(
        default=2.0, about="rate of the anti-windup at a limit", unit="1/s", at_least=0.0, factor="ki"
    )

    r = Input("reference", unit="?r")
    ym = Input("measurement", unit="?r")
    u = Output("control effort within the limits", unit="?u")
    integral: float = state(default=0.0, about="integral action", unit="?u")
    smooth: float = state(default=0.0, about="c r - ym after the derivative filter", unit="?r")

    check = check_limits

    def _rate(self, x: Any, u: Any) -> Any:
        return (self.c * u.r - u.ym - x.smooth) / self.tau

    def _unlimited(self, x: Any, u: Any) -> Any:
        return self.kp * (self.b * u.r - u.ym) + x.integral + self.kd * self._rate(x, u)

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        unlimited = self._unlimited(x, u)
        excess = limited(self, unlimited) - unlimited
        return dict(integral=self.ki * (u.r - u.ym) + anti_windup(self) * excess, smooth=self._rate(x, u))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(u=limited(self, self._unlimited(x, u)))


@block
class LeadLag(Block):
    r"""First-order compensator that leads or lags in phase.

    .. math:: \frac{Y(s)}{U(s)} = k\, \frac{1 + T_1 s}{1 + T_2 s}

    By default both time constants are equal, and the signal passes unchanged.
    """

    source = "Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems, section 6.7"
    symbol = "lead-lag"
    symbol_with_values = "{gain}({lead:s}+1)/({lag:s}+1)"

    gain: float = parameter(default=1.0, about="gain at rest")
    lead: float = parameter(default=0.1, about="time constant of the numerator", unit="s")
    lag: float = parameter(default=0.1, about="time constant of the denominator", unit="s", above=0.0)
    u = Input("any signal", unit="?u")
    y = Output("compensated signal", unit="?y")
    smooth: float = state(default=0.0, about="input after the lag", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(smooth=(u.u - x.smooth) / self.lag)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.gain * (x.smooth + self.lead * (u.u - x.smooth) / self.lag))
