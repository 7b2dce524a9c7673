"""Linear blocks in continuous time: integral, derivative, lags, delay, transfer function, state space."""

from __future__ import annotations

from itertools import zip_longest
from typing import Any

import casadi as ca

from tsmblocks.block import Block, Input, Output, Past, State, block, option, parameter, state
from tsmblocks.errors import BlockError, ParameterError, in_words

Rows = tuple[tuple[float, ...], ...]
INFINITE = float("inf")


@block
class Integrator(Block):
    r"""Time integral of a signal, which stops at its limits and may be set back.

    .. math:: \dot z = K u \text{ unless it leads past a limit}, \qquad y = \min(\max(z, l), h)

    With ``reset=True`` there is a port ``reset``: where it is above 0.5 at the start of a step, the
    integral is set to its start value.
    """

    source = "definition"
    symbol = "∫"

    gain: float = parameter(default=1.0, about="factor on the input")
    low: float = parameter(default=-INFINITE, about="smallest output", unit="?u*s", finite=False)
    high: float = parameter(default=INFINITE, about="largest output", unit="?u*s", finite=False)
    reset: bool = option(default=False, about="whether there is a port that sets the integral back")

    u = Input("any signal", unit="?u")
    y = Output("its time integral", unit="?u*s")
    integral: float = state(default=0.0, about="the integral; starts and is reset here", unit="?u*s")

    def check(self) -> None:
        if self.low >= self.high:
            raise ParameterError(f"Integrator needs low < high, got low={self.low:g}, high={self.high:g}.")

    @property
    def inports(self) -> dict[str, Input]:
        more = {"reset": Input("above 0.5 sets the integral back")} if self.reset else {}
        return {"u": self._declared["u"], **more}

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        rate = self.gain * u.u
        above_low = ca.if_else(x.integral <= self.low, ca.fmax(rate, 0.0), rate)
        return dict(integral=ca.if_else(x.integral >= self.high, ca.fmin(rate, 0.0), above_low))

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        if not self.reset:
            return {}
        return dict(integral=ca.if_else(u.reset > 0.5, self.integral, x.integral))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.fmin(ca.fmax(x.integral, self.low), self.high))


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
    r"""Derivative of a signal behind a first-order lag, for signals that are measured.

    .. math:: \dot z = \frac{u - z}{T}, \qquad y = \frac{u - z}{T}, \qquad \frac{Y(s)}{U(s)} = \frac{s}{T s + 1}

    Where the signal does not start at zero, start ``smooth`` at its first value.
    """

    source = "Åström and Hägglund, PID Controllers (1995), section 3.3"
    symbol = "s/(Ts+1)"

    time_constant: float = parameter(default=0.01, about="time constant of the filter", unit="s", above=0.0)

    u = Input("any signal", unit="?u")
    y = Output("its filtered derivative", unit="?u/s")
    smooth: float = state(default=0.0, about="the signal after the filter", unit="?u")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(smooth=(u.u - x.smooth) / self.time_constant)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=(u.u - x.smooth) / self.time_constant)


@block
class FirstOrderLag(Block):
    r"""A value that follows its input exponentially.

    .. math:: T \dot z = K u - z, \qquad y = z, \qquad \frac{Y(s)}{U(s)} = \frac{K}{T s + 1}
    """

    source = "definition"
    symbol = "K/(Ts+1)"

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
    r"""A value that follows its input like a damped oscillator.

    .. math::

        \ddot z = \omega^2 (K u - z) - 2 \zeta \omega \dot z, \qquad y = z, \qquad
        \frac{Y(s)}{U(s)} = \frac{K \omega^2}{s^2 + 2 \zeta \omega s + \omega^2}

    The defaults are a motor position loop of 20 Hz.
    """

    source = "definition"
    symbol = "Kω²/(s²+…)"

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
    r"""The signal as it was some time ago.

    .. math:: y(t) = u(t - T)
    """

    source = "definition"
    symbol = "e^(-Ts)"

    time: float = parameter(default=0.01, about="how long ago", unit="s", above=0.0)
    initial: float = parameter(default=0.0, about="value of the signal before the run began", unit="?u")

    u = Input("any signal", unit="?u")
    past = Past("the signal as it was", of="u", by="time", initial="initial")
    y = Output("the delayed signal", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.past)


# ---- rational transfer functions ------------------------------------------------------------


def _section(num: Any, den: Any, x: Any, u: Any) -> tuple[Any, Any]:
    """Highest derivative and output of num/den in controllable canonical form.

    A coefficient that is not given must not appear: as a symbol, 0 * u would count as a path from
    input to output.
    """
    newest = (u - sum(a * z for a, z in zip(den[1:], x, strict=True))) / den[0]
    kept = (newest, *x)[len(den) - len(num) :]
    return newest, sum(b * z for b, z in zip(num, kept, strict=True))


def _starts(x0: tuple[Any, ...], n: int, about: str) -> dict[str, State]:
    """States ``x1`` to ``xn``; without start values they start at zero."""
    return {f"x{k}": State(start, f"{about} {k}") for k, start in enumerate(x0 or (0.0,) * n, 1)}


def _check_starts(owner: str, x0: tuple[Any, ...], n: int) -> None:
    """Raise ParameterError unless there are n start values or none."""
    if x0 and len(x0) != n:
        raise ParameterError(f"{owner}.x0 needs one number per state ({n}) or none, got {len(x0)}.")


@block
class TransferFunction(Block):
    r"""Linear block given by its coefficients, highest power of s first.

    .. math:: \frac{Y(s)}{U(s)} = \frac{b_0 s^m + \dots + b_m}{a_0 s^n + \dots + a_n}

    Controllable canonical form: ``x1`` is the highest derivative kept, each further state its
    integral. A numerator shorter than the denominator passes nothing at the same instant.
    """

    source = "Åström and Murray, Feedback Systems, section 7.2 (reachable canonical form)"
    symbol = "b(s)/a(s)"

    num: tuple[float, ...] = parameter(default=(1.0,), about="numerator")
    den: tuple[float, ...] = parameter(default=(0.05, 1.0), about="denominator; its length sets the order")
    x0: tuple[float, ...] = parameter(default=(), about="start values; an empty list means zeros")

    u = Input("any signal", unit="?u")
    y = Output("filtered signal", unit="?y")

    def check(self) -> None:
        for name in ("num", "den"):
            if any(isinstance(number, tuple) for number in getattr(self, name)):
                raise ParameterError(f"TransferFunction.{name} must be one list of numbers, such as [1, 0.5].")
        if not self.den or self.den[0] == 0:
            raise ParameterError(
                f"TransferFunction.den must begin with a number other than 0, got {in_words(self.den)}."
            )
        if not 1 <= len(self.num) <= len(self.den):
            raise ParameterError(
                f"TransferFunction must be proper: 1 <= len(num) <= len(den), got {len(self.num)} and {len(self.den)}."
            )
        _check_starts("TransferFunction", self.x0, len(self.den) - 1)

    @property
    def states(self) -> dict[str, State]:
        return _starts(self.x0, len(self.den) - 1, "canonical state")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        newest, _ = _section(self.num, self.den, x, u.u)
        return dict(zip(x._fields, (newest, *x), strict=False))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=_section(self.num, self.den, x, u.u)[1])


def _quadratic(pair: Any) -> tuple[Any, ...]:
    """Coefficients of (s - z)(s - z*) for z = re + j im."""
    re, im = pair
    return (1.0, -2 * re, re * re + im * im)


def _linear(roots: list[Any]) -> tuple[Any, ...]:
    """Coefficients of the product of (s - z) over at most two real roots."""
    if len(roots) == 2:
        return (1.0, -(roots[0] + roots[1]), roots[0] * roots[1])
    return (1.0, *(-z for z in roots))


@block
class ZeroPoleGain(Block):
    r"""Linear block given by its zeros, poles and gain.

    .. math::

        \frac{Y(s)}{U(s)} = k\, \frac{\prod (s - z_i) \prod \left((s - a_j)^2 + b_j^2\right)}
        {\prod (s - p_i) \prod \left((s - c_j)^2 + d_j^2\right)}

    A conjugate pair is written as a row (real part, imaginary part). The block is a chain of
    sections of first and second order, so that no polynomial is ever multiplied out.
    """

    source = "Åström and Murray, Feedback Systems, section 9.2 (zeros and poles)"
    symbol = "zpk"

    zeros: tuple[float, ...] = parameter(default=(-10.0,), about="real zeros", unit="rad/s")
    poles: tuple[float, ...] = parameter(default=(-20.0,), about="real poles", unit="rad/s")
    zero_pairs: Rows = parameter(default=(), about="conjugate zeros, as rows of real and imaginary part", unit="rad/s")
    pole_pairs: Rows = parameter(
        default=((-3.0, 4.0),), about="conjugate poles, as rows of real and imaginary part", unit="rad/s"
    )
    gain: float = parameter(default=50.0, about="factor in front of the fraction")
    x0: tuple[float, ...] = parameter(default=(), about="start values; an empty list means zeros")

    u = Input("any signal", unit="?u")
    y = Output("filtered signal", unit="?y")

    def check(self) -> None:
        for name in ("zero_pairs", "pole_pairs"):
            for k, row in enumerate(getattr(self, name)):
                if not isinstance(row, tuple) or len(row) != 2:
                    raise ParameterError(
                        f"ZeroPoleGain.{name}[{k}] must be a real and an imaginary part, got {in_words(row)}."
                    )
        above = len(self.zeros) + 2 * len(self.zero_pairs)
        if above > self._order():
            raise ParameterError(
                f"ZeroPoleGain must be proper: no more zeros than poles, got {above} zeros and {self._order()} poles."
            )
        _check_starts("ZeroPoleGain", self.x0, self._order())

    def _order(self) -> int:
        return len(self.poles) + 2 * len(self.pole_pairs)

    @property
    def states(self) -> dict[str, State]:
        return _starts(self.x0, self._order(), "state of the chain,")

    def _sections(self) -> list[tuple[Any, Any]]:
        """Numerator and denominator of each section; poles are joined in twos where a pair of zeros needs it."""
        over, real = [_quadratic(pair) for pair in self.zero_pairs], list(self.zeros)
        under, single = [_quadratic(pair) for pair in self.pole_pairs], list(self.poles)
        while len(under) < len(over):
            under.append(_linear([single.pop(), single.pop()]))
        sections = []
        for num, den in zip_longest(over, [*under, *(_linear([p]) for p in single)]):
            taken, real = ([], real) if num else (real[: len(den) - 1], real[len(den) - 1 :])
            sections.append((num or _linear(taken), den))
        return sections

    def _chain(self, x: Any, u: Any) -> tuple[list[Any], Any]:
        """Rates of the states and the output."""
        rates, signal, left = [], self.gain * u.u, list(x)
        for num, den in self._sections():
            own, left = left[: len(den) - 1], left[len(den) - 1 :]
            newest, signal = _section(num, den, own, signal)
            rates += [newest, *own[:-1]]
        return rates, signal

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(zip(x._fields, self._chain(x, u)[0], strict=True))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._chain(x, u)[1])
