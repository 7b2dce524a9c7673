"""Recordings made by plain loops in NumPy, in no equations of the blocks', and what is found missing in them."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum, ViscousFriction

STEP, FINE = 0.01, 20
T = np.arange(0.0, 16.0, STEP)


def volts(t):
    return 3.0 * np.sin(1.3 * t) + 2.0 * np.sin(3.7 * t + 1.0)


def spinning(level, slope=25.0, damping=2.0):
    """Speed [rad/s] of a drive that sticks below ``level`` and slides against it: one Euler step after another."""
    w, h, made = 0.0, STEP / FINE, []
    for k in range(len(T) * FINE):
        made.append(w)
        free = w + h * (slope * volts(k * h) - damping * w)
        w = np.sign(free) * max(abs(free) - h * level, 0.0)
    return np.array(made[::FINE])


def drive(unit):
    """The same without dry friction."""
    return tsm.Diagram(
        title="drive",
        wires=["push -> net.plus", "net -> speed -> viscous -> net.minus"],
        blocks=dict(
            push=Gain(gain=20.0),
            net=Sum(signs="+-"),
            speed=Integrator(unit=unit),
            viscous=ViscousFriction(coefficient=3.0),
        ),
        inputs={"u": tsm.Inlet("push.u", unit="V")},
        outputs={"w": "speed"},
    )


def recording():
    noise = 0.1 * np.random.default_rng(3).standard_normal(len(T))
    return tsm.Record("run", T, {"u": volts(T), "w": spinning(30.0) + noise}, {"u": "V", "w": "rad/s"})


FREE = ["push.gain", "viscous.coefficient"]
SOME = ["coulomb_friction", "asymmetric_friction", "quadratic_drag", "resonance", "dead_zone", "first_order_lag"]


@pytest.fixture(scope="module")
def found():
    return tsm.diagnose(drive("rad/s"), recording(), noise_floor="0.1 rad/s", free=FREE, effects=SOME)


def test_dry_friction_is_found_where_the_speed_is_measured(found):
    first, *more = found.effects
    assert (first.name, first.wire, more) == ("coulomb_friction", "net.y -> speed.u", [])
    assert first.parameters["friction.level"].value == pytest.approx(30.0, rel=0.03)
    now = found.augmented.parameters
    assert now["push.gain"] == pytest.approx(25.0, rel=0.02)
    assert now["viscous.coefficient"] == pytest.approx(2.0, rel=0.05)


def test_the_diagram_with_friction_of_a_speed_in_place_comes_back_from_its_file(found):
    again = tsm.loads(tsm.dumps(found.augmented))
    one, other = (tsm.score(d, recording(), outputs=["w"]) for d in (found.augmented, again))
    assert str(one) == str(other)


def test_a_gain_that_drifts_is_one_effect_and_not_several_changes():
    x = 0.8 * np.sin(1.1 * T) + 0.4 * np.sin(2.6 * T)
    y, gap = np.empty_like(x), 0.0
    for k, u in enumerate(x):
        gap = min(max(gap, u - 0.05), u + 0.05)
        y[k] = gap * (0.92 - 0.008 * T[k])
    y += 0.003 * np.random.default_rng(5).standard_normal(len(T))
    sheath = tsm.Record("sheath", T, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
    effects = ["parameter_change", "drift", "jump", "creep"]
    found = tsm.diagnose(tsm.load("tendon_sheath_play"), sheath, noise_floor="0.003 rad", effects=effects)
    (only,) = found.effects
    assert (only.name, only.words) == ("parameter_change", "a gain that drifts")
    rate = only.parameters["rate"]
    assert rate.low < -0.008 / 0.92 < rate.high


@pytest.mark.parametrize(
    ("made", "name", "number", "value"),
    [
        (lambda y: y * (0.92 - 0.008 * T), "parameter_change", "rate", -0.008 / 0.92),
        (lambda y: 0.92 * y + 0.004 * T, "drift", "rate", 0.004),
        (lambda y: 0.92 * y + 0.02 * np.cos(2 * np.pi * 1.73 * T), "periodic_disturbance", "frequency", 1.73),
    ],
    ids=["gain", "offset", "disturbance"],
)
def test_a_clock_that_began_long_before_hides_nothing(made, name, number, value):
    x = 0.8 * np.sin(1.1 * T) + 0.4 * np.sin(2.6 * T)
    y = made(x) + 0.003 * np.random.default_rng(5).standard_normal(len(T))
    effects = ["parameter_change", "drift", "periodic_disturbance"]
    found = []
    for start in (0.0, 1e4):
        late = tsm.Record("run", T + start, {"x_in": x, "x_out": y}, {"x_in": "rad", "x_out": "rad"})
        found.append(tsm.diagnose(tsm.load("tendon_sheath_play"), late, noise_floor="0.003 rad", effects=effects))
    (only,) = found[1].effects
    assert only.name == name
    assert only.parameters[number].value == pytest.approx(value, rel=0.05)
    assert found[1].consequence.augmented == pytest.approx(found[0].consequence.augmented, rel=0.01)


def test_a_memory_that_the_search_threw_beyond_its_reach_is_brought_back():
    """As where degrees are declared radians, and the output is fifty times as large as the model begins with."""
    x, y = 0.8 * np.sin(1.1 * T) + 0.4 * np.sin(2.6 * T), np.zeros(len(T))
    for k in range(1, len(T)):
        y[k] = min(max(y[k - 1], x[k] - 0.05), x[k] + 0.05)
    noise = 0.003 * np.random.default_rng(0).standard_normal(len(T))
    signals = {"x_in": x, "x_out": np.degrees(0.92 * y + 0.01 + noise)}
    record = tsm.Record("run", T, signals, {"x_in": "rad", "x_out": "rad"})
    found = tsm.diagnose(tsm.load("tendon_sheath_play"), record, effects=["asymmetric_hysteresis"])
    (gap,) = found.worst.gaps
    assert found.verdict == "none"
    assert gap.held_out[0] == pytest.approx(np.degrees(0.003), rel=0.04)
