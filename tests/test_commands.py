"""Commands: inputs that are held from sample to sample, or whose fast part drives the plant, are found from outputs."""

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import CoulombFriction, FirstOrderLag, Integrator, Sum
from tsmblocks.diagnosis import preparation
from tsmblocks.diagnosis.arguments import checked
from tsmblocks.diagnosis.commands import Commands
from tsmblocks.diagnosis.partition import partition
from tsmblocks.model.simulation import Simulation

STEP = 0.02
PLANT = """
format = 1
title = "Drive"
wires = ["lag -> gain"]
[blocks]
lag = { type = "FirstOrderLag", time_constant = 0.06 }
gain = { type = "Gain", gain = 1.5 }
[inputs]
u = { ports = "lag.u", unit = "V" }
[outputs]
y = { signal = "gain", unit = "V" }
"""


def motion(t):
    """A smooth command without any step."""
    return np.sin(2.1 * t) + 0.4 * np.sin(7.3 * t + 1.0) + 0.2 * np.sin(13.7 * t)


def recorded(u, *, hold, told=None, sigma=0.003, seed=0, model=None):
    """A recording of the plant, whose input ran between samples as ``hold`` says; ``told`` is what was recorded."""
    t = STEP * np.arange(len(u))
    run = tsm.simulate(model or tsm.loads(PLANT), inputs={"u": (t, u)}, hold=hold, stop=t[-1], step=STEP / 8)
    y = run["y"][::8] + np.random.default_rng(seed).normal(0.0, sigma, t.size)
    return tsm.Record("run", t, {"u": u if told is None else told, "y": y}, {"u": "V", "y": "V"})


@pytest.fixture
def u():
    return motion(STEP * np.arange(1200))


def diagnosed(record, **more):
    return tsm.diagnose(
        attrs.evolve(tsm.loads(PLANT)), record, effects=["dead_time", "first_order_lag", "backlash"], **more
    )


def told(found, words):
    return [note for note in found.notes if words in note]


def test_a_command_that_is_held_is_no_missing_dead_time(u):
    found = diagnosed(recorded(u, hold="zero"))
    assert found.verdict == "none"
    assert found.simulated.hold == "zero"
    assert told(found, "u is held between samples (hold='zero')")
    assert found.augmented.parameters["lag.time_constant"] == pytest.approx(0.06, rel=0.02)


@pytest.mark.parametrize("sigma", [0.02, 0.04])
def test_a_hold_is_found_without_an_effect_that_delays(u, sigma):
    """What it takes off may be small; that its share is 1 is seldom chance. The verdict was "unknown"."""
    found = tsm.diagnose(tsm.loads(PLANT), recorded(u, hold="zero", sigma=sigma), effects=["jump", "drift"])
    assert (found.verdict, found.simulated.hold) == ("none", "zero")


def test_with_a_hold_that_is_given_nothing_is_tried(u):
    found = diagnosed(recorded(u, hold="zero"), hold="cubic")
    assert [e.name for e in found.effects] == ["dead_time"]
    assert not told(found, "held")


def test_a_smooth_motion_stays_smooth(u):
    found = diagnosed(recorded(u, hold="cubic"))
    assert found.verdict == "none"
    assert found.simulated.hold == "cubic"
    assert not told(found, "held")


def test_a_hold_is_found_behind_a_dead_time_that_is_missing(u):
    late = tsm.loads(PLANT).insert("late", tsm.blocks.DeadTime(time=0.17), before="lag.u")
    found = diagnosed(recorded(u, hold="zero", model=late))
    assert told(found, "u is held between samples (hold='zero')")
    assert [e.name for e in found.effects] == ["dead_time"]
    assert found.augmented.parameters["dead_time.time"] == pytest.approx(0.17, abs=0.002)


def test_a_fit_finds_a_hold_behind_a_dead_time(u):
    late = tsm.loads(PLANT).insert("late", tsm.blocks.DeadTime(time=0.17), before="lag.u")
    found = tsm.fit(late, recorded(u, hold="zero", model=late), step=STEP)
    assert told(found, "the outputs agree with u held between samples")


@pytest.mark.parametrize("hold", ["zero", "cubic"])
def test_an_input_that_is_held_in_one_recording_is_so_in_others_where_the_outputs_agree(u, hold):
    """A staircase shows that the command is held; whether it is in a smooth motion as well, the outputs tell."""
    stairs = np.repeat(np.random.default_rng(3).uniform(-1, 1, 40), 30)
    told_of = {"stairs": (stairs, "zero"), "smooth": (u, hold)}
    records = {
        name: recorded(np.r_[one[:1], one[:1], one[:-2]], hold=of, told=one, sigma=0.02)  # two samples late
        for name, (one, of) in told_of.items()
    }
    found = diagnosed(records)
    assert [e.name for e in found.effects] == ["dead_time"]
    assert found.augmented.parameters["dead_time.time"] == pytest.approx(2 * STEP, abs=0.002)
    assert bool(told(found, "u is held between samples (hold='zero')")) == (hold == "zero")


def test_a_dead_time_is_given_for_a_held_input_too_where_the_outputs_agree_with_both():
    """Half a sample of a longer delay is that of a hold: a stranger's 3 ms were 5.5 ms, with no word on it."""
    second = """
    format = 1
    title = "Valve"
    wires = ["gain -> net.plus", "net -> speed -> angle", "angle -> spring -> net.minus1",
             "speed -> damper -> net.minus2"]
    [blocks]
    gain = { type = "Gain", gain = 2.0 }
    net = { type = "Sum", signs = "+--" }
    speed = { type = "Integrator" }
    angle = { type = "Integrator" }
    spring = { type = "Gain", gain = 9.0 }
    damper = { type = "Gain", gain = 4.0 }
    [inputs]
    u = { ports = "gain.u", unit = "V" }
    [outputs]
    y = { signal = "angle", unit = "V" }
    """
    valve, t = tsm.loads(second), STEP * np.arange(1500)
    u = np.sin(1.1 * t) + 0.6 * np.sin(2.3 * t + 1.0) + 0.3 * np.sin(3.7 * t)  # slow: the hold shows as a delay alone
    late = valve.insert("late", tsm.blocks.DeadTime(time=0.03), before="y")
    told_of = recorded(u, hold="zero", model=late, sigma=0.002)
    free = ["gain.gain", "spring.gain", "damper.gain"]
    found = tsm.diagnose(valve, told_of, free=free, effects=["dead_time", "backlash"])
    (effect,), text = found.effects, " ".join(found.sentence.split())
    assert effect.parameters["time"].value == pytest.approx(0.03 + STEP / 2, abs=0.003)
    assert "If u is held between samples (--hold u=zero), which fits as well, dead_time is" in text
    (other,) = found.segments[0].delays_if_held
    assert other.time == pytest.approx(0.03, abs=0.003)
    held = tsm.diagnose(valve, told_of, free=free, effects=["dead_time", "backlash"], hold="zero")
    assert "fits as well" not in held.sentence
    assert held.effects[0].parameters["time"].value == pytest.approx(other.time, abs=2e-4)


@pytest.mark.parametrize("delay", [0.004, 0.016, 0.05])
def test_a_dead_time_of_another_length_is_no_hold(u, delay):
    late = tsm.loads(PLANT).insert("late", tsm.blocks.DeadTime(time=delay), before="lag.u")
    found = diagnosed(recorded(u, hold="cubic", model=late))
    (one,) = found.effects
    assert (one.name, found.simulated.hold) == ("dead_time", "cubic")
    assert next(iter(one.parameters.values())).value == pytest.approx(delay, rel=0.1)


def test_a_hold_is_found_from_a_base_that_is_far_from_its_best_parameters():
    """The share of the hold is of first order, and 1.52 here beside the base with a smooth input."""
    swing = """
    format = 1
    title = "Swing"
    wires = ["push.y -> speed -> place", "place -> spring -> push.minus1", "speed -> damper -> push.minus2"]
    [blocks]
    push = { type = "Sum", signs = "+--" }
    speed = { type = "Integrator" }
    place = { type = "Integrator" }
    spring = { type = "Gain", gain = 1500.0 }
    damper = { type = "Gain", gain = 1.2 }
    [inputs]
    u = { ports = "push.plus", unit = "m/s^2" }
    [outputs]
    x = { signal = "place", unit = "m" }
    """
    t = STEP * np.arange(1200)
    u = motion(t) + 0.5 * np.sin(31.0 * t)
    run = tsm.simulate(tsm.loads(swing), inputs={"u": (t, u)}, hold="zero", stop=t[-1], step=STEP / 16)
    x = run["x"][::16] + np.random.default_rng(0).normal(0.0, 2e-6, t.size)
    record = tsm.Record("run", t, {"u": u, "x": x}, {"u": "m/s^2", "x": "m"})
    found = tsm.diagnose(tsm.loads(swing), record, effects=["dead_time", "first_order_lag"])
    assert (found.verdict, found.simulated.hold) == ("none", "zero")
    assert found.augmented.parameters["damper.gain"] == pytest.approx(1.2, rel=0.01)


def test_a_hold_beside_an_effect_is_found_once_the_effect_is_named(u):
    loose = tsm.loads(PLANT).insert("gap", tsm.blocks.Play(half_width=0.6), before="y")
    found = diagnosed(recorded(u, hold="zero", model=loose))
    assert [e.name for e in found.effects] == ["backlash"]
    assert found.simulated.hold == "zero"


def test_the_fast_part_of_a_command_drives_the_plant(u):
    fast = u + np.random.default_rng(3).normal(0.0, 0.1, len(u))
    found = diagnosed(recorded(fast, hold="zero"))
    assert found.verdict == "none"
    assert found.simulated.hold == "zero"
    assert found.simulated.conditioned == ()
    assert told(found, "u was not filtered")
    assert "u as recorded" not in found.provenance.options["inputs"]  # all inputs are


def test_noise_of_a_measured_input_is_noise(u):
    noisy = u + np.random.default_rng(3).normal(0.0, 0.02, len(u))
    found = diagnosed(recorded(u, hold="cubic", told=noisy))
    assert found.simulated.conditioned == ("u",)
    assert not told(found, "not filtered")


def test_commands_are_joined_once_each():
    assert Commands(("a",), ()).joined(Commands(("a", "b"), ("c",))) == Commands(("a", "b"), ("c",))
    assert not Commands()


def test_a_fit_says_that_an_input_is_held(u):
    fitted = tsm.fit(tsm.loads(PLANT), recorded(u, hold="zero"))
    (note,) = [text for text in fitted.notes if "held between samples" in text]
    assert "hold='zero'" in note
    better = tsm.fit(tsm.loads(PLANT), recorded(u, hold="zero"), hold="zero")
    share = float(note.partition("would be about ")[2].partition(" ")[0])
    assert better.rms / fitted.rms == pytest.approx(share, rel=0.15)  # to first order
    assert not [text for text in better.notes if "held" in text]


def test_a_fit_to_a_smooth_motion_says_nothing_of_holds(u):
    assert not [text for text in tsm.fit(tsm.loads(PLANT), recorded(u, hold="cubic")).notes if "held" in text]


def test_a_restart_that_leaves_more_is_refused_and_no_other_is_looked_for(u, monkeypatch):
    nothing = dict.fromkeys(("free", "noise_floor", "effects", "outputs", "window", "step", "progress"))
    more = {"start_states": True, "condition": True, "seed": 0, "integrator": "rk4", "hold": "auto"}
    request = checked(tsm.loads(PLANT), recorded(u, hold="cubic"), **nothing, **more)
    (part,) = partition(request.diagram, request.measured)
    ready = preparation.prepared(part, request, lambda *_: None)
    held = Commands(held=("u",))

    def with_noise(factor):
        floors = attrs.evolve(ready.floors, sigma={k: factor * v for k, v in ready.floors.sigma.items()})
        return attrs.evolve(ready, floors=floors, commands=held)

    monkeypatch.setattr(preparation, "prepared", lambda *_: with_noise(1.2))
    again = preparation.prepared_again(ready, held, lambda *_: None)
    assert (again.commands, again.settled) == (held, False)
    monkeypatch.setattr(preparation, "prepared", lambda *_: with_noise(1.4))
    kept = preparation.prepared_again(ready, held, lambda *_: None)
    assert (kept.commands, kept.settled) == (ready.commands, True)
    assert kept.commands_of(ready.base, distance=100.0) == Commands()


def test_a_command_that_is_seen_to_rest_in_one_recording_is_filtered_in_none(u):
    noise = 0.02 * np.random.default_rng(3).standard_normal(u.size)
    steps = np.repeat([0.0, 1.0, -0.5, 0.7, 0.2, -1.0], 200)
    records = {"loop": recorded(u + noise, hold="zero"), "steps": recorded(steps, hold="zero", seed=1)}
    found = diagnosed(records)
    assert told(found, "u was not filtered: it is piecewise constant in steps, so it has no noise.")
    assert not told(found, "u was filtered")
    alone = diagnosed({"steps": records["steps"]})
    assert not told(alone, "not filtered")
    assert not told(diagnosed(records, condition=False), "not filtered")


@pytest.mark.parametrize("hold", ["zero", "cubic"])
def test_a_fit_finds_a_hold_that_its_linear_prediction_misses(hold):
    """Dry friction ends the search at a kink, where the share of a hold is not near 1: the fit blamed the model."""
    servo = tsm.Diagram(
        title="servo with friction",
        blocks=dict(
            net=Sum(signs="+-"),
            motor=FirstOrderLag(gain=2.0, time_constant=0.08),
            angle=Integrator(),
            friction=CoulombFriction(level=0.15, smoothing=0.01),
        ),
        wires=["net -> motor -> angle", "motor -> friction -> net.minus"],
        inputs={"u": "net.plus"},
        outputs={"y": "angle"},
    )
    true = {"motor.gain": 2.1, "motor.time_constant": 0.085, "friction.level": 0.35, "friction.smoothing": 0.005}
    t, rng = np.arange(0.0, 4.0, 0.005), np.random.default_rng(2)
    u = 1.5 * sum(np.sin(2 * np.pi * f * t + p) for f, p in zip((0.3, 0.9, 1.4), rng.uniform(0, 6, 3), strict=True))
    run = tsm.simulate(servo.with_parameters(true), inputs={"u": (t, u)}, stop=t[-1], step=5e-4, hold=hold)
    y = np.interp(t, run.t, run["y"]) + rng.normal(0.0, 9e-4, t.size)
    found = tsm.fit(servo, tsm.Record("run", t, {"u": u, "y": y}, {"u": "V", "y": "rad"}), starts=1)
    said = told(found, "with u held between samples, as at the output of a sampled controller, a fit leaves")
    assert bool(said) == (hold == "zero")


def test_a_comparison_says_where_models_take_inputs_in_other_ways(u):
    plant = tsm.loads(PLANT)
    held = plant.with_simulation(Simulation(hold="zero"))
    both = tsm.compare({"own": held, "plain": plant}, recorded(u, hold="zero"), starts=1, step=STEP)
    assert "the models differ in how inputs are taken between samples: " in str(both).replace("\n  ", " ")
    same = tsm.compare({"own": held, "plain": plant}, recorded(u, hold="zero"), starts=1, step=STEP, hold="zero")
    assert "between samples" not in str(same)
