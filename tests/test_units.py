"""Unit labels: what is read, what is refused, and labels of rates and integrals."""

import math

import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Gain, Integrator
from tsmblocks.common import units
from tsmblocks.common.displayed_units import times
from tsmblocks.common.headings import split_heading
from tsmblocks.common.units import UnitError, factor, parse, same
from tsmblocks.model.unit_inference import unit_label


@pytest.mark.parametrize(
    ("label", "other"),
    [
        ("N/(m*s)", "N/m/s"),
        ("1/(V s)", "1/V/s"),
        ("(m/s)", "m/s"),
        ("(N*m)/rad", "Nm/rad"),
        ("N m", "Nm"),
        ("μm", "um"),  # the Greek letter
        ("µm", "um"),  # the sign of micro
        ("rpm/s", "rev/min/s"),
        ("m / s²", "m/s^2"),
    ],
)
def test_labels_of_one_meaning(label, other):
    assert same(label, other)


def test_units_of_a_motors_data_sheet():
    assert factor("V/rpm", "V*s/rad") == pytest.approx(60 / (2 * math.pi))
    assert factor("mN*m/A", "Nm/A") == pytest.approx(1e-3)


def test_a_unit_over_a_quotient():
    assert factor("mm/(m/s^2)", "m*s^2/m") == pytest.approx(1e-3)
    assert factor("V/(rad/s)", "V*s/rad") == 1.0


@pytest.mark.parametrize("label", ["m/(m/s", "m/((m/s))", "m/(/s)", "/(m/s)", "m/()"])
def test_parentheses_that_hold_no_unit(label):
    with pytest.raises(UnitError, match="is not a unit known here"):
        factor(label, "m")


@pytest.mark.parametrize("label", ["N/m*s", "rad/V*s", "1/s*m/kg"])
def test_a_product_below_the_line_wants_brackets(label):
    with pytest.raises(UnitError, match="can be read in two ways"):
        units.parse(label)


@pytest.mark.parametrize("label", ["(N*m", "N(m)", "(m)(s)"])
def test_brackets_that_do_not_close_are_refused(label):
    with pytest.raises(UnitError, match="is not a unit known here"):
        units.parse(label)


@pytest.mark.parametrize("label", ["rad", "rad/s", "rad/V", "m/s^2", "rad/us", "1/s", "N*m", "N/(m*s)", "1", "V/rpm"])
def test_a_rate_and_an_integral_are_what_they_say(label):
    """A label made of another by a factor of time means that much more or less of it."""
    plain, second = units.parse(label), units.parse("s")
    for exponent in (1, -1):
        made = units.parse(times(label, "s", exponent))
        assert made.factor == pytest.approx(plain.factor * second.factor**exponent)
        powers = dict(plain.dimension)
        powers["s"] = powers.get("s", 0) + exponent
        assert dict(made.dimension) == {k: n for k, n in powers.items() if n}


@pytest.mark.parametrize(
    ("above", "below", "label"),
    [
        ("kN", "mm", "kN/mm"),
        ("V", "rad/s", "V*s/rad"),
        ("rad", "V", "rad/V"),
        ("m", "s^2", "m/s^2"),
        ("N*m", "rad", "N*m/rad"),
        ("Pa/s", "m^3/s", "Pa/m^3"),
        ("m/s", "Pa", "m/(s*Pa)"),
        ("V", "1/s", "V*s"),
        ("rad", "rad", ""),
        ("rad", "", ""),
    ],
)
def test_a_unit_over_another(above, below, label):
    assert units.quotient(above, below) == label
    if label:
        a, b, made = (units.parse(one) for one in (above, below, label))
        assert made.factor == pytest.approx(a.factor / b.factor)
        powers = {
            k: dict(a.dimension).get(k, 0) - dict(b.dimension).get(k, 0)
            for k in {*dict(a.dimension), *dict(b.dimension)}
        }
        assert dict(made.dimension) == {k: n for k, n in powers.items() if n}


@pytest.mark.parametrize(("rate", "label"), [("cm/s", "cm"), ("um/s", "um"), ("kPa/s", "kPa"), ("deg/s", "deg")])
def test_the_integral_of_a_rate_has_a_unit_that_can_be_read_again(rate, label):
    diagram = tsm.Diagram(
        blocks={"rate": Gain(unit=rate), "level": Integrator()},
        wires=["rate -> level"],
        inputs={"u": tsm.Inlet(["rate"], unit="V")},
        outputs={"h": "level"},
    )
    assert diagram.unit("h") == label


@pytest.mark.parametrize(
    ("written", "meant"),
    [("m3/h", "m^3/h"), ("m³/h", "m^3/h"), ("m/s2", "m/s^2"), ("N/mm2", "N/mm^2"), ("percent", "%")],
)
def test_powers_may_be_written_without_a_sign(written, meant):
    assert parse(written) == parse(meant)


def test_a_number_in_round_brackets_is_that_of_a_motor():
    assert split_heading("angle (m2)") == ("angle (m2)", "")
    assert split_heading("flow (m3/h)") == ("flow", "m3/h")
    assert split_heading("area [m2]") == ("area", "m2")


@pytest.mark.parametrize("label", ["s4", "deg23", "m-2", "2m"])
def test_other_digits_are_no_powers(label):
    with pytest.raises(UnitError):
        parse(label)


@pytest.mark.parametrize("written", ["l/(min*s)", "m^3/(h*s)", "l/(min*s*bar)", "kN*mm/(min*h)", "in*lbf/ft"])
def test_the_label_of_an_inferred_unit_can_be_read_again(written):
    """A flow in l/min behind an integrator stopped a diagnosis: the inferred label had a factor that no one read."""
    unit = parse(written)
    again = parse(unit_label(unit))
    assert again.dimension == unit.dimension
    assert again.factor == pytest.approx(unit.factor, rel=1e-12)
    assert parse(times(unit_label(unit), "s")).factor == pytest.approx(unit.factor, rel=1e-12)


def test_a_rate_of_a_flow_has_a_readable_label():
    assert unit_label(parse("l/(min*s)")) == "l/(min*s)"
    assert parse("0.0254*m^2").factor == pytest.approx(0.0254)
