"""The engine against independent integrators, closed forms, and itself by other routes."""

import copy
import gc
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
import weakref
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.tolerances import BACKENDS, EXACT, INTEGRATION
from tsmblocks.blocks import (
    PID,
    AsymmetricBoucWen,
    Constant,
    Delay,
    Derivative,
    DiscreteIntegrator,
    DiscretePID,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    MovingAverage,
    Play,
    Ramp,
    Saturation,
    SecondOrderLag,
    SensorNoise,
    Sine,
    Step,
    Sum,
    TransferFunction,
    UnitDelay,
    ZeroOrderHold,
)
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.engine import code_cache, jit, session
from tsmblocks.engine.backends import CompiledKernel
from tsmblocks.engine.kernel import Memory, Steps
from tsmblocks.engine.methods import METHODS
from tsmblocks.engine.plan import Plan
from tsmblocks.files import shipped
from tsmblocks.simulation.stability import StepWarning

SHIPPED = shipped.shipped_names()
W = 2 * np.pi * 0.2
AMPLITUDE = np.deg2rad(55)


def inputs_for(diagram, stop=20.0, step=1e-3):
    """A sine for each input, as samples fine enough that the hold does not matter (cubic)."""
    t = np.arange(0, stop + step, step)
    return {name: tsm.Samples(t, AMPLITUDE * np.sin(W * t), "cubic") for name in diagram.inputs}


def run_shipped(name, **options):
    diagram = tsm.load(name)
    return tsm.simulate(diagram, stop=options.pop("stop", 10.0), inputs=inputs_for(diagram), **options)


# ---- against SciPy


def scipy_reference(diagram, stop, knots):
    """The equations integrated by SciPy at tight tolerance, piece by piece between the knots (kinks of the input)."""
    eq = tsm.equations(diagram)
    p = np.array([diagram.parameters[k] for k in eq.p])
    given = inputs_for(diagram)
    splines = {}
    if given:
        from scipy.interpolate import CubicSpline

        splines = {k: CubicSpline(v.t, v.y) for k, v in given.items()}

    def feeds(t):
        return [float(splines[f.name.removeprefix("d/dt ")](t, nu=f.order)) for f in eq.u]

    at, into = [np.zeros(eq.rhs.nnz_in(k)) for k in range(6)], np.zeros(eq.rhs.nnz_out(0))
    at[5][:] = p
    buffer, evaluate = eq.rhs.buffer()  # a call with numbers converts each of them first, which takes most of the time
    for k, values in enumerate(at):
        buffer.set_arg(k, memoryview(values))
    buffer.set_res(0, memoryview(into))

    def rates(t, x):
        at[0][0], at[1][:], at[3][:] = t, x, feeds(t)
        evaluate()
        return into.copy()

    x = np.asarray(eq.start(p)[0]).ravel()
    edges = [0.0, *knots, stop]
    for begin, end in pairwise(edges):
        out = solve_ivp(rates, (begin, end), x, method="DOP853", rtol=1e-11, atol=1e-13)
        assert out.success
        x = out.y[:, -1]
    y = np.asarray(eq.rhs(stop, x, [], feeds(stop), [], p)[1]).ravel()
    return {name: y[eq.y.index(signal)] for name, signal in eq.aliases.items()}


CONTINUOUS = [n for n in SHIPPED if not tsm.equations(tsm.load(n)).d]


@pytest.mark.parametrize("name", CONTINUOUS)
def test_shipped_diagrams_agree_with_scipy(name):
    stop = 4.6
    expected = scipy_reference(tsm.load(name), stop, knots=[1.25, 3.75])  # where the reference turns
    run = run_shipped(name, stop=stop, step=1e-4)
    for key, value in expected.items():
        scale = max(1.0, np.abs(run[key]).max())
        assert abs(run[key][-1] - value) < INTEGRATION * scale, key


def test_every_shipped_diagram_is_held_against_something_independent():
    """Diagrams with memory or samples have tests of their own; a new one must be added here or there."""
    with_memory = set(SHIPPED) - set(CONTINUOUS)
    assert with_memory == {"sampled_position_loop", "tendon_sheath_play", *SUMS_OF_PLAYS}


SUMS_OF_PLAYS = {  # lines up, lines down (each a slope and the input at which it is zero), and the input's own weight
    "tendon_sheath_backlash": ([(0.8972, 0.15)], [(0.9487, -0.2)], 0.0),
    "tendon_sheath_prandtl_ishlinskii": (
        *(
            [(w, s * r) for w, r in zip((0.6, 0.36, 0.04, 0.01, 0.01), (0.1, 0.2, 0.4, 0.6, 0.8), strict=True)]
            for s in (1, -1)
        ),
        -0.1,
    ),
}


@pytest.mark.parametrize("name", SUMS_OF_PLAYS)
def test_sums_of_plays_against_their_definition(name):
    up, down, own = SUMS_OF_PLAYS[name]
    run = run_shipped(name, stop=20.0)
    x, y = run["x_in"], [0.0] * len(up)
    for k, value in enumerate(x):
        y = [max(c * (value - b), min(d * (value - e), m)) for (c, b), (d, e), m in zip(up, down, y, strict=True)]
        assert abs(run["x_out"][k] - own * value - sum(y)) < EXACT


def test_play_against_its_definition():
    run = run_shipped("tendon_sheath_play", stop=20.0)
    x, w, m = run["x_in"], 0.2, 0.0
    for k, value in enumerate(x):
        m = max(value - w, min(value + w, m))
        assert abs(run["x_out"][k] - m) < EXACT


def test_sampled_loop_against_scipy_with_a_hand_written_controller():
    """The plant by SciPy between samples, the controller as a difference equation written out here."""
    diagram = tsm.load("sampled_position_loop")
    run = tsm.simulate(diagram, stop=0.25, step=1e-4)
    assert np.abs(run["x_out"][::10] - _sampled_by_hand(diagram, 0.25)).max() < 2e-6


def _sampled_by_hand(diagram, stop):
    motor, c, encoder = (diagram.blocks[k] for k in ("motor", "controller", "encoder"))
    names = list(motor.states)

    def rates(_t, x, u):
        from tsmblocks.model.block import signals

        made = motor.derivatives(0.0, signals(names, x), signals(["u"], [u]))
        return [float(ca.DM(made[k])) for k in names]

    x, integral, derivative, last, angles = np.zeros(len(names)), 0.0, 0.0, 0.0, []
    count = 2 * np.pi / encoder.counts
    for k in range(round(stop / c.period) + 1):
        angle = float(motor.outputs(0.0, _by_name(names, x), None)["y"])
        angles.append(angle)
        measured = _encode(encoder, angle, count)
        e = AMPLITUDE * np.sin(W * k * c.period) - measured
        u, integral, derivative, last = _pid(c, e, integral, derivative, last)
        out = solve_ivp(rates, (0, c.period), x, args=(np.clip(u, -24, 24),), method="Radau", rtol=1e-9, atol=1e-12)
        x = out.y[:, -1]
    return np.array(angles)


def _by_name(names, x):
    from tsmblocks.model.block import signals

    return signals(names, x)


def _encode(encoder, angle, count):
    from tsmblocks.model.block import signals

    assert abs(float(encoder.outputs(0.0, None, signals(["u"], [angle]))["y"]) - angle) <= count
    return float(encoder.outputs(0.0, None, signals(["u"], [angle]))["y"])


def _pid(c, e, integral, derivative, last):
    """The difference equations of the block's docstring, through its own numbers."""
    from tsmblocks.model.block import signals

    x = signals(["integral", "derivative", "last"], [integral, derivative, last])
    u = signals(["e"], [e])
    y = float(ca.DM(c.outputs(0.0, x, u)["y"]))
    new = c.updates(0.0, x, u)
    return y, *(float(ca.DM(new[k])) for k in ("integral", "derivative", "last"))


def test_bouc_wen_benchmark_is_reproduced(measured):
    """Noël and Schoukens' simulated benchmark: the test multisine, RK4 at 15 kHz, to under 1e-6 m.

    The record is one period of a periodic, band-limited signal, so the force between its samples
    follows from its spectrum, and the last of three periods is compared.
    """
    h5py = pytest.importorskip("h5py", reason="pip install 'tsmblocks[data]'")
    from scipy.signal import resample

    with h5py.File(measured / "bouc_wen" / "test.h5") as file:
        u, y, fs = (np.asarray(file["multisine"][k], dtype=float).ravel() for k in ("u", "y", "fs"))
    finer, periods = 20, 3
    force = np.tile(resample(u, len(u) * finer), periods)
    t = np.arange(len(force)) / (fs[0] * finer)
    run = tsm.simulate(
        bouc_wen_oscillator(),
        stop=(len(u) * periods - 1) / fs[0],
        step=1 / (fs[0] * finer),
        every=finer,
        inputs={"u": (t, force)},
        log="outputs",
    )
    error = run["y"][-len(u) :] - y
    assert np.abs(error).max() < 1e-6
    assert np.sqrt(np.mean(error**2)) < 2.5e-7  # of 6.7e-4 m rms


def bouc_wen_oscillator():
    """m 2, c 10, k 5e4, alpha 5e4, beta 1e3, gamma 0.8, delta -1.1, nu 1, as blocks around BoucWen."""
    return tsm.Diagram(
        title="Bouc-Wen oscillator",
        blocks={
            "force": Sum(signs="+-"),
            "mass": Gain(gain=1 / 2.0),
            "speed": Integrator(),
            "place": Integrator(),
            "spring": tsm.blocks.BoucWen(alpha_x=5e4, alpha_zeta=1.0, A=5e4, beta=800.0, gamma=-1100.0, n=1.0),
            "damper": Gain(gain=10.0),
            "back": Sum(signs="++"),
        },
        wires=[
            "force -> mass -> speed -> place -> spring.x",
            "speed -> spring.v, damper",
            "spring -> back.plus1",
            "damper -> back.plus2",
            "back -> force.minus",
        ],
        inputs={"u": "force.plus"},
        outputs={"y": "place"},
    )


# ---- order, back ends, forms


class TestOrder:
    """Convergence order of each method, measured on closed forms."""

    @staticmethod
    def error(method, h):
        lag = tsm.Diagram(
            title="lag",
            blocks={"r": Sine(amplitude=1.0, frequency=1.0), "lag": SecondOrderLag(omega=9.0, zeta=0.4)},
            wires=["r -> lag"],
            outputs={"y": "lag"},
        )
        run = tsm.simulate(lag, stop=1.0, step=h, method=method)
        w, wn, z = 2 * np.pi, 9.0, 0.4
        # y'' + 2 z wn y' + wn^2 y = wn^2 sin(w t), from rest
        g = wn**2 / (wn**2 - w**2 + 2j * z * wn * w)
        wd, t = wn * np.sqrt(1 - z**2), run.t
        steady = (g * np.exp(1j * w * t)).imag
        y0, v0 = -g.imag, -(1j * w * g).imag
        transient = np.exp(-z * wn * t) * (y0 * np.cos(wd * t) + (v0 + z * wn * y0) / wd * np.sin(wd * t))
        return np.abs(run["y"] - steady - transient).max()

    @pytest.mark.parametrize("method", sorted(METHODS))
    def test_order(self, method):
        coarse, fine = self.error(method, 2e-3), self.error(method, 1e-3)
        assert np.log2(coarse / fine) == pytest.approx(METHODS[method].order, abs=0.12)


@pytest.mark.parametrize("name", SHIPPED)
def test_back_ends_agree(name):
    fast = run_shipped(name, stop=20.0, backend="llvm")
    slow = run_shipped(name, stop=20.0, backend="casadi")
    assert np.abs(fast.rows - slow.rows).max() < BACKENDS


@pytest.mark.parametrize("name", [*SHIPPED, "everything"])
@pytest.mark.parametrize("method", sorted(METHODS))
def test_large_form_agrees(name, method, monkeypatch):
    diagram = everything() if name == "everything" else tsm.load(name)
    options = {"stop": 1.5, "method": method, "inputs": inputs_for(diagram)}
    small = tsm.simulate(diagram, **options)
    session.single_kernel.cache_clear()
    monkeypatch.setattr("tsmblocks.engine.backends.LARGE_OPERATIONS", 0)
    large = tsm.simulate(diagram, **options)
    session.single_kernel.cache_clear()
    assert np.abs(small.rows - large.rows).max() < BACKENDS


def everything():
    """Continuous, sampled at two rates, memory, delay, exact derivative, noise: one of each in one diagram."""
    return tsm.Diagram(
        title="one of each",
        blocks={
            "ref": Sine(),
            "e": Sum(),
            "pid": DiscretePID(period=0.01, kp=1.5, ki=2.0, low=-24.0, high=24.0),
            "slow": ZeroOrderHold(period=0.05),
            "hold": UnitDelay(period=0.02),
            "lag": FirstOrderLag(time_constant=0.2),
            "rate": Derivative(),
            "delay": Delay(time=0.0337),
            "play": Play(half_width=0.1),
            "noise": SensorNoise(std=0.01, interval=0.004),
            "tsm": AsymmetricBoucWen(),
        },
        wires=[
            "ref -> e.plus",
            "e -> pid -> lag -> noise -> hold -> e.minus",
            "lag -> rate",
            "lag -> delay -> play",
            "play -> tsm",
            "lag -> slow",
        ],
        outputs={"y": "lag", "played": "play", "rate": "rate", "out": "tsm", "slow": "slow"},
    )


def test_everything_at_once_agrees_between_back_ends():
    a = tsm.simulate(everything(), stop=3.0)
    b = tsm.simulate(everything(), stop=3.0, backend="casadi")
    assert np.abs(a.rows - b.rows).max() < BACKENDS


def test_fused_arithmetic_is_the_only_difference_from_casadi():
    """Fig 9(b) over 20 s: the two back ends differ by rounding only."""
    a, b = (run_shipped("fig09b_feedforward", stop=20.0, backend=k) for k in ("llvm", "casadi"))
    assert np.abs(a["x_out"] - b["x_out"]).max() < 1e-11


# ---- python-control


def test_linear_blocks_and_a_closed_loop_agree_with_python_control():
    import control as ct

    t = np.linspace(0, 3, 3001)
    loop = tsm.Diagram(
        title="loop",
        blocks={
            "e": Sum(),
            "pid": PID(kp=3.0, ki=2.0, kd=0.4, tau=0.02),
            "plant": TransferFunction(num=(2.0, 5.0), den=(1.0, 0.7, 4.0)),
        },
        wires=["e -> pid -> plant -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "plant"},
    )
    ours = tsm.simulate(loop, inputs={"r": (t, np.ones_like(t))}, step=2.5e-4, every=4)["y"]
    s = ct.tf("s")
    controller = 3.0 + 2.0 / s + 0.4 * s / (0.02 * s + 1)
    plant = ct.tf([2, 5], [1, 0.7, 4])
    theirs = np.asarray(ct.step_response(ct.feedback(controller * plant, 1), t).outputs)
    assert np.abs(ours - theirs).max() < 1e-8


@pytest.mark.parametrize("system", ["tf", "ss", "mimo", "zpk"])
def test_a_control_system_is_a_block(system):
    import control as ct

    made = {
        "tf": ct.tf([1, 3], [1, 2, 10]),
        "zpk": ct.zpk([-1], [-2 + 3j, -2 - 3j], 4.0),
        "ss": ct.ss([[0, 1], [-4, -0.5]], [[0], [1]], [[1, 0]], [[0]]),
        "mimo": ct.ss([[0, 1], [-4, -0.5]], [[1, 0], [0, 1]], [[1, 0], [0, 2]], [[0, 0], [0.3, 0]]),
    }[system]
    t = np.linspace(0, 2, 2001)
    block = tsm.from_control(made)
    inputs = {f"in{k}": f"b.{port}" for k, port in enumerate(block.inports)}
    outputs = {f"out{k}": f"b.{port}" for k, port in enumerate(block.outports)}
    diagram = tsm.Diagram(title="lti", blocks={"b": block}, inputs=inputs, outputs=outputs)
    u = np.vstack([np.sin((k + 2) * t) for k in range(len(inputs))])
    run = tsm.simulate(diagram, inputs={f"in{k}": (t, row) for k, row in enumerate(u)}, hold="linear")
    theirs = ct.forced_response(made, t, u if len(inputs) > 1 else u[0])
    for k, row in enumerate(np.atleast_2d(np.asarray(theirs.outputs))):
        assert np.abs(run[f"out{k}"] - row).max() < 1e-9


# ---- inputs and holds


@pytest.mark.parametrize(("hold", "order"), [("zero", 1), ("linear", 2), ("cubic", 4)])
def test_order_of_each_hold(hold, order):
    """A smooth input sampled on the steps of RK4 limits the order as its hold does."""
    diagram = tsm.Diagram(
        title="l", blocks={"l": FirstOrderLag(time_constant=0.1)}, inputs={"u": "l.u"}, outputs={"y": "l"}
    )

    def error(h):
        t = np.arange(0, 2 + h / 2, h)
        run = tsm.simulate(diagram, inputs={"u": (t, np.sin(5 * t))}, hold=hold, step=h)
        tau, w = 0.1, 5.0
        exact = (np.sin(w * t) - tau * w * np.cos(w * t) + tau * w * np.exp(-t / tau)) / (1 + (tau * w) ** 2)
        return np.abs(run["y"] - exact)[len(t) // 2 : -3].max()

    assert np.log2(error(0.02) / error(0.01)) == pytest.approx(order, abs=0.25)


def test_inputs_of_every_kind_agree():
    diagram = tsm.Diagram(title="l", blocks={"l": FirstOrderLag()}, inputs={"u": "l.u"}, outputs={"y": "l"})
    t = np.linspace(0, 1, 1001)
    kinds = [
        2.0,
        np.full(1001, 2.0),
        np.full(1000, 2.0),
        (t, np.full(1001, 2.0)),
        tsm.Samples(t, np.full(1001, 2.0)),
        lambda t: 2.0 + 0 * t,
        lambda t: 2.0,
    ]
    runs = [tsm.simulate(diagram, stop=1.0, inputs={"u": kind})["y"] for kind in kinds]
    assert all(np.abs(run - runs[0]).max() < EXACT for run in runs)


def test_a_recording_drives_all_inputs_that_are_not_given():
    blocks = {"l": FirstOrderLag(), "sum": Sum()}
    inputs = {"u": "sum.plus", "v": "sum.minus"}
    diagram = tsm.Diagram(title="l", blocks=blocks, wires=["sum -> l"], inputs=inputs, outputs={"y": "l"})
    t = np.linspace(0, 1, 101)
    record = tsm.Record("run", t, {"u": np.sin(t), "v": t}, {"u": "1", "v": "1"})
    by_name = tsm.simulate(diagram, inputs={"u": record, "v": record})["y"]
    assert np.array_equal(tsm.simulate(diagram, data=record)["y"], by_name)
    again = tsm.simulate(diagram, data=tsm.simulate(diagram, data=record))["y"]
    assert np.abs(again - by_name).max() < EXACT
    own = tsm.simulate(diagram, data=record, inputs={"v": 0.0})["y"]
    assert np.array_equal(own, tsm.simulate(diagram, inputs={"u": record, "v": 0.0})["y"])
    with pytest.raises(tsm.TsmError) as caught:
        tsm.simulate(diagram, data="run.csv")
    assert str(caught.value) == "data must be a recording or a run with the inputs of the diagram, got 'run.csv'."
    with pytest.raises(tsm.TsmError, match="v"):
        tsm.simulate(diagram, data=tsm.Record("run", t, {"u": np.sin(t)}, {"u": "1"}))


def test_a_jump_in_a_held_input_falls_on_its_instant():
    """With zero-order hold a jump at a sample acts from that instant on, not half a step early."""
    diagram = tsm.Diagram(title="i", blocks={"i": Integrator()}, inputs={"u": "i.u"}, outputs={"y": "i"})
    run = tsm.simulate(
        diagram,
        stop=1.0,
        step=0.1,
        hold="zero",
        inputs={"u": (np.array([0.0, 0.3, 0.7, 1.0]), np.array([0.0, 1.0, 3.0, 0.0]))},
    )
    assert run["y"][-1] == pytest.approx(0.4 * 1 + 0.3 * 3, abs=EXACT)


# ---- exact derivative


def test_exact_derivative_of_time_states_and_inputs():
    t = np.linspace(0, 4, 4001)
    diagram = tsm.Diagram(
        title="d",
        blocks={
            "r": Sine(amplitude=1.0, frequency=0.5),
            "dr": Derivative(),
            "lag": SecondOrderLag(omega=8.0, zeta=0.5),
            "dx": Derivative(),
            "ddx": Derivative(),
            "du": Derivative(),
        },
        wires=["r -> dr", "r -> lag -> dx -> ddx"],
        inputs={"u": "du.u"},
        outputs={"dr": "dr", "x": "lag", "dx": "dx", "ddx": "ddx", "du": "du"},
    )
    run = tsm.simulate(diagram, inputs={"u": tsm.Samples(t, np.cos(3 * t), "cubic")}, step=1e-3)
    assert np.abs(run["dr"] - np.pi * np.cos(np.pi * run.t)).max() < EXACT
    assert np.abs(run["dx"] - run["lag.rate"]).max() < EXACT
    from_its_equation = 64.0 * (run["r.y"] - run["x"]) - 8.0 * run["lag.rate"]
    assert np.abs(run["ddx"] - from_its_equation).max() < 1e-10
    assert np.abs(run["du"] + 3 * np.sin(3 * t))[5:-5].max() < 1e-7


@tsm.block(register=False)
class Accelerometer(tsm.Block):
    """Acceleration of a position.

    .. math:: y = \\ddot x
    """

    x = tsm.Input("position")
    v = tsm.Input("its rate", rate_of="x")
    a = tsm.Input("the rate of that", rate_of="v")
    y = tsm.Output("acceleration")

    def outputs(self, t, x, u):
        return dict(y=u.a)


@pytest.mark.parametrize("wired", [False, True])
def test_a_rate_may_have_a_rate(wired):
    """Formed from the rate that is formed, or from the one that is wired."""
    blocks = {"s": Sine(amplitude=2.0, frequency=0.5), "a": Accelerometer(), "d": Derivative()}
    wires = ["s -> a.x", "s -> d", *(["d -> a.v"] if wired else [])]
    run = tsm.simulate(tsm.Diagram(title="a", blocks=blocks, wires=wires, outputs={"y": "a"}), stop=2.0, step=0.01)
    assert np.abs(run["y"] + 2 * np.pi**2 * np.sin(np.pi * run.t)).max() < EXACT


def test_derivative_action_without_a_filter_goes_through_a_nonlinear_plant():
    """u = kd d/dt(r - y) around a lag: the derivative of y is known from its state, so no filter is needed."""
    diagram = tsm.Diagram(
        title="pd",
        blocks={
            "r": Ramp(slope=2.0, start=0.0),
            "e": Sum(),
            "d": Derivative(),
            "g": Gain(gain=0.5),
            "m": SecondOrderLag(omega=10.0, zeta=0.7),
        },
        wires=["r -> e.plus", "e -> d -> g -> m -> e.minus"],
        outputs={"y": "m"},
    )
    run = tsm.simulate(diagram, stop=20.0)
    # y -> u = 0.5 (2 - y'), and the lag's steady state is y = u with y' = 0
    assert run["y"][-1] == pytest.approx(1.0, abs=1e-6)


# ---- delays and samples


def test_transport_delay_is_exact_on_the_grid_and_fourth_order_off_it():
    def error(tau, h):
        d = tsm.Diagram(
            title="d",
            blocks={"r": Sine(amplitude=1.0, frequency=1.0), "d": Delay(time=tau), "i": Integrator()},
            wires=["r -> d -> i"],
            outputs={"y": "d", "int": "i"},
        )
        run = tsm.simulate(d, stop=2.0, step=h)
        late = run.t > tau + 6 * h
        exact = np.sin(2 * np.pi * (run.t - tau))
        return np.abs(run["y"] - exact)[late].max()

    assert error(0.1, 0.01) < EXACT
    assert np.log2(error(0.1037, 0.01) / error(0.1037, 0.005)) > 3.5


def test_delayed_feedback_against_the_method_of_steps():
    """y' = -y(t - 1), y = 1 before: y = 1 - t on [0, 1], then a parabola; SciPy is not needed."""
    d = tsm.Diagram(
        title="dde",
        blocks={"y": Integrator(integral=1.0), "d": Delay(time=1.0, initial=1.0), "g": Gain(gain=-1.0)},
        wires=["y -> d -> g -> y"],
        outputs={"y": "y"},
    )
    run = tsm.simulate(d, stop=2.0, step=0.01)
    first, second = run.t <= 1, run.t >= 1
    assert np.abs(run["y"] - (1 - run.t))[first].max() < 1e-10
    exact = 1 - run.t + (run.t - 1) ** 2 / 2
    assert np.abs(run["y"] - exact)[second].max() < 5e-5  # the corner in the past costs an order locally


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize(("source", "jump"), [(Constant(value=2.0), 0.0), (Step(time=0.2, after=2.0), 0.2)])
@pytest.mark.parametrize("tau", [0.01, 0.05, 0.3])
def test_a_jump_comes_out_of_a_delay_as_a_jump(source, jump, tau, backend):
    """What lies before the start ends with the step before, and a jump is not spread over one."""
    d = tsm.Diagram(
        title="jump",
        blocks={"s": source, "late": Delay(time=tau), "i": Integrator()},
        wires=["s -> late -> i"],
        outputs={"y": "i"},
    )
    run = tsm.simulate(d, stop=1.0, step=0.01, backend=backend)
    assert np.abs(run["y"] - 2.0 * np.maximum(run.t - jump - tau, 0.0)).max() < EXACT


def test_what_began_before_a_delay_costs_no_order():
    """A sine that is 0.84 as the run starts comes out of the delay with a jump there."""
    d = tsm.Diagram(
        title="cut",
        blocks={"s": Sine(amplitude=1.0, frequency=0.5, phase=1.0), "late": Delay(time=0.3), "i": Integrator()},
        wires=["s -> late -> i"],
        outputs={"y": "i"},
    )
    exact = (np.cos(1.0) - np.cos(1.0 + np.pi * 0.7)) / np.pi
    errors = [abs(tsm.simulate(d, stop=1.0, step=h)["y"][-1] - exact) for h in (0.02, 0.01)]
    assert errors[1] < 1e-8
    assert np.log2(errors[0] / errors[1]) > 3.5


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("tau", [0.003, 0.01, 0.024])
@pytest.mark.parametrize("split", [1, 2])
def test_a_sampled_controller_behind_a_delay_against_its_exact_sequence(tau, split, backend):
    """A lag of 0.05 s under a sampled PI controller whose command comes late by one delay, or by two in a row."""
    period, lag = 0.01, 0.05
    blocks = {
        "one": Constant(value=1.0),
        "e": Sum(),
        "pi": DiscretePID(period=period, kp=2.0, ki=10.0),
        "double": Gain(gain=2.0),
        "p": FirstOrderLag(gain=0.5, time_constant=lag),
    }
    late = {f"late{k}": Delay(time=tau if split == 1 else [tau - 0.001, 0.001][k]) for k in range(split)}
    d = tsm.Diagram(
        title="late",
        blocks={**blocks, **late},
        outputs={"y": "p"},
        wires=["one -> e.plus", f"e -> pi -> double -> {' -> '.join(late)} -> p -> e.minus"],
    )
    run = tsm.simulate(d, stop=0.5, step=1e-3, backend=backend)
    whole, part = divmod(round(tau * 1e3), 10)
    y, integral, given, expected = 0.0, 0.0, [0.0] * (whole + 1), []
    for _ in range(51):
        expected.append(y)
        integral += 10.0 * period * (1.0 - y)
        given.append(2.0 * (1.0 - y) + integral)
        for u, length in ((given[-2 - whole], part * 1e-3), (given[-1 - whole], period - part * 1e-3)):
            y = u + (y - u) * np.exp(-length / lag)
    assert np.abs(run["y"][::10] - expected).max() < 1e-8


def test_sampled_blocks_of_two_rates_update_in_signal_order():
    d = tsm.Diagram(
        title="rates",
        blocks={
            "r": Ramp(slope=1.0, start=0.0),
            "fast": ZeroOrderHold(period=0.01),
            "slow": ZeroOrderHold(period=0.02),
            "back": UnitDelay(period=0.01),
        },
        wires=["r -> fast -> slow", "fast -> back"],
        outputs={"fast": "fast", "slow": "slow", "back": "back"},
    )
    run = tsm.simulate(d, stop=0.1, step=0.001)
    ticks = np.round(run.t * 1000).astype(int)
    assert np.abs(run["fast"] - ticks // 10 * 0.01).max() < EXACT
    assert np.abs(run["slow"] - ticks // 20 * 0.02).max() < EXACT
    assert np.abs(run["back"] - np.maximum(ticks // 10 - 1, 0) * 0.01).max() < EXACT


def test_sampled_feedback_equals_the_z_transform():
    """A first-order plant under a zero-order hold and a sampled gain has a pole that is known in closed form."""
    k, tau, period = 2.0, 0.1, 0.02
    d = tsm.Diagram(
        title="sampled",
        blocks={
            "one": Constant(value=1.0),
            "e": Sum(),
            "g": Gain(gain=k),
            "z": ZeroOrderHold(period=period),
            "p": FirstOrderLag(time_constant=tau),
        },
        wires=["one -> e.plus", "e -> g -> z -> p -> e.minus"],
        outputs={"y": "p"},
    )
    run = tsm.simulate(d, stop=0.4, step=0.001)
    a = np.exp(-period / tau)
    y, expected = 0.0, []
    for _ in range(21):
        expected.append(y)
        y = a * y + (1 - a) * k * (1 - y)
    assert np.abs(run["y"][::20] - expected).max() < 1e-8


# ---- running


def test_stepper_follows_simulate_and_goes_back():
    d = tsm.load("motor_linear")
    stepper = tsm.Stepper(d, step=1e-3)
    run = tsm.simulate(d, stop=0.1, inputs={"u": 3.0})
    outputs = [stepper.step({"u": 3.0})["x"] for _ in range(100)]
    assert np.abs(np.array(outputs) - run["x"][1:]).max() < EXACT
    saved = pickle.loads(pickle.dumps(stepper.save()))
    onward = [stepper.step({"u": 1.0})["x"] for _ in range(5)]
    stepper.restore(saved)
    assert [stepper.step({"u": 1.0})["x"] for _ in range(5)] == onward


def test_log_every_and_outputs_only():
    full = run_shipped("fig16_feedforward_feedback", stop=2.0)
    thin = run_shipped("fig16_feedforward_feedback", stop=2.0, every=7, log="outputs")
    assert np.array_equal(thin.t, full.t[::7])
    for name in thin.aliases:
        assert np.array_equal(thin[name], full[name][::7])
    assert "pid.y" not in thin
    assert "pid.y" in run_shipped("fig16_feedforward_feedback", stop=0.1, log=["pid.*"])


def test_long_runs_are_cut_into_pieces_without_a_seam(monkeypatch):
    whole = tsm.simulate(everything(), stop=9.0)
    monkeypatch.setattr(session, "PIECE_SECONDS", 1e-9)  # as short as pieces get: 1024 steps
    seen = []
    cut = tsm.simulate(everything(), stop=9.0, progress=seen.append, every=3)
    assert np.array_equal(cut.rows, whole.rows[::3])
    assert len(seen) >= 3
    assert all(a < b for a, b in pairwise(seen))


def test_ctrl_c_returns_what_there_is():
    """The interrupt arrives between two pieces here; wherever it strikes, whole pieces are kept."""

    def progress(done):
        signal.raise_signal(signal.SIGINT)

    run = tsm.simulate(everything(), stop=200.0, every=10, log="outputs", progress=progress)
    whole = tsm.simulate(everything(), stop=run.t[-1] + 0.01, every=10, log="outputs")
    assert not run.complete
    assert 0 < run.t[-1] < 200.0
    assert np.array_equal(run.rows, whole.rows[: len(run.t)])


def test_a_changed_parameter_does_not_compile_again():
    d = tsm.load("fig09b_feedforward")
    tsm.simulate(d, stop=0.1)
    eq = tsm.equations(d)
    before = session.single_kernel.cache_info().misses
    tsm.simulate(d, stop=0.1, parameters={"controller.kp": 30.0})
    assert tsm.equations(d.with_parameters({"theta": 4.0})) is eq
    assert session.single_kernel.cache_info().misses == before


def test_step_too_long_for_the_fastest_pole_warns():
    d = tsm.Diagram(
        title="stiff",
        blocks={"s": Step(), "l": FirstOrderLag(time_constant=1e-4)},
        wires=["s -> l"],
        outputs={"y": "l"},
    )
    with pytest.warns(StepWarning, match=r"fastest pole \(1e\+04 rad/s, at l.value\).*a step of about 0.00027 s"):
        tsm.simulate(d, stop=0.01, step=1e-3)


def test_nan_is_caught_where_it_is_born_with_the_run_so_far():
    d = tsm.Diagram(
        title="d",
        blocks={
            "r": Ramp(slope=-1.0, initial=0.5, start=0.0),
            "one": Constant(value=0.0),
            "q": Divide(),
            "cap": Saturation(),
            "g": Gain(),
        },
        wires=["one -> q.num", "r -> q.den", "q -> g -> cap"],
        outputs={"y": "cap"},
    )
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(d, stop=1.0, step=0.125)
    error = caught.value
    assert (error.block, error.time) == ("q", 0.5)
    assert (
        str(error)
        == "q.y = nan at t = 0.5 s, first in q (Divide). Its inputs: num (from one.y) = 0, den (from r.y) = 0."
    )
    assert len(error.run.t) == 4
    assert np.array_equal(error.run["r.y"], [0.5, 0.375, 0.25, 0.125])


def test_nan_is_not_swallowed_by_a_limit_when_only_outputs_are_logged():
    d = tsm.Diagram(
        title="d",
        blocks={"a": Constant(value=0.0), "b": Constant(value=0.0), "q": Divide(), "cap": Saturation()},
        wires=["a -> q.num", "b -> q.den", "q -> cap"],
        outputs={"y": "cap"},
    )
    with pytest.raises(NotFinite, match="first in q"):
        tsm.simulate(d, stop=1.0, log="outputs")


# ---- machine code on disk


def test_machine_code_is_kept_and_a_damaged_file_is_replaced(tmp_path, monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_CACHE", str(tmp_path / "store"))
    text = "define void @run(ptr %t) {\n  ret void\n}\n"
    jit._LOADED.clear()
    jit.compile_text(text, promote=True)
    (file,) = (tmp_path / "store").rglob("*.o")
    good = file.read_bytes()
    assert file.parent.stat().st_mode & 0o077 == 0
    for damage in (b"", good[:50], good[:-1] + b"x", b"nonsense"):
        file.write_bytes(damage)
        jit._LOADED.clear()
        jit.compile_text(text, promote=True)
        assert file.read_bytes() == good
    jit._LOADED.clear()


def test_machine_code_lives_as_long_as_whoever_may_call_it():
    function = jit.compile_text("define void @run(ptr %t) {\n  store i64 7, ptr %t\n  ret void\n}\n", promote=True)
    code = weakref.ref(jit._LOADED[next(reversed(jit._LOADED))][0])
    jit._LOADED.clear()
    gc.collect()
    assert code() is not None
    place = np.zeros(1, dtype=np.int64)
    function(place.ctypes.data)
    assert place[0] == 7
    del function
    gc.collect()
    assert code() is None


def test_only_the_functions_used_last_stay_loaded(monkeypatch):
    monkeypatch.setattr(jit, "MOST_LOADED", 3)
    monkeypatch.setattr(jit, "_LOADED", {})
    texts = [f"define void @run(ptr %t) {{\n  store i64 {k}, ptr %t\n  ret void\n}}\n" for k in range(5)]
    engines = []
    for text in (*texts[:3], texts[0], *texts[3:]):  # the first is used once more before the last two
        jit.compile_text(text, promote=True)
        engines.append(weakref.ref(jit._LOADED[next(reversed(jit._LOADED))][0]))
    gc.collect()
    assert len(jit._LOADED) == 3
    assert [engine() is not None for engine in engines] == [True, False, False, True, True, True]


def test_a_store_others_may_write_to_is_not_used(tmp_path, monkeypatch):
    store = tmp_path / "open"
    store.mkdir(mode=0o777)
    store.chmod(0o777)
    monkeypatch.setenv("TSMBLOCKS_CACHE", str(store))
    jit._LOADED.clear()
    jit.compile_text("define void @run(ptr %t) {\n  ret void\n}\n", promote=True)
    assert not list(store.iterdir())
    jit._LOADED.clear()


def _write_many(store, started):
    os.environ["TSMBLOCKS_CACHE"] = str(store)
    started.set()
    while True:
        for n in range(50):
            jit._LOADED.clear()
            jit.compile_text(f"define void @run(ptr %t) {{\n  %a = add i64 {n}, 1\n  ret void\n}}\n", promote=True)


def test_machine_code_of_one_process_is_found_by_the_next(tmp_path):
    """Names of stored machine code do not depend on the order of sets, which differs from process to process."""
    code = (
        "import tsmblocks as tsm\n"
        "for name in ('fig09b_feedforward', 'loop_around_model'):\n"
        "    tsm.simulate(tsm.load(name), stop=0.01)\n"
    )
    stored = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        more = {"PYTHONHASHSEED": seed, "TSMBLOCKS_CACHE": str(folder)}
        subprocess.run([sys.executable, "-c", code], env=os.environ | more, check=True)
        stored.append({path.relative_to(folder).as_posix() for path in folder.rglob("*.o")})
    assert len(stored[0]) >= 2
    assert stored[0] == stored[1]


def test_killed_and_concurrent_writers_leave_no_bad_file(tmp_path, monkeypatch):
    store = tmp_path / "store"
    context = multiprocessing.get_context("spawn")
    for _ in range(3):
        events = [context.Event(), context.Event()]
        workers = [context.Process(target=_write_many, args=(store, e)) for e in events]
        for w in workers:
            w.start()
        for e in events:
            e.wait(30)
        until = time.monotonic() + 60
        while not list(store.rglob("*.o")) and time.monotonic() < until:
            time.sleep(0.02)
        time.sleep(0.3)
        for w in workers:
            w.kill()
            w.join()
    kept = list(store.rglob("*.o"))
    assert kept
    monkeypatch.setenv("TSMBLOCKS_CACHE", str(store))
    assert all(code_cache.read_code(f.stem) is not None for f in kept)


def test_without_llvmlite_the_other_back_end_serves(monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_ENGINE", "casadi")
    session.single_kernel.cache_clear()
    run = tsm.simulate(tsm.load("motor_linear"), stop=0.1, inputs={"u": 1.0})
    session.single_kernel.cache_clear()
    assert run["x"][-1] > 0
    with pytest.raises(RunError, match="needs llvmlite"):
        tsm.simulate(tsm.load("motor_linear"), stop=0.1, inputs={"u": 1.0}, backend="llvm")


# ---- elementary functions of the emitter


@pytest.mark.parametrize("name", ["exp", "expm1", "tanh", "sin", "cos"])
def test_own_elementary_functions_are_accurate_in_lanes(name):
    """Each against NumPy over its range, side by side in lanes; a few units in the last place."""
    x = np.concatenate(
        [np.linspace(-700, 700, 4001), np.logspace(-300, 2, 4000), -np.logspace(-300, 2, 4000), [0.0] * 7]
    )
    lanes = 16
    x = x[: len(x) // lanes * lanes]
    t, d, u, q = ca.SX.sym("t"), ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, 1)
    state, p = ca.SX.sym("x"), ca.SX.sym("p")
    f = ca.Function(
        "rhs",
        [t, state, d, u, q, p],
        [ca.SX(0), getattr(ca, name)(p), ca.SX(0, 1)],
        ["t", "x", "d", "u", "q", "p"],
        ["dx", "y", "s"],
    )
    kernel = CompiledKernel(
        Plan(
            rhs=f,
            update=None,
            lag=None,
            method=METHODS["euler"],
            y=(0,),
            every_step=False,
            lanes=lanes,
            wide_x=(True,),
            wide_d=(),
            wide_p=(True,),
            wide_s=(),
        )
    )
    got = np.empty_like(x)
    for k in range(0, len(x), lanes):
        memory = Memory(np.zeros(lanes), np.empty(0), x[k : k + lanes].copy(), np.empty(0), 0, np.empty(0))
        y = np.empty((1, lanes))
        kernel.advance(memory, np.empty((1, 1, 0)), y, Steps(0.0, 1.0, 0, 0, True))
        got[k : k + lanes] = y[0]
    expected = getattr(np, name)(x)
    size = np.abs(expected)
    ordinary = np.isfinite(expected) & (size > 1e-290)
    assert (np.abs(got - expected)[ordinary] / np.spacing(size[ordinary])).max() < 4
    assert np.array_equal(np.isinf(got), np.isinf(expected))


@pytest.mark.parametrize(("name", "most"), [("sin", 1.6), ("cos", 1.6), ("tanh", 4.2)], ids=["sin", "cos", "tanh"])
def test_own_elementary_functions_of_single_numbers_against_extended_precision(name, most):
    """Units in the last place; beyond the range of the reduction sine and cosine are those of libm."""
    u, state, none = ca.SX.sym("u"), ca.SX.sym("x"), ca.SX(0, 1)
    f = ca.Function(
        "rhs",
        [ca.SX.sym("t"), state, none, u, none, none],
        [ca.SX(0), getattr(ca, name)(u), none],
        ["t", "x", "d", "u", "q", "p"],
        ["dx", "y", "s"],
    )
    plan = Plan(
        rhs=f, update=None, lag=None, method=METHODS["euler"], y=(0,), every_step=False, lanes=1,
        wide_x=(False,), wide_d=(), wide_p=(), wide_s=(),
    )  # fmt: skip
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-size, size, 20000) for size in (0.1, 1.0, 10.0, 1e4, 1e9, 1e15)])
    x = np.append(x, [*-np.logspace(-300, 9, 2000), 0.0, 20.0, -20.0, 1e300, np.nan])
    got, none = np.empty((len(x), 1)), np.empty(0)
    kernel = CompiledKernel(plan)
    memory, steps = Memory(np.zeros(1), none, none, none, 0, none), Steps(0.0, 1.0, 0, len(x) - 1, True)
    kernel.advance(memory, x.reshape(-1, 1, 1), got, steps)
    exact = getattr(np, name)(x.astype(np.longdouble))
    if np.finfo(np.longdouble).eps > 1e-18:
        pytest.skip("no extended precision here")
    assert np.nanmax(np.abs(got[:, 0] - exact) / np.spacing(np.abs(exact).astype(float))) < most
    assert np.isnan(got[-1, 0])


@pytest.mark.parametrize("count", [20, 900])
def test_many_sines_are_called_and_give_the_same_bits_as_inlined(count):
    blocks = {f"s{k}": Sine(frequency=0.3 + 0.7 * k) for k in range(count)}
    whole = tsm.simulate(tsm.Diagram(title="many", blocks=blocks, wires=[]), stop=0.5)
    for k in (0, 7, 19):
        alone = tsm.simulate(tsm.Diagram(title="one", blocks={"s": Sine(frequency=0.3 + 0.7 * k)}, wires=[]), stop=0.5)
        assert np.array_equal(whole[f"s{k}.y"], alone["s.y"])


# ---- results on disk


def two_signals(**outputs):
    blocks = {"s": Sine(), "g": Gain(gain=3.0)}
    return tsm.simulate(tsm.Diagram(title="d", blocks=blocks, wires=["s -> g"], outputs=outputs), stop=0.01)


@pytest.mark.parametrize("ending", [".csv", ".npz", ".mat"])
def test_results_come_back_as_they_were_written(ending, tmp_path):
    from scipy.io import loadmat

    run = two_signals(a="s", _b="g")
    path = run.save(tmp_path / f"r{ending}")
    if ending == ".csv":
        read = tsm.read(path)
        found = {"t": read.t, "a": read.signals["a"], "_b": read.signals["_b"]}
    else:
        raw = np.load(path) if ending == ".npz" else loadmat(path)
        found = {"t": raw["t"], "a": raw["a"], "_b": raw["_b" if ending == ".npz" else "x_b"]}
    for name, expected in {"t": run.t, "a": run["a"], "_b": run["_b"]}.items():
        assert np.array_equal(np.ravel(found[name]), expected)


@pytest.mark.parametrize(
    ("ending", "outputs", "names", "taken"),
    [
        (".csv", {"t": "g"}, None, "t"),
        (".npz", {"t": "g"}, None, "t"),
        (".npz", {"units": "g"}, None, "units"),
        (".npz", {"file": "g"}, None, "file"),
        (".npz", {"allow_pickle": "g"}, None, "allow_pickle"),
        (".mat", {"g_y": "s"}, ["g_y", "g.y"], "g_y"),
    ],
)
def test_no_signal_takes_the_place_of_another(ending, outputs, names, taken, tmp_path):
    from tsmblocks.common.errors import DataError

    with pytest.raises(DataError, match=f"the name '{taken}' is taken there"):
        two_signals(**outputs).save(tmp_path / f"r{ending}", names)
    assert not list(tmp_path.iterdir())


def test_a_stepper_goes_on_from_a_run_that_began_elsewhere():
    """Time goes on with the state: what depends on it is the same as in one long run."""
    d = tsm.Diagram(
        title="wave",
        blocks={"s": tsm.blocks.Sine(), "g": tsm.blocks.FirstOrderLag()},
        wires=["s -> g"],
        outputs={"y": "g"},
    )
    whole = tsm.simulate(d, start=3.0, stop=5.0, step=0.01)
    first = tsm.simulate(d, start=3.0, stop=4.0, step=0.01)
    stepper = tsm.Stepper(d, step=0.01)
    stepper.restore(first.state)
    assert stepper.t == pytest.approx(4.0)
    found = [stepper.step()["y"] for _ in range(100)]
    assert stepper.t == pytest.approx(5.0)
    assert found == pytest.approx(whole["y"][101:], abs=1e-12)


@pytest.mark.parametrize("locate", [False, True])
def test_samples_and_memory_act_once_where_a_run_is_gone_on_with(locate):
    """At the last instant of a run samples show what they become; who goes on from there lets them act, once."""
    d = tsm.Diagram(
        title="counts",
        blocks={
            "s": Ramp(),
            "sum": DiscreteIntegrator(period=0.1),
            "late": UnitDelay(period=0.1),
            "i": Integrator(),
            "gap": Play(half_width=0.05),
        },
        wires=["s -> sum, late, gap", "late -> i"],
        outputs={"sum": "sum", "i": "i", "late": "late", "gap": "gap"},
    )
    whole = tsm.simulate(d, stop=2.0, step=0.05, locate=locate)
    first = tsm.simulate(d, stop=1.0, step=0.05, locate=locate)
    stepper = tsm.Stepper(d, step=0.05)
    stepper.restore(first.state)
    for k in range(21, 41):
        found = stepper.step()
        for name in d.outputs:
            assert found[name] == pytest.approx(whole[name][k], abs=1e-12)
            assert first[name][-1] == pytest.approx(whole[name][20], abs=1e-12)


@pytest.mark.parametrize("locate", [False, True])
@pytest.mark.parametrize("every", [1, 3])
def test_a_run_goes_on_from_another(every, locate):
    """Time, samples, memory, noise, inputs and the instants that are kept go on as in one run."""
    blocks = {
        "s": Sine(frequency=0.5),
        "noise": SensorNoise(interval=0.05),
        "z": MovingAverage(period=0.15),
        "gap": Play(half_width=0.05),
        "add": Sum(signs="++"),
        "i": FirstOrderLag(time_constant=0.3),
    }
    late = {} if locate else {"late": Delay(time=0.37)}
    d = tsm.Diagram(
        title="goes on",
        blocks={**blocks, **late},
        inputs={"u": "add.plus2"},
        outputs={"y": "i", "z": "z"},
        wires=["s -> noise -> z -> gap -> add.plus1", f"add {'-> late' if late else ''} -> i"],
    )
    t = 0.05 * np.arange(81)
    how = dict(inputs={"u": (t, np.cos(t))}, step=0.05, every=every, locate=locate)
    whole = tsm.simulate(d, start=1.0, stop=4.0, **how)
    first = tsm.simulate(d, start=1.0, stop=2.5, **how)
    states = first.state, pickle.loads(pickle.dumps(first.state))
    for second in [tsm.simulate(d, stop=4.0, initial=state, **how) for state in states]:
        assert second.t == pytest.approx(whole.t[-len(second.t) :], abs=1e-12)
        assert second.t[0] == pytest.approx(2.5, abs=1e-12)
        for name in d.outputs:
            assert second[name] == pytest.approx(whole[name][-len(second.t) :], abs=1e-9)
    twice = tsm.simulate(d, stop=4.0, initial=tsm.simulate(d, stop=3.2, initial=first.state, **how).state, **how)
    assert twice["y"] == pytest.approx(whole["y"][-len(twice.t) :], abs=1e-9)


@pytest.mark.parametrize("typed", [0.1 - 0.2 / 3, 0.1 * (1 / 3) * (1 + 1e-12)])
def test_steps_and_starts_that_differ_by_rounding_are_the_same_where_a_run_is_gone_on_with(typed):
    """Time is counted in steps of the first run, so that all that comes is the same to the bit."""
    d = tsm.Diagram(
        title="lag",
        blocks={"g": FirstOrderLag(), "s": Sine(), "z": ZeroOrderHold(period=0.1)},
        wires=["s -> z -> g"],
        outputs={"y": "g"},
    )
    step = 0.03333333333333333
    first = tsm.simulate(d, stop=3.0, step=step)
    plain = tsm.simulate(d, stop=6.0, step=step, initial=first.state)
    second = tsm.simulate(d, start=0.3 * 10, stop=6.0, step=typed, initial=first.state)
    np.testing.assert_array_equal(second["y"], plain["y"])
    np.testing.assert_array_equal(second.t, plain.t)
    steppers = [tsm.Stepper(d, step=one, initial=first.state) for one in (step, typed)]
    for _ in range(20):
        one, other = (stepper.step()["y"] for stepper in steppers)
        assert one == other
    assert steppers[0].t == steppers[1].t


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_delays_keep_their_length_where_time_is_counted_from_1970(backend):
    """A time there is known to 2e-7 s, not to a step; recordings with such clocks are not shifted."""
    h, n = 1e-3, 60
    d = tsm.Diagram(
        title="late",
        blocks={
            "z": ZeroOrderHold(period=5 * h),
            "held": Delay(time=7 * h, initial=-1.0),
            "smooth": Delay(time=7 * h, initial=-1.0),
            "i": Integrator(),
        },
        inputs={"u": ["z", "smooth"]},
        wires=["z -> held -> i"],
        outputs={"held": "held", "smooth": "smooth", "i": "i"},
    )
    how = dict(inputs={"u": np.sin(0.1 * np.arange(n + 1))}, step=h, backend=backend)
    near = tsm.simulate(d, stop=n * h, **how)
    far = tsm.simulate(d, start=1.7e9, stop=1.7e9 + (n + 0.4) * h, **how)
    for name, tolerance in (("held", 1e-15), ("smooth", 1e-4), ("i", 1e-15)):
        np.testing.assert_allclose(far[name], near[name], rtol=0, atol=tolerance)


def test_the_instants_that_are_kept_are_those_of_one_run_also_in_parts_shorter_than_what_is_left_out():
    d = tsm.Diagram(title="lag", blocks={"g": FirstOrderLag()}, inputs={"u": "g"}, outputs={"y": "g"})
    how = dict(step=0.01, inputs={"u": 1.0}, every=50)
    whole = tsm.simulate(d, stop=1.2, **how)
    parts = [tsm.simulate(d, stop=0.1, **how)]
    for stop in 0.1 * np.arange(2, 13):
        parts.append(tsm.simulate(d, stop=stop, initial=parts[-1].state, **how))
    times, k = np.unique(np.round(np.concatenate([part.t for part in parts]), 9), return_index=True)
    assert times.tolist() == whole.t.tolist() == [0.0, 0.5, 1.0]
    assert np.concatenate([part["y"] for part in parts])[k] == pytest.approx(whole["y"], abs=1e-12)
    assert tsm.simulate(d, stop=1.2, step=0.01, inputs={"u": 1.0}, every=10**30).t.tolist() == [0.0]


@pytest.mark.parametrize("at_fault", ["a state", "an output"])
def test_no_run_goes_on_from_one_that_stopped_being_finite(at_fault):
    away = tsm.Diagram(
        title="away",
        blocks={"i": TransferFunction(num=[1.0], den=[1.0, -900.0])},
        inputs={"u": "i"},
        outputs={"y": "i"},
    )
    pole = tsm.Diagram(
        title="pole",
        blocks={"q": Divide(), "i": Integrator(), "one": Constant(value=1.0)},
        wires=["one -> q.num, i"],
        inputs={"u": "q.den"},
        outputs={"y": "q"},
    )
    d, u = (away, np.ones) if at_fault == "a state" else (pole, lambda n: np.arange(n) - n // 2)
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(d, stop=2.0, inputs={"u": u(2001)})
    state = pickle.loads(pickle.dumps(caught.value.run.state))
    for going_on in (
        lambda: tsm.simulate(d, stop=3.0, inputs={"u": 1.0}, initial=state),
        lambda: tsm.Stepper(d, initial=state),
        lambda: tsm.Stepper(d).restore(state),
    ):
        with pytest.raises(RunError, match=r"diverged at t = .* s, so there is no state to continue from"):
            going_on()


def test_a_run_goes_on_with_other_numbers_and_tells_how_far_it_is():
    d = tsm.Diagram(title="lag", blocks={"g": FirstOrderLag(time_constant=1.0)}, inputs={"u": "g"}, outputs={"y": "g"})
    warm = tsm.simulate(d, inputs={"u": 1.0}, stop=10.0)
    seen = []
    run = tsm.simulate(
        d, inputs={"u": 1.0}, stop=20.0, initial=warm.state, parameters={"g.gain": 3.0}, progress=seen.append
    )
    assert run["y"] == pytest.approx(3.0 + (warm["y"][-1] - 3.0) * np.exp(10.0 - run.t), abs=1e-9)
    assert run["y"][0] == warm["y"][-1]
    assert seen == sorted(seen)
    assert 0.0 < seen[0] < 0.5


def test_a_state_is_gone_on_from_with_the_steppers_own_numbers():
    d = tsm.Diagram(title="lag", blocks={"g": FirstOrderLag(time_constant=1.0)}, inputs={"u": "g"}, outputs={"y": "g"})
    warm = tsm.simulate(d, inputs={"u": 1.0}, stop=1.0, step=0.01)
    stepper = tsm.Stepper(d, step=0.01, parameters={"g.gain": 3.0})
    stepper.restore(warm.state)
    for _ in range(100):
        found = stepper.step({"u": 1.0})["y"]
    assert found == pytest.approx(3.0 + (warm["y"][-1] - 3.0) * np.exp(-1.0), abs=1e-9)
    other = tsm.Stepper(d, step=0.01, parameters={"g.gain": 3.0}, initial=warm.state)
    assert [other.step({"u": 1.0})["y"] for _ in range(100)][-1] == found
    assert other.t == stepper.t == pytest.approx(2.0)
    assert warm.parameters["g.gain"] == 1.0


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))], ids=["copy", "pickle"])
def test_a_copy_of_a_stepper_goes_on_by_itself(copied):
    d = tsm.Diagram(title="lag", blocks={"g": tsm.blocks.FirstOrderLag()}, inputs={"u": "g"}, outputs={"y": "g"})
    stepper = tsm.Stepper(d, step=0.01, method="heun", parameters={"g.gain": 3.0}, initial={"g.value": 0.5})
    stepper.step({"u": 1.0})
    other = copied(stepper)
    assert other.t == stepper.t
    ahead = [other.step({"u": 1.0})["y"] for _ in range(5)]
    assert stepper.t == pytest.approx(0.01)
    assert [stepper.step({"u": 1.0})["y"] for _ in range(5)] == ahead
