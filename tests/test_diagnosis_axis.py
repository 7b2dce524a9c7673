"""A ball-screw axis made by a plain loop: it integrates, its play is larger than what it misses, its sensor is late."""

from functools import cache

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Delay, FirstOrderLag, Gain, Integrator, Play

SLOW_NEEDS = ["diagnosis"]
STEP, FINE, NOISE = 0.005, 10, 0.02
SLOPE, LAG, PITCH, GAP, LATE = 18.15, 0.146, 0.8, 1.0, 0.012


@pytest.fixture(params=[1200, pytest.param(2400, marks=pytest.mark.slow)])
def samples(request):
    """Length of each recording."""
    return request.param


@cache
def measured(samples, seed, late=LATE):
    """Volts and position [mm]: Euler steps of ``STEP / FINE``, from which on the sensor sends what it saw."""
    draw = np.random.default_rng(seed)
    t, h = STEP * np.arange(samples), STEP / FINE
    tones = zip((3.0, 2.0, 1.5), (0.21, 0.63, 1.4), draw.uniform(0, 6, 3), strict=True)
    u = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    speed = angle = nut = 0.0
    seen = [0.0] * round(late / h)
    for volts in np.repeat(u, FINE):
        seen.append(nut)
        speed, angle = speed + h * (SLOPE * volts - speed) / LAG, angle + h * speed
        nut = min(max(nut, PITCH * angle - GAP), PITCH * angle + GAP)
    x = np.array(seen[: len(u) * FINE : FINE]) + NOISE * draw.standard_normal(len(u))
    return tsm.Record(f"run_{seed}", t, {"u": u, "x": x}, {"u": "V"})


def diagnosed(more, free, runs, **how):
    blocks = dict(motor=FirstOrderLag(gain=18.0, time_constant=0.15), turn=Integrator(), screw=Gain(gain=PITCH), **more)
    axis = tsm.Diagram(
        title="axis",
        blocks=blocks,
        wires=[" -> ".join(blocks)],
        inputs={"u": tsm.Inlet("motor.u", unit="V")},
        outputs={"x": list(blocks)[-1]},
    )
    return tsm.diagnose(axis, runs, free=["motor.*", *free], noise_floor=NOISE, hold="zero", condition=False, **how)


@pytest.mark.parametrize("late", [LATE, 0.3])
def test_nothing_is_missing_in_the_true_model(late, samples):
    """What is on its way in the delay when a piece begins is no error, however long it is."""
    found = diagnosed(
        dict(gear=Play(half_width=1.0), late=Delay(time=late)),
        ["gear.half_width", "late.time"],
        [measured(samples, 1, late), measured(samples, 2, late)],
        effects=["resonance", "coulomb_friction", "dead_time"],
    )
    assert (found.verdict, found.effects) == ("none", ())
    assert found.segments[0].gaps[0].held_out[-1] == pytest.approx(NOISE, rel=0.02)
    values = found.base.parameters
    assert values["gear.half_width"] == pytest.approx(GAP, rel=0.003)
    assert values["late.time"] == pytest.approx(late, abs=0.0007)


def test_the_delay_that_is_missing_is_named(samples):
    found = diagnosed(
        dict(gear=Play(half_width=1.0)),
        ["gear.half_width"],
        [measured(samples, 1)],
        effects=["dead_time", "resonance", "first_order_lag", "coulomb_friction"],
    )
    (effect,) = found.effects
    assert effect.name == "dead_time"
    assert effect.parameters["time"].value == pytest.approx(LATE, abs=0.0007)
    assert " leads " not in found.sentence


def test_play_and_delay_that_are_missing_are_named_with_their_sizes(samples):
    """Each piece begins on one side of the play or the other, which no step downhill changes."""
    found = diagnosed({}, [], [measured(samples, 2)], effects=["backlash", "dead_time", "resonance", "first_order_lag"])
    first, second = found.effects
    assert (first.name, second.name) == ("backlash", "dead_time")
    assert first.parameters["half_width"].value == pytest.approx(GAP, rel=0.003)
    assert second.parameters["time"].value == pytest.approx(LATE, abs=0.0007)
    assert found.segments[0].gaps[0].held_out[-1] < 1.02 * NOISE
    assert " leads " not in found.sentence
    starts = [v for own in found.start_states.values() for k, v in own.items() if k == "backlash.m"]
    assert np.max(np.abs(starts)) < 100  # mm: on the way that the screw went, not thrown anywhere


def position_loop(amplitude, seed, gap, rest):
    """Reference, at rest at first, and position [mm] of a table behind a play; the loop is closed around the motor."""
    draw, h = np.random.default_rng(seed), 0.0005
    t = 0.004 * np.arange(1500)
    tones = zip((1.0, 0.6, 0.3), (0.4, 1.1, 2.7), draw.uniform(0, 6, 3), strict=True)
    r = amplitude * sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    r = (r - r[0]) * np.clip((t - rest) / 0.5, 0.0, 1.0)
    at = speed = total = table = 0.0
    x = []
    for wanted in r:
        x.append(table)
        for _ in range(8):
            error = 30.0 * (wanted - at) - speed
            total += h * error
            speed += h * (10.0 * (2.0 * error + 60.0 * total) - speed) / 0.2
            at += h * speed
            table = min(max(table, at - gap / 2), at + gap / 2)
    noisy_x = np.array(x) + 0.001 * draw.standard_normal(len(t))
    return tsm.Record(f"run_{seed}", t, {"x_ref": r, "x": noisy_x}, {"x_ref": "mm", "x": "mm"})


def test_a_gap_behind_a_position_loop_is_found_where_it_is():
    """What the loop starts from has no effect while the gap is not closed: steps went thousands of mm/s for it."""
    axis = tsm.loads(
        """
        format = 1
        title = "position loop"
        wires = ["e -> kv -> ev.plus", "ev -> pi -> axis -> pos -> e.minus", "axis -> ev.minus"]
        [blocks]
        e = { type = "Sum", signs = "+-" }
        kv = { type = "Gain", gain = 27.0, unit = "mm/s" }
        ev = { type = "Sum", signs = "+-" }
        pi = { type = "PID", kp = 2.3, ki = 50.0 }
        axis = { type = "FirstOrderLag", gain = 10.0, time_constant = 0.25 }
        pos = { type = "Integrator" }
        [inputs]
        x_ref = { ports = "e.plus", unit = "mm" }
        [outputs]
        x = { signal = "pos", unit = "mm" }
        """
    )
    runs = [position_loop(size, k, 0.06, 0.8) for k, size in enumerate((8.0, 1.0))]
    found = tsm.diagnose(axis, runs, effects=["backlash", "hysteresis", "coulomb_friction", "dead_time"])
    (effect,) = found.effects
    assert (effect.name, effect.wire.strip()) == ("backlash", "pos.y -> x")
    size = effect.sizes["gap width"]
    assert size.value == pytest.approx(0.06, rel=0.02)
    assert found.complete
