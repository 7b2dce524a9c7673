"""Hysteresis blocks against their printed equations, closed forms and the paper's loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tests.blocks.helpers import Bench, assert_sound, flat, rates, refuses, simulate, value
from tsmblocks.blocks.hysteresis import (
    AsymmetricBoucWen,
    BoucWen,
    DahlHysteresis,
    ElasticBacklash,
    GeneralizedBoucWen,
    Play,
    PrandtlIshlinskii,
    TaoBacklash,
    slope,
)
from tsmblocks.blocks.tendon import CapstanFriction

W = 2 * np.pi * 0.2
AMPLITUDE = np.deg2rad(55.0)
SINE = {"x": lambda t: AMPLITUDE * np.sin(W * t), "v": lambda t: AMPLITUDE * W * np.cos(W * t)}
ALL = [
    AsymmetricBoucWen,
    BoucWen,
    CapstanFriction,
    DahlHysteresis,
    ElasticBacklash,
    GeneralizedBoucWen,
    Play,
    PrandtlIshlinskii,
    TaoBacklash,
]


@pytest.mark.parametrize("cls", ALL)
def test_sound(cls):
    assert_sound(cls())


def test_bouc_wen_with_the_smallest_exponent_has_finite_slopes():
    assert_sound(BoucWen(n=1.0))
    assert_sound(GeneralizedBoucWen(n=1.0))


@pytest.mark.parametrize(
    ("block", "degrees"),
    [(AsymmetricBoucWen(), 28.67), (GeneralizedBoucWen(), 27.01), (BoucWen(), 26.47), (BoucWen(gamma=2.272), 64.97)],
    ids=["asymmetric", "generalized", "symmetric", "symmetric, gamma as printed"],
)
def test_loss_at_the_papers_sine(block, degrees):
    run = simulate(block, SINE, stop=20.0, step=1e-3)
    last = run["t"] > 15.0
    loss = np.rad2deg(SINE["x"](run["t"]) - run["y"])[last]
    assert np.ptp(loss) == pytest.approx(degrees, abs=0.01)


def test_slope_is_equation_9_as_printed():
    plant = AsymmetricBoucWen()
    for v in np.linspace(-5, 5, 41):
        e2v = np.exp(2 * v)
        printed = (plant.alpha1 * e2v + plant.alpha2) / (e2v + 1)
        assert abs(printed - float(slope(v, plant.alpha1, plant.alpha2))) < 1e-15
        assert abs(printed * 0.7 + 0.1 - value(plant, {"zeta": 0.1}, x=0.7, v=v)["y"]) < 1e-15


def test_slope_does_not_overflow():
    assert float(slope(1e6, 0.8, 0.9)) == pytest.approx(0.8, rel=1e-15)
    assert float(slope(-1e6, 0.8, 0.9)) == pytest.approx(0.9, rel=1e-15)


def test_state_rate_is_equation_8_as_printed():
    p = AsymmetricBoucWen()
    for zeta, v in np.random.default_rng(1).normal(size=(50, 2)):
        printed = p.A * v - p.theta * abs(v) * zeta + p.delta * abs(v)
        assert abs(printed - rates(p, {"zeta": zeta}, x=0.0, v=v)["zeta"]) < 1e-14


def test_generalized_bouc_wen_is_equation_6_written_out():
    p = GeneralizedBoucWen()
    sgn = np.sign
    for zeta, x, v in np.random.default_rng(2).normal(size=(100, 3)):
        theta = (sgn(v * zeta), sgn(v * x), sgn(x * zeta), sgn(v), sgn(zeta), sgn(x))
        xi = np.dot((p.beta1, p.beta2, p.beta3, p.beta4, p.beta5, p.beta6), theta)
        psi = v * abs(zeta) ** p.n * xi
        assert rates(p, {"zeta": zeta}, x=x, v=v)["zeta"] == pytest.approx(p.A * v - psi, rel=1e-12)
        assert value(p, {"zeta": zeta}, x=x, v=v)["y"] == pytest.approx(p.alpha_x * x + p.alpha_zeta * zeta)


def test_symmetric_bouc_wen_is_equation_3_written_out():
    p = BoucWen(n=1.7)
    for zeta, v in np.random.default_rng(3).normal(size=(100, 2)):
        size = abs(zeta)
        printed = p.A * v - p.beta * abs(v) * size ** (p.n - 1) * zeta - p.gamma * v * size**p.n
        assert rates(p, {"zeta": zeta}, x=0.0, v=v)["zeta"] == pytest.approx(printed, rel=1e-12)


def test_generalized_bouc_wen_contains_the_symmetric_one_without_gamma():
    p = BoucWen(n=1.5, gamma=0.0)
    q = GeneralizedBoucWen(A=p.A, n=1.5, beta1=p.beta, beta2=0.0, beta3=0.0, beta4=0.0, beta5=0.0, beta6=0.0)
    for zeta, x, v in np.random.default_rng(4).normal(size=(20, 3)):
        symmetric = rates(p, {"zeta": zeta}, x=x, v=v)["zeta"]
        assert rates(q, {"zeta": zeta}, x=x, v=v)["zeta"] == pytest.approx(symmetric, rel=1e-12)


def test_dahl_is_the_papers_model_without_asymmetry():
    A, theta = -0.8745, 5.034
    paper = AsymmetricBoucWen(alpha1=0.92, alpha2=0.92, A=A, theta=theta, delta=0.0)
    dahl = DahlHysteresis(alpha_x=0.92, rho=-A, half_width=-A / theta)
    a, b = (simulate(p, SINE, stop=6.0, step=2e-3)["y"] for p in (paper, dahl))
    assert np.abs(a - b).max() < 1e-13


def test_dahl_tends_to_its_half_width():
    p = DahlHysteresis(alpha_x=0.9, rho=0.8, half_width=0.15)
    run = simulate(p, {"x": lambda t: 1.5 * t, "v": lambda t: 1.5}, stop=2.0, step=1e-3)
    travel = 1.5 * run["t"]
    assert run["x.zeta"] == pytest.approx(0.15 * (1 - np.exp(-0.8 * travel / 0.15)), abs=1e-9)
    assert run["y"][-1] == pytest.approx(0.9 * travel[-1] - 0.15, abs=1e-7)


def soft(**values):
    """Elastic backlash with flat tops and a width that does not change, unless told otherwise."""
    return ElasticBacklash(**{"rho": 1.0, "growth_up": 0.0, "growth_down": 0.0, **values})


def strokes(block, turns, pieces=400, rate=1.0):
    """Input and output along straight strokes from 0 to each of the turns, each in so many steps of RK4."""
    begins = [0.0, *turns[:-1]]
    x = np.concatenate([[0.0], *(np.linspace(a, b, pieces + 1)[1:] for a, b in zip(begins, turns, strict=True))])
    bench = Bench(block)
    numbers, zeta, y = np.array(bench.p0), bench.x0, []

    def stretch_rate(zeta, x, v):
        return flat(bench.rate(0.0, zeta, [x, v], numbers))

    for a, b in zip(x, [*x[1:], x[-1]], strict=True):
        y.append(flat(bench.y(0.0, zeta, [a, 0.0], numbers))[0])
        h = abs(b - a) / rate
        v, middle = rate * np.sign(b - a), (a + b) / 2
        k1 = stretch_rate(zeta, a, v)
        k2 = stretch_rate(zeta + h / 2 * k1, middle, v)
        k3 = stretch_rate(zeta + h / 2 * k2, middle, v)
        zeta = zeta + h / 6 * (k1 + 2 * k2 + 2 * k3 + stretch_rate(zeta + h * k3, b, v))
    return x, np.array(y)


def test_elastic_backlash_is_its_equation_written_out():
    p = ElasticBacklash(roundness=0.3, growth_up=0.4, growth_down=-0.3)
    for share, x, v in np.random.default_rng(6).uniform(-1, 1, size=(100, 3)):
        zeta = 0.8 * share * p.half_width
        y = p.alpha_x * (x - zeta)
        width = p.half_width * (1 + (0.4 * y if y > 0 else 0.3 * y))
        followed = ((1 + np.sign(v) * zeta / width) / 2) ** (1 / 0.3)
        assert rates(p, {"zeta": zeta}, x=x, v=v)["zeta"] == pytest.approx(p.rho * v * (1 - followed), rel=1e-12)
        assert value(p, {"zeta": zeta}, x=x, v=v)["y"] == pytest.approx(y, rel=1e-12)


def test_elastic_backlash_with_full_roundness_is_dahls_law():
    elastic = soft(alpha_x=0.9, rho=1.4, half_width=0.2, roundness=1.0)
    dahl = DahlHysteresis(alpha_x=0.9, rho=0.7, half_width=0.2)
    a, b = (simulate(p, SINE, stop=6.0, step=2e-3)["x.zeta"] for p in (elastic, dahl))
    assert np.abs(a - b).max() < 1e-13


def test_elastic_backlash_with_half_roundness_takes_up_its_slack_as_tanh():
    p = soft(alpha_x=1.0, rho=1.2, half_width=0.25, roundness=0.5)
    x, y = strokes(p, [1.0])
    share = np.tanh(1.2 * x / 0.5 + np.arctanh(0.5))  # (1 + zeta/w) / 2, whose rate is rho / (2 w) (1 - share^2)
    assert np.abs(y - (x - 0.25 * (2 * share - 1))).max() < 1e-9


@pytest.mark.parametrize("rho", [0.7, 1.0, 1.3])
def test_elastic_backlash_just_after_a_reversal(rho):
    """rho = 1 rests there, less follows, more swings back."""
    x, y = strokes(soft(alpha_x=0.9, rho=rho, half_width=0.1, roundness=0.25), [1.0, 0.9], pieces=2000)
    first = slice(2000, 2005)
    assert np.polyfit(x[first], y[first], 1)[0] == pytest.approx(0.9 * (1 - rho), abs=1e-3)


def test_elastic_backlash_tends_to_play():
    """The largest difference is at the corners and shrinks with the roundness."""
    turns, play = [1.0, -1.0, 0.8, -0.2, 0.5, -1.0], Play(half_width=0.25, gain=0.9)
    grid = strokes(soft(), turns)[0]
    expected = simulate(play, {"u": lambda t: grid[min(round(t), len(grid) - 1)]}, len(grid) - 1, 1.0)["y"]
    off = [
        np.abs(strokes(soft(alpha_x=0.9, half_width=0.25, roundness=r), turns)[1] - expected).max()
        for r in (0.16, 0.08, 0.04, 0.02)
    ]
    assert off[-1] < 0.01
    assert all(0.4 < b / a < 0.7 for a, b in pairwise(off))


def test_elastic_backlash_with_opposite_growths_tends_to_taos():
    alpha, width, growth = 0.9, 0.3, 0.4
    turns = [1.0, -1.0, 1.0]
    elastic = soft(alpha_x=alpha, half_width=width, roundness=0.01, growth_up=growth, growth_down=-growth)
    x, y = strokes(elastic, turns, pieces=2000)
    c1, c2 = alpha / (1 + alpha * width * growth), alpha / (1 - alpha * width * growth)
    tao = TaoBacklash(c1=c1, c2=c2, B1=width, B2=width)
    expected = simulate(tao, {"u": lambda t: x[min(round(t), len(x) - 1)]}, len(x) - 1, 1.0)["y"]
    assert np.abs(y - expected).max() < 0.01
    for stroke in (slice(1900, 2001), slice(3900, 4001)):
        assert np.polyfit(x[stroke], y[stroke], 1)[0] == pytest.approx((c1, c2)[stroke.start > 2000], abs=1e-3)


def test_elastic_backlash_loop_closes_once_the_past_is_forgotten():
    y = strokes(ElasticBacklash(), [1.0, -1.0] * 4, pieces=400)[1]
    rounds = [y[400 + 800 * k : 1200 + 800 * k] for k in range(3)]
    gaps = [np.abs(a - b).max() for a, b in pairwise(rounds)]
    assert gaps[0] < 1e-3
    assert gaps[1] < 1e-6
    assert np.ptp(rounds[0]) > 1.0


@pytest.mark.parametrize(
    ("roundness", "mean_gap"),  # the integral of (1 - s) / (1 - s^(1/r)) over s from 0 to 1
    [(1.0, 1.0), (0.5, np.log(2)), (0.25, np.log(2) / 4 + np.pi / 8)],
)
@pytest.mark.parametrize("rho", [0.8, 1.3])
def test_elastic_backlash_loop_area(roundness, mean_gap, rho):
    """A stroke of 2 X follows the contact line but for its corner: play has mean_gap 1/2 and 4 k w (X - w)."""
    k, w, X = 0.9, 0.05, 1.0
    x, y = strokes(soft(alpha_x=k, rho=rho, half_width=w, roundness=roundness), [X, -X, X], pieces=2000)
    area = np.trapezoid(y[2000:], x[2000:])
    assert area == pytest.approx(
        -2 * k * (2 * w * X - 4 * w**2 / rho * mean_gap), rel=1e-4
    )  # the trapezoids, where the corner is sharp


@given(
    turns=st.lists(st.floats(-1, 1), min_size=1, max_size=4),
    rate=st.floats(1e-3, 1e3),
    roundness=st.floats(0.05, 1.0),
    rho=st.floats(0.5, 1.5),
)
@settings(max_examples=25, deadline=None)
def test_elastic_backlash_does_not_depend_on_the_rate(turns, rate, roundness, rho):
    p = ElasticBacklash(roundness=roundness, rho=rho)
    slow, fast = (strokes(p, turns, pieces=60, rate=r)[1] for r in (1.0, rate))
    assert np.abs(slow - fast).max() < 1e-10


@given(turns=st.lists(st.floats(-1, 1), min_size=1, max_size=4), up=st.floats(-0.5, 1), down=st.floats(-0.5, 1))
@settings(max_examples=25, deadline=None)
def test_elastic_backlash_turned_over_swaps_its_sides(turns, up, down):
    plus = strokes(ElasticBacklash(growth_up=up, growth_down=down), turns, pieces=60)[1]
    minus = strokes(ElasticBacklash(growth_up=down, growth_down=up), [-t for t in turns], pieces=60)[1]
    assert np.abs(plus + minus).max() < 1e-12


@given(turns=st.lists(st.floats(-1, 1), min_size=1, max_size=5), roundness=st.floats(0.1, 1.0))
@settings(max_examples=25, deadline=None)
def test_elastic_backlash_keeps_its_stretch_within_the_width(turns, roundness):
    x, y = strokes(soft(alpha_x=0.9, half_width=0.2, roundness=roundness), turns, pieces=100)
    assert np.abs(x - y / 0.9).max() <= 0.2 + 1e-9


def test_elastic_backlash_far_outside_its_width_comes_back_without_a_jump():
    p = soft(half_width=0.2, roundness=0.1)
    inside, edge, beyond = (rates(p, {"zeta": z}, x=0.0, v=1.0)["zeta"] for z in (0.2 - 1e-7, 0.2, 0.2 + 1e-7))
    assert edge == 0.0
    assert (beyond - edge) / 1e-7 == pytest.approx((edge - inside) / 1e-7, rel=1e-4)
    assert rates(p, {"zeta": 0.4}, x=0.0, v=1.0)["zeta"] == pytest.approx(-5.0)
    assert rates(p, {"zeta": -0.4}, x=0.0, v=1.0)["zeta"] == pytest.approx(1.0)


def test_elastic_backlash_width_never_falls_below_a_tenth():
    p = soft(half_width=0.2, growth_up=-5.0, roundness=1.0, alpha_x=1.0)
    assert rates(p, {"zeta": 0.0}, x=1.0, v=1.0)["zeta"] == pytest.approx(0.5)
    assert rates(p, {"zeta": 0.02}, x=1.02, v=1.0)["zeta"] == pytest.approx(0.0, abs=1e-12)


def test_elastic_backlash_is_near_the_papers_generalised_loop():
    """The defaults were fitted to it: 0.44 degrees rms on its three signals."""
    a, b = (simulate(p, SINE, stop=10.0, step=1e-3)["y"] for p in (ElasticBacklash(), GeneralizedBoucWen()))
    difference = np.rad2deg(a - b)
    assert np.std(difference) < 0.45
    assert abs(difference.mean()) < 0.7


def triangle(t):
    """Triangle of amplitude 1 and period 4, starting upwards from 0."""
    return 1 - abs((t - 1) % 4 - 2)


def test_tao_backlash_follows_both_lines_and_rests_between():
    p = TaoBacklash(c1=0.8, c2=0.9, B1=0.1, B2=0.3)
    run = simulate(p, {"u": triangle}, stop=8.0, step=1e-2)
    u, y = np.array([triangle(t) for t in run["t"]]), run["y"]
    top, bottom = 0.8 * (1 - 0.1), 0.9 * (-1 + 0.3)
    late = run["t"] >= 4 - 1e-9
    rising, falling = np.gradient(u) > 0, np.gradient(u) < 0
    expected = np.where(rising, np.maximum(0.8 * (u - 0.1), bottom), np.minimum(0.9 * (u + 0.3), top))
    inside = late & (rising | falling) & (np.abs(u) < 0.99)
    assert np.abs(y - expected)[inside].max() < 1e-14


def test_tao_backlash_obeys_equation_1_step_by_step():
    p = TaoBacklash()
    u = np.cumsum(np.random.default_rng(5).normal(scale=0.05, size=400))
    run = simulate(p, {"u": lambda t: u[min(round(t), 399)]}, stop=399.0, step=1.0)
    y = run["y"]
    for k in range(1, 400):
        if abs(y[k] - y[k - 1]) < 1e-15:
            continue
        line = p.c1 * (u[k] - p.B1) if u[k] > u[k - 1] else p.c2 * (u[k] + p.B2)
        assert y[k] == pytest.approx(line, abs=1e-14)


def test_play_loop_is_exact():
    p = Play(half_width=0.25, gain=2.0)
    run = simulate(p, {"u": triangle}, stop=12.0, step=1e-2)
    u = np.array([triangle(t) for t in run["t"]])
    m = np.empty_like(u)
    before = 0.0
    for k, uk in enumerate(u):
        before = m[k] = max(uk - 0.25, min(uk + 0.25, before))
    assert np.array_equal(run["y"], 2.0 * m)
    late = run["t"] > 4
    assert np.ptp(run["y"][late]) == pytest.approx(2 * (2 - 0.5), abs=1e-14)
    loss = np.ptp((u - run["y"] / 2)[late])
    assert loss == pytest.approx(0.5, abs=1e-14)


def test_play_between_grid_points_uses_the_present_input():
    assert value(Play(half_width=0.1), {"m": 0.0}, u=0.05)["y"] == 0.0
    assert value(Play(half_width=0.1), {"m": 0.0}, u=0.3)["y"] == pytest.approx(0.2)
    assert value(Play(half_width=0.1), {"m": 0.0}, u=-0.3)["y"] == pytest.approx(-0.2)


def test_tao_backlash_with_equal_sides_is_play():
    inputs = {"u": lambda t: np.sin(t) + 0.4 * np.sin(2.7 * t)}
    tao = simulate(TaoBacklash(c1=0.9, c2=0.9, B1=0.2, B2=0.2), inputs, stop=20.0, step=1e-2)
    play = simulate(Play(half_width=0.2, gain=0.9), inputs, stop=20.0, step=1e-2)
    assert np.abs(tao["y"] - play["y"]).max() < 1e-14


def test_prandtl_ishlinskii_is_a_sum_of_plays():
    radii, weights, starts = (0.1, 0.3, 0.5), (0.5, -0.2, 0.4), (0.05, 0.0, -0.2)
    inputs = {"u": lambda t: np.sin(t) + 0.4 * np.sin(2.7 * t)}
    whole = simulate(PrandtlIshlinskii(radii=radii, weights=weights, weight0=0.3, x0=starts), inputs, 20.0, 1e-2)
    parts = [simulate(Play(half_width=r, m=m), inputs, 20.0, 1e-2)["y"] for r, m in zip(radii, starts, strict=True)]
    u = np.array([inputs["u"](t) for t in whole["t"]])
    assert np.abs(whole["y"] - 0.3 * u - np.dot(weights, parts)).max() < 1e-14


def test_prandtl_ishlinskii_without_plays_is_a_gain():
    p = PrandtlIshlinskii(radii=(), weights=(), weight0=0.7)
    assert not p.states
    assert value(p, u=2.0)["y"] == pytest.approx(1.4)


def test_rate_of_displacement_may_be_left_open():
    for cls in (AsymmetricBoucWen, GeneralizedBoucWen, BoucWen, DahlHysteresis, ElasticBacklash):
        assert cls().inports["v"].rate_of == "x"


@pytest.mark.parametrize(
    ("message", "cls", "values"),
    [
        (
            "AsymmetricBoucWen.theta must lie in (0, inf), got -1. "
            "It is: decay of the internal state with travel [1/rad].",
            AsymmetricBoucWen,
            dict(theta=-1),
        ),
        (
            "AsymmetricBoucWen.alpha1 must lie in (0, inf), got 0. It is: slope while loading (v > 0).",
            AsymmetricBoucWen,
            dict(alpha1=0),
        ),
        ("BoucWen.n must lie in [1, 20], got 0.5. It is: sharpness of the bends.", BoucWen, dict(n=0.5)),
        (
            "GeneralizedBoucWen.n must lie in [1, 20], got 25. It is: sharpness of the bends.",
            GeneralizedBoucWen,
            dict(n=25),
        ),
        (
            "DahlHysteresis.half_width must lie in (0, inf), got 0. "
            "It is: stretch after long travel in one direction [rad].",
            DahlHysteresis,
            dict(half_width=0),
        ),
        (
            "ElasticBacklash.roundness must lie in [0.01, 1], got 0. It is: 0.01: sharp corners, 1: Dahl's law.",
            ElasticBacklash,
            dict(roundness=0),
        ),
        (
            "TaoBacklash.c2 must lie in (0, inf), got -1. It is: slope of the line followed downwards.",
            TaoBacklash,
            dict(c2=-1),
        ),
        ("Play.half_width must lie in [0, inf), got -0.1. It is: half of the slack.", Play, dict(half_width=-0.1)),
        (
            "PrandtlIshlinskii needs as many weights as radii, got 1 and 2.",
            PrandtlIshlinskii,
            dict(radii=(0.1, 0.2), weights=(1.0,)),
        ),
        ("PrandtlIshlinskii.x0 needs one number per play (3) or none, got 2.", PrandtlIshlinskii, dict(x0=(0.0, 0.0))),
        (
            "PrandtlIshlinskii.radii[1] must lie in [0, inf), got -0.2. It is: half of each slack.",
            PrandtlIshlinskii,
            dict(radii=(0.1, -0.2), weights=(1.0, 1.0)),
        ),
    ],
)
def test_bad_values(message, cls, values):
    refuses(message, cls, **values)


@pytest.mark.parametrize("step", [1e-2, 1e-3])
def test_the_rate_behind_a_play_is_that_of_its_output(step):
    """A sheath behind a gap moves at the speed of what the gap lets through, from the first to the last sample."""
    sheath = AsymmetricBoucWen()
    chain = tsm.Diagram(
        blocks=dict(gap=Play(half_width=0.2), tsm=sheath),
        wires=["gap -> tsm.x"],
        inputs={"x": "gap.u"},
        outputs={"y": "tsm"},
    )
    t = np.arange(0.0, 1.0 + step / 2, step)
    y = tsm.simulate(chain, inputs={"x": (t, t)}, stop=1.0, step=step, hold="linear")["y"]
    travel = np.maximum(t - 0.2, 0.0)
    zeta = (sheath.A + sheath.delta) / sheath.theta * (1 - np.exp(-sheath.theta * travel))
    slope = (sheath.alpha1 + sheath.alpha2 + np.tanh(1.0) * (sheath.alpha1 - sheath.alpha2)) / 2
    moving = t > 0.2 + 2 * step
    assert y[moving] == pytest.approx((slope * travel + zeta)[moving], abs=0.2 * step)


# ---- a tendon in its sheath


def test_capstan_friction_is_play_in_the_logarithm_of_the_tension():
    p = CapstanFriction(mu=0.15, angle=2.0, pretension=5.0, m=0.0)
    inputs = {"u": lambda t: 3.0 * np.sin(2.1 * t) + 1.2 * np.sin(7.3 * t)}
    run = simulate(p, inputs, stop=6.0, step=1e-3)
    log = {"u": lambda t: np.log(5.0 + inputs["u"](t))}
    expected = simulate(Play(half_width=0.3, m=np.log(5.0)), log, stop=6.0, step=1e-3)
    assert np.allclose(run["y"], np.exp(expected["y"]) - 5.0, atol=1e-9)


def test_capstan_friction_holds_the_tendon_between_the_edges_of_the_band():
    p = CapstanFriction(mu=0.1, angle=1.0, pretension=10.0)
    pulled, released = value(p, {"m": 0.0}, u=5.0)["y"], value(p, {"m": 0.0}, u=-5.0)["y"]
    assert pulled == pytest.approx(15.0 * np.exp(-0.1) - 10.0)
    assert released == pytest.approx(5.0 * np.exp(0.1) - 10.0)
    assert value(p, {"m": 0.3}, u=0.2)["y"] == pytest.approx(0.3)  # within the band it rests


def test_a_cable_that_pushes_rubs_as_well():
    p = CapstanFriction(mu=0.1, angle=1.0, pretension=1.0)
    assert value(p, {"m": 0.0}, u=-3.0)["y"] == pytest.approx(-2.0 * np.exp(-0.1) - 1.0)
    assert value(p, {"m": -9.0}, u=-3.0)["y"] == pytest.approx(-2.0 * np.exp(0.1) - 1.0)
    assert value(p, {"m": 5.0}, u=-1.0)["y"] == pytest.approx(-1.0)


def test_without_friction_a_tendon_passes_its_tension_on():
    p = CapstanFriction(mu=0.0, pretension=2.0)
    for u in (-1.5, 0.0, 0.7):
        assert value(p, {"m": 9.0}, u=u)["y"] == pytest.approx(u)
