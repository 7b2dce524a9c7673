"""Which inputs act as forces do: integrated twice before a position, once before a speed, and no positions."""

import pytest

import tsmblocks as tsm
from tsmblocks.blocks import FirstOrderLag, Gain, Integrator, SecondOrderLag
from tsmblocks.diagnosis.insertion_points import smoothed_inputs


def chain(*blocks, unit, out):
    """Blocks in a row behind an input."""
    named = {f"b{k}": block for k, block in enumerate(blocks)}
    return tsm.Diagram(
        title="chain",
        blocks={**named, "shown": Gain(unit=out)},
        wires=[" -> ".join([*named, "shown"])],
        inputs={"u": tsm.Inlet(("b0.u",), unit, "")},
        outputs={"y": "shown"},
    )


@pytest.mark.parametrize(
    ("diagram", "is_force"),
    [
        pytest.param(chain(Gain(unit="m/s^2"), Integrator(), Integrator(), unit="N", out="m"), True, id="force"),
        pytest.param(chain(Gain(unit="m/s^2"), Integrator(), unit="N", out="m/s"), True, id="force on a speed"),
        pytest.param(chain(Integrator(), unit="m/s", out="m"), False, id="speed"),
        pytest.param(chain(FirstOrderLag(), unit="V", out="rad"), False, id="lag"),
        pytest.param(chain(SecondOrderLag(), unit="rad", out="rad"), False, id="position"),
        pytest.param(tsm.load("motor_linear"), True, id="motor"),
        pytest.param(tsm.load("flexible_joint"), True, id="joint"),
        pytest.param(tsm.load("tendon_sheath_asymmetric"), False, id="sheath"),
    ],
)
def test_inputs_that_act_as_forces(diagram, is_force):
    assert smoothed_inputs(diagram, list(diagram.outputs)) == (list(diagram.inputs) if is_force else [])
