"""Limits against numpy and sample-by-sample references."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, simulate, value
from tsmblocks.blocks.limits import (
    DeadZone,
    EndStops,
    Quantiser,
    RateLimit,
    Relay,
    Saturation,
    SoftDeadZone,
    SoftRateLimit,
    SoftSaturation,
)
from tsmblocks.model.block import signals

NUMBERS = np.concatenate([np.linspace(-3, 3, 121), [-1e6, 1e6]])


@pytest.mark.parametrize(
    "block",
    [
        DeadZone(),
        EndStops(),
        EndStops(low=-np.inf, high=0.1, damping=2.0),
        SoftDeadZone(),
        Quantiser(),
        RateLimit(),
        RateLimit(start="last"),
        SoftRateLimit(),
        SoftRateLimit(rising=1e12, falling=-1e12),
        Relay(),
        Saturation(),
        SoftSaturation(),
        SoftSaturation(low=-0.5, high=0.5, softness=0.01),
    ],
    ids=lambda block: type(block).__name__,
)
def test_sound(block):
    assert_sound(block)


def test_dead_zone():
    for u in NUMBERS:
        expected = u - 0.7 if u > 0.7 else u + 0.4 if u < -0.4 else 0.0
        assert value(DeadZone(low=-0.4, high=0.7), u=u)["y"] == pytest.approx(expected, abs=1e-15)
        assert value(DeadZone(low=0.0, high=0.0), u=u)["y"] == u


def test_end_stops():
    stops = EndStops(low=-0.4, high=0.7, stiffness=50.0, damping=4.0, transition=0.1)
    assert all(value(stops, x=x, v=v)["y"] == 0 for x in (-0.4, 0.0, 0.7) for v in (-3.0, 0.0, 3.0))
    assert value(stops, x=0.9, v=0.0)["y"] == pytest.approx(50 * 0.2)
    assert value(stops, x=0.9, v=1.5)["y"] == pytest.approx(50 * 0.2 + 4 * 1.5 * 0.2 / 0.3)
    assert value(stops, x=0.9, v=-100.0)["y"] == 0  # it never pulls
    assert value(stops, x=-0.6, v=-1.5)["y"] == pytest.approx(-50 * 0.2 - 4 * 1.5 * 0.2 / 0.3)
    assert value(stops, x=-0.6, v=100.0)["y"] == 0
    assert value(EndStops(low=-np.inf, high=0.7), x=-1e9, v=0.0)["y"] == 0
    refuses("EndStops needs low <= high, got low=1, high=0.", EndStops, low=1.0, high=0.0)


def bouncing(**stop):
    """A mass of 1 thrown against a stop at 0.1 with speed 1."""
    return tsm.Diagram(
        title="thrown",
        blocks=dict(
            v=tsm.blocks.Integrator(integral=1.0),
            x=tsm.blocks.Integrator(),
            stop=EndStops(**stop),
            net=tsm.blocks.Gain(gain=-1.0),
        ),
        wires=["stop -> net -> v -> x -> stop.x"],
        outputs={"x": "x", "v": "v", "force": "stop"},
    )


def test_a_mass_leaves_an_elastic_stop_as_fast_as_it_came():
    run = tsm.simulate(bouncing(low=-np.inf, high=0.1, stiffness=400.0), stop=0.5, step=1e-4)
    touched = run.t[run["force"] > 0]
    assert touched[-1] - touched[0] == pytest.approx(np.pi / 20, abs=4e-4)  # half a period of the mass on the spring
    assert run["v"][-1] == pytest.approx(-1.0, abs=1e-5)
    assert run["x"].max() == pytest.approx(0.1 + 1 / 20, abs=1e-5)


def test_a_mass_at_a_stop_with_a_damper_as_scipy_integrates_it():
    def rates(_, z):
        p = max(z[0] - 0.1, 0.0)
        return z[1], -max(400 * p + 12 * p / (p + 0.005) * z[1], 0.0)

    run = tsm.simulate(
        bouncing(low=-1.0, high=0.1, stiffness=400.0, damping=12.0, transition=0.005), stop=0.5, step=1e-4
    )
    exact = solve_ivp(rates, (0, 0.5), (0.0, 1.0), rtol=1e-10, atol=1e-12, max_step=1e-3, t_eval=run.t)
    assert run["x"] == pytest.approx(exact.y[0], abs=1e-6)
    assert run["v"] == pytest.approx(exact.y[1], abs=1e-4)
    assert -0.8 < run["v"][-1] < -0.2  # it leaves slower than it came


@pytest.mark.parametrize("softness", [0.05, 0.3])
def test_soft_dead_zone(softness):
    def softplus(x):
        return softness * np.logaddexp(0.0, x / softness)

    block = SoftDeadZone(half_width=0.5, centre=0.2, softness=softness)
    for u in NUMBERS:
        expected = 0.2 + softplus(u - 0.7) - softplus(-0.3 - u)
        assert value(block, u=u)["y"] == pytest.approx(expected, abs=1e-9 * max(abs(u), 1))


def test_soft_dead_zone_tends_to_the_hard_one_and_passes_without_a_width():
    for u in NUMBERS:
        soft, hard = SoftDeadZone(half_width=0.5, softness=1e-7), DeadZone(low=-0.5, high=0.5)
        assert value(soft, u=u)["y"] == pytest.approx(value(hard, u=u)["y"], abs=1e-6)
        assert value(SoftDeadZone(half_width=0.0, centre=0.3), u=u)["y"] == u


def test_saturation():
    for u in NUMBERS:
        assert value(Saturation(low=-1.0, high=2.0), u=u)["y"] == np.clip(u, -1.0, 2.0)


@pytest.mark.parametrize(("low", "high"), [(-np.inf, 2.0), (-1.0, np.inf), (-np.inf, np.inf)])
def test_saturation_on_one_side_or_none(low, high):
    for u in NUMBERS:
        assert value(Saturation(low=low, high=high), u=u)["y"] == np.clip(u, low, high)


@pytest.mark.parametrize("softness", [0.05, 0.3])
def test_soft_saturation(softness):
    def softplus(x):
        return softness * np.logaddexp(0.0, x / softness)

    block = SoftSaturation(low=-1.0, high=2.0, softness=softness)
    for u in NUMBERS:
        expected = u - softplus(u - 2.0) + softplus(-1.0 - u)
        assert value(block, u=u)["y"] == pytest.approx(expected, abs=1e-9 * max(abs(u), 1))
    for u in (*NUMBERS, 1e17, -1e17):
        assert value(block, u=u)["y"] == pytest.approx(np.clip(u, -1.0, 2.0), abs=0.7 * softness)


def test_soft_saturation_tends_to_the_hard_one():
    for u in NUMBERS:
        y = value(SoftSaturation(low=-1.0, high=2.0, softness=1e-6), u=u)["y"]
        assert y == pytest.approx(np.clip(u, -1.0, 2.0), abs=1e-6)


@pytest.mark.parametrize("softness", [1e-3, 1.0, 1e3])
def test_soft_saturation_without_limits_passes_to_the_bit(softness):
    for u in NUMBERS:
        assert value(SoftSaturation(low=-np.inf, high=np.inf, softness=softness), u=u)["y"] == u


def test_a_soft_limit_beside_an_infinite_one_has_derivatives():
    """The output is u - s ln(1 + e^((u - h)/s)): its derivatives are written out here."""
    t, h, s = np.linspace(0.0, 2.0, 101), 0.3, 0.1
    u = np.sin(3.0 * t)
    soft = SoftSaturation(low=-np.inf, high=h, softness=s)
    alone = tsm.Diagram(title="soft", blocks={"b": soft}, inputs={"u": "b"}, outputs={"y": "b"})
    found = tsm.sensitivities(alone, ["b.high", "b.softness"], inputs={"u": (t, u)}, stop=2.0, step=0.02)
    e = np.exp((u - h) / s)
    exact = np.stack([e / (1 + e), (u - h) / s * e / (1 + e) - np.log1p(e)])
    assert pytest.approx(exact, abs=1e-12) == found.jacobian[:, 0, :].T


@pytest.mark.parametrize(("low", "high"), [(-np.inf, 0.5), (-0.5, np.inf)])
def test_soft_saturation_on_one_side(low, high):
    """Far within the limits the signal passes, and the order of signals stays."""
    block = SoftSaturation(low=low, high=high, softness=0.1)
    y = [value(block, u=u)["y"] for u in NUMBERS[:-2]]
    assert np.all(np.diff(y) >= 0)
    assert min(y) > low
    assert max(y) < high
    free = -3.0 if low == -np.inf else 3.0
    assert value(block, u=free)["y"] == pytest.approx(free, abs=1e-9)


def test_quantiser():
    for u in NUMBERS:
        y = value(Quantiser(interval=0.25), u=u)["y"]
        assert abs(y - u) <= 0.125
        assert y / 0.25 == round(y / 0.25)


def test_rate_limit_follows_the_recursion_on_the_grid():
    def wanted(t):
        return np.sign(np.sin(3 * t + 0.1)) + 0.2 * t

    run = simulate(RateLimit(rising=2.0, falling=-5.0), {"u": wanted}, stop=4.0, step=0.01)
    expected = [wanted(0.0)]
    for t in run["t"][1:]:
        expected.append(float(np.clip(wanted(t), expected[-1] - 0.05, expected[-1] + 0.02)))
    assert run["y"] == pytest.approx(expected, abs=1e-12)


def test_rate_limit_lets_a_slow_signal_pass():
    run = simulate(RateLimit(rising=3.0, falling=-3.0), {"u": np.sin}, stop=4.0, step=0.01)
    assert run["y"] == pytest.approx(np.sin(run["t"]), abs=1e-12)


def test_rate_limit_may_set_out_from_its_state():
    block = RateLimit(rising=2.0, falling=-1.0, start="last", last=0.5)
    run = simulate(block, {"u": lambda _: 1.5}, stop=1.0, step=0.1)
    assert run["y"] == pytest.approx(np.minimum(0.5 + 2 * run["t"], 1.5), abs=1e-12)


def test_rate_limit_holds_within_the_step():
    block = RateLimit(rising=2.0, falling=-1.0)
    x = signals(["last", "time"], [1.0, 10.0])
    for dt in (0.0, 0.005, 0.01):
        assert float(block.outputs(10 + dt, x, signals(["u"], [99.0]))["y"]) == pytest.approx(1 + 2 * dt)
        assert float(block.outputs(10 + dt, x, signals(["u"], [-99.0]))["y"]) == pytest.approx(1 - dt)


SWING, RATE = (1.5, 0.4), (2.0, 7.0)


def swing(t):
    return sum(a * np.sin(w * t) for a, w in zip(SWING, RATE, strict=True))


def test_soft_rate_limit_solves_its_equation():
    r, f, s, T = 2.0, -1.5, 0.2, 0.05

    def slope(t, y):
        w = sum(a * w * np.cos(w * t) for a, w in zip(SWING, RATE, strict=True)) + (swing(t) - y) / T
        return w - s * np.logaddexp(0.0, (w - r) / s) + s * np.logaddexp(0.0, (f - w) / s)

    exact = solve_ivp(slope, (0, 4), [0.0], rtol=1e-10, atol=1e-12, dense_output=True).sol
    block, left = SoftRateLimit(rising=r, falling=f, softness=s, lag=T), []
    for step in (0.004, 0.002):
        run = simulate(block, {"u": swing}, stop=4.0, step=step)
        left.append(np.abs(run["y"] - exact(run["t"])[0]).max())
        assert np.abs(run["y"] - swing(run["t"])).max() > 1.0
    assert left[0] < 0.01
    assert left[0] / left[1] == pytest.approx(2.0, rel=0.3)  # first order in the step: the speed is held over it


def test_soft_rate_limit_tends_to_the_hard_one():
    soft = SoftRateLimit(rising=2.0, falling=-1.5, softness=1e-6, lag=1e-6)
    runs = [simulate(b, {"u": swing}, stop=4.0, step=0.01) for b in (soft, RateLimit(rising=2.0, falling=-1.5))]
    assert runs[0]["y"] == pytest.approx(runs[1]["y"], abs=1e-5)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1e-3, 1.0))
def test_soft_rate_limit_out_of_reach_is_none(first, then, lag):
    block = SoftRateLimit(rising=1e12, falling=-1e12, lag=lag)
    run = simulate(block, {"u": lambda t: first if t < 0.05 else then}, stop=0.1, step=0.01)
    assert run["y"].tolist() == [first if t < 0.05 else then for t in run["t"]]


def test_the_first_value_passes_a_soft_rate_limit():
    run = simulate(SoftRateLimit(softness=1e-3), {"u": lambda t: 5.0 if t < 0.05 else 6.0}, stop=1.0, step=0.01)
    assert run["y"][:5] == pytest.approx(5.0, abs=1e-12)
    assert run["y"][15] == pytest.approx(5 + 11 * 0.03, abs=1e-3)


def test_relay_switches_on_the_grid_and_remembers():
    given = (0.0, 0.99, 1.0, 0.0, -0.49, -0.5, 0.0, 5.0)
    x, seen = signals(["active"], [0.0]), []
    block = Relay(on=1.0, off=-0.5, high=10.0, low=-2.0)
    for u in given:
        x = signals(["active"], [float(block.updates(0.0, x, signals(["u"], [u]))["active"])])
        seen.append(float(block.outputs(0.0, x, signals(["u"], [u]))["y"]))
    assert seen == [-2, -2, 10, 10, 10, -2, -2, 10]


def test_relay_holds_within_the_step():
    for u in NUMBERS:
        assert value(Relay(low=-2.0), {"active": 0.0}, u=u)["y"] == -2
        assert value(Relay(high=10.0), {"active": 1.0}, u=u)["y"] == 10


@pytest.mark.parametrize(
    ("cls", "low", "high"),
    [
        (Saturation, "low", "high"),
        (SoftSaturation, "low", "high"),
        (DeadZone, "low", "high"),
        (RateLimit, "falling", "rising"),
        (SoftRateLimit, "falling", "rising"),
    ],
)
def test_a_limit_that_is_given_alone_has_its_opposite(cls, low, high):
    one, other = cls(**{high: 5.0}), cls(**{low: -5})
    assert one == other == cls(**{low: -5.0, high: 5.0})
    assert one.replace(**{high: 7.0}) == cls(**{low: -5.0, high: 7.0})
    # A file means what it meant before: the default.
    text = f'format = 1\nwires = []\n[blocks]\nb = {{ type = "{cls.__name__}", {high} = 5.0 }}\n[inputs]\nu = "b.u"\n'
    old = tsm.loads(text)
    assert getattr(old.blocks["b"], low) == getattr(cls(), low)
    assert tsm.loads(tsm.dumps(old)) == old
    new = old.replace("b", one)
    assert tsm.loads(tsm.dumps(new)) == new != old


def test_a_limit_that_never_acts_has_its_opposite():
    assert Saturation(high=np.inf) == Saturation(low=-np.inf) == Saturation(low=-np.inf, high=np.inf)


def test_refuses_what_does_not_go_together():
    refuses("Saturation needs low < high, got low=1, high=1.", Saturation, low=1, high=1)
    refuses("SoftSaturation needs low < high, got low=1, high=1.", SoftSaturation, low=1, high=1)
    refuses(
        "SoftSaturation.softness must lie in (0, inf), got 0. It is: distance s from a limit where it begins.",
        SoftSaturation,
        softness=0,
    )
    refuses("DeadZone needs low <= high, got low=0.2, high=-0.2.", DeadZone, low=0.2)
    refuses("Relay needs off <= on, got off=1, on=0.01.", Relay, off=1)
    refuses("RateLimit.falling must lie in (-inf, 0), got 3. It is: fastest fall, negative.", RateLimit, falling=3)
    refuses(
        "Quantiser.interval must lie in (0, inf), got 0. It is: distance between two values.", Quantiser, interval=0
    )
