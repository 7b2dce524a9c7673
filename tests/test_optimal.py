"""Optimal control against closed forms, a linear programme, and the paper's plant; smoothing against what it smooths."""
# ruff: noqa: E501 - the text of a message stands on one line, as the user reads it

import signal

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.signal import cont2discrete

import tsmblocks as tsm
from tsmblocks.blocks import (
    DahlHysteresis,
    DCMotor,
    Delay,
    Derivative,
    ElasticBacklash,
    FirstOrderLag,
    Gain,
    Integrator,
    Overflow,
    Quantiser,
    Saturation,
    Sign,
    Step,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.common.errors import DataError, ParameterError, RunError
from tsmblocks.optimal.smoothing import smooth
from tsmblocks.optimal.transcription import Programme

SLOW_NEEDS = ["optimal", "blocks"]

SET1 = dict(alpha1=0.8972, alpha2=0.9487, A=-0.8745, theta=5.034, delta=0.14522)
HALF = np.deg2rad(55.0)


def line(*blocks, unit=""):
    names = [f"b{k}" for k in range(len(blocks))]
    return tsm.Diagram(
        title="line",
        blocks=dict(zip(names, blocks, strict=True)),
        wires=[" -> ".join(names)] if len(names) > 1 else [],
        inputs={"u": tsm.Inlet("b0", unit=unit)},
        outputs={"y": names[-1]},
    )


def sheath():
    return tsm.load("tendon_sheath_asymmetric").with_parameters({f"tsm.{k}": v for k, v in SET1.items()})


def triangle(t):
    """Amplitude 1, period 4 s, from zero upwards: slope 1."""
    return 1 - np.abs((t + 1) % 4 - 2)


# ---- kinks rounded off


def kinked():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    low = ca.if_else(x < y, x, 2 * y)
    parts = [ca.fabs(x), ca.sign(x - y), ca.fmin(x, ca.fmax(y, 0.5)), low, ca.fabs(ca.fabs(x) - y) * ca.tanh(y), x / y]
    return ca.Function("f", [x, y], [ca.vertcat(*parts)], ["x", "y"], ["f"])


@settings(max_examples=200, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3))
def test_rounding_off_little_changes_little(x, y):
    f = kinked()
    soft = smooth(f)
    near = min(abs(float(v)) for v in np.asarray(soft.kinks(x, y)).ravel())
    if near < 1e-3 or abs(y) < 1e-3:
        return
    exact, rounded = np.asarray(f(x, y)), np.asarray(soft.function(x, y, np.full(soft.count, 1e-6 * near)))
    assert rounded == pytest.approx(exact, abs=1e-5, rel=1e-5)


def test_choices_are_rounded_too():
    x = ca.SX.sym("x")
    either = ca.if_else(ca.logic_or(x < -1, ca.logic_and(x > 0, ca.logic_not(x > 2))), x, -x)
    f = ca.Function("f", [x], [either], ["x"], ["f"])
    soft = smooth(f)
    for z in (-3.0, -0.5, 0.5, 3.0):
        assert float(soft.function(z, np.full(soft.count, 1e-6))) == pytest.approx(float(f(z)), abs=1e-5)
    assert abs(float(soft.function(2.0, np.full(soft.count, 0.1)))) < 1e-2  # half way between both


def test_kinks_are_told_and_rounded():
    soft = smooth(kinked())
    assert soft.count == 6  # |x|, sign, min, max, <, and | |x| - y |: the |x| inside it is the first
    ends = [float(soft.function(z, 2.0, np.full(soft.count, 0.1))[0]) for z in (-1e-3, 0.0, 1e-3)]
    assert ends[0] == ends[2]
    assert abs(ends[0] - ends[1]) < 1e-5
    assert float(soft.function(0.0, 2.0, np.zeros(soft.count))[0]) == 0.0


# ---- closed forms


@pytest.mark.parametrize("pace", [0.25, 0.5, 0.8])
def test_a_triangle_steeper_than_the_command_may_be(pace):
    """The best command is the triangle made flatter: the error has its corners where the reference has them."""
    t = np.linspace(0.0, 4.0, 81)
    found = tsm.optimal_control(
        line(Gain()),
        {"u": (None, None)},
        "r - y",
        rates={"u": (-pace, pace)},
        references={"r": (t, triangle(t))},
        step=0.05,
        periodic=True,
    )
    assert found.found
    assert found.peak == pytest.approx(1 - pace, rel=1e-4)
    assert np.abs(np.diff(found.commands["u"])).max() <= pace * 0.05 * (1 + 1e-6)


def test_an_integrator_that_cannot_keep_up():
    """A ramp of slope 2 followed at speed 1 at most: the error at the end is the time."""
    t = np.linspace(0.0, 2.0, 41)
    for smallest in ("peak", "rms"):
        found = tsm.optimal_control(
            line(Integrator()),
            {"u": (-1.0, 1.0)},
            "r - y",
            smallest=smallest,
            step=0.05,
            references={"r": (t, 2 * t)},
            guess={"u": np.linspace(1, 0, 41)},
        )
        assert found.found
        assert found.error[-1] == pytest.approx(2.0, rel=1e-6)
        assert found.commands["u"] == pytest.approx(np.ones(41), abs=1e-4)
    assert found.rms == pytest.approx(2 / np.sqrt(3), rel=2e-2)


def test_the_smallest_peak_of_a_linear_plant_is_that_of_a_linear_programme():
    T, h, count = 0.3, 0.1, 40
    t = h * np.arange(count + 1)
    r = np.sin(2.0 * t) + 0.5 * np.sign(np.sin(1.3 * t))
    a, b, c, d, _ = cont2discrete((np.array([[-1 / T]]), np.array([[1 / T]]), np.eye(1), np.zeros((1, 1))), h, "foh")
    # scipy's form of a held ramp has its own state z: y = c z + d u
    z = np.zeros((count + 1, count + 1))
    z[0] = -float(d[0, 0]) * np.eye(count + 1)[0]  # y(0) = 0
    for k in range(count):
        z[k + 1] = float(a[0, 0]) * z[k] + float(b[0, 0]) * np.eye(count + 1)[k]
    y = float(c[0, 0]) * z + float(d[0, 0]) * np.eye(count + 1)
    one = np.ones((count + 1, 1))
    best = linprog(
        np.append(np.zeros(count + 1), 1.0),
        np.block([[y, -one], [-y, -one]]),
        np.concatenate([r, -r]),
        np.append(np.eye(count + 1)[:1], [[0.0]], axis=1),
        [0.0],
        [(-1.2, 1.2)] * (count + 1) + [(0, None)],
    )
    found = tsm.optimal_control(
        line(FirstOrderLag(time_constant=T)), {"u": (-1.2, 1.2)}, "r - y", step=h, pieces=1, references={"r": (t, r)}
    )
    assert best.success
    assert best.fun * (1 - 1e-4) < found.peak < best.fun * 1.011  # of all within 1 % of it, the calmest
    again = tsm.simulate(line(FirstOrderLag(time_constant=T)), inputs=found.inputs(), step=h / 50, stop=t[-1])
    assert np.abs(r - again["y"][::50]).max() == pytest.approx(found.peak, rel=1e-3)


@pytest.mark.parametrize("scale", [1e-7, 1e6])
def test_the_user_s_units_change_nothing(scale):
    t = np.linspace(0.0, 2.0, 41)
    made = []
    for gain, size in ((1.0, 1.0), (scale, scale), (1.0 / scale, 1.0)):  # as it is, small outputs, large commands
        plant = line(Gain(gain=gain), FirstOrderLag(time_constant=0.3))
        most = 1.2 * size / gain
        found = tsm.optimal_control(
            plant, {"u": (-most, most)}, "r - y", references={"r": (t, size * np.sin(3 * t))}, step=0.05
        )
        assert found.found
        made.append(found.peak / size)
    assert made == pytest.approx([made[0]] * 3, rel=1e-2)


# ---- the paper's plant


@pytest.fixture(scope="module")
def best():
    t = np.linspace(0.0, 5.0, 501)
    reference = HALF * np.sin(0.4 * np.pi * t)
    return tsm.optimal_control(
        sheath(),
        {"x_in": (None, None)},
        "x_ref - x_out",
        rates={"x_in": (-3.0, 3.0)},
        references={"x_ref": (t, reference)},
        step=0.01,
        periodic=True,
        guess={"x_in": 1.25 * reference},
    )


def test_the_best_feedforward_of_the_paper_s_plant(best):
    """Direct transcription by other hands, 500 points, IPOPT: 0.94 deg peak to peak at 3 rad/s."""
    assert best.found
    assert np.rad2deg(best.peak_to_peak) < 0.93
    assert np.rad2deg(best.rms) < 0.15
    assert np.abs(np.diff(best.commands["x_in"])).max() <= 3.0 * 0.01 * (1 + 1e-6)
    assert str(best).startswith(
        "Tendon sheath: the proposed asymmetric model and an offset: smallest peak of the error found: peak to peak 0.9"
    )


def test_its_commands_do_the_same_in_a_plain_simulation(best):
    run = tsm.simulate(sheath(), inputs=best.inputs(20.0), stop=20.0, step=1e-3)
    error = (HALF * np.sin(0.4 * np.pi * run.t) - run["x_out"])[run.t >= 10.0]
    assert np.ptp(error) == pytest.approx(best.peak_to_peak, rel=0.02)
    period = best.inputs(20.0)["x_in"].y
    assert period[500:1001] == pytest.approx(period[:501], abs=1e-9)
    assert best.run["x_out"][0] == pytest.approx(best.run["x_out"][-1], abs=1e-3)


def test_limits_on_signals_hold_at_every_sample():
    motor = tsm.load("motor_linear")
    t = np.linspace(0.0, 1.0, 51)
    how = dict(references={"r": (t, np.sin(2 * np.pi * t) ** 2)}, step=0.02, pieces=6)
    free = tsm.optimal_control(motor, {"u": (-24.0, 24.0)}, "r - x", **how)
    held = tsm.optimal_control(
        motor, {"u": (-24.0, 24.0)}, "r - x", limits=["motor.v <= 1.5", "-1.5 <= motor.v"], **how
    )
    assert np.abs(free.run["motor.v"]).max() > 2.5
    assert held.found
    assert held.missed < 0.05  # between the instants that the search looks at
    assert np.abs(held.run["motor.v"][::4]).max() <= 1.5 * (1 + 1e-5)
    assert held.peak > 2 * free.peak


def test_a_limiter_in_the_plant_is_passed_over():
    """The search begins beyond the limit, where a command changes nothing, and the error asks for it to come back."""
    t = np.linspace(0.0, 2.0, 41)
    plant = line(Saturation(low=-1.0, high=1.0), FirstOrderLag(time_constant=0.2))
    found = tsm.optimal_control(
        plant,
        {"u": (-5.0, 5.0)},
        "r - y",
        smallest="rms",
        step=0.05,
        references={"r": (t, 0.5 * (1 - np.exp(-t / 0.2)))},
        guess={"u": np.full(41, 1.5)},
    )
    assert found.rms < 0.03


def test_a_rim_that_is_never_reached_leaves_nothing_to_round_off():
    """A difference from infinity bends nowhere; rounded off, it would be no number."""
    t = np.linspace(0.0, 1.0, 51)
    vessel = tsm.Diagram(
        title="vessel",
        blocks={"rim": Overflow(), "level": FirstOrderLag(time_constant=0.2)},
        wires=["rim.y -> level", "level -> rim.x"],
        inputs={"u": "rim.u"},
        outputs={"y": "level"},
    )
    wanted = 0.5 * (1 - np.exp(-t / 0.2))  # the answer of the lag to a step of 0.5
    found = tsm.optimal_control(
        vessel,
        {"u": (-5.0, 5.0)},
        "r - y",
        smallest="rms",
        step=0.02,
        references={"r": (t, wanted)},
        guess={"u": np.full(51, 0.5)},
    )
    assert found.rms < 1e-4
    assert np.abs(found.commands["u"][:40] - 0.5).max() < 0.01


# ---- sample by sample


def test_with_a_short_preview_nearly_as_good(best):
    t = np.arange(0.0, 6.0 + 0.5 + 1e-9, 0.02)
    found = tsm.receding_horizon(
        sheath(),
        {"x_in": (None, None)},
        "x_ref - x_out",
        rates={"x_in": (-3.0, 3.0)},
        references={"x_ref": (t, HALF * np.sin(0.4 * np.pi * t))},
        preview=25,
        step=0.02,
        smallest="peak",
        stop=6.0,
    )
    late = found.error.reshape(300, -1)[50:]
    assert best.peak_to_peak < np.ptp(late) < np.deg2rad(2.0)
    assert found.seconds.shape == (300,)
    assert found.seconds.min() > 0
    run = tsm.simulate(sheath(), inputs=found.inputs(), stop=6.0, step=1e-3)
    error = (HALF * np.sin(0.4 * np.pi * run.t) - run["x_out"])[run.t >= 1.0]
    assert np.ptp(error) == pytest.approx(np.ptp(late), rel=0.05)


def test_by_hand_it_is_the_same_sample_by_sample():
    t = np.linspace(0.0, 2.0, 41)
    r, how = np.sin(2 * t), dict(preview=8, rates={"u": (-1.0, 1.0)}, step=0.05)
    plant = line(FirstOrderLag(time_constant=0.2))
    whole = tsm.receding_horizon(plant, {"u": (-2.0, 2.0)}, "r - y", references={"r": (t, r)}, **how)
    control = tsm.RecedingHorizon(plant, {"u": (-2.0, 2.0)}, "r - y", references=["r"], **how)
    made = [0.0] + [control.next({"r": r[k : k + 9]})["u"] for k in range(32)]
    assert made == pytest.approx(whole.commands["u"], abs=1e-9)
    assert control.t == pytest.approx(1.6)
    assert control.missed == 0
    assert len(control.seconds) == 32


def test_a_state_that_is_measured_counts():
    control = tsm.RecedingHorizon(
        line(Integrator()), {"u": (-1.0, 1.0)}, "r - y", references=["r"], preview=5, step=0.1
    )
    assert abs(control.next({"r": 0.0})["u"]) < 1e-6
    assert control.next({"r": 0.0}, state={"b0.integral": 0.5})["u"] == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("block", [DahlHysteresis(), ElasticBacklash()])
def test_a_plan_does_not_get_stuck_at_standing_still(block):
    """Hysteresis makes standing still a place that no small change betters; another begin leads out of it."""
    t = 0.05 * np.arange(60)
    found = tsm.receding_horizon(
        line(block, unit="rad"),
        {"u": (-3.0, 3.0)},
        "r - y",
        preview=10,
        step=0.05,
        stop=2.4,
        references={"r": (t, np.sin(3 * t))},
    )
    assert found.peak < 0.12


# ---- told as it is


def lagged(**more):
    t = np.linspace(0.0, 1.0, 11)
    how = dict(references={"r": (t, np.sin(6 * t))}, step=0.1, smallest="rms") | more
    return tsm.optimal_control(line(FirstOrderLag(time_constant=0.2)), {"u": (-5.0, 5.0)}, "r - y", **how)


@pytest.mark.parametrize("hold", ["zero", "linear", "cubic"])
def test_commands_are_linear_between_samples_whatever_holds_for_the_rest(hold):
    found = lagged(hold=hold)
    run = tsm.simulate(line(FirstOrderLag(time_constant=0.2)), inputs=found.inputs(), stop=1.0, step=0.005, hold="zero")
    assert np.interp(found.run.t, run.t, run["y"]) == pytest.approx(found.run["y"], abs=1e-3)
    assert found.inputs(0.5)["u"].t[-1] == pytest.approx(0.5)
    assert found.inputs(1.5)["u"].y[-1] == found.commands["u"][-1]


@pytest.mark.parametrize("stop", [1.0, pytest.param(2.0, marks=pytest.mark.slow)])
def test_a_limit_that_the_equations_miss_is_told(stop):
    """With the sign rounded off the limit is kept; as it is, it cannot be."""
    t = np.linspace(0.0, stop, round(stop / 0.05) + 1)
    found = tsm.optimal_control(
        line(Sign(), FirstOrderLag(time_constant=0.2)),
        {"u": (-1.0, 1.0)},
        "r - y",
        references={"r": (t, 0.7 * np.sin(3 * t))},
        step=0.05,
        smallest="rms",
        limits="abs(y) <= 0.3",
    )
    assert not found.found
    assert found.missed > 0.05
    assert "(not the end of the search: " in str(found)


def test_a_source_that_jumps_is_seen_from_both_sides():
    """Half a volt at one instant: no command does better than half of it."""
    jump = tsm.Diagram(
        title="jump",
        blocks={"a": FirstOrderLag(time_constant=0.1), "d": Step(time=1.0, after=0.5), "s": Sum()},
        wires=["a -> s.plus", "d -> s.minus"],
        inputs={"u": tsm.Inlet("a")},
        outputs={"y": "s"},
    )
    found = tsm.optimal_control(jump, {"u": (-5.0, 5.0)}, "y", stop=2.0, step=0.05)
    assert found.peak == pytest.approx(0.25, rel=0.05)


def test_times_before_zero():
    t = np.linspace(-2.0, -1.0, 11)
    found = lagged(references={"r": (t, t)}, start=-2.0)
    assert found.inputs()["u"].t == pytest.approx(t)


def test_a_unit_is_that_of_a_difference_only():
    t = np.linspace(0.0, 0.5, 6)
    how = dict(commands={"x_in": (-1.0, 1.0)}, references={"r": (t, 0.1 * t)}, step=0.1, smallest="rms")
    assert tsm.optimal_control(sheath(), error="r - x_out", **how).unit == "rad"
    assert tsm.optimal_control(sheath(), error="1000*(r - x_out)**2", **how).unit == ""


def test_ctrl_c_ends_with_the_best_so_far():
    told = []

    def press(*stage):
        told.append(stage)
        if len(told) == 2:
            signal.raise_signal(signal.SIGINT)

    found = lagged(progress=press)
    assert not found.found
    assert found.word == "interrupted"
    t, told[:] = np.arange(0.0, 3.0, 0.05), []
    found = tsm.receding_horizon(
        line(FirstOrderLag(time_constant=0.2)),
        {"u": (-2, 2)},
        "r - y",
        preview=5,
        step=0.05,
        references={"r": (t, np.sin(t))},
        progress=press,
    )
    assert found.word == "interrupted after 2 samples"
    assert found.run.t[-1] == pytest.approx(0.1)


# ---- what cannot be asked


def asked(diagram=None, commands=None, error="r - y", **more):
    t = np.linspace(0.0, 1.0, 11)
    how = dict(references={"r": (t, t)}, step=0.1) | more
    return tsm.optimal_control(diagram or line(Gain()), {"u": (-1, 1)} if commands is None else commands, error, **how)


MISTAKES = {
    "no diagram": (
        lambda: asked("fig09"),
        RunError,
        "only a diagram can be run, got 'fig09'. Load it first: tsmblocks.load('fig09').",
    ),
    "no commands": (
        lambda: asked(commands={}),
        RunError,
        "name at least one input of the diagram as a command, with its limits: commands={'u': (-24, 24)}.",
    ),
    "commands as a list": (
        lambda: asked(commands=["u"]),
        ParameterError,
        "commands must map inputs to (low, high), got ['u'].",
    ),
    "unknown command": (
        lambda: asked(commands={"v": (0, 1)}),
        ParameterError,
        "commands: 'line' has no input 'v'. Known here: u.",
    ),
    "one limit": (
        lambda: asked(commands={"u": 3.0}),
        ParameterError,
        "commands of 'u' must be a pair (low, high), None for no limit, got 3.",
    ),
    "limits the wrong way": (
        lambda: asked(commands={"u": (1, -1)}),
        ParameterError,
        "commands of 'u': the lower limit must be below the upper one, got (1, -1).",
    ),
    "limit that is no number": (
        lambda: asked(commands={"u": (0, "a")}),
        ParameterError,
        "commands of 'u' must be a finite number, got 'a'.",
    ),
    "rate of no command": (
        lambda: asked(rates={"x": (0, 1)}),
        ParameterError,
        "rates: 'line' has no command 'x'. Known here: u.",
    ),
    "unknown signal": (lambda: asked(error="r - z"), ParameterError, "there is no signal 'z'"),
    "goal": (
        lambda: asked(smallest="peaks"),
        ParameterError,
        "smallest is 'peak' or 'rms', got 'peaks'. Did you mean 'peak'?",
    ),
    "reference that is a signal": (
        lambda: asked(references={"y": (np.arange(2.0), np.zeros(2))}),
        ParameterError,
        "references give 'y', which is a signal of 'line' already.",
    ),
    "no end": (
        lambda: asked(references={"r": 1.0}),
        RunError,
        "the end is not known: give stop=… [s], or references as (times, values).",
    ),
    "stop between samples": (
        lambda: asked(stop=0.95),
        RunError,
        "stop=0.95 s is no whole number of steps of 0.1 s after start=0 s.",
    ),
    "reference too short": (
        lambda: asked(stop=2.0),
        DataError,
        "input 'r' is known from 0 to 1 s, but the run goes from 0 to 2 s. Shorten the run, or give more samples.",
    ),
    "guess of another": (
        lambda: asked(guess={"v": np.zeros(11)}),
        ParameterError,
        "guess: there is no command 'v'. Known here: u.",
    ),
    "guess too short": (
        lambda: asked(guess={"u": np.zeros(7)}),
        ParameterError,
        "guess of 'u' must be 11 finite numbers, one for each sample, or a pair (times, values) with times that increase.",
    ),
    "sampled": (
        lambda: asked(line(ZeroOrderHold(period=0.1))),
        RunError,
        "'line' has a part that changes in jumps (b0); optimal control needs states that change smoothly. Replace it by a continuous block.",
    ),
    "delay": (
        lambda: asked(line(Delay(time=0.1))),
        RunError,
        "'line' delays b0.past, which optimal control does not support. Remove the delay, and give the references earlier by the same time.",
    ),
    "pieces": (lambda: asked(pieces=0), RunError, "pieces must be a whole number of at least 1, got 0."),
    "missing reference": (
        lambda: tsm.RecedingHorizon(line(Gain()), {"u": (-1, 1)}, "r - y", references=["r"], preview=3).next({}),
        DataError,
        "the references are r, and r is not given.",
    ),
    "preview of another length": (
        lambda: tsm.RecedingHorizon(line(Gain()), {"u": (-1, 1)}, "r - y", references=["r"], preview=3).next(
            {"r": np.zeros(3)}
        ),
        DataError,
        "'r' must be a number or 4 samples, one for now and one for each sample of the preview; got shape (3,).",
    ),
    "rounds": (
        lambda: asked(line(Quantiser(interval=0.1))),
        RunError,
        "'line' rounds a signal to steps, and a gradient is zero between them. Remove the block that rounds from the model.",
    ),
    "two derivatives": (
        lambda: asked(line(Derivative(), Derivative())),
        RunError,
        "'line' needs the second derivative of 'u', and a command that is linear between its samples has none. Put a lag or an integrator behind it.",
    ),
    "command as input": (
        lambda: asked(inputs={"u": 0.3}),
        DataError,
        "'u' is a command of 'line'; it cannot be given as an input too.",
    ),
    "references as a list": (
        lambda: asked(references=["r"]),
        DataError,
        "references must map names to signals, such as {'x_ref': (t, values)}, got ['r'].",
    ),
    "progress": (
        lambda: asked(progress=True),
        RunError,
        "progress must be a function of stage, done and of, got True.",
    ),
    "periodic": (lambda: asked(periodic="no"), RunError, "periodic must be True or False, got 'no'."),
    "guess as a list": (
        lambda: asked(guess=[0.0] * 11),
        ParameterError,
        "guess must map commands to samples, got [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].",
    ),
    "guess of words": (
        lambda: asked(guess={"u": ["a"] * 11}),
        ParameterError,
        "guess of 'u' must be 11 finite numbers, one for each sample, or a pair (times, values) with times that increase.",
    ),
    "limit of no signal": (lambda: asked(limits="z <= 1"), ParameterError, "there is no signal 'z'"),
    "equality": (
        lambda: asked(limits="y == 0.5"),
        ParameterError,
        "limit 'y == 0.5': an equality at every instant determines the commands. Make it the error, or write two limits.",
    ),
    "limit that is met": (
        lambda: asked(limits="1 <= 2"),
        ParameterError,
        "this is always true, for any values of the signals.",
    ),
    "limits that cannot be kept": (
        lambda: asked(line(FirstOrderLag()), limits="y >= 2"),
        RunError,
        "no commands were found that keep all limits (Infeasible_Problem_Detected). Loosen limits, ranges or rates, allow more iterations, or give a guess that keeps them.",
    ),
    "references of a controller": (
        lambda: tsm.RecedingHorizon(line(Gain()), {"u": (-1, 1)}, "r - y", references=5),
        ParameterError,
        "references takes names such as 'x_ref', got 5.",
    ),
    "short references": (
        lambda: tsm.receding_horizon(
            line(Gain()), {"u": (-1, 1)}, "r - y", references={"r": (np.arange(3.0), np.zeros(3))}, step=0.2, preview=20
        ),
        RunError,
        "the known signals end at 2 s, which is less than one sample and a preview of 20 samples of 0.2 s. Give longer signals, or a shorter preview.",
    ),
    "state as a list": (
        lambda: tsm.RecedingHorizon(line(Integrator()), {"u": (-1, 1)}, "r - y", references="r", preview=3).next(
            {"r": 0.0}, state=[1.0]
        ),
        DataError,
        "state must map names of states to numbers, got [1.0].",
    ),
    "unknown state": (
        lambda: tsm.RecedingHorizon(line(Integrator()), {"u": (-1, 1)}, "r - y", references=["r"], preview=3).next(
            {"r": 0.0}, state={"b0.integra": 1.0}
        ),
        DataError,
        "'line' has no state 'b0.integra'. Did you mean 'b0.integral'?",
    ),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_told(what):
    do, kind, told = MISTAKES[what]
    with pytest.raises(kind) as found:
        do()
    assert str(found.value).endswith(told) or told in str(found.value)


def test_commands_before_their_start_are_refused(best):
    with pytest.raises(RunError, match="the commands start at 0 s, so they cannot stop at -1 s"):
        best.inputs(-1.0)


def test_the_current_of_a_motor_is_kept_within_its_limit():
    """Voltage, current and speed: the motor as an electrical and mechanical model, its winding faster than a sample."""
    motor = tsm.Diagram(
        title="motor",
        blocks={"motor": DCMotor(L=0.005)},
        inputs={"u": tsm.Inlet("motor.u", unit="V")},
        outputs={"x": "motor.y", "i": "motor.i", "v": "motor.v"},
    )
    t = np.linspace(0.0, 0.4, 21)
    how = dict(smallest="rms", references={"r": (t, np.sin(np.pi * t / 0.8) ** 2)}, step=0.02)
    free = tsm.optimal_control(motor, {"u": (-24.0, 24.0)}, "r - x", **how)
    limits = ["i <= 0.04", "i >= -0.04", "v <= 3.0"]
    held = tsm.optimal_control(motor, {"u": (-24.0, 24.0)}, "r - x", limits=limits, **how)
    assert free.found
    assert held.found
    assert np.abs(free.run["i"]).max() > 0.05
    assert np.abs(held.run["i"]).max() < 0.0404
    assert held.run["v"].max() < 3.001
    assert held.rms > free.rms


def test_an_error_that_can_vanish_is_found_at_once(monkeypatch):
    """What rounding leaves of an error is no size to count in, and no peak to make smaller."""
    ends, solve = [], Programme.solve

    def noted(self, *how):
        made = solve(self, *how)
        ends.append((self.goal, made.word))
        return made

    monkeypatch.setattr(Programme, "solve", noted)
    t = np.linspace(0.0, 1.0, 51)
    found = tsm.optimal_control(
        line(Gain(gain=2.0)), {"u": (-5, 5)}, "r - y", references={"r": (t, np.sin(t))}, step=0.02
    )
    assert found.peak < 1e-9
    assert set(ends) == {("rms", "Solve_Succeeded")}
