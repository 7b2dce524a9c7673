"""What a record does with its signals: parts, grids, filters, derivatives, units; each against a reference."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, freqz, sosfiltfilt

import tsmblocks as tsm
from tsmblocks.common.errors import DataError
from tsmblocks.common.interpolation import found_hold
from tsmblocks.data import Record
from tsmblocks.data.filters import choose_cutoff, low_pass


def record(t, units=None, **signals):
    return Record("bench", np.asarray(t, dtype=float), signals, units or {}, "bench.csv")


def refusal(call):
    with pytest.raises(DataError) as error:
        call()
    return str(error.value)


T = np.arange(2000) / 200
SLOW = np.sin(2 * np.pi * T) + 0.3 * np.sin(2 * np.pi * 2.3 * T + 1)


def noisy(sigma, seed=1, x=SLOW):
    return x + sigma * np.random.default_rng(seed).standard_normal(len(x))


# ---- the time axis and its parts


def test_step_jitter_uniform():
    assert record([0, 1, 2, 3.0]).step == 1.0
    assert record([0, 1, 2, 3.0]).jitter == 0.0
    uneven = record([0, 1, 2, 3.5, 4.5])
    assert (uneven.step, uneven.jitter, uneven.uniform) == (1.0, 0.5, False)
    assert record([0, 1.004, 2, 3.004, 4]).uniform


def test_a_part_keeps_its_ends_and_says_so():
    part = record(T, x=SLOW).part(2.0, 4.0)
    assert (part.t[0], part.t[-1], len(part)) == (2.0, 4.0, 401)
    np.testing.assert_array_equal(part["x"], SLOW[400:801])
    assert part.notes == ("Only 2 s to 4 s (401 of 2000 samples).",)
    assert part.name == "bench, 2 s to 4 s"
    assert refusal(lambda: record(T).part(3.0, 3.01)) == (
        "bench.csv: only 3 samples lie between 3 s and 3.01 s; 4 are the least. The record is from 0 s to 9.995 s."
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(0.01, 0.99))
def test_a_split_loses_and_doubles_nothing(fraction):
    train, test = record(T, x=SLOW).split(fraction)
    np.testing.assert_array_equal(np.r_[train.t, test.t], T)
    np.testing.assert_array_equal(np.r_[train["x"], test["x"]], SLOW)
    assert train.t[-1] < fraction * T[-1] <= test.t[0]


def test_a_split_at_an_instant():
    train, test = record(T, x=SLOW).split(at=2.5)
    assert (train.t[-1], test.t[0]) == (2.495, 2.5)
    assert refusal(lambda: record(T).split(3.0)) == (
        "bench.csv: the share of the first part must lie between 0 and 1, got 3. For a time in s write split(at=…)."
    )
    assert refusal(lambda: record(T).split(at=9.99)) == (
        "bench.csv: a split at 9.99 s leaves 2 samples on one side; 4 are the least. The record is from 0 s to 9.995 s."
    )


@pytest.mark.parametrize("period", [1.0, 1.37, 2.5, 0.333])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_the_period_of_a_signal(period, sigma):
    w = 2 * np.pi / period
    x = noisy(sigma, x=np.sin(w * T) + 0.5 * np.cos(3 * w * T) + 0.2 * np.sin(2 * w * T))
    assert record(T, x=x).period("x") == pytest.approx(period, rel=2e-3 if sigma else 1e-6)


@pytest.mark.parametrize(
    "x",
    [
        np.ones(2000),
        T,
        T**2,
        np.random.default_rng(0).standard_normal(2000),
        np.sin(T**2),
        np.cumsum(np.random.default_rng(1).standard_normal(2000)),
        np.exp(-T),
        T * np.sin(2 * np.pi * T),
        np.sin(2 * np.pi * T / 7),
    ],
)
def test_what_does_not_repeat_has_no_period(x):
    assert record(T, x=x).period() is None


def test_periods_one_by_one():
    found = record(T, x=np.sin(2 * np.pi * T / 3), y=T).periods("x")
    assert [p.t[0] for p in found] == [0.0, 3.0, 6.0]
    assert {len(p) for p in found} == {600}
    np.testing.assert_allclose(found[2]["x"], found[0]["x"], atol=1e-9)
    assert refusal(lambda: record(T, y=T).periods()) == (
        "bench.csv: no signal repeats itself at least twice, so there are no periods."
    )
    assert refusal(lambda: record(T, y=T).periods("y")) == (
        "bench.csv: 'y' does not repeat itself at least twice, so there are no periods."
    )


# ---- resampling


def test_uneven_samples_come_on_an_even_grid():
    t = T + 0.001 * np.random.default_rng(2).uniform(-1, 1, len(T))
    x = np.sin(2 * np.pi * t)
    even = record(t, x=x, u=np.sign(x + 1e-9)).resampled(0.005)
    assert even.uniform
    np.testing.assert_allclose(even["x"], np.sin(2 * np.pi * even.t), atol=1e-6)
    assert np.abs(even["u"]).max() == 1.0  # a spline would ring beside the edges
    count = len(even)
    assert even.notes == (f"Resampled from 2000 to {count} samples, 0.005 s apart (interpolated; cubic: x; held: u).",)


def test_a_held_command_keeps_its_jumps_on_an_even_grid():
    """Times rounded to 1 ms, whose median step is not their mean, and samples that are late or early by a tenth."""
    true = 0.0101 * np.arange(3000) + 0.0007 * np.sin(np.arange(3000))
    t = np.round(true + 0.0004, 3)
    u = np.where(np.arange(3000) // 50 % 2, 1.0, -1.0)
    even = record(t, u=u).resampled()
    jumps = even.t[np.flatnonzero(np.diff(even["u"])) + 1]
    np.testing.assert_allclose(jumps, t[np.flatnonzero(np.diff(u)) + 1], rtol=0, atol=0.0055)
    assert abs(np.mean(jumps - t[np.flatnonzero(np.diff(u)) + 1])) < 1e-3  # not late by half a step on average
    assert np.isclose(even.step, 0.0101, rtol=1e-4)
    assert np.array_equal(even["u"], u[: len(even)])


def test_thinning_takes_out_what_would_come_back_slow():
    """A tone above the new Nyquist frequency, which plain picking turns into a slow one, is gone."""
    fast = 0.5 * np.sin(2 * np.pi * 19.0 * T)
    thin = record(T, x=SLOW + fast).resampled(0.05)
    inner = slice(20, -20)
    np.testing.assert_allclose(thin["x"][inner], np.interp(thin.t, T, SLOW)[inner], atol=3e-3)
    assert np.abs((SLOW + fast)[::10] - SLOW[::10]).max() > 0.4
    assert thin.notes == ("Resampled from 2000 to 200 samples, 0.05 s apart, after a zero-phase low-pass at 7 Hz.",)


def test_resampling_back_gives_the_samples():
    x = record(T, x=SLOW)
    again = x.resampled(0.0013).resampled(0.005)
    np.testing.assert_allclose(again["x"][5:-5], SLOW[5 : len(again) - 5], atol=1e-4)
    np.testing.assert_allclose(x.resampled()["x"], SLOW, atol=1e-11)


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (0.0, "the new step must be above 0 s and at most a third of the record (9.995 s), got 0 s."),
        (5.0, "the new step must be above 0 s and at most a third of the record (9.995 s), got 5 s."),
        (1e-8, "a step of 1e-08 s makes 999500001 samples; is it in seconds?"),
    ],
)
def test_steps_that_do_not_fit(step, words):
    assert refusal(lambda: record(T, x=SLOW).resampled(step)) == f"bench.csv: {words}"


def test_a_spline_for_what_is_smooth_and_lines_for_what_jumps():
    assert found_hold(T, SLOW) == "cubic"
    assert found_hold(T, np.sign(SLOW)) == "zero"
    assert found_hold(T[:6], SLOW[:6]) == "linear"


# ---- filters


@pytest.mark.parametrize("order", [1, 2, 4, 6])
@pytest.mark.parametrize("cutoff", [3.0, 20.0, 80.0])
def test_the_low_pass_is_3_db_down_at_its_cut_off(order, cutoff):
    """Against SciPy's response of one pass, squared by the second."""
    one = np.arctan(np.tan(np.pi * cutoff / 200) / (np.sqrt(2) - 1) ** (0.5 / order)) / np.pi
    b, a = butter(order, 2 * one)
    response = np.abs(freqz(b, a, worN=[2 * np.pi * cutoff / 200])[1][0]) ** 2
    assert response == pytest.approx(np.sqrt(0.5), rel=1e-6)
    middle = slice(800, 1200)
    expected = sosfiltfilt(butter(order, 2 * one, output="sos"), SLOW)
    np.testing.assert_allclose(low_pass(SLOW, 0.005, cutoff, order)[middle], expected[middle], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.sampled_from([2.0, 10.0, 50.0]))
def test_filtering_keeps_straight_lines_and_is_linear(a, b, cutoff):
    line = a + b * T
    np.testing.assert_allclose(low_pass(line, 0.005, cutoff), line, atol=1e-7 * (1 + abs(a) + abs(b) * 10))
    x, y = SLOW, np.cos(7 * T)
    both = low_pass(a * x + b * y, 0.005, cutoff)
    np.testing.assert_allclose(both, a * low_pass(x, 0.005, cutoff) + b * low_pass(y, 0.005, cutoff), atol=1e-9)


def test_filtering_shifts_nothing():
    x = np.sin(2 * np.pi * 3 * T)
    y = low_pass(x, 0.005, 4.0)[500:1500]
    lag = np.angle(
        np.vdot(np.exp(2j * np.pi * 3 * T[500:1500]), y) / np.vdot(np.exp(2j * np.pi * 3 * T[500:1500]), x[500:1500])
    )
    assert abs(lag) < 1e-6


@pytest.mark.parametrize("band", [2.0, 8.0, 25.0])
@pytest.mark.parametrize("sigma", [0.003, 0.03])
@pytest.mark.parametrize("seed", range(3))
def test_the_chosen_cut_off_is_near_the_best_there_is(band, sigma, seed):
    """A sum of sines up to a known frequency in white noise: no cut-off leaves much less error than the chosen one."""
    rng = np.random.default_rng(seed)
    f = np.linspace(band / 8, band, 8)
    true = sum(np.sin(2 * np.pi * fk * T + p) for fk, p in zip(f, rng.uniform(0, 6, 8), strict=True)) / 4
    x = true + sigma * rng.standard_normal(len(T))
    chosen = choose_cutoff(x, 0.005)
    assert band < chosen < 5 * band

    def error(cutoff):
        return float(np.sqrt(np.mean((low_pass(x, 0.005, cutoff) - true) ** 2)))

    best = min(error(c) for c in np.geomspace(1.0, 80.0, 80))
    assert error(chosen) < 1.1 * best
    assert error(chosen) < 0.8 * sigma


def test_nothing_is_filtered_where_there_is_no_noise():
    assert choose_cutoff(np.zeros(100), 0.01) is None
    assert choose_cutoff(3.0 + 2.0 * T, 0.005) is None


@pytest.mark.parametrize("seed", range(5))
def test_of_noise_alone_next_to_nothing_is_left(seed):
    noise = np.random.default_rng(seed).standard_normal(4000)
    assert np.std(low_pass(noise, 0.01, choose_cutoff(noise, 0.01))) < 0.2


def removed(before, after, name):
    unit = np.rad2deg(1.0) if before.unit(name) == "rad" else 1.0
    return f"{unit * np.std(before[name] - after[name]):.2g}"


def test_filtering_says_what_it_did():
    x = record(T, {"x": "rad"}, x=noisy(0.02), y=noisy(0.02, 2))
    given_ = x.filtered("x", cutoff=12.5)
    assert given_.notes == (
        f"x was filtered with zero phase, cut-off 12.5 Hz; {removed(x, given_, 'x')} deg rms was removed.",
    )
    np.testing.assert_array_equal(given_["y"], x["y"])
    chosen = choose_cutoff(x["y"], x.step)
    kept = x.filtered(["y"])
    assert kept.notes == (
        f"y was filtered with zero phase, cut-off {chosen:.4g} Hz (chosen from its spectrum); "
        f"{removed(x, kept, 'y')} rms was removed.",
    )
    assert x.filtered().unit("x") == "rad"
    assert x.notes == ()
    text = "z was not filtered: no noise stands out from its motion in the spectrum."
    assert record(T, z=np.zeros(2000)).filtered().notes == (text,)


UNEVEN = np.r_[T[:100], T[100:200] + 0.002]
REFUSED = {
    "uneven": (
        lambda: record(UNEVEN, x=UNEVEN).filtered(),
        "filtering needs evenly spaced samples, but steps are up to 40 % off 0.005 s. Call resampled() first.",
    ),
    "short": (lambda: record(T[:9], x=T[:9]).filtered(), "filtering needs at least 16 samples, there are 9."),
    "cut-off": (
        lambda: record(T, x=T).filtered(cutoff=120.0),
        "the cut-off must lie between 0 Hz and 100 Hz (half the sampling frequency), got 120 Hz.",
    ),
    "order": (lambda: record(T, x=T).filtered(order=0), "the order of a filter is a whole number from 1 to 12, got 0."),
    "signal": (lambda: record(T, x=T).filtered("y"), "there is no signal 'y'. Known here: x."),
    "uneven derivative": (
        lambda: record(UNEVEN, x=UNEVEN).differentiated("x"),
        "differentiating needs evenly spaced samples, but steps are up to 40 % off 0.005 s. Call resampled() first.",
    ),
    "third derivative": (
        lambda: record(T, x=T).differentiated("x", 3),
        "a signal is differentiated once or twice (order = 1 or 2), got 3.",
    ),
    "name taken": (
        lambda: record(T, x=T, v=T).differentiated("x", name="v"),
        "there is already a signal 'v'; give the derivative another name.",
    ),
    "length": (
        lambda: record(T, x=T).with_signal("y", [1.0, 2.0]),
        "signal 'y' must have one number for each of the 2000 samples, got 2.",
    ),
    "shape": (
        lambda: record(T, x=T).with_signal("y", np.zeros((2000, 2))),
        "signal 'y' must have one number for each of the 2000 samples, got an array of shape (2000, 2).",
    ),
    "not finite": (
        lambda: record(T, x=T).with_signal("y", np.where(np.arange(2000) == 7, np.nan, T)),
        "signal 'y' holds nan in sample 7.",
    ),
    "rename": (lambda: record(T, x_in=T).renamed({"x_inn": "x"}), "there is no signal 'x_inn'. Did you mean 'x_in'?"),
    "name twice": (lambda: record(T, x=T, y=T).renamed({"x": "y"}), "two signals would both be named 'y'."),
    "unit": (
        lambda: record(T, {"x": "deg"}, x=T).converted({"x": "V"}),
        "signal 'x [deg]' is wanted in V. 'deg' does not convert to 'V'.",
    ),
    "unknown unit": (
        lambda: record(T, x=T).converted({"x": "grad"}),
        "'grad' is not a unit known here. Did you mean 'rad'?",
    ),
    "turn": (
        lambda: record(T, {"x": "mm"}, x=T).unwrapped("x"),
        "one turn of 'x' is not known, because 'mm' is no unit of angle. Give it: turn = 360.",
    ),
    "turn of what": (
        lambda: record(T, x=T).unwrapped("x"),
        "one turn of 'x' is not known, because it has no unit. Give it: turn = 360.",
    ),
    "negative turn": (lambda: record(T, x=T).unwrapped("x", turn=-1.0), "a turn must be a positive number, got -1."),
}


@pytest.mark.parametrize(("call", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_done(call, message):
    assert refusal(call) == f"bench.csv: {message}"


# ---- derivatives


@pytest.mark.parametrize(("order", "tolerance"), [(1, 1e-6), (2, 1e-5)])
def test_a_derivative_without_noise_is_that_of_the_function(order, tolerance):
    got = record(T, {"x": "rad"}, x=np.sin(3 * T)).differentiated("x", order, cutoff=40.0)
    name, unit = ("x_dot", "rad/s") if order == 1 else ("x_ddot", "rad/s^2")
    exact = 3 * np.cos(3 * T) if order == 1 else -9 * np.sin(3 * T)
    assert got.unit(name) == unit
    np.testing.assert_allclose(got[name][300:-300], exact[300:-300], atol=tolerance)


@pytest.mark.parametrize("order", [1, 2])
def test_a_derivative_of_noisy_data_is_near_the_best_there_is(order):
    w = 2 * np.pi * np.array([[1.0], [2.3]])
    phase = w * T + [[0.0], [1.0]]
    true = np.array([1.0, 0.3]) @ (w * np.cos(phase) if order == 1 else -(w**2) * np.sin(phase))
    x = record(T, x=noisy(0.01))

    def error(cutoff):
        got = x.differentiated("x", order, name="d", cutoff=cutoff)["d"]
        return float(np.sqrt(np.mean((got - true)[50:-50] ** 2)))

    assert error(None) < 2.0 * min(error(c) for c in np.geomspace(1.0, 50.0, 60))
    assert error(None) < 0.05 * np.std(np.diff(x["x"] - SLOW, order)) / 0.005**order


def test_a_derivative_says_what_was_done():
    x = record(T, {"x": "deg"}, x=noisy(0.01))
    assert x.differentiated("x", cutoff=6.0).notes == (
        "x_dot [deg/s] is x differentiated after a zero-phase low-pass, cut-off 6 Hz.",
    )
    assert x.differentiated("x", 2, name="a", cutoff=6.0).notes == (
        "a [deg/s^2] is x differentiated twice after a zero-phase low-pass, cut-off 6 Hz.",
    )
    assert record(T, x=T).differentiated("x", cutoff=6.0).unit("x_dot") == ""


# ---- signals one by one


def test_signals_are_added_renamed_and_converted():
    x = record(T, {"x": "deg"}, x=SLOW, y=T)
    more = x.with_signal("e", x["x"] - x["y"], "deg").renamed({"x": "x_in"}).converted({"x_in": "rad", "y": "rad"})
    assert more.names == ("x_in", "y", "e")
    assert [more.unit(k) for k in more] == ["rad", "rad", "deg"]
    np.testing.assert_allclose(more["x_in"], np.radians(SLOW))
    np.testing.assert_array_equal(more["y"], T)
    assert more.notes == (
        "e was added.",
        "Renamed: x is now x_in.",
        "Converted: x_in from deg to rad, y, which had no unit, taken as rad.",
    )
    assert x.names == ("x", "y")
    swapped = x.renamed({"x": "y", "y": "x"})
    np.testing.assert_array_equal(swapped["y"], SLOW)
    assert swapped.unit("y") == "deg"
    assert x.with_signal("x", T).unit("x") == ""


@settings(max_examples=50, deadline=None)
@given(st.floats(-100, 100), st.floats(0.1, 100), st.sampled_from([2 * np.pi, 360.0, 4096.0]))
def test_joined_turns_are_the_angle_again(start, speed, turn):
    """What a wrapping encoder shows, joined, differs from the angle by whole turns, the same for all samples."""
    angle = turn * (start + 0.4 * np.sin(speed * T / 100) + 0.01 * T)
    off = record(T, x=np.mod(angle, turn)).unwrapped("x", turn=turn)["x"] - angle
    np.testing.assert_allclose(off, np.round(off[0] / turn) * turn, atol=1e-6 * turn)


# ---- out of the program and back


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_a_recording_that_is_saved_is_read_again(ending, tmp_path):
    one = record(T, {"x": "deg"}, x=SLOW, y=2 * SLOW)
    path = one.save(tmp_path / f"run.{ending}")
    again = tsm.read(path)
    assert (again.names, again.notes, dict(again.units)) == (("x", "y"), (), {"x": "deg"})
    for name in one:
        np.testing.assert_array_equal(again[name], one[name])
    np.testing.assert_array_equal(again.t, one.t)


NAMES = ("a,b", "a=b", '"q"', 'a"b,c', "f(x)", "x [deg]", "a;b", "#c", "θ", "()", "=", "T", "1")


@pytest.mark.parametrize("unit", ["", "deg", "kg*m/s^2"])
@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_signals_of_any_name_are_read_again_as_they_were(ending, unit, tmp_path):
    one = record(T, dict.fromkeys(NAMES, unit) if unit else {}, **{name: k + SLOW for k, name in enumerate(NAMES)})
    again = tsm.read(one.save(tmp_path / f"run.{ending}"))
    assert (again.names, dict(again.units)) == (NAMES, dict(one.units))
    for name in NAMES:
        np.testing.assert_array_equal(again[name], one[name])


@pytest.mark.parametrize("name", ["a\nb", "a\rb", "a\0b", " a", "a ", "", "a\tb", "\ud800"])
@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_signals_that_would_not_be_read_again_are_not_saved(ending, name, tmp_path):
    assert refusal(lambda: record(T, **{name: SLOW}).save(tmp_path / f"run.{ending}")) == (
        f"signal {name!r} cannot be written to 'run.{ending}': it would not be read from there as it is. "
        "Give it another name with renamed({…})."
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_units_that_would_not_be_read_again_are_not_saved(ending, tmp_path):
    unit = {"csv": "a]", "npz": "a=b"}[ending]
    assert refusal(lambda: record(T, {"x": unit}, x=SLOW).save(tmp_path / f"run.{ending}")).startswith(
        f"signal 'x' cannot be written to 'run.{ending}': it would not be read from there as it is, in '{unit}'."
    )


@pytest.mark.parametrize("name", ["a b", "θ", "a,b", "", "x" * 64])
def test_matlab_takes_only_names_of_its_own(name, tmp_path):
    assert refusal(lambda: record(T, **{name: SLOW}).save(tmp_path / "run.mat")).endswith(
        "cannot be written to 'run.mat': MATLAB has no variables of such names. Give it another name with renamed({…})."
    )
    kept = tsm.read(record(T, **{"arm.x": SLOW, "x" * 62: SLOW}).save(tmp_path / "run.mat"))
    assert kept.names == ("arm_x", "x" * 62)


def test_names_with_lines_and_brackets_are_read_from_arrays_and_frames(tmp_path):
    np.savez(tmp_path / "run.npz", **{"t": T, "motor\nangle [deg]": SLOW})
    assert dict(tsm.read(tmp_path / "run.npz").units) == {"motor\nangle": "deg"}
    frame = record(T, {"f(x)": "rad"}, **{"f(x)": SLOW}).to_pandas()
    assert dict(tsm.from_pandas(frame).units) == {"f(x)": "rad"}


def test_a_recording_is_not_saved_as_anything_else(tmp_path):
    assert refusal(lambda: record(T, x=SLOW).save(tmp_path / "run.txt")).endswith(
        "run.txt' ends in '.txt'; results are written to .csv, .npz or .mat."
    )


@pytest.mark.parametrize(
    ("t", "signals", "units", "said"),
    [
        (T, {"x": SLOW[:9]}, {}, "signal 'x' must have one number for each of the 2000 samples, got 9."),
        (
            T,
            {"x": np.zeros((2000, 2))},
            {},
            "signal 'x' must have one number for each of the 2000 samples, got an array of shape (2000, 2).",
        ),
        (np.zeros((2000, 2)), {}, {}, "the times must be one row of numbers, got an array of shape (2000, 2)."),
        (T, {"x_in": SLOW}, {"x_inn": "deg"}, "a unit is given for 'x_inn', which is no signal. Did you mean 'x_in'?"),
    ],
    ids=["length", "matrix", "times", "unit"],
)
def test_arrays_that_make_no_recording(t, signals, units, said):
    assert refusal(lambda: Record("bench", t, signals, units)) == f"bench: {said}"


def test_one_table_of_units_serves_many_recordings():
    assert Record("bench", T, {"x": SLOW}, {"x": "rad", "force": "N", "t": "s"}).unit("x") == "rad"


def test_a_recording_without_a_file_is_called_by_its_name():
    one = Record("bench", T, {"x": SLOW}, {"x": "rad"})
    for call in (
        lambda: one["y"],
        lambda: one.filtered("y"),
        lambda: one.periods("y"),
        lambda: one.renamed({"y": "z"}),
        lambda: one.values("x", "V"),
        lambda: one.part(50.0),
        lambda: one.resampled(-1.0),
    ):
        assert refusal(call).startswith("bench: ")


def test_recordings_and_what_holds_them_are_pickled_and_copied():
    one = record(T, {"x": "deg"}, x=SLOW)
    for again in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
        assert (again.name, again.notes, dict(again.units)) == (one.name, one.notes, dict(one.units))
        np.testing.assert_array_equal(again["x"], one["x"])
        assert not again["x"].flags.writeable


@pytest.mark.parametrize("ending", [".csv", ".npz", ".mat"])
def test_a_folder_that_is_not_there_is_named(tmp_path, ending):
    gone = tmp_path / "results"
    record = Record("rig", 0.1 * np.arange(5), {"x": np.arange(5.0)}, {"x": "rad"})
    with pytest.raises(DataError) as caught:
        record.save(gone / f"x{ending}")
    assert str(caught.value) == f"there is no folder '{gone}' to write x{ending} into."
    with pytest.raises(DataError) as caught:
        tsm.read(gone / f"x{ending}")
    assert str(caught.value) == f"there is no file {gone / f'x{ending}'}: there is no folder '{gone}'."
