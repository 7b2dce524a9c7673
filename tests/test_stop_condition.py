"""Resets and stop conditions located within the step, against closed forms and SciPy at tight tolerance."""

import json
import math

import attrs
import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tsmblocks.block import Block, Output, block, parameter, state

import tsmblocks as tsm
from tsmblocks.blocks import Delay, FirstOrderLag, Gain, Integrator, Ramp, Relay, Sine, ZeroOrderHold
from tsmblocks.cli.entry import main
from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.engine.events import SlidingWarning
from tsmblocks.simulation.stop_condition import IgnoredConditionWarning

G = 9.81


@block(register=False)
class Ball(Block):
    """A ball that falls, with drag, and leaves the ground with a share of its speed."""

    source, symbol = "mechanics", "ball"
    e: float = parameter(default=0.8, about="share of the speed kept at the ground")
    drag: float = parameter(default=0.0, about="quadratic drag")
    y = Output("height")
    h: float = state(default=1.0, about="height")
    v: float = state(default=0.0, about="speed")

    def derivatives(self, t, x, u):
        return dict(h=x.v, v=-G - self.drag * x.v * ca.fabs(x.v))

    def updates(self, t, x, u):
        down = ca.logic_and(x.h <= 0, x.v < 0)
        return dict(h=ca.if_else(down, 0.0, x.h), v=ca.if_else(down, -self.e * x.v, x.v))

    def outputs(self, t, x, u):
        return dict(y=x.h)


def ball(**numbers):
    return tsm.Diagram(title="ball", blocks={"b": Ball(**numbers)}, wires=[], outputs={"y": "b"})


def bounced(t, e):
    """Height in closed form."""
    speed = math.sqrt(2 * G)
    impacts, speeds = [speed / G], [e * speed]
    while impacts[-1] < t[-1]:
        impacts.append(impacts[-1] + 2 * speeds[-1] / G)
        speeds.append(e * speeds[-1])
    k = np.searchsorted(impacts, t, side="right") - 1
    since, v = t - np.array(impacts)[k], np.array(speeds)[k]
    return np.where(k < 0, 1 - G * t**2 / 2, v * since - G * since**2 / 2)


@pytest.mark.parametrize("step", [0.01, 0.013])
def test_a_bouncing_ball_is_located(step):
    run = tsm.simulate(ball(e=0.9), stop=6.0, step=step, locate=True)
    assert np.abs(run["y"] - bounced(run.t, 0.9)).max() < 1e-10
    plain = tsm.simulate(ball(e=0.9), stop=6.0, step=step)
    assert np.abs(plain["y"] - bounced(plain.t, 0.9)).max() > 0.1  # resets on the grid only
    assert {event.block for event in run.events} == {"b"}


def test_order_four_across_resets():
    """With drag nothing is a polynomial: every flight is integrated by SciPy from impact to impact."""
    e, c, end = 0.8, 0.4, 2.0

    def fall(_, x):
        return [x[1], -G - c * x[1] * abs(x[1])]

    def ground(_, x):
        return x[0] if x[1] < 0 else 1.0

    ground.terminal, ground.direction = True, -1
    t, x, flights = 0.0, [1.0, 0.0], []
    while t < end:
        made = solve_ivp(fall, (t, end), x, rtol=1e-13, atol=1e-14, events=ground, dense_output=True, method="DOP853")
        flights.append(made)
        t, x = made.t[-1], [0.0, -e * made.y[1, -1]]

    def exact(instants):
        of = np.searchsorted([one.t[-1] for one in flights[:-1]], instants)
        return np.array([flights[k].sol(s)[0] for k, s in zip(of, instants, strict=True)])

    errors = []
    for step in (0.04, 0.02, 0.01):
        run = tsm.simulate(ball(e=e, drag=c), stop=end, step=step, locate=True)
        errors.append(np.abs(run["y"] - exact(run.t)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-7
    assert orders.min() > 3.5


def test_a_thousand_bounces_keep_the_energy():
    run = tsm.simulate(ball(e=1.0), stop=903.0, step=0.02, locate=True)
    energy = G * run["y"] + 0.5 * run["b.v"] ** 2
    assert sum(event.switch == "<=" for event in run.events) >= 1000
    assert np.abs(energy / G - 1).max() < 1e-8
    assert np.abs(run["y"] - bounced(run.t, 1.0)).max() < 1e-6


def test_bounces_without_end_say_so():
    with pytest.warns(SlidingWarning, match="follow each other ever faster"):
        run = tsm.simulate(ball(e=0.5), stop=2.0, step=0.01, locate=True)
    assert np.abs(run["y"][run.t > 1.5]).max() < 0.01


def test_an_integrator_is_reset_at_the_instant():
    """A sawtooth: reset by a sine that passes 0.5, at instants that are known."""
    blocks = {"w": Sine(amplitude=1.0, frequency=0.7), "one": Gain(gain=1.0), "i": tsm.blocks.Integrator(reset=True)}
    wires = ["w -> i.reset", "c -> i.u"]
    blocks = {"w": blocks["w"], "c": tsm.blocks.Constant(value=1.0), "i": blocks["i"]}
    d = tsm.Diagram(title="saw", blocks=blocks, wires=wires, outputs={"y": "i"})
    run = tsm.simulate(d, stop=5.0, step=0.01, locate=True)
    rise = [(math.asin(0.5) + 2 * math.pi * k) / (2 * math.pi * 0.7) for k in range(4)]
    for first, following in zip(rise, [*rise[1:], 10.0], strict=True):
        k = np.flatnonzero((run.t > first + 0.6 / 0.7) & (run.t < min(following, 5.0)))  # the sine is below 0.5 again
        assert len(k) > 5 or following > 5.0
    after = (run.t > rise[0] + 0.01) & (run.t < rise[0] + 0.3)
    assert np.abs(run["y"][after]).max() < 0.011  # held at its start while the signal is above


# ---- stop conditions ---------------------------------------------------------------------------------


def motor_instant(x):
    """When a motor under 12 V reaches an angle."""
    K, tau = 2.0 * 12.0, 0.02
    return brentq(lambda t: K * (t - tau * (1 - math.exp(-t / tau))) - x, 0.0, 1.0, xtol=1e-15)


def motor_run(**more):
    return tsm.simulate(tsm.load("motor_linear"), inputs={"u": 12.0}, **more)


@pytest.mark.parametrize("backend", ["", "casadi"])
@pytest.mark.parametrize("every", [1, 7])
def test_a_run_ends_where_its_condition_becomes_true(every, backend):
    run = motor_run(stop_when="x > 1", step=0.002, every=every, backend=backend)
    assert run.ended_by == "x > 1"
    assert run.complete
    assert run.t[-1] == pytest.approx(motor_instant(1.0), abs=1e-8)
    assert run["x"][-1] == pytest.approx(1.0, abs=1e-12)
    whole = motor_run(stop=0.1, step=0.002, every=every, backend=backend)
    assert np.array_equal(run["x"][:-1], whole["x"][: len(run.t) - 1])
    assert whole.ended_by == ""


def test_the_end_has_the_order_of_the_method():
    errors = [abs(motor_run(stop_when="x > 1", step=h).t[-1] - motor_instant(1.0)) for h in (0.01, 0.005, 0.0025)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 3.3


def test_conditions_are_joined_and_late_ones_are_found():
    run = motor_run(stop_when="x > 50 and motor.speed > 0 or x < -1", step=1e-3)
    assert run["x"][-1] == pytest.approx(50.0, abs=1e-9)
    assert len(run.t) > 2000
    assert motor_run(stop_when="x > 1e9", stop=0.5, step=1e-3).ended_by == ""


def test_a_run_goes_on_from_where_it_ended():
    first = motor_run(stop_when="x > 1", step=1e-3)
    rest = tsm.simulate(tsm.load("motor_linear"), inputs={"u": 12.0}, initial=first.state, stop=0.5, step=1e-3)
    whole = motor_run(stop=0.5, step=1e-3)
    assert rest.t[0] == first.t[-1]
    assert rest["x"][-1] == pytest.approx(np.interp(rest.t[-1], whole.t, whole["x"]), abs=1e-6)


def test_a_jump_ends_a_run_at_its_instant():
    d = tsm.Diagram(
        title="jump",
        blocks={"s": tsm.blocks.Step(time=0.1234, after=2.0), "lag": FirstOrderLag()},
        wires=["s -> lag"],
        outputs={"s": "s", "y": "lag"},
    )
    assert tsm.simulate(d, stop_when="s > 1", step=0.01).t[-1] == pytest.approx(0.1234, abs=1e-9)


@pytest.mark.parametrize("part", [ZeroOrderHold(period=0.02), Delay(time=0.03)])
def test_samples_and_delays_end_a_run_on_the_grid(part):
    d = tsm.Diagram(title="held", blocks={"r": Ramp(slope=1.0), "p": part}, wires=["r -> p"], outputs={"y": "p"})
    run = tsm.simulate(d, stop_when="y > 0.505", step=0.01)
    whole = tsm.simulate(d, stop=1.0, step=0.01)
    k = int(np.argmax(whole["y"] > 0.505))
    assert run.t[-1] == whole.t[k]
    assert np.array_equal(run["y"], whole["y"][: k + 1])
    again = tsm.simulate(d, initial=run.state, stop=1.0, step=0.01)
    assert np.array_equal(again["y"], whole["y"][k:])


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("x < 1", RunError, "stop_when 'x < 1' holds at the start"),
        ("x + 1", ParameterError, "stop_when: a comparison is expected here"),
        ("xx > 1", ParameterError, "stop_when: there is no signal 'xx'. Did you mean 'x'"),
        ("1 > 2", ParameterError, "stop_when: this contains no signal"),
        ("x == 1", ParameterError, "stop_when: signals are compared by"),
        ("x > u", ParameterError, "stop_when: this mixes"),
        (3, RunError, "stop_when must be a text, got 3."),
    ],
)
def test_conditions_that_are_none(text, error, message):
    with pytest.raises(error) as caught:
        motor_run(stop_when=text)
    assert message in str(caught.value)


def test_a_file_and_the_command_line_end_a_run(tmp_path, capsys):
    path = tmp_path / "ramp.toml"
    path.write_text(
        'format = 1\ntitle = "ramp"\nwires = []\n[blocks]\nr = { type = "Ramp", slope = 2.0 }\n'
        '[outputs]\ny = "r"\n[simulation]\nstop_when = "y > 1"\n'
    )
    d = tsm.load(path)
    assert tsm.simulate(d, step=0.01).t[-1] == pytest.approx(0.5)
    assert tsm.simulate(d, step=0.01, stop=1.0, stop_when="").t[-1] == 1.0
    (tmp_path / "again.toml").write_text(tsm.dumps(d))
    assert tsm.load(tmp_path / "again.toml").simulation.stop_when == "y > 1"
    assert main(["run", str(path), "--step", "0.01"]) == 0
    assert "0 to 0.5 s in steps of 0.01 s (rk4)\nended where y > 1" in capsys.readouterr().out
    assert main(["run", str(path), "--step", "0.01", "--stop-when", "y > 1.5"]) == 0
    assert "0 to 0.75 s" in capsys.readouterr().out


def test_a_check_reads_the_condition_of_a_file(tmp_path, capsys):
    path = tmp_path / "ramp.toml"
    text = 'format = 1\ntitle = "r"\nwires = []\n[blocks]\nr = { type = "Ramp" }\n[simulation]\nstop_when = "r.y > 1"\n'
    path.write_text(text)
    assert main(["check", str(path)]) == 0
    path.write_text(text.replace("r.y", "r.z"))
    assert main(["check", str(path)]) == 2
    assert "ramp.toml: stop_when: there is no signal 'r.z'." in capsys.readouterr().err


def test_batches_and_sensitivities_refuse_a_condition_that_they_do_not_know():
    motor = tsm.load("motor_linear")
    ending = motor.with_simulation(attrs.evolve(motor.simulation, stop_when="x > 1"))
    options = dict(stop=0.2, step=1e-3, inputs={"u": 12.0})
    said = r"ends its runs with stop_when = 'x > 1', but a batch always runs to the end\. Remove it: diagram\.with_sim"
    with pytest.raises(RunError, match=said):
        tsm.simulate_batch(ending, {"motor.K": [1.0, 2.0]}, **options)
    with pytest.raises(RunError, match="but a run with sensitivities always runs to the end"):
        tsm.sensitivities(ending, ["motor.K"], **options)
    again = ending.with_simulation(attrs.evolve(ending.simulation, stop_when=""))
    assert tsm.simulate_batch(again, {"motor.K": [1.0]}, **options)["x"].shape == (1, 201)


@pytest.mark.parametrize("locate", [False, True])
@pytest.mark.parametrize("step", [0.1, 0.01, 0.03, 0.07])
def test_a_held_input_ends_a_run_where_it_jumps(step, locate):
    """A sample counts at the instant of the grid that it nearly meets, but not before it comes within a step."""
    d = tsm.Diagram(
        title="held",
        blocks={"g": Gain(), "lag": FirstOrderLag()},
        wires=["g -> lag"],
        inputs={"u": "g"},
        outputs={"y": "g"},
    )
    t = np.arange(11) * 0.1
    run = tsm.simulate(
        d, stop=0.9, step=step, inputs={"u": (t, 1.0 * np.arange(11))}, hold="zero", locate=locate, stop_when="y > 2.5"
    )
    assert run.t[-1] == pytest.approx(0.3, abs=1e-11 * step)
    assert run["y"][-1] == 3.0
    late = t + 0.5e-3 * step
    on_grid = round(0.3 / step) * step == pytest.approx(0.3)
    options = dict(stop=0.9, step=step, hold="zero", locate=locate, stop_when="y > 2.5")
    run = tsm.simulate(d, inputs={"u": (np.append(0.0, late[1:]), 1.0 * np.arange(11))}, **options)
    assert run.t[-1] == pytest.approx(0.3 if on_grid else late[3], abs=1e-11 * step)


def test_a_condition_of_a_diagram_inside_another_is_warned_of(recwarn):
    motor = tsm.load("motor_linear")
    alone = motor.with_simulation(attrs.evolve(motor.simulation, stop_when="x > 1"))
    held = tsm.Diagram(title="held", blocks=dict(m=alone), inputs=dict(u="m.u"), outputs=dict(x="m.x"))
    around = tsm.Diagram(title="around", blocks=dict(part=held), inputs=dict(u="part.u"), outputs=dict(x="part.x"))
    said = "diagram 'around': runs of part.m alone end with stop_when = 'x > 1', which is ignored here"
    with pytest.warns(IgnoredConditionWarning, match=said) as caught:
        assert tsm.simulate(around, inputs=dict(u=12.0), stop=0.5).t[-1] == 0.5
    assert caught[0].filename == __file__
    tsm.simulate(around, inputs=dict(u=12.0), stop=0.5, stop_when="")
    tsm.simulate(alone, inputs=dict(u=12.0), stop=0.5)
    assert not recwarn


def test_the_command_locates_switches(tmp_path, capsys):
    d = tsm.Diagram(
        title="relay",
        blocks=dict(s=Sine(amplitude=1.0, frequency=0.5), r=Relay(on=0.3, off=-0.3, high=1.0, low=0.0), i=Integrator()),
        wires=["s -> r -> i"],
        outputs=dict(y="i"),
    )
    tsm.save(d, tmp_path / "relay.toml")
    for more, error in ((["--locate"], 1e-9), ([], 0.02)):
        assert main(["run", str(tmp_path / "relay.toml"), "--stop", "1.9", "--step", "0.013", "--json", *more]) == 0
        made = json.loads(capsys.readouterr().out)
        assert abs(made["outputs"]["y"]["last"] - 1.0) < error
        assert (made.get("switches", 0) >= 2) == bool(more)
