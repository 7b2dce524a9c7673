"""Plants that integrate: whole recordings where their errors stay small, pieces that begin anew where they grow."""

from __future__ import annotations

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.diagnosis.partition import piece_lengths, split_into_pieces

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
    assert any("restarts every" in note for note in found.notes)


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
