"""Algebraic loops: against closed forms, SciPy and differences; on every way to run; and what has no solution."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from tsmblocks.block import Block, Input, Output, block, parameter

import tsmblocks as tsm
from tests.test_export import c_rows, engine_rows, needs_compiler
from tsmblocks.blocks import (
    DeadTime,
    Derivative,
    Divide,
    FirstOrderLag,
    Gain,
    Integrator,
    Play,
    Product,
    Ramp,
    Ripple,
    Saturation,
    Sine,
    Step,
    Sum,
    ZeroOrderHold,
)
from tsmblocks.cli import main
from tsmblocks.common.errors import AlgebraicLoop, NotFinite, RunError, TsmError
from tsmblocks.draw.compose import layout
from tsmblocks.engine import jit
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.plan import plan_for
from tsmblocks.engine.register_kernel import RegisterKernel

BACKENDS = ["llvm", "casadi"]


@block(register=False)
class Cubic(Block):
    """y = u + a u^3."""

    a: float = parameter(default=1.0, about="share of the cube")
    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=u.u + self.a * u.u**3)


@block(register=False)
class Square(Block):
    """y = u^2."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=u.u**2)


@block(register=False)
class Orifice(Block):
    """y = sign(u) sqrt(|u|), whose derivative at 0 is infinite."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=ca.sign(u.u) * ca.sqrt(ca.fabs(u.u)))


@block(register=False)
class Root(Block):
    """y = sqrt(u)."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=ca.sqrt(u.u))


@block(register=False)
class Unless(Block):
    """y = 1 unless u is 0: a constant derivative, and yet not linear."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=ca.if_else(u.u, 1.0, 0.0))


@block(register=False)
class Sign(Block):
    """y = sign(u)."""

    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=ca.sign(u.u))


@block(register=False)
class Bent(Block):
    """y = gain tanh(u)."""

    gain: float = parameter(default=1.0, about="gain")
    u = Input("input")
    y = Output("output")

    def outputs(self, t, x, u):
        return dict(y=self.gain * ca.tanh(u.u))


def ring(inner, signs="+-", ref=None, **more):
    """error = ref - inner(error), or with a plus."""
    first, second = ("plus", "minus") if signs == "+-" else ("plus1", "plus2")
    return tsm.Diagram(
        title="ring",
        blocks=dict(ref=ref or Sine(amplitude=2.0, frequency=0.7), error=Sum(signs=signs), k=inner, **more),
        wires=[f"ref -> error.{first}", f"error -> k -> error.{second}"],
        outputs={"y": "error"},
    )


def cardano(u):
    """The root of e + e + e^3 = u."""
    s = np.sqrt(u * u / 4 + 8 / 27)
    return np.cbrt(u / 2 + s) + np.cbrt(u / 2 - s)


# ---- closed forms


def test_a_linear_loop_whose_fixed_point_iteration_diverges_is_solved_exactly():
    run = tsm.simulate(ring(Gain(gain=3.0)), stop=1.0)
    assert np.array_equal(run["y"], run["ref.y"] / 4)
    assert run.loops[0].linear
    assert run.loops[0].path == ("error.y", "k.y", "error.y")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("locate", [False, True])
def test_loops_with_a_kink_or_a_curve_follow_their_closed_forms(backend, locate):
    run = tsm.simulate(ring(Saturation(low=-0.4, high=0.4)), stop=1.0, backend=backend, locate=locate)
    u = run["ref.y"]
    assert run["y"] == pytest.approx(np.where(abs(u) < 0.8, u / 2, u - 0.4 * np.sign(u)), abs=1e-14)
    run = tsm.simulate(ring(Cubic()), stop=1.0, backend=backend, locate=locate)
    assert run["y"] == pytest.approx(cardano(run["ref.y"]), abs=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("size", [1e-9, 1e-13, 1e-40])
def test_small_signals_are_solved_as_exactly_as_large_ones(size, backend):
    d = ring(Cubic(a=1 / size**2), ref=Sine(amplitude=2.0 * size, frequency=0.7))
    run = tsm.simulate(d, stop=2.0, step=0.01, backend=backend)
    assert run["y"] / size == pytest.approx(cardano(run["ref.y"] / size), abs=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_loop_that_rests_at_zero_but_for_rounding_is_solved_at_once(backend):
    """e = (r - 0.1 r - 0.9 r) - e^3: what is left of r is its rounding."""
    d = tsm.Diagram(
        title="rest",
        blocks=dict(r=Sine(amplitude=7.0), a=Gain(gain=0.1), b=Gain(gain=0.9), s=Sum(signs="+---"), c=Cubic(a=1.0)),
        wires=["r -> a -> s.minus1", "r -> b -> s.minus2", "r -> s.plus", "s -> c -> s.minus3"],
    )
    run = tsm.simulate(d, stop=2.0, step=0.01, backend=backend)
    assert run["s.y"] == pytest.approx(0.0, abs=1e-14)
    assert run.loops[0].mean_iterations < 4


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condition_on_the_signal_itself_is_not_linear(backend):
    """e + (1 unless e is 0) = 3."""
    run = tsm.simulate(ring(Unless(), ref=Ramp(slope=0.0, initial=3.0)), stop=0.1, step=0.01, backend=backend)
    assert run["y"] == pytest.approx(2.0)
    assert not run.loops[0].linear


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_loop_is_not_solved_where_its_derivative_is_infinite(backend):
    """From 0, where a square root is infinitely steep, Newton's correction is 0 though e + sqrt(e) is not 3."""
    run = tsm.simulate(ring(Root(), ref=Ramp(slope=0.0, initial=3.0)), stop=0.1, step=0.01, backend=backend)
    assert run["y"] == pytest.approx(((np.sqrt(13.0) - 1) / 2) ** 2, rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_reset_beside_a_loop_is_located(backend):
    """The rate is the root of e + 2 tanh(e) = 1; the integral is reset at 0.5."""
    d = tsm.Diagram(
        title="reset",
        blocks=dict(one=Ramp(slope=0.0, initial=1.0), e=Sum(), k=Bent(gain=2.0), i=Integrator(reset=True)),
        wires=["one -> e.plus", "e -> k -> e.minus", "e -> i.u", "i -> i.reset"],
    )
    run = tsm.simulate(d, stop=4.0, step=0.01, locate=True, backend=backend)
    rate = brentq(lambda v: v + 2 * np.tanh(v) - 1, 0, 1, xtol=1e-15)
    assert len(run.events) == int(4.0 * rate / 0.5)
    assert run["i.y"][-1] == pytest.approx(4.0 * rate % 0.5, abs=1e-10)


def orifice(u):
    """The root of e + sign(e) sqrt(|e|) = u."""
    return np.sign(u) * ((np.sqrt(1 + 4 * abs(u)) - 1) / 2) ** 2


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("height", [1e-3, 1.0, 1e5])
def test_a_loop_with_an_orifice_passes_through_zero(backend, height):
    d = ring(Orifice(), ref=Sine(amplitude=height, frequency=0.7))
    run = tsm.simulate(d, stop=2.0, step=0.01, backend=backend)
    assert run["y"] == pytest.approx(orifice(run["ref.y"]), rel=1e-7, abs=1e-13)


def test_a_loop_through_a_product_has_a_coefficient_that_changes():
    blocks = dict(ref=Sine(amplitude=2.0), ramp=Ramp(), e=Sum(), m=Product())
    wires = ["ref -> e.plus", "ramp -> m.u1", "e -> m.u2", "m -> e.minus"]
    run = tsm.simulate(tsm.Diagram(title="p", blocks=blocks, wires=wires), stop=2.0)
    assert run["e.y"] == pytest.approx(run["ref.y"] / (1 + run["ramp.y"]), abs=1e-15)
    assert run.loops[0].linear


@pytest.mark.parametrize("size", [2, 3, 5, 8])
def test_coupled_linear_loops_against_a_linear_solver(size):
    a = np.random.default_rng(size).normal(size=(size, size))
    blocks = {"ref": Sine(amplitude=2.0, frequency=0.7)}
    wires = []
    for i in range(size):
        blocks[f"s{i}"] = Sum(signs="+" * (size + 1))
        wires.append(f"ref -> s{i}.plus1")
        for j in range(size):
            blocks[f"g{i}_{j}"] = Gain(gain=float(a[i, j]))
            wires += [f"s{j} -> g{i}_{j}", f"g{i}_{j} -> s{i}.plus{j + 2}"]
    run = tsm.simulate(tsm.Diagram(title="coupled", blocks=blocks, wires=wires), stop=1.0, step=0.01)
    wanted = np.linalg.solve(np.eye(size) - a, np.ones(size))
    for i in range(size):
        assert run[f"s{i}.y"] == pytest.approx(wanted[i] * run["ref.y"], rel=1e-11, abs=1e-11)
    assert all(loop.linear for loop in run.loops)


def test_a_loop_through_the_derivative_of_a_lag_makes_it_slower():
    """x' = (r - d x' - x) / T is a lag of T + d."""
    blocks = dict(ref=Step(time=0.0), e=Sum(), lag=FirstOrderLag(time_constant=0.2), d=Derivative(), k=Gain(gain=0.3))
    wires = ["ref -> e.plus", "e -> lag -> d -> k -> e.minus"]
    run = tsm.simulate(tsm.Diagram(title="d", blocks=blocks, wires=wires), stop=2.0)
    assert run["lag.y"] == pytest.approx(1 - np.exp(-run.t / 0.5), abs=1e-11)


def test_a_plant_around_a_nonlinear_loop_against_scipy():
    d = tsm.Diagram(
        title="plant",
        blocks=dict(
            ref=Sine(amplitude=2.0, frequency=0.7),
            e=Sum(signs="+--"),
            k=Cubic(),
            lag=FirstOrderLag(gain=5.0, time_constant=1.0),
        ),
        wires=["ref -> e.plus", "e -> k -> e.minus1", "e -> lag -> e.minus2"],
    )
    run = tsm.simulate(d, stop=3.0, step=2e-3)

    def rate(t, x):
        return 5.0 * cardano(2.0 * np.sin(2 * np.pi * 0.7 * t) - x) - x

    exact = solve_ivp(rate, (0.0, 3.0), [0.0], rtol=1e-12, atol=1e-13, t_eval=run.t)
    assert run["lag.y"] == pytest.approx(exact.y[0], abs=1e-10)


# ---- random loops


FORMS = {
    "gain": (Gain(gain=0.8), lambda v: 0.8 * v),
    "bent": (Bent(gain=0.9), lambda v: 0.9 * np.tanh(v)),
    "limit": (Saturation(low=-0.5, high=0.7), lambda v: np.clip(v, -0.5, 0.7)),
    "cubic": (Cubic(a=0.2), lambda v: v + 0.2 * v**3),
}


def random_loops(seed):
    """Signals v_i = b_i r + sum of a_ij f_j(v_j) as a diagram, and the residual of these equations."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    a, b, kinds = np.zeros((n, n)), rng.normal(size=n), rng.choice(list(FORMS), size=n)
    blocks, wires = {"ref": Sine(amplitude=1.3, frequency=0.7)}, []
    for i in range(n):
        sources = rng.choice(n, size=int(rng.integers(1, min(3, n) + 1)), replace=False)
        blocks |= {f"r{i}": Gain(gain=float(b[i])), f"s{i}": Sum(signs="+" * (len(sources) + 1))}
        blocks[f"f{i}"] = FORMS[kinds[i]][0]
        wires += [f"ref -> r{i} -> s{i}.plus1", f"s{i} -> f{i}"]
        for place, j in enumerate(sources, 2):
            a[i, j] = rng.uniform(-0.5, 0.5)
            blocks[f"g{i}_{j}"] = Gain(gain=float(a[i, j]))
            wires.append(f"f{j} -> g{i}_{j} -> s{i}.plus{place}")

    def residual(v, r):
        return b * r + a @ np.array([FORMS[kind][1](one) for kind, one in zip(kinds, v, strict=True)]) - v

    return tsm.Diagram(title=f"random {seed}", blocks=blocks, wires=wires), residual, n


@pytest.mark.parametrize("seed", range(12))
def test_random_loops_against_the_root_that_scipy_finds(seed):
    d, residual, n = random_loops(seed)
    run = tsm.simulate(d, stop=1.0, step=0.02)
    for k in range(0, len(run.t), 7):
        mine = np.array([run[f"s{i}.y"][k] for i in range(n)])
        found = root(residual, mine, args=(run["ref.y"][k],), tol=1e-13)
        assert mine == pytest.approx(found.x, rel=1e-10, abs=1e-10)


# ---- samples, memory, delays


def test_a_loop_at_the_samples_is_closed_at_the_samples():
    blocks = dict(ref=Sine(frequency=0.7), e=Sum(), hold=ZeroOrderHold(period=0.1), k=Cubic())
    wires = ["ref -> e.plus", "e -> hold -> k -> e.minus"]
    run = tsm.simulate(tsm.Diagram(title="s", blocks=blocks, wires=wires), stop=1.0, step=0.01)
    at = np.arange(len(run.t)) // 10 * 10
    assert run["hold.y"] == pytest.approx(cardano(run["ref.y"][at]), abs=1e-13)
    assert [loop.linear for loop in run.loops] == [False]
    blocks["k"] = Gain(gain=3.0)
    run = tsm.simulate(tsm.Diagram(title="s", blocks=blocks, wires=wires), stop=1.0, step=0.01)
    assert run["hold.y"] == pytest.approx(run["ref.y"][at] / 4, abs=1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_dead_time_shorter_than_the_step_closes_a_loop(backend):
    """y(t) = r(t) - y(t - 4 ms) / 2 at steps of 10 ms: interpolated with the present value."""
    d = tsm.Diagram(
        title="late",
        blocks=dict(ref=Sine(frequency=0.3), e=Sum(), k=Gain(gain=0.5), late=DeadTime(time=0.004)),
        wires=["ref -> e.plus", "e -> k -> late -> e.minus"],
    )
    run = tsm.simulate(d, stop=4.0, step=0.01, backend=backend)
    w = 2 * np.pi * 0.3
    settled = (Sine().amplitude / (1 + 0.5 * np.exp(-1j * w * 0.004)) * np.exp(1j * w * run.t)).imag
    assert run["e.y"][200:] == pytest.approx(settled[200:], abs=1e-7)


def test_memory_in_a_loop_keeps_its_state():
    """A play passes its input on while it is engaged: the loop goes through the memory of the last step."""
    run = tsm.simulate(ring(Play()), stop=2.0)
    assert np.isfinite(run["y"]).all()
    assert run["y"] == pytest.approx(run["ref.y"] - run["k.y"], abs=1e-12)


# ---- every way to run


def plant(kind=Cubic, **parameters):
    return tsm.Diagram(
        title="plant",
        blocks=dict(e=Sum(signs="+--"), k=kind(**parameters), lag=FirstOrderLag(gain=5.0), i=Integrator()),
        wires=["e -> k -> e.minus1", "e -> lag -> i -> e.minus2"],
        inputs={"r": "e.plus"},
        outputs={"y": "i", "e": "e"},
    )


def test_a_continued_run_and_a_stepper_give_the_same_numbers():
    d, r = plant(), {"r": 1.5}
    whole = tsm.simulate(d, stop=2.0, inputs=r)
    first = tsm.simulate(d, stop=1.0, inputs=r)
    second = tsm.simulate(d, stop=2.0, inputs=r, initial=first.state)
    assert np.array_equal(whole["y"][1000:], second["y"])
    assert second.loops[0].solved < whole.loops[0].solved
    stepper = tsm.Stepper(d)
    for _ in range(2000):
        last = stepper.step(r)
    assert last["y"] == pytest.approx(whole["y"][-1], abs=1e-15)


def test_batches_on_lanes_and_both_back_ends_agree_with_single_runs():
    d, gains = plant(), np.linspace(0.1, 8.0, 11)
    options = dict(stop=1.0, inputs={"r": 1.5})
    single = [tsm.simulate(d, parameters={"k.a": a}, **options)["y"] for a in gains]
    for backend in BACKENDS:
        made = tsm.simulate_batch(d, {"k.a": gains}, backend=backend, **options)["y"]
        assert np.asarray(made).reshape(np.shape(single)) == pytest.approx(np.array(single), abs=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("kind", "name"), [(Cubic, "k.a"), (Gain, "k.gain"), (Bent, "k.gain")])
def test_sensitivities_go_through_loops(backend, kind, name):
    d, options = plant(kind), dict(stop=1.0, step=0.01, inputs={"r": 1.5}, backend=backend)
    names = [name, "lag.gain", "i.integral"]
    made = tsm.sensitivities(d, names, **options)
    for k, one in enumerate(names):
        value = d.parameters[one]
        ends = [tsm.simulate(d, parameters={one: value + s}, **options) for s in (1e-4, -1e-4)]
        for j, signal in enumerate(made.signals):
            wanted = (ends[0][signal] - ends[1][signal]) / 2e-4
            assert made.jacobian[:, j, k] == pytest.approx(wanted, abs=1e-6)


def first_order():
    """A lag around a loop, so that the operating point depends on the loop."""
    return tsm.Diagram(
        title="lag",
        blocks=dict(e=Sum(signs="+--"), k=Cubic(), lag=FirstOrderLag(gain=5.0, time_constant=1.0)),
        wires=["e -> k -> e.minus1", "e -> lag -> e.minus2"],
        inputs={"r": "e.plus"},
        outputs={"y": "lag"},
    )


def test_linear_models_and_operating_points_go_through_loops():
    d = plant()
    point = tsm.trim(d, inputs={"r": 1.5})
    assert point["y"] == pytest.approx(1.5, abs=1e-9)  # an integrator leaves no error
    point = tsm.trim(first_order(), inputs={"r": 1.5})
    model = tsm.linearize(first_order(), at=point)
    e = cardano(1.5 - point["y"])
    slope = 1 / (2 + 3 * e * e)
    assert np.asarray(model.A) == pytest.approx(np.array([[-1.0 - 5 * slope]]), abs=1e-9)


def test_a_fit_finds_a_parameter_inside_a_loop():
    t = np.arange(0.0, 5.0, 0.01)
    r = np.sin(2.0 * t) + 0.5
    truth = tsm.simulate(plant(a=2.3), stop=t[-1], step=0.01, inputs={"r": (t, r)})
    record = tsm.Record("sine", t, {"r": r, "y": truth["y"]}, {"r": "1", "y": "1"})
    fit = tsm.fit(plant(a=0.7), record, free=["k.a"], outputs=["y"])
    assert fit.diagram.parameters["k.a"] == pytest.approx(2.3, rel=1e-6)


def test_a_large_diagram_with_many_loops():
    blocks, wires, last = {"ref": Sine(amplitude=2.0, frequency=0.7)}, [], "ref"
    for k in range(150):
        blocks |= {f"e{k}": Sum(), f"k{k}": Cubic(), f"g{k}": Gain(gain=2.0), f"l{k}": FirstOrderLag(time_constant=0.1)}
        wires += [f"{last} -> e{k}.plus", f"e{k} -> k{k} -> e{k}.minus", f"e{k} -> g{k} -> l{k}"]
        last = f"l{k}"
    d = tsm.Diagram(title="large", blocks=blocks, wires=wires, outputs={"y": last})
    run = tsm.simulate(d, stop=0.5, step=0.005)
    for k in (0, 7, 149):
        before = run["ref.y"] if not k else run[f"l{k - 1}.y"]
        assert run[f"e{k}.y"] == pytest.approx(cardano(before), abs=1e-13)
    assert sum(not loop.linear for loop in run.loops) == 150


@needs_compiler
@pytest.mark.parametrize("kind", [Cubic, Gain, Saturation, Orifice])
def test_c_code_solves_loops(tmp_path, kind):
    d, steps = plant(kind), 400
    values = np.random.default_rng(1).normal(size=(steps, 1)).cumsum(axis=0) / 10
    mine = engine_rows(d, ["r"], values, 0.01, steps, "rk4")
    assert c_rows(d, tmp_path, values, 0.01, steps) == pytest.approx(mine, rel=1e-12, abs=1e-12)


@needs_compiler
def test_c_code_solves_loops_at_samples_and_of_several_signals(tmp_path):
    d = tsm.Diagram(
        title="several",
        blocks=dict(
            e=Sum(), hold=ZeroOrderHold(period=0.05), k=Cubic(), f=Sum(signs="+-+"), b=Bent(gain=0.7), c=Cubic(a=0.1)
        ),
        wires=["e -> hold -> k -> e.minus", "e -> f.plus1", "f -> b -> f.minus", "b -> c -> f.plus2"],
        inputs={"r": "e.plus"},
        outputs={"h": "hold", "f": "f"},
    )
    values = np.random.default_rng(2).normal(size=(200, 1)).cumsum(axis=0) / 10
    mine = engine_rows(d, ["r"], values, 0.01, 200, "rk4")
    assert c_rows(d, tmp_path, values, 0.01, 200) == pytest.approx(mine, rel=1e-12, abs=1e-12)


def a_loop_that_reads_much():
    """Functions of time are carried from step to step, and the loop reads more numbers than registers take."""
    return tsm.Diagram(
        title="much",
        blocks=dict(
            a=Sine(amplitude=0.8, frequency=5.8),
            b=Sine(amplitude=0.6, frequency=1.4),
            r=Gain(),
            e=Sum(signs="+-"),
            g=Gain(gain=-0.35),
            bent=Ripple(cosine=0.122, sine=-0.016, cosine2=0.1, sine2=-0.087, cycles=2.542),
            h=Gain(gain=0.83),
            back=Gain(gain=-0.46),
        ),
        wires=["r -> e.plus", "e -> g -> bent -> h -> back -> e.minus"],
        inputs={"u": "r"},
        outputs={"a": "a", "b": "b", "e": "e", "bent": "bent"},
    )


def test_lanes_keep_the_stack_aligned_where_a_loop_reads_much():
    """A place on the stack that is made behind a branch moves it, and a run of several lanes ended the process."""
    d = a_loop_that_reads_much()
    eq = tsm.equations(d)
    logged = tuple(range(len(eq.y)))
    varied = frozenset({eq.p.index("r.gain"), eq.p.index("g.gain")})
    text = RegisterKernel(plan_for(eq, method_named("rk4"), logged, lanes=4, vary=varied), jit.host()).text()
    start = text.partition("define void @run(")[2].partition("\n}")[0]
    assert " alloca " in start
    assert "@tsm_" in start
    assert start.rindex(" alloca ") < start.index("@tsm_")
    t = 0.01 * np.arange(51)
    options = dict(stop=0.5, step=0.01, inputs={"u": (t, np.cos(3 * t))}, hold="zero")
    values = {"r.gain": [1.0, 0.9, 1.1], "g.gain": [-0.35, -0.3, -0.4]}
    batch = tsm.simulate_batch(d, values, **options)
    for k in range(3):
        run = tsm.simulate(d, parameters={name: v[k] for name, v in values.items()}, **options)
        assert batch["bent"][k] == pytest.approx(run["bent"], abs=1e-13)


@needs_compiler
def test_c_code_has_no_function_for_a_loop_that_nothing_shown_depends_on(tmp_path):
    shown = tsm.Diagram(
        title="beside",
        blocks=dict(e=Sum(), k=Cubic(), lag=FirstOrderLag(time_constant=0.2)),
        wires=["e -> k -> e.minus"],
        inputs={"r": ["e.plus", "lag"]},
        outputs={"y": "lag"},
    )
    values = np.random.default_rng(3).normal(size=(50, 1))
    mine = engine_rows(shown, ["r"], values, 0.01, 50, "rk4")
    assert c_rows(shown, tmp_path, values, 0.01, 50) == pytest.approx(mine, rel=1e-12, abs=1e-12)


# ---- what is reported


def test_a_run_says_where_its_loops_are_and_how_they_were_solved():
    run = tsm.simulate(plant(), stop=1.0, inputs={"r": 1.5})
    (loop,) = run.loops
    assert loop.path == ("e.y", "k.y", "e.y")
    assert not loop.linear
    assert loop.solved >= 4000
    assert 1.0 <= loop.mean_iterations < 4.0
    assert loop.mean_iterations <= loop.most_iterations <= 20
    assert str(loop).startswith("e.y -> k.y -> e.y: solved ")
    assert tsm.simulate(ring(Gain(gain=3.0)), stop=0.1).loops[0].solved == 0


def test_loops_are_drawn_in_the_accent_colour_with_a_mark_where_they_are_solved():
    inner = tsm.Diagram(title="gain", blocks=dict(g=Gain(gain=3.0)), inputs=dict(u="g"), outputs=dict(y="g"))
    d = tsm.Diagram(
        title="loop",
        blocks=dict(r=Sine(), e=Sum(signs="+-"), c=inner, s=Saturation(low=-1.0, high=1.0), lag=FirstOrderLag()),
        wires=["r -> e.plus", "e -> c -> s -> e.minus", "s -> lag"],
        outputs=dict(y="lag"),
    )
    run = tsm.simulate(d, stop=0.1)
    picture = layout(d, loops=run.loops)
    assert {w.signal for w in picture.wires if w.accent} == {"e.y", "c.y", "s.y"}
    marked = {w.signal: [one.text for one in w.labels] for w in picture.wires if w.labels}
    assert marked == {run.loops[0].path[0]: ["↻"]}
    assert "in an algebraic loop that is solved for it" in tsm.to_svg(d, loops=run.loops)
    assert tsm.to_svg(d, loops=[]) == tsm.to_svg(d)
    # From outside, the block with the loop in it is marked.
    around = tsm.Diagram(title="around", blocks=dict(part=d), outputs=dict(y="part"))
    assert [b.accent for b in layout(around, loops=tsm.simulate(around, stop=0.1).loops).boxes if b.name == "part"] == [
        True
    ]
    with pytest.raises(TsmError, match=r"has no signal 'q\.y' of an algebraic loop"):
        tsm.to_svg(d, loops=[["q.y", "e.y", "q.y"]])


def test_the_command_draws_loops(tmp_path):
    d = tsm.Diagram(
        title="loop",
        blocks=dict(r=Sine(), e=Sum(signs="+-"), k=Gain(gain=3.0)),
        wires=["r -> e.plus", "e -> k -> e.minus"],
        outputs=dict(y="k"),
    )
    tsm.save(d, tmp_path / "loop.toml")
    assert main(["draw", str(tmp_path / "loop.toml"), "--out", str(tmp_path / "loop.svg")]) == 0
    assert "↻" in (tmp_path / "loop.svg").read_text(encoding="utf-8")


def test_a_diagram_without_loops_reports_none():
    assert tsm.simulate(tsm.load("motor_linear"), stop=0.1, inputs={"u": 1.0}).loops == ()


# ---- what has no solution


def test_loops_are_refused_on_request():
    with pytest.raises(AlgebraicLoop, match=r"error\.y -> k\.y -> error\.y has no state in it") as caught:
        tsm.simulate(ring(Gain(gain=3.0)), stop=1.0, loops="refuse")
    assert caught.value.path == ("error.y", "k.y", "error.y")
    assert len(tsm.simulate(ring(Gain(gain=3.0)), stop=1.0).t) == 1001
    with pytest.raises(RunError, match="loops must be 'solve' or 'refuse', got 'refused'"):
        tsm.simulate(ring(Gain(gain=3.0)), stop=1.0, loops="refused")


def test_a_loop_that_passes_its_value_on_unchanged_is_an_error_when_it_is_compiled():
    blocks = dict(ref=Sine(), a=Sum(signs="++"), b=Sum(signs="++"))
    wires = ["ref -> a.plus1", "ref -> b.plus1", "a -> b.plus2", "b -> a.plus2"]
    with pytest.raises(AlgebraicLoop, match="passes its own value on unchanged"):
        tsm.simulate(tsm.Diagram(title="one", blocks=blocks, wires=wires), stop=1.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_singular_loop_names_its_path_and_the_instant(backend):
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(ring(Gain(gain=1.0), "++"), stop=1.0, backend=backend)
    assert str(caught.value) == (
        "the algebraic loop error.y -> k.y -> error.y is singular at t = 0 s: its loop gain is 1, so it has no "
        "solution, or infinitely many. Change a gain, or break it with a block that has a state (a lag, an "
        "integrator)."
    )
    blocks = dict(ref=Sine(), ramp=Ramp(), e=Sum(signs="++"), m=Product())
    wires = ["ref -> e.plus1", "ramp -> m.u1", "e -> m.u2", "m -> e.plus2"]
    with pytest.raises(NotFinite, match=r"e\.y -> m\.y -> e\.y is singular at t = 1 s") as caught:
        tsm.simulate(tsm.Diagram(title="p", blocks=blocks, wires=wires), stop=2.0, step=0.125, backend=backend)
    assert caught.value.time == 1.0
    assert caught.value.block == "e"
    assert caught.value.run.t[-1] == 0.875


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_loop_without_a_solution_names_its_path_and_the_instant(backend):
    """e = r + e^2 has a solution up to r = 1/4."""
    d = ring(Square(), "++", ref=Ramp(slope=0.5))
    with pytest.raises(NotFinite) as caught:
        tsm.simulate(d, stop=1.0, step=0.01, backend=backend)
    assert caught.value.time == pytest.approx(0.51)
    text = str(caught.value)
    assert text.startswith("the algebraic loop error.y -> k.y -> error.y has no solution at t = 0.51 s")
    assert "One step before: error.y = 0.5, k.y = 0.25." in text
    run = caught.value.run
    assert run["y"][:-1] == pytest.approx((1 - np.sqrt(1 - 2 * run.t[:-1])) / 2, abs=1e-12)


def test_a_loop_around_a_jump_may_have_no_solution():
    with pytest.raises(NotFinite, match="A discontinuity"):
        tsm.simulate(ring(Sign(), "+-", ref=Ramp(slope=0.1)), stop=0.5)  # e = 0.1 t - sign(e)


def test_a_division_in_a_loop_starts_where_it_is_defined():
    """e = r / e, from 0 where it is not defined: the root of r."""
    blocks = dict(ref=Ramp(initial=1.0), d=Divide())
    d = tsm.Diagram(title="root", blocks=blocks, wires=["ref -> d.num", "d -> d.den"])
    run = tsm.simulate(d, stop=1.0)
    assert abs(run["d.y"]) == pytest.approx(np.sqrt(run["ref.y"]), rel=1e-12)


def test_scalar_loops_against_brent():
    run = tsm.simulate(ring(Bent(gain=4.0)), stop=1.0, step=0.01)
    for u, e in zip(run["ref.y"][::9], run["y"][::9], strict=True):
        assert e == pytest.approx(brentq(lambda v, u=u: u - 4 * np.tanh(v) - v, -20, 20, xtol=1e-15), abs=1e-12)
