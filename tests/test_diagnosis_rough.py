"""A base far from the measurements: friction that is large beside all else, of a load behind a spring."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum

SLOW_NEEDS = ["diagnosis"]
STEP, SUBSTEPS, FRICTION = 0.01, 100, 4.0


def drive():
    """Motor and load, two masses with a spring and a damper, with parameters that are up to a quarter off."""
    return tsm.Diagram(
        blocks={
            "net": Sum(signs="+--"),
            "motor": Gain(gain=1.6, unit="m/s^2"),
            "v1": Integrator(unit="m/s"),
            "x1": Integrator(unit="m"),
            "drag": Gain(gain=1.5, unit="N"),
            "stretch": Sum(signs="+-"),
            "rate": Sum(signs="+-"),
            "spring": Gain(gain=1000.0, unit="N"),
            "damper": Gain(gain=3.0, unit="N"),
            "force": Sum(signs="++"),
            "load": Gain(gain=1.2, unit="m/s^2"),
            "v2": Integrator(unit="m/s"),
            "x2": Integrator(unit="m"),
        },
        wires=[
            "net -> motor -> v1 -> x1 -> stretch.plus",
            "v1 -> drag -> net.minus1",
            "v1 -> rate.plus",
            "stretch -> spring -> force.plus1",
            "rate -> damper -> force.plus2",
            "force -> net.minus2",
            "force -> load -> v2 -> x2 -> stretch.minus",
            "v2 -> rate.minus",
        ],
        inputs={"f": tsm.Inlet(["net.plus"], unit="N")},
        outputs={"x1": "x1", "x2": "x2"},
    )


def recorded(seed):
    """The same mechanism with dry friction of the load, which sticks, under a sampled controller."""
    t, h = np.arange(0, 8, STEP), STEP / SUBSTEPS
    x1 = v1 = x2 = v2 = 0.0
    rows = []
    for now in t:
        wanted = 0.05 * np.sin(2 * np.pi * 0.5 * now) + 0.03 * np.sin(2 * np.pi * 1.3 * now)
        f = float(np.clip(300 * (wanted - x1) - 12 * v1, -30, 30))
        rows.append((f, x1, x2))
        for _ in range(SUBSTEPS):
            force = 800 * (x1 - x2) + 4 * (v1 - v2)
            v1 += h * (f - 2 * v1 - force) / 0.5
            free = v2 + h * force
            v2 = 0.0 if abs(free) <= h * FRICTION else free - np.sign(free) * h * FRICTION
            x1, x2 = x1 + h * v1, x2 + h * v2
    f, x1, x2 = np.array(rows).T
    noise = 2e-5 * np.random.default_rng(seed).standard_normal((2, len(t)))
    return tsm.Record("run", t, {"f": f, "x1": x1 + noise[0], "x2": x2 + noise[1]}, {"f": "N", "x1": "m", "x2": "m"})


@pytest.mark.slow
def test_friction_that_is_large_beside_all_else_is_found_where_it_is():
    """The masses were fitted hundreds of times off without it, and from there a dead zone of the drive was named."""
    effects = ["coulomb_friction", "dead_zone", "viscous_friction"]
    free = ["motor.gain", "drag.gain", "spring.gain", "damper.gain", "load.gain"]
    found = tsm.diagnose(drive(), {"a": recorded(0), "b": recorded(1)}, free=free, effects=effects)
    (effect, *others) = found.effects
    assert (effect.name, others) == ("coulomb_friction", [])
    assert effect.wire.startswith("load")
    values = found.augmented.parameters
    assert values["load.gain"] == pytest.approx(1.0, rel=0.1)
    assert values["spring.gain"] == pytest.approx(800, rel=0.05)
    assert values["coulomb_friction.friction.level"] / values["load.gain"] == pytest.approx(FRICTION, rel=0.02)
    (segment,) = found.segments
    assert segment.in_doubt == ()
