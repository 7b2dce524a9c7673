"""Commands that were held from sample to sample: taken for anything else, they make a delay of half a sample."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import PID, FirstOrderLag, Sum
from tsmblocks.fitting.input_checks import standing

T = 0.02 * np.arange(400)
SQUARE = np.where(T % 2 < 1, 1.0, -1.0)
FREE = ["lag.gain", "lag.time_constant"]
SAID = (
    "the input u is piecewise constant, and hold='linear' draws each of its steps out over a sample interval. If it "
    "was a zero-order hold, as a controller applies its command, give hold='zero', or --hold zero."
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


def test_a_fit_says_what_to_do_and_is_right_then():
    drawn = tsm.fit(LAG, answered(), free=FREE)
    assert f"run: {SAID}" in drawn.notes
    kept = tsm.fit(LAG, answered(), free=FREE, hold="zero")
    assert not any("piecewise constant" in text for text in kept.notes)
    for found, right in ((drawn, False), (kept, True)):
        tau = found["lag.time_constant"]
        assert (tau.low < 0.2 < tau.high) is right


def test_a_diagnosis_says_so_beside_the_delay_that_it_makes():
    effects = ["dead_time", "first_order_lag", "resonance"]
    drawn = tsm.diagnose(LAG, answered(), free=FREE, noise_floor=0.003, effects=effects)
    assert [one.name for one in drawn.effects] == ["dead_time"]
    assert any("give hold='zero'" in text for text in drawn.notes)
    kept = tsm.diagnose(LAG, answered(), free=FREE, noise_floor=0.003, effects=effects, hold="zero")
    assert (kept.verdict, kept.effects) == ("none", ())


@pytest.mark.parametrize(
    ("x", "told"),
    [
        (SQUARE, True),
        (np.round(SQUARE * 3 + T / 4), True),
        (np.zeros(400), False),
        (np.sin(T), False),
        (np.round(np.sin(T) * 500) / 500, False),
        (np.repeat(np.sin(T[::4]), 4), False),  # quantised, and sampled slowly
    ],
    ids=["square", "staircase", "nothing", "smooth", "quantised", "slow"],
)
def test_what_stands_and_jumps(x, told):
    record = tsm.Record("run", T, {"u": x, "y": x}, {})
    assert list(standing(record, ["u"], "linear")) == ([SAID] if told else [])
    assert list(standing(record, ["u"], "zero")) == []


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
