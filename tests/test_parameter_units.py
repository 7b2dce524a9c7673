"""Units of parameters that depend on the signals at their block."""

import pytest

import tsmblocks as tsm
from tsmblocks.blocks import Constant, FirstOrderLag, Gain, Play, RateLimit, Step
from tsmblocks.model.parameter_units import unit_of


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("load.value", "N"),
        ("step.after", "V"),
        ("gap.half_width", "V"),
        ("limit.rising", "V/s"),
        ("gain.gain", "N/V"),
        ("lag.time_constant", "s"),
    ],
)
def test_units_follow_the_signals_or_the_option_of_the_block(name, unit):
    diagram = tsm.Diagram(
        blocks={
            "load": Constant(value=2.0, unit="N"),
            "step": Step(after=3.0, unit="V"),
            "gap": Play(),
            "limit": RateLimit(),
            "gain": Gain(gain=2.0, unit="N"),
            "lag": FirstOrderLag(),
        },
        wires=["step -> gap -> limit -> gain -> lag"],
    )
    block, _, own = name.partition(".")
    assert unit_of(name, diagram, [diagram.blocks[block].fields()[own]]) == unit


def test_without_any_unit_there_is_none():
    diagram = tsm.Diagram(blocks={"step": Step(), "gap": Play()}, wires=["step -> gap"])
    assert unit_of("gap.half_width", diagram, [Play.fields()["half_width"]]) == ""
    assert unit_of("step.after", diagram, [Step.fields()["after"]]) == ""
    assert unit_of("nothing.after", diagram, [Step.fields()["after"]]) == ""


def nested(unit, depth=1, **edges):
    """A gap inside ``depth`` diagrams without units, behind a source with one."""
    inner = tsm.Diagram(
        blocks={"gap": Play(), "limit": RateLimit()},
        wires=["gap -> limit"],
        inputs={"u": "gap.u"},
        outputs={"y": "limit"},
    )
    for _ in range(depth - 1):
        inner = tsm.Diagram(blocks={"in": inner}, inputs={"u": "in.u"}, outputs={"y": "in.y"})
    return tsm.Diagram(blocks={"tip": inner}, inputs={"x": tsm.Inlet("tip.u", unit)}, outputs={"y": "tip.y"}, **edges)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_units_of_signals_reach_parameters_inside_of_diagrams(depth):
    diagram = nested("mm", depth)
    way = ".".join(["tip", *["in"] * (depth - 1)])
    assert diagram.unit(f"{way}.gap.y") == "mm"
    assert unit_of(f"{way}.gap.half_width", diagram, [Play.fields()["half_width"]]) == "mm"
    assert unit_of(f"{way}.limit.rising", diagram, [RateLimit.fields()["rising"]]) == "mm/s"
    assert nested("", depth).unit(f"{way}.gap.y") == ""
    behind = nested("", depth, output_units={"y": "rad"})
    assert unit_of(f"{way}.gap.half_width", behind, [Play.fields()["half_width"]]) == "rad"
    again = diagram.rewire(inputs={"x": tsm.Inlet("tip.u", "V")})
    assert again.unit(f"{way}.gap.y") == "V"


def test_one_inner_diagram_has_the_units_of_each_place():
    inner = tsm.Diagram(blocks={"gap": Play()}, inputs={"u": "gap.u"}, outputs={"y": "gap"})
    both = tsm.Diagram(
        blocks={"left": inner, "right": inner},
        inputs={"a": tsm.Inlet("left.u", "mm"), "b": tsm.Inlet("right.u", "V")},
        outputs={"x": "left.y", "v": "right.y"},
    )
    assert (both.unit("left.gap.y"), both.unit("right.gap.y")) == ("mm", "V")
