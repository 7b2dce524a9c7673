"""Intervals and kinds of noise from ``noise``, on draws whose noise is known (tests/benchmarks/noise_floors.py)."""

import sys
from pathlib import Path

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.data import Noise, noise_floor
from tsmblocks.data.noise_floor import noise_of_recordings, noise_over_recordings
from tsmblocks.data.noise_methods import STILL_MOVING, Found
from tsmblocks.data.slow_noise import Stretch

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from noise_floors import SIGMA, draw, first_order

STEP = 0.01


def drawn(family, motion, count=24):
    """Floors, lower and upper ends over the true rms, and the doubts, of some draws."""
    rows = [draw(family, motion, seed) for seed in range(count)]
    values = np.array([row[0] for row in rows]) / np.sqrt(np.mean([row[3] for row in rows]))
    return values.T, [row[1] for row in rows], [row[2] for row in rows]


@pytest.mark.parametrize(
    ("family", "motion", "spread"),
    [
        ("white", "two", 0.05),
        ("white and 0.1 s", "two", 0.07),
        ("white and 0.5 s", "two", 0.1),
        ("slow 0.5 s", "two", 0.15),
        ("white and 0.5 s", "many", 0.1),
        ("white and 0.5 s", "transient", 0.15),
        ("white", "transient", 0.05),
        ("white and 0.5 s", "repeats", 0.07),
        ("white and 0.5 s", "rests", 0.1),
        ("two scales", "many", 0.1),
        ("hum", "rests", 0.05),
    ],
)
def test_the_truth_lies_in_the_interval(family, motion, spread):
    """In most draws, and in the median the floor is the truth, whatever the noise is made of."""
    (floor, low, high), methods, _ = drawn(family, motion)
    assert methods.count("high frequencies") <= 1
    assert np.median(floor) == pytest.approx(1, abs=spread)
    assert np.mean((low <= 1) & (high >= 1)) > 0.75  # 95 % of 24 draws: fewer than 19 once in 1000
    assert np.all((low <= floor) & (floor <= high))


def test_an_interval_is_wide_where_noise_is_slow():
    widths = [np.median(high / low) for _, low, high in (drawn(f, "two", 8)[0] for f in ("white", "slow 2 s"))]
    assert widths[0] < 1.2 < 2 < widths[1]


def test_short_rests_in_which_a_signal_settles_leave_a_long_one():
    """A reference that stops for 0.4 s nine times, and for 5 s once; the axis follows with a lag of 0.3 s."""
    rng, t = np.random.default_rng(4), STEP * np.arange(1400)
    u = np.repeat(rng.uniform(-10.0, 10.0, 18), 50)
    u = np.concatenate([np.interp(t[:900], 0.5 * np.arange(18) + 0.1, u[::50]), np.full(500, u[-1])])
    for k in range(0, 900, 100):
        u[k : k + 60] = u[k]
    y = np.empty_like(u)
    y[0] = u[0]
    for k in range(1, len(u)):
        y[k] = y[k - 1] + STEP / 0.3 * (u[k] - y[k - 1])
    found = tsm.noise(tsm.Record("r", t, {"u": u, "y": y + rng.normal(0.0, 0.05, len(t))}, {}), "y", inputs="u")
    assert found.method == "stand-still"
    assert found.floor == pytest.approx(0.05, rel=0.15)


def test_a_load_that_moves_while_the_inputs_rest_is_no_noise():
    (floor, _, high), methods, doubts = drawn("white", "creeping", 24)
    assert set(methods) == {"high frequencies"}
    assert np.all(np.abs(floor - 1) < 0.1)
    assert np.all(np.isinf(high))
    assert all(said.startswith(f"stand-still: {STILL_MOVING} (") for said in doubts)


def test_a_reason_that_several_recordings_have_is_said_once_with_the_largest_size():
    def moved(size):
        return Found("stand-still", (Stretch(size * np.array([1.0, -1.0]), 0.01),), 5.0, doubt="it moves")

    found = [moved(0.02), moved(0.053), moved(0.01)]
    assert noise_floor._refused(found, 1.0, "rev") == ["stand-still: it moves (0.053 rev rms)"]


def test_fast_noise_is_a_lower_bound():
    for family in ("white", "white and 0.5 s", "slow 0.1 s"):
        (_, low, high), methods, _ = drawn(family, "never", 12)
        assert set(methods) == {"high frequencies"}
        assert np.mean(low <= 1) > 0.9
        assert np.all(np.isinf(high))


def recording(name, seed, u=None, slow=0.02, white=0.01, time=0.3, n=3000, more=0.0):
    """The motion sin(t^1.3), or another one, with noise of two kinds."""
    rng, t = np.random.default_rng(seed), np.arange(n) * STEP
    u = np.sin(t**1.3) if u is None else u
    y = u + slow * first_order(rng, n, time) + white * rng.standard_normal(n) + more
    return tsm.Record(name, t, {"u": u, "y": y}, {"y": "rad"})


def test_both_kinds_of_noise_are_told():
    got = tsm.noise([recording(str(k), k) for k in range(4)], "y", inputs="u")
    assert got.white == pytest.approx(0.01, rel=0.2)
    assert got.slow == pytest.approx(0.02, rel=0.2)
    assert got.slow_time == pytest.approx(0.3, rel=0.4)
    assert got.floor == pytest.approx(np.hypot(0.01, 0.02), rel=0.1)
    assert f"; white {got.white:.3g} rad, slow {got.slow:.3g} rad with a correlation time of " in str(got)
    white = tsm.noise([recording(str(k), k, slow=0.0) for k in range(4)], "y", inputs="u")
    assert (white.slow, white.slow_time) == (None, None)
    assert white.white == white.floor == pytest.approx(0.01, rel=0.05)


def test_recordings_that_repeat_another_are_found():
    other = np.sin(0.7 * (np.arange(3000) * STEP) ** 1.4)
    files = {"a": recording("a", 1), "b": recording("b", 2, other), "c": recording("c", 3), "d": recording("d", 4)}
    degrees = tsm.Record("d", files["d"].t, {"u": files["d"]["u"], "y": np.degrees(files["d"]["y"])}, {"y": "deg"})
    got = noise_over_recordings({**files, "d": degrees}, "y", "rad", ["u"])
    assert (got.method, got.samples, got.unit) == ("repeats", 9000, "rad")
    assert got.low < np.hypot(0.01, 0.02) < got.high < 1.5 * got.low
    assert noise_of_recordings(files, "y", "rad", ["u"])[1] == "repeats"
    alone = noise_over_recordings({"a": files["a"], "b": files["b"]}, "y", "rad", ["u"])
    assert (alone.method, alone.high) == ("high frequencies", np.inf)


def test_what_two_methods_see_differently_is_doubted():
    """Something comes and goes that the command does not cause: rests show the sensor, and periods more than that."""
    rng, t = np.random.default_rng(0), np.arange(6000) * STEP
    u = np.sin(2 * np.pi * t / 10) * (np.mod(t, 10) < 5)
    rough = u**2 * first_order(rng, len(t), 0.3)
    got = tsm.noise(tsm.Record("r", t, {"u": u, "y": u + rough + 0.01 * rng.standard_normal(len(t))}, {}), "y", "u")
    assert (got.method, got.floor) == ("stand-still", pytest.approx(0.01, rel=0.1))
    assert got.high > 0.2
    assert got.doubt.startswith("repeated periods: 0.")
    assert got.doubt.endswith(f" rms, more than the {got.floor:.3g} from stand-still")


def test_a_large_transient_is_not_taken_for_noise():
    """A transient 150 times the noise, short or as long as the recording, is left out or seen as drift."""
    rng, t = np.random.default_rng(0), np.arange(2000) * STEP
    u = np.sin(2 * np.pi * t / 9.7)
    for last in (1.0, 3.0, 10.0, 30.0):
        y = u + 3 * np.exp(-t / last) + 0.02 * rng.standard_normal(len(t))
        got = tsm.noise(tsm.Record("r", t, {"u": u, "y": y}, {}), "y", "u")
        assert got.floor == pytest.approx(0.02, rel=0.2), last
        assert got.low < 0.022
        assert got.high > 0.02


def test_a_signal_without_noise():
    t = np.arange(2000) * STEP
    got = tsm.noise(tsm.Record("r", t, {"u": np.floor(t) % 2, "y": np.floor(t) % 2}, {}), "y", "u")
    assert (got.floor, got.low) == (0.0, 0.0)


def test_noise_as_it_was_made_before_there_were_intervals():
    old = Noise("y", "deg", 0.1, None, "repeats", 100, 98)
    assert (old.low, old.high, old.white, old.slow, old.doubt) == (0.0, np.inf, None, None, "")
    assert SIGMA > 0
