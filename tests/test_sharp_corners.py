"""Dry friction that holds a body at rest, made in NumPy: its corner is sharper than the bound of the candidates."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum, ViscousFriction

MASS, DAMPING, STIFFNESS, FRICTION, NOISE = 2.0, 9.0, 350.0, 1.2, 5e-5
STAGE = tsm.Diagram(
    title="stage",
    blocks={
        "net": Sum(signs="+--"),
        "inertia": Gain(gain=1.0, unit="m/s^2"),
        "speed": Integrator(),
        "travel": Integrator(),
        "spring": Gain(gain=100.0, unit="N"),
        "damper": ViscousFriction(coefficient=3.0),
    },
    wires=["net -> inertia -> speed -> travel", "travel -> spring -> net.minus1", "speed -> damper -> net.minus2"],
    inputs={"force": tsm.Inlet(("net.plus",), "N", "")},
    outputs={"x": "travel"},
)


def recorded(name, share, seed):
    """A body that sticks exactly until the drive exceeds its friction, by Euler's method in 200 steps a sample."""
    t, fine = 0.005 * np.arange(1600), 200
    force = share * (6 * np.sin(2.1 * t) + 4 * np.sin(7.7 * t + 0.3) + 3 * np.sin(15 * t))
    x = v = 0.0
    places = []
    step = 0.005 / fine
    for now, then in zip(force.tolist(), [*force[1:].tolist(), float(force[-1])], strict=True):
        places.append(x)
        for k in range(fine):
            drive = now + (then - now) * k / fine - STIFFNESS * x - DAMPING * v
            if v == 0 and abs(drive) <= FRICTION:
                continue
            way = 1.0 if v > 0 or (v == 0 and drive > 0) else -1.0
            faster = v + step * (drive - FRICTION * way) / MASS
            v = 0.0 if v * faster < 0 else faster
            x += step * v
    noisy = np.array(places) + np.random.default_rng(seed).normal(0.0, NOISE, t.size)
    return tsm.Record(name, t, {"force": force, "x": noisy}, {"force": "N", "x": "m"})


@pytest.fixture(scope="module")
def found():
    records = [recorded("big", 1.0, 12), recorded("small", 0.5, 13)]
    return tsm.diagnose(STAGE, records, effects=["coulomb_friction", "stribeck_friction"])


def test_no_second_friction_is_named_for_the_creep_of_a_smooth_one(found):
    (friction,) = found.effects
    assert friction.name == "coulomb_friction"
    assert found.worst.complete
    held = friction.as_force["friction"].partition(" N ")[0]
    value, half = (float(one) for one in held.split(" ± "))
    assert abs(value - FRICTION) < 2.5 * half < 0.01 * FRICTION


def test_a_corner_that_is_sharp_is_no_caution(found):
    said = " ".join([str(found), found.details()])
    assert "lower bound of coulomb_friction.friction.smoothing" not in " ".join(said.split())
    assert not [note for note in found.notes if "smoothing" in note]
