"""Effects inside a control loop that is in the diagram: on the control error, the command, and what is fed back."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import (
    Constant,
    DeadTime,
    FirstOrderLag,
    Gain,
    Integrator,
    Product,
    Saturation,
    Sum,
    ViscousFriction,
)
from tsmblocks.common.errors import DiagramError
from tsmblocks.diagnosis.control_loops import control_loops
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.shift_in_time import is_shift_in_time
from tsmblocks.fitting.parameters import chosen
from tsmblocks.model.arguments import Inlet
from tsmblocks.model.diagram import Diagram

SLOW_NEEDS = ["diagnosis"]
LOOP_WIRES = [
    "error -> controller -> amplifier -> motor -> force.plus -> mass -> speed -> position -> error.minus",
    "speed -> damper -> force.minus1",
    "position -> spring -> force.minus2",
]
LOOP = Diagram(
    title="a carriage on a spring in a position loop",
    blocks={
        "error": Sum(signs="+-"),
        "controller": Gain(gain=200.0, unit="V"),
        "amplifier": FirstOrderLag(gain=0.9, time_constant=0.015),
        "motor": Gain(gain=2.0, unit="N"),
        "force": Sum(signs="+--"),
        "mass": Gain(gain=0.5, unit="m/s^2"),
        "speed": Integrator(),
        "position": Integrator(),
        "damper": ViscousFriction(coefficient=22.0),
        "spring": Gain(gain=90.0, unit="N"),
    },
    wires=LOOP_WIRES,
    inputs={"ref": Inlet("error.plus", unit="m")},
    outputs={"x": "position"},
)


def places(diagram, place):
    return [point.words(diagram) for point in insertion_points(diagram, list(diagram.outputs)) if point.place == place]


# ---- the wires


def test_wires_of_a_control_loop():
    assert places(LOOP, "loop") == [
        "position.y -> error.minus, x",  # the sensor, which the spring does not see
        "position.y -> error.minus",
        "error.y -> controller.u",
        "controller.y -> amplifier.u",
    ]
    assert places(LOOP, "drive") == ["mass.y -> speed.u", "error.y -> controller.u", "controller.y -> amplifier.u"]


@pytest.mark.parametrize(
    ("sensor", "unit", "seen"),
    [
        (Gain(gain=50.0, unit="V"), "V", True),
        (Gain(gain=1.0), "", True),
        (Gain(gain=1e3, unit="mm"), "mm", True),
        (Gain(gain=90.0, unit="N"), "N", False),  # a spring
    ],
)
def test_a_position_is_fed_back_through_the_gain_of_its_sensor(sensor, unit, seen):
    wires = [wire.replace("-> error.minus", "-> sensor -> error.minus") for wire in LOOP_WIRES]
    inputs, units = {"ref": Inlet("error.plus", unit=unit)}, {"x": "m"}
    diagram = Diagram(
        blocks={**LOOP.blocks, "sensor": sensor},
        wires=wires,
        inputs=inputs,
        outputs={"x": "position"},
        output_units=units,
    )
    wires = ["sensor.y -> error.minus", "error.y -> controller.u", "controller.y -> amplifier.u"]
    assert places(diagram, "loop") == (wires if seen else [])


def test_a_voltage_of_a_speed_or_a_current_is_no_measurement():
    """The voltages of a motor balance as a control error does."""
    diagram = Diagram(
        blocks={
            "net": Sum(signs="+--"),
            "coil": Integrator(gain=100.0, unit="A"),
            "ohm": Gain(gain=2.0, unit="V"),
            "torque": Gain(gain=0.1, unit="N*m"),
            "speed": Integrator(gain=1e3, unit="rad/s"),
            "emf": Gain(gain=0.1, unit="V"),
        },
        wires=["net -> coil -> torque -> speed -> emf -> net.minus1", "coil -> ohm -> net.minus2"],
        inputs={"u": Inlet("net.plus", unit="V")},
        outputs={"w": "speed", "i": "coil"},
    )
    assert places(diagram, "loop") == []


def test_what_an_actuator_moves_is_a_place_in_the_loop():
    """The spool of a valve: behind its lag, where the pressure drop comes in."""
    diagram = Diagram(
        blocks={
            "error": Sum(signs="+-"),
            "card": Gain(gain=4.0, unit="V"),
            "limit": Saturation(low=-10.0, high=10.0),
            "spool": FirstOrderLag(time_constant=0.01),
            "drop": Constant(value=12.0),
            "flow": Product(),
            "speed": Gain(gain=3.0, unit="mm/s"),
            "travel": Integrator(),
        },
        wires=[
            "error -> card -> limit -> spool -> flow.u1",
            "drop -> flow.u2",
            "flow -> speed -> travel -> error.minus",
        ],
        inputs={"ref": Inlet("error.plus", unit="mm")},
        outputs={"x": "travel"},
    )
    wires = ["travel.y -> error.minus", "error.y -> card.u", "card.y -> limit.u", "spool.y -> flow.u1"]
    assert places(diagram, "loop") == wires


TWO_INERTIAS = Diagram(
    blocks={
        "net": Sum(signs="+-"),
        "motor": Gain(gain=430.0, unit="rad/s^2"),
        "speed": Integrator(),
        "rate": Sum(signs="+-"),
        "twist": Integrator(),
        "spring": Gain(gain=42.0, unit="N*m"),
        "damper": Gain(gain=0.024, unit="N*m"),
        "shaft": Sum(signs="++"),
        "load": Gain(gain=190.0, unit="rad/s^2"),
        "load_speed": Integrator(),
    },
    wires=[
        "net -> motor -> speed -> rate.plus",
        "load_speed -> rate.minus",
        "rate -> twist -> spring -> shaft.plus1",
        "rate -> damper -> shaft.plus2",
        "shaft -> net.minus, load",
        "load -> load_speed",
    ],
    inputs={"torque": Inlet("net.plus", unit="N*m")},
    outputs={"v": "speed"},
)


def test_the_integral_of_a_difference_of_speeds_is_a_deflection():
    assert places(TWO_INERTIAS, "deflection") == ["twist.y -> spring.u"]
    controlled = Diagram(  # the integral part of a controller of the speed is none
        blocks={
            "error": Sum(signs="+-"),
            "twist": Integrator(),
            "spring": Gain(gain=42.0, unit="N*m"),
            "motor": Gain(gain=430.0, unit="rad/s^2"),
            "speed": Integrator(),
        },
        wires=["error -> twist -> spring -> motor -> speed -> error.minus"],
        inputs={"reference": Inlet("error.plus", unit="rad/s")},
        outputs={"v": "speed"},
    )
    assert places(controlled, "deflection") == []


def test_a_coupling_that_stiffens_is_found_in_its_deflection():
    """By SciPy: the model without it is fitted with four times the acceleration, and its spring deflects otherwise."""
    from scipy.integrate import solve_ivp

    t = 0.002 * np.arange(2500)
    torque = sum(0.25 * np.sin(2 * np.pi * f * t + 1.3 * k) for k, f in enumerate((0.4, 2.2, 6.8, 11.0, 17.0, 23.0)))

    def rate(s, x):
        turning, other, twist = x
        shaft = 38 * twist * (1 + (twist / 0.012) ** 2) + 0.021 * (turning - other)
        return [476 * (np.interp(s, t, torque) - shaft), 172 * shaft, turning - other]

    v = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0, 0.0], t_eval=t, max_step=1e-3, rtol=1e-8, atol=1e-10).y[0]
    v = v + 0.05 * np.random.default_rng(2).standard_normal(len(t))
    record = tsm.Record("run", t, {"torque": torque, "v": v}, {"torque": "N*m", "v": "rad/s"})
    found = tsm.diagnose(TWO_INERTIAS, record, effects=["odd_nonlinearity", "backlash", "periodic_disturbance"])
    (effect,) = found.effects
    assert (effect.name, effect.wire) == ("odd_nonlinearity", "twist.y -> spring.u")
    fitted = found.augmented.parameters
    for name, true in (("motor.gain", 476), ("load.gain", 172), ("spring.gain", 38)):
        assert fitted[name] == pytest.approx(true, rel=0.1)


def test_a_control_error_is_no_deflection():
    """What a spring makes of a difference is a force; a controller makes a command of it."""
    straight = LOOP.rewire(
        cut=["controller.y -> amplifier.u", "amplifier.y -> motor.u"],
        blocks={k: b for k, b in LOOP.blocks.items() if k != "amplifier"},
        add=["controller -> motor"],
    )
    assert places(straight, "deflection") == []
    assert places(straight, "loop")
    sprung = straight.replace("controller", Gain(gain=200.0, unit="N")).replace("motor", Gain(gain=1.0))
    assert places(sprung, "deflection") == ["error.y -> controller.u"]
    assert places(sprung, "loop") == []


def test_an_inner_loop_takes_its_reference_from_the_outer_one():
    found = {one.error: one for one in control_loops(tsm.load("fig16_feedforward_feedback"), "motor.y", ())}
    assert list(found) == ["error"]
    assert found["error"].commands == ("controller.e", "drive.u")


def test_behind_a_block_that_was_named_the_loop_is_the_same():
    worn = LOOP.insert("gap", tsm.blocks.Play(half_width=1e-4), before="error.minus")
    assert next(control_loops(worn, "position.y", ["gap"])).fed_back == "error.minus"
    assert not list(control_loops(worn, "position.y", ()))


def test_behind_a_sensor_where_another_output_depends_on_it():
    """The recorded command is what the controller gives; what the amplifier makes of it is seen in the position."""
    both = LOOP.rewire(outputs={"x": "position", "u": "controller"})
    points = insertion_points(both, ["x", "u"])
    assert [p.words(both) for p in points if (p.place, p.output) == ("branch", "u")] == ["controller.y -> amplifier.u"]
    assert not [p for p in insertion_points(both, ["u"]) if p.place == "branch"]


def test_a_mode_is_driven_as_the_output_is():
    (point,) = (p for p in insertion_points(LOOP, ["x"]) if p.place == "mode")
    assert (point.signal, point.other) == ("position.y", "mass.y")
    stage = Diagram(blocks={"stage": FirstOrderLag()}, inputs={"u": "stage"}, outputs={"y": "stage"})
    assert [p.other for p in insertion_points(stage, ["y"]) if p.place == "mode"] == ["u"]
    assert not [p for p in insertion_points(stage, ["y"], measured={"y": "degC"}) if p.place == "mode"]


# ---- what is known by definition


def test_the_integral_of_a_speed_is_the_position():
    """An integrator between known units has a gain of 1 by definition; one of another gain, or without units, not."""
    free = chosen(LOOP, None)
    assert "position.gain" not in free
    assert "speed.gain" not in free
    assert "mass.gain" in free
    assert "position.gain" in chosen(LOOP, ["position.gain"])
    assert "position.gain" in chosen(LOOP.with_parameters({"position.gain": 1.1}), None)
    bare = Diagram(blocks={"tank": Integrator()}, inputs={"u": "tank"}, outputs={"y": "tank"})
    assert chosen(bare, None) == ["tank.gain"]


def test_a_named_gain_of_an_integrator_is_no_value_of_a_data_sheet():
    t = np.arange(0.0, 2.0, 0.01)
    record = tsm.Record("r", t, {"v": np.cos(t), "x": np.sin(t)}, {"v": "m/s", "x": "m"})
    tank = Diagram(blocks={"sum": Integrator()}, inputs={"v": Inlet("sum", unit="m/s")}, outputs={"x": "sum"})
    found = tsm.fit(tank, record, free=["sum.gain"])
    assert not [text for text in found.notes if "usually known" in text]


# ---- a change in proportion to the speed


@pytest.mark.parametrize(("exponent", "shift"), [(0.5, False), (0.9, False), (0.98, True), (1.03, True), (1.2, False)])
def test_a_change_in_proportion_to_the_speed_is_a_shift_in_time(exponent, shift):
    model = SimpleNamespace(values={"rate.exponent": exponent, "rate.coefficient": 0.1, "other.exponent": 1.0})
    effect = SimpleNamespace(name="rate_dependence")
    one = SimpleNamespace(effect=effect, free=("rate.coefficient", "rate.exponent"))
    assert is_shift_in_time(model, one) is shift
    assert not is_shift_in_time(model, SimpleNamespace(effect=SimpleNamespace(name="backlash"), free=one.free))


# ---- a block in front of several ports


def test_a_block_is_put_in_front_of_several_ports():
    made = LOOP.insert("sensor", DeadTime(time=0.01), before="error.minus, x")
    assert made.shown["x"] == ("sensor", "y")
    assert {".".join(x.target) for x in made.links if x.source[0] == "sensor"} == {"error.minus"}
    assert "position.y -> spring.u" in {str(x) for x in made.links} | set(made.wires)


def test_ports_of_several_wires_are_refused():
    with pytest.raises(DiagramError) as caught:
        LOOP.insert("sensor", Gain(), before="error.minus, motor.u")
    said = str(caught.value)
    assert "before='error.minus, motor.u': these ports are on several wires, from amplifier.y and position.y." in said


# ---- found in recordings

STEP, FINE, SAMPLES = 5e-3, 20, 1500


def recorded(seed, *, dead_band=0.0, play=0.0, delay=0.0):
    """A recording of the loop by its equations: with a dead band and a delay of the command, and a play of the sensor.

    In Euler steps, a twentieth of a sample each; the dead band [V] and the play [m] are full widths.
    """
    rng, h = np.random.default_rng(seed), STEP / FINE
    t = STEP * np.arange(SAMPLES)
    tones = zip(rng.uniform(0.1, 2.5, 6), rng.uniform(0, 6.28, 6), rng.uniform(0.002, 0.01, 6), strict=True)
    ref = sum(a * np.sin(2 * np.pi * f * t + p) for f, p, a in tones)
    past, x, v, drive, read = [0.0] * round(delay / h), 0.0, 0.0, 0.0, 0.0
    measured = np.empty(SAMPLES)
    for k, (now, then) in enumerate(itertools.pairwise([*ref, ref[-1]])):
        measured[k] = read
        for part in range(FINE):
            command = 200.0 * (now + (then - now) * part / FINE - read)
            command = np.sign(command) * max(abs(command) - dead_band / 2, 0.0)
            past.append(command)
            drive += h * (0.9 * past.pop(0) - drive) / 0.015
            v += h * 0.5 * (2.0 * drive - 22.0 * v - 90.0 * x)
            x += h * v
            read = min(max(read, x - play / 2), x + play / 2)
    x = measured + rng.normal(0.0, 3e-5, SAMPLES)
    return tsm.Record(f"run{seed}", t, {"ref": ref, "x": x}, {"ref": "m", "x": "m"})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "name", "wire", "size", "true"),
    [
        ({"dead_band": 0.3}, "dead_zone", "error.y -> controller.u", "width", 0.0015),
        ({"play": 6e-4}, "backlash", "position.y -> error.minus, x", "gap width", 6e-4),
        ({"delay": 0.012}, "dead_time", "", "delay", 12.0),
        ({}, "", "", "", 0.0),
    ],
    ids=["dead band of the command", "play of the sensor", "delay of the command", "nothing"],
)
def test_an_effect_inside_a_control_loop_is_found_there(hidden, name, wire, size, true):
    """A dead band is found where its width does not depend on the gain of the controller, which has no measured side.

    A delay has nearly the same effect anywhere in the loop, and nearly the same length.
    """
    found = tsm.diagnose(LOOP, [recorded(seed, **hidden) for seed in (1, 2, 3)])
    assert [e.name for e in found.effects] == ([name] if name else [])
    for effect in found.effects:
        assert wire in ("", effect.wire)
        margin = 0.0 if wire else 0.05 * true
        assert effect.sizes[size].low - margin < true < effect.sizes[size].high + margin
