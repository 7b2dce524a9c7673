"""What a missing effect means for control: tracking behind compensators on the base and on the new model."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Lag, Play, Saturation
from tsmblocks.diagnosis.consequence import NAMES_HOLD, NOT_TRACKED, consequence, inverse

DEG = np.pi / 180
T = np.arange(0.0, 8.0, 0.01)


def model(diagram, unit="rad", amplitude=40.0):
    """A model as far as it is asked here: a diagram beside one experiment, at numbers that are its own."""
    record = tsm.Record("run", T, {"x_in": amplitude * DEG * np.sin(1.7 * T)}, {"x_in": unit})
    setup = SimpleNamespace(
        experiments=[SimpleNamespace(name="run", record=record)], outputs=("x_out",), diagram=diagram
    )
    unknowns = SimpleNamespace(settings=lambda theta, e: {})
    return SimpleNamespace(diagram=diagram, setup=setup, theta=None, problem=SimpleNamespace(unknowns=unknowns))


def test_where_the_gain_was_wrong_the_new_model_leaves_next_to_nothing():
    base = tsm.load("tendon_sheath_linear").with_parameters({"gain.gain": 0.9, "offset.bias": 0.0})
    found = consequence(model(base), model(base.with_parameters({"gain.gain": 0.6})))
    assert found.none == pytest.approx((2 * 0.4 * 40 * DEG, 0.4 * 40 * DEG / np.sqrt(2)), rel=0.03)
    assert found.base == pytest.approx((2 * 40 * DEG / 3, 40 * DEG / 3 / np.sqrt(2)), rel=0.03)
    assert found.augmented[0] < 0.01 * found.base[0]
    assert (found.words, found.unit, found.reference) == ("", "rad", "run")


def test_a_gap_is_crossed_faster_by_the_compensator_that_knows_it():
    base = tsm.load("tendon_sheath_linear").with_parameters({"gain.gain": 1.0, "offset.bias": 0.0})
    found = consequence(model(base), model(base.insert("gap", Play(half_width=1.2 * DEG), after="gain.y")))
    assert found.none[1] == pytest.approx(found.base[1], rel=0.03)
    assert found.augmented[1] < 0.3 * found.base[1]


def test_a_compensator_that_knows_more_and_does_no_better_is_explained():
    base = tsm.load("tendon_sheath_linear").with_parameters({"gain.gain": 1.0, "offset.bias": 0.0})
    found = consequence(model(base), model(base))
    assert found.words == ""
    other = base.insert("gap", Play(half_width=0.01 * DEG), after="gain.y")
    found = consequence(model(other), model(base))
    said = [found.augmented[k] > found.base[k] for k in (0, 1)]
    assert bool(found.words) == any(said)


def test_a_compensator_that_makes_matters_worse_says_nothing_about_control():
    """Around a plant that is stuck at a limit, the loop around the model winds up."""
    plant = tsm.load("tendon_sheath_linear").with_parameters({"gain.gain": 1.0, "offset.bias": 0.0})
    slow = Lag(time_constant=0.5)
    low = plant.insert("limit", Saturation(low=-5 * DEG, high=5 * DEG), after="gain.y").insert(
        "lag", slow, after="limit.y"
    )
    assert consequence(model(low), model(low)) == (f"{NOT_TRACKED} does worse than none. {NAMES_HOLD}")


def test_what_cannot_be_tracked_says_why_where_a_compensator_is_meant():
    base = tsm.load("tendon_sheath_linear")
    volts = tsm.Diagram(
        title="v", blocks={"g": Gain()}, inputs={"x_in": tsm.Inlet("g.u", unit="V")}, outputs={"x_out": "g"}
    ).rewire(blocks={"g": Gain(unit="rad")})
    assert consequence(model(volts, "V"), model(volts, "V")) == ""  # no compensator is meant
    two = model(base)
    two.setup.outputs = ("x_out", "u")
    assert consequence(two, two) == ""
    back = base.with_parameters({"gain.gain": -1.0})
    assert consequence(model(back), model(back)) == (
        "Tracking was not simulated: the compensator, a fast feedback loop around the model that finds the command for "
        "a wanted motion, is unstable with this model, as with most that have an inertia. That is a limit of this "
        "compensator, not of the mechanism; the verdict does not depend on it."
    )


def test_a_command_begins_where_it_is_told():
    made = inverse(tsm.load("tendon_sheath_linear"), "x_in", "x_out", 10.0, start=0.3)
    assert (made.parameters["fast.integral"], made.parameters["soft.value"]) == (0.3, 0.3)
