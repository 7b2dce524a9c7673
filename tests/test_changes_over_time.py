"""Changes that settle or end again, the weight of a link, and limits at one end: found in data of other programs."""

from __future__ import annotations

import attrs
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, Integrator, Sum
from tsmblocks.diagnosis import screening
from tsmblocks.diagnosis.fitted_candidate import NO_INSTANTS
from tsmblocks.effects import catalogue
from tsmblocks.effects.trials import LONGEST_INTERVAL, Scales, Span, Trials, interval_trials
from tsmblocks.model.diagram import Diagram

RIVALS = ["parameter_change", "drift", "jump", "creep", "first_order_lag", "gain_error", "offset", "stiffness"]
"""Effects that imitate these changes."""
TANKS = tsm.load("two_tanks")
K, OUT = 0.119, 0.112
"""The pump and the outlets of the tanks, as in the diagram."""


def levels_driven(t):
    """Voltages that fill and drain the tanks."""
    return 3.0 + 0.8 * np.sin(2 * np.pi * t / 300) + 0.5 * np.sin(2 * np.pi * t / 110 + 1.0)


def tanks(voltage, t, gain=lambda t: 1.0, inflow=lambda t: 0.0, start=(9.0, 11.0)):
    """Levels of both tanks, whose pump has a gain that changes, and into the lower of which something flows."""

    def rates(s, h):
        upper, lower = OUT * np.sqrt(np.maximum(h, 0.0))
        return [K * gain(s) * voltage(s) - upper, upper - lower + inflow(s)]

    done = solve_ivp(rates, (t[0], t[-1]), start, t_eval=t, rtol=1e-9, atol=1e-9, max_step=2.0)
    return done.y


def recorded(name, t, u, h, seed):
    noise = 0.02 * np.random.default_rng(seed).standard_normal(h.shape)
    units = {"voltage": "V", "h1": "cm", "h2": "cm"}
    return tsm.Record(name, t, {"voltage": u, "h1": h[0] + noise[0], "h2": h[1] + noise[1]}, units)


def test_a_pump_that_warms_up():
    """Before there was such a form: a lag of -1.7 and a drift of -7 %/min, which cancelled, for +3 %."""
    t = np.arange(0.0, 900.0, 1.5)
    h = tanks(levels_driven, t, gain=lambda s: 1 + 0.03 * (1 - np.exp(-s / 200.0)))
    found = tsm.diagnose(TANKS, recorded("cold", t, levels_driven(t), h, 1), effects=RIVALS)
    (one,) = found.effects
    assert (one.name, one.wire) == ("parameter_change", "voltage -> pump.u")
    assert one.sizes["change of the gain"].low < 3.0 < one.sizes["change of the gain"].high
    assert one.sizes["time constant"].low < 200.0 < one.sizes["time constant"].high


def test_a_sensor_that_warms_up():
    t = np.arange(0.0, 900.0, 1.5)
    h = tanks(levels_driven, t)
    h[0] += 0.2 * (1 - np.exp(-t / 250.0))
    found = tsm.diagnose(TANKS, recorded("cold", t, levels_driven(t), h, 2), effects=RIVALS)
    (one,) = found.effects
    assert (one.name, list(one.sizes)) == ("drift", ["offset in the end", "time constant"])
    assert one.sizes["offset in the end"].low < 0.2 < one.sizes["offset in the end"].high


@pytest.mark.parametrize("others", [0, 1], ids=["alone", "in one of two recordings"])
def test_an_inflow_for_a_time(others):
    """From 300 s to 480 s something flows into the lower tank; in another recording nothing does."""
    t = np.arange(0.0, 900.0, 1.5)
    h = tanks(levels_driven, t, inflow=lambda s: 0.025 * (300.0 < s < 480.0))
    records = [recorded("poured", t, levels_driven(t), h, 3)]
    if others:
        u = levels_driven(t + 170.0)
        records.append(recorded("plain", t, u, tanks(lambda s: levels_driven(s + 170.0), t, start=(10, 9)), 4))
    (one,) = tsm.diagnose(TANKS, records, effects=RIVALS).effects
    assert (one.name, one.wire) == ("jump", "lower_net.y -> lower.u")
    of = "@poured" if others else ""
    for name, true in {"offset": 0.025, "from": 300.0, "until": 480.0}.items():
        size = one.sizes[f"{name}{of}"]
        assert size.value == pytest.approx(true, abs=1.5 * (size.high - size.value))
    assert one.absent_in == (("plain",) if others else ())


def test_the_weight_of_a_link_is_no_spring():
    """Named before as a quadratic and a cubic spring: the first terms of its series."""
    joint = tsm.loads(LINK)

    def rates(s, x):
        q, v = x
        return [v, 700.0 * (command(s) - q) - 8.0 * v - 500.0 * np.sin(np.radians(q + 60.0))]

    t = np.arange(0.0, 12.0, 0.01)
    done = solve_ivp(rates, (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-9, max_step=0.01)
    q = done.y[0] + 0.02 * np.random.default_rng(5).standard_normal(len(t))
    record = tsm.Record("swing", t, {"cmd": command(t), "q": q}, {"cmd": "deg", "q": "deg"})
    few = ["gravity", "even_nonlinearity", "odd_nonlinearity", "stiffness", "load_offset", "position_ripple"]
    (one,) = tsm.diagnose(joint, record, effects=few).effects
    assert one.name == "gravity"
    assert one.sizes["amplitude"].value == pytest.approx(500.0, rel=0.05)
    assert one.sizes["angle of the largest pull"].value == pytest.approx(30.0, abs=5.0)


@pytest.mark.parametrize("kind", ["softens at once", "warms up", "stays"])
def test_a_spring_that_changes(kind):
    """A change of an element inside the model, which no change of the command or of the output imitates."""
    softer = {
        "softens at once": lambda s: 1 - 0.06 * (s > 5.0),
        "warms up": lambda s: 1 - 0.06 * (1 - np.exp(-s / 3.0)),
        "stays": lambda s: 1.0,
    }[kind]

    def rates(s, x):
        q, v = x
        return [v, 700.0 * softer(s) * (command(s) - q) - 8.0 * v]

    t = np.arange(0.0, 12.0, 0.01)
    done = solve_ivp(rates, (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-9, max_step=0.01)
    q = done.y[0] + 0.02 * np.random.default_rng(7).standard_normal(len(t))
    record = tsm.Record("swing", t, {"cmd": command(t), "q": q}, {"cmd": "deg", "q": "deg"})
    found = tsm.diagnose(tsm.loads(LINK), record, effects=RIVALS)
    if kind == "stays":
        assert found.verdict == "none"
        return
    (one,) = found.effects
    assert one.name == "parameter_change"
    assert "twist.y -> spring.u" in (one.wire, *one.other_places)  # behind the spring it acts much alike
    assert one.sizes["change of the gain"].value == pytest.approx(-6.0, abs=0.5)
    of_time = {"softens at once": ("time", 5.0), "warms up": ("time constant", 3.0)}[kind]
    assert one.sizes[of_time[0]].value == pytest.approx(of_time[1], rel=0.2)


LINK = """
format = 1
title = "link on a spring"
wires = ["twist -> spring -> net.plus", "net -> speed -> angle -> twist.minus", "speed -> damping -> net.minus"]
[blocks]
twist = { type = "Sum" }
spring = { type = "Gain", gain = 700.0, unit = "deg/s^2" }
net = { type = "Sum" }
speed = { type = "Integrator" }
angle = { type = "Integrator" }
damping = { type = "Gain", gain = 8.0, unit = "deg/s^2" }
[inputs]
cmd = { ports = "twist.plus", unit = "deg" }
[outputs]
q = "angle.y"
"""


def command(s):
    """Commanded angles [deg]."""
    return 25.0 * np.sin(2.1 * s) + 12.0 * np.sin(5.3 * s + 0.5) + 6.0 * np.sin(0.7 * s)


def test_an_amplifier_that_gives_less_and_less_at_one_end():
    """Named before as a dead zone in the middle of the upper part, or as a characteristic whose ends bend apart."""
    plant = tsm.Diagram(
        title="heater",
        blocks={"power": tsm.blocks.Gain(gain=2.0), "heater": tsm.blocks.FirstOrderLag(time_constant=3.0)},
        wires=["power -> heater"],
        inputs={"u": "power"},
        outputs={"y": "heater"},
    )
    t = np.arange(0.0, 120.0, 0.1)
    u = 15.0 + 5.0 * np.sin(0.31 * t) + 3.5 * np.sin(0.83 * t + 1.0)
    given = u / (1 + (u / 30.0) ** 8) ** (1 / 8)
    y = tsm.simulate(plant, inputs={"u": (t, given)}, stop=t[-1], step=0.1)["y"]
    record = tsm.Record("run", t, {"u": u, "y": y + 0.02 * np.random.default_rng(6).standard_normal(len(t))}, {})
    few = ["saturation", "dead_zone", "odd_nonlinearity", "even_nonlinearity", "asymmetric_gain", "rate_limit"]
    (one,) = tsm.diagnose(plant, record, effects=few).effects
    assert one.name == "saturation"
    assert one.sizes["cut off at the upper end"].value == pytest.approx(np.max(u - given), rel=0.15)


# ---- what is tried


SCALES = Scales(*2 * [Span(-1.0, 1.0, 0.6, 2.0, 5.0)], 10.0, 30.0, 0.01, 20.0)


def test_intervals_are_inside_the_recordings_and_no_longer_than_half_of_them():
    trials = interval_trials(SCALES, {"size": 1.0})
    lengths = [shape["until"] - shape["time"] for shape in trials.shapes]
    assert min(lengths) > 0
    assert max(lengths) < LONGEST_INTERVAL * 20.0
    assert all(10.0 < shape["time"] < shape["until"] < 30.0 for shape in trials.shapes)
    assert trials.refine == ("time", "until")


def test_one_instant_is_given_by_its_name_alone():
    assert Trials({}, refine="time").refine == Trials({}, refine=("time",)).refine == ("time",)
    assert Trials({}).refine == ()
    assert Trials({}, refine=("time", "until")).under("part").refine == ("part.time", "part.until")


def test_a_weight_is_looked_for_on_angles_alone():
    gravity = next(one for one in catalogue() if one.name == "gravity")
    assert gravity.trials(SCALES) is None
    for turn in (2 * np.pi, 360.0):
        trials = gravity.trials(attrs.evolve(SCALES, other=attrs.evolve(SCALES.other, turn=turn)))
        assert trials.fixed["force.cycles"] * turn == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("ends", [True, False])
def test_a_change_that_does_not_end_within_the_recording_is_not_temporary(ends):
    t = np.arange(0.0, 60.0, 0.05)
    u = np.sin(0.7 * t) + 0.5 * np.sin(2.3 * t + 1.0)
    diagram = Diagram(blocks={"gain": Gain(gain=2.0)}, inputs={"u": "gain"}, outputs={"y": "gain"})
    change = 0.4 * ((t > 24.0) & (t < (41.0 if ends else np.inf)))
    noise = 0.1 * np.random.default_rng(5).standard_normal(len(t))
    record = tsm.Record("one", t, {"u": u, "y": 1.9 * u + change + noise}, {})
    found = tsm.diagnose(diagram, record, effects=["jump", "parameter_change"])
    assert (f"- {NO_INSTANTS}: jump (temporary)" in found.details()) is not ends
    (effect,) = found.effects
    size = next(iter(effect.sizes.values()))
    assert ("until" in effect.sizes, size.low < 0.4 < size.high) == (ends, True)


def test_an_interval_is_what_begins_less_what_begins_later(monkeypatch):
    """Intervals are screened by the simulations of their instants: in a linear plant that is exact."""
    compared, usual = [], screening._Screening._coarse_changes

    def checked(one):
        found = usual(one)
        if one.candidate.trials.without_end:
            each = one._changes_at(one._in_each(one.candidate.trials.shapes))
            compared.append(np.abs(found - each).max() / np.abs(each).max())
        return found

    monkeypatch.setattr(screening._Screening, "_coarse_changes", checked)
    t = np.arange(0.0, 60.0, 0.1)
    u = np.sin(0.7 * t) + 0.5 * np.sin(2.3 * t + 1.0)
    plant = Diagram(blocks={"lag": FirstOrderLag(time_constant=0.5)}, inputs={"u": "lag"}, outputs={"y": "lag"})
    y = tsm.simulate(plant, inputs={"u": (t, u)}, stop=t[-1], step=t[1])["y"]
    noise = 0.1 * np.random.default_rng(3).standard_normal((2, len(t)))
    records = [tsm.Record(name, t, {"u": u, "y": y + own}, {}) for name, own in zip("ab", noise, strict=True)]
    tsm.diagnose(plant, records, effects=["jump"])
    assert len(compared) >= 2
    assert max(compared) < 1e-9


def test_the_shapes_that_do_not_end():
    trials = interval_trials(SCALES, {"size": 1.0})
    begun = trials.without_end
    assert {one["time"] for one in begun} == {one[k] for one in trials.shapes for k in ("time", "until")}
    assert {one["until"] for one in begun} == {SCALES.stop}
    assert attrs.evolve(trials, refine="time").without_end == ()
    assert attrs.evolve(trials, bounds={}).without_end == ()
    more = tuple({**one, "softness": 0.1} for one in trials.shapes)
    assert attrs.evolve(trials, shapes=more).without_end == ()


def test_a_coil_whose_resistance_rises_with_its_heat():
    """Before there was such a form, it was a resistance that changed suddenly, and another time for a while."""
    t = np.arange(0.0, 40.0, 0.02)

    def voltage(s):
        return 4.0 * np.sin(0.9 * s) + 2.0 * np.sin(4.1 * s + 0.5) + (2.0 if s > 15.0 else 0.0)

    def rates(s, x):
        current, heat = x
        return [(voltage(s) - 2.0 * (1 + 0.05 * heat) * current) / 0.4, (current**2 - heat) / 6.0]

    done = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-9, max_step=0.05).y[0]
    coil = Diagram(
        blocks={
            "left": Sum(signs="+-"),
            "coil": Integrator(gain=2.2, unit="A"),
            "resistance": Gain(gain=2.1, unit="V"),
        },
        wires=["left -> coil -> resistance -> left.minus"],
        inputs={"u": tsm.Inlet("left.plus", "V")},
        outputs={"i": "coil"},
    )
    noise = 0.02 * np.random.default_rng(8).standard_normal(len(t))
    u = np.array([voltage(s) for s in t])
    record = tsm.Record("cold", t, {"u": u, "i": done + noise}, {"u": "V", "i": "A"})
    found = tsm.diagnose(coil, record, effects=RIVALS)
    (one,) = found.effects
    assert (one.name, one.wire) == ("parameter_change", "coil.y -> resistance.u")
    assert "+ parameter_change = HeatedGain(" in str(found)
    change, time = one.sizes.values()
    assert change.low < 5.0 * np.mean(done**2) < change.high
    assert time.low < 6.0 < time.high
