"""An angular frequency is displayed in rad/s, a speed in deg/s, for every parameter of every block."""

import pickle

import pytest

import tsmblocks as tsm
from tsmblocks import blocks
from tsmblocks.blocks import SecondOrderLag
from tsmblocks.common.rounding import plus_minus
from tsmblocks.common.units import ANGULAR_FREQUENCY, display_unit, parse
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.fitting.parameters import numbers

FREQUENCY = ("frequency", "zeros", "poles", "corner", "bandwidth", "cut-off")
SPEED = ("speed", "velocity", "rate")
KINDS = [getattr(blocks, name) for name in blocks.__all__]
RATES = [
    (kind.__name__, name, field)
    for kind in KINDS
    if isinstance(kind, type)
    for name, field in kind.fields().items()
    if field.unit and "?" not in field.unit and parse(field.unit).dimension == parse("rad/s").dimension
]


@pytest.mark.parametrize(("block", "name", "field"), RATES, ids=lambda one: one if isinstance(one, str) else "")
def test_a_parameter_is_a_frequency_or_a_speed_and_shown_as_such(block, name, field):
    frequency, speed = (any(word in field.about for word in words) for words in (FREQUENCY, SPEED))
    assert frequency != speed, f"{block}.{name}: say whether it is a frequency or a speed"
    assert display_unit(field.unit)[1] == ("rad/s" if frequency else "deg/s")


def test_both_kinds_are_in_the_catalogue():
    assert {display_unit(field.unit)[1] for _, _, field in RATES} == {"rad/s", "deg/s"}


def test_a_natural_frequency_keeps_its_unit_through_a_diagram():
    before = tsm.Diagram(blocks={"servo": SecondOrderLag(omega=30.0)}, inputs={"u": "servo.u"}, outputs={"y": "servo"})
    (changed,) = difference(before, before.with_parameters({"servo.omega": 41.2})).parameters
    assert changed.words == "servo.omega  30 -> 41.2 rad/s"
    (field, *_) = numbers(before)["servo.omega"]
    assert plus_minus(41.2, 0.6, field.unit) == "41.20 ± 0.60 rad/s"
    assert display_unit(pickle.loads(pickle.dumps(ANGULAR_FREQUENCY))) == (1.0, "rad/s")
