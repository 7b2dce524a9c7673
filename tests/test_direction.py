"""Forces that resist a motion which the drive turns backwards, such as that of a damper on a base that is moved."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.diagnosis.direction import moves_backwards
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.effects import catalogue
from tsmblocks.effects.variants import with_opposite_motion

STIFFNESS, DAMPING, MASS, FRICTION = 16000.0, 1500.0, 320.0, 45.0
NOISE = 2e-4
STEP, STOP = 0.01, 12.0
BENCH = """
format = 1
title = "Mass on a moved base"
wires = [
  "travel -> spring -> force.plus1",
  "rate -> damper -> force.plus2",
  "force -> inverse_mass -> speed -> body -> travel.minus",
  "speed -> rate.minus",
  "base_rate -> rate.plus",
]
[blocks]
base_rate = { type = "Derivative" }
travel = { type = "Sum", signs = "+-" }
rate = { type = "Sum", signs = "+-" }
spring = { type = "Gain", gain = 15000.0, unit = "N" }
damper = { type = "Gain", gain = 1700.0, unit = "N" }
force = { type = "Sum", signs = "++" }
inverse_mass = { type = "Gain", gain = 0.003125, unit = "m/s^2" }
speed = { type = "Integrator" }
body = { type = "Integrator" }
[inputs]
base = { ports = ["base_rate.u", "travel.plus"], unit = "m" }
[outputs]
body = "body"
travel = "travel"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(BENCH, encoding="utf-8")
    return tsm.load(path)


def recorded(name, frequencies, seed):
    """A recording by SciPy, in m: the body rests on a base that is moved, through a damper with dry friction."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, STOP, STEP)
    phases = rng.uniform(0, 2 * np.pi, len(frequencies))

    def base(s):
        moved = sum(0.01 * np.sin(2 * np.pi * f * s + a) for f, a in zip(frequencies, phases, strict=True))
        return moved * (1 - np.exp(-s))

    def rates(s, state):
        body, speed = state
        rate = (base(s + 1e-6) - base(s - 1e-6)) / 2e-6 - speed
        force = STIFFNESS * (base(s) - body) + DAMPING * rate + FRICTION * np.tanh(rate / 1e-3)
        return speed, force / MASS

    body = solve_ivp(rates, (0.0, STOP), (0.0, 0.0), t_eval=t, rtol=1e-7, atol=1e-10, max_step=STEP / 4).y[0]
    signals = {
        "base": base(t),
        "body": body + rng.normal(0, NOISE, t.size),
        "travel": base(t) - body + rng.normal(0, NOISE, t.size),
    }
    return tsm.Record(name, t, signals, dict.fromkeys(signals, "m"))


def test_a_drive_moves_its_output_forwards_and_what_it_is_subtracted_from_backwards(bench):
    assert not moves_backwards(bench, "body.y", "speed.u")
    assert not moves_backwards(bench, "speed.y", "speed.u")
    assert moves_backwards(bench, "travel.y", "speed.u")
    assert moves_backwards(bench, "rate.y", "speed.u")


def test_a_signal_that_is_not_driven_is_not_moved_backwards(bench):
    assert not moves_backwards(bench, "base_rate.y", "speed.u")
    assert not moves_backwards(bench, "nothing.y", "speed.u")


def test_friction_is_looked_for_along_a_deflection_that_is_not_measured(bench):
    points = insertion_points(bench, ["body"])
    loads = {(p.other, p.opposite) for p in points if p.place == "load"}
    assert loads == {("body.y", False), ("travel.y", True)}


def test_with_a_motion_backwards_the_force_adds_to_the_drive(bench):
    (friction,) = [one for one in catalogue() if one.name == "coulomb_friction" and one.place == "load"]
    point = next(p for p in insertion_points(bench, ["travel"]) if p.place == "load")
    for effect, sign in ((friction, -1.0), (with_opposite_motion(friction), 1.0)):
        made = point.put(bench, "friction", effect.block).with_parameters({"friction.friction.level": 0.1})
        t = np.arange(0.0, 1.0, 1e-3)
        run = tsm.simulate(made, inputs={"base": (t, 0.05 * np.sin(6 * t))}, stop=t[-1], step=1e-3, log="all")
        resisting = run["friction.left.y"] - run["inverse_mass.y"]
        fast = np.abs(run["friction.rate.y"]) > 0.05
        assert np.allclose(resisting[fast], sign * 0.1 * np.sign(run["friction.rate.y"][fast]), rtol=1e-3)


def test_effects_that_subtract_nothing_stay_as_they_are():
    effects = [one for one in catalogue() if one.place == "output"]
    assert all(with_opposite_motion(one) is one for one in effects)


@pytest.mark.parametrize("outputs", [["body", "travel"], ["body"]])
def test_dry_friction_of_a_damper_is_named_with_its_force(bench, outputs):
    records = [recorded("slow", (0.3, 0.7), 1), recorded("fast", (0.9, 1.6), 2)]
    said = tsm.diagnose(
        bench,
        records,
        free=["spring.gain", "damper.gain"],
        outputs=outputs,
        effects=["coulomb_friction", "viscous_friction", "quadratic_drag", "odd_nonlinearity", "dead_time"],
    )
    assert [e.name for e in said.effects] == ["coulomb_friction"]
    level = said.effects[0].parameters["friction.level"]
    assert level.low <= FRICTION / MASS <= level.high
    assert level.high - level.low < 0.05 * level.value
    assert said.complete
