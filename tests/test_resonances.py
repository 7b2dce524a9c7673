"""Resonances that are fast, and in front of a hysteresis, in recordings made by integrating them independently."""

import itertools

import numpy as np
import pytest
from scipy.signal import lsim, lti

import tsmblocks as tsm
from tests.test_evidence import DEG, SIGMA, STEP, motion
from tsmblocks.blocks import Bias, Gain, Play

UNITS = {"x_in": "rad", "x_out": "rad"}
PLAY = tsm.Diagram(
    blocks={"gain": Gain(gain=0.85), "play": Play(half_width=0.02), "offset": Bias()},
    wires=["gain -> play -> offset"],
    inputs={"x_in": tsm.Inlet("gain.u", "rad")},
    outputs={"x_out": "offset"},
)
EFFECTS = ["resonance", "parameter_change", "drift", "jump", "dead_time", "first_order_lag"]


def through_mode(t, x, omega, zeta, feed):
    """What a mode with its damper partly on the base makes of a motion, from rest at its first value."""
    system = lti([2 * feed * zeta * omega, omega**2], [1, 2 * zeta * omega, omega**2])
    return x[0] + lsim(system, x - x[0], t)[1]


def recordings(omega, zeta, feed, gap):
    """A mode, a gain of 0.9 and a play of half width ``gap``, with noise; the motion has steps of 0.2 s."""
    draw, result = np.random.default_rng(7), {}
    for k in range(4):
        fine = np.arange(0.0, 24.0, STEP / 20)
        t, x = motion(k)
        x = np.interp(fine, t, x)
        for at in np.arange(2.0, 22.0, 4.0) + k:
            x = x + 4 * DEG * draw.choice([-1, 1]) * np.clip((fine - at) / 0.2, 0, 1)
        y = 0.9 * through_mode(fine, x, omega, zeta, feed)
        y = np.array([*itertools.accumulate(y, lambda z, u: min(max(z, u - gap), u + gap))])[::20]
        y = y + SIGMA * draw.standard_normal(len(y))
        result[f"run {k}"] = tsm.Record(f"run {k}", fine[::20], {"x_in": x[::20], "x_out": y}, UNITS)
    return result


@pytest.mark.parametrize(
    ("model", "gap", "omega"), [(PLAY, 0.03, 17.0), ("tendon_sheath_linear", 0.0, 48.0)], ids=["in front", "fast"]
)
def test_it_is_named_with_its_frequency(model, gap, omega):
    """In front of a play, whose changes it makes look sudden; and faster than a third of a radian in a sample."""
    records = recordings(omega, 0.1, 0.4, gap)
    found = tsm.diagnose(tsm.load(model) if isinstance(model, str) else model, records, effects=EFFECTS)
    assert [one.name for one in found.effects] == ["resonance"]
    assert found.complete
    (one,) = found.effects
    assert one.parameters["omega"].value == pytest.approx(omega, rel=0.05)
