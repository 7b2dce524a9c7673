"""Effects in front of those that were named, and noise floors that cannot be: on a sheath made in NumPy alone."""

from functools import cache

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Play
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.noise_floor import NoiseFloors, doubtful_floors

SLOW_NEEDS = ["diagnosis", "diagrams/tendon_sheath_symmetric.toml"]
DEG = np.pi / 180
HALF, SLOPES, BENDS, NOISE = 1.2, (0.905, 0.93), 0.1, 0.06
"""The gap [deg], the slopes while loading and unloading, the speed [rad/s] at which they change, the noise [deg]."""


def gap(u, half):
    y, at = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        y[k] = at = min(max(at, value - half), value + half)
    return y


def sheath(x, v, step):
    """Eqs (8) and (9) with slopes that change more abruptly than the paper's, by Euler's method."""
    A, theta, delta = -0.80, 4.3, 0.05
    up, down = SLOPES
    slope = (up + down) / 2 + (up - down) / 2 * np.tanh(v / BENDS)
    zeta = np.zeros_like(x)
    for k in range(len(x) - 1):
        zeta[k + 1] = zeta[k] + step * (A * v[k] - theta * abs(v[k]) * zeta[k] + delta * abs(v[k]))
    return slope * x + zeta


@cache
def records(*, first="sheath"):
    """Tones that come nearly back after 15 s, 13 s and 13 s, but not quite; the gap is behind or in front."""
    rng, step, made = np.random.default_rng(77), 1e-3, {}
    t = np.arange(0.0, 40.0, step)
    for name, sizes, tones in (
        ("big", (45, 12), (0.2, 0.47)),
        ("mid", (20, 9), (0.31, 0.77)),
        ("small", (8, 4), (0.23, 0.9)),
    ):
        x = sum(a * np.sin(2 * np.pi * f * t) for a, f in zip(sizes, tones, strict=True)) * np.minimum(t, 1) * DEG
        if first == "sheath":
            y = gap(sheath(x, np.gradient(x, step), step), HALF * DEG)
        else:
            moved = gap(x, HALF * DEG)
            y = sheath(moved, np.gradient(moved, step), step)
        few = slice(None, None, 20)
        seen = y[few] / DEG + rng.normal(0, NOISE, len(t[few]))
        made[name] = tsm.Record(name, t[few], {"x_in": x[few] / DEG, "x_out": seen}, {"x_in": "deg", "x_out": "deg"})
    return made


def found(floor):
    base, effects = tsm.load("tendon_sheath_symmetric"), ["backlash", "asymmetric_hysteresis"]
    return tsm.diagnose(base, records(), noise_floor=floor, effects=effects)


def test_what_stands_in_front_of_a_gap_is_placed_there_and_no_gap_of_nothing_is_named():
    said = found(f"{NOISE} deg")
    assert {e.name for e in said.effects} == {"backlash", "asymmetric_hysteresis"}
    wires = {".".join(x.source): x.target[0] for x in said.augmented.links}
    assert wires["asymmetric_hysteresis.y"] == "backlash"
    half = said.augmented.parameters["backlash.half_width"] / DEG
    assert half == pytest.approx(HALF, rel=0.02)
    change = said.augmented.parameters["asymmetric_hysteresis.slope_difference"]
    assert change == pytest.approx(SLOPES[0] - SLOPES[1], rel=0.05)
    assert said.augmented.parameters["asymmetric_hysteresis.speed"] == pytest.approx(BENDS, rel=0.15)
    (held,) = said.segments[0].gaps
    assert held.held_out[-1] == pytest.approx(NOISE * DEG, rel=0.05)


@pytest.mark.slow
def test_what_stands_behind_a_gap_reads_what_comes_out_of_it():
    base, effects = tsm.load("tendon_sheath_symmetric"), ["backlash", "asymmetric_hysteresis"]
    said = tsm.diagnose(base, records(first="gap"), noise_floor=f"{NOISE} deg", effects=effects)
    assert [e.name for e in said.effects] == ["backlash", "asymmetric_hysteresis"]
    links = {str(link) for link in said.augmented.links}
    assert {"backlash.y -> tsm.x", "backlash.y -> asymmetric_hysteresis.x"} <= links
    assert said.augmented.parameters["backlash.half_width"] / DEG == pytest.approx(HALF, rel=0.02)
    change = said.augmented.parameters["asymmetric_hysteresis.slope_difference"]
    assert change == pytest.approx(SLOPES[0] - SLOPES[1], rel=0.05)
    (held,) = said.segments[0].gaps
    assert held.held_out[-1] < 1.5 * NOISE * DEG < 0.3 * held.held_out[0]


def test_a_floor_that_is_looked_for_is_that_of_the_sensor():
    said = found(None)
    assert said.verdict == "named"
    assert said.segments[0].gaps[0].noise_floor == pytest.approx(NOISE * DEG, rel=0.05)


def test_a_floor_above_what_the_model_leaves_is_doubted():
    said = found(f"{NOISE} rad")
    assert said.verdict == "none"
    assert said.sentence.endswith("But the noise floor given for x_out is implausible: the residual is smaller.")
    (note,) = [n for n in said.notes if "noise floor" in n]
    assert note.startswith("the noise floor given for x_out (3.44 deg) is above the residual of the base (0.3")
    assert note.endswith("deg rms), so no effect can be found: is it in the right unit (rad)?")


def test_a_floor_found_above_what_the_model_leaves_gives_way(monkeypatch):
    """Whatever says so, noise that the model explains is none."""
    from tsmblocks.data import Noise
    from tsmblocks.diagnosis import noise_floor as noise_module

    fooled = Noise("x_out", "rad", 1.16 * DEG, None, "repeated periods", 1000, 900)
    monkeypatch.setattr(noise_module, "noise_over_recordings", lambda *_, **__: fooled)
    said = found(None)
    assert said.verdict == "named"
    (note,) = [n for n in said.notes if "noise floor" in n]
    assert note == (
        "the noise of x_out estimated from repeated periods, 1.16 deg rms, is not all noise: the residual of the base "
        "model, which contains all of it, is 0.353 deg rms. Taken for the noise floor instead: the fast noise, 0.0619 "
        "deg rms."
    )


def test_a_floor_above_what_the_final_model_leaves_is_doubted():
    sigma = {"x_out": 1.2 * DEG}
    found_in = NoiseFloors(sigma, {"x_out": "repeated periods"})
    assert doubtful_floors(found_in, {"x_out": 0.8}, {"x_out": "rad"}) == [
        "the noise floor of x_out estimated from repeated periods, 1.2 deg rms, is too high: the residual of the final "
        "model, which contains all noise, is smaller (0.96 deg rms). Small effects may be missed. Give the noise if "
        "you know it."
    ]
    assert doubtful_floors(found_in, {"x_out": 0.95}, {"x_out": "rad"}) == []
    for method in ("given", "high frequencies"):
        assert doubtful_floors(NoiseFloors(sigma, {"x_out": method}), {"x_out": 0.5}, {"x_out": "rad"}) == []


def test_wires_in_front_of_blocks_that_were_named_are_places_too():
    model = (
        tsm.load("tendon_sheath_symmetric")
        .insert("gap", Play(), after="offset.y")
        .insert("more", Gain(), after="gap.y")
    )
    plain = insertion_points(model, ["x_out"])
    further = [s for s in insertion_points(model, ["x_out"], named={"gap", "more"}) if s not in plain]
    assert [(s.place, s.signal, s.before) for s in further] == [
        ("output", "offset.y", "gap.u"),
        ("across", "offset.y", "gap.u"),
    ]
    assert [s for s in insertion_points(model, ["x_out"], named={"gap"}) if s not in plain] == []
