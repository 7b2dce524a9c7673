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
