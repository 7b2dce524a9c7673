"""Effects of one's own on a wire they name themselves: put there, found missing, and left out elsewhere."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Constant, Gain, Integrator, Overflow, Sum
from tsmblocks.common.errors import DiagramError
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.effects import Effect, Trials, registered

TANKS = tsm.Diagram(
    title="tanks",
    blocks={
        "upper_flow": Sum(),
        "upper": Integrator(integral=1.0),
        "upper_outlet": Gain(gain=0.8),
        "lower_flow": Sum(),
        "lower": Integrator(integral=1.0),
        "lower_outlet": Gain(gain=0.5),
    },
    wires=[
        "upper_flow -> upper -> upper_outlet -> upper_flow.minus, lower_flow.plus",
        "lower_flow -> lower -> lower_outlet -> lower_flow.minus",
    ],
    inputs={"u": "upper_flow.plus"},
    outputs={"y": "lower"},
)
T = np.arange(0.0, 60.0, 0.1)
FLOW = np.clip(1.0 + 0.9 * np.sin(0.5 * T) + 0.6 * np.sin(0.17 * T), 0.0, None)


def rims(scales):
    level = scales.other
    shares = [(rim, part) for rim in (0.95, 0.7, 0.4) for part in (0.0, 0.5)]
    return Trials({}, tuple({"rim": level.middle + rim * level.reach, "caught": part} for rim, part in shares))


def caught(diagram, name):
    return diagram.insert("inflow", Sum(signs="++"), before="lower_flow.plus", wires=[f"{name}.spilt -> inflow.plus2"])


def overflow(place="u -> upper_flow.plus", reads="upper"):
    return Effect(
        "overflow",
        "vessel",
        "an overflow of the upper tank",
        place,
        Overflow(),
        {"rim": float("inf")},
        ("rim", "caught"),
        rims,
        reads=reads,
        adds=caught,
    )


def site_of(diagram, effect):
    return [s for s in insertion_points(diagram, ["y"], [effect]) if s.place == effect.place]


def test_it_stands_on_its_wire_reads_its_signal_and_changes_the_rest():
    effect = overflow()
    (site,) = site_of(TANKS, effect)
    assert (site.signal, site.other, site.before) == ("u", "upper.y", "upper_flow.plus")
    made = site.put(TANKS, "overflow", effect.block)
    ends = {(".".join(x.source), ".".join(x.target)) for x in made.links}
    assert {
        ("overflow.y", "upper_flow.plus"),
        ("upper.y", "overflow.x"),
        ("overflow.spilt", "inflow.plus2"),
        ("upper_outlet.y", "inflow.plus1"),
        ("inflow.y", "lower_flow.plus"),
    } <= ends
    assert made.inlets["u"] == (("overflow", "u"),)


def test_at_its_null_it_gives_the_base_bit_for_bit():
    (site,) = site_of(TANKS, overflow())
    made = site.put(TANKS, "overflow", Overflow())
    a, b = (tsm.simulate(d, inputs={"u": (T, FLOW)}, stop=T[-1], step=0.1)["y"] for d in (TANKS, made))
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("effect", [overflow(place="pump -> nowhere.plus"), overflow(reads="third")])
def test_a_diagram_without_its_port_or_signal_has_no_place_for_it(effect):
    assert site_of(TANKS, effect) == []


def test_it_can_stand_there_twice():
    effect = overflow()
    (first,) = site_of(TANKS, effect)
    once = first.put(TANKS, "overflow", effect.block)
    (second,) = site_of(once, effect)
    assert (second.signal, second.before) == ("overflow.y", "upper_flow.plus")


def test_it_is_named_where_it_was_hidden():
    """The truth overflows at a level of 1.5 and loses 70 % of it; noise is white."""
    (site,) = site_of(TANKS, overflow())
    truth = site.put(TANKS, "hidden", Overflow(rim=1.5, rate=1.0, caught=0.3))
    y = tsm.simulate(truth, inputs={"u": (T, FLOW)}, stop=T[-1], step=0.1)["y"]
    assert tsm.simulate(truth, inputs={"u": (T, FLOW)}, stop=T[-1], step=0.1)["upper.y"].max() > 1.8
    noisy = y + np.random.default_rng(3).normal(0.0, 0.01, len(T))
    record = tsm.Record("tanks", T, {"u": FLOW, "y": noisy}, {})
    with registered(overflow()):
        found = tsm.diagnose(TANKS, record, free=["*.gain"], noise_floor=0.01, condition=False)
    assert [e.name for e in found.effects] == ["overflow"]
    (effect,) = found.effects
    assert effect.parameters["rim"].value == pytest.approx(1.5, abs=0.05)
    assert effect.parameters["caught"].value == pytest.approx(0.3, abs=0.1)
    assert "inflow" in found.augmented.blocks
    assert found.augmented.blocks["overflow"].rim == pytest.approx(effect.parameters["rim"].value)


def test_a_block_of_two_inputs_goes_on_a_wire_where_another_wire_has_one_of_them():
    base = tsm.Diagram(
        title="two",
        blocks={"a": Constant(value=1.0), "b": Constant(value=3.0), "end": Bias()},
        wires=["a -> end"],
        outputs={"y": "end", "b": "b"},
    )
    made = base.insert("sum", Sum(signs="+-"), before="end.u", wires=["b -> sum.minus"])
    assert tsm.simulate(made, stop=0.1, step=0.1)["y"][0] == -2.0
    with pytest.raises(DiagramError, match=r"Sum has 2 inputs \(plus, minus\)\. Use rewire"):
        base.insert("sum", Sum(signs="+-"), before="end.u")
