"""Compensators and controllers against their printed equations and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.blocks.helpers import assert_sound, rates, refuses, simulate, value
from tsmblocks.blocks.control import (
    PID,
    FeedforwardCompensator,
    HysteresisObserver,
    LeadLag,
    PIDController,
    SmoothSlope,
)
from tsmblocks.blocks.hysteresis import AsymmetricBoucWen, slope

W = 2 * np.pi * 0.2
AMPLITUDE = np.deg2rad(55.0)


def x_ref(t):
    return AMPLITUDE * np.sin(W * t)


def v_ref(t):
    return AMPLITUDE * W * np.cos(W * t)


def acceleration(t):
    return -(W**2) * x_ref(t)


@pytest.mark.parametrize("cls", [FeedforwardCompensator, HysteresisObserver, LeadLag, PID, PIDController, SmoothSlope])
def test_sound(cls):
    assert_sound(cls())


def test_controller_without_limits_is_sound():
    assert_sound(PIDController(low=-np.inf, high=np.inf))


def test_observer_is_the_state_of_the_plant():
    a = simulate(AsymmetricBoucWen(), {"x": x_ref, "v": v_ref}, stop=5.0, step=5e-3)
    b = simulate(HysteresisObserver(), {"v": v_ref}, stop=5.0, step=5e-3)
    assert np.array_equal(a["x.zeta"], b["y"])


def test_compensator_holds_the_observer():
    a = simulate(FeedforwardCompensator(), {"x": x_ref, "v": v_ref}, stop=5.0, step=5e-3)
    b = simulate(HysteresisObserver(), {"v": v_ref}, stop=5.0, step=5e-3)
    alpha = [value(SmoothSlope(), v=v_ref(t))["y"] for t in a["t"]]
    assert a["y"] == pytest.approx((x_ref(a["t"]) - b["y"]) / np.array(alpha), abs=1e-14)


def test_observer_is_equation_12_as_printed():
    p = HysteresisObserver(A=-0.8130, theta=4.3820, delta=-0.0570)
    for zeta, v in np.random.default_rng(1).normal(size=(50, 2)):
        printed = p.A * v - p.theta * abs(v) * zeta + p.delta * abs(v)
        assert rates(p, {"zeta": zeta}, v=v)["zeta"] == pytest.approx(printed, abs=1e-14)


def test_slope_is_equation_13_as_printed():
    p = SmoothSlope()
    for v in np.linspace(-5, 5, 41):
        printed = (p.alpha1 * np.exp(2 * v) + p.alpha2) / (np.exp(2 * v) + 1)
        assert value(p, v=v)["y"] == pytest.approx(printed, abs=1e-15)


def test_equation_14_would_hold_if_plant_and_observer_saw_the_same_rate():
    for x, v, zeta in np.random.default_rng(2).normal(size=(20, 3)):
        command = value(FeedforwardCompensator(), {"zeta": zeta}, x=x, v=v)["y"]
        assert value(AsymmetricBoucWen(), {"zeta": zeta}, x=command, v=v)["y"] == pytest.approx(x, abs=1e-14)


def test_compensator_leaves_13_of_29_degrees_with_a_perfect_model():
    p, step = FeedforwardCompensator(), 1e-3
    fine = simulate(p, {"x": x_ref, "v": v_ref}, stop=20.0, step=step / 2)
    t, v, zeta = fine["t"], v_ref(fine["t"]), fine["x.zeta"]
    alpha = np.array([float(slope(s, p.alpha1, p.alpha2)) for s in v])
    alpha_rate = (p.alpha1 - p.alpha2) / 2 / np.cosh(v) ** 2 * acceleration(t)
    zeta_rate = p.A * v - p.theta * abs(v) * zeta + p.delta * abs(v)
    speed = (v - zeta_rate) / alpha - fine["y"] * alpha_rate / alpha

    def at(values):
        return lambda s: values[min(round(s / (step / 2)), len(values) - 1)]

    run = simulate(AsymmetricBoucWen(), {"x": at(fine["y"]), "v": at(speed)}, stop=20.0, step=step)
    late = run["t"] > 15.0
    assert np.rad2deg(np.ptp((x_ref(run["t"]) - run["y"])[late])) == pytest.approx(13.17, abs=0.01)


def test_pid_answers_a_constant_error_as_equation_15_says():
    p = PID(kp=1.5, ki=2.0, kd=0.3, tau=0.05)
    run = simulate(p, {"e": lambda t: 0.4}, stop=1.0, step=1e-3)
    expected = 0.4 * (1.5 + 2.0 * run["t"] + 0.3 / 0.05 * np.exp(-run["t"] / 0.05))
    assert run["y"] == pytest.approx(expected, abs=1e-8)


def test_pid_derivative_of_a_ramp_is_its_slope():
    run = simulate(PID(kp=0.0, ki=0.0, kd=2.0, tau=0.01), {"e": lambda t: 3.0 * t}, stop=0.5, step=1e-3)
    assert run["y"][-1] == pytest.approx(6.0, abs=1e-9)


def test_controller_without_weights_and_limits_is_the_pid():
    gains = dict(kp=1.2, ki=3.0, kd=0.1, tau=0.02)
    full = PIDController(**gains, b=1.0, c=1.0, low=-np.inf, high=np.inf)
    a = simulate(full, {"r": x_ref, "ym": lambda t: 0.3 * t}, stop=3.0, step=1e-3)
    b = simulate(PID(**gains), {"e": lambda t: x_ref(t) - 0.3 * t}, stop=3.0, step=1e-3)
    assert np.abs(a["u"] - b["y"]).max() < 1e-12


def test_controller_weights_act_on_the_reference_only():
    p = PIDController(kp=2.0, ki=0.0, kd=0.5, tau=0.1, b=0.4, c=0.0)
    assert value(p, r=1.0, ym=0.0)["u"] == pytest.approx(0.8)
    assert value(p, r=0.0, ym=1.0)["u"] == pytest.approx(-2.0 - 5.0)
    assert value(p.replace(c=0.2), r=1.0, ym=0.0)["u"] == pytest.approx(0.8 + 1.0)


def test_controller_gives_way_at_its_limit():
    p = PIDController(kp=10.0, ki=5.0, low=-24.0, high=24.0, kaw=4.0)
    run = simulate(p, {"r": lambda t: 10.0, "ym": lambda t: 0.0}, stop=5.0, step=1e-3)
    assert np.all(run["u"] == 24.0)
    # It rests where ki e = kaw (w - high), with w = kp e + I.
    assert run["x.integral"][-1] == pytest.approx(24.0 + 5.0 * 10.0 / 4.0 - 100.0, abs=1e-6)


def test_controller_without_anti_windup_winds_up():
    p = PIDController(kp=10.0, ki=5.0, kaw=0.0)
    run = simulate(p, {"r": lambda t: 10.0, "ym": lambda t: 0.0}, stop=2.0, step=1e-3)
    assert run["x.integral"][-1] == pytest.approx(100.0)


def test_lead_lag_answers_a_step_in_closed_form():
    run = simulate(LeadLag(gain=2.0, lead=0.1, lag=0.04), {"u": lambda t: 1.0}, stop=0.5, step=1e-3)
    expected = 2.0 * (1 + (0.1 / 0.04 - 1) * np.exp(-run["t"] / 0.04))
    assert run["y"] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize(
    ("message", "cls", "values"),
    [
        ("PID.tau must lie in (0, inf), got 0. It is: time constant of the derivative filter [s].", PID, dict(tau=0)),
        ("PID has no parameter 'kpp'. Did you mean 'kp'?", PID, dict(kpp=1.0)),
        ("PIDController needs low < high, got low=1, high=-1.", PIDController, dict(low=1, high=-1)),
        (
            "PIDController.kaw must lie in [0, inf), got -1. It is: rate of the anti-windup at a limit [1/s].",
            PIDController,
            dict(kaw=-1),
        ),
        (
            "HysteresisObserver.theta must lie in (0, inf), got 0. "
            "It is: decay of the internal state with travel [1/rad].",
            HysteresisObserver,
            dict(theta=0),
        ),
        (
            "SmoothSlope.alpha1 must lie in (0, inf), got -0.9. It is: slope while loading (v > 0).",
            SmoothSlope,
            dict(alpha1=-0.9),
        ),
        (
            "FeedforwardCompensator.alpha2 must be a number, got 'x'. It is: slope while unloading (v < 0).",
            FeedforwardCompensator,
            dict(alpha2="x"),
        ),
        (
            "LeadLag.lag must lie in (0, inf), got -1. It is: time constant of the denominator [s].",
            LeadLag,
            dict(lag=-1),
        ),
    ],
)
def test_bad_values(message, cls, values):
    refuses(message, cls, **values)
