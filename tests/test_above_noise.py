"""A fit says where its residual is far above the noise of the recordings."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, Jump, Play, Saturation
from tsmblocks.data.noise_floor import method_text

T = np.arange(0, 20, 0.02)
X = np.radians(20) * np.sin(2 * np.pi * 0.25 * T)
PLAY = tsm.Diagram(
    title="play",
    blocks={"play": Play(half_width=0.02)},
    inputs={"x_in": tsm.Inlet(["play"], unit="rad")},
    outputs={"x_out": "play"},
)
BOTH = tsm.Diagram(
    blocks={"play": Play(half_width=0.03, gain=0.8), "lag": FirstOrderLag(time_constant=0.2)},
    wires=["play -> lag"],
    inputs={"x_in": tsm.Inlet(["play"], unit="rad")},
    outputs={"x_out": "lag"},
)


@pytest.fixture(scope="module")
def data():
    y = tsm.simulate(BOTH, inputs={"x_in": (T, X)}, step=0.02)["x_out"]
    y = np.degrees(y) + 0.03 * np.random.default_rng(0).standard_normal(len(T))
    return tsm.Record("run", T, {"x_in": np.degrees(X), "x_out": y}, {"x_in": "deg", "x_out": "deg"})


def test_a_residual_far_above_the_noise_is_told_as_in_a_comparison(data):
    fit, compared = tsm.fit(PLAY, data, starts=1), tsm.compare({"play": PLAY}, data, train=1, starts=1)
    (said,) = (text for text in fit.to_dict()["notes"] if "times the noise floor" in text)
    assert said.startswith(f"The residual of x_out is {compared.above_noise:.0f} times the noise floor (")
    assert f"The error of play is {compared.above_noise:.0f} times the noise floor" in str(compared)
    assert compared.above_noise > 10
    assert (
        f" deg rms, {method_text(compared.noise_from)}): the model lacks an effect, and the intervals do not cover it."
        in said
    )
    assert said in str(fit).replace("\n  ", " ")
    assert "tsm.diagnose, tsmblocks diagnose" in said


def test_a_residual_of_the_size_of_the_noise_needs_no_word(data):
    assert "times the noise floor" not in str(tsm.fit(BOTH, data, starts=1))


def test_a_bound_may_be_the_cause(data):
    held = tsm.fit(BOTH, data, starts=1, bounds={"play.half_width": (0.0, 0.01)}, start={"play.half_width": 0.005})
    assert "): a bound or constraint prevents a better fit, or the model lacks an effect" in held.to_dict()["notes"][-1]


# ---- what it may come from

LAG = tsm.Diagram(
    blocks={"gain": Gain(gain=2.0), "lag": FirstOrderLag(time_constant=0.5)},
    wires=["gain -> lag"],
    inputs={"u": "gain"},
    outputs={"y": "lag"},
)


def answered(diagram=LAG, spike=0.0):
    y = tsm.simulate(diagram, inputs={"u": (T, X)}, step=0.02)["y"] + 1e-3 * np.random.default_rng(0).normal(
        size=len(T)
    )
    y[310:312] += spike
    return tsm.Record("run", T, {"u": X, "y": y}, {})


def cause(fit):
    (said,) = (text for text in fit.to_dict()["notes"] if "times the noise floor" in text)
    return said.partition("): ")[2]


def test_a_residual_that_decays_from_the_start_is_one_of_initial_states():
    data = answered(LAG.with_parameters({"lag.value": 1.0}))
    assert cause(tsm.fit(LAG, data, free=["*"], starts=1)) == (
        "it is largest at the start and decays, so the initial states may be wrong: "
        "estimate them (start_states=True, --start-states)."
    )
    assert "times the noise floor" not in str(tsm.fit(LAG, data, free=["*.time_constant"], starts=1, start_states=True))


def test_a_few_samples_that_hold_most_of_the_residual_are_pointed_at():
    notes = tsm.fit(LAG, answered(spike=2.0), free=["gain.gain"], starts=1).to_dict()["notes"]
    assert notes[-1] == (
        "The residual of y has 100 % of its square in 2 samples, the largest at t = 6.2 s of run: "
        "check the recording there."
    )


def test_fixed_parameters_that_would_remove_the_residual_are_named():
    data = answered(LAG.with_parameters({"lag.time_constant": 0.3}))
    assert cause(tsm.fit(LAG, data, free=["gain.gain"], starts=1)).startswith(
        "lag.time_constant, kept fixed, may be wrong (free=, --free), or the model lacks an effect"
    )
    assert tsm.fit(LAG, data, free=["gain.gain", "lag.time_constant"], starts=1).fixed_in_doubt == {}


def test_fixed_parameters_that_would_remove_nothing_are_not_named():
    data = answered(LAG.insert("hard", Saturation(low=-0.4, high=0.4), before="y"))
    early = LAG.insert("clock", Jump(size=0.0, time=18.0), before="lag.u")
    fit = tsm.fit(early, data, free=["gain.*", "lag.time_constant"], starts=1)
    assert fit.fixed_in_doubt == {}
    assert cause(fit).startswith("the model lacks an effect")
