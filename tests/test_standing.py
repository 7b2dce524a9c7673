"""Commands that were held from sample to sample: taken for anything else, they make a delay of half a sample."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import PID, FirstOrderLag, Sum
from tsmblocks.common.errors import DataError
from tsmblocks.common.interpolation import is_held, smooth_hold

T = 0.02 * np.arange(400)
SQUARE = np.where(T % 2 < 1, 1.0, -1.0)
FREE = ["lag.gain", "lag.time_constant"]
SAID = (
    "the input u is piecewise constant, and hold='linear' spreads each of its steps over a sample interval. If it was "
    "a zero-order hold, as at the output of a sampled controller, give hold='zero', or --hold zero."
)


def answered():
    """What 1 / (0.2 s + 1) makes of the square: exact from jump to jump."""
    y, keeps = np.zeros(len(T)), np.exp(-0.02 / 0.2)
    for k in range(1, len(T)):
        y[k] = keeps * y[k - 1] + (1 - keeps) * SQUARE[k - 1]
    return tsm.Record("run", T, {"u": SQUARE, "y": y + 0.003 * np.random.default_rng(0).standard_normal(len(T))}, {})


LAG = tsm.Diagram(
    title="lag", blocks={"lag": FirstOrderLag(gain=0.8, time_constant=0.3)}, inputs={"u": "lag.u"}, outputs={"y": "lag"}
)


FOUND = "u is piecewise constant: held between samples (hold='zero')."


def test_a_fit_finds_that_the_input_is_held_and_is_right_then():
    drawn = tsm.fit(LAG, answered(), free=FREE, hold="linear")
    assert f"run: {SAID}" in drawn.notes
    found = tsm.fit(LAG, answered(), free=FREE)
    assert f"run: {FOUND}" in found.notes
    assert found.hold == "zero"
    assert found.values == tsm.fit(LAG, answered(), free=FREE, hold={"u": "zero"}).values
    for fit, right in ((drawn, False), (found, True)):
        tau = fit["lag.time_constant"]
        assert (tau.low < 0.2 < tau.high) is right


def test_a_held_command_makes_no_delay():
    """Drawn as a curve, it made a dead time of half a sample that nothing in the plant has."""
    effects = ["dead_time", "first_order_lag", "resonance"]
    drawn = tsm.diagnose(LAG, answered(), free=FREE, noise_floor=0.003, effects=effects, hold="linear")
    assert [one.name for one in drawn.effects] == ["dead_time"]
    assert any("give hold='zero'" in text for text in drawn.notes)
    found = tsm.diagnose(LAG, answered(), free=FREE, noise_floor=0.003, effects=effects)
    assert (found.verdict, found.effects) == ("none", ())
    assert f"run: {FOUND}" in found.notes
    assert found.to_dict()["simulated"]["hold"] == "zero"


def test_the_default_is_the_same_wherever_a_recording_drives_a_diagram():
    """The command is held and the load is not: fits, scores and runs agree; the hold may be given."""
    blocks = {"e": Sum(signs="+-"), "lag": FirstOrderLag(gain=0.8, time_constant=0.3)}
    two = tsm.Diagram(blocks=blocks, wires=["e -> lag"], inputs={"u": "e.plus", "d": "e.minus"}, outputs={"y": "lag"})
    given = {"u": SQUARE, "d": np.sin(T), "y": 0.0 * T}
    data = tsm.Record("run", T, given, {})
    holds = {"u": "zero", "d": "cubic"}
    run = tsm.simulate(two, inputs={k: (T, given[k]) for k in holds}, step=0.02)
    np.testing.assert_array_equal(run["y"], tsm.simulate(two, inputs=dict.fromkeys(holds, data), step=0.02)["y"])
    told = tsm.simulate(two, inputs={k: (T, given[k]) for k in holds}, step=0.02, hold=holds)
    np.testing.assert_array_equal(run["y"], told["y"])
    np.testing.assert_allclose(tsm.score(two, data, step=0.02).items[0].simulated, run["y"], atol=1e-12)
    assert tsm.fit(two, data, free=["lag.gain"], start={"lag.gain": 0.5}).hold == holds
    with pytest.raises(DataError, match=r"hold: there is no input 'dd'\. Did you mean 'd'"):
        tsm.simulate(two, inputs={"u": 0.0, "d": 0.0}, hold={"dd": "zero"}, stop=1.0)


def test_an_input_whose_rate_is_needed_is_not_held():
    data = tsm.Record("run", T, {"x_in": SQUARE, "x_out": SQUARE}, {"x_in": "rad", "x_out": "rad"})
    sheath = tsm.load("tendon_sheath_symmetric")
    found = tsm.fit(sheath, data, free=["offset.bias"], starts=1)
    assert found.hold == "linear"
    assert any("x_in is piecewise constant, but its rate drives the diagram" in text for text in found.notes)


def moved(rng, n):
    """A smooth motion, with rests in one of three."""
    t, x = np.arange(n) * 0.01, np.zeros(n)
    if rng.random() < 1 / 3:
        at, level = 0, 0.0
        while at < n:
            takes, goal = int(rng.integers(12, 60)), rng.uniform(-1, 1)
            s = np.clip((np.arange(n) - at) / takes, 0, 1)
            x, level = x + (goal - level) * s**3 * (10 - 15 * s + 6 * s * s), goal
            at += takes + int(rng.integers(20, 200))
        return x
    for f in np.exp(rng.uniform(np.log(0.05), np.log(2.0), rng.integers(1, 6))):
        x += rng.random() * np.sin(2 * np.pi * (f * t + rng.random()))
    return x


def stairs(rng, n):
    """Levels kept for random times."""
    levels = np.repeat(rng.uniform(-1, 1, n), rng.integers(5, 200, n))
    return levels[:n]


def held_for_some_samples(rng, n):
    k = int(rng.integers(2, 20))
    return np.repeat(moved(rng, n)[::k], k)[:n]


def few_steps(rng, n):
    at = rng.integers(1, n - 1, rng.integers(1, 4))
    return np.sum([rng.uniform(0.1, 1) * (np.arange(n) >= k) for k in at], axis=0)


def step_test(rng, n):
    """Four to thirty steps of similar sizes at irregular instants."""
    steps = rng.uniform(1, 2, int(rng.integers(4, 30))) * np.where(rng.random() < 0.5, 1, -1)
    at = np.sort(rng.choice(np.arange(5, n - 5, 9), len(steps), replace=False))
    return np.sum([size * (np.arange(n) >= k) for size, k in zip(steps, at, strict=True)], axis=0)


def few_equal_steps(rng, n):
    """A staircase of four to nine equal steps, by hand."""
    at = rng.choice(np.arange(5, n - 5, 9), int(rng.integers(4, 10)), replace=False)
    return np.sum([np.arange(n) >= k for k in at], axis=0).astype(float)


def switched(rng, n):
    return np.repeat(rng.integers(0, 2, n), rng.integers(1, 4))[:n].astype(float)


def clocked_stairs_of_one_size(rng, n):
    return np.abs((np.arange(n) // int(rng.integers(5, 30))) % 20 - 10.0)


def quantised(rng, n):
    """From coarse encoders to fine ones, and read slowly."""
    x = moved(rng, n)
    slow = np.interp(np.linspace(0, n / rng.uniform(1, 20), n), np.arange(n), x)
    step = max(np.ptp(slow), 1e-3) / rng.uniform(20, 2000)
    return np.round(slow / step) * step


def quantised_and_printed(rng, n):
    """Counts of an encoder that are printed with two digits: steps of 0.08 and of 0.09."""
    return np.round(np.round(20 * moved(rng, n) / 0.0879) * 0.0879, 2)


def noisy(rng, n):
    return moved(rng, n) + rng.normal(0, 0.003, n)


def noisy_stairs(rng, n):
    return stairs(rng, n) + rng.normal(0, 0.003, n)


@pytest.mark.parametrize(
    "make", [stairs, held_for_some_samples, few_steps, step_test, few_equal_steps, switched, clocked_stairs_of_one_size]
)
def test_what_stands_and_jumps_is_held(make):
    rng = np.random.default_rng(1)
    held = [is_held(make(rng, int(rng.integers(600, 3000)))) for _ in range(200)]
    assert np.mean(held) >= 0.99


@pytest.mark.parametrize("make", [moved, quantised, quantised_and_printed, noisy, noisy_stairs])
def test_what_moves_is_not_held(make):
    rng = np.random.default_rng(2)
    held = [is_held(make(rng, int(rng.integers(600, 3000)))) for _ in range(200)]
    assert np.mean(held) <= 0.01


@pytest.mark.parametrize("x", [np.zeros(400), T, T[:4], T[:0], np.full(9, np.nan), np.sin(T) * 1e300], ids=str)
def test_there_is_nothing_held_in_what_does_not_jump(x):
    assert not is_held(x)


def test_the_smooth_curve_is_the_one_that_predicts_samples_from_their_neighbours():
    rng = np.random.default_rng(3)
    assert smooth_hold(T, np.sin(T)) == "cubic"
    assert smooth_hold(T, np.sin(T) + rng.normal(0, 0.1, len(T))) == "linear"
    assert smooth_hold(T, np.abs(T % 2 - 1)) == "linear"  # straight from corner to corner
    assert smooth_hold(T, np.round(np.interp(T, [0, 1.003, 2, 3.5, 8], [0, 0, 5, 5, -2]), 4)) == "linear"
    assert smooth_hold(T, np.where(T < 4, 0.0, np.sin(np.pi * (T - 4)) ** 2 * (T < 5))) == "cubic"  # a rest and a pulse
    assert smooth_hold(T, SQUARE) == "linear"  # where a spline would ring
    uneven = np.sort(rng.uniform(0, 8, 400))
    assert smooth_hold(uneven, uneven**3 - uneven) == "cubic"


def test_held_inputs_of_a_loop_are_diagnosed_without_what_takes_their_rate():
    """The controller passes jumps on at once, so what goes by the rate of its output is none to try there."""
    blocks = dict(e=Sum(signs="+-"), pid=PID(kp=4.0, ki=1.0, kd=0.0), lag=FirstOrderLag(gain=1.0, time_constant=0.2))
    loop = tsm.Diagram(
        title="loop",
        blocks=blocks,
        wires=["e -> pid -> lag -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"u": "pid", "y": "lag"},
    )
    run = tsm.simulate(loop, inputs={"r": (T, SQUARE)}, stop=T[-1], step=0.02, hold="zero")
    noise = 0.003 * np.random.default_rng(1).standard_normal((2, len(T)))
    record = tsm.Record("run", T, {"r": SQUARE, "u": run["u"] + noise[0], "y": run["y"] + noise[1]}, {})
    found = tsm.diagnose(loop, record, free=["lag.*"], noise_floor=0.003, hold="zero")
    assert found.verdict == "none"


@pytest.mark.parametrize(("share", "held"), [(1e-4, True), (0.3, False)])
def test_what_a_filter_leaves_beside_jumps_is_no_motion(share, held):
    """Twenty levels; behind every third jump the signal moves on for 40 samples, by a share of the jump."""
    rng = np.random.default_rng(5)
    x = np.repeat(rng.uniform(-30.0, 30.0, 20), 100)
    for k in range(100, len(x), 300):
        x[k : k + 40] += share * abs(x[k] - x[k - 1]) * np.linspace(1.0, 0.0, 40)
    assert is_held(x) is held
