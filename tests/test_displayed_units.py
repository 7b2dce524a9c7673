"""Units in which people read results: those of the recordings, angles in degrees, angular speeds in rad/s."""

import pickle

import pytest

import tsmblocks as tsm
from tsmblocks import blocks
from tsmblocks.blocks import RateLimit, SecondOrderLag
from tsmblocks.common.displayed_units import DisplayedUnit, display_unit, displayed_in, times, unit_over
from tsmblocks.common.rounding import plus_minus
from tsmblocks.common.units import parse
from tsmblocks.diagnosis.model_difference import difference
from tsmblocks.effects import Size
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
def test_a_parameter_is_a_frequency_or_a_speed_and_shown_in_rad_per_second(block, name, field):
    frequency, speed = (any(word in field.about for word in words) for words in (FREQUENCY, SPEED))
    assert frequency != speed, f"{block}.{name}: say whether it is a frequency or a speed"
    assert display_unit(field.unit) == (1.0, "rad/s")


def test_a_natural_frequency_keeps_its_unit_through_a_diagram():
    before = tsm.Diagram(blocks={"servo": SecondOrderLag(omega=30.0)}, inputs={"u": "servo.u"}, outputs={"y": "servo"})
    (changed,) = difference(before, before.with_parameters({"servo.omega": 41.2})).parameters
    assert changed.words == "servo.omega  30.0 -> 41.2 rad/s"
    (field, *_) = numbers(before)["servo.omega"]
    assert plus_minus(41.2, 0.6, field.unit) == "41.20 ± 0.60 rad/s"


def test_the_rate_of_an_angle_is_shown_in_degrees_as_the_angle_is():
    assert [display_unit(one)[1] for one in ("rad", "rad/s", "rpm", "deg/s")] == ["deg", "rad/s", "rpm", "deg/s"]
    rate = times("rad", "s", -1)
    assert (rate, display_unit(rate)[1]) == ("rad/s", "deg/s")
    assert display_unit(times(rate, "s", -1))[1] == "deg/s^2"
    assert display_unit(unit_over("rad", "min"))[1] == "deg/min"
    limit = tsm.Diagram(
        blocks={"limit": RateLimit()}, inputs={"u": tsm.Inlet(("limit.u",), "rad", "")}, outputs={"y": "limit"}
    )
    changed = difference(limit, limit.with_parameters({"limit.rising": 1.0})).parameters[0]
    assert changed.words.endswith(" -> 57.3 deg/s")


@pytest.mark.parametrize(
    ("wire", "other", "label", "shown"),
    [
        ("V", DisplayedUnit("Pa", "bar"), "V/Pa", "V/bar"),
        (DisplayedUnit("m", "mm"), "V", "m/V", "mm/V"),
        (DisplayedUnit("m", "mm"), "m", "", ""),
        ("", DisplayedUnit("m", "mm"), "1/m", "1/mm"),
        ("rad", "V", "rad/V", "rad/V"),
        (DisplayedUnit("m", "mm"), "m/s^2", "m/(m/s^2)", "mm/(m/s^2)"),
        ("m", DisplayedUnit("rad/s", "rpm"), "m/(rad/s)", "m/rpm"),
        ("m", "N m", "m/(N m)", "m/(N m)"),
        ("m", "1/(V*s)", "m*V*s", "m*V*s"),
    ],
)
def test_a_size_per_signal_is_shown_in_the_units_of_both(wire, other, label, shown):
    unit = Size("slope", lambda p, _: 1.0, "{u}/{x}").unit_for(wire, other)
    assert (unit, display_unit(unit)[1]) == (label, shown)


def test_a_unit_is_shown_in_that_of_a_recording_of_the_same_quantity():
    pressure = displayed_in("Pa", ["", "mm", "kPa", "bar"])
    assert pressure == "Pa"
    assert display_unit(pressure) == (pytest.approx(1e-3), "kPa")
    assert display_unit(times(displayed_in("m", ["mm"]), "s", -1)) == (pytest.approx(1e3), "mm/s")
    assert display_unit(times(displayed_in("m", ["mm"]), "s"))[1] == "mm*s"
    assert display_unit(displayed_in("deg", ["rev"]))[1] == "rev"


@pytest.mark.parametrize(
    ("label", "recorded"), [("Pa", []), ("Pa", ["m", "no unit"]), ("", ["m"]), ("rad", ["rad"]), ("K", ["degC"])]
)
def test_without_another_unit_of_the_same_quantity_a_label_stays(label, recorded):
    assert displayed_in(label, recorded) is label


def test_a_displayed_unit_keeps_both_units_in_a_pickle():
    again = pickle.loads(pickle.dumps(DisplayedUnit("Pa", "bar")))
    assert (again, again.shown) == ("Pa", "bar")


def test_no_unit_is_not_a_pure_number_that_a_recording_has_in_percent():
    assert display_unit(displayed_in("%", ["", "%"])) == (1.0, "%")
    assert display_unit(displayed_in("", ["%"])) == (1.0, "")
    assert display_unit(displayed_in("1", ["%"])) == (pytest.approx(100.0), "%")
