"""Friction of a tendon in its sheath is named, and with its size, on data of a mechanism with an elastic wire."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Gain
from tsmblocks.model.diagram import Diagram

PRETENSION, WIRE, TIP = 9.0, 10.0, 2.5
"""Pretension [N], stiffness of the wire and of the spring at the tip [N/mm]."""
FRICTION, RATIO, NOISE = 0.12, 12.0, 0.3
"""Coefficient of friction times bend angle; tip angle [deg/mm] and its noise [deg]."""
DRIVE = Diagram(
    title="Tendon drive",
    blocks={"ratio": Gain(gain=np.deg2rad(11.0) * 1e3, unit="rad"), "zero": Bias(bias=0.0)},
    wires=["ratio -> zero"],
    inputs={"wire": tsm.Inlet("ratio.u", unit="m")},
    outputs={"tip": "zero"},
)
EFFECTS = ["capstan_friction", "backlash", "hysteresis", "position_dependent_friction", "dead_time", "dead_zone"]


def recorded(amplitude, seed):
    """A recording [mm, deg]: the end of the tendon rests while the tensions on both sides are within the band."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.001)
    x = amplitude * np.sin(2 * np.pi * 0.21 * t + seed) + 0.4 * amplitude * np.sin(2 * np.pi * 0.83 * t)
    grip, z, moved = np.exp(FRICTION), 0.0, np.empty(t.size)
    for k, drawn in enumerate(x):
        pulled = (PRETENSION + WIRE * drawn - PRETENSION * grip) / (WIRE + TIP * grip)
        released = (PRETENSION + WIRE * drawn - PRETENSION / grip) / (WIRE + TIP / grip)
        z = min(max(z, pulled), released)
        moved[k] = z
    tip = RATIO * moved * (WIRE + TIP) / WIRE + rng.normal(0, NOISE, t.size)
    signals = {"wire": x[::20], "tip": tip[::20]}
    return tsm.Record(f"run{seed}", t[::20], signals, {"wire": "mm", "tip": "deg"})


@pytest.fixture(scope="module")
def found():
    return tsm.diagnose(DRIVE, [recorded(2.0, 1), recorded(0.9, 2)], effects=EFFECTS)


def test_friction_in_proportion_to_the_tension_is_named(found):
    (effect,) = found.effects
    assert effect.name == "capstan_friction"
    assert found.complete


def test_its_band_is_that_of_the_mechanism(found):
    """The band at rest, and its growth with the motion, from the balance of tensions at both edges."""
    (effect,) = found.effects
    mu, tension = (effect.parameters[name] for name in ("mu", "pretension"))
    assert effect.wire == "zero.y -> tip"
    share = TIP / (WIRE + TIP)
    assert mu.value == pytest.approx(FRICTION * share, rel=0.1)
    assert mu.low < FRICTION * share < mu.high
    slackens = PRETENSION * (WIRE + TIP) / (TIP * WIRE)
    assert tension.low < np.deg2rad(RATIO * slackens) < tension.high
