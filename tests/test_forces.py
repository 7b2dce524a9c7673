"""A size on a signal that is an acceleration is reported as a force too, or called an acceleration."""

import re

import attrs
import numpy as np
import pytest

import tsmblocks as tsm
from tests.diagnoses import BACKLASH
from tests.test_report import NAMED, diagnosis
from tsmblocks.blocks import Bias, CoulombFriction, Gain, Integrator, Sum
from tsmblocks.diagnosis.presentation import main_sizes
from tsmblocks.diagnosis.quantities import as_force
from tsmblocks.diagnosis.segment import Quantity
from tsmblocks.html.report import page

SIZE = Quantity(0.7959, 0.7946, 0.7972, "m/s^2")
FORCE = Quantity(795.9, 794.6, 797.2, "m/s^2")
"""The same over the gain of the cart."""


def cart(gain=0.001):
    """A mass that a force and gravity accelerate."""
    return tsm.Diagram(
        blocks={"inertia": Gain(gain=gain, unit="m/s^2"), "sum": Sum(), "speed": Integrator()},
        wires=["inertia -> sum.plus", "sum -> speed"],
        inputs={"force": tsm.Inlet(("inertia.u",), "N", ""), "gravity": tsm.Inlet(("sum.minus",), "m/s^2", "")},
        outputs={"v": "speed.y"},
    )


def with_friction():
    """The cart with an effect that was added before, on the same wire."""
    once = cart().insert("coulomb_friction", Bias(), before="sum.plus")
    return once.insert("coulomb_friction_2", Bias(), before="sum.plus")


@pytest.mark.parametrize(
    ("size", "signal", "diagram", "words"),
    [
        (FORCE, "inertia.y", cart(), "795.9 ± 1.3 N at the input of inertia"),
        (FORCE, "inertia.y", cart(-0.001), "795.9 ± 1.3 N at the input of inertia"),
        (FORCE, "coulomb_friction_2.y", with_friction(), "795.9 ± 1.3 N at the input of inertia"),
        (SIZE, "sum.y", cart(), "an acceleration: times the mass, a force"),
        (SIZE, "inertia.y", cart(0.0), "an acceleration: times the mass, a force"),
        (SIZE, "speed.y", cart(), ""),  # an acceleration at which a speed is limited
        (attrs.evolve(SIZE, unit="N"), "inertia.y", cart(), ""),
        (attrs.evolve(SIZE, unit=""), "inertia.y", cart(), ""),
    ],
)
def test_an_acceleration_is_a_force_at_the_input_of_the_gain_before_it(size, signal, diagram, words):
    assert as_force(size, signal, diagram) == words


def sliding(t, force, gain, friction):
    """Places of a mass of 1/gain under a force and dry friction, in 50 steps of Euler's method a sample."""
    step = (t[1] - t[0]) / 50
    speed, places = 0.0, []
    for drive in np.interp(step * np.arange(len(t) * 50), t, force):
        places.append(places[-1] + step * speed if places else 0.0)
        faster = speed + step * gain * drive
        speed = np.sign(faster) * max(abs(faster) - step * gain * friction, 0.0)
    return np.array(places[::50])


def test_a_force_has_its_own_interval():
    """That of a fit of the same friction in N, since the estimates of mass and acceleration go together."""
    model = tsm.Diagram(
        blocks={"inertia": Gain(gain=0.5, unit="m/s^2"), "speed": Integrator(), "place": Integrator()},
        wires=["inertia -> speed -> place"],
        inputs={"force": tsm.Inlet(("inertia.u",), "N", "")},
        outputs={"x": "place.y"},
    )
    t = 0.01 * np.arange(800)
    force = 3.0 * np.sin(2.1 * t) + 2.0 * np.sin(5.3 * t)
    x = sliding(t, force, 0.4, 1.0) + np.random.default_rng(0).normal(0.0, 2e-4, t.size)
    record = tsm.Record("run", t, {"force": force, "x": x}, {"force": "N", "x": "m"})
    found = tsm.diagnose(model, record, free=["inertia.gain"], effects=["coulomb_friction"], hold="linear")
    (friction,) = found.effects
    said = re.fullmatch(r"(\S+) ± (\S+) N at the input of inertia", friction.as_force["friction"])
    value, half = map(float, said.groups())
    assert abs(value - 1.0) < 2 * half
    direct = tsm.fit(
        tsm.Diagram(
            blocks={**model.blocks, "net": Sum(signs="+-"), "dry": CoulombFriction(level=0.5, smoothing=0.01)},
            wires=["net -> inertia -> speed -> place", "speed -> dry -> net.minus"],
            inputs={"force": tsm.Inlet(("net.plus",), "N", "")},
            outputs=dict(model.outputs),
        ),
        record,
        free=["inertia.gain", "dry.*"],
        start_states=True,
        hold="linear",
    )
    (level,) = (one for one in direct.estimates if one.name == "dry.level")
    assert value == pytest.approx(level.value, rel=2e-3)
    assert half == pytest.approx((level.high - level.low) / 2, rel=0.3)


def test_a_force_is_not_stated_where_only_the_ratio_of_forces_is_determined():
    """With an amplifier of unknown gain in front of the mass, twice the gain and twice the mass leave the same."""
    t = 0.01 * np.arange(800)
    command = 3.0 * np.sin(2.1 * t) + 2.0 * np.sin(5.3 * t)
    x = sliding(t, command, 0.4, 1.0) + np.random.default_rng(0).normal(0.0, 2e-4, t.size)
    record = tsm.Record("run", t, {"command": command, "x": x}, {"command": "V", "x": "m"})
    model = tsm.Diagram(
        blocks={
            "amplifier": Gain(gain=1.2, unit="N"),
            "inertia": Gain(gain=0.5, unit="m/s^2"),
            "speed": Integrator(),
            "place": Integrator(),
        },
        wires=["amplifier -> inertia -> speed -> place"],
        inputs={"command": tsm.Inlet(("amplifier.u",), "V", "")},
        outputs={"x": "place.y"},
    )
    effects = ["coulomb_friction"]
    (friction,) = tsm.diagnose(model, record, effects=effects, hold="linear").effects
    assert not friction.as_force
    (friction,) = tsm.diagnose(model, record, free=["inertia.gain"], effects=effects, hold="linear").effects
    assert "N at the input of inertia" in friction.as_force["friction"]


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
    friction = attrs.evolve(
        BACKLASH, sizes={"friction": SIZE}, as_force={"friction": "795.9 ± 1.3 N at the input of inertia"}
    )
    words = "0.7959 ± 0.0013 m/s^2, 795.9 ± 1.3 N at the input of inertia"
    assert main_sizes(friction, NAMED) == [f"friction {words}"]
    whole = diagnosis(attrs.evolve(NAMED, effects=(friction,)))
    assert f"  friction  {words}\n" in str(whole)
    assert f"friction {words}" in page(whole)
    assert "as_force" not in whole.to_json()


def test_detection_limits_that_are_accelerations_are_called_so():
    note = "Sizes in m/s^2 are accelerations: times the mass, forces."
    limits = tuple(attrs.evolve(one, size=0.04, size_unit="m/s^2", size_name="friction") for one in NAMED.limits)
    whole = diagnosis(attrs.evolve(NAMED, limits=limits))
    assert note in whole.details()
    assert note in page(whole)
    assert "accelerations" not in str(diagnosis()) + page(diagnosis())


def test_accelerations_in_two_units_are_told_of_once():
    units = ["rad/s^2", "deg/s^2"]
    limits = tuple(
        attrs.evolve(one, size=0.04, size_unit=unit, size_name="friction")
        for one, unit in zip(NAMED.limits * 2, units, strict=False)
    )
    note = "are accelerations: times the inertia, torques."
    assert diagnosis(attrs.evolve(NAMED, limits=limits)).details().replace("\n", " ").count(note) == 1
