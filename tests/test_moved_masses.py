"""A mass that a measured force moves: it runs against a stop, or becomes heavier. Data by SciPy, other equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator, Sum, ViscousFriction

STEP, NOISE = 0.005, 2e-5
MASS, FRICTION = 4.0, 30.0
STIFFNESS, DAMPING, STOP = 2e4, 60.0, 0.05
SLED = tsm.Diagram(
    title="Sled",
    blocks={
        "net": Sum(signs="+-"),
        "rate": Gain(gain=0.2, unit="m/s^2"),
        "speed": Integrator(),
        "friction": ViscousFriction(coefficient=20.0),
        "place": Integrator(),
    },
    wires=["net -> rate -> speed -> place", "speed -> friction -> net.minus"],
    inputs={"force": tsm.Inlet("net.plus", unit="N")},
    outputs={"x": "place"},
)
FREE = ["rate.gain", "friction.coefficient"]


def recorded(seed, stop=False, heavier=1.0):
    """Sines and a slow push; beside the stop a spring, and a damper that resists compression alone."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(1200)
    phases = rng.uniform(0, 2 * np.pi, 4)

    def force(s):
        return sum(
            a * np.sin(2 * np.pi * f * s + p)
            for a, f, p in zip((9, 6, 5, 4), (0.3, 0.7, 1.3, 2.1), phases, strict=True)
        )

    def rates(s, z):
        beyond = z[0] - STOP
        contact = STIFFNESS * beyond + DAMPING * max(z[1], 0.0) if stop and beyond > 0 else 0.0
        mass = MASS * (heavier if s > 3.3 else 1.0)
        return z[1], (force(s) - FRICTION * z[1] - contact) / mass

    x = solve_ivp(rates, (0, t[-1]), (0.0, 0.0), t_eval=t, max_step=STEP / 5, rtol=1e-8, atol=1e-10).y[0]
    measured = {"force": force(t), "x": x + rng.normal(0, NOISE, t.size)}
    return tsm.Record(f"run{seed}", t, measured, {"force": "N", "x": "m"})


@pytest.fixture(scope="module")
def stopped():
    effects = ["end_stop", "odd_nonlinearity", "stiffness", "coulomb_friction", "jump"]
    return tsm.diagnose(SLED, recorded(1, stop=True), free=FREE, effects=effects)


def test_a_stop_at_one_end_is_named_with_its_place_and_no_stop_at_the_other(stopped):
    assert [one.words.partition(" (")[0] for one in stopped.effects] == ["an end stop"]
    (effect,) = stopped.effects
    assert set(effect.sizes) == {"upper stop", "stiffness", "damping over stiffness"}
    assert effect.sizes["upper stop"].value == pytest.approx(STOP, abs=5e-4)
    assert effect.sizes["stiffness"].value == pytest.approx(STIFFNESS / MASS, rel=0.15)
    assert 0.3 < effect.sizes["damping over stiffness"].value / (1e3 * DAMPING / STIFFNESS) < 1.1


def test_a_mass_that_becomes_heavier_is_a_change_where_the_force_moves_it():
    effects = ["parameter_change", "end_stop", "viscous_friction", "jump", "drift"]
    (effect,) = tsm.diagnose(SLED, recorded(2, heavier=1.5), free=FREE, effects=effects).effects
    assert (effect.name, effect.wire) == ("parameter_change", "rate.y -> speed.u")
    change = effect.sizes["change of the gain"]
    assert change.low < 100 * (1 / 1.5 - 1) < change.high
    assert effect.sizes["time"].value == pytest.approx(3.3, abs=0.03)
