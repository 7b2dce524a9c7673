"""Blocks that compute one value from others at the same instant: sum, product, switch, conversion."""

from __future__ import annotations

import operator
from functools import reduce
from typing import Any, ClassVar

import casadi as ca

from tsmblocks.blocks.shared import UNIT
from tsmblocks.common.errors import ParameterError, in_words
from tsmblocks.common.units import UnitError, factor
from tsmblocks.model.block import Block, Input, Output, block, option, parameter


def _numbered_inputs(about: str, unit: str = "") -> Any:
    """The property ``inports`` of a block with inputs ``u1`` to ``un``."""
    return property(lambda block: {f"u{k}": Input(f"{about} {k}", unit=unit) for k in range(1, block.n + 1)})


@block
class Gain(Block):
    r"""Gain: a signal times a constant.

    .. math:: y = K u
    """

    source = "definition"
    symbol = "K"
    symbol_with_values = "{gain}"

    gain: float = parameter(default=1.0, about="factor from input to output", unit="?y/?u")
    unit: str = option(default="", about=UNIT)
    u = Input("any signal", unit="?u")
    y = Output("the signal times the gain", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.gain * u.u)


@block
class Sum(Block):
    r"""Sum and difference of signals.

    .. math:: y = \pm u_1 \pm u_2 \pm \dots

    One input for each sign: ``plus`` and ``minus``, or ``plus1``, ``plus2``, … where a sign is repeated.
    """

    source = "definition"
    symbol = "Σ"

    signs: str = option(default="+-", about="sign of each input, in order")
    y = Output("the sum", unit="?u")

    def check(self) -> None:
        if not self.signs or set(self.signs) - set("+-"):
            raise ParameterError(
                f"Sum.signs must be one or more of + and -, got {in_words(self.signs)}. "
                "For two inputs added and one subtracted it is '++-'."
            )

    @property
    def inports(self) -> dict[str, Input]:
        ports = {}
        for k, sign in enumerate(self.signs):
            name, about = ("plus", "added") if sign == "+" else ("minus", "subtracted")
            number = self.signs[: k + 1].count(sign) if self.signs.count(sign) > 1 else ""
            ports[f"{name}{number}"] = Input(f"signal that is {about}", unit="?u")
        return ports

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        terms = [value if sign == "+" else -value for sign, value in zip(self.signs, u, strict=True)]
        return dict(y=reduce(operator.add, terms))


@block
class Product(Block):
    r"""Product of signals.

    .. math:: y = u_1 u_2 \cdots u_n
    """

    source = "definition"
    symbol = "×"

    n: int = option(default=2, about="number of inputs", at_least=1, at_most=1000)

    y = Output("the product")
    inports = _numbered_inputs("factor")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=reduce(operator.mul, u))


@block
class Divide(Block):
    r"""One signal over another.

    .. math:: y = \frac{n}{d}

    Where the denominator passes zero the result is infinite or undefined, and the run ends with an error.
    """

    source = "definition"
    symbol = "÷"
    singular: ClassVar[str] = "den = 0"
    """Where the result is not finite by definition."""

    num = Input("numerator")
    den = Input("denominator, which must not pass zero")
    y = Output("the quotient")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.num / u.den)


@block
class Abs(Block):
    r"""Magnitude of a signal.

    .. math:: y = |u|
    """

    source = "definition"
    symbol = "|u|"

    u = Input("any signal", unit="?u")
    y = Output("its magnitude", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.fabs(u.u))


@block
class Sign(Block):
    r"""Direction of a signal: 1, -1, or 0 at zero.

    .. math:: y = \operatorname{sgn} u
    """

    source = "definition"
    symbol = "sgn"

    u = Input("any signal")
    y = Output("its sign", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.sign(u.u))


@block
class Square(Block):
    r"""Square of a signal.

    .. math:: y = u^2
    """

    source = "definition"
    symbol = "u²"

    u = Input("any signal")
    y = Output("its square")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u * u.u)


@block
class Power(Block):
    r"""A signal raised to a power, its sign kept: flow through an opening (1/2), drag (2).

    .. math:: y = K u \left(u^2 + u_0^2\right)^{(n - 1)/2}

    Away from zero it is :math:`K |u|^n \operatorname{sgn} u`; below :math:`u_0` it is linear, as flow in a narrow gap.
    """

    source = "definition; for n = 1/2 Torricelli's law"
    symbol = "uⁿ"

    exponent: float = parameter(default=0.5, about="power n", at_least=0.1, at_most=10.0)
    gain: float = parameter(default=1.0, about="factor K")
    smoothing: float = parameter(
        default=1e-3, about="value u0 below which it is linear", unit="?u", above=0.0, known=True
    )
    u = Input("any signal", unit="?u")
    y = Output("the signal raised to the power")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        square = u.u * u.u + self.smoothing * self.smoothing
        return dict(y=self.gain * (u.u * square ** ((self.exponent - 1) / 2)))


@block
class Tanh(Block):
    r"""Hyperbolic tangent, a smooth change from -1 to 1.

    .. math:: y = \tanh u
    """

    source = "Paper, eqs (9) and (13): the smooth change between two slopes"
    symbol = "tanh"

    u = Input("any signal")
    y = Output("value between -1 and 1", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.tanh(u.u))


@block
class Sin(Block):
    r"""Sine of an angle, as in the torque of gravity on a link.

    .. math:: y = \sin u
    """

    source = "definition"
    symbol = "sin"

    u = Input("angle", unit="rad")
    y = Output("value between -1 and 1", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.sin(u.u))


@block
class Cos(Block):
    r"""Cosine of an angle, as in the arm of a force on a crank.

    .. math:: y = \cos u
    """

    source = "definition"
    symbol = "cos"

    u = Input("angle", unit="rad")
    y = Output("value between -1 and 1", unit="1")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.cos(u.u))


@block
class Convert(Block):
    r"""The same quantity in another unit.

    .. math:: y = c\, u
    """

    source = "definition"
    symbol = "unit"
    symbol_with_values = "{source_unit} → {target_unit}"

    source_unit: str = option(default="rad", about="unit of the input")
    target_unit: str = option(default="deg", about="unit of the output")
    u = Input("the quantity", unit_option="source_unit")
    y = Output("the same quantity in the other unit", unit_option="target_unit")

    def check(self) -> None:
        try:
            factor(self.source_unit, self.target_unit)
        except UnitError as error:
            raise ParameterError(f"Convert: {error}") from None

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=factor(self.source_unit, self.target_unit) * u.u)


@block
class Minimum(Block):
    r"""The smallest of several signals.

    .. math:: y = \min(u_1, \dots, u_n)
    """

    source = "definition"
    symbol = "min"

    n: int = option(default=2, about="number of inputs", at_least=1, at_most=1000)

    y = Output("the smallest input", unit="?u")
    inports = _numbered_inputs("candidate", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=reduce(ca.fmin, u))


@block
class Maximum(Block):
    r"""The largest of several signals.

    .. math:: y = \max(u_1, \dots, u_n)
    """

    source = "definition"
    symbol = "max"

    n: int = option(default=2, about="number of inputs", at_least=1, at_most=1000)

    y = Output("the largest input", unit="?u")
    inports = _numbered_inputs("candidate", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=reduce(ca.fmax, u))


@block
class Switch(Block):
    r"""One of two signals, chosen by a third.

    .. math:: y = u_1 \text{ while } c \ge c_0, \quad u_2 \text{ otherwise}
    """

    source = "definition"
    symbol = "switch"
    symbol_with_values = "switch\n> {threshold:unit}"

    threshold: float = parameter(default=0.5, about="control value from which the first input passes", unit="?c")
    u1 = Input("passes while control is at or above the threshold", unit="?u")
    u2 = Input("passes otherwise", unit="?u")
    control = Input("chooses between the two", unit="?c")
    y = Output("the chosen signal", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.if_else(u.control >= self.threshold, u.u1, u.u2))
