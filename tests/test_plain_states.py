"""Initial states that a recording does not determine are written as plain values; the outputs stay the same."""

import numpy as np
import pytest

import tsmblocks as tsm
from tsmblocks.blocks import SecondOrderLag
from tsmblocks.diagnosis.model import ModelSettings, calibrate
from tsmblocks.diagnosis.plain_states import MAX_CHANGE, with_plain_states

T = np.arange(0.0, 4.0, 0.01)
NOISE = 0.02


def recorded(value, rate):
    """A servo that begins at some angle and speed, with noise."""
    servo = tsm.Diagram(
        blocks={"servo": SecondOrderLag(omega=20.0, zeta=0.5)}, inputs={"u": "servo.u"}, outputs={"y": "servo"}
    )
    u = np.sin(3 * T)
    start = {"servo.value": value, "servo.rate": rate}
    y = tsm.simulate(servo, inputs={"u": (T, u)}, step=0.01, stop=T[-1], parameters=start, check_step=False)["y"]
    y = y + np.random.default_rng(2).normal(0.0, NOISE, len(T))
    return servo, {"run": tsm.Record("run", T, {"u": u, "y": y}, {})}


def calibrated(value, rate):
    servo, records = recorded(value, rate)
    return calibrate(servo, records, ModelSettings(None, {"y": NOISE}, ("y",), step=0.01))


def states(model):
    return {k: v for k, v in model.parameters("run").items() if k in ("servo.value", "servo.rate")}


def test_states_at_rest_are_written_as_the_diagrams_own():
    model = calibrated(0.0, 0.0)
    assert any(states(model).values())
    plain = with_plain_states(model)
    assert states(plain) == {"servo.value": 0.0, "servo.rate": 0.0}
    assert np.sum((plain.r - model.r) ** 2) <= 2 * MAX_CHANGE
    np.testing.assert_allclose(plain.problem.residuals(plain.theta), plain.r)


def test_states_that_are_determined_are_rounded_to_a_part_of_their_uncertainty():
    model = calibrated(0.5, 8.0)
    plain = with_plain_states(model)
    found = states(plain)
    assert all(len(repr(value)) <= 8 for value in found.values())
    assert found["servo.value"] == pytest.approx(0.5, abs=0.1)
    assert found["servo.rate"] == pytest.approx(8.0, abs=1.0)
    assert np.sum((plain.r - model.r) ** 2) < 0.01


def test_parameters_are_left_as_they_are():
    model = calibrated(0.0, 0.0)
    shared = ~model.is_local
    np.testing.assert_array_equal(with_plain_states(model).theta[shared], model.theta[shared])
