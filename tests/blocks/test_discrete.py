"""Sampled blocks against scipy, python-control and their difference equations."""

from __future__ import annotations

import casadi as ca
import control
import numpy as np
import pytest
from scipy import signal

from tests.blocks.helpers import Bench, assert_sound, refuses, sample
from tsmblocks.blocks.discrete import (
    DiscreteIntegrator,
    DiscretePID,
    DiscreteStateSpace,
    DiscreteTransferFunction,
    MovingAverage,
    UnitDelay,
    ZeroOrderHold,
)

ALL = [
    DiscreteIntegrator(),
    DiscreteIntegrator(method="backward"),
    DiscreteIntegrator(method="trapezoidal"),
    DiscretePID(),
    DiscretePID(ki=2.0, kd=0.1, low=-1.0, high=1.0),
    DiscretePID(tau=0.0, low=-np.inf, high=np.inf),
    DiscreteStateSpace(),
    DiscreteStateSpace(A=[[0.9]], B=[[0.1]], C=[[1.0]]),
    DiscreteTransferFunction(),
    DiscreteTransferFunction(num=(0.1,), den=(1.0, -0.9)),
    MovingAverage(),
    MovingAverage(length=1),
    UnitDelay(),
    ZeroOrderHold(),
]
LAG = dict(A=[[0.9]], B=[[0.1]], C=[[1.0]])
U = np.random.default_rng(0).normal(size=60)
SYSTEM = dict(
    A=[[0.5, 0.2, 0.0], [-0.1, 0.7, 0.3], [0.0, 0.1, 0.2]],
    B=[[1.0, 0.0], [0.2, 0.5], [0.0, -1.0]],
    C=[[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]],
    D=[[0.0, 0.1], [0.3, 0.0]],
)


@pytest.mark.parametrize("block", [b for b in ALL if b != MovingAverage(length=1)], ids=str)
def test_sound(block):
    assert_sound(block)


@pytest.mark.parametrize("block", ALL, ids=str)
def test_sampled_with_a_period(block):
    assert block.sampled
    assert block.period == 0.01
    assert block.fields()["period"].kind == "option"


def passes_through(block):
    """Whether the present input reaches an output at the same sample."""
    bench = Bench(block)
    return ca.depends_on(bench.y_of, bench.u)


def test_only_blocks_with_a_direct_path_pass_their_input_through():
    direct = [ZeroOrderHold(), MovingAverage(), DiscretePID(), DiscreteIntegrator(method="backward")]
    direct += [DiscreteTransferFunction(), DiscreteStateSpace(**LAG, D=[[0.0]])]
    late = [UnitDelay(), DiscreteIntegrator(), DiscreteTransferFunction(den=(1.0, -0.9)), DiscreteStateSpace(**LAG)]
    assert [passes_through(b) for b in direct] == [True] * len(direct)
    assert [passes_through(b) for b in late] == [False] * len(late)


def test_hold_gives_the_samples():
    assert np.array_equal(sample(ZeroOrderHold(), u=U)["y"], U)


def test_delay_gives_the_sample_before():
    assert np.array_equal(sample(UnitDelay(initial=7.0), u=U)["y"], [7.0, *U[:-1]])


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ((0.1,), (1.0, -0.9)),
        ((0.3, 0.2, 0.1), (2.0, -1.1, 0.4)),
        ((1.0, -0.5), (1.0, -1.2, 0.5, -0.1)),
        ((0.0, 1.0), (1.0, 0.3)),
        ((3.0,), (2.0,)),
    ],
)
def test_transfer_function_is_scipys_filter(num, den):
    padded = (0.0,) * (len(den) - len(num)) + num
    y = sample(DiscreteTransferFunction(num=num, den=den), u=U)["y"]
    assert y == pytest.approx(signal.lfilter(padded, den, U), abs=1e-13)


def test_transfer_function_is_python_controls():
    y = sample(DiscreteTransferFunction(num=(1.0, -0.5), den=(1.0, -1.2, 0.5)), u=U)["y"]
    system = control.tf([1.0, -0.5], [1.0, -1.2, 0.5], 0.01)
    assert y == pytest.approx(control.forced_response(system, inputs=U).outputs, abs=1e-12)


def test_transfer_function_starts_where_it_is_told():
    p = DiscreteTransferFunction(num=(0.3, 0.2, 0.1), den=(2.0, -1.1, 0.4), x0=(0.5, -0.2))
    w = [0.5, -0.2]
    for u, y in zip(U, sample(p, u=U)["y"], strict=True):
        newest = (u + 1.1 * w[0] - 0.4 * w[1]) / 2.0
        assert y == pytest.approx(0.3 * newest + 0.2 * w[0] + 0.1 * w[1], abs=1e-14)
        w = [newest, w[0]]


def test_state_space_is_scipys_with_several_ports():
    v = np.roll(U, 3)
    y = sample(DiscreteStateSpace(**SYSTEM, x0=[1.0, -1.0, 0.5]), u1=U, u2=v)
    matrices = [np.array(SYSTEM[k]) for k in "ABCD"]
    _, expected, _ = signal.dlsim((*matrices, 0.01), np.column_stack([U, v]), x0=[1.0, -1.0, 0.5])
    assert np.column_stack([y["y1"], y["y2"]]) == pytest.approx(expected, abs=1e-12)


def test_state_space_without_states_is_a_matrix():
    y = sample(DiscreteStateSpace(A=[], B=[], C=[], D=[[2.0], [-1.0]]), u=U)
    assert np.array_equal(y["y1"], 2.0 * U)
    assert np.array_equal(y["y2"], -U)


def test_state_space_with_one_port_each_is_python_controls():
    y = sample(DiscreteStateSpace(A=[[0.5, 0.2], [-0.1, 0.7]], B=[[1.0], [0.2]], C=[[1.0, 2.0]]), u=U)["y"]
    system = control.ss([[0.5, 0.2], [-0.1, 0.7]], [[1.0], [0.2]], [[1.0, 2.0]], 0, 0.01)
    assert y == pytest.approx(control.forced_response(system, inputs=U).outputs, abs=1e-12)


@pytest.mark.parametrize(
    ("method", "num"), [("forward", (0.0, 1.0)), ("backward", (1.0, 0.0)), ("trapezoidal", (0.5, 0.5))]
)
def test_integrator_is_its_rule(method, num):
    p = DiscreteIntegrator(method=method, gain=3.0, period=0.1, initial=2.0)
    expected = 2.0 + 0.3 * signal.lfilter(num, (1.0, -1.0), U)
    assert sample(p, u=U)["y"] == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_moving_average_is_scipys_filter(n):
    y = sample(MovingAverage(length=n), u=U)["y"]
    assert y == pytest.approx(signal.lfilter(np.ones(n) / n, [1.0], U), abs=1e-14)


def test_moving_average_of_a_constant_it_started_with():
    y = sample(MovingAverage(length=4, initial=3.0), u=np.full(10, 3.0))["y"]
    assert np.array_equal(y, np.full(10, 3.0))


@pytest.mark.parametrize("tau", [0.0, 0.05])
def test_pid_is_its_transfer_function(tau):
    kp, ki, kd, T = 1.3, 4.0, 0.2, 0.02
    p = DiscretePID(kp=kp, ki=ki, kd=kd, tau=tau, period=T, low=-np.inf, high=np.inf)
    expected = kp * U + ki * T * signal.lfilter([1, 0], [1, -1], U)
    expected += kd * signal.lfilter([1, -1], [tau + T, -tau], U)
    assert sample(p, e=U)["y"] == pytest.approx(expected, abs=1e-12)


def test_pid_gives_way_at_its_limit():
    p = DiscretePID(kp=10.0, ki=5.0, kaw=4.0, low=-24.0, high=24.0)
    e = np.concatenate([np.full(2000, 10.0), np.full(100, -0.1)])
    y = sample(p, e=e)["y"]
    wound = sample(p.replace(kaw=0.0), e=e)["y"]
    assert np.all(y[:2000] == 24.0)
    assert y[2000] < 24.0
    assert np.all(wound == 24.0)


@pytest.mark.parametrize(
    ("message", "cls", "values"),
    [
        (
            "ZeroOrderHold.period must lie in (0, inf), got 0. It is: time between samples [s].",
            ZeroOrderHold,
            dict(period=0),
        ),
        (
            "DiscreteTransferFunction.den must begin with a number other than 0, got (0.0, 1.0).",
            DiscreteTransferFunction,
            dict(den=(0.0, 1.0)),
        ),
        (
            "DiscreteTransferFunction.num must be one list of numbers, such as [1, 0.5], "
            "got ((1.0, 2.0),). It is: numerator.",
            DiscreteTransferFunction,
            dict(num=((1.0, 2.0),)),
        ),
        (
            "DiscreteTransferFunction must be proper: 1 <= len(num) <= len(den), got 3 and 1.",
            DiscreteTransferFunction,
            dict(num=(1.0, 2.0, 3.0)),
        ),
        (
            "DiscreteTransferFunction.x0 needs one number per state (1) or none, got 2.",
            DiscreteTransferFunction,
            dict(den=(1.0, -0.9), x0=(1.0, 2.0)),
        ),
        ("DiscreteStateSpace.A must be a list of rows, such as [[1, 0], [0, 1]].", DiscreteStateSpace, dict(A=(0.9,))),
        (
            "DiscreteStateSpace.B must have 2 rows of 1, to match the other matrices, got rows of length 1.",
            DiscreteStateSpace,
            dict(A=[[0.9, 0.0], [0.0, 0.9]], B=[[0.1]], C=[[1.0, 0.0]]),
        ),
        (
            "DiscreteStateSpace.D must have 1 rows of 1, to match the other matrices, got rows of length 2.",
            DiscreteStateSpace,
            dict(**LAG, D=[[0.0, 1.0]]),
        ),
        (
            "DiscreteStateSpace needs at least one input (columns of B) and one output (rows of C).",
            DiscreteStateSpace,
            dict(A=[[0.9]]),
        ),
        (
            "DiscreteStateSpace.x0 needs one number per state (1) or none, got 3.",
            DiscreteStateSpace,
            dict(**LAG, x0=(1.0, 2.0, 3.0)),
        ),
        ("DiscretePID needs low < high, got low=2, high=2.", DiscretePID, dict(low=2, high=2)),
        (
            "DiscreteIntegrator.method is 'forwards', which is not a choice. Did you mean 'forward'? "
            "It is: integration rule.",
            DiscreteIntegrator,
            dict(method="forwards"),
        ),
        (
            "MovingAverage.length must be a whole number in [1, 10000], got 0. It is: number of samples in the mean.",
            MovingAverage,
            dict(length=0),
        ),
        (
            "MovingAverage.length must be a whole number in [1, 10000], got 2.5. It is: number of samples in the mean.",
            MovingAverage,
            dict(length=2.5),
        ),
    ],
)
def test_bad_values(message, cls, values):
    refuses(message, cls, **values)
