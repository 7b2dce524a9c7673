"""A fit says where its residual is far above the noise of the recordings."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Play
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
    (said,) = (text for text in fit.to_dict()["notes"] if "times the noise" in text)
    assert said.startswith(f"The residual of x_out is {compared.above_noise:.0f} times the noise (")
    assert f"its error is {compared.above_noise:.0f} times the noise" in str(compared)
    assert compared.above_noise > 10
    assert (
        f" deg rms, {method_text(compared.noise_from)}): the model lacks an effect, and the intervals do not cover it."
        in said
    )
    assert said in str(fit).replace("\n  ", " ")
    assert "tsm.diagnose, tsmblocks diagnose" in said


def test_a_residual_of_the_size_of_the_noise_needs_no_word(data):
    assert "times the noise" not in str(tsm.fit(BOTH, data, starts=1))


def test_a_bound_may_be_the_cause(data):
    held = tsm.fit(BOTH, data, starts=1, bounds={"play.half_width": (0.0, 0.01)}, start={"play.half_width": 0.005})
    assert "): a bound or constraint prevents a better fit, or the model lacks an effect" in held.to_dict()["notes"][-1]
