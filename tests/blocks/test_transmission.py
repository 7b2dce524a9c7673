"""Blocks on a wire that add one effect: closed forms, equal blocks, refusals, and nothing added at strength zero."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.blocks.helpers import assert_sound, refuses, simulate, value
from tsmblocks.blocks import (
    AsymmetricBoucWen,
    AsymmetricGain,
    Bend,
    Bow,
    BroadCreep,
    Creep,
    DahlHysteresis,
    DeadTime,
    Disturbance,
    Drift,
    GainChange,
    GainDrift,
    HeatedGain,
    Jump,
    Lag,
    LoopAsymmetry,
    LoopChange,
    NonlocalMemory,
    ParallelResonance,
    PositionDependentLoop,
    PrandtlIshlinskii,
    RateDependence,
    Resonance,
    Ripple,
    SettlingGain,
    SettlingOffset,
    Slack,
    Stretch,
    StribeckStretch,
    TemporaryGain,
    TemporaryOffset,
)

# Each with its strength at zero, and the rest away from its defaults.
NULL = {
    "Slack": Slack(edge=0.3),
    "Slack high": Slack(edge=0.3, side="high"),
    "AsymmetricGain": AsymmetricGain(),
    "Bend": Bend(centre=0.4),
    "Bow": Bow(width=0.2, centre=0.4),
    "Ripple": Ripple(cycles=7.0),
    "Drift": Drift(),
    "Jump": Jump(time=0.7, width=0.05),
    "GainChange": GainChange(time=0.7, width=0.05),
    "GainDrift": GainDrift(),
    "SettlingOffset": SettlingOffset(time_constant=0.4),
    "SettlingGain": SettlingGain(time_constant=0.4),
    "HeatedGain": HeatedGain(time_constant=0.4),
    "TemporaryOffset": TemporaryOffset(time=0.4, until=0.9, width=0.05),
    "TemporaryGain": TemporaryGain(time=0.4, until=0.9, width=0.05),
    "LoopChange": LoopChange(distance=0.2, time=0.7),
    "Disturbance": Disturbance(frequency=3.3),
    "Creep": Creep(time_constant=0.3),
    "BroadCreep": BroadCreep(fastest=0.2, slowest=3.0),
    "RateDependence": RateDependence(exponent=0.7, smoothing=0.02),
    "NonlocalMemory": NonlocalMemory(),
    "LoopAsymmetry": LoopAsymmetry(theta=4.0, speed=0.5),
    "PositionDependentLoop": PositionDependentLoop(distance=0.2),
    "Stretch": Stretch(distance=0.2),
    "StribeckStretch": StribeckStretch(speed=0.5, distance=0.2),
    "Resonance": Resonance(omega=25.0, zeta=0.1),
    "Resonance fed through": Resonance(omega=25.0, zeta=0.1, feed=0.6),
    "ParallelResonance": ParallelResonance(omega=25.0, zeta=0.1),
    "Lag": Lag(),
    "DeadTime": DeadTime(),
    "DeadTime value": DeadTime(start="value", initial=5.0),
}
# With an effect, and the parameters whose derivatives are looked at.
ACTIVE = {
    "Slack": (Slack(share=0.4, edge=0.1), ("share", "edge")),
    "AsymmetricGain": (AsymmetricGain(difference=-0.3), ("difference",)),
    "Bend": (
        Bend(quadratic=0.1, cubic=-0.05, quartic=0.02, quintic=-0.03, centre=0.2),
        ("quadratic", "cubic", "quartic", "quintic", "centre"),
    ),
    "Bow": (Bow(size=0.1, width=0.3, centre=0.2), ("size", "width", "centre")),
    "Ripple": (Ripple(cosine=0.02, sine=0.03, cycles=5.0), ("cosine", "sine", "cycles")),
    "Drift": (Drift(rate=0.02), ("rate",)),
    "Jump": (Jump(size=0.2, time=0.7, width=0.1), ("size", "time", "width")),
    "GainChange": (GainChange(change=0.2, time=0.7, width=0.1), ("change", "time", "width")),
    "GainDrift": (GainDrift(rate=0.02), ("rate",)),
    "SettlingOffset": (SettlingOffset(size=0.2, time_constant=0.4), ("size", "time_constant")),
    "SettlingGain": (SettlingGain(change=0.2, time_constant=0.4), ("change", "time_constant")),
    "HeatedGain": (HeatedGain(change=0.2, scale=0.5, time_constant=0.4), ("change", "scale", "time_constant")),
    "TemporaryOffset": (TemporaryOffset(size=0.2, time=0.4, until=0.9, width=0.1), ("size", "time", "until", "width")),
    "TemporaryGain": (TemporaryGain(change=0.2, time=0.4, until=0.9, width=0.1), ("change", "time", "until", "width")),
    "LoopChange": (
        LoopChange(change=-0.1, gain=0.2, time=0.7, width=0.1),
        ("change", "gain", "distance", "time", "width"),
    ),
    "Disturbance": (Disturbance(cosine=0.02, sine=0.03, frequency=3.3), ("cosine", "sine", "frequency")),
    "Creep": (Creep(share=0.2, time_constant=0.3), ("share", "time_constant", "late")),
    "BroadCreep": (BroadCreep(share=0.2, fastest=0.1, slowest=2.0), ("share", "fastest", "slowest", "late2")),
    "RateDependence": (
        RateDependence(coefficient=-0.05, exponent=0.7, smoothing=0.3),
        ("coefficient", "exponent", "smoothing"),
    ),
    "NonlocalMemory": (NonlocalMemory(weights=(0.1, 0.2, 0.1)), ("weights[1]", "radii[2]")),
    "LoopAsymmetry": (LoopAsymmetry(slope_difference=-0.1, delta=0.1), ("slope_difference", "delta", "theta", "speed")),
    "PositionDependentLoop": (PositionDependentLoop(gain=-0.1), ("gain", "distance")),
    "Stretch": (Stretch(half_width=0.06), ("half_width", "distance")),
    "StribeckStretch": (
        StribeckStretch(half_width=0.06, breakaway=0.05, speed=0.8, distance=0.2),
        ("half_width", "breakaway", "speed", "distance"),
    ),
    "Resonance": (Resonance(share=0.5, omega=25.0, feed=0.4), ("share", "omega", "zeta", "feed")),
    "ParallelResonance": (
        ParallelResonance(gain=0.3, rate_gain=0.2, omega=25.0),
        ("gain", "rate_gain", "omega", "zeta"),
    ),
}
BACKENDS = ("llvm", "casadi")
T = np.arange(0.0, 2.0, 0.01)
SOURCE = {"u": lambda t: 0.8 * np.sin(2 * t) + 0.1, "v": lambda t: 1.6 * np.cos(2 * t)}
NUMBERS = np.concatenate([np.linspace(-3, 3, 121), [-1e6, 1e6]])


def places(block, plant=None):
    """The plant alone, and with the block before and behind it, where the block fits."""
    plant = plant or AsymmetricBoucWen()
    alone = tsm.Diagram(title="base", blocks=dict(tsm=plant), inputs={"x_in": "tsm.x"}, outputs={"x_out": "tsm"})
    both = dict(tsm=plant, effect=block)
    if "x" in block.inports:
        read, wires = {"x_in": ["tsm.x", "effect.x"]}, ["tsm -> effect.u"]
    else:
        read, wires = {"x_in": "tsm.x"}, ["tsm -> effect"]
    behind = tsm.Diagram(title="behind", blocks=both, inputs=read, wires=wires, outputs={"x_out": "effect"})
    if "x" in block.inports:
        return alone, [behind]
    before = tsm.Diagram(
        title="before", blocks=both, inputs={"x_in": "effect.u"}, wires=["effect -> tsm.x"], outputs={"x_out": "tsm"}
    )
    return alone, [before, behind]


def out(diagram, x, /, **more):
    return tsm.simulate(diagram, inputs={"x_in": (T, x)}, stop=T[-1], step=0.01, hold="cubic", **more)


def signal(parts):
    return sum(a * np.sin(f * T + phase) for a, f, phase in parts)


PARTS = st.lists(st.tuples(st.floats(-2, 2), st.floats(0, 8), st.floats(-3, 3)), min_size=1, max_size=3)


# ---- nothing at strength zero


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NULL)
@settings(max_examples=8, deadline=None)
@given(parts=PARTS)
def test_at_strength_zero_the_diagram_is_as_before_to_the_bit(name, backend, parts):
    """Also where a plant behind reads the rate of the signal, and the whole has more states."""
    base, edited = places(NULL[name])
    x = signal(parts)
    plain = out(base, x, backend=backend)
    for diagram in edited:
        run = out(diagram, x, backend=backend)
        assert np.array_equal(run["x_out"], plain["x_out"])
        assert np.array_equal(run["tsm.zeta"], plain["tsm.zeta"])


@pytest.mark.parametrize("name", [k for k, block in NULL.items() if not block.past_ports])
@given(u=st.floats(-1e50, 1e50), rest=st.floats(-1e3, 1e3), states=st.floats(-1e3, 1e3))
def test_at_strength_zero_the_output_is_the_input(name, u, rest, states):
    block = NULL[name]
    memory = dict.fromkeys(block.states, 0.0 if name in ("Lag", "LoopAsymmetry") else states)
    assert value(block, memory, **{k: u if k == "u" else rest for k in block.inports})["y"] == u


def test_all_of_them_in_one_chain_change_nothing():
    several = {f"e{k}": block for k, block in enumerate(NULL.values()) if "x" not in block.inports}
    several = {k: v for k, v in several.items() if not v.inports.get("v")}  # each rate of a rate needs a smoother input
    base, _ = places(Drift())
    chain = tsm.Diagram(
        title="chain",
        blocks={**several, "tsm": AsymmetricBoucWen()},
        inputs={"x_in": "e0.u"},
        wires=[" -> ".join(several) + " -> tsm.x"],
        outputs={"x_out": "tsm"},
    )
    x = signal([(0.8, 2.0, 0.3), (0.3, 7.0, 1.0)])
    for backend in BACKENDS:
        assert np.array_equal(out(chain, x, backend=backend)["x_out"], out(base, x, backend=backend)["x_out"])


def test_a_loop_of_no_strength_is_a_straight_line():
    block = DahlHysteresis(alpha_x=0.9, rho=0.0)
    base, _ = places(Drift(), block)
    x = signal([(0.8, 2.0, 0.3)])
    assert np.array_equal(out(base, x)["x_out"], 0.9 * x)


# ---- derivatives


@pytest.mark.parametrize("name", ACTIVE)
def test_derivatives_by_parameters_against_differences(name):
    block, parameters = ACTIVE[name]
    x = signal([(0.8, 2.0, 0.3), (0.3, 7.0, 1.0)])
    for diagram in places(block)[1]:
        wanted = [f"effect.{k}" for k in parameters]
        exact = tsm.sensitivities(
            diagram, wanted, outputs=["x_out"], inputs={"x_in": (T, x)}, stop=T[-1], step=0.01, hold="cubic"
        ).jacobian[:, 0]
        at = diagram.parameters
        for k, parameter in enumerate(wanted):
            high, low = (out(diagram, x, parameters={parameter: at[parameter] + e})["x_out"] for e in (1e-6, -1e-6))
            assert np.abs(exact[:, k]).max() > 1e-4
            assert exact[:, k] == pytest.approx((high - low) / 2e-6, abs=2e-5 * (1 + np.abs(exact[:, k]).max()))


@pytest.mark.parametrize("name", [k for k, block in NULL.items() if not isinstance(block, (Lag, DeadTime))])
def test_derivatives_by_the_strengths_at_zero(name):
    """What a search for missing effects looks at first."""
    block = NULL[name]
    strengths = {"Slack": ["share"], "AsymmetricGain": ["difference"],
                 "Bend": ["quadratic", "cubic", "quartic", "quintic"], "Bow": ["size"],
                 "Ripple": ["cosine", "sine"], "Drift": ["rate"],
                 "Jump": ["size"], "GainChange": ["change"], "GainDrift": ["rate"],
                 "SettlingOffset": ["size"], "SettlingGain": ["change"], "HeatedGain": ["change"],
                 "TemporaryOffset": ["size"], "TemporaryGain": ["change"], "LoopChange": ["change", "gain"],
                 "Creep": ["share"], "BroadCreep": ["share"], "Disturbance": ["cosine", "sine"],
                 "RateDependence": ["coefficient"],
                 "Resonance": ["share"], "ParallelResonance": ["gain", "rate_gain"],
                 "NonlocalMemory": ["weights[0]"], "LoopAsymmetry": ["slope_difference", "delta"],
                 "PositionDependentLoop": ["gain"], "Stretch": ["half_width"],
                 "StribeckStretch": ["half_width", "breakaway"]}  # fmt: skip
    x = signal([(0.8, 2.0, 0.3), (0.3, 7.0, 1.0)])
    base, (*_, behind) = places(block)
    wanted = [f"effect.{k}" for k in strengths[type(block).__name__]]
    exact = tsm.sensitivities(
        behind, wanted, outputs=["x_out"], inputs={"x_in": (T, x)}, stop=T[-1], step=0.01, hold="cubic"
    ).jacobian[:, 0]
    for k, parameter in enumerate(wanted):
        # The output is linear in a strength behind the plant, so that a long step does.
        added = out(behind, x, parameters={parameter: 0.25})["x_out"] - out(base, x)["x_out"]
        assert np.abs(exact[:, k]).max() > 1e-3
        assert exact[:, k] == pytest.approx(added / 0.25, abs=1e-12)


# ---- closed forms


@pytest.mark.parametrize("block", [*NULL.values(), *(block for block, _ in ACTIVE.values())], ids=lambda b: str(b)[:40])
def test_sound(block):
    if not block.past_ports:
        assert_sound(block)


def test_a_gain_for_each_sign():
    block = AsymmetricGain(difference=0.2)
    assert [value(block, u=u)["y"] for u in (-2.0, 0.0, 3.0)] == pytest.approx([-1.8, 0.0, 3.3], abs=1e-15)


@pytest.mark.parametrize(("side", "inside"), [("low", 1.0), ("high", -1.0)])
def test_slack(side, inside):
    for u in NUMBERS:
        beyond = inside * (u - 0.4) < 0
        expected = 0.4 + 0.3 * (u - 0.4) if beyond else u
        assert value(Slack(share=0.7, edge=0.4, side=side), u=u)["y"] == pytest.approx(expected, rel=1e-14)


def test_bend():
    p = np.polynomial.Polynomial([0, 1]) + 0.2 * np.polynomial.Polynomial([-0.5, 1]) ** 2
    p = p - 0.1 * np.polynomial.Polynomial([-0.5, 1]) ** 3
    for u in NUMBERS[:-2]:
        assert value(Bend(quadratic=0.2, cubic=-0.1, centre=0.5), u=u)["y"] == pytest.approx(p(u), abs=1e-13)


def test_bend_to_the_fifth_power():
    e = np.polynomial.Polynomial([-0.5, 1])
    p = np.polynomial.Polynomial([0, 1]) + 0.2 * e**2 - 0.1 * e**3 + 0.03 * e**4 - 0.02 * e**5
    block = Bend(quadratic=0.2, cubic=-0.1, quartic=0.03, quintic=-0.02, centre=0.5)
    for u in NUMBERS[:-2]:
        assert value(block, u=u)["y"] == pytest.approx(p(u), abs=1e-12)


def test_bow():
    """Steeper about the centre by size over width, and shifted by the size far from it."""
    block = Bow(size=0.3, width=0.2, centre=0.5)
    for u in NUMBERS:
        rise = np.exp(2 * min((u - 0.5) / 0.2, 300))
        assert value(block, u=u)["y"] == pytest.approx(u + 0.3 * (rise - 1) / (rise + 1), abs=1e-12)
    assert value(block, u=0.5)["y"] == 0.5
    slope = (value(block, u=0.5 + 1e-6)["y"] - value(block, u=0.5 - 1e-6)["y"]) / 2e-6
    assert slope == pytest.approx(1 + 0.3 / 0.2, rel=1e-9)


def test_the_gain_that_changes_with_the_loop():
    """Without a loop of its own it is the change of a gain."""
    loop = simulate(LoopChange(gain=0.3, time=1.0, width=0.1), {**SOURCE}, stop=2.0, step=0.01)
    gain = simulate(GainChange(change=0.3, time=1.0, width=0.1), {"u": SOURCE["u"]}, stop=2.0, step=0.01)
    assert loop["y"] == pytest.approx(gain["y"], abs=1e-14)


def test_ripple():
    for u in NUMBERS[:-2]:
        expected = u + 0.5 * np.sin(3 * u + np.arctan2(0.3, 0.4))
        assert value(Ripple(cosine=0.3, sine=0.4, cycles=3.0), u=u)["y"] == pytest.approx(expected, abs=1e-14)


def _share(t, first, last):
    """One between two instants, one half at them."""
    return np.heaviside(np.round(t - first, 9), 0.5) - np.heaviside(np.round(t - last, 9), 0.5)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (Drift(rate=0.3), lambda t, u: u + 0.3 * t),
        (Drift(rate=0.3, curve=0.2, since=-1.5), lambda t, u: u + 0.3 * (t + 1.5) + 0.2 * (t + 1.5) ** 2),
        (Jump(size=0.3, time=1.0, width=0.1), lambda t, u: u + 0.3 / (1 + np.exp(-2 * (t - 1) / 0.1))),
        (GainChange(change=0.3, time=1.0, width=0.1), lambda t, u: u * (1 + 0.3 / (1 + np.exp(-2 * (t - 1) / 0.1)))),
        (GainDrift(rate=-0.07), lambda t, u: u - 0.07 * t * u),
        (GainDrift(rate=-0.07, since=0.5), lambda t, u: u - 0.07 * (t - 0.5) * u),
        (SettlingOffset(size=0.3, time_constant=0.5), lambda t, u: u + 0.3 * (1 - np.exp(-t / 0.5))),
        (
            SettlingGain(change=0.3, time_constant=0.5, since=0.6),
            lambda t, u: u * (1.3 - 0.3 * np.exp(-np.maximum(t - 0.6, 0) / 0.5)),
        ),
        (TemporaryOffset(size=0.3, time=0.5, until=1.5, width=1e-9), lambda t, u: u + 0.3 * _share(t, 0.5, 1.5)),
        (TemporaryGain(change=0.3, time=0.5, until=1.5, width=1e-9), lambda t, u: u * (1 + 0.3 * _share(t, 0.5, 1.5))),
        (TemporaryOffset(size=0.3, time=1.5, until=0.5, width=1e-9), lambda t, u: u - 0.3 * _share(t, 0.5, 1.5)),
        (Disturbance(cosine=0.3, frequency=2.0, since=0.3), lambda t, u: u + 0.3 * np.cos(4 * np.pi * (t - 0.3))),
        (
            Disturbance(cosine=0.3, sine=0.4, frequency=2.0),
            lambda t, u: u + 0.5 * np.sin(4 * np.pi * t + np.arctan2(0.3, 0.4)),
        ),
    ],
    ids=[
        "Drift",
        "Drift since",
        "Jump",
        "GainChange",
        "GainDrift",
        "GainDrift since",
        "SettlingOffset",
        "SettlingGain since",
        "TemporaryOffset",
        "TemporaryGain",
        "TemporaryOffset with its ends swapped",
        "Disturbance since",
        "Disturbance",
    ],
)
def test_what_comes_with_time(block, expected):
    run = simulate(block, {"u": SOURCE["u"]}, stop=2.0, step=0.01)
    assert run["y"] == pytest.approx(expected(run["t"], SOURCE["u"](run["t"])), abs=1e-13)


def test_creep_after_a_step():
    run = simulate(Creep(share=0.2, time_constant=0.5), {"u": lambda _: 3.0}, stop=2.0, step=0.01)
    assert run["y"] == pytest.approx(3 + 0.6 * (1 - np.exp(-run["t"] / 0.5)), abs=1e-9)


def test_broad_creep_after_a_step_grows_with_the_logarithm_of_time():
    block = BroadCreep(share=0.4, fastest=0.1, slowest=100.0)
    run = simulate(block, {"u": lambda _: 1.0}, stop=60.0, step=0.01)
    lags = [1 - np.exp(-run["t"] / time) for time in (0.1, 1.0, 10.0, 100.0)]
    assert run["y"] == pytest.approx(1 + 0.1 * np.sum(lags, axis=0), abs=1e-7)
    decades = np.interp([0.3, 3.0, 30.0], run["t"], run["y"])
    assert np.diff(decades) == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize(
    ("exponent", "reference"),
    [(1.0, lambda v: v), (2.0, lambda v: np.abs(v) * v), (0.5, lambda v: np.sign(v) * np.abs(v) ** 0.5)],
)
def test_rate_dependence(exponent, reference):
    block = RateDependence(coefficient=0.3, exponent=exponent, smoothing=1e-7)
    for v in NUMBERS:
        assert value(block, u=0.2, v=v)["y"] == pytest.approx(0.2 + 0.3 * reference(v), rel=1e-9, abs=1e-9)


def test_rate_dependence_forms_its_rate():
    d = tsm.Diagram(
        title="rate",
        blocks=dict(s=tsm.blocks.Sine(amplitude=1.0, frequency=0.5), e=RateDependence(coefficient=0.3)),
        wires=["s -> e"],
        outputs={"y": "e"},
    )
    run = tsm.simulate(d, stop=2.0, step=0.01)
    assert run["y"] == pytest.approx(np.sin(np.pi * run.t) + 0.3 * np.pi * np.cos(np.pi * run.t), abs=1e-12)


def test_the_loop_that_comes_turns_round_over_its_distance():
    """At constant speed the side of the loop tends to 1 exponentially with travel."""
    block = LoopChange(change=-0.2, distance=0.3, time=1.0, width=0.05)
    run = simulate(block, {"u": lambda t: 0.5 * t, "v": lambda _: 0.5}, stop=2.0, step=0.01)
    t = run["t"]
    come = 1 / (1 + np.exp(-2 * (t - 1) / 0.05))
    assert run["y"] == pytest.approx(0.5 * t - 0.2 * come * (1 - np.exp(-0.5 * t / 0.3)), abs=1e-9)


def test_the_loop_that_widens_to_one_side():
    """At constant speed the state follows the displacement, late by the distance."""
    block = PositionDependentLoop(gain=0.2, distance=0.3)
    run = simulate(block, {"u": lambda _: 1.0, "x": lambda t: 0.5 * t, "v": lambda _: 0.5}, stop=2.0, step=0.01)
    travel = 0.5 * run["t"]
    assert run["y"] == pytest.approx(1 + 0.2 * (travel - 0.3 * (1 - np.exp(-travel / 0.3))), abs=1e-7)


def test_a_stretch_is_dahls_hysteresis_of_slope_one_in_any_unit():
    v = {"v": lambda t: 2.0 * np.cos(4 * t)}
    lost = simulate(
        Stretch(half_width=0.15, distance=0.15 / 0.8), {"u": lambda t: 0.5 * np.sin(4 * t), **v}, stop=2.0, step=0.01
    )
    dahl = DahlHysteresis(alpha_x=1.0, rho=0.8, half_width=0.15)
    same = simulate(dahl, {"x": lambda t: 0.5 * np.sin(4 * t), **v}, stop=2.0, step=0.01)
    assert lost["y"] == pytest.approx(same["y"], abs=1e-12)


def test_the_width_of_a_stribeck_loop_falls_with_the_speed():
    """At a constant speed it is a stretch of one width: w + b exp(-(v / v_s)^2)."""
    for speed in (0.05, 0.4, 3.0):
        given = {"u": lambda t, speed=speed: speed * t, "v": lambda _, speed=speed: speed}
        block = StribeckStretch(half_width=0.1, breakaway=0.2, speed=0.4, distance=0.02)
        run = simulate(block, given, stop=4.0, step=0.001)
        width = 0.1 + 0.2 * np.exp(-((speed / 0.4) ** 2))
        side = 1 - np.exp(-speed * run["t"] / 0.02)
        assert run["y"] == pytest.approx(speed * run["t"] - width * side, abs=1e-6)


@given(v=st.lists(st.floats(-3, 3), min_size=5, max_size=40))
def test_the_side_of_a_loop_stays_within_one(v):
    def rate(t):
        return v[min(int(t / 0.01 + 1e-6), len(v) - 1)]

    run = simulate(LoopChange(change=1.0), {"u": lambda _: 0.0, "v": rate}, stop=0.01 * len(v), step=0.01)
    assert np.abs(run["x.z"]).max() <= 1.0


def test_the_asymmetric_terms_make_the_paper_model_of_a_symmetric_one():
    """The paper's state equation is linear in the state, so its two parts add up."""
    whole = AsymmetricBoucWen()
    mean = (whole.alpha1 + whole.alpha2) / 2
    symmetric = whole.replace(alpha1=mean, alpha2=mean, delta=0.0)
    block = LoopAsymmetry(slope_difference=whole.alpha1 - whole.alpha2, delta=whole.delta, theta=whole.theta, speed=1.0)
    x = signal([(0.8, 2.0, 0.3), (0.3, 7.0, 1.0)])
    built = out(places(block, symmetric)[1][0], x)["x_out"]
    assert built == pytest.approx(out(places(block, whole)[0], x)["x_out"], abs=1e-13)


def test_nonlocal_memory_is_a_sum_of_plays():
    weights, radii = (0.1, 0.25, 0.15), (0.05, 0.2, 0.5)
    ours = simulate(NonlocalMemory(weights=weights, radii=radii), {"u": SOURCE["u"]}, stop=4.0, step=0.01)
    block = PrandtlIshlinskii(weight0=1 - sum(weights), weights=weights, radii=radii)
    assert ours["y"] == pytest.approx(simulate(block, {"u": SOURCE["u"]}, stop=4.0, step=0.01)["y"], abs=1e-14)


def test_a_resonance_at_full_share_is_the_oscillator():
    block = Resonance(share=1.0, omega=9.0, zeta=0.3)
    run = simulate(block, {"u": lambda _: 1.0}, stop=2.0, step=0.005)
    damped, t = 9 * np.sqrt(1 - 0.09), run["t"]
    swing = np.cos(damped * t) + 0.3 / np.sqrt(1 - 0.09) * np.sin(damped * t)
    assert run["y"] == pytest.approx(1 - np.exp(-0.3 * 9 * t) * swing, abs=1e-7)


def test_a_mode_beside_a_model_adds_an_oscillator_and_its_rate():
    block = ParallelResonance(gain=0.4, rate_gain=0.3, omega=9.0, zeta=0.3)
    run = simulate(block, {"u": lambda t: 2 * t, "x": lambda _: 1.0}, stop=2.0, step=0.005)
    damped, t = 9 * np.sqrt(1 - 0.09), run["t"]
    decay = np.exp(-0.3 * 9 * t)
    swing = 1 - decay * (np.cos(damped * t) + 0.3 / np.sqrt(1 - 0.09) * np.sin(damped * t))
    rate = decay * np.sin(damped * t) * 81 / damped
    assert run["y"] == pytest.approx(2 * t + 0.4 * swing + 0.3 * rate / 9, abs=1e-7)


# ---- refusals


def test_refuses_bad_values():
    refuses(
        "Slack.share must lie in [0, 1], got 1.5. It is: share of the slope lost beyond the edge.", Slack, share=1.5
    )
    refuses(
        "Slack.side is 'left', which is not a choice. Known here: high, low. "
        "It is: on which side of the edge it is lost.",
        Slack,
        side="left",
    )
    refuses(
        "Ripple.cycles must lie in (0, inf), got 0. It is: phase n [rad] per unit of u; periods per turn of an angle.",
        Ripple,
        cycles=0,
    )
    refuses("NonlocalMemory needs as many weights as radii, got 2 and 3.", NonlocalMemory, weights=(0.1, 0.2))
    refuses(
        "RateDependence.exponent must lie in [0.2, 4], got 5. It is: power n of the rate.", RateDependence, exponent=5
    )
    refuses(
        "Resonance.share must lie in [0, 1], got -0.1. It is: share of the signal that resonates.",
        Resonance,
        share=-0.1,
    )
    refuses("Bow.width must lie in (0, inf), got 0. It is: distance d over which it builds up.", Bow, width=0)
    refuses("Jump.width must lie in (0, inf), got 0. It is: time over which the change is rounded [s].", Jump, width=0)
