"""Motors against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, simulate
from tsmblocks.blocks.motor import DCMotor, MotorTransferFunction
from tsmblocks.simulation.stability import StepWarning

LINEAR = dict(L=0.005, coulomb=0.0, voltage_drop=0.0)


@pytest.mark.parametrize("motor", [MotorTransferFunction(), DCMotor(), DCMotor(load=True)])
def test_sound(motor):
    assert_sound(motor)


def test_transfer_function_answers_a_step_in_closed_form():
    run = simulate(MotorTransferFunction(K=2.0, tau=0.02), {"u": lambda t: 12.0}, stop=0.3, step=1e-3)
    lag = 1 - np.exp(-run["t"] / 0.02)
    assert run["v"] == pytest.approx(24.0 * lag, abs=1e-5)
    assert run["y"] == pytest.approx(24.0 * (run["t"] - 0.02 * lag), abs=1e-7)


def test_linear_dc_motor_settles_in_closed_form():
    p = DCMotor(**LINEAR, load=True)
    run = simulate(p, {"u": lambda t: 12.0, "load": lambda t: 0.05}, stop=0.5, step=5e-4)
    torque = 0.05 / p.gear
    speed = (p.kt * 12.0 - p.R * torque) / (p.kt**2 + p.R * p.b)
    assert run["v"][-1] == pytest.approx(speed / p.gear, rel=1e-9)
    assert run["i"][-1] == pytest.approx((p.b * speed + torque) / p.kt, rel=1e-9)


@pytest.mark.parametrize("voltage", [-24.0, -2.0, 3.0, 24.0])
def test_dc_motor_with_friction_and_brushes_settles_in_closed_form(voltage):
    p = DCMotor(L=0.005)
    run = simulate(p, {"u": lambda t: voltage}, stop=0.5, step=5e-4)

    def lacking(speed):
        current = (p.b * speed + p.coulomb * np.tanh(speed / p.smoothing)) / p.kt
        drop = p.voltage_drop * np.tanh(current / p.drop_current)
        return voltage - p.R * current - p.kt * speed - drop

    assert run["v"][-1] * p.gear == pytest.approx(brentq(lacking, -1e3, 1e3), rel=1e-6)


def test_dc_motor_of_the_class_agrees_with_the_transfer_function():
    p, K = DCMotor(), MotorTransferFunction().K
    assert p.kt / (p.kt**2 + p.R * p.b) / p.gear == pytest.approx(K, rel=0.03)


def test_angle_is_the_integral_of_the_speed():
    run = simulate(DCMotor(L=0.005), {"u": lambda t: 10 * np.sin(3 * t)}, stop=1.0, step=5e-4)
    area = np.concatenate([[0], np.cumsum((run["v"][1:] + run["v"][:-1]) / 2 * 5e-4)])
    assert run["y"] == pytest.approx(area, abs=1e-5)


def test_dc_motor_with_a_choke_can_be_stepped_at_a_millisecond():
    coarse = simulate(DCMotor(L=0.005), {"u": lambda t: 24 * np.sin(5 * t)}, stop=1.0, step=1e-3)
    fine = simulate(DCMotor(L=0.005), {"u": lambda t: 24 * np.sin(5 * t)}, stop=1.0, step=1e-4)
    assert coarse["y"] == pytest.approx(fine["y"][::10], abs=1e-4)


def test_an_implicit_method_steps_a_bare_motor_at_a_millisecond():
    """A step of 12 V, against Radau at 1e-10; the current is past its peak after a few steps."""
    p = DCMotor()
    assert pytest.approx(9.5e-5, rel=0.01) == p.L / p.R

    def rates(t, x):
        i, speed, _ = x
        drop = p.voltage_drop * np.tanh(i / p.drop_current)
        dry = p.coulomb * np.tanh(speed / p.smoothing)
        return [(12.0 - p.R * i - p.kt * speed - drop) / p.L, (p.kt * i - p.b * speed - dry) / p.J, speed / p.gear]

    t = 1e-3 * np.arange(301)
    i, speed, angle = solve_ivp(rates, (0, 0.3), [0, 0, 0], method="Radau", t_eval=t, rtol=1e-10, atol=1e-12).y
    motor = tsm.Diagram(title="motor", blocks=dict(m=p), inputs={"u": "m.u"})
    for method, error in (("sdirk2", 2e-5), ("sdirk3", 5e-6), ("sdirk4", 5e-6)):
        run = tsm.simulate(motor, inputs={"u": 12.0}, stop=0.3, step=1e-3, method=method)
        assert np.abs(run["m.y"] - angle).max() < error * angle.max()
        assert run["m.v"] == pytest.approx(speed / p.gear, rel=4e-3, abs=0.1)
        assert run["m.i"][5:] == pytest.approx(i[5:], rel=0.01)
    with pytest.warns(StepWarning, match=r"too long for the fastest pole .*, an implicit method \(sdirk2\) does not"):
        tsm.simulate(motor, inputs={"u": 12.0}, stop=0.01, step=1e-3)


def test_a_file_without_an_inductance_means_that_of_winding_and_choke():
    text = 'format = 1\nwires = []\n[blocks]\nm = { type = "DCMotor" }\n[inputs]\nu = "m.u"\n'
    old = tsm.loads(text)
    assert old.parameters["m.L"] == 0.005
    assert 'm = { type = "DCMotor" }' in tsm.dumps(old)
    bare = old.replace("m", DCMotor())
    assert "L = 0.00055" in tsm.dumps(bare)
    assert tsm.loads(tsm.dumps(bare)) == bare


def test_dc_motor_stays_put_below_its_friction():
    p = DCMotor(L=0.005)
    start = p.coulomb * p.R / p.kt
    run = simulate(p, {"u": lambda t: 0.5 * start}, stop=1.0, step=5e-4)
    assert abs(run["v"][-1]) < 1.5 * p.smoothing / p.gear


def test_load_port_is_there_when_asked_for():
    assert list(DCMotor().inports) == ["u"]
    assert list(DCMotor(load=True).inports) == ["u", "load"]
    assert list(DCMotor().outports) == ["y", "v", "i"]
    assert DCMotor(load=True).inports["load"].unit == "N*m"


@pytest.mark.parametrize(
    ("message", "cls", "values"),
    [
        (
            "MotorTransferFunction.K must lie in (0, inf), got -2. "
            "It is: speed per volt at the output shaft [rad/(s*V)].",
            MotorTransferFunction,
            dict(K=-2),
        ),
        ("DCMotor.R must lie in (0, inf), got 0. It is: resistance of the winding [ohm].", DCMotor, dict(R=0)),
        (
            "DCMotor.load must be true or false, got 1. It is: whether there is a port for the load's torque.",
            DCMotor,
            dict(load=1),
        ),
        (
            "DCMotor.coulomb must lie in [0, inf), got -1. It is: dry friction at the rotor [N*m].",
            DCMotor,
            dict(coulomb=-1),
        ),
    ],
)
def test_bad_values(message, cls, values):
    refuses(message, cls, **values)
