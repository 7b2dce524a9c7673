"""A size on a signal that is an acceleration is reported as a force too, or called an acceleration."""

import attrs
import pytest

import tsmblocks as tsm
from tests.diagnoses import BACKLASH
from tests.test_report import NAMED, diagnosis
from tsmblocks.blocks import Gain, Integrator, Sum
from tsmblocks.diagnosis.presentation import main_sizes
from tsmblocks.diagnosis.quantities import as_force
from tsmblocks.diagnosis.result import Quantity
from tsmblocks.html.report import page

SIZE = Quantity(0.7959, 0.7946, 0.7972, "m/s^2")


def cart(gain=0.001):
    """A mass that a force and gravity accelerate."""
    return tsm.Diagram(
        blocks={"inertia": Gain(gain=gain, unit="m/s^2"), "sum": Sum(), "speed": Integrator()},
        wires=["inertia -> sum.plus", "sum -> speed"],
        inputs={"force": tsm.Inlet(("inertia.u",), "N", ""), "gravity": tsm.Inlet(("sum.minus",), "m/s^2", "")},
        outputs={"v": "speed.y"},
    )


@pytest.mark.parametrize(
    ("size", "signal", "diagram", "words"),
    [
        (SIZE, "inertia.y", cart(), "796 N at the input of inertia"),
        (SIZE, "inertia.y", cart(-0.001), "796 N at the input of inertia"),
        (SIZE, "sum.y", cart(), "an acceleration: times the mass, a force"),
        (SIZE, "inertia.y", cart(0.0), "an acceleration: times the mass, a force"),
        (SIZE, "speed.y", cart(), ""),  # an acceleration at which a speed is limited
        (attrs.evolve(SIZE, unit="N"), "inertia.y", cart(), ""),
        (attrs.evolve(SIZE, unit=""), "inertia.y", cart(), ""),
    ],
)
def test_an_acceleration_is_a_force_at_the_input_of_the_gain_before_it(size, signal, diagram, words):
    assert as_force(size, signal, diagram) == words


def test_a_torque_belongs_to_an_angular_acceleration():
    shaft = tsm.Diagram(
        blocks={"sum": Sum(), "speed": Integrator()},
        wires=["sum -> speed"],
        inputs={"a": tsm.Inlet(("sum.plus",), "rad/s^2", ""), "b": tsm.Inlet(("sum.minus",), "rad/s^2", "")},
        outputs={"v": "speed.y"},
    )
    size = attrs.evolve(SIZE, unit="rad/s^2")
    assert as_force(size, "sum.y", shaft) == "an acceleration: times the inertia, a torque"


def test_the_force_stands_behind_the_size_everywhere_but_in_the_file():
    friction = attrs.evolve(BACKLASH, sizes={"friction": SIZE}, as_force={"friction": "796 N at the input of inertia"})
    words = "0.7959 ± 0.0013 m/s^2, 796 N at the input of inertia"
    assert main_sizes(friction, NAMED) == [f"friction {words}"]
    whole = diagnosis(attrs.evolve(NAMED, effects=(friction,)))
    assert f"  friction  {words}\n" in str(whole)
    assert f"friction {words}" in page(whole)
    assert "as_force" not in whole.to_json()


def test_detection_limits_that_are_accelerations_are_called_so():
    note = "Sizes in m/s^2 are accelerations: times the mass, forces."
    limits = tuple(attrs.evolve(one, size=0.04, size_unit="m/s^2", size_name="friction") for one in NAMED.limits)
    whole = diagnosis(attrs.evolve(NAMED, limits=limits))
    assert note in str(whole)
    assert note in page(whole)
    assert "accelerations" not in str(diagnosis()) + page(diagnosis())
