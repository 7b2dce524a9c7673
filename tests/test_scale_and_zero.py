"""A gain and an offset that a model has no parameter for are named, and not the nonlinearity that imitates them."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Gain, Lag, Play

T = np.arange(0.0, 12.0, 0.01)
LAG = tsm.Diagram(
    title="lag",
    blocks={"plant": Lag(time_constant=0.3), "scale": Gain(gain=1.2)},
    wires=["plant -> scale"],
    inputs={"u": tsm.Inlet(["plant"], unit="mm")},
    outputs={"y": "scale"},
)
FIXED = tsm.Diagram(
    title="lag without a gain",
    blocks={"plant": Lag(time_constant=0.3), "same": Bias()},
    wires=["plant -> same"],
    inputs={"u": tsm.Inlet(["plant"], unit="mm")},
    outputs={"y": "same"},
)


def recordings(model, offsets, gain=1.0):
    """Three motions, one for each offset."""
    made = []
    for k, offset in enumerate(offsets):
        rng = np.random.default_rng(10 + k)
        x = np.convolve(0.05 * rng.standard_normal(len(T)).cumsum(), np.ones(40) / 40, "same") + np.sin(2 * T)
        y = tsm.simulate(model, inputs={"u": (T, x)}, step=0.01)["y"]
        noise = 0.02 * rng.standard_normal(len(T))
        made.append(tsm.Record(f"run {k}", T, {"u": x, "y": gain * y + offset + noise}, {"u": "mm", "y": "mm"}))
    return made


def test_an_offset_is_no_slack():
    (named,) = tsm.diagnose(LAG, recordings(LAG, [0.1, 0.1, 0.1])).effects
    assert named.name == "offset"
    size, at_output = named.sizes["offset"], 1.2 if named.wire == "u -> plant.u" else 1.0
    assert size.low < 0.1 / at_output < size.high
    assert size.high - size.low < 0.005


def test_offsets_that_differ_between_recordings_are_found_in_each():
    (named,) = tsm.diagnose(LAG, recordings(LAG, [0.1, -0.05, 0.2])).effects
    assert named.name == "offset"
    found = [named.sizes[f"offset@run {k}"].value for k in range(3)]
    assert found == pytest.approx([0.1, -0.05, 0.2], abs=0.01)


def test_a_gain_error_is_no_creep():
    (named,) = tsm.diagnose(FIXED, recordings(FIXED, [0.0, 0.0, 0.0], gain=1.2)).effects
    assert named.name == "gain_error"
    assert named.sizes["error of the gain"].value == pytest.approx(20.0, abs=0.2)
    assert named.sizes["error of the gain"].unit == "%"


def test_one_offset_for_all_recordings_beside_a_backlash():
    """Alone, separate offsets explain a part of the backlash as well; beside it they do not."""
    loose = LAG.insert("slack", Play(half_width=0.08), after="scale.y")
    found = tsm.diagnose(LAG, recordings(loose, [0.1, 0.1, 0.1]), effects=["offset", "backlash", "jump", "drift"])
    sizes = {e.name: e.sizes for e in found.effects}
    assert set(sizes) == {"offset", "backlash"}
    assert "offset" in sizes["offset"]  # and no offset@run 0
    assert sizes["backlash"]["gap width"].low < 0.16 < sizes["backlash"]["gap width"].high
    assert "instead of backlash" not in found.sentence
