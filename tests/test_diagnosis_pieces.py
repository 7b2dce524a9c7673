"""Plants that integrate: whole recordings where their errors stay small, pieces that begin anew where they grow."""

from __future__ import annotations

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Integrator
from tsmblocks.diagnosis.model import ModelSettings
from tsmblocks.diagnosis.partition import has_lasting_memory, piece_lengths, split_into_pieces

GAIN, LAG, STEP, NOISE, FINE = 2.0, 0.05, 0.005, 0.005, 10
"""Gain [rad/(s V)] and time constant [s] of the motor, sampling [s], rms noise [rad], steps of the loop a sample."""
MOTOR = tsm.loads(
    f"""format = 1
title = "motor"
[blocks]
motor = {{ type = "MotorTransferFunction", K = {0.9 * GAIN}, tau = {1.1 * LAG} }}
[inputs]
u = {{ ports = "motor.u", unit = "V" }}
[outputs]
x = "motor.y"
"""
)


def recording(seed, friction, limit=np.inf):
    """A motor with dry friction [V] by a plain loop; its amplifier saturates smoothly at a limit [V]."""
    draw, h = np.random.default_rng(seed), STEP / FINE
    t = np.arange(0.0, 10.0, h)
    f, phase = draw.uniform(0.2, 2.5, 6), draw.uniform(0, 2 * np.pi, 6)
    u = np.sum(0.8 * np.cos(2 * np.pi * f * t[:, None] + phase) * np.sqrt(f), axis=1)
    slow, at = friction * GAIN / LAG * h, np.empty_like(t)
    v = x = 0.0
    for k, force in enumerate((u / np.sqrt(1 + (u / limit) ** 2)).tolist()):
        at[k] = x
        new = v + h * (GAIN * force - v) / LAG
        new = float(np.sign(new)) * max(abs(new) - slow, 0.0)
        v, x = new, x + h * (v + new) / 2
    y = at[::FINE] + draw.normal(0.0, NOISE, len(at[::FINE]))
    return tsm.Record(f"r{seed}", t[::FINE], {"u": u[::FINE], "x": y}, {"u": "V", "x": "rad"})


def diagnosed(*runs, effects=("coulomb_friction", "quadratic_drag", "dead_time", "odd_nonlinearity")):
    return tsm.diagnose(MOTOR, runs, noise_floor=NOISE, effects=effects)


@pytest.mark.parametrize(("slow", "lasting"), [(FirstOrderLag(time_constant=950.0), False), (Integrator(), True)])
def test_a_stable_plant_has_no_lasting_memory(slow, lasting):
    """A load behind a heater: what its temperature began at is gone at the end, though it came slowly."""
    blocks = {"heater": FirstOrderLag(time_constant=150.0), "load": slow}
    plant = tsm.Diagram(blocks=blocks, wires=["heater -> load"], inputs={"u": "heater"}, outputs={"y": "load"})
    t = np.arange(0.0, 1500.0, 5.0)
    record = tsm.Record("r", t, {"u": np.sin(t / 90.0), "y": np.zeros(len(t))}, {})
    settings = ModelSettings(None, {"y": 1.0}, ("y",), start_states=True)
    assert has_lasting_memory(plant, {"r": record}, settings) is lasting


def test_a_small_friction_is_seen_in_whole_recordings():
    """The initial states of pieces of a second absorb it."""
    found = diagnosed(*(recording(seed, 0.01) for seed in (1, 2, 3)))
    (effect,) = found.effects
    assert effect.name == "coulomb_friction"
    assert effect.parameters["friction.level"].value == pytest.approx(0.01, rel=0.1)
    assert found.base.parameters["motor.K"] == pytest.approx(GAIN, rel=0.01)
    assert not any("restarts" in note for note in found.notes)
    assert list(found.start_states) == ["r1", "r2", "r3"]


def test_where_errors_grow_a_large_friction_is_seen_in_pieces():
    found = diagnosed(*(recording(seed, 0.3) for seed in (1, 2)))
    assert [one.name for one in found.effects] == ["coulomb_friction"]
    assert any("restarts about every" in note for note in found.notes)


def test_an_error_that_does_not_grow_is_seen_in_whole_recordings_with_what_is_slow():
    """A cell whose resistance differs between its directions: pieces of 22 s took up a jump in one recording."""
    cell = tsm.loads(
        """
        format = 1
        title = "cell"
        wires = ["r0 -> v.minus1", "charge -> v.minus2", "ocv -> v.plus"]
        [blocks]
        r0 = { type = "Gain", gain = 0.035, unit = "V" }
        charge = { type = "Integrator", gain = 6e-5, unit = "V" }
        ocv = { type = "Constant", value = 3.72, unit = "V" }
        v = { type = "Sum", signs = "+--" }
        [inputs]
        i = { ports = ["r0.u", "charge.u"], unit = "A" }
        [outputs]
        v = { signal = "v", unit = "V" }
        """
    )
    runs, t = [], 0.2 * np.arange(1500)
    for seed in (1, 2, 3):
        draw = np.random.default_rng(seed)
        f, phase = draw.uniform(0.01, 0.3, 5), draw.uniform(0, 2 * np.pi, 5)
        i = 0.8 * np.sum(np.cos(2 * np.pi * f * t[:, None] + phase), axis=1)
        charge = np.cumsum(np.r_[0.0, (i[1:] + i[:-1]) / 2 * 0.2])
        v = 3.7 - (0.033 + 0.004 * np.sign(i)) * i - 6.7e-5 * charge
        v += (seed == 3) * 0.0012 * (t > 150.0) + draw.normal(0.0, 3e-4, len(t))
        runs.append(tsm.Record(f"r{seed}", t, {"i": i, "v": v}, {"i": "A", "v": "V"}))
    effects = ["asymmetric_gain", "even_nonlinearity", "odd_nonlinearity", "jump", "drift"]
    found = tsm.diagnose(cell, runs, free=["r0.gain", "charge.gain", "ocv.value"], effects=effects)
    assert not any("restarts" in note for note in found.notes)
    assert {one.name for one in found.effects} == {"asymmetric_gain", "jump"}
    assert found.augmented.parameters["charge.gain"] == pytest.approx(6.7e-5, rel=0.05)


def test_pieces_are_tried_from_the_longest_that_cuts_a_recording():
    t = np.arange(0.0, 40.0, 0.01)
    one = tsm.Record("one", t, {"x": t}, {"x": "rad"})
    assert piece_lengths({"one": one}) == [16.0, 4.0, 1.0]
    for length, count in ((16.0, 2), (4.0, 10), (1.0, 40)):
        pieces, windows = split_into_pieces({"one": one}, 0.0, length)
        assert len(pieces) == len(windows) == count


def test_a_smooth_saturation_of_the_amplifier_is_named():
    """A hard one leaves most of it, and drag that grows with the speed less."""
    runs = [recording(seed, 0.0, limit=10.0) for seed in (4, 5, 6)]
    (effect,) = diagnosed(*runs, effects=("saturation", "quadratic_drag")).effects
    assert (effect.name, effect.wire) == ("saturation", "u -> motor.u")
    assert "softness" in effect.parameters
