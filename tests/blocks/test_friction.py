"""Friction blocks against their formulas, limits and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.blocks.helpers import assert_sound, rates, refuses, simulate, value
from tsmblocks.blocks.friction import (
    AsymmetricFriction,
    CoulombFriction,
    DahlFriction,
    LuGreFriction,
    QuadraticDrag,
    StribeckFriction,
    ViscousFriction,
)

ALL = [
    AsymmetricFriction,
    CoulombFriction,
    DahlFriction,
    LuGreFriction,
    QuadraticDrag,
    StribeckFriction,
    ViscousFriction,
]


@pytest.mark.parametrize("cls", ALL)
def test_sound(cls):
    assert_sound(cls())


@pytest.mark.parametrize("cls", [c for c in ALL if c is not AsymmetricFriction])
def test_friction_is_odd_and_positive_for_positive_velocity(cls):
    run = {s: simulate(cls(), {"v": lambda t, s=s: s * 0.5 * t}, stop=1.0, step=1e-3)["y"] for s in (1, -1)}
    assert np.abs(run[1] + run[-1]).max() < 1e-16
    assert np.all(run[1][1:] > 0)


def test_static_laws_are_their_formulas():
    for v in np.linspace(-0.5, 0.5, 21):
        assert value(ViscousFriction(coefficient=0.3), v=v)["y"] == pytest.approx(0.3 * v)
        assert value(QuadraticDrag(coefficient=0.3), v=v)["y"] == pytest.approx(0.3 * v * abs(v))
        coulomb = value(CoulombFriction(level=0.3, smoothing=0.02), v=v)["y"]
        assert coulomb == pytest.approx(0.3 * np.tanh(v / 0.02))
        p = StribeckFriction(coulomb=0.2, static=0.5, stribeck=0.1, viscous=0.03, smoothing=0.01)
        level = 0.2 + 0.3 * np.exp(-((v / 0.1) ** 2))
        assert value(p, v=v)["y"] == pytest.approx(level * np.tanh(v / 0.01) + 0.03 * v)


def test_asymmetric_friction_has_one_law_per_direction():
    p = AsymmetricFriction(
        level_positive=0.2, level_negative=0.5, viscous_positive=0.03, viscous_negative=0.07, smoothing=0.01
    )
    assert value(p, v=2.0)["y"] == pytest.approx(0.2 + 0.06, rel=1e-12)
    assert value(p, v=-2.0)["y"] == pytest.approx(-0.5 - 0.14, rel=1e-12)
    assert value(p, v=0.0)["y"] == 0.0


def test_asymmetric_friction_with_equal_sides_is_coulomb_and_viscous():
    p = AsymmetricFriction(
        level_positive=0.2, level_negative=0.2, viscous_positive=0.03, viscous_negative=0.03, smoothing=0.05
    )
    for v in np.linspace(-0.5, 0.5, 21):
        plain = value(CoulombFriction(level=0.2, smoothing=0.05), v=v)["y"] + 0.03 * v
        assert value(p, v=v)["y"] == pytest.approx(plain, abs=1e-15)


def test_dahl_friction_builds_up_in_closed_form():
    p = DahlFriction(sigma0=3.0, coulomb=0.05)
    run = simulate(p, {"v": lambda t: 0.2}, stop=1.0, step=1e-3)
    assert run["y"] == pytest.approx(0.05 * (1 - np.exp(-3.0 * 0.2 * run["t"] / 0.05)), abs=1e-9)


def test_dahl_friction_does_not_depend_on_the_rate():
    slow = simulate(DahlFriction(), {"v": lambda t: 0.1 * np.cos(t)}, stop=8.0, step=2e-3)["y"]
    quick = simulate(DahlFriction(), {"v": lambda t: 0.4 * np.cos(4 * t)}, stop=2.0, step=5e-4)["y"]
    assert np.abs(slow - quick).max() < 1e-13


def test_dahl_friction_holds_at_rest():
    run = simulate(DahlFriction(z=0.005), {"v": lambda t: 0.0}, stop=1.0, step=1e-2)
    assert np.all(run["y"] == 2.0 * 0.005)


@pytest.mark.parametrize("v", [-1.0, -0.05, 0.02, 0.1, 0.7])
def test_lugre_settles_on_its_stribeck_curve(v):
    p = LuGreFriction()
    run = simulate(p, {"v": lambda t: v}, stop=0.5 / abs(v) + 1.0, step=1e-3)
    level = p.coulomb + (p.static - p.coulomb) * np.exp(-((v / p.stribeck) ** 2))
    assert run["y"][-1] == pytest.approx(np.sign(v) * level + p.sigma2 * v, rel=1e-9)


def test_lugre_is_the_published_form():
    p = LuGreFriction()
    for z, v in np.random.default_rng(0).normal(scale=0.1, size=(50, 2)):
        g = p.coulomb + (p.static - p.coulomb) * np.exp(-((v / p.stribeck) ** 2))
        rate = v - p.sigma0 * abs(v) / g * z
        assert rates(p, {"z": z}, v=v)["z"] == pytest.approx(rate, rel=1e-12)
        force = p.sigma0 * z + p.sigma1 * rate + p.sigma2 * v
        assert value(p, {"z": z}, v=v)["y"] == pytest.approx(force, rel=1e-12)


def test_lugre_without_its_extras_is_dahl():
    lugre = LuGreFriction(sigma0=3.0, sigma1=0.0, sigma2=0.0, coulomb=0.05, static=0.05)
    dahl = DahlFriction(sigma0=3.0, coulomb=0.05)
    inputs = {"v": lambda t: 0.1 * np.cos(3 * t)}
    a, b = (simulate(p, inputs, stop=3.0, step=1e-3)["y"] for p in (lugre, dahl))
    assert np.abs(a - b).max() < 1e-15


def test_units_are_the_users_own():
    for cls in ALL:
        assert cls().inports["v"].unit == "?v"
        assert cls().outports["y"].unit == "?f"


@pytest.mark.parametrize(
    ("message", "cls", "values"),
    [
        (
            "CoulombFriction.level must lie in [0, inf), got -1. It is: friction while sliding.",
            CoulombFriction,
            dict(level=-1),
        ),
        (
            "CoulombFriction.smoothing must lie in (0, inf), got 0. It is: speed within which the force reverses.",
            CoulombFriction,
            dict(smoothing=0),
        ),
        (
            "StribeckFriction.stribeck must lie in (0, inf), got 0. It is: speed over which the static part falls.",
            StribeckFriction,
            dict(stribeck=0),
        ),
        (
            "LuGreFriction.coulomb must lie in (0, inf), got 0. It is: friction while sliding fast.",
            LuGreFriction,
            dict(coulomb=0),
        ),
        (
            "DahlFriction.sigma0 must be a number, got nan. It is: stiffness of the contact before it slides.",
            DahlFriction,
            dict(sigma0=float("nan")),
        ),
        (
            "ViscousFriction.coefficient must lie in [0, inf), got inf. It is: friction per velocity.",
            ViscousFriction,
            dict(coefficient=float("inf")),
        ),
    ],
)
def test_bad_values(message, cls, values):
    refuses(message, cls, **values)
