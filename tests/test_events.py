"""Switching instants located within the step: closed forms, order, and what cannot be located."""

import signal
import warnings

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.tolerances import BACKENDS, EXACT
from tsmblocks.blocks import (
    Abs,
    AsymmetricBoucWen,
    Constant,
    DeadZone,
    Delay,
    ElasticBacklash,
    FirstOrderLag,
    Gain,
    Integrator,
    LookupTable,
    Minimum,
    Play,
    Quantiser,
    Relay,
    Saturation,
    Sign,
    Sine,
    Step,
    Sum,
    Triangle,
    ZeroOrderHold,
)
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.engine import backends, session, switches
from tsmblocks.engine.events import SlidingWarning
from tsmblocks.model.block import Block, Input, Output, block, parameter, state
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate

INSTANT = 1e-10
"""Error of an instant [s], where the run up to it is accurate enough."""
STEPS = (0.02, 0.01, 0.005)


@block(register=False)
class Body(Block):
    """A unit mass with dry friction."""

    friction: float = parameter(default=1.0, about="dry friction", at_least=0.0)
    f = Input("force")
    y = Output("position")
    position: float = state(default=0.0, about="position")
    speed: float = state(default=0.0, about="speed")

    def derivatives(self, t, x, u):
        return dict(position=x.speed, speed=u.f - self.friction * ca.sign(x.speed))

    def outputs(self, t, x, u):
        return dict(y=x.position)


def instants(run):
    return np.array([e.t for e in run.events])


def orders(diagram, name, exact, stop, **options):
    """Mean order over the steps, without and with located instants, and the errors with."""
    made = []
    for locate in (False, True):
        errors = []
        for h in STEPS:
            run = simulate(diagram, stop=stop, step=h, locate=locate, **options)
            errors.append(np.abs(run[name] - exact(run.t)).max())
        made.append(np.log2(errors[0] / errors[-1]) / (len(STEPS) - 1))
    return made[0], made[1], errors


def piecewise(rates, edges, modes, x, stop):
    """SciPy at tight tolerance from switch to switch: ``rates(t, x, modes)``, ``edges(t, x)`` per switch."""
    t, pieces, found = 0.0, [], []
    while t < stop:
        events = []
        for k, mode in enumerate(modes):
            events.append(lambda t, x, _, k=k: edges(t, x)[k])
            events[-1].terminal, events[-1].direction = True, -mode
        out = solve_ivp(
            rates,
            (t, stop),
            x,
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=events,
            args=(modes,),
            dense_output=True,
        )
        assert out.success
        pieces.append((t, out.t[-1], out.sol))
        t, x = out.t[-1], out.y[:, -1]
        if out.status == 1:
            k = next(k for k, found_there in enumerate(out.t_events) if len(found_there))
            modes = [-m if i == k else m for i, m in enumerate(modes)]
            found.append(t)

    def solution(times):
        made = np.empty((len(times), len(x)))
        for a, b, sol in pieces:
            inside = (times >= a - 1e-12) & (times <= b + 1e-12)
            if inside.any():
                made[inside] = sol(np.clip(times[inside], a, b)).T
        return made

    return solution, np.array(found)


# ---- closed forms


def lag_into_limit():
    return Diagram(
        title="lag into a limit",
        blocks=dict(
            one=Constant(), lag=FirstOrderLag(time_constant=0.5), limit=Saturation(low=-0.6, high=0.6), sum=Integrator()
        ),
        wires=["one -> lag -> limit -> sum"],
        outputs={"x": "sum"},
    )


def lag_into_limit_exact(t):
    T, at = 0.5, -0.5 * np.log(0.4)
    free = lambda t: t - T + T * np.exp(-t / T)  # noqa: E731
    return np.where(t < at, free(t), free(at) + 0.6 * (t - at))


def test_a_lag_reaches_a_limit_at_the_analytic_instant():
    run = simulate(lag_into_limit(), stop=2.0, step=2e-3, locate=True)
    (event,) = run.events
    assert abs(event.t - 0.5 * np.log(2.5)) < INSTANT / 10
    assert (event.block, event.switch, event.rising) == ("limit", "min", True)


def test_order_four_across_a_limit():
    plain, located, errors = orders(lag_into_limit(), "x", lag_into_limit_exact, 2.0)
    assert located > 3.8
    assert plain < 2.7
    assert errors[-1] < 3e-11


@pytest.mark.parametrize("level", [-0.83, -0.2, 0.0, 0.31, 0.999])
def test_a_sine_crosses_a_level_at_the_analytic_instants(level):
    d = Diagram(
        title="level",
        blocks=dict(s=Sine(amplitude=1.0, frequency=0.5), k=DeadZone(low=level, high=level + 9), i=Integrator()),
        wires=["s -> k -> i"],
        outputs={"x": "i"},
    )
    run = simulate(d, stop=5.5, step=0.01, locate=True)
    base = np.arcsin(level) / np.pi
    expected = np.sort([t + 2 * n for n in range(-1, 4) for t in (base, 1 - base)])
    expected = expected[(expected > 1e-9) & (expected < 5.5)]
    assert np.allclose(instants(run), expected, rtol=0, atol=INSTANT / 100)
    assert [e.rising for e in run.events] == [bool(np.cos(np.pi * t) > 0) for t in expected]


def test_dry_friction_reverses_without_an_error_of_order_h():
    """Motion under constant force and dry friction is made of parabolas, which RK4 integrates exactly."""
    d = Diagram(
        title="friction", blocks=dict(f=Constant(value=-3.0), b=Body(speed=2.03)), wires=["f -> b"], outputs={"x": "b"}
    )
    run = simulate(d, stop=2.0, step=0.01, locate=True)
    turn = 2.03 / 4
    before, after = 2.03 * run.t - 2 * run.t**2, 2.03 * turn / 2 - (run.t - turn) ** 2
    assert abs(instants(run)[0] - turn) < EXACT
    assert np.abs(run["x"] - np.where(run.t < turn, before, after)).max() < EXACT
    plain = simulate(d, stop=2.0, step=0.01)
    assert np.abs(plain["x"] - run["x"]).max() > 1e-4


def test_relay_with_hysteresis_cycles_at_the_analytic_instants():
    """An integrator driven by a relay: straight lines, so that every switching instant is known."""
    d = Diagram(
        title="cycle",
        blocks=dict(
            c=Constant(value=0.03),
            e=Sum(),
            relay=Relay(on=0.1, off=-0.07, high=1.3, low=-0.9),
            i=Integrator(),
            lag=FirstOrderLag(time_constant=0.3),
        ),
        wires=["c -> e.plus", "e -> relay -> i -> e.minus", "i -> lag"],
        outputs={"x": "i", "y": "lag"},
    )
    t, x, rate, y, T = 0.0, 0.0, -0.9, 0.0, 0.3
    starts, pieces = [], []
    while t < 3:
        target, start = (-0.07 if rate < 0 else 0.1), (t, x, rate, y)
        pieces.append(start)
        span = (target - x) / rate
        y = (y - x + T * rate) * np.exp(-span / T) + target - T * rate
        t, x, rate = t + span, target, (1.3 if rate < 0 else -0.9)
        starts.append(t)

    def exact(times):
        made = np.empty(len(times))
        for begin, x, rate, y in pieces:
            s = times[times >= begin] - begin
            made[times >= begin] = (y - x + T * rate) * np.exp(-s / T) + x + rate * s - T * rate
        return made

    plain, located, _ = orders(d, "y", exact, 3.0)
    run = simulate(d, stop=3.0, step=0.01, locate=True)
    assert np.allclose(instants(run), starts[:-1], rtol=0, atol=INSTANT / 100)
    assert {(e.block, e.switch) for e in run.events} == {("relay", "<=")}
    assert located > 3.8
    assert plain < 1


def relay_loop(*blocks, end=None, source=None):
    """A loop of the blocks in order, fed by a slow triangle, with a lag at its end."""
    names = [f"b{k}" for k in range(len(blocks))]
    return Diagram(
        title="relay loop",
        blocks=dict(
            r=source or Triangle(amplitude=0.96, frequency=0.2),
            e=Sum(),
            **dict(zip(names, blocks, strict=True)),
            end=end or FirstOrderLag(time_constant=0.2),
        ),
        wires=["r -> e.plus", f"e -> {' -> '.join(names)} -> end -> e.minus"],
        outputs={"y": "end"},
    )


TABLE = LookupTable(points=(-1.0, -0.2, 0.2, 1.0), values=(-0.8, 0.0, 0.0, 0.8))
RELAY_LOOPS = {
    "integrator": relay_loop(
        Relay(on=0.1, off=-0.07, high=1.3, low=-0.9), end=Integrator(), source=Constant(value=0.03)
    ),
    "relay first": relay_loop(Relay(on=0.1, off=-0.4, high=1.0, low=-1.0), TABLE, DeadZone(low=-0.2, high=0.4)),
    "relay last": relay_loop(TABLE, Play(half_width=0.1), Relay(on=0.3, off=-0.3, high=1.0, low=-1.0)),
}


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("loop", RELAY_LOOPS)
def test_a_plain_relay_loop_tends_to_the_located_one(loop, backend):
    """A stage that crosses a level and comes back must not act: the relay would stick there at any step."""
    d, options = RELAY_LOOPS[loop], dict(stop=4.0, log="outputs", backend=backend)
    exact = simulate(d, step=1e-3, every=10, locate=True, **options)
    assert len(exact.events) > 5
    for every in (1, 10, 100) if backend == "llvm" else (1, 10):
        plain = simulate(d, step=0.01 / every, every=every, **options)
        late = len(exact.events) * 0.01 / every  # each switch by up to a step
        assert np.abs(plain["y"] - exact["y"]).max() < 3 * late


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_a_relay_switches_on_the_grid_before_the_step_from_there(backend):
    d = Diagram(
        title="grid",
        blocks=dict(s=Step(time=0.3, before=1.0, after=-1.0), relay=Relay(high=2.0, low=-1.0), i=Integrator()),
        wires=["s -> relay -> i"],
        outputs={"y": "relay", "x": "i"},
    )
    for locate in (False, True):
        run = simulate(d, stop=1.0, step=0.1, locate=locate, backend=backend)
        assert np.array_equal(run["y"], [2.0] * 3 + [-1.0] * 8)
        assert np.abs(run["x"] - np.where(run.t < 0.3, 2 * run.t, 0.9 - run.t)).max() < 1e-9


@pytest.mark.parametrize(
    "source",
    [
        Sine(amplitude=1.0, frequency=0.5),
        Step(time=0.3, before=-1.0, after=1.0),
        Step(time=0.303, before=-1.0, after=1.0),
        Constant(value=1.0),
        ZeroOrderHold(period=0.2),
    ],
    ids=lambda s: type(s).__name__,
)
def test_a_chain_of_relays_switches_at_once(source):
    relays = {k: Relay(on=0.3, off=-0.2, high=1.0, low=-1.0) for k in "abc"}
    d = Diagram(
        title="chain",
        blocks=dict(s=Sine(amplitude=1.0, frequency=0.5), source=source, **relays, one=Integrator(), all=Integrator()),
        wires=["source -> a -> b -> c -> all", "a -> one", *(["s -> source"] if source.inports else [])],
        outputs={"one": "one", "all": "all"},
    )
    run = simulate(d, stop=2.0, step=0.01, locate=True)
    assert np.ptp(run["a.y"]) == (0 if isinstance(source, Constant) else 2)
    assert np.abs(run["one"] - run["all"]).max() < EXACT


def test_integrator_stops_at_its_limits_and_leaves_them():
    """x' = cos t between -0.5 and 0.7 by its closed form, cut and shifted at each limit."""
    d = Diagram(
        title="limits",
        blocks=dict(s=Sine(amplitude=1.0, frequency=0.5 / np.pi, phase=np.pi / 2), i=Integrator(low=-0.5, high=0.7)),
        wires=["s -> i"],
        outputs={"x": "i"},
    )
    run = simulate(d, stop=6.0, step=0.01, locate=True)
    high, low = np.arcsin(0.7), np.pi + np.arcsin(0.2)  # where sin t = 0.7, and 0.7 - 1 + sin t = -0.5
    edges = np.array([high, np.pi / 2, low, 3 * np.pi / 2])
    parts = [np.sin(run.t), 0.7, np.sin(run.t) - 0.3, -0.5]
    exact = np.select([run.t < edge for edge in edges], parts, np.sin(run.t) + 0.5)
    assert np.abs(run["x"] - exact).max() < 1e-10
    gaps = np.abs(instants(run)[:, None] - edges)
    assert (gaps.min(axis=0) < INSTANT).all()
    assert (gaps.min(axis=1) < 1e-6).all()  # a limit is left with rate zero, hence seen a little later


# ---- against SciPy, piece by piece


def saturated_loop():
    d = Diagram(
        title="loop",
        blocks=dict(
            r=Sine(amplitude=1.0, frequency=0.5),
            e=Sum(),
            k=Gain(gain=40.0),
            limit=Saturation(low=-8.0, high=8.0),
            v=FirstOrderLag(gain=2.0, time_constant=2.0),
            x=Integrator(),
        ),
        wires=["r -> e.plus", "e -> k -> limit -> v -> x -> e.minus"],
        outputs={"x": "x"},
    )
    error = lambda t, x: 40 * (np.sin(np.pi * t) - x[0])  # noqa: E731

    def rates(t, x, m):
        u = 8.0 if m[1] > 0 else -8.0 if m[0] < 0 else error(t, x)
        return [x[1], u - 0.5 * x[1]]

    exact, at = piecewise(rates, lambda t, x: (error(t, x) + 8, error(t, x) - 8), [1, -1], [0.0, 0.0], 6.0)
    return d, lambda t: exact(t)[:, 0], at


def test_order_four_in_a_loop_that_saturates_many_times():
    d, exact, at = saturated_loop()
    plain, located, errors = orders(d, "x", exact, 6.0)
    assert len(at) == 13
    assert located > 3.5
    assert plain < 3
    assert errors[1] < 3e-7
    run = simulate(d, stop=6.0, step=1e-3, locate=True)
    assert np.abs(instants(run) - at).max() < INSTANT
    assert {e.block for e in run.events} == {"limit"}


def test_order_four_at_the_kink_of_a_hysteresis():
    w = 2 * np.pi * 0.37
    speed = lambda t: 0.96 * w * np.cos(w * t + 0.3)  # noqa: E731
    d = Diagram(
        title="kink",
        blocks=dict(
            r=Sine(amplitude=0.96, frequency=0.37, phase=0.3), h=AsymmetricBoucWen(A=-0.8745, theta=8.0, delta=0.14522)
        ),
        wires=["r -> h"],
        outputs={"y": "h"},
    )

    def rates(t, x, m):
        return [-0.8745 * speed(t) - 8.0 * m[0] * speed(t) * x[0] + 0.14522 * m[0] * speed(t)]

    exact, at = piecewise(rates, lambda t, x: (speed(t),), [1], [0.0], 6.0)
    plain, located, _ = orders(d, "h.zeta", lambda t: exact(t)[:, 0], 6.0)
    assert located > 3.8
    assert plain < 3
    run = simulate(d, stop=6.0, step=0.01, locate=True)
    assert np.abs(instants(run) - at).max() < INSTANT
    assert {(e.block, e.switch) for e in run.events} == {("h", "abs")}


def test_sampled_controller_with_events_between_samples():
    """A held reference and a limit on the difference: a straight line, then an exponential, per sample."""
    d = Diagram(
        title="sampled",
        blocks=dict(
            r=Sine(amplitude=1.0, frequency=0.8),
            hold=ZeroOrderHold(period=0.1),
            e=Sum(),
            k=Gain(gain=20.0),
            limit=Saturation(low=-3.0, high=3.0),
            i=Integrator(),
        ),
        wires=["r -> hold -> e.plus", "e -> k -> limit -> i -> e.minus"],
        outputs={"x": "i"},
    )
    samples = np.sin(2 * np.pi * 0.8 * 0.1 * np.arange(31))

    def exact(times):
        x, made, inside = 0.0, np.empty(len(times)), []
        for k, z in enumerate(samples):
            side, gap = np.sign(z - x), abs(z - x)
            span = max(gap - 3 / 20, 0.0) / 3
            if 0 < span < 0.1:
                inside.append(0.1 * k + span)

            def at(s, z=z, side=side, gap=gap, span=span):
                return z - side * np.where(s < span, gap - 3 * s, min(gap, 3 / 20) * np.exp(-20 * (s - span)))

            here = times >= 0.1 * k - 1e-9
            made[here] = at(times[here] - 0.1 * k)
            x = float(at(0.1))
        return made, np.array(inside)

    plain, located, errors = orders(d, "x", lambda t: exact(t)[0], 3.0)
    assert located > 3.5
    assert plain < 3.2
    run = simulate(d, stop=3.0, step=1e-3, locate=True)
    inside = exact(run.t)[1]
    off_grid = np.array([e.t for e in run.events if abs(e.t / 0.1 - round(e.t / 0.1)) > 1e-6])
    assert len(inside) > 3
    assert np.allclose(off_grid, inside[: len(off_grid)], rtol=0, atol=1e-8)
    assert len(off_grid) >= len(inside) - 1
    assert errors[-1] < 1e-5


def test_a_recorded_input_crosses_a_limit_between_its_samples():
    t = np.arange(0, 4.05, 0.05)
    y = np.random.default_rng(1).normal(size=len(t))
    d = Diagram(
        title="recorded",
        blocks=dict(limit=Saturation(low=-0.5, high=0.5), i=Integrator()),
        wires=["limit -> i"],
        inputs={"u": "limit.u"},
        outputs={"x": "i"},
    )
    run = simulate(d, stop=4.0, step=0.01, inputs={"u": (t, y)}, locate=True)
    fine = np.linspace(0, 4, 4_000_001)
    clipped = np.clip(np.interp(fine, t, y), -0.5, 0.5)
    area = np.concatenate([[0], np.cumsum((clipped[1:] + clipped[:-1]) / 2 * 1e-6)])
    assert np.abs(run["x"] - area[::10_000]).max() < 1e-9
    assert np.allclose(np.abs(np.interp(instants(run), t, y)), 0.5, atol=1e-9)


def test_jumps_pass_down_a_chain_of_switches_in_order():
    """Each of these jumps with the one before it; none may act on what another was before."""
    d = Diagram(
        title="chain",
        blocks=dict(
            s=Sine(amplitude=1.0, frequency=0.5, phase=0.3),
            sign=Sign(),
            p=Play(half_width=0.1),
            first=Relay(on=0.3, off=-0.2, high=1.0, low=-1.0),
            limit=Saturation(low=-0.5, high=0.2),
            second=Relay(on=0.3, off=-0.3, high=1.0, low=-1.0),
            i=Integrator(),
        ),
        wires=["s -> sign -> p -> first -> limit -> second -> i"],
        outputs={"x": "i"},
    )
    run = simulate(d, stop=4.0, step=0.01, locate=True)
    assert np.abs(run["x"] + run.t).max() < EXACT  # 0.2 never reaches the second relay's 0.3
    crossings = np.arange(1, 5) - 0.3 / np.pi
    assert all(np.abs(crossings - t).min() < INSTANT for t in instants(run))


@pytest.mark.parametrize("level", [0.0, 0.3])
def test_a_signal_that_rests_on_an_edge(level):
    """Sign of what a dead zone lets through: zero while it lets nothing through, not the last sign."""
    d = Diagram(
        title="rest",
        blocks=dict(
            s=Sine(amplitude=1.0, frequency=0.5), k=DeadZone(low=-level, high=0.4), sign=Sign(), i=Integrator()
        ),
        wires=["s -> k -> sign -> i"],
        outputs={"x": "i", "y": "sign"},
    )
    run = simulate(d, stop=2.0, step=0.01, locate=True)
    low, high = np.arcsin(level) / np.pi, np.arcsin(0.4) / np.pi
    exact = np.clip(run.t - high, 0, 1 - 2 * high) - np.clip(run.t - 1 - low, 0, 1 - 2 * low)
    assert np.abs(run["x"] - exact).max() < INSTANT


def test_a_relay_switched_by_a_jump_keeps_its_state_afterwards():
    """The input jumps across both levels, then falls between them: the relay stays on."""
    d = Diagram(
        title="jump",
        blocks=dict(
            up=Step(time=0.503, before=-1.0, after=0.5),
            down=FirstOrderLag(time_constant=0.3),
            e=Sum(),
            relay=Relay(on=0.3, off=-0.3, high=1.0, low=-1.0),
            i=Integrator(),
        ),
        wires=["up -> down -> e.minus", "up -> e.plus", "e -> relay -> i"],
        outputs={"x": "i"},
    )
    run = simulate(d, stop=2.0, step=0.01, locate=True)
    assert np.abs(run["x"] - np.abs(run.t - 0.503) + 0.503).max() < INSTANT


# ---- what is logged


def test_a_jump_on_the_grid_is_logged_with_the_value_after_it():
    d = Diagram(
        title="jump", blocks=dict(s=Step(time=0.3), i=Integrator()), wires=["s -> i"], outputs={"x": "i", "s": "s"}
    )
    for h in (0.1, 0.01, 0.001):
        run = simulate(d, stop=1.0, step=h, locate=True)
        plain = simulate(d, stop=1.0, step=h)
        assert np.array_equal(run["s"], plain["s"])
        assert np.abs(run["x"] - np.maximum(run.t - 0.3, 0)).max() < 1e-9
        assert abs(run.events[0].t - 0.3) < INSTANT
        assert len(run.events) == 1


def test_a_jump_off_the_grid_is_located():
    d = Diagram(title="jump", blocks=dict(s=Step(time=1 / 3), i=Integrator()), wires=["s -> i"], outputs={"x": "i"})
    run = simulate(d, stop=1.0, step=0.05, locate=True)
    assert np.abs(run["x"] - np.maximum(run.t - 1 / 3, 0)).max() < INSTANT
    assert abs(instants(run)[0] - 1 / 3) < INSTANT


def test_comparisons_of_a_block_that_change_at_one_instant_are_listed_once_each_way():
    """The two limits of elastic play are maxima alike, and its direction turns both."""
    blocks = dict(s=Sine(frequency=0.5), lag=FirstOrderLag(time_constant=0.05), play=ElasticBacklash(half_width=0.2))
    d = Diagram(title="play", blocks=blocks, wires=["s -> lag -> play"], outputs={"y": "play"})
    events = simulate(d, stop=4.0, step=0.01, locate=True).events
    assert len({event.t for event in events}) == 11
    assert len(set(events)) == len(events) == 20


def test_rows_stay_on_the_grid_whatever_is_kept():
    d, _, _ = saturated_loop()
    whole = simulate(d, stop=6.0, step=0.01, locate=True)
    few = simulate(d, stop=6.0, step=0.01, locate=True, every=7, log="outputs")
    assert np.array_equal(few.t, whole.t[::7])
    assert np.array_equal(few["x"], whole["x"][::7])
    assert few.events == whole.events
    later = simulate(d, start=8.0, stop=14.0, step=0.01, locate=True)  # 8 s are four periods
    assert np.abs(later["x"] - whole["x"]).max() < BACKENDS
    assert np.allclose(instants(later) - 8.0, instants(whole), rtol=0, atol=BACKENDS)


def test_names_of_blocks_inside_diagrams():
    inner = Diagram(
        title="inner",
        blocks=dict(limit=Saturation(low=-0.5, high=0.5)),
        inputs={"u": "limit.u"},
        outputs={"y": "limit"},
    )
    d = Diagram(
        title="outer",
        blocks=dict(
            s=Sine(amplitude=1.0, frequency=0.5), drive=inner, m=Minimum(), c=Constant(value=0.2), i=Integrator()
        ),
        wires=["s -> drive -> m.u1", "c -> m.u2", "m -> i"],
        outputs={"x": "i"},
    )
    run = simulate(d, stop=1.1, step=0.01, locate=True)
    assert [(e.block, e.switch) for e in run.events] == [
        ("m", "min"),
        ("drive.limit", "min"),
        ("drive.limit", "min"),
        ("m", "min"),
    ]


def test_switches_that_have_no_effect_are_left_alone():
    """The limits of an integrator that has none, and the branch of a comparison that is not taken."""
    d = Diagram(
        title="free",
        blocks=dict(s=Sine(amplitude=1.0), i=Integrator(), q=Quantiser()),
        wires=["s -> i", "s -> q"],
        outputs={"x": "i"},
    )
    assert simulate(d, stop=10.0, step=0.01, locate=True).events == ()


# ---- agreement


def test_a_smooth_diagram_runs_as_without():
    d = Diagram(
        title="smooth",
        blocks=dict(s=Sine(), hold=ZeroOrderHold(), lag=FirstOrderLag()),
        wires=["s -> hold -> lag"],
        outputs={"x": "lag"},
    )
    run = simulate(d, stop=5.0, locate=True)
    assert np.array_equal(run.rows, simulate(d, stop=5.0).rows)
    assert run.events == ()


def test_limits_that_are_never_reached_change_nothing_but_rounding():
    d = lag_into_limit().with_parameters({"limit.high": 2.0})
    run, plain = (simulate(d, stop=5.0, locate=k) for k in (True, False))
    assert np.abs(run.rows - plain.rows).max() < EXACT
    assert run.events == ()
    assert plain.events == ()


def test_memory_updated_at_each_step_keeps_its_law():
    d = Diagram(
        title="play",
        blocks=dict(s=Sine(amplitude=1.0, frequency=0.25), p=Play(half_width=0.3), a=Abs(), i=Integrator()),
        wires=["s -> p -> a -> i"],
        outputs={"y": "p"},
    )
    run = simulate(d, stop=9.0, step=0.01, locate=True)
    m = 0.0
    for x, y in zip(run["s.y"], run["y"], strict=True):
        m = max(x - 0.3, min(x + 0.3, m))
        assert abs(y - m) < EXACT
    contact = 2 / np.pi * np.arcsin(0.3)
    assert abs(instants(run)[0] - contact) < INSTANT
    assert {e.block for e in run.events} == {"p", "a"}


def test_back_ends_and_large_form_agree(monkeypatch):
    d, _, _ = saturated_loop()
    run = simulate(d, stop=6.0, step=0.01, locate=True)
    other = simulate(d, stop=6.0, step=0.01, locate=True, backend="casadi")
    assert np.abs(run.rows - other.rows).max() < BACKENDS
    assert np.allclose(instants(run), instants(other), rtol=0, atol=BACKENDS)
    monkeypatch.setattr(backends, "LARGE_OPERATIONS", 0)
    for cached in (session.single_kernel, switches.freeze):
        cached.cache_clear()
    large = simulate(d, stop=6.0, step=0.01, locate=True)
    for cached in (session.single_kernel, switches.freeze):
        cached.cache_clear()
    assert np.abs(run.rows - large.rows).max() < BACKENDS


@pytest.mark.parametrize("name", ["fig16_feedforward_feedback", "fig09b_elementary", "tendon_sheath_play"])
def test_shipped_diagrams_agree_with_a_much_finer_step(name):
    d = tsm.load(name)
    t = np.arange(0, 3.001, 1e-3)
    given = {k: tsm.Samples(t, np.sin(2 * np.pi * 0.3 * t), "cubic") for k in d.inputs}
    start = {"motor.angle": 0.6} if "motor.angle" in tsm.equations(d).x else {}
    options = dict(stop=3.0, inputs=given, initial=start, log="outputs")
    fine = simulate(d, step=2e-5, every=50, **options)
    plain, run = (simulate(d, step=1e-3, locate=k, **options) for k in (False, True))
    assert run.events
    for key in ("x_in", "x_out"):
        if key in d.outputs:
            error, before = (np.abs(r[key] - fine[key]).max() for r in (run, plain))
            assert error <= before + EXACT
            assert error < 1e-5


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("heun", 2), ("rk4", 4)])
def test_other_methods_keep_their_order(method, order):
    located = orders(lag_into_limit(), "x", lag_into_limit_exact, 2.0, method=method)[1]
    assert located > order - 0.2


# ---- what cannot be located


def test_a_relay_in_sliding_mode_warns_once_and_goes_on_plainly():
    d = Diagram(
        title="slide",
        blocks=dict(r=Sine(amplitude=0.5, frequency=0.1, phase=0.4), e=Sum(), relay=Sign(), i=Integrator(integral=0.7)),
        wires=["r -> e.plus", "e -> relay -> i -> e.minus"],
        outputs={"x": "i"},
    )
    with pytest.warns(SlidingWarning, match="the sign in relay changes again and again") as caught:
        run = simulate(d, stop=6.0, step=0.01, locate=True)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    sliding = run.t > 1
    target = 0.5 * np.sin(0.2 * np.pi * run.t + 0.4)
    assert np.abs(run["x"] - target)[sliding].max() < 0.02
    plain = simulate(d, stop=6.0, step=0.01)
    assert np.abs(run["x"] - plain["x"]).max() < 0.02


def test_a_body_that_rests_at_zero_stays_there_quietly():
    d = Diagram(title="rest", blocks=dict(f=Constant(value=0.0), b=Body()), wires=["f -> b"], outputs={"x": "b"})
    run = simulate(d, stop=1.0, step=0.01, locate=True)
    assert not run["x"].any()
    assert run.events == ()


def test_a_body_that_starts_from_rest_moves_off_at_once():
    d = Diagram(title="start", blocks=dict(f=Constant(value=-3.0), b=Body()), wires=["f -> b"], outputs={"x": "b"})
    run = simulate(d, stop=1.0, step=0.01, locate=True)
    assert np.abs(run["x"] + run.t**2).max() < EXACT
    late = Diagram(
        title="later", blocks=dict(f=Step(time=0.5, after=3.0), b=Body()), wires=["f -> b"], outputs={"x": "b"}
    )
    run = simulate(late, stop=1.0, step=0.01, locate=True)
    assert np.abs(run["x"] - np.maximum(run.t - 0.5, 0) ** 2).max() < INSTANT
    assert [(e.block, e.rising) for e in run.events] == [("f", True), ("b", True)]


def test_transport_delays_are_refused():
    d = Diagram(
        title="late",
        blocks=dict(s=Sine(), delay=Delay(), lag=FirstOrderLag()),
        wires=["s -> delay -> lag"],
        outputs={"x": "lag"},
    )
    with pytest.raises(RunError, match=r"'late': locate=True does not support a transport delay \(delay\."):
        simulate(d, stop=1.0, locate=True)


@block(register=False)
class Root(Block):
    """A square root that is given too much."""

    level: float = parameter(default=1.0, about="largest input")
    u = Input("any signal")
    y = Output("the root")

    def outputs(self, t, x, u):
        return dict(y=ca.sqrt(self.level - u.u))


@pytest.mark.parametrize("options", [{}, {"log": "outputs"}, {"every": 10}, {"backend": "casadi"}])
def test_nan_is_reported_as_without(options):
    d = Diagram(
        title="nan",
        blocks=dict(
            s=Sine(amplitude=3.0, frequency=0.5),
            a=Abs(),
            i=Integrator(),
            root=Root(),
            limit=Saturation(low=-1.0, high=1.0),
        ),
        wires=["s -> a -> i -> root -> limit"],
        outputs={"x": "limit"},
    )
    errors = []
    for locate in (False, True):
        with pytest.raises(NotFinite, match="first in root") as caught:
            simulate(d, stop=6.0, step=0.01, locate=locate, **options)
        errors.append(caught.value)
    plain, located = errors
    assert located.time == plain.time
    assert located.block == "root"
    assert np.array_equal(located.run.t, plain.run.t)
    assert np.isfinite(located.run.rows).all()


def test_a_limit_that_guards_a_root_still_guards_it():
    @block(register=False)
    class Tank(Block):
        """A tank that runs empty, z' = -sqrt(z)."""

        y = Output("level")
        z: float = state(default=1.0, about="level")

        def derivatives(self, t, x, u):
            return dict(z=-ca.sqrt(ca.fmax(x.z, 0.0)))

        def outputs(self, t, x, u):
            return dict(y=x.z)

    run = simulate(Diagram(title="tank", blocks=dict(b=Tank()), outputs={"z": "b"}), stop=4.0, step=0.01, locate=True)
    assert np.abs(run["z"] - np.maximum(1 - run.t / 2, 0) ** 2).max() < 1e-6


def test_ctrl_c_returns_what_there_is(monkeypatch):
    d, _, _ = saturated_loop()
    whole = simulate(d, stop=60.0, step=1e-3, locate=True)
    calls = []
    turn = switches.Frozen.turned

    def interrupted(frozen, g, m, which):
        calls.append(1)
        if len(calls) == 100:
            signal.raise_signal(signal.SIGINT)
        return turn(frozen, g, m, which)

    monkeypatch.setattr(switches.Frozen, "turned", interrupted)
    monkeypatch.setattr(session, "PIECE_SECONDS", 0.001)
    run = simulate(d, stop=60.0, step=1e-3, locate=True)
    assert not run.complete
    assert 1.0 < run.t[-1] < 60.0
    assert np.abs(run.rows - whole.rows[: len(run.t)]).max() < BACKENDS
    assert 0 < len(run.events) < 100
    assert run.events[-1].t <= run.t[-1] + 1e-3


def test_no_warnings_where_all_goes_well():
    d, _, _ = saturated_loop()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(d, stop=2.0, step=0.01, locate=True)


def test_play_behind_a_relay_that_jumps():
    """The band is pushed by the input just before the jump and just after it; on the grid alone with an error of h."""
    d = Diagram(
        title="jump",
        blocks=dict(
            s=Sine(amplitude=1.0, frequency=1.0), r=Relay(on=0.5, off=-0.5, high=-1.0, low=1.0), a=Sum(signs="++"),
            p=Play(half_width=0.3),
        ),
        wires=["s -> r -> a.plus1", "s -> a.plus2", "a -> p"],
    )  # fmt: skip
    t = np.union1d(np.linspace(0.0, 1.0, 2001), [1 / 12, 7 / 12])
    left, right = np.where(t <= 1 / 12, 1.0, -1.0), np.where(t < 1 / 12, 1.0, -1.0)
    left, right = np.where(t > 7 / 12, 1.0, left), np.where(t >= 7 / 12, 1.0, right)
    m, wanted = 0.0, []
    for before, after in zip(left + np.sin(2 * np.pi * t), right + np.sin(2 * np.pi * t), strict=True):
        for u in (before, after):
            m = min(max(m, u - 0.3), u + 0.3)
        wanted.append(m)
    errors = []
    for step, locate in ((0.01, True), (0.01, False), (0.0025, False)):
        run = simulate(d, stop=1.0, step=step, locate=locate)
        away = (abs(run.t - 1 / 12) > 0.011) & (abs(run.t - 7 / 12) > 0.011)
        errors.append(abs(run["p.y"] - np.interp(run.t, t, wanted))[away].max())
    assert errors[0] < 1e-11
    assert 1e-3 < errors[2] < 0.5 * errors[1] < 0.05


def test_a_held_input_switches_where_it_jumps():
    d = Diagram(
        title="held", blocks=dict(r=Relay(on=2.5, off=-2.5, high=1.0, low=0.0), i=Integrator()), wires=["r -> i"],
        inputs={"u": "r.u"}, outputs={"y": "i"},
    )  # fmt: skip
    t = np.arange(11) * 0.1
    run = simulate(d, stop=0.91, step=0.07, inputs={"u": (t, 1.0 * np.arange(11))}, hold="zero", locate=True)
    (event,) = run.events
    assert event.t == pytest.approx(0.3, abs=1e-12)
    assert run["y"] == pytest.approx(np.maximum(run.t - 0.3, 0.0), abs=1e-12)
