"""Lag and dead time of any size: closed forms, order, continuity down to nothing, derivatives, both back ends."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, simulate
from tsmblocks.blocks import (
    AsymmetricBoucWen,
    Constant,
    DeadTime,
    Delay,
    Derivative,
    FirstOrderLag,
    Gain,
    Integrator,
    Lag,
    Saturation,
    Sine,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.common.errors import AlgebraicLoop, RunError

H = 0.01
T = np.arange(0.0, 2.0, H)
X = 0.8 * np.cos(2 * T) + 0.3 * np.cos(7 * T)
"""A signal that starts at rest, so that holding its first value before the start leaves no corner."""
MEMORY = {"time": 0.0, "last": 0.0, "behind": 0.0, "slope": 0.0, "length": 1.0}


def of_sine(block, step, stop=2.0):
    blocks = dict(s=Sine(amplitude=1.0, frequency=0.5), late=block, rate=Derivative())
    return tsm.simulate(tsm.Diagram(title="sine", blocks=blocks, wires=["s -> late -> rate"]), stop=stop, step=step)


def before(block):
    """The block in front of a plant that reads the rate of its output."""
    return tsm.Diagram(
        title="before",
        blocks=dict(late=block, tsm=AsymmetricBoucWen()),
        inputs={"x_in": "late.u"},
        wires=["late -> tsm.x"],
        outputs={"x_out": "tsm"},
    )


def behind(block):
    return tsm.Diagram(
        title="behind",
        blocks=dict(late=block, tsm=AsymmetricBoucWen()),
        inputs={"x_in": "tsm.x"},
        wires=["tsm -> late"],
        outputs={"x_out": "late"},
    )


def out(diagram, **more):
    return tsm.simulate(diagram, inputs={"x_in": (T, X)}, stop=T[-1], step=H, hold="cubic", **more)["x_out"]


def cubic(**more):
    """t^3 made of integrators, for which the method is exact, behind a dead time."""
    blocks = dict(six=Constant(value=6.0), a=Integrator(), b=Integrator(), c=Integrator(), late=DeadTime(**more))
    return tsm.Diagram(title="cubic", blocks=blocks, wires=["six -> a -> b -> c -> late"])


# ---- lag


def test_sound():
    assert_sound(Lag(time_constant=0.1))


@pytest.mark.parametrize("T1", [1e-6, 0.004, 0.1, 3.0])
def test_lag_of_a_straight_line_is_exact(T1):
    run = simulate(Lag(time_constant=T1), {"u": lambda t: 0.3 + 2 * t}, stop=1.0, step=0.05)
    t = run["t"]
    assert run["y"] == pytest.approx(0.3 + 2 * (t - T1 * (1 - np.exp(-t / T1))), abs=1e-12)


def test_lag_of_a_parabola_is_exact_once_the_start_is_forgotten():
    run = simulate(Lag(time_constant=0.05), {"u": lambda t: t * t}, stop=3.0, step=0.1)
    t = run["t"][20:]
    assert run["y"][20:] == pytest.approx(t * t - 0.1 * t + 2 * 0.05**2, abs=1e-12)


@pytest.mark.parametrize("T1", [1e-5, 0.003, 0.03, 0.3, 3.0])
def test_lag_of_a_sine_and_its_rate(T1):
    """Of third order in the step where the lag is longer than it, the rate of second order where it is shorter."""
    w = np.pi
    errors = []
    for step in (0.02, 0.01):
        run = of_sine(Lag(time_constant=T1), step)
        size, angle = 1 / math.hypot(1, w * T1), math.atan(w * T1)
        y = size * (np.sin(w * run.t - angle) + math.sin(angle) * np.exp(-run.t / T1))
        rate = (np.sin(w * run.t) - y) / T1
        errors.append((np.abs(run["late.y"] - y).max(), np.abs(run["rate.y"] - rate)[5:].max()))
    (y2, r2), (y1, r1) = errors
    assert y1 < 3e-6
    assert r1 < 2e-3
    assert np.log2(y2 / y1) > 1.9
    assert np.log2(r2 / r1) > 1.9


@pytest.mark.parametrize("backend", ["casadi", "llvm"])
def test_a_lag_may_start_away_from_its_input(backend):
    """A recording does not begin in equilibrium: the error of the start decays with the lag's time constant."""
    place = tsm.Diagram(blocks={"lag": Lag(time_constant=0.4, behind=-3.0)}, inputs={"u": "lag"}, outputs={"y": "lag"})
    run = tsm.simulate(place, inputs={"u": (T, 2.0 + 0 * T)}, stop=1.5, step=H, backend=backend)
    assert run["y"] == pytest.approx(2.0 - 3.0 * np.exp(-run.t / 0.4), abs=1e-12)


def test_a_fit_finds_where_a_lag_starts():
    """A heater that is switched on cold ended far from its parameters: the lag began in equilibrium."""
    wanted = tsm.Diagram(blocks={"lag": Lag(time_constant=0.4, behind=-2.0)}, inputs={"u": "lag"}, outputs={"y": "lag"})
    u = 2.0 + 0.3 * X
    y = tsm.simulate(wanted, inputs={"u": (T, u)}, stop=T[-1], step=H, hold="linear")["y"]
    data = tsm.Record("cold", T, {"u": u, "y": y}, {})
    other = tsm.Diagram(blocks={"lag": Lag(time_constant=0.6)}, inputs={"u": "lag"}, outputs={"y": "lag"})
    found = tsm.fit(other, data, step=H, hold="linear", start_states=True)
    assert found["lag.time_constant"].value == pytest.approx(0.4, rel=1e-6)


def test_lag_agrees_with_the_lag_that_has_a_state():
    blocks = dict(s=Sine(amplitude=1.0, frequency=0.5), ours=Lag(time_constant=0.1))
    d = tsm.Diagram(
        title="two", blocks={**blocks, "theirs": FirstOrderLag(time_constant=0.1)}, wires=["s -> ours, theirs"]
    )
    run = tsm.simulate(d, stop=3.0, step=0.002)
    assert run["ours.y"] == pytest.approx(run["theirs.y"], abs=1e-7)


@settings(max_examples=30, deadline=None)
@given(
    T1=st.one_of(st.just(0.0), st.floats(-13, 4).map(lambda e: 10**e)),
    u=st.lists(st.floats(-1, 1), min_size=30, max_size=30),
)
def test_lag_of_any_size_is_stable_at_any_step(T1, u):
    """A corner may be passed by a little, as by any parabola."""
    run = simulate(Lag(time_constant=T1), {"u": lambda t: u[min(round(t), 29)]}, stop=29.0, step=1.0)
    assert np.abs(run["y"]).max() <= 3.0


@pytest.mark.parametrize("T1", [0.0, 0.004, 0.05])
def test_lag_goes_with_locating_switches(T1):
    """It brings no event of its own, and an update at one of the limit's leaves it as it was."""
    blocks = dict(
        s=Sine(amplitude=1.0, frequency=0.5),
        late=Lag(time_constant=T1),
        cap=Saturation(low=-0.5, high=0.5),
        i=Integrator(),
    )
    d = tsm.Diagram(title="cap", blocks=blocks, wires=["s -> late -> cap -> i"])
    found, fine = tsm.simulate(d, stop=4.0, step=0.01, locate=True), tsm.simulate(d, stop=4.0, step=0.0005)
    assert [event.block for event in found.events] == ["cap"] * 8
    assert found["i.y"] == pytest.approx(fine["i.y"][::20], abs=1e-6)


@pytest.mark.parametrize("place", [before, behind])
@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_lag_tends_to_nothing_as_it_shrinks(place, backend):
    base = out(place(Lag()), backend=backend)
    for T1, bound in ((1e-3, 4e-3), (1e-6, 2e-4), (1e-12, 2e-4)):
        away = np.abs(out(place(Lag(time_constant=T1)), backend=backend) - base)[3:].max()  # past the first parabola
        assert 0 < away < bound


# ---- dead time


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.0031, 0.005, 0.01, 0.0134, 0.02, 0.155])
@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_dead_time_of_a_cubic_is_exact(delay, backend):
    run = tsm.simulate(cubic(time=delay), stop=1.0, step=H, backend=backend)
    late = run.t > delay + 4 * H
    assert run["late.y"][late] == pytest.approx((run.t[late] - delay) ** 3, abs=1e-13)
    assert (run["late.y"][run.t < delay - 1e-9] == 0.0).all()


@pytest.mark.parametrize("delay", [0.0007, 0.0037, 0.0123])
def test_dead_time_of_a_sine_and_its_rate(delay):
    w = np.pi
    errors = []
    for step in (0.04, 0.02):
        run = of_sine(DeadTime(time=delay), step)
        late = run.t > delay + 4 * step
        errors.append(
            (
                np.abs(run["late.y"] - np.sin(w * (run.t - delay)))[late].max(),
                np.abs(run["rate.y"] - w * np.cos(w * (run.t - delay)))[late].max(),
            )
        )
    (y2, r2), (y1, r1) = errors
    assert y1 < 1e-6
    assert r1 < 2e-4
    assert np.log2(y2 / y1) > 2.9
    assert np.log2(r2 / r1) > 1.9


@pytest.mark.parametrize("place", [before, behind])
@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_dead_time_goes_on_smoothly_through_zero_and_whole_steps(place, backend):
    """No step between neighbours is larger than the signal's own, and lanes give what single runs give."""
    times = np.concatenate([[0.0, 1e-12, 1e-6], np.linspace(0, 3 * H, 61)[1:]])
    diagram = place(DeadTime())
    batch = tsm.simulate_batch(
        diagram,
        {"late.time": times},
        inputs={"x_in": (T, X)},
        stop=T[-1],
        step=H,
        hold="cubic",
        outputs=["x_out"],
        backend=backend,
    )["x_out"]
    runs = np.reshape(batch, (len(T), len(times))) if np.shape(batch)[0] == len(T) else np.transpose(batch)
    fastest = np.abs(np.diff(X)).max() / H
    for k, (a, b) in enumerate(pairwise(times)):
        assert np.abs(runs[4:, k + 1] - runs[4:, k]).max() <= 1.5 * fastest * (b - a) + 1e-7
    for k in (0, 2, 7, 40):
        assert runs[:, k] == pytest.approx(out(diagram, parameters={"late.time": times[k]}), abs=1e-7)


def test_dead_time_is_the_delay_where_that_can_be():
    blocks = dict(
        s=Sine(amplitude=1.0, frequency=0.5),
        ours=DeadTime(time=0.0137, start="value", initial=0.4),
        theirs=Delay(time=0.0137, initial=0.4),
    )
    run = tsm.simulate(tsm.Diagram(title="two", blocks=blocks, wires=["s -> ours, theirs"]), stop=1.0, step=H)
    assert run["ours.y"] == pytest.approx(run["theirs.y"], abs=1e-15)
    assert run["ours.y"][0] == 0.4


def test_dead_time_holds_the_first_value_before_the_start():
    d = tsm.Diagram(title="one", blocks=dict(late=DeadTime(time=0.025)), inputs={"u": "late.u"}, outputs={"y": "late"})
    run = tsm.simulate(d, inputs={"u": (T, 3.0 + T)}, stop=T[-1], step=H)
    assert run["y"] == pytest.approx(np.maximum(3.0 + T - 0.025, 3.0), abs=1e-13)


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("method", ["heun", "rk4"])
@pytest.mark.parametrize("kind", [DeadTime, Delay])
def test_the_jump_from_the_value_before_the_start_belongs_to_the_step_after_it(kind, method, backend):
    """The integral of what jumps from -1 to 1 at an instant of the grid has no error there."""
    options = {"start": "value"} if kind is DeadTime else {}
    late = tsm.Diagram(
        title="late",
        blocks={"one": Constant(), "late": kind(time=0.05, initial=-1.0, **options), "total": Integrator()},
        wires=["one -> late -> total"],
        outputs={"y": "total"},
    )
    run = tsm.simulate(late, stop=0.2, step=0.01, method=method, backend=backend)
    assert run["y"] == pytest.approx(np.abs(run.t - 0.05) - 0.05, abs=1e-9)


def test_dead_time_of_a_sampled_signal():
    d = tsm.Diagram(
        title="held",
        blocks=dict(s=Sine(), hold=ZeroOrderHold(period=0.05), late=DeadTime(time=0.03)),
        wires=["s -> hold -> late"],
    )
    run = tsm.simulate(d, stop=1.0, step=H)
    assert run["late.y"][3:] == pytest.approx(run["hold.y"][:-3], abs=1e-12)


def test_dead_time_goes_on_from_a_state_that_was_left():
    """Taken step by step, a run is the same; a step gives the outputs at its end."""
    d = tsm.Diagram(title="one", blocks=dict(late=DeadTime(time=0.0134)), inputs={"u": "late.u"}, outputs={"y": "late"})
    stepper = tsm.Stepper(d, step=H)
    rows = [stepper.step({"u": x})["y"] for x in X]
    once = tsm.simulate(d, inputs={"u": (T, X)}, stop=T[-1], step=H, hold="zero")["y"]
    assert rows[:-1] == pytest.approx(once[1:], abs=1e-13)


def test_the_second_derivative_of_a_delayed_signal():
    def error(step):
        blocks = dict(s=Sine(amplitude=1.0, frequency=0.5), late=Delay(time=0.0773), a=Derivative(), b=Derivative())
        d = tsm.Diagram(title="twice", blocks=blocks, wires=["s -> late -> a -> b"])
        run = tsm.simulate(d, stop=2.0, step=step)
        late = run.t > 0.0773 + 4 * step
        return np.abs(run["b.y"] + np.pi**2 * np.sin(np.pi * (run.t - 0.0773)))[late].max()

    assert error(0.01) < 1e-2
    assert np.log2(error(0.02) / error(0.01)) > 1.5


# ---- derivatives


@pytest.mark.parametrize("place", [before, behind])
@pytest.mark.parametrize(
    ("block", "parameter", "tolerance"),
    [(Lag, "time_constant", 1e-5), (DeadTime, "time", 1e-6)],
    ids=["Lag", "DeadTime"],
)
@pytest.mark.parametrize("size", [0.0, 0.0013, 0.0041, 0.0513])
@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_derivatives_by_the_size_one_sided_at_zero(place, block, parameter, tolerance, size, backend):
    diagram = place(block(**{parameter: size}))
    exact = tsm.sensitivities(
        diagram,
        [f"late.{parameter}"],
        outputs=["x_out"],
        inputs={"x_in": (T, X)},
        stop=T[-1],
        step=H,
        hold="cubic",
        backend=backend,
    ).jacobian[:, 0, 0]
    if block is Lag and place is before and size == 0.0:
        # A rate is not quite continuous there: at the start of a step it is taken over the steps before.
        a, b = (out(diagram, parameters={f"late.{parameter}": e}) for e in (4e-5, 2e-5))
        assert exact[3:] == pytest.approx((a - b)[3:] / 2e-5, abs=0.02 * np.abs(exact).max())
        return
    now, a, b = (out(diagram, parameters={f"late.{parameter}": size + e}) for e in (0.0, 1e-6, 2e-6))
    assert np.abs(exact).max() > 1.0
    assert exact == pytest.approx((-3 * now + 4 * a - b) / 2e-6, abs=tolerance)


@pytest.mark.parametrize("block", [Lag(), DeadTime()])
def test_at_nothing_the_slope_is_that_of_the_rate(block):
    """Lag and dead time cannot be told apart there."""
    name = "time_constant" if isinstance(block, Lag) else "time"
    d = tsm.Diagram(title="sine", blocks=dict(s=Sine(amplitude=1.0, frequency=0.5), late=block), wires=["s -> late"])
    slopes = tsm.sensitivities(d, [f"late.{name}"], outputs=["late.y"], stop=2.0, step=1e-3)
    rate = np.pi * np.cos(np.pi * slopes.t)
    assert slopes.jacobian[4:, 0, 0] == pytest.approx(-rate[4:], abs=2e-5)


def test_the_derivative_of_a_delayed_rate_is_exact():
    """What is behind reads the rate of the delayed signal, whose slope in the delay is a second derivative."""
    diagram = before(Delay(time=0.0513, initial=1.1))
    exact = tsm.sensitivities(
        diagram,
        ["late.time", "late.initial"],
        outputs=["x_out"],
        inputs={"x_in": (T, X)},
        stop=T[-1],
        step=H,
        hold="cubic",
    ).jacobian[:, 0]
    for k, (name, at) in enumerate((("late.time", 0.0513), ("late.initial", 1.1))):
        high, low = (out(diagram, parameters={name: at + e}) for e in (1e-6, -1e-6))
        assert np.abs(exact[:, k]).max() > 0.1
        assert exact[:, k] == pytest.approx((high - low) / 2e-6, abs=1e-6)


# ---- refusals


def test_refuses_bad_values():
    refuses("Lag.time_constant must lie in [0, inf), got -1. It is: time to 63 % of a step [s].", Lag, time_constant=-1)
    refuses("DeadTime.time must lie in [0, inf), got -0.1. It is: length of the delay [s].", DeadTime, time=-0.1)
    refuses(
        "DeadTime.start is 'last', which is not a choice. Known here: first, value. "
        "It is: whether the first input or initial holds before the start.",
        DeadTime,
        start="last",
    )


def test_a_dead_time_breaks_no_algebraic_loop():
    blocks = dict(ref=Sine(), error=Sum(), k=Gain(gain=0.5), late=DeadTime(time=0.1))
    wires = ["ref -> error.plus", "error -> k -> late -> error.minus"]
    with pytest.raises(AlgebraicLoop) as caught:
        tsm.simulate(tsm.Diagram(title="ring", blocks=blocks, wires=wires), stop=1.0, loops="refuse")
    assert caught.value.problems == (
        "error.y -> k.y -> late.y -> error.y has no state in it, so its value at one instant depends on itself. "
        "Break it with a block that has a state (a lag, an integrator), with a Delay, or with a sampled block.",
    )


def test_locating_switches_does_not_go_with_a_dead_time():
    with pytest.raises(RunError, match=r"locate=True does not support a transport delay \(late\.past\)"):
        out(behind(DeadTime()), locate=True)
