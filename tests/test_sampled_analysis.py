"""Linear models of diagrams with sampled blocks against python-control, and against what a run answers."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import control
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.analysis import frequency_response, linearize, loop_gain
from tsmblocks.blocks import (
    Constant,
    Delay,
    Derivative,
    DiscretePID,
    DiscreteTransferFunction,
    Encoder,
    FirstOrderLag,
    Gain,
    Integrator,
    MovingAverage,
    Play,
    Product,
    Quantiser,
    Saturation,
    SecondOrderLag,
    Sum,
    TransferFunction,
    UnitDelay,
    ZeroOrderHold,
)
from tsmblocks.common.errors import RunError
from tsmblocks.tuning.constraints import limit

T = 0.05


def pid_loop(kp=2.0, wires=(), ports=(), **more):
    """A sampled PID controller on an oscillating plant, and what else there is to be."""
    blocks = {
        "e": Sum(),
        "c": DiscretePID(period=T, kp=kp, ki=3.0, kd=0.1, tau=0.02),
        "p": SecondOrderLag(omega=6.0, zeta=0.5),
    }
    return tsm.Diagram(
        title="pid",
        blocks={**blocks, **more},
        wires=["e -> c -> p -> e.minus", *wires],
        inputs={"r": ["e.plus", *ports]},
        outputs={"y": "p", "u": "c"},
    )


def by_hand(kp=2.0):
    """The gain of its loop."""
    pid = kp + 3.0 * T * control.tf([1, 0], [1, -1], T) + control.tf([0.1, -0.1], [0.02 + T, -0.02], T)
    return pid * control.c2d(control.tf([36], [1, 6, 36]), T)


def two_rates():
    """A slow loop around a fast one, a diagram inside, and a limit that is not reached."""
    drive = tsm.Diagram(
        title="drive",
        blocks={"late": UnitDelay(period=0.01), "limit": Saturation(low=-50, high=50)},
        wires=["late -> limit"],
        inputs={"u": "late"},
        outputs={"y": "limit"},
    )
    blocks = {
        "e": Sum(),
        "hold": ZeroOrderHold(period=0.04),
        "fast": Sum(),
        "k": Gain(gain=3.0),
        "drive": drive,
        "c": DiscreteTransferFunction(period=0.04, num=(1.0, -0.8), den=(1.0, -0.5)),
        "mean": MovingAverage(period=0.01, length=3),
        "p": FirstOrderLag(time_constant=0.2),
        "q": Integrator(),
    }
    return tsm.Diagram(
        title="two",
        blocks=blocks,
        inputs={"r": "e.plus"},
        outputs={"y": "q", "v": "p", "u": "drive", "c": "c"},
        wires=["e -> hold -> c -> fast.plus", "fast -> k -> drive -> p -> q -> e.minus", "p -> mean -> fast.minus"],
    )


def test_the_gain_of_a_sampled_loop_is_that_of_python_control():
    wanted = control.margin(by_hand())
    for wire in ("c -> p", "p -> e.minus", "e -> c"):
        found = loop_gain(pid_loop(), wire)
        assert found.dt == T
        assert control.margin(found) == pytest.approx(wanted, rel=1e-5)
        z = np.exp(1j * T * np.logspace(-1, 1.7, 30))
        assert [found(v) for v in z] == pytest.approx([by_hand()(v) for v in z], rel=1e-9)


def test_a_closed_sampled_loop_has_the_poles_of_python_control():
    made = linearize(pid_loop())
    assert made.state_labels == ["p_value", "p_rate", "c_integral", "c_derivative", "c_last"]
    assert (made.input_labels, made.output_labels, made.dt) == (["r"], ["y", "u"], T)
    wanted = np.abs(control.feedback(by_hand(), 1).poles())
    assert np.sort(np.abs(made.poles()))[1:] == pytest.approx(np.sort(wanted), abs=1e-9)


@pytest.mark.parametrize(("make", "dt"), [(pid_loop, T), (two_rates, 0.04)])
def test_a_sampled_model_answers_as_the_diagram_runs(make, dt):
    diagram, n = make(), 26
    made, t, u = linearize(diagram), dt * np.arange(n), np.sin(0.7 * np.arange(n))
    run = tsm.simulate(diagram, inputs={"r": (t, u)}, hold="zero", stop=t[-1], step=1e-3)
    answer = control.forced_response(made, T=t, U=u).outputs
    for k, name in enumerate(diagram.outputs):
        assert run[name][:: round(dt * 1e3)] == pytest.approx(answer[k], abs=1e-9)


def test_a_sampled_model_holds_where_the_diagram_starts():
    """The slope of y² is that at the held output, which the first sample sets: 2 · 1.5."""
    d = tsm.Diagram(
        title="square",
        blocks={
            "one": Constant(value=1.5),
            "s": Sum(signs="++"),
            "z": ZeroOrderHold(period=T),
            "square": Product(),
            "g": Integrator(),
        },
        wires=["one -> s.plus1", "s -> z -> square.u1, square.u2", "square -> g"],
        inputs={"u": "s.plus2"},
        outputs={"y": "g", "now": "square"},
    )
    made = linearize(d)
    assert made.A.tolist() == [[1.0]]
    assert made.B.item() == pytest.approx(3.0 * T)
    assert made.D.ravel() == pytest.approx([0.0, 3.0])


@pytest.mark.parametrize("rounding", [Encoder(counts=400), Quantiser(interval=0.1)], ids=["encoder", "quantiser"])
def test_rounding_counts_as_a_gain_of_one(rounding):
    """Its slope is 0 nearly everywhere, with which any loop through it would have endless margins."""
    inner = tsm.Diagram(title="sensor", blocks={"round": rounding}, inputs={"u": "round"}, outputs={"y": "round"})
    for sensor in (rounding, inner):
        blocks = {"e": Sum(), "k": Gain(gain=5.0), "p": TransferFunction(num=(1.0,), den=(0.1, 1.0, 0.0)), "s": sensor}
        d = tsm.Diagram(
            title="seen",
            blocks=blocks,
            wires=["e -> k -> p -> s -> e.minus"],
            inputs={"r": "e.plus"},
            outputs={"y": "p", "seen": "s"},
        )
        wanted = control.margin(control.tf([5.0], [0.1, 1.0, 0.0]))
        assert control.margin(loop_gain(d, "s -> e.minus")) == pytest.approx(wanted, rel=1e-6, nan_ok=True)
        assert np.sort_complex(linearize(d).poles()) == pytest.approx([-5 - 5j, -5 + 5j])
        assert linearize(d).C[0].tolist() == linearize(d).C[1].tolist()


@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_the_frequency_response_of_a_sampled_block_is_that_of_what_it_holds(step):
    """Half a step is not lost: z/(z - 0.9) under a hold, and its first image as a harmonic of 1/(T f) - 1."""
    d = tsm.Diagram(
        title="held",
        blocks={"f": DiscreteTransferFunction(period=0.01, num=(0.1, 0.0), den=(1.0, -0.9)), "g": Gain(gain=-2.0)},
        wires=["f -> g"],
        inputs={"u": "f"},
        outputs={"y": "g"},
    )
    f = np.array([1.0, 5.0, 20.0])
    s, z = 2j * np.pi * f, np.exp(2j * np.pi * f * 0.01)
    wanted = -2.0 * 0.1 * z / (z - 0.9) * (1.0 - 1.0 / z) / (0.01 * s)
    found = frequency_response(d, f, step=step, settle=100)
    assert found.response[0] == pytest.approx(wanted, rel=1e-9)
    assert found.harmonics[0, 2, 2] == pytest.approx(1 / 4, rel=1e-9)  # at 80 Hz


def test_margins_of_sampled_loops_limit_a_search():
    for kp, stable in ((2.0, True), (9.0, False)):
        gain, phase, *_ = control.margin(by_hand(kp))
        found = [
            limit(f"{kind}('c -> p') >= 1", {}, pid_loop()).margin_of(pid_loop(kp))
            for kind in ("gain_margin", "phase_margin")
        ]
        assert found == pytest.approx([gain, phase], rel=1e-4)
        assert (found[0] > 1) == stable


REFUSED = {
    "memory": (
        lambda: linearize(pid_loop().insert("gap", Play(), before="p.u")),
        "gap of 'pid' acts at its own instants (samples, or memory from step to step, as a backlash has it)",
    ),
    "dead time": (
        lambda: linearize(pid_loop().insert("late", Delay(), before="p.u")),
        "'pid' has dead times beside samples, of which there is no linear model: late.past. Use a UnitDelay instead.",
    ),
    "slope": (
        lambda: linearize(pid_loop(wires=["d -> g"], ports=["d.u"], d=Derivative(), g=FirstOrderLag())),
        "'pid' depends on the derivative of its input 'r', which a discrete-time model holds between samples. Put a lag on the input.",
    ),
    "apart": (
        lambda: linearize(pid_loop(wires=["e -> a"], a=UnitDelay(period=0.04999))),
        "the samples of 'pid' coincide too seldom for a linear model (periods 0.05 s, 0.04999 s).",
    ),
    "fast wire": (
        lambda: loop_gain(two_rates(), "drive -> p"),
        "at='drive -> p': the signal on this wire matters, and changes, "
        "between the instants at which all samples of 'two' coincide (0.04 s apart). Open the loop where it enters "
        "or leaves the slowest sampled block.",
    ),
    "moving wire": (
        lambda: loop_gain(two_rates(), "p -> q"),
        "at='p -> q': the signal on this wire matters, and changes,",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_sampled_model(name):
    make, said = REFUSED[name]
    with pytest.raises(RunError) as found:
        make()
    assert str(found.value).startswith(said)
