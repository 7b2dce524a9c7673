"""Arithmetic blocks against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from tests.blocks.helpers import Bench, assert_sound, refuses, value
from tsmblocks.blocks.arithmetic import (
    Abs,
    Convert,
    Cos,
    Divide,
    Gain,
    Maximum,
    Minimum,
    Power,
    Product,
    Sign,
    Sin,
    Square,
    Sum,
    Switch,
    Tanh,
)

NUMBERS = [-1e6, -2.5, -1.0, -1e-9, 0.0, 1e-9, 0.3, 1.0, 4.0, 1e6]


@pytest.mark.parametrize(
    "block",
    [
        Abs(),
        Convert(),
        Gain(),
        Maximum(n=3),
        Minimum(),
        Product(n=3),
        Sign(),
        Power(),
        Cos(),
        Sin(),
        Square(),
        Sum(),
        Switch(),
        Tanh(),
    ],
)
def test_sound(block):
    assert_sound(block)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (Gain(gain=-2.5), lambda u: -2.5 * u),
        (Abs(), np.abs),
        (Sign(), np.sign),
        (Square(), np.square),
        (Tanh(), np.tanh),
        (Sin(), np.sin),
        (Cos(), np.cos),
        (Convert(), np.rad2deg),
        (Convert(source_unit="rpm", target_unit="rad/s"), lambda u: u * 2 * np.pi / 60),
    ],
    ids=lambda value: type(value).__name__,
)
def test_one_in_one_out(block, expected):
    for u in NUMBERS:
        assert value(block, u=u)["y"] == pytest.approx(float(expected(u)), rel=1e-14)


@pytest.mark.parametrize(
    ("signs", "ports", "result"),
    [
        ("+-", ["plus", "minus"], 1 - 10),
        ("-+", ["minus", "plus"], -1 + 10),
        ("++", ["plus1", "plus2"], 1 + 10),
        ("++-", ["plus1", "plus2", "minus"], 1 + 10 - 100),
        ("-+-", ["minus1", "plus", "minus2"], -1 + 10 - 100),
        ("-", ["minus"], -1),
        ("+", ["plus"], 1),
    ],
)
def test_sum(signs, ports, result):
    block = Sum(signs=signs)
    assert list(block.inports) == ports
    assert {port.unit for port in block.inports.values()} == {"?u"}
    assert value(block, **dict(zip(ports, (1.0, 10.0, 100.0), strict=False)))["y"] == result


def test_several_inputs():
    u = dict(u1=2.0, u2=-3.0, u3=5.0)
    assert value(Product(n=3), **u)["y"] == -30
    assert value(Minimum(n=3), **u)["y"] == -3
    assert value(Maximum(n=3), **u)["y"] == 5
    assert list(Product(n=4).inports) == ["u1", "u2", "u3", "u4"]
    assert value(Product(n=1), u1=2.0)["y"] == 2


def test_divide_says_where_it_is_not_finite():
    assert value(Divide(), num=3.0, den=-2.0)["y"] == -1.5
    assert Divide.singular == "den = 0"
    y = Bench(Divide()).y
    assert not np.isfinite(float(y(0, [], [0.0, 0.0], [])))
    assert not np.isfinite(float(y(0, [], [1.0, 0.0], [])))


def test_switch():
    block = Switch(threshold=2.0)
    for control, chosen in ((1.999, 20.0), (2.0, 10.0), (3.0, 10.0)):
        assert value(block, u1=10.0, u2=20.0, control=control)["y"] == chosen


def test_convert_declares_its_units():
    block = Convert(source_unit="V", target_unit="mV")
    assert block.inports["u"].unit == "V"
    assert block.outports["y"].unit == "mV"
    assert value(block, u=2.0)["y"] == pytest.approx(2000)


def test_refuses_bad_values():
    for signs in ("", "+*"):
        refuses(
            f"Sum.signs must be one or more of + and -, got {signs!r}. "
            "For two inputs added and one subtracted it is '++-'.",
            Sum,
            signs=signs,
        )
    refuses("Sum.signs must be text, got 2. It is: sign of each input, in order.", Sum, signs=2)
    refuses("Product.n must be a whole number in [1, 1000], got 0. It is: number of inputs.", Product, n=0)
    refuses("Convert: 'rad' does not convert to 'V'.", Convert, target_unit="V")
    refuses("Convert.source_unit: 'radd' is not a unit known here. Did you mean 'rad'?", Convert, source_unit="radd")
    refuses("Gain.gain must be a number, got nan. It is: factor from input to output.", Gain, gain=np.nan)


@pytest.mark.parametrize("exponent", [0.3, 0.5, 1.0, 2.0, 3.5])
def test_power_keeps_the_sign_and_is_straight_at_zero(exponent):
    block = Power(exponent=exponent, gain=1.5, smoothing=1e-4)
    for u in (-40.0, -1.0, -0.1, 0.1, 2.0, 1e3):
        assert value(block, u=u)["y"] == pytest.approx(1.5 * np.sign(u) * abs(u) ** exponent, rel=1e-5)
    assert value(block, u=0.0)["y"] == 0.0
    slope = value(block, u=1e-9)["y"] / 1e-9
    assert slope == pytest.approx(1.5 * 1e-4 ** (exponent - 1), rel=1e-6)
