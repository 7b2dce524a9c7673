"""L-stable methods: their order, stiff problems against Radau, and the same on every way to run."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tsmblocks as tsm
from tests.stiff import Contact, Robertson, VanDerPol
from tests.test_export import c_rows, engine_rows, needs_compiler
from tests.test_loops import Cubic
from tsmblocks.blocks import (
    DCMotor,
    DeadTime,
    DiscretePID,
    FirstOrderLag,
    Gain,
    Integrator,
    Play,
    Saturation,
    Sign,
    Sine,
    Step,
    Sum,
    Tanh,
    ZeroOrderHold,
)
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.engine.methods import METHODS
from tsmblocks.simulation.stability import StepWarning

IMPLICIT = ["sdirk2", "sdirk3", "sdirk4"]
BACKENDS = ["llvm", "casadi"]


def alone(inner, **more):
    return tsm.Diagram(title="alone", blocks=dict(b=inner, **more), wires=[], outputs={"y": "b.y"})


def motor_loop(**more):
    """A controller around a motor of two states with a limit, a curve and an algebraic loop."""
    return tsm.Diagram(
        title="loop",
        blocks=dict(
            e=Sum(), k=Gain(gain=8.0), sat=Saturation(low=-2.0, high=2.0), s=Sum(), c=Cubic(a=0.3), f=Tanh(),
            fast=FirstOrderLag(time_constant=1e-4), slow=FirstOrderLag(time_constant=0.2), i=Integrator(), **more,
        ),
        wires=["e -> k -> sat -> s.plus", "s -> c -> s.minus", "s -> fast -> slow -> f -> i -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "i", "s": "s"},
    )  # fmt: skip


@pytest.mark.parametrize("method", IMPLICIT)
def test_tables_are_l_stable_and_of_their_order(method):
    rule = METHODS[method]
    assert rule.implicit
    for z in (-1e3, -1e9, -1 + 1e6j, 1e9j):
        assert not rule.grows(z)
    for part in np.logspace(-2, 3, 60):
        assert not rule.grows(1j * part)  # A-stable: not on the imaginary axis, hence nowhere to its left


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("method", IMPLICIT)
def test_the_order_on_a_nonlinear_problem(method, backend):
    d = alone(VanDerPol(mu=2.0))
    exact = solve_ivp(
        lambda t, x: [x[1], 2 * (1 - x[0] ** 2) * x[1] - x[0]], (0, 3), [2, 0], "DOP853", rtol=1e-13, atol=1e-14
    )
    errors = []
    for h in (0.02, 0.01):
        run = tsm.simulate(d, stop=3.0, step=h, method=method, backend=backend)
        errors.append(abs(run["y"][-1] - exact.y[0, -1]))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(METHODS[method].order, abs=0.15)


@pytest.mark.parametrize("method", IMPLICIT)
def test_a_lag_of_ten_microseconds_at_a_step_of_a_millisecond(method):
    d = tsm.Diagram(
        title="rc",
        blocks=dict(r=Sine(frequency=1.0, amplitude=1.0), g=FirstOrderLag(time_constant=1e-5)),
        wires=["r -> g"],
    )
    run = tsm.simulate(d, stop=1.0, method=method)
    w = 2 * np.pi
    exact = (np.exp(1j * w * run.t) / (1 + 1j * w * 1e-5)).imag
    assert run["g.y"][10:] == pytest.approx(exact[10:], abs=1e-5)
    assert not run.loops


@pytest.mark.parametrize("method", IMPLICIT)
def test_reactions_of_robertson_against_radau(method):
    def rate(t, x):
        slow, back, fast = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
        return [back - slow, slow - back - fast, fast]

    exact = solve_ivp(rate, (0, 40), [1, 0, 0], "Radau", rtol=1e-11, atol=1e-14, t_eval=[1.0, 10.0, 40.0])
    run = tsm.simulate(alone(Robertson()), stop=40.0, step=0.05, method=method)
    at = np.searchsorted(run.t, exact.t - 1e-9)
    assert run["y"][at] == pytest.approx(exact.y[0], abs=2e-4)
    assert run["b.a"] + run["b.b"] + run["b.c"] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("method", IMPLICIT)
def test_van_der_pol_with_mu_1000_between_its_jumps(method):
    def rate(t, x):
        return [x[1], 1000 * (1 - x[0] ** 2) * x[1] - x[0]]

    exact = solve_ivp(rate, (0, 600), [2, 0], "Radau", rtol=1e-10, atol=1e-12, t_eval=[100.0, 400.0, 600.0])
    run = tsm.simulate(alone(VanDerPol()), stop=600.0, step=0.5, method=method)
    assert run["y"][[200, 800, 1200]] == pytest.approx(exact.y[0], abs=1e-3)


def test_a_stiff_contact_comes_to_rest():
    d = tsm.Diagram(title="c", blocks=dict(f=Step(time=0.0, before=-10.0, after=-10.0), b=Contact()), wires=["f -> b"])
    run = tsm.simulate(d, stop=2.0, method="sdirk2")
    assert run["b.x"][-1] == pytest.approx(-10.0 / 1e7, rel=1e-3)
    assert abs(run["b.v"][-1]) < 1e-3


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("method", IMPLICIT)
def test_sensitivities_are_those_of_the_discrete_solution(method, backend):
    d, options = motor_loop(), dict(stop=0.3, step=0.01, inputs={"r": 0.2}, method=method, backend=backend)
    names = ["k.gain", "c.a", "slow.time_constant", "i.integral"]
    made = tsm.sensitivities(d, names, **options)
    run = tsm.simulate(d, **options)
    assert made.y[:, 0] == pytest.approx(run["y"], abs=1e-12)
    for k, one in enumerate(names):
        value = d.parameters[one]
        ends = [tsm.simulate(d, parameters={one: value + s}, **options) for s in (1e-5, -1e-5)]
        for j, signal in enumerate(made.signals):
            wanted = (ends[0][signal] - ends[1][signal]) / 2e-5
            assert made.jacobian[:, j, k] == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("method", IMPLICIT)
def test_every_way_to_run_agrees(method):
    d, options = motor_loop(), dict(stop=0.5, step=0.01, inputs={"r": 1.0}, method=method)
    run = tsm.simulate(d, **options)
    assert tsm.simulate(d, backend="casadi", **options)["y"] == pytest.approx(run["y"], abs=1e-12)
    gains = np.array([2.0, 8.0, 20.0])
    batch = np.asarray(tsm.simulate_batch(d, {"k.gain": gains}, **options)["y"])
    for k, gain in enumerate(gains):
        single = tsm.simulate(d, parameters={"k.gain": gain}, **options)["y"]
        assert batch[k] == pytest.approx(single, abs=1e-11)
    stepper = tsm.Stepper(d, step=0.01, method=method)
    for _ in range(50):
        last = stepper.step({"r": 1.0})
    assert last["y"] == pytest.approx(run["y"][-1], abs=1e-14)
    first = tsm.simulate(d, **{**options, "stop": 0.2})
    assert tsm.simulate(d, initial=first.state, **options)["y"] == pytest.approx(run["y"][20:], abs=1e-14)


def test_a_run_may_continue_with_another_method():
    d, options = motor_loop(), dict(step=2e-4, inputs={"r": 1.0})
    whole = tsm.simulate(d, stop=0.5, **options)
    first = tsm.simulate(d, stop=0.2, **options)
    for method in IMPLICIT:
        rest = tsm.simulate(d, stop=0.5, initial=first.state, method=method, **options)
        assert rest["y"] == pytest.approx(whole["y"][1000:], abs=1e-5)
        back = tsm.simulate(d, stop=0.8, initial=rest.state, **options)
        assert np.isfinite(back["y"]).all()


@pytest.mark.parametrize("method", ["sdirk2", "sdirk4"])
def test_memory_samples_and_delays_are_as_with_rk4(method):
    """At a short step both converge to the same run."""
    d = tsm.Diagram(
        title="hybrid",
        blocks=dict(
            e=Sum(), pid=DiscretePID(period=0.01), sat=Saturation(low=-2.0, high=2.0), bus=DeadTime(time=0.023),
            plant=FirstOrderLag(gain=2.0, time_constant=0.3), play=Play(),
        ),
        wires=["e -> pid -> sat -> bus -> plant -> play", "plant -> e.minus"],
        inputs={"r": "e.plus"},
        outputs={"y": "plant", "p": "play"},
    )  # fmt: skip
    options = dict(stop=1.0, step=1e-3, inputs={"r": 1.0})
    with_rk4 = tsm.simulate(d, **options)
    run = tsm.simulate(d, method=method, **options)
    for name in ("y", "p"):
        assert run[name] == pytest.approx(with_rk4[name], abs=2e-5)


def test_a_large_diagram_in_pieces():
    blocks, wires, last = {"ref": Sine(amplitude=2.0, frequency=0.7)}, [], "ref"
    for k in range(120):
        blocks |= {f"f{k}": Tanh(), f"l{k}": FirstOrderLag(time_constant=1e-4 if k % 2 else 0.02)}
        wires.append(f"{last} -> f{k} -> l{k}")
        last = f"l{k}"
    d = tsm.Diagram(title="large", blocks=blocks, wires=wires, outputs={"y": last})
    run = tsm.simulate(d, stop=0.3, step=1e-3, method="sdirk3")
    fine = tsm.simulate(d, stop=0.3, step=5e-5)
    assert run["l3.y"][20:] == pytest.approx(fine["l3.y"][::20][20:], abs=2e-4)
    assert run["y"] == pytest.approx(fine["y"][::20], abs=2e-4)


def test_located_switches_keep_the_order():
    d = tsm.Diagram(
        title="limit",
        blocks=dict(
            r=Sine(amplitude=2.0, frequency=0.7), s=Saturation(low=-0.5, high=0.5), g=FirstOrderLag(time_constant=0.1)
        ),
        wires=["r -> s -> g"],
    )
    fine = tsm.simulate(d, stop=1.0, step=1e-4, locate=True)["g.y"][::100]
    run = tsm.simulate(d, stop=1.0, step=0.01, method="sdirk4", locate=True)
    assert len(run.events) > 2
    assert run["g.y"] == pytest.approx(fine, abs=1e-7)


@needs_compiler
@pytest.mark.parametrize("method", IMPLICIT)
def test_c_code_takes_the_same_steps(tmp_path, method):
    d, steps = motor_loop(), 200
    values = np.random.default_rng(1).normal(size=(steps, 1)).cumsum(axis=0) / 10
    mine = engine_rows(d, ["r"], values, 0.01, steps, method)
    assert c_rows(d, tmp_path, values, 0.01, steps, method=method) == pytest.approx(mine, rel=1e-11, abs=1e-12)


def test_no_step_is_too_long_for_a_fast_pole(recwarn):
    d = tsm.Diagram(title="rc", blocks=dict(r=Sine(), g=FirstOrderLag(time_constant=1e-5)), wires=["r -> g"])
    tsm.simulate(d, stop=0.1, method="sdirk2")
    assert not [one for one in recwarn if issubclass(one.category, StepWarning)]


def test_a_motor_with_its_real_inductance():
    d = tsm.Diagram(title="m", blocks=dict(m=DCMotor(L=1e-6)), wires=[], inputs={"u": "m.u"})
    fine = tsm.simulate(d, stop=0.05, step=2e-7, inputs={"u": 12.0}, every=5000)
    run = tsm.simulate(d, stop=0.05, step=1e-3, inputs={"u": 12.0}, method="sdirk3")
    assert run["m.v"] == pytest.approx(fine["m.v"], rel=1e-3, abs=1e-2)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_step_without_a_solution_says_where(backend):
    """x' = -10 sign(x) comes to rest at a jump, where the equations of a stage have no solution."""
    d = tsm.Diagram(title="jump", blocks=dict(s=Sign(), k=Gain(gain=-10.0), i=Integrator()), wires=["i -> s -> k -> i"])
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(d, stop=0.1, method="sdirk2", initial={"i.integral": 0.0123}, backend=backend)
    assert str(caught.value) == (
        "the equations of sdirk2 for the step to t = 0.002 s have no solution that Newton's method finds, first in "
        "i.integral. One step before: i.integral = 0.0023. A discontinuity (a sign, a comparison) may leave them "
        "without a solution: where a state passes a discontinuity, use locate=True; where a state rests at one, "
        "replace it by a continuous function. A state that grows without bound needs a shorter step."
    )
    assert caught.value.block == "i"


@pytest.mark.parametrize("method", IMPLICIT)
def test_a_state_that_passes_a_jump_needs_located_switches(method):
    """l' = (sign(s - i) - l) / 1e-4 and i' = l, with a sine s that i follows and passes."""
    d = tsm.Diagram(
        title="switch",
        blocks=dict(s=Sine(frequency=0.5), e=Sum(), r=Sign(), l=FirstOrderLag(time_constant=1e-4), i=Integrator()),
        wires=["s -> e.plus", "e -> r -> l -> i -> e.minus"],
    )
    with pytest.raises(NotFinite, match="where a state passes a discontinuity, use locate=True"):
        tsm.simulate(d, stop=4.0, step=0.01, method=method)
    run = tsm.simulate(d, stop=4.0, step=0.01, method=method, locate=True)
    fine = tsm.simulate(d, stop=4.0, step=1e-5, every=1000)
    assert run["i.y"] == pytest.approx(fine["i.y"], abs=2e-4)
    assert {event.block for event in run.events} == {"r"}


def test_located_switches_are_refused_beside_a_nonlinear_loop():
    with pytest.raises(RunError, match=r"'sdirk2' with a nonlinear algebraic loop\. Remove one of them, or use 'rk4'"):
        tsm.simulate(motor_loop(), stop=1.0, inputs={"r": 1.0}, method="sdirk2", locate=True)


@pytest.mark.parametrize("method", ["sdirk2", "sdirk3", "sdirk4"])
def test_a_loop_at_samples_alone_goes_with_an_implicit_method(method):
    """A held signal that feeds the sine of itself back: solved at samples, and nothing between them."""

    @tsm.function_block(register=False)
    def bent(u, v):
        return 0.3 * ca.sin(u) + v

    d = tsm.Diagram(
        title="held",
        blocks=dict(r=Sine(), b=bent(), hold=ZeroOrderHold(period=0.03), lag=FirstOrderLag(time_constant=0.1)),
        wires=["r -> b.v", "b -> hold -> b.u", "hold -> lag"],
    )
    run, wanted = (tsm.simulate(d, stop=0.6, step=0.01, method=one) for one in (method, "rk4"))
    assert run["hold.y"] == pytest.approx(wanted["hold.y"], abs=1e-13)
    assert run["lag.y"] == pytest.approx(wanted["lag.y"], abs=1e-4)
