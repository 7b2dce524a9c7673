"""Measured inputs made ready: noise is taken out, rests are held still, and motion is left as it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.blocks import AsymmetricBoucWen, Play
from tsmblocks.common.errors import DataError
from tsmblocks.data.conditioning import BLEND_SAMPLES, REST_BAND, all_conditioned, conditioned, held_at_rest, rests

STEP, NOISE = 0.01, 1e-3
T = np.arange(0.0, 20.0, STEP)
STAIRS = np.interp(T, [0, 2, 3, 6, 7, 10, 11, 14, 15, 20], [0, 0, 0.5, 0.5, -0.3, -0.3, 0.2, 0.2, -0.5, -0.5])
SINE = 0.8 * np.sin(2 * np.pi * 0.2 * T)


def noisy(x, seed=0, size=NOISE):
    return x + size * np.random.default_rng(seed).standard_normal(len(x))


def record(x, t=T, **more):
    return tsm.Record("rig", t, {"x_in": x, **more}, {"x_in": "rad"})


def path(x):
    """What hysteresis and friction integrate."""
    return float(np.abs(np.diff(x)).sum())


def behind(block, x):
    diagram = tsm.Diagram(blocks={"b": block}, inputs={"x_in": "b"}, outputs={"y": "b"})
    return tsm.simulate(diagram, inputs={"x_in": (T, x)}, stop=T[-1], step=STEP, hold="cubic")["y"]


def rms(x):
    return float(np.sqrt(np.mean(x**2)))


# ---- rests


@pytest.mark.parametrize("seed", range(5))
def test_noise_at_rest_does_not_move_hysteresis(seed):
    made = conditioned(record(noisy(STAIRS, seed)), ["x_in"])["x_in"]
    assert path(noisy(STAIRS, seed)) > 1.5 * path(STAIRS)
    assert path(made) == pytest.approx(path(STAIRS), rel=0.01)
    clean = behind(AsymmetricBoucWen(), STAIRS)
    assert rms(behind(AsymmetricBoucWen(), noisy(STAIRS, seed)) - clean) > 30 * NOISE
    assert rms(behind(AsymmetricBoucWen(), made) - clean) < 1.5 * NOISE


def test_an_encoder_at_rest():
    """At rest an encoder dithers between two counts."""
    count = 2 * np.pi / 4000
    made = conditioned(record(np.round(noisy(STAIRS, 3, 0.5 * count) / count) * count), ["x_in"])["x_in"]
    assert path(made) == pytest.approx(path(STAIRS), rel=0.01)
    assert np.abs(made - STAIRS).max() < 3 * count


def test_a_signal_that_never_moves_is_held_at_its_mean():
    x = noisy(np.full(len(T), 0.3))
    made = conditioned(record(x), ["x_in"])
    assert path(made["x_in"]) < 0.1 * NOISE
    assert made["x_in"] == pytest.approx(0.3, abs=0.2 * NOISE)
    assert made.notes[-1] == "x_in was held constant where it moves no more than its noise (100 % of the samples)."


@pytest.mark.parametrize(("begin", "end"), [(300, 700), (0, 400), (1500, 1999)])
def test_rests_are_found_where_they_are(begin, end):
    x = np.interp(np.arange(2000), [0, begin, end, 1999], [-1.0 * begin, 0, 0, 1999.0 - end]) * 5e-3
    (one,) = rests(x, NOISE, 25, 150)
    assert abs(one.start - begin) <= 1
    assert abs(one.stop - end) <= 2


@given(st.integers(0, 10_000), st.integers(60, 300), st.floats(0.35, 3.0))
def test_what_is_held_is_the_mean_and_what_moves_stays(seed, length, speed):
    """Rests between two ramps: the samples away from their ends are the mean or the signal.

    Below 0.31 a sample of the slow ramp lies within the noise now and then (2 of 6000 draws).
    """
    ramp = speed * STEP * np.arange(200)
    x = noisy(np.concatenate([ramp - ramp[-1], np.zeros(length), ramp]), seed, 0.2 * NOISE)
    made, share = held_at_rest(x, STEP, NOISE)
    found = rests(x, NOISE, 25, 150)
    first, last = found[0].start, found[-1].stop
    assert abs(first - 199) <= 2
    assert -25 < last - 200 - length <= 2  # a rest that began with the end of the ramp may leave a piece too short
    assert share == pytest.approx(sum(one.stop - one.start for one in found) / len(x))
    for one in found:
        assert made[one] == pytest.approx(x[one].mean())
    assert np.array_equal(made[: first - BLEND_SAMPLES], x[: first - BLEND_SAMPLES])
    assert np.array_equal(made[last + BLEND_SAMPLES :], x[last + BLEND_SAMPLES :])
    assert np.abs(made - x).max() <= REST_BAND * NOISE


@pytest.mark.parametrize("seed", range(8))
def test_slow_noise_does_not_move_what_rests(seed):
    """Noise of which half is slow (0.1 s) seems to drift for a while; a long rest is held all the same."""
    rng, slow = np.random.default_rng(seed), np.zeros(1400)
    for k in range(1, 1400):
        slow[k] = 0.9 * slow[k - 1] + math.sqrt(1 - 0.9**2) * rng.standard_normal()
    ramp = 0.8 * STEP * np.arange(200)
    x = np.concatenate([ramp - ramp[-1], np.zeros(1000), ramp])
    raw = record(x + NOISE * math.sqrt(0.5) * (slow + rng.standard_normal(1400)), STEP * np.arange(1400))
    made = conditioned(raw, ["x_in"])["x_in"]
    assert path(made[200:1200]) < 0.3 * path(raw.filtered(["x_in"])["x_in"][200:1200])


def test_a_turn_is_no_rest():
    turning = 0.3 * np.abs((T / 2.5) % 2 - 1)
    assert rests(turning, NOISE, 25, 150) == []
    assert rests(0.02 * np.abs((T / 2.5) % 2 - 1), NOISE, 25, 150) == []


# ---- motion


@pytest.mark.parametrize("speed", [0.003, 0.01, 0.03, 0.1, 0.5])
def test_slow_motion_is_no_rest(speed):
    """A slow ramp must not become a staircase."""
    x = speed * 2.5 * np.abs((T / 2.5) % 2 - 1)
    raw = record(noisy(x))
    made = conditioned(raw, ["x_in"])
    assert np.array_equal(made["x_in"], raw.filtered(["x_in"])["x_in"])
    assert rms(made["x_in"] - x) < 0.7 * NOISE


def test_a_clean_signal_is_left_alone():
    made = conditioned(record(SINE), ["x_in"])
    assert made["x_in"] == pytest.approx(SINE, abs=1e-6)


def test_what_a_play_makes_of_it():
    made = conditioned(record(noisy(SINE)), ["x_in"])["x_in"]
    block = Play(half_width=0.1)
    assert rms(behind(block, made) - behind(block, SINE)) < 0.4 * NOISE
    assert rms(behind(block, noisy(SINE)) - behind(block, SINE)) > 0.9 * NOISE


def test_other_signals_and_the_record_given_stay_as_they_are():
    raw = record(noisy(SINE), x_out=noisy(STAIRS, 5))
    before = raw["x_in"].copy()
    made = conditioned(raw, ["x_in"])
    assert np.array_equal(made["x_out"], raw["x_out"])
    assert np.array_equal(raw["x_in"], before)
    assert not np.array_equal(made["x_in"], before)
    assert (made.name, made.units) == (raw.name, raw.units)


def test_every_record_is_made_ready_by_itself():
    raw = {"a": record(noisy(SINE)), "b": record(noisy(STAIRS))}
    made = all_conditioned(raw, iter(["x_in"]))
    assert list(made) == ["a", "b"]
    for name, one in made.items():
        assert np.array_equal(one["x_in"], conditioned(raw[name], ["x_in"])["x_in"])


# ---- odd records


def test_a_constant_signal_and_one_that_is_not_there():
    raw = record(np.full(len(T), 0.3))
    assert conditioned(raw, ["x_in"]) is raw
    assert conditioned(raw, ["u"]) is raw
    assert conditioned(raw, []) is raw


def test_a_short_record():
    raw = record(noisy(SINE)[:15], T[:15])
    assert conditioned(raw, ["x_in"]) is raw
    longer = conditioned(record(noisy(SINE)[:16], T[:16]), ["x_in"])
    assert np.isfinite(longer["x_in"]).all()


def test_uneven_samples_are_put_on_an_even_grid_first():
    t = np.sort(T + np.random.default_rng(2).uniform(-0.003, 0.003, len(T)))
    raw = record(noisy(0.8 * np.sin(2 * np.pi * 0.2 * t)), t)
    made = conditioned(raw, ["x_in"])
    assert not raw.uniform
    assert made.uniform
    assert rms(made["x_in"] - 0.8 * np.sin(2 * np.pi * 0.2 * made.t)) < 0.7 * NOISE


@pytest.mark.parametrize("gap", [np.nan, np.inf])
@pytest.mark.parametrize("which", ["x_in", "x_out"])
def test_a_diagnosis_says_where_a_sample_is_missing(which, gap):
    """Before anything is filtered, after which every sample would be missing."""
    signals = {"x_in": SINE, "x_out": noisy(SINE)}
    signals[which] = np.where(np.arange(len(T)) == 7, gap, signals[which])
    with pytest.raises(DataError) as caught:
        tsm.diagnose(tsm.load("tendon_sheath_linear"), record(signals["x_in"], x_out=signals["x_out"]))
    assert str(caught.value) == f"experiment 'rig': sample 7 of {which} is not finite (t = 0.07 s, value = {gap})."


@pytest.mark.parametrize(
    ("what", "call"),
    [
        ("filtering", lambda r: r.filtered(["x_in"])),
        ("differentiating", lambda r: r.differentiated("x_in")),
        ("resampling", lambda r: r.resampled(0.02)),
    ],
)
def test_what_would_spread_a_missing_sample_says_where_it_is(what, call):
    gap = record(np.where(np.arange(len(T)) == 7, np.nan, SINE), x_out=SINE)
    with pytest.raises(DataError) as caught:
        call(gap)
    assert str(caught.value) == (
        f"rig: sample 7 of x_in is not finite (t = 0.07 s, value = nan), and {what} needs every sample."
    )


def test_a_gap_of_nan_is_refused_by_who_reads():
    with pytest.raises(DataError) as caught:
        tsm.fit(tsm.load("tendon_sheath_linear"), record(np.where(np.arange(len(T)) == 7, np.nan, SINE), x_out=SINE))
    assert str(caught.value) == "experiment 'rig': sample 7 of x_in is not finite (t = 0.07 s, value = nan)."


def test_no_noise_no_rest():
    made, share = held_at_rest(STAIRS, STEP, 0.0)
    assert np.array_equal(made, STAIRS)
    assert share == 0.0
    assert made is not STAIRS
