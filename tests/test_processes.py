"""Processes without motion, such as a heated bath: what acts back, what drifts, and what replaces the model."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.blocks import Bias, FirstOrderLag, Gain, Integrator, Sum
from tsmblocks.diagnosis.credibility import notes_on_moved
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.noise_floor import noise_floors
from tsmblocks.diagnosis.takes_over import switches_off
from tsmblocks.effects import catalogue
from tsmblocks.model.diagram import Diagram

STEP, NOISE = 4.0, 0.12
GAIN, TIME_CONSTANT, AMBIENT = 0.55, 240.0, 22.0
BALANCE = Diagram(
    title="Bath as a heat balance",
    blocks={
        "heat": Gain(gain=0.6, unit="degC"),
        "net": Sum(signs="+-"),
        "rate": Gain(gain=0.0044, unit="degC/s"),
        "bath": Integrator(),
        "loss": Gain(gain=1.0, unit="degC"),
        "ambient": Bias(bias=20.0),
    },
    wires=["heat -> net.plus", "net -> rate -> bath -> ambient", "bath -> loss -> net.minus"],
    inputs={"heater": tsm.Inlet("heat.u", unit="%")},
    outputs={"temp": "ambient"},
)
FREE = ["heat.gain", "rate.gain", "ambient.bias"]
FEW = ["even_nonlinearity", "odd_nonlinearity", "backlash", "dead_time", "drift", "parameter_change", "offset"]


def recorded(seed, quadratic=0.0, drift=0.0):
    """A recording by SciPy: the loss may grow with the square of the temperature, the heater may lose power."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(700)
    heater = np.repeat(rng.uniform(10, 80, 20), 35)

    def rate(s, theta):
        power = heater[min(int(s / STEP), len(heater) - 1)] * (1 + drift * s)
        return (GAIN * power - theta - quadratic * theta**2) / TIME_CONSTANT

    theta = solve_ivp(rate, (0.0, t[-1]), [8.0], t_eval=t, max_step=STEP / 2, rtol=1e-8, atol=1e-8).y[0]
    temp = AMBIENT + theta + rng.normal(0, NOISE, t.size)
    return tsm.Record(f"run{seed}", t, {"heater": heater, "temp": temp}, {"heater": "%", "temp": "degC"})


def diagnosed(**hidden):
    records = [recorded(seed, **hidden) for seed in (1, 2)]
    return tsm.diagnose(BALANCE, records, free=FREE, effects=FEW, hold="zero")


def test_what_is_measured_acts_back_on_a_wire_of_its_own():
    branches = [p for p in insertion_points(BALANCE, ["temp"]) if p.place == "branch"]
    assert [(p.signal, p.before) for p in branches] == [("bath.y", "loss.u")]


def test_what_is_not_measured_acts_back_on_a_wire_of_its_own():
    """A block that is heated, with the sensor in a sleeve: its loss, and the flow into the sleeve."""
    heated = Diagram(
        blocks={
            "net": Sum(signs="+--"),
            "rate": Gain(gain=0.005, unit="degC/s"),
            "block": Integrator(),
            "above": Bias(bias=-20.0),
            "loss": Gain(gain=0.9, unit="W"),
            "step": Sum(signs="+-"),
            "flow": Gain(gain=4.0, unit="W"),
            "sleeve": Integrator(gain=0.02, unit="degC"),
        },
        wires=[
            "net -> rate -> block -> above -> loss -> net.minus1",
            "block -> step.plus",
            "step -> flow -> net.minus2, sleeve",
            "sleeve -> step.minus",
        ],
        inputs={"power": tsm.Inlet("net.plus", unit="W")},
        outputs={"temp": "sleeve"},
    )
    branches = {p.before for p in insertion_points(heated, ["temp"]) if p.place == "branch"}
    assert {"loss.u", "flow.u"} <= branches
    assert not {"rate.u", "net.plus"} & branches


def test_the_outflow_of_a_tank_is_a_branch_and_the_spring_of_a_mass_is_none():
    """Both are fed back from a length; a level sets its own rate, a position its acceleration."""
    blocks = {"net": Sum(signs="+-"), "level": Integrator(), "out": Gain(gain=0.01, unit="cm/s")}
    tank = Diagram(
        blocks=blocks,
        wires=["net -> level -> out -> net.minus"],
        inputs={"pump": tsm.Inlet("net.plus", unit="cm/s")},
        outputs={"level": "level"},
    )
    assert [p.before for p in insertion_points(tank, ["level"]) if p.place == "branch"] == ["out.u"]
    mass = Diagram(
        blocks={**blocks, "speed": Integrator(), "out": Gain(gain=9.0, unit="cm/s^2")},
        wires=["net -> speed -> level -> out -> net.minus"],
        inputs={"push": tsm.Inlet("net.plus", unit="cm/s^2")},
        outputs={"level": "level"},
    )
    assert not [p for p in insertion_points(mass, ["level"]) if p.place == "branch"]


CHAMBER = Diagram(
    title="Chamber that a heater warms",
    blocks={
        "heater_net": Sum(signs="+-"),
        "heater_rate": Gain(gain=0.0013, unit="K/s"),
        "heater": Integrator(),
        "between": Sum(signs="+-"),
        "coupling": Gain(gain=7.5, unit="W"),
        "to_ambient": Sum(signs="+-"),
        "wall": Gain(gain=6.0, unit="W"),
        "chamber_net": Sum(signs="+-"),
        "chamber_rate": Gain(gain=2.2e-4, unit="K/s"),
        "chamber": Integrator(),
    },
    wires=[
        "heater_net -> heater_rate -> heater -> between.plus",
        "chamber -> between.minus, to_ambient.plus",
        "between -> coupling -> heater_net.minus, chamber_net.plus",
        "to_ambient -> wall -> chamber_net.minus",
        "chamber_net -> chamber_rate -> chamber",
    ],
    inputs={"power": tsm.Inlet("heater_net.plus", unit="W"), "room": tsm.Inlet("to_ambient.minus", unit="K")},
    outputs={"inside": "chamber"},
)


def test_a_loss_to_surroundings_that_are_measured_is_no_control_loop():
    points = insertion_points(CHAMBER, ["inside"])
    branches = {p.before for p in points if p.place == "branch"}
    assert {"to_ambient.plus", "wall.u", "between.minus", "coupling.u"} <= branches
    assert not [p for p in points if p.place == "loop"]
    turned = CHAMBER.rewire(  # a reference less what is measured is a control error
        cut=["chamber -> to_ambient.plus", "wall -> chamber_net.minus", "coupling -> chamber_net.plus"],
        blocks={**CHAMBER.blocks, "chamber_net": Sum(signs="++")},
        add=["chamber -> to_ambient.minus", "wall -> chamber_net.plus1", "coupling -> chamber_net.plus2"],
        inputs={"power": "heater_net.plus", "room": "to_ambient.plus"},
    )
    assert [p for p in insertion_points(turned, ["inside"]) if p.place == "loop"]


def warmed(seed, hot, cold, *, radiation=0.0, lag=0.0, sensor=lambda x: x):
    """The chamber by SciPy: it loses ``radiation`` [W/K^4] beside its wall, the room acts on it ``lag`` [s] late."""
    rng, t = np.random.default_rng(seed), 5.0 * np.arange(900)
    power = np.repeat(rng.uniform(0, 620, 30), 30)
    room = 294.0 + 2.5 * np.sin(2 * np.pi * t / 2900 + seed) + 1.2 * np.sin(2 * np.pi * t / 700 + 2 * seed)

    def rate(s, x):
        k = min(int(s / 5.0), len(t) - 1)
        surroundings = np.interp(s, t, room)
        acting = x[2] if lag else surroundings
        flow = 8.4 * (x[0] - x[1])
        loss = 5.1 * (x[1] - acting) + radiation * (x[1] ** 4 - acting**4)
        return [(power[k] - flow) / 870, (flow - loss) / 5263, (surroundings - x[2]) / lag if lag else 0.0]

    begin = [hot, cold, room[0]]
    found = solve_ivp(rate, (0.0, t[-1]), begin, t_eval=t, max_step=2.5, rtol=1e-8, atol=1e-8).y[1]
    signals = {"power": power, "room": room, "inside": sensor(found) + rng.normal(0, 0.05, t.size)}
    return tsm.Record(f"run{seed}", t, signals, {"power": "W", "room": "K", "inside": "K"})


def chamber_diagnosed(effects=FEW, **hidden):
    runs = [warmed(1, 328.0, 320.0, **hidden), warmed(2, 296.0, 299.0, **hidden)]
    return tsm.diagnose(CHAMBER, runs, effects=effects)


def test_a_sensor_that_is_right_at_one_value_curves_about_it():
    found = chamber_diagnosed(sensor=lambda x: x + 0.0012 * (x - 323.0) ** 2)
    (effect,) = found.effects
    assert (effect.name, effect.wire) == ("even_nonlinearity", "chamber.y -> inside")
    centre = effect.sizes["value at which it adds nothing"]
    assert centre.low < 323.0 < centre.high


def test_a_slow_lag_of_the_surroundings_is_found_from_a_base_far_from_the_diagram():
    found = chamber_diagnosed(effects=["first_order_lag", "hysteresis", "rate_limit", "offset"], lag=300.0)
    (effect,) = found.effects
    assert (effect.name, effect.wire) == ("first_order_lag", "room -> to_ambient.minus")
    time = effect.sizes["time constant"]
    assert time.low < 300e3 < time.high  # ms
    assert found.augmented.parameters["heater_rate.gain"] == pytest.approx(1 / 870, rel=0.3)


def test_radiation_of_a_chamber_is_a_loss_whose_slope_changes():
    """Beside the wall it loses 2e-8 W/K^4 of the fourth powers; the diagram's own parameters come right."""
    found = chamber_diagnosed(radiation=2e-8)
    (effect,) = found.effects
    assert (effect.name, effect.wire) == ("even_nonlinearity", "chamber.y -> to_ambient.plus")
    fitted = found.augmented.parameters
    for name, true in (("heater_rate.gain", 1 / 870), ("coupling.gain", 8.4), ("chamber_rate.gain", 1 / 5263)):
        assert fitted[name] == pytest.approx(true, rel=0.2)
    size = effect.sizes["slope at the upper end less that at the lower"]
    assert 10 < size.low < size.high < 40


def test_the_feedback_of_a_controller_is_no_branch_of_the_process():
    controlled = Diagram(
        blocks={
            "error": Sum(signs="+-"),
            "gain": Gain(gain=2.0, unit="degC"),
            "bath": FirstOrderLag(time_constant=100.0),
        },
        wires=["error -> gain -> bath -> error.minus"],
        inputs={"reference": "error.plus"},
        outputs={"temp": "bath"},
    )
    assert not [p for p in insertion_points(controlled, ["temp"]) if p.place == "branch"]


def test_a_loss_that_grows_with_the_square_is_found_where_it_acts():
    (effect,) = diagnosed(quadratic=0.004).effects
    assert (effect.name, effect.wire) == ("even_nonlinearity", "bath.y -> loss.u")


def test_a_heater_that_loses_power_is_a_drift_of_the_gain_at_the_input():
    """At the output, the percentage would count the temperature of the surroundings as well."""
    (effect,) = diagnosed(drift=-0.02 / 100 / 60 * 10).effects
    assert (effect.name, effect.wire) == ("parameter_change", "heater -> heat.u")
    size = effect.sizes["drift of the gain"]
    assert size.low < -0.2 < size.high


def test_nothing_is_said_of_a_bath_that_is_as_it_was_drawn():
    assert diagnosed().verdict == "none"


def test_a_note_names_the_step_of_a_reading_that_is_most_of_the_noise():
    record = recorded(1)
    coarse = record.with_signal("temp", np.round(record["temp"]), "degC")
    (note,) = (text for text in noise_floors({"run": coarse}, BALANCE, ["temp"], {}).notes if "quantised" in text)
    assert note.startswith("temp is quantised in steps of 1 degC: rounding, 0.289 degC rms, is most of its noise from ")
    assert not [text for text in noise_floors({"run": record}, BALANCE, ["temp"], {}).notes if "quantised" in text]


# ---- effects beside the model


PARALLEL = next(one for one in catalogue() if one.place == "parallel")


def model(gain, *, beside=True):
    diagram = Diagram(blocks={"heat": Gain()}, inputs={"u": "heat"}, outputs={"y": "heat"})
    if beside:
        diagram = diagram.insert("lag", PARALLEL.block, after="heat.y", wires=["u -> lag.x"])
    return SimpleNamespace(diagram=diagram, parameters=lambda: {"heat.gain": gain, "heat.bias": 0.0})


@pytest.mark.parametrize(
    ("left", "beside", "gone"), [(0.05, True, True), (-0.05, True, True), (0.5, True, False), (0.05, False, False)]
)
def test_a_lag_in_parallel_that_leaves_nothing_of_the_model_is_none(left, beside, gone):
    assert switches_off(model(left, beside=beside), model(1.0), catalogue(), {}) is gone


def test_a_gain_that_is_the_diagram_s_again_is_not_lost():
    base, fitted = model(70.0, beside=False), model(1.3)
    assert switches_off(fitted, base, catalogue(), {})
    assert not switches_off(fitted, base, catalogue(), {"heat.gain": 1.0})


# ---- parameters that moved far where nothing is found


def test_a_note_names_parameters_that_were_fitted_far_from_the_diagram():
    (note,) = notes_on_moved(model(0.4), {"heat.gain": 1.0, "heat.bias": 3.0})
    assert note.startswith("heat.gain (0.4 for 1) was fitted far from the diagram: it may compensate for an effect.")
    assert notes_on_moved(model(0.8), {"heat.gain": 1.0}) == []
