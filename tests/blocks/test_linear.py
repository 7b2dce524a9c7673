"""Linear blocks against closed forms and python-control."""

from __future__ import annotations

import casadi as ca
import control
import numpy as np
import pytest

import tsmblocks as tsm
from tests.blocks.helpers import Bench, assert_sound, rates, refuses, simulate, value
from tsmblocks.blocks.discrete import DiscreteStateSpace, DiscreteTransferFunction
from tsmblocks.blocks.linear import Delay, Derivative, FilteredDerivative, FirstOrderLag, Integrator, SecondOrderLag
from tsmblocks.blocks.lti import StateSpace, TransferFunction, ZeroPoleGain, from_control
from tsmblocks.common.errors import BlockError, ParameterError
from tsmblocks.model.block import signals

FREQUENCIES = np.logspace(-2, 3, 61)
OSCILLATOR = StateSpace(A=[[0, 1], [-100, -2]], B=[[0], [100]], C=[[1, 0]])
MIMO = StateSpace(
    A=((0, 1, 0), (-4, -1, 2), (0, 0, -3)), B=((0, 1), (1, 0), (0.5, 2)), C=((1, 0, 0), (0, 1, 1)), D=((0, 0.5), (0, 0))
)


def matrices(block):
    """A, B, C, D of a linear block, by differentiating its equations."""
    bench = Bench(block)
    p = np.array(bench.p0)
    parts = [(bench.rate_of, bench.x), (bench.rate_of, bench.u), (bench.y_of, bench.x), (bench.y_of, bench.u)]
    n = bench.x.numel()
    f = ca.Function("f", [ca.vertcat(*bench.p)], [ca.jacobian(e, v) for e, v in parts])
    a, b, c, d = (m.full() for m in f(p))
    assert a.shape == (n, n)
    return a, b, c, d


def response(block):
    """Frequency response of a linear block."""
    return control.ss(*matrices(block)).frequency_response(FREQUENCIES).complex


def assert_same_response(block, system):
    ours, theirs = response(block), system.frequency_response(FREQUENCIES).complex
    assert np.max(np.abs(ours - theirs) / (1e-12 + np.max(np.abs(theirs)))) < 1e-10
    assert np.max(np.abs(ours - theirs) / np.abs(theirs)) < 1e-9


@pytest.mark.parametrize(
    "block",
    [
        Derivative(),
        FilteredDerivative(),
        FirstOrderLag(),
        Integrator(),
        Integrator(reset=True),
        Integrator(low=-1.0, high=2.0),
        MIMO,
        SecondOrderLag(),
        StateSpace(),
        OSCILLATOR,
        TransferFunction(),
        TransferFunction(den=(0.05, 1)),
        TransferFunction(num=(1, 2, 3), den=(2, 1, 5)),
        ZeroPoleGain(),
        ZeroPoleGain(zeros=(-10,), poles=(-20,), pole_pairs=((-3, 4),), gain=50),
    ],
    ids=lambda block: type(block).__name__,
)
def test_sound(block):
    assert_sound(block)


# ---- integral, derivative, lags, delay


def test_integrator():
    run = simulate(Integrator(gain=2.0, integral=-1.0), {"u": np.cos}, stop=5.0, step=0.01)
    assert run["y"] == pytest.approx(-1 + 2 * np.sin(run["t"]), abs=1e-9)


def test_integrator_stops_at_its_limits_and_leaves_them_at_once():
    run = simulate(Integrator(low=-0.4, high=0.5), {"u": np.cos}, stop=8.0, step=0.001)
    y = run["y"]
    assert y.max() == 0.5
    assert y.min() == -0.4
    leaves_high = np.searchsorted(run["t"], np.pi / 2)
    after = run["t"][leaves_high : leaves_high + 800]
    assert y[leaves_high : leaves_high + 800] == pytest.approx(0.5 - (1 - np.sin(after)), abs=1.5e-3)
    block = Integrator(low=-1.0, high=1.0)
    for z, u, rate in ((1, 3, 0), (1, -3, -3), (-1, -3, 0), (-1, 3, 3), (0, 3, 3), (1.2, 1, 0), (1.2, -1, -1)):
        assert rates(block, {"integral": z}, u=u)["integral"] == rate
    assert value(block, {"integral": 1.2}, u=0.0)["y"] == 1.0


def test_integrator_is_set_back_to_its_start():
    block = Integrator(reset=True, integral=0.25)
    assert list(block.inports) == ["u", "reset"]
    for signal, expected in ((0.5, 7.0), (0.51, 0.25), (1.0, 0.25)):
        u = signals(["u", "reset"], [1.0, signal])
        assert float(block.updates(0.0, signals(["integral"], [7.0]), u)["integral"]) == expected
    assert list(Integrator().inports) == ["u"]
    assert Integrator().updates(0.0, None, None) == {}


def test_derivative_passes_the_rate_on():
    assert value(Derivative(), u=5.0, rate=-2.0)["y"] == -2
    assert Derivative().inports["rate"].rate_of == "u"


def test_filtered_derivative():
    assert_same_response(FilteredDerivative(time_constant=0.02), control.tf([1, 0], [0.02, 1]))


def test_lags():
    assert_same_response(FirstOrderLag(gain=3.0, time_constant=0.2), control.tf([3], [0.2, 1]))
    lag = SecondOrderLag(gain=2.0, omega=10.0, zeta=0.3)
    assert_same_response(lag, control.tf([200], [1, 6, 100]))


def test_delay_reads_the_past_of_its_input():
    block = Delay(time=0.2, initial=3.0)
    assert value(block, u=1.0, past=-4.0)["y"] == -4
    past = block.past_ports["past"]
    assert (past.of, past.by, past.initial) == ("u", "time", "initial")
    assert block.read_names == ("u", "past")


# ---- rational transfer functions


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ((1,), (0.05, 1)),
        ((3,), (2,)),
        ((1, 2), (4, 5)),
        ((1, 2, 3), (2, 1, 5)),
        ((2, 0), (1, 0.5, 3, 1)),
        ((5,), (0.1, 2, 3, 4, 5)),
    ],
)
def test_transfer_function(num, den):
    block = TransferFunction(num=num, den=den)
    assert len(block.states) == len(den) - 1
    assert_same_response(block, control.tf(num, den))


def test_transfer_function_without_direct_path_has_none():
    bench = Bench(TransferFunction(num=(1, 2), den=(1, 2, 3)))
    assert not ca.depends_on(bench.y_of, bench.u)
    bench = Bench(TransferFunction(num=(0, 1, 2), den=(1, 2, 3)))
    assert ca.depends_on(bench.y_of, bench.u)


@pytest.mark.parametrize(
    ("zeros", "zero_pairs", "poles", "pole_pairs"),
    [
        ((), (), (), ()),
        ((-10,), (), (-20,), ((-3, 4),)),
        ((), ((-1, 5),), (-2, -3, -7), ()),
        ((-4,), ((-1, 5),), (-2, -3, -7), ()),
        ((-4, -6), (), (), ((-1, 2),)),
        ((-4, -6, 2), (), (-8,), ((-1, 2), (-3, 1))),
        ((-4, 0), ((-1, 5), (0, 3)), (-2, -3, -9, -11), ((-1, 2),)),
        ((), (), (0, 0), ((-1, 2),)),
        ((-1,), ((-2, 3),), (-5,), ((-1, 1), (-2, 2))),
    ],
)
def test_zero_pole_gain(zeros, zero_pairs, poles, pole_pairs):
    def roots(real, pairs):
        return [*real, *(complex(re, s * im) for re, im in pairs for s in (1, -1))]

    block = ZeroPoleGain(zeros=zeros, zero_pairs=zero_pairs, poles=poles, pole_pairs=pole_pairs, gain=-2.5)
    above, below = roots(zeros, zero_pairs), roots(poles, pole_pairs)
    s = 1j * FREQUENCIES
    expected = -2.5 * np.prod([s - z for z in above], axis=0) / np.prod([s - p for p in below], axis=0)
    ours = response(block) * np.ones_like(s)
    assert np.max(np.abs(ours / expected - 1)) < 1e-10
    assert len(block.states) == len(below)
    if below:
        assert_same_response(block, control.zpk(above, below, -2.5))
    bench = Bench(block)
    assert ca.depends_on(bench.y_of, bench.u) == (len(above) == len(below))


def test_state_space():
    assert_same_response(OSCILLATOR, control.ss([[0, 1], [-100, -2]], [[0], [100]], [[1, 0]], [[0]]))
    a, b, c, d = matrices(MIMO)
    assert a.tolist() == [[0, 1, 0], [-4, -1, 2], [0, 0, -3]]
    assert b.tolist() == [[0, 1], [1, 0], [0.5, 2]]
    assert c.tolist() == [[1, 0, 0], [0, 1, 1]]
    assert d.tolist() == [[0, 0.5], [0, 0]]
    assert list(MIMO.inports) == ["u1", "u2"]
    assert list(MIMO.outports) == ["y1", "y2"]
    assert list(OSCILLATOR.inports) == ["u"]
    assert list(OSCILLATOR.outports) == ["y"]


def test_state_space_without_states_is_a_gain():
    block = StateSpace(A=(), B=(), C=(), D=((2, 3),))
    assert value(block, u1=1.0, u2=10.0) == {"y": 32.0}


@pytest.mark.parametrize(
    "block",
    [
        TransferFunction(den=(1, 2, 3), x0=(4, 5)),
        ZeroPoleGain(poles=(-1, -2), x0=(4, 5)),
        OSCILLATOR.replace(x0=(4, 5)),
    ],
)
def test_start_values(block):
    assert [s.start for s in block.states.values()] == [4, 5]
    assert [s.start for s in block.replace(x0=()).states.values()] == [0, 0]


# ---- python-control


@pytest.mark.parametrize(
    "system",
    [
        control.tf([1, 2], [1, 3, 5]),
        control.tf([0, 0, 4], [1, 2, 3]),
        control.tf([2, 1], [1, 3]),
        control.tf([5], [2]),
        control.zpk([-1], [-2, -3 + 1j, -3 - 1j], 5),
        control.ss([[0, 1], [-2, -3]], [[0], [1]], [[1, 0]], [[0]]),
        control.ss([[0, 1], [-2, -3]], [[0], [1]], [[1, 0]], [[0.5]]),
        control.ss([[-1.0]], [[1]], [[1]], [[0]], dt=None),
    ],
)
def test_from_control_keeps_the_response(system):
    block = from_control(system)
    assert type(block) is (TransferFunction if isinstance(system, control.TransferFunction) else StateSpace)
    assert_same_response(block, system)


def test_from_control_finds_no_direct_path_where_there_is_none():
    for system in (control.tf([0, 0, 4], [1, 2, 3]), control.ss([[-1.0]], [[1]], [[1]], [[0]])):
        bench = Bench(from_control(system))
        assert not ca.depends_on(bench.y_of, bench.u)


def test_from_control_keeps_several_inputs_and_outputs():
    a, b, c, d = matrices(MIMO)
    assert from_control(control.ss(a, b, c, d)) == MIMO
    assert from_control(control.ss([], [], [], [[2.0]])) == StateSpace(A=(), B=(), C=((),), D=((2,),))


def test_from_control_takes_names_and_units():
    made = control.ss(
        [[0, 1], [0, -1]],
        [[0], [57.3]],
        np.eye(2),
        0,
        inputs="drive [V]",
        outputs=["angle [deg]", "motor speed"],
        states=["angle", "speed [deg/s]"],
    )
    for system in (made, control.sample_system(made, 0.01)):
        block = from_control(system)
        assert {k: p.unit for k, p in block.inports.items()} == {"drive": "V"}
        assert {k: p.unit for k, p in block.outports.items()} == {"angle": "deg", "motor_speed": ""}
        assert {k: s.unit for k, s in block.states.items()} == {"angle_2": "", "speed": "deg/s"}
        assert tsm.loads(tsm.dumps(tsm.Diagram(blocks={"p": block}, inputs={"u": "p"}))).blocks["p"] == block
        inner = tsm.Diagram(blocks={"p": block}, inputs={"u": "p.drive"}, outputs={"w": "p.motor_speed"})
        run = tsm.simulate(inner, stop=1.0, inputs={"u": 1.0}, step=0.01)
        assert run["w"][-1] == pytest.approx(57.3 * (1 - np.exp(-1.0)), rel=1e-6)
        assert run.unit("u") == "V"
    for dt in (0, 0.01):
        block = from_control(control.tf([1], [1, 0.1], dt, inputs="3 phase [V]", outputs="y [rad]"))
        assert (block.unit_in, block.unit) == ("V", "rad")
        assert (block.inports["u"].unit, block.outports["y"].unit) == ("V", "rad")
    one = from_control(control.ss([[-1.0]], [[1]], [[1]], [[0]], inputs="2nd", outputs="y[0]", states="ẋ"))
    assert (list(one.inports), list(one.outports), list(one.states)) == (["s_2nd"], ["y"], ["s_"])
    with pytest.raises(ParameterError, match=r"TransferFunction.unit_in: .*'cubits'"):
        from_control(control.tf([1], [1, 1], inputs="u [cubits]"))
    round_ = from_control(control.ss(-1, 1, 1, 0, inputs="u (V)", outputs="angle of tip (deg)", states="u [rad]"))
    assert (round_.input_names, round_.output_names) == (("u [V]",), ("angle_of_tip [deg]",))
    assert round_.state_names == ("u_2 [rad]",)


@pytest.mark.parametrize("kind", [StateSpace, DiscreteStateSpace])
def test_names_of_state_spaces_are_checked(kind):
    how = (
        "is no name. Write letters, digits and underscores, and a unit in brackets where there is one, such as "
        "'a [rad]'."
    )
    for names, message in (
        ({"input_names": ["a", "b"]}, "input_names needs one name per input (1) or none, got 2."),
        ({"state_names": ["x 1"]}, f"state_names: 'x 1' {how}"),
        ({"output_names": [2.0]}, f"output_names: 2 {how}"),
        ({"output_names": ["class"]}, f"output_names: 'class' {how}"),
        (
            {"state_names": ["w"], "output_names": ["w [rad]"]},
            "output_names: 'w' is taken already; states, inputs and outputs need different names.",
        ),
    ):
        with pytest.raises(ParameterError) as caught:
            kind(A=((0.5,),), B=((1.0,),), C=((1.0,),), **names)
        assert str(caught.value) == f"{kind.__name__}.{message}"
    with pytest.raises(ParameterError, match=r"input_names: 'u \[cubits\]': 'cubits' is not a unit known here"):
        kind(A=((0.5,),), B=((1.0,),), C=((1.0,),), input_names=["u [cubits]"])


def test_from_control_of_sampled_systems():
    assert from_control(control.tf([1], [1, -0.5], 0.02)) == DiscreteTransferFunction(
        num=(1,), den=(1, -0.5), period=0.02
    )
    assert from_control(control.ss([[0.5]], [[1]], [[2]], [[0]], 0.02)) == DiscreteStateSpace(
        A=((0.5,),), B=((1,),), C=((2,),), period=0.02
    )


def test_from_control_refuses():
    two = control.tf([[[1], [2]]], [[[1, 1], [1, 2]]])
    for system, message in (
        (42, "from_control takes a TransferFunction or StateSpace of python-control, got int."),
        (
            control.frd([1, 2], [1, 2]),
            "from_control takes a TransferFunction or StateSpace of python-control, got FrequencyResponseData.",
        ),
        (
            control.tf([1], [1, 1], True),
            "from_control needs the sample time, but this system has dt=True (sampled, period unknown). "
            "Build it with its period in s, such as control.tf(num, den, 0.01).",
        ),
        (
            two,
            "from_control takes a transfer function with one input and one output, got 2 and 1. "
            "Give it as a state space, such as control.ss(system).",
        ),
        (
            control.tf([1, 0, 1], [1, 2]),
            "from_control needs a proper transfer function, got a numerator of degree 2 over a "
            "denominator of degree 1. Add a fast pole.",
        ),
    ):
        with pytest.raises(BlockError) as caught:
            from_control(system)
        assert str(caught.value) == message


# ---- bad values


def test_refuses_bad_numbers():
    refuses("Integrator needs low < high, got low=2, high=1.", Integrator, low=2, high=1)
    refuses("Integrator.gain must be finite, got inf. It is: factor on the input.", Integrator, gain=float("inf"))
    refuses(
        "Integrator.reset must be true or false, got 1. It is: whether there is a port that resets the integral.",
        Integrator,
        reset=1,
    )
    refuses("Delay.time must lie in (0, inf), got 0. It is: length of the delay [s].", Delay, time=0)
    refuses(
        "FirstOrderLag.time_constant must lie in (0, inf), got -1. It is: time to 63 % of a step [s].",
        FirstOrderLag,
        time_constant=-1,
    )
    refuses("SecondOrderLag.zeta must lie in [0, inf), got -1. It is: damping ratio.", SecondOrderLag, zeta=-1)


def test_refuses_fractions_that_are_none():
    cls = TransferFunction
    proper = "TransferFunction must be proper: 1 <= len(num) <= len(den), got"
    refuses(f"{proper} 2 and 1.", cls, num=(1, 2), den=(1,))
    refuses(f"{proper} 0 and 1.", cls, num=())
    refuses("TransferFunction.den must begin with a number other than 0, got (0.0, 1.0).", cls, den=(0, 1))
    refuses("TransferFunction.den must begin with a number other than 0, got ().", cls, den=())
    refuses(
        "TransferFunction.num must be one list of numbers, such as [1, 0.5], got ((1.0,),). It is: numerator.",
        cls,
        num=((1,),),
    )
    refuses("TransferFunction.x0 needs one number per state (1) or none, got 2.", cls, den=(1, 1), x0=(1, 2))
    cls = ZeroPoleGain
    refuses(
        "ZeroPoleGain must be proper: no more zeros than poles, got 2 zeros and 1 poles.", cls, zeros=(1, 2), poles=(1,)
    )
    refuses("ZeroPoleGain.pole_pairs[0] must be a real and an imaginary part, got (-1.0,).", cls, pole_pairs=((-1,),))
    refuses("ZeroPoleGain.zero_pairs[0] must be a real and an imaginary part, got 1.", cls, zero_pairs=(1, 2))
    refuses("ZeroPoleGain.x0 needs one number per state (3) or none, got 1.", cls, poles=(1, 2, 3), x0=(1,))


def test_refuses_matrices_that_do_not_fit():
    cls = StateSpace
    fit = "to match the other matrices, got rows of length"
    refuses("StateSpace.A must be a list of rows, such as [[1, 0], [0, 1]].", cls, A=(1, 2))
    refuses("StateSpace.A must be square, got 2 rows of length 2, 1.", cls, A=((0, 1), (2,)))
    refuses("StateSpace.A must be square, got 1 row of length 2.", cls, A=((0, 1),))
    whole = dict(A=((0, 1), (-100, -2)), B=((0,), (100,)), C=((1, 0),))
    refuses(f"StateSpace.B must have 2 rows of 1, {fit} 1.", cls, **{**whole, "B": ((1,),)})
    refuses(f"StateSpace.C must have 1 rows of 2, {fit} 3.", cls, **{**whole, "C": ((1, 0, 0),)})
    refuses(f"StateSpace.D must have 1 rows of 1, {fit} 2.", cls, **whole, D=((1, 0),))
    refuses(f"StateSpace.B must have 2 rows of 1, {fit} none.", cls, **{**whole, "B": ()}, D=((1,),))
    refuses("StateSpace needs at least one input (columns of B) and one output (rows of C).", cls, A=((-1,),))
    refuses("StateSpace.x0 needs one number per state (2) or none, got 1.", cls, **whole, x0=(1,))
    refuses("StateSpace.D must be a list of rows, such as [[1, 0], [0, 1]].", cls, D=(((1,),),))


def test_an_integrator_whose_gain_brings_a_unit_closes_a_loop():
    """An integral controller: its gain is in 1/s, so the output has the unit of the error."""
    import tsmblocks as tsm

    blocks = {
        "r": tsm.blocks.Constant(value=1.0, unit="rad"),
        "e": tsm.blocks.Sum(),
        "i": Integrator(gain=2.0, unit="rad"),
    }
    loop = tsm.Diagram(title="I", blocks=blocks, wires=["r -> e.plus", "e -> i -> e.minus"], outputs={"y": "i"})
    assert loop.unit("y") == "rad"
    assert tsm.simulate(loop, stop=1.0)["y"][-1] == pytest.approx(1 - np.exp(-2.0), abs=1e-9)
