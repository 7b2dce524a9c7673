"""An axis of two masses, driven by a force that is measured with noise: a random walk common to both encoders."""

from functools import cache

import numpy as np
import pytest

import tsmblocks as tsm

SLOW_NEEDS = ["diagnosis"]
STEP, SUB, SAMPLES = 1e-3, 20, 2000
MASSES, SPRING, DAMPER, FRICTION = (8.0, 13.0), 4.2e5, 110.0, (280.0, 90.0)
AXIS = """
format = 1
title = "two masses"
wires = [
  "net1 -> inv1 -> v1 -> x1 -> twist.plus",
  "v1 -> fric1 -> net1.minus1",
  "twist -> spring -> shaft.plus1",
  "v1 -> rate.plus",
  "rate -> damper -> shaft.plus2",
  "shaft -> net1.minus2, net2.plus",
  "net2 -> inv2 -> v2 -> x2 -> twist.minus",
  "v2 -> rate.minus, fric2",
  "fric2 -> net2.minus",
]
[blocks]
net1 = { type = "Sum", signs = "+--" }
inv1 = { type = "Gain", gain = 0.13, unit = "m/s^2" }
v1 = { type = "Integrator" }
x1 = { type = "Integrator" }
fric1 = { type = "ViscousFriction", coefficient = 250.0 }
twist = { type = "Sum", signs = "+-" }
rate = { type = "Sum", signs = "+-" }
spring = { type = "Gain", gain = 3.5e5, unit = "N" }
damper = { type = "Gain", gain = 130.0, unit = "N" }
shaft = { type = "Sum", signs = "++" }
net2 = { type = "Sum", signs = "+-" }
inv2 = { type = "Gain", gain = 0.06, unit = "m/s^2" }
v2 = { type = "Integrator" }
x2 = { type = "Integrator" }
fric2 = { type = "ViscousFriction", coefficient = 110.0 }

[inputs]
F = { ports = "net1.plus", unit = "N" }

[outputs]
x1 = "x1"
x2 = "x2"
"""


@cache
def measured(seed, slow, gap=0.0):
    """Force [N] with noise of 1 N, or of 0.3 N with a correlation time ``slow`` [s], and positions [m] with 1 um."""
    draw, h = np.random.default_rng(seed), STEP / SUB
    t = h * np.arange(SAMPLES * SUB)
    tones = zip(draw.uniform(20, 60, 6), draw.uniform(0.4, 12, 6), draw.uniform(0, 6, 6), strict=True)
    force = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    x1 = x2 = v1 = v2 = 0.0
    seen = np.empty((SAMPLES, 2))
    for k, driving in enumerate(force.tolist()):
        if k % SUB == 0:
            seen[k // SUB] = x1, x2
        twist = x1 - x2
        twist -= min(max(twist, -gap), gap)
        shaft = SPRING * twist + DAMPER * (v1 - v2 if twist or not gap else 0.0)
        v1 += h * (driving - shaft - FRICTION[0] * v1) / MASSES[0]
        v2 += h * (shaft - FRICTION[1] * v2) / MASSES[1]
        x1, x2 = x1 + h * v1, x2 + h * v2
    noise = draw.standard_normal(SAMPLES)
    if slow:
        kept = np.exp(-STEP / slow)
        for k in range(1, SAMPLES):
            noise[k] = kept * noise[k - 1] + 0.3 * np.sqrt(1 - kept**2) * noise[k]
    x1, x2 = seen.T + 1e-6 * draw.standard_normal((2, SAMPLES))
    return tsm.Record(f"run_{seed}", t[::SUB], dict(F=force[::SUB] + noise, x1=x1, x2=x2), dict(F="N", x1="m", x2="m"))


@pytest.mark.parametrize("slow", [0.0, 0.002])
@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 9))])
def test_noise_of_the_force_is_no_effect(seed, slow):
    """A jump of 0.1 mm was named, and where the noise is slower a resonance."""
    effects = ["jump", "resonance", "presliding_friction", "load_offset"] if seed < 3 else None
    found = tsm.diagnose(tsm.loads(AXIS), measured(seed, slow), effects=effects)
    assert (found.verdict, found.effects) == ("none", ())


def test_a_gap_smaller_than_that_random_walk_is_named():
    """It was not seen beside a residual of 0.025 mm, which is all that noise of the force leaves."""
    found = tsm.diagnose(tsm.loads(AXIS), measured(1, 0.0, gap=15e-6), effects=["backlash", "jump", "coulomb_friction"])
    (one,) = found.effects
    assert one.name == "backlash"
    width = one.sizes["gap width"]
    assert width.value == pytest.approx(30e-6, rel=0.1)
    assert width.unit == "m"
