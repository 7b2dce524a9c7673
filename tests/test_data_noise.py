"""Noise floor and quantisation, against data whose noise is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsmblocks.common.errors import DataError
from tsmblocks.data import Record, cautions, noise
from tsmblocks.data.noise_floor import fast_noise_of_recordings, noise_of_recordings
from tsmblocks.data.periods import find_period
from tsmblocks.data.quantization import quantum_of

STEP = 0.01
T = np.arange(6000) * STEP


def record(t=T, units=None, name="bench", **signals):
    return Record(name, t, signals, units or {}, f"{name}.csv")


def periodic(t, period):
    w = 2 * np.pi / period
    return np.sin(w * t) + 0.3 * np.sin(3 * w * t + 1)


def white(sigma, n=6000, seed=0):
    return sigma * np.random.default_rng(seed).standard_normal(n)


def coloured(sigma, n=6000, seed=0, pole=0.9):
    """First-order noise with the rms value sigma."""
    from scipy.signal import lfilter, lfiltic

    drive = np.random.default_rng(seed).standard_normal(n + 500) * sigma * np.sqrt(1 - pole**2)
    return lfilter([1.0], [1.0, -pole], drive, zi=lfiltic([1.0], [1.0, -pole], [0.0]))[0][500:]


# ---- repeated periods


@pytest.mark.parametrize("period", [10.0, 7.777, 3.3333])
@pytest.mark.parametrize("make", [white, coloured])
@pytest.mark.parametrize("seed", range(3))
def test_noise_from_repeated_periods(period, make, seed):
    """Within 10 %, white or coloured, whether or not a period is a whole number of samples."""
    x = periodic(T, period)
    got = noise(record(u=x, y=np.tanh(2 * x) + make(0.05, seed=seed)), "y", inputs="u")
    assert got.method == "repeated periods"
    tolerance = 0.1 if make is white else 0.2
    assert got.floor == pytest.approx(0.05, rel=tolerance)
    assert got.low < 0.05 < got.high
    fewest = 0.3 if make is white else 0.02  # autocorrelated samples tell less
    assert fewest * len(T) < got.freedom < got.samples < len(T)


def test_a_transient_and_a_slow_drift_are_no_noise():
    x = periodic(T, 10.0)
    y = x + np.exp(-T / 1.5) + 0.02 * T + white(0.01)
    assert noise(record(u=x, y=y), "y").floor == pytest.approx(0.01, rel=0.1)


def test_two_periods_with_a_transient_in_the_first():
    x = periodic(T[:1000], 4.9)
    y = x + np.exp(-T[:1000] / 0.5) + white(0.01, 1000)
    got = noise(record(T[:1000], u=x, y=y), "y")
    assert (got.method, got.floor) == ("repeated periods", pytest.approx(0.01, rel=0.25))


def test_periods_in_uneven_samples():
    t = T + np.random.default_rng(5).uniform(-0.004, 0.004, len(T))
    x = periodic(t, 8.0)
    got = noise(record(t, u=x, y=2 * x + white(0.02)), "y", inputs="u")
    assert (got.method, got.floor) == ("repeated periods", pytest.approx(0.02, rel=0.1))


def test_an_input_that_does_not_repeat_contradicts_the_period():
    x = periodic(T, 10.0)
    other = np.cumsum(white(0.1, seed=9))
    got = noise(record(u=x, w=other, y=x + other + white(0.02)), "y", inputs=["u", "w"])
    assert got.method == "high frequencies"


@pytest.mark.parametrize(("turns", "size", "floor"), [(0.94, 0.06, 0.063), (0.938, 2.5, 2.5)])
def test_tones_that_come_nearly_back_make_no_period(turns, size, floor):
    """Three periods of the one are 15 s, seven of the other 14.89 s: what differs between them is motion.

    So it is where noise is larger and the input explains four tenths of it: an effect may respond more.
    """
    rng = np.random.default_rng(4)
    t = T[:4000]
    u = 45 * np.sin(0.4 * np.pi * t) + 12 * np.sin(turns * np.pi * t) + rng.normal(0, 0.02, len(t))
    got = noise(record(t, u=u, y=0.9 * u + rng.normal(0, size, len(t))), "y", inputs="u")
    assert (got.method, got.floor) == ("high frequencies", pytest.approx(floor, rel=0.06))


def test_an_input_that_repeats_after_a_transient_has_periods():
    """What the input does in the first period alone is left out with the transient of the signal."""
    x, start = periodic(T[:1000], 4.9), np.exp(-T[:1000] / 0.5)
    got = noise(record(T[:1000], u=x + 0.05 * start, y=x + start + white(0.02, 1000)), "y", inputs="u")
    assert (got.method, got.floor) == ("repeated periods", pytest.approx(0.02, rel=0.25))


def test_noise_of_the_input_itself_contradicts_no_period():
    rng = np.random.default_rng(4)
    x = periodic(T, 10.0)
    got = noise(record(u=x + rng.normal(0, 0.02, len(T)), y=x + rng.normal(0, 0.02, len(T))), "y", inputs="u")
    assert (got.method, got.floor) == ("repeated periods", pytest.approx(0.02, rel=0.1))


# ---- repeats


def test_noise_from_repeats():
    x = periodic(T, 100.0) + T**2 / 900
    made = [record(u=x, y=x + 0.1 * k + 0.001 * k * T + coloured(0.03, seed=k)) for k in range(4)]
    got = noise(made, "y")
    assert (got.method, got.samples) == ("repeats", 24000)
    assert 1300 < got.freedom < 2600  # noise with this pole has 0.105 independent values a sample
    assert got.floor == pytest.approx(0.03, rel=0.05)


def test_repeats_of_other_lengths_and_units():
    x = periodic(T, 100.0)
    first = record(T, {"y": "rad"}, u=x, y=x + white(0.02, seed=1))
    later = Record("b", T[:5000] + 7, {"y": np.degrees(x + white(0.02, seed=2))[:5000]}, {"y": "deg"})
    got = noise([first, later], "y")
    assert (got.unit, got.samples) == ("rad", 10000)
    assert got.floor == pytest.approx(0.02, rel=0.05)


def test_what_is_no_repeat_is_refused():
    with pytest.raises(DataError) as error:
        noise([record(y=np.sin(T)), record(y=np.cos(T))], "y")
    assert str(error.value) == (
        "these 2 records do not repeat one experiment: 'y' differs between them by 71 % of its rms value."
    )
    with pytest.raises(DataError, match=r"^noise needs at least one record\.$"):
        noise([], "y")
    with pytest.raises(DataError, match=r"^bench.csv: noise needs at least 8 samples, there are 6\.$"):
        noise(record(T[:6], y=T[:6]), "y")


def test_short_records_fall_back():
    y = white(0.1, 60)
    assert noise(record(T[:60], u=0 * y, y=y), "y", inputs="u").method == "stand-still"
    assert noise(record(T[:45], u=0 * y[:45], y=y[:45]), "y", inputs="u").method == "high frequencies"
    x = periodic(T[:40], 0.13)
    assert noise([record(T[:40], u=x, y=x + y[:40])], "y", inputs="u").method == "high frequencies"
    tiny = periodic(T[:40], 0.03)
    assert noise(record(T[:40], u=tiny, y=tiny + y[:40]), "y", inputs="u").method == "high frequencies"


def test_many_short_periods():
    x = periodic(T, 0.13)
    got = noise(record(u=x, y=x + white(0.05)), "y", inputs="u")
    assert (got.method, got.floor) == ("repeated periods", pytest.approx(0.05, rel=0.1))


def test_two_periods_of_few_samples_are_found():
    t = np.arange(17.0)
    period, unlike = find_period(t, np.array([0.0, 2, 5, 1, -3, -6, -2, 0] * 3)[:17])
    assert (period, unlike) == (8.0, pytest.approx(0.0, abs=1e-12))


def test_a_signal_that_comes_back_far_from_itself_has_no_period():
    t = np.arange(400) / 10
    x = np.sin(2 * np.pi * t)
    assert find_period(t, x)[0] == pytest.approx(1.0, rel=1e-6)
    assert find_period(t, x + white(0.125, 400)) is None


def test_repeats_whose_noise_fades_all_along_are_doubted():
    x = periodic(T, 100.0)
    made = [record(u=x, y=x + white(1.0, seed=k) * np.linspace(0.5, 0.01, 6000)) for k in range(2)]
    got = noise(made, "y")
    assert got.method == "high frequencies"
    assert got.doubt.startswith("repeats: the noise found does not settle (")


@pytest.mark.parametrize("samples", [14, 20])
def test_repeats_of_few_samples(samples):
    x = periodic(T, 1.0)[:samples]
    made = [record(T[:samples], u=x, y=x + white(0.05, samples, seed)) for seed in range(2)]
    got = noise(made, "y")
    assert got.method == ("high frequencies" if samples == 14 else "repeats")
    assert got.floor == pytest.approx(0.05, rel=0.6)


def test_recordings_of_one_input_that_answer_otherwise_are_no_repeats():
    u = periodic(T, 100.0)
    made = {str(k): record(u=u, y=(1 - 2 * k) * u + white(0.02, seed=k)) for k in range(2)}
    floor, method = noise_of_recordings(made, "y", "", ["u"])
    assert method == "high frequencies"
    assert floor == pytest.approx(0.02, rel=0.1)
    assert fast_noise_of_recordings(made, "y", "") == pytest.approx(0.02, rel=0.1)


# ---- stand-still


def test_noise_while_the_input_rests():
    u = np.where(T < 20, 0.0, np.where(T < 35, (T - 20) / 15, 1.0))
    y = np.sin(3 * u) + coloured(0.02)
    got = noise(record(u=u, y=y), "y", inputs="u")
    assert (got.method, got.floor) == ("stand-still", pytest.approx(0.02, rel=0.15))
    assert 3000 < got.samples < 4500


def test_an_input_may_be_measured_and_quantised_and_still_rest():
    u = np.round(np.where(T < 20, 0.0, (T - 20) / 15) / 0.01) * 0.01 + white(1e-4, seed=4)
    assert noise(record(u=u, y=np.sin(u) + white(0.02)), "y", inputs="u").method == "stand-still"


def steps(rest, pole, seed, count=30):
    """A command that steps to another value every ``rest`` samples, and the first-order response to it."""
    from scipy.signal import lfilter

    u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, count), rest)
    return u, lfilter([1 - pole], [1, -pole], u)


@pytest.mark.parametrize("rest", [60, 200])
@pytest.mark.parametrize("share", [0.07, 0.15, 0.25])
@pytest.mark.parametrize("seed", range(3))
def test_what_still_settles_in_all_rests_is_no_noise(rest, share, seed):
    u, y = steps(rest, np.exp(-1 / (share * rest)), seed)
    y = y + white(0.003, len(u), seed)
    got = noise(record(np.arange(len(u)) * STEP, u=u, y=y), "y", inputs="u")
    assert 0.8 * 0.003 < got.floor < 1.6 * 0.003, got


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("pole", [0.9, 0.98])
def test_slow_noise_in_rests_is_noise(seed, pole):
    u, y = steps(300, 0.5, seed)
    made = coloured(0.02, len(u), seed, pole)
    got = noise(record(np.arange(len(u)) * STEP, u=u, y=y + made), "y", inputs="u")
    assert (got.method, got.floor) == ("stand-still", pytest.approx(0.02, rel=0.6)), got
    assert got.low < 1.1 * np.std(made) < 1.2 * got.high


# ---- high frequencies


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sigma", [1e-4, 0.01])
def test_white_noise_from_high_frequencies(sigma, seed):
    y = np.sin(T**1.5 / 20) + white(sigma, seed=seed)
    got = noise(record(y=y), "y")
    assert (got.method, got.floor) == ("high frequencies", pytest.approx(sigma, rel=0.06))


def test_high_frequencies_in_uneven_samples_and_beside_jumps():
    t = T + np.random.default_rng(5).uniform(-0.004, 0.004, len(T))
    y = np.sin(t**1.5 / 20) + np.floor(t / 17) + white(0.01)
    assert noise(record(t, y=y), "y").floor == pytest.approx(0.01, rel=0.06)


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-100, 100), st.integers(0, 5), st.sampled_from([7.0, 23.0, 61.0]))
def test_the_floor_goes_with_the_unit_and_not_with_the_origin(scale, offset, seed, period):
    x = periodic(T[:1500], period / 5)
    y = x + white(0.05, 1500, seed)
    one = noise(record(T[:1500], u=x, y=y), "y", inputs="u")
    two = noise(record(T[:1500], u=x, y=scale * (y + offset)), "y", inputs="u")
    assert two.floor == pytest.approx(scale * one.floor, rel=1e-6)
    assert (two.method, two.freedom) == (one.method, one.freedom)


# ---- quantisation


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 0.03), st.floats(-5, 5), st.integers(0, 100))
def test_the_step_of_an_encoder_is_found(quantum, origin, seed):
    y = np.sin(T) + 0.2 * np.sin(2.7 * T) + white(0.3 * quantum, seed=seed)
    coded = origin + quantum * np.round(y / quantum)
    assert quantum_of(coded) == pytest.approx(quantum, rel=1e-6)
    assert quantum_of(y) is None


def test_printed_digits_do_not_hide_the_step():
    quantum = 2 * np.pi / 4096
    printed = np.round(quantum * np.round(np.sin(T) / quantum), 6)
    assert quantum_of(printed) == pytest.approx(quantum, rel=1e-4)


def test_a_step_found_though_no_two_neighbouring_values_occur():
    codes = np.random.default_rng(0).permutation(np.repeat(np.r_[np.arange(0, 40, 2), np.arange(43, 100, 3)], 3))
    assert quantum_of(0.25 * codes) == pytest.approx(0.25)


@pytest.mark.parametrize(
    "x",
    [
        np.sign(np.sin(T)),
        np.zeros(100),
        np.linspace(0, 1, 500),
        np.abs(np.mod(np.arange(900), 200) - 100.0),
        np.sin(T),
        white(1.0),
        np.cumsum(white(1.0)),
        np.ones(3),
    ],
)
def test_what_is_not_quantised(x):
    assert quantum_of(x) is None


@pytest.mark.parametrize("quantum", [0.003, 0.02])
@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_the_floor_holds_the_rounding(quantum, sigma):
    x = periodic(T, 7.1234)
    y = quantum * np.round((x + white(sigma)) / quantum)
    got = noise(record(T, {"y": "rad"}, u=x, y=y), "y", inputs="u")
    assert got.quantum == pytest.approx(quantum)
    assert got.floor == pytest.approx(np.sqrt(sigma**2 + quantum**2 / 12), rel=0.15)


def test_a_reading_that_stands_still_hides_its_rounding():
    u = np.where(T < 30, 0.0, np.sin(T - 30))
    got = noise(record(u=u, y=0.01 * np.round(u / 0.01)), "y", inputs="u")
    assert (got.method, got.floor) == ("stand-still", pytest.approx(0.01 / np.sqrt(12)))
    assert (got.low, got.high) == (got.floor, pytest.approx(0.01 * np.hypot(0.25, 1 / np.sqrt(12))))


def test_noise_says_what_it_is():
    x = periodic(T, 10.0)
    got = noise(record(T, {"y": "deg"}, u=x, y=0.02 * np.round((x + white(0.005)) / 0.02)), "y")
    assert str(got) == (
        f"y: noise {got.floor:.3g} deg rms (95 %: {got.low:.3g} to {got.high:.3g}), from repeated periods "
        f"({got.samples} samples, {got.freedom} degrees of freedom); quantised in steps of 0.02 deg"
    )
    fine = noise(record(u=x, y=np.round(x + white(0.005), 6)), "y")
    assert fine.quantum == pytest.approx(1e-6)
    assert "quantised" not in str(fine)  # only the digits of a file
    with pytest.raises(DataError, match=r"bench.csv: there is no signal 'v'. Known here: u, y."):
        noise(record(u=x, y=x), "y", inputs="v")


# ---- what to mind


def test_an_input_whose_noise_lengthens_its_path_is_named():
    x = np.sin(T)
    rough = record(T, {"q": "rad"}, clean=x, q=0.05 * np.round((x + white(0.02)) / 0.05), n=x + white(0.02, seed=3))
    first, second = cautions(rough, ["clean", "q", "n"])
    assert first.startswith("q is quantised in steps of 0.05 rad: its path is ")
    assert first.endswith(
        " % longer than that of the motion in it, which drives hysteresis and friction. Filter it first: filtered('q')."
    )
    assert second.startswith("n is noisy: its path is ")
    assert cautions(rough, "clean") == ()
    assert cautions(record(T[:4], n=white(1.0)[:4])) == ()  # too short to be filtered
    assert cautions(rough.filtered(["q", "n"])) == ()
    t = T + 0.003 * np.sin(np.arange(len(T)))
    assert cautions(record(t, x=np.sin(t) + white(0.02)))[0].startswith("x is noisy")
    with pytest.raises(DataError, match="there is no signal 'm'"):
        cautions(rough, ["m"])


def test_steps_that_leave_the_path_alone_are_named_for_the_rate():
    t = np.arange(0, 20, 0.001)
    x, q = np.sin(1.3 * t), 2 * np.pi / 4096
    stepped = record(t, {"x": "rad"}, x=q * np.round(x / q))
    rate = np.sqrt(np.mean((np.diff(stepped["x"]) - np.diff(x)) ** 2)) / np.abs(np.diff(x)).mean()
    (said,) = cautions(stepped)
    assert said.startswith("x is quantised in steps of 0.00153 rad, which makes its rate wrong by ")
    assert said.endswith(
        " %. Where the rate drives the model, filter it first: filtered('x', cutoff=50), for example, above the "
        "frequencies of its motion."
    )
    assert float(said.split("wrong by ")[1].split(" %")[0]) == pytest.approx(100 * rate, rel=0.15)
    assert cautions(stepped.filtered("x", cutoff=50.0)) == ()
    assert cautions(record(t, x=1e-6 * np.round(x / 1e-6))) == ()  # digits of a file


def test_only_inputs_are_to_be_filtered():
    """It advised to filter a measured output, which would distort a fit."""
    noisy = record(T, {"tip": "rad"}, tip=np.sin(T) + white(0.02))
    (any_signal,), (driving,) = cautions(noisy), cautions(noisy, "tip")
    assert any_signal.endswith(
        "If it is an input of the model, filter it first (an output stays as it is): filtered('tip')."
    )
    assert driving.endswith("friction. Filter it first: filtered('tip').")


def test_the_caution_measures_the_added_path():
    x = np.sin(T)
    y = x + white(0.02)
    added = np.abs(np.diff(y)).sum() / np.abs(np.diff(x)).sum() - 1
    said = float(cautions(record(y=y))[0].split("its path is ")[1].split(" %")[0])
    assert said == pytest.approx(100 * added, rel=0.05)
