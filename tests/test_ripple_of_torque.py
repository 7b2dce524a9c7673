"""A ripple of the torque over an angle that is not measured: a controller holds the speed, which is."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.partition import partition
from tsmblocks.model.diagram import Diagram

INERTIA, DRAG, TORQUE = 2e-4, 1.2e-4, 0.005
RIPPLE, PER_TURN, NOISE = 0.004, 6, 0.1
STEP = 0.002
EFFECTS = ["position_ripple", "coulomb_friction", "viscous_friction", "jump", "dead_time"]
MOTOR = Diagram(
    title="Motor",
    blocks={
        "error": Sum(signs="+-"),
        "torque": Gain(gain=0.0045, unit="N*m"),
        "net": Sum(signs="+-"),
        "inertia": Gain(gain=5200.0, unit="rad/s^2"),
        "speed": Integrator(),
        "drag": Gain(gain=1e-4, unit="N*m"),
    },
    wires=["error -> torque -> net.plus", "net -> inertia -> speed -> error.minus", "speed -> drag -> net.minus"],
    inputs={"reference": tsm.Inlet("error.plus", unit="rad/s")},
    outputs={"speed": "speed"},
)
WITH_ANGLE = MOTOR.rewire(blocks={**MOTOR.blocks, "angle": Integrator()}, add=["speed -> angle"])


def recorded(seed):
    rng, t = np.random.default_rng(seed), STEP * np.arange(1500)
    tones = [(0.5, 25.0, rng.uniform(0, 6)), (1.3, 15.0, rng.uniform(0, 6)), (2.9, 8.0, rng.uniform(0, 6))]

    def reference(s):
        return sum(a * np.sin(2 * np.pi * f * s + p) for f, a, p in tones)

    def rates(s, state):
        speed, angle = state
        torque = TORQUE * (reference(s) - speed) - DRAG * speed - RIPPLE * np.sin(PER_TURN * angle)
        return torque / INERTIA, speed

    state = solve_ivp(rates, (0.0, t[-1]), (0.0, 0.3), t_eval=t, rtol=1e-8, atol=1e-8, max_step=STEP).y
    signals = {"reference": reference(t), "speed": state[0] + rng.normal(0, NOISE, t.size)}
    return tsm.Record(f"run{seed}", t, signals, {"reference": "rad/s", "speed": "rad/s"})


@pytest.fixture(scope="module")
def records():
    return [recorded(seed) for seed in (1, 2)]


def test_a_position_behind_a_measured_speed_stays_in_the_model():
    (part,) = partition(WITH_ANGLE, ["speed"])
    assert "angle" in part.diagram.blocks
    loads = {p.other for p in insertion_points(part.diagram, ["speed"]) if p.place == "load"}
    assert loads == {"angle.y"}


def test_a_ripple_of_the_torque_is_named_with_its_amplitude_and_period(records):
    found = tsm.diagnose(WITH_ANGLE, records, free=["torque.gain", "inertia.gain", "drag.gain"], effects=EFFECTS)
    (effect,) = found.effects
    assert effect.name == "position_ripple"
    assert found.complete
    amplitude, period = effect.sizes["amplitude"], effect.sizes["period"]
    assert amplitude.value == pytest.approx(RIPPLE / INERTIA, rel=0.05)
    assert period.low < 2 * np.pi / PER_TURN < period.high


def test_without_an_angle_the_next_step_is_an_integrator(records):
    found = tsm.diagnose(MOTOR, records, free=["torque.gain", "inertia.gain", "drag.gain"], effects=EFFECTS)
    assert "position_ripple" not in [e.name for e in found.effects]
    assert "Put an Integrator behind speed in the diagram" in " ".join(str(found).split())


# ---- many periods in a turn, beside a torque that is commanded

SLOTS, COGGING = 24, 0.003
ALONE = Diagram(
    title="Motor without a controller",
    blocks={
        "net": Sum(signs="+-"),
        "inertia": Gain(gain=4300.0, unit="rad/s^2"),
        "speed": Integrator(),
        "drag": Gain(gain=0.0021, unit="N*m"),
        "angle": Integrator(),
    },
    wires=["net -> inertia -> speed -> angle", "speed -> drag -> net.minus"],
    inputs={"torque": tsm.Inlet("net.plus", unit="N*m")},
    outputs={"speed": "speed"},
)


def cogging(seed):
    rng, t = np.random.default_rng(seed), STEP * np.arange(2500)
    tones = [(f, a, rng.uniform(0, 6)) for f, a in ((0.17, 0.03), (0.43, 0.03), (1.1, 0.02), (2.7, 0.02), (6.1, 0.02))]

    def torque(s):
        return sum(a * np.sin(2 * np.pi * f * s + p) for f, a, p in tones)

    def rates(s, state):
        speed, angle = state
        return (torque(s) - 0.0025 * speed - COGGING * np.sin(SLOTS * angle)) / INERTIA, speed

    speed = solve_ivp(rates, (0.0, t[-1]), (0.0, 0.3 * seed), t_eval=t, rtol=1e-8, atol=1e-8, max_step=STEP).y[0]
    signals = {"torque": torque(t), "speed": speed + rng.normal(0, NOISE, t.size)}
    return tsm.Record(f"run{seed}", t, signals, {"torque": "N*m", "speed": "rad/s"})


def test_cogging_is_found_where_the_angle_of_the_model_is_in_error():
    found = tsm.diagnose(ALONE, [cogging(seed) for seed in (1, 2)], effects=EFFECTS)
    (effect,) = found.effects
    assert effect.name == "position_ripple"
    amplitude, period = effect.sizes["amplitude"], effect.sizes["period"]
    assert amplitude.value == pytest.approx(COGGING / INERTIA, rel=0.1)
    assert period.low < 2 * np.pi / SLOTS < period.high
    units = {name.partition("@")[0]: one.unit for name, one in effect.parameters.items()}
    assert (units["force.cosine"], units["force.sine"]) == ("rad/s^2", "rad/s^2")  # not that of the angle
