"""Overflow against its closed form, and a tank that runs over against its exact levels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, value
from tsmblocks.blocks import Constant, Integrator, Overflow


def test_sound():
    assert_sound(Overflow(rim=0.3, caught=0.2))


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.01, 50.0), st.floats(0.0, 1.0))
def test_above_the_rim_flow_runs_over(flow, above, rate, caught):
    found = value(Overflow(rim=2.0, rate=rate, caught=caught), u=flow, x=2.0 + above)
    over = rate * above if above > 0 else 0.0
    assert found == pytest.approx({"y": flow - over, "spilt": caught * over}, abs=1e-9)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_without_a_rim_the_flow_passes_bit_for_bit(flow, level):
    assert value(Overflow(caught=1.0), u=flow, x=level) == {"y": flow, "spilt": 0.0}


def test_a_tank_settles_above_its_rim():
    """Filled with flow 2 it stands at the rim, 1, from t = 0.5 on, and then tends to 1 + 2/k as exp(-k t)."""
    tank = tsm.Diagram(
        title="tank",
        blocks={"flow": Constant(value=2.0), "rim": Overflow(rim=1.0, rate=4.0, caught=0.5), "level": Integrator()},
        wires=["flow -> rim.u", "rim.y -> level -> rim.x"],
        outputs={"level": "level", "spilt": "rim.spilt"},
    )
    run = tsm.simulate(tank, stop=2.0, step=1e-3)
    exact = np.where(run.t < 0.5, 2 * run.t, 1.5 - 0.5 * np.exp(-4 * (run.t - 0.5)))
    np.testing.assert_allclose(run["level"], exact, atol=1e-6)
    np.testing.assert_allclose(run["spilt"], 2.0 * np.maximum(exact - 1.0, 0.0), atol=1e-5)


def test_a_share_is_between_none_and_all():
    refuses(
        "Overflow.caught must lie in [0, 1], got 1.2. It is: share s of the spilt flow that is caught.",
        Overflow,
        caught=1.2,
    )
