"""Sampled blocks, each with its own period, next to continuous ones.

The first sample is taken as the run starts, whatever the time is then. At a sample instant the outputs
are formed from the old state and the present inputs and then held; then the state is updated.
"""

from __future__ import annotations

import math
from typing import Any

from tsmblocks.blocks import linear_systems as systems
from tsmblocks.blocks.shared import UNIT, UNIT_IN, anti_windup, check_limits, limited
from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter, state


def _period() -> Any:
    """Declare the option that every sampled block has."""
    return option(default=0.01, about="time between samples", unit="s", above=0.0)


@block
class ZeroOrderHold(Block):
    r"""Zero-order hold: samples its input and holds it until the next sample.

    .. math:: y(t) = u(kT), \qquad kT \le t < (k + 1) T
    """

    source = "definition"
    symbol = "ZOH"
    symbol_with_values = "ZOH\n{period} s"
    sampled = True

    period: float = _period()
    u = Input("any signal", unit="?u")
    y = Output("the signal at the last sample", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u)


@block
class UnitDelay(Block):
    r"""Delay by one sample.

    .. math:: y_k = u_{k-1}
    """

    source = "definition"
    symbol = "1/z"
    sampled = True

    period: float = _period()
    initial: float = parameter(default=0.0, about="output until the second sample", unit="?u")
    u = Input("any signal", unit="?u")
    y = Output("the signal one sample ago", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        return {"last": State(self.initial, "input at the last sample", "?u")}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(last=u.u)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.last)


@block
class DiscreteTransferFunction(Block):
    r"""Discrete transfer function given by its coefficients, highest power of z first.

    .. math::

        \frac{Y(z)}{U(z)} = \frac{b_0 z^n + \dots + b_n}{a_0 z^n + \dots + a_n}, \qquad
        a_0 w_k = u_k - \sum_{i=1}^n a_i w_{k-i}, \quad y_k = \sum_{i=0}^n b_i w_{k-i}

    A short numerator is padded with zeros on the left; without :math:`b_0` the input does not reach the output at the
    same sample (no direct feedthrough).
    """

    source = "Oppenheim and Schafer, Discrete-Time Signal Processing, section 6.3 (direct form II)"
    symbol = "b(z)/a(z)"
    symbol_with_values = "{num:z}/({den:z})"
    sampled = True

    period: float = _period()
    num: tuple[float, ...] = parameter(default=(1.0,), about="numerator")
    den: tuple[float, ...] = parameter(default=(1.0,), about="denominator; its length sets the order")
    x0: tuple[float, ...] = parameter(
        default=(), about="initial states w, newest first; an empty list means zeros", initial=True
    )
    unit: str = option(default="", about=UNIT)
    unit_in: str = option(default="", about=UNIT_IN)

    u = Input("any signal", unit_option="unit_in")
    y = Output("filtered signal", unit_option="unit")

    check = systems.check_fraction
    updates = systems.fraction_states
    outputs = systems.fraction_output

    @property
    def states(self) -> dict[str, State]:
        return systems.initial_states(self.x0, len(self.den) - 1, "w before this sample, by", "w")


@block
class DiscreteStateSpace(Block):
    r"""Discrete state-space model given by its matrices, with any number of inputs and outputs.

    .. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k + D u_k

    Ports are named as those of ``StateSpace``. Without D there is no direct feedthrough. Without any matrix the signal
    passes unchanged.
    """

    source = "Åström and Wittenmark, Computer-Controlled Systems, section 2.3"
    symbol = "A,B,C,D"
    sampled = True

    period: float = _period()
    A: systems.Rows = parameter(default=(), about="state matrix, as rows")
    B: systems.Rows = parameter(default=(), about="input matrix, as rows")
    C: systems.Rows = parameter(default=(), about="output matrix, as rows")
    D: systems.Rows = parameter(default=(), about="direct matrix, as rows; an empty list means none")
    x0: tuple[float, ...] = parameter(default=(), about="initial states; an empty list means zeros", initial=True)
    input_names: tuple[str, ...] = systems.names_of("inputs", "u, or u1, u2, …")
    output_names: tuple[str, ...] = systems.names_of("outputs", "y, or y1, y2, …")
    state_names: tuple[str, ...] = systems.names_of("states", "x1, x2, …")

    check = systems.check_matrices
    inports = systems.matrix_inputs
    outports = systems.matrix_outputs
    states = systems.matrix_states
    updates = systems.state_equation
    outputs = systems.output_equation


@block
class DiscretePID(Block):
    r"""Sampled PID by backward differences, with output limits and anti-windup.

    .. math::

        i_k &= I_{k-1} + k_I T e_k, \qquad
        d_k = \frac{\tau d_{k-1} + k_D (e_k - e_{k-1})}{\tau + T} \\
        w_k &= k_P e_k + i_k + d_k, \qquad y_k = \min(\max(w_k, y_{low}), y_{high}), \qquad
        I_k = i_k + k_{aw} T (y_k - w_k)

    With :math:`\tau = 0` the derivative is the plain difference quotient. Keep :math:`k_{aw} T` below 1. By
    default it has no limits and no integral action; without integral action (kI = 0) there is no anti-windup either.
    """

    source = "Åström and Hägglund, PID Controllers (1995), section 3.6"
    symbol = "PID(z)"
    symbol_with_values = "PID(z)\nkp {kp}, ki {ki}, kd {kd}"
    sampled = True

    period: float = _period()
    kp: float = parameter(default=1.0, about="proportional gain")
    ki: float = parameter(default=0.0, about="integral gain", unit="1/s", factor="ki")
    kd: float = parameter(default=0.0, about="derivative gain", unit="s", factor="kd")
    tau: float = parameter(
        default=0.01, about="time constant of the derivative filter", unit="s", at_least=0.0, factor="kd"
    )
    low: float = parameter(default=-math.inf, about="smallest output", unit="?u", finite=False)
    high: float = parameter(default=math.inf, about="largest output", unit="?u", finite=False)
    kaw: float = parameter(
        default=2.0, about="rate of the anti-windup at a limit", unit="1/s", at_least=0.0, factor="ki"
    )

    e = Input("reference minus measurement", unit="?e")
    y = Output("control effort within the limits", unit="?u")
    integral: float = state(default=0.0, about="integral action", unit="?u")
    derivative: float = state(default=0.0, about="derivative action at the last sample", unit="?u")
    last: float = state(default=0.0, about="error at the last sample", unit="?e")

    check = check_limits

    def _actions(self, x: Any, u: Any) -> tuple[Any, Any, Any]:
        """Integral and derivative action, and the control effort before the limits."""
        integral = x.integral + self.ki * self.period * u.e
        derivative = (self.tau * x.derivative + self.kd * (u.e - x.last)) / (self.tau + self.period)
        return integral, derivative, self.kp * u.e + integral + derivative

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        integral, derivative, unlimited = self._actions(x, u)
        excess = limited(self, unlimited) - unlimited
        return dict(integral=integral + anti_windup(self) * self.period * excess, derivative=derivative, last=u.e)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=limited(self, self._actions(x, u)[2]))


@block
class DiscreteIntegrator(Block):
    r"""Discrete integrator: a running sum instead of an integral.

    .. math::

        \text{forward: } y_k &= x_k, \qquad
        \text{backward: } y_k = x_k + K T u_k, \qquad
        \text{trapezoidal: } y_k = x_k + \tfrac12 K T u_k \\
        x_{k+1} &= x_k + K T u_k
    """

    source = "Åström and Wittenmark, Computer-Controlled Systems, section 8.2"
    symbol = "T/(z-1)"
    sampled = True

    period: float = _period()
    method: str = option(default="forward", about="integration rule", choices=("forward", "backward", "trapezoidal"))
    gain: float = parameter(default=1.0, about="gain")
    initial: float = parameter(default=0.0, about="sum at the start", unit="?u*s")
    u = Input("any signal", unit="?u")
    y = Output("its integral", unit="?u*s")

    @property
    def states(self) -> dict[str, State]:
        return {"total": State(self.initial, "sum up to the last sample", "?u*s")}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(total=x.total + self.gain * self.period * u.u)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if self.method == "forward":  # without a path from the input
            return dict(y=x.total)
        share = 1.0 if self.method == "backward" else 0.5
        return dict(y=x.total + share * self.gain * self.period * u.u)


@block
class MovingAverage(Block):
    r"""Moving average: the mean of the last samples.

    .. math:: y_k = \frac1n \sum_{i=0}^{n-1} u_{k-i}
    """

    source = "definition"
    symbol = "mean"
    symbol_with_values = "mean\n{length} samples"
    sampled = True

    period: float = _period()
    length: int = option(default=5, about="number of samples in the mean", at_least=1, at_most=10_000)
    initial: float = parameter(default=0.0, about="samples before the first", unit="?u")
    u = Input("any signal", unit="?u")
    y = Output("its mean over the last samples", unit="?u")

    @property
    def states(self) -> dict[str, State]:
        return {f"u{k}": State(self.initial, f"input {k} samples ago", "?u") for k in range(1, self.length)}

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(zip(x._fields, (u.u, *x[:-1]), strict=False))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=(u.u + sum(x)) / self.length)
