"""Effects inside a transmission, hidden in recordings that SciPy simulates: a gap in a spring, a play before a belt."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tsmblocks.blocks import SecondOrderLag
from tsmblocks.effects import Scales, Span
from tsmblocks.effects.transmission import _gap_trials

SLOW_NEEDS = ["diagnosis", "diagrams/flexible_joint.toml", "diagrams/belt_drive.toml"]
STEP = 2e-3
NOISE = 2e-5
T = STEP * np.arange(3000)


def torque(t, k):
    """A torque that turns the joint to and fro, another one in each recording."""
    return 6.0 * np.sin(2.1 * t + k) + 5.0 * np.sin((7.3 + k) * t) + 3.0 * np.sin(23.0 * t + 1.0 + k)


def joint_with_a_gap(k, gap=0.012):
    """The flexible joint with a gap in series with its spring: within it no torque passes but that of the damper."""

    def rates(t, x):
        motor, speed, link, link_speed = x
        stretch = motor - link
        beyond = stretch - np.clip(stretch, -gap / 2, gap / 2)
        shaft = 800.0 * beyond + 4.0 * (speed - link_speed)
        return [speed, 2.0 * (torque(t, k) - 5.0 * speed - shaft), link_speed, 1.6 * (shaft - 10.0 * np.sin(link))]

    done = solve_ivp(rates, (0.0, T[-1]), [0.0, 0.0, 0.0, 0.0], t_eval=T, rtol=1e-8, atol=1e-10, max_step=2e-3)
    noise = np.random.default_rng(k).normal(0.0, NOISE, (2, len(T)))
    signals = {"torque": torque(T, k), "theta": done.y[0] + noise[0], "q": done.y[2] + noise[1]}
    return tsm.Record(f"run{k}", T, signals, {"torque": "N*m", "theta": "rad", "q": "rad"})


def test_a_gap_is_tried_where_nothing_is_transmitted():
    """The middle of a deflection that gravity biases is no place of a gap: from there its fit ends beside it."""

    def tried(low, high):
        wire = Span(low, high, 1.0, 1.0, 1.0)
        return {one["centre"] for one in _gap_trials(Scales(wire, wire, 0.0, 1.0, 0.01, 1.0)).shapes}

    assert tried(-0.25, 0.75) == {0.0, 0.25}
    assert tried(0.25, 0.75) == {0.5}  # a preload


@pytest.mark.slow
def test_a_gap_in_a_spring_is_named_with_its_width():
    model = tsm.load("flexible_joint").with_parameters({"spring.gain": 700.0, "damper.gain": 5.0})
    free = ["motor_inverse_inertia.gain", "spring.gain", "damper.gain", "link_inverse_inertia.gain", "weight.gain"]
    found = tsm.diagnose(model, {f"run{k}": joint_with_a_gap(k) for k in range(2)}, free=free)
    (gap,) = found.effects
    assert (gap.name, gap.wire) == ("backlash", "twist.y -> spring.u")
    assert found.complete
    width = gap.sizes["gap width"]
    assert width.value == pytest.approx(0.012, rel=0.03)
    assert width.low <= 0.012 <= width.high
    assert found.augmented.parameters["spring.gain"] == pytest.approx(800.0, rel=0.01)


def belt_behind_a_play(k, half_width=0.0004):
    """The belt drive with a play between pulley and belt: an event at each side, where the pulley moves the belt."""
    from scipy.signal import lsim

    t = 1e-4 * np.arange(60_000)
    u = 1.5 * np.sin(2 * np.pi * (0.3 + 0.1 * k) * t + 1.5) + 1.0 * np.sin(2 * np.pi * 1.1 * t + k)
    motor = tsm.load("belt_drive").blocks["motor"]
    _, angle, _ = lsim(([motor.K], [motor.tau, 1.0, 0.0]), u, t)
    before, middle = np.empty_like(t), 0.0
    for i, x in enumerate(0.02 * angle):
        middle = max(x - half_width, min(x + half_width, middle))
        before[i] = middle
    _, x, _ = lsim(([60.0**2], [1.0, 2 * 0.2 * 60.0, 60.0**2]), before, t)
    x, at = x[::20] + np.random.default_rng(k).normal(0.0, 1e-6, 3000), t[::20]
    return tsm.Record(f"run{k}", at, {"u": u[::20], "x": x}, {"u": "V", "x": "m"})


@pytest.mark.slow
def test_a_play_before_a_belt_is_named_with_its_width():
    records = {f"run{k}": belt_behind_a_play(k) for k in range(2)}
    found = tsm.diagnose(tsm.load("belt_drive"), records, free=["motor.K", "belt.omega", "belt.zeta"])
    (gap,) = found.effects
    assert (gap.name, gap.wire) == ("backlash", "pulley.y -> belt.u")
    width = gap.sizes["gap width"]
    assert width.value == pytest.approx(0.0008, rel=0.03)


def oscillator_with_a_gap(k, gap=0.02):
    """A second-order lag whose spring does not pull within a gap, from a state that is not at rest."""
    t = 5e-3 * np.arange(1600)

    def turned(t):
        return 0.3 * np.sin(2.0 * t + k) + 0.1 * np.sin((6.1 + k) * t)

    def rates(t, x):
        stretch = turned(t) - x[0]
        pull = 900.0 * (stretch - np.clip(stretch, -gap / 2, gap / 2))
        return [x[1], pull - 6.0 * x[1]]

    start = [0.1 * k, 0.3]
    done = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-8, atol=1e-10, max_step=5e-3)
    y = done.y[0] + np.random.default_rng(k).normal(0.0, 1e-4, len(t))
    return tsm.Record(f"run{k}", t, {"x_in": turned(t), "x_out": y}, {"x_in": "rad", "x_out": "rad"})


def test_a_gap_in_the_spring_of_a_lag_is_named_with_its_width():
    model = tsm.Diagram(
        title="oscillator",
        blocks={"lag": SecondOrderLag(omega=26.0, zeta=0.15)},
        inputs={"x_in": tsm.Inlet(("lag.u",), "rad", "")},
        outputs={"x_out": "lag"},
    )
    records = {f"run{k}": oscillator_with_a_gap(k) for k in range(2)}
    options = dict(free=["lag.omega", "lag.zeta"], effects=["backlash", "hysteresis", "rate_dependence"])
    found = tsm.diagnose(model, records, **options)
    (gap,) = found.effects
    assert (gap.name, gap.block) == ("backlash", "lag")
    assert found.complete
    width = gap.sizes["gap width"]
    assert width.low <= 0.02 <= width.high
    assert width.value == pytest.approx(0.02, rel=0.01)
    assert found.augmented.parameters["lag.spring.gain"] == pytest.approx(900.0, rel=0.01)
