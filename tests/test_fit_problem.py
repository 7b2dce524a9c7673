"""A fit as mathematics: the quadratic step, residuals, exact derivatives, costs in lanes, recordings made ready."""

import attrs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import tsmblocks as tsm
from tests.tolerances import BACKENDS
from tsmblocks.blocks import DiscretePID, FirstOrderLag, Gain, Integrator, Play, Sum, ZeroOrderHold
from tsmblocks.common.errors import ParameterError
from tsmblocks.fitting.optimizer import feasible_start
from tsmblocks.fitting.quadratic_program import Infeasible, quadratic_step
from tsmblocks.fitting.setup import pose

STEP = 0.01
T = STEP * np.arange(301)
U = 0.6 * np.sin(2.1 * T + 0.3) + 0.4 * np.sin(5.3 * T)


def record(name="a", t=T, units=None, **signals):
    return tsm.Record(name, t, signals, units or {})


# ---- the quadratic step


def programme(seed, n, m, equalities, kind="feasible"):
    """A strictly convex programme and a point that meets its constraints."""
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(n + 1, n)) * 10.0 ** rng.uniform(-2, 2, size=n)
    size = np.sqrt(np.diag(M.T @ M)) + 1e-3
    H = M.T @ M / np.outer(size, size) + 1e-6 * np.eye(n)
    inside = rng.uniform(-1, 1, n)
    rows = np.vstack([rng.normal(size=(m, n)), np.eye(n), -np.eye(n)])
    if kind == "degenerate" and m:
        rows[0] = rows[-1]
        rows[m // 2] = 0.0
    slack = rng.uniform(0, 0.5, len(rows)) * (rng.random(len(rows)) < 0.6)
    slack[-n:] += 0.1  # bounds leave room between them
    equal = np.arange(len(rows)) < equalities
    return H, 5 * rng.normal(size=n), rows, rows @ inside - np.where(equal, 0.0, slack), equal, inside


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 8),
    m=st.integers(0, 6),
    data=st.data(),
    kind=st.sampled_from(["feasible", "degenerate"]),
)
def test_a_step_meets_the_conditions_of_a_minimum(seed, n, m, data, kind):
    equalities = data.draw(st.integers(0, min(m, n - 1)))
    H, g, rows, bounds, equal, _ = programme(seed, n, m, equalities, kind)
    d, force = quadratic_step(H, g, rows, bounds, equal)
    left = rows @ d - bounds
    np.testing.assert_allclose(H @ d + g, rows.T @ force, atol=1e-6 * np.abs(g).max())  # forces balance
    assert left.min() > -1e-8  # all constraints hold
    assert np.abs(left[equal]).max(initial=0.0) < 1e-8
    assert force[~equal].min() >= -1e-9  # inequalities only push
    assert np.abs(force * left).max() < 1e-6 * np.abs(g).max()  # and only where they touch


@pytest.mark.parametrize("seed", [230, 31717])
def test_a_single_direction_on_which_bounds_touch_has_a_minimum(seed):
    H, g, rows, bounds, equal, _ = programme(seed, 7, 6, 6)  # six equalities of seven unknowns
    d, force = quadratic_step(H, g, rows, bounds, equal)
    assert np.abs((rows @ d - bounds)[equal]).max() < 1e-8
    assert (rows @ d - bounds).min() > -1e-8
    assert force[~equal].min() >= -1e-9
    np.testing.assert_allclose(H @ d + g, rows.T @ force, atol=1e-6 * np.abs(g).max())


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
def test_no_point_that_meets_the_constraints_is_lower(seed, n):
    H, g, rows, bounds, equal, inside = programme(seed, n, 3, 0)
    d, _ = quadratic_step(H, g, rows, bounds, equal)

    def value(x):
        return 0.5 * x @ H @ x + g @ x

    along = inside + np.linspace(0, 1, 20)[:, None] * (d - inside)  # the set is convex, so all of these are in it
    assert value(d) <= min(value(x) for x in along) + 1e-9 * abs(value(d))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), gap=st.floats(1e-3, 10.0), both=st.booleans())
def test_constraints_that_exclude_each_other_are_found_out(seed, n, gap, both):
    H, g, rows, bounds, equal, _ = programme(seed, n, 2, 0)
    a = np.random.default_rng(seed).normal(size=n)
    rows, bounds = np.vstack([rows, a, -a]), np.concatenate([bounds, [1.0, gap - 1.0]])  # 1 <= a d <= 1 - gap
    with pytest.raises(Infeasible):
        quadratic_step(H, g, rows, bounds, np.concatenate([equal, [both, both]]))


def test_a_step_without_constraints_is_newtons():
    H, g, *_ = programme(3, 4, 0, 0)
    d, force = quadratic_step(H, g, np.empty((0, 4)), np.empty(0), np.empty(0, dtype=bool))
    np.testing.assert_allclose(d, -np.linalg.solve(H, g), rtol=1e-9)
    assert force.shape == (0,)


def test_an_equality_may_pull_or_push():
    H, row = np.eye(2), np.array([[1.0, 1.0]])
    for value in (2.0, -2.0):
        d, force = quadratic_step(H, np.zeros(2), row, np.array([value]), np.array([True]))
        np.testing.assert_allclose(d, [value / 2, value / 2], rtol=1e-12)
        np.testing.assert_allclose(force, [value / 2], rtol=1e-12)


def test_an_equality_said_twice_is_one_and_said_differently_is_none():
    rows, equal = np.array([[1.0, 2.0], [2.0, 4.0]]), np.array([True, True])
    d, _ = quadratic_step(np.eye(2), np.ones(2), rows, np.array([1.0, 2.0]), equal)
    np.testing.assert_allclose(rows @ d, [1.0, 2.0], rtol=1e-12)
    with pytest.raises(Infeasible, match=r"^no step meets all constraints at once\.$"):
        quadratic_step(np.eye(2), np.ones(2), rows, np.array([1.0, 3.0]), equal)


def test_a_row_of_zeros_asks_nothing_or_too_much():
    zeros, no = np.zeros((1, 2)), np.array([False])
    d, _ = quadratic_step(np.eye(2), np.ones(2), zeros, np.array([-1.0]), no)
    np.testing.assert_allclose(d, [-1.0, -1.0])
    with pytest.raises(Infeasible):
        quadratic_step(np.eye(2), np.ones(2), zeros, np.array([1.0]), no)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), m=st.integers(0, 4), data=st.data())
def test_a_step_agrees_with_another_program(seed, n, m, data):
    """SciPy's SLSQP, which takes constraints as functions."""
    H, g, rows, bounds, equal, inside = programme(seed, n, m, data.draw(st.integers(0, min(m, n - 1))))
    parts = [("eq", equal), ("ineq", ~equal)]
    expected = minimize(
        lambda x: 0.5 * x @ H @ x + g @ x,
        inside,
        jac=lambda x: H @ x + g,
        method="SLSQP",
        constraints=[
            {"type": kind, "fun": lambda x, k=k: rows[k] @ x - bounds[k], "jac": lambda _, k=k: rows[k]}
            for kind, k in parts
            if k.any()
        ],
        options=dict(ftol=1e-15, maxiter=1000),
    )
    d, _ = quadratic_step(H, g, rows, bounds, equal)
    assert 0.5 * d @ H @ d + g @ d == pytest.approx(expected.fun, abs=1e-7 * np.abs(g).max())
    flat = np.linalg.eigvalsh(H)[0]
    np.testing.assert_allclose(d, expected.x, atol=1e-3 * np.sqrt(1e-7 / flat) + 1e-5)


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(2, 7), data=st.data(), damping=st.sampled_from([1e-13, 1e-10, 1e-7])
)
def test_a_matrix_near_to_singular_gives_a_step(seed, n, data, damping):
    """As in a fit of parameters that the outputs do not determine: the damping alone makes the step unique."""
    rng, rank = np.random.default_rng(seed), data.draw(st.integers(1, n - 1))
    J = rng.normal(size=(20, rank)) @ rng.normal(size=(rank, n))
    J /= np.linalg.norm(J, axis=0)
    H, g = J.T @ J + damping * np.eye(n), J.T @ rng.normal(size=20)
    rows = np.vstack([np.eye(n), -np.eye(n), rng.normal(size=(1, n))])
    slack = rng.uniform(0, 2, len(rows))
    equal = np.arange(len(rows)) == 2 * n
    bounds = rows @ rng.uniform(-1, 1, n) - np.where(equal, 0.0, slack)
    d, force = quadratic_step(H, g, rows, bounds, equal)
    left = rows @ d - bounds
    np.testing.assert_allclose(H @ d + g, rows.T @ force, atol=1e-6)
    assert left.min() > -1e-9
    assert abs(left[-1]) < 1e-9
    assert force[~equal].min() >= -1e-9
    assert np.abs(force * left).max() < 1e-9


@pytest.mark.parametrize(("given", "solved"), [({}, False), ({"constraints": "gain.gain < 1.5"}, True)])
def test_casadi_solves_the_steps_that_constraints_hold(monkeypatch, given, solved):
    """Without an active one a step is the solution of linear equations."""
    from tsmblocks.fitting import quadratic_program

    shapes, solver = [], quadratic_program._solver
    monkeypatch.setattr(quadratic_program, "_solver", lambda *shape: shapes.append(shape) or solver(*shape))
    diagram = tsm.Diagram(blocks=dict(gain=Gain()), wires=[], inputs={"u": "gain.u"}, outputs={"y": "gain.y"})
    found = tsm.fit(diagram, record(u=U, y=2 * U), free=["gain.gain"], starts=1, **given)
    assert found.values["gain.gain"] == pytest.approx(1.5 if solved else 2.0, rel=1e-9)
    assert bool(shapes) is solved
    assert set(shapes) <= {(1, 1)}


# ---- diagrams and recordings of many kinds


def servo():
    """A motor that drives a sheath: two outputs, states that carry on, a number used twice."""
    return tsm.Diagram(
        title="motor and sheath",
        blocks=dict(
            motor=tsm.blocks.MotorTransferFunction(tau=0.05),
            tsm=tsm.blocks.AsymmetricBoucWen(theta="$theta"),
            scale=Gain(gain="$theta"),
            offset=tsm.blocks.Bias(bias=0.1),
        ),
        wires=["motor.y -> tsm.x", "tsm -> offset", "tsm -> scale"],
        values={"theta": 4.0},
        inputs={"u": "motor.u"},
        outputs={"x_in": "motor.y", "x_out": "offset", "scaled": "scale"},
    )


def sampled():
    return tsm.Diagram(
        title="sampled loop",
        blocks=dict(
            hold=ZeroOrderHold(period=0.05),
            error=Sum(signs="+-"),
            pid=DiscretePID(period=0.05, kp=0.8, ki=1.5, kd=0.02),
            lag=FirstOrderLag(time_constant=0.2),
        ),
        wires=["error -> pid -> lag -> hold -> error.minus"],
        inputs={"r": "error.plus"},
        outputs={"y": "lag"},
    )


def delayed():
    blocks = dict(late=tsm.blocks.Delay(time=0.123), lag=FirstOrderLag(gain=1.3, time_constant=0.3))
    return tsm.Diagram(title="late", blocks=blocks, wires=["late -> lag"], inputs={"u": "late"}, outputs={"y": "lag"})


def chain(count):
    """More parameters than one run has lanes."""
    names = [f"k{i}" for i in range(count)]
    return tsm.Diagram(
        title="chain",
        blocks={n: Gain(gain=1 + 0.01 * i) for i, n in enumerate(names)},
        wires=[" -> ".join(names)],
        inputs={"u": "k0"},
        outputs={"y": names[-1]},
    )


JITTER = T + 0.003 * np.sin(37 * np.arange(len(T)))
MEASURED = {"x_in": 0.9 * U, "x_out": 0.8 * U + 0.1, "scaled": 3.0 * U}
TWO = [record("one", u=8 * U, **MEASURED), record("two", T + 5.0, u=-6 * U, **MEASURED)]

CASES = {
    "several experiments and outputs": (servo(), TWO, dict(free=["motor.*", "tsm.*", "offset.bias"])),
    "a shared number, start states, local ones": (
        servo(),
        TWO,
        dict(free=["theta", "tsm.A"], local=["offset.bias"], start_states=True),
    ),
    "a shared number freed in one place": (servo(), TWO, dict(free=["tsm.theta", "scale.gain"])),
    "ties": (
        servo(),
        TWO,
        dict(
            free=["tsm.*"],
            ties={"tsm.alpha2": "2 * alpha1 - 0.1 * A**2", "offset.bias": "alpha2 / 10", "motor.K": 2.5},
            local=["tsm.delta"],
        ),
    ),
    "priors and sigma": (
        servo(),
        TWO,
        dict(
            free=["tsm.*"],
            priors={"tsm.A": (-0.7, 0.1), "tsm.delta": (0.1, 0.2)},
            local=["tsm.delta"],
            sigma={"x_in": 0.01, "x_out": 0.1, "scaled": 2.0},
        ),
    ),
    "windows": (servo(), TWO, dict(free=["tsm.*"], window={"one": (0.5, 2.005), "two": (None, 7.0)})),
    "uneven times": (servo(), [attrs.evolve(r, t=r.t - T + JITTER) for r in TWO], dict(free=["tsm.*", "motor.tau"])),
    "uneven times in a window": (
        servo(),
        [attrs.evolve(TWO[1], t=5 + JITTER)],
        dict(free=["tsm.*"], window=(5.5, 6.5), step=0.004),
    ),
    "smaller steps": (servo(), TWO[0], dict(free=["tsm.*", "motor.tau"], step=STEP / 5)),
    "longer steps": (servo(), TWO[0], dict(free=["tsm.*", "motor.tau"], step=0.025)),
    "heun, held inputs": (servo(), TWO[0], dict(free=["tsm.*"], step=STEP / 2, integrator="heun", hold="zero")),
    "a sampled loop": (sampled(), record(r=U, y=0.5 * U), dict(free=["pid.kp", "pid.ki", "pid.kd", "lag.*"])),
    "a delay": (delayed(), record(u=U, y=U), dict(free=["lag.*"], start_states=True)),
    "more parameters than lanes": (chain(40), record(u=U, y=1.1 * U), dict(free=["k*"])),
    "without the compiler": (
        delayed(),
        record(t=T[:40], u=U[:40], y=U[:40]),
        dict(free=["lag.*"], backend="casadi", step=STEP),
    ),
}


@pytest.fixture(scope="module")
def problems():
    made = {}

    def get(name):
        if name not in made:
            diagram, data, given = CASES[name]
            made[name] = pose(diagram, data, **given)
        return made[name]

    return get


def near_start(problem, seed, spread=0.02):
    start = problem.unknowns.start
    return start + spread * np.random.default_rng(seed).uniform(-1, 1, len(start)) * np.maximum(np.abs(start), 0.1)


def led_on(t, y, end, hold):
    """A signal to the end of the last step, as it went."""
    if end <= t[-1] + 1e-9:
        return t, y
    return np.append(t, end), np.append(
        y, y[-1] if hold == "zero" else y[-1] + (end - t[-1]) * (y[-1] - y[-2]) / (t[-1] - t[-2])
    )


@pytest.mark.parametrize("name", CASES)
def test_residuals_are_those_of_a_simulation_by_hand(problems, name):
    problem, setup = problems(name)
    theta, parts = near_start(problem, 1), []
    for e, trial in enumerate(problem.experiments):
        numbers = problem.unknowns.settings(theta, e)
        diagram = setup.diagram.with_parameters(numbers)
        times, r = trial.times, trial.record
        end = times.start + times.steps * times.h
        inputs = {k: tsm.Samples(*led_on(r.t, r[k], end, trial.hold[k]), trial.hold[k]) for k in diagram.inputs}
        run = tsm.simulate(diagram, start=times.start, stop=end, step=times.h, method=trial.rule.name, inputs=inputs)
        for output, weight in zip(setup.outputs, problem.weights, strict=True):
            there = np.isin(r.t, trial.t)
            parts.append(weight * (np.interp(r.t, run.t, run[output]) - r[output])[there])
    expected = np.concatenate(parts)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(problem.residuals(theta), expected, atol=1e-9 * scale)
    assert sum(s.stop - s.start for s in problem.segments) == problem.samples == len(expected)


@pytest.mark.parametrize("name", CASES)
def test_derivatives_equal_central_differences(problems, name):
    problem, _ = problems(name)
    theta = near_start(problem, 2)
    r, found = problem.jacobian(theta)
    found = found.dense()
    np.testing.assert_allclose(r, problem.residuals(theta), atol=BACKENDS * np.abs(r).max())

    def slope(k, h):
        move = h * (np.arange(len(theta)) == k)
        return (problem.residuals(theta + move) - problem.residuals(theta - move)) / (2 * h)

    for k in range(len(theta)):
        h = 2e-4 * max(abs(theta[k]), 0.1)
        expected = (4 * slope(k, h / 2) - slope(k, h)) / 3
        off = np.abs(found[:, k] - expected) / max(np.abs(expected).max(), 1e-3)
        # where a reversal of the motor moves past a step, a difference is of first order: a few samples
        assert np.quantile(off, 0.98) < 1e-6, problem.unknowns.names[k]
        assert off.max() < 1e-2, problem.unknowns.names[k]


@pytest.mark.parametrize("name", CASES)
def test_cost_gradient_and_matrix_go_together(problems, name):
    problem, _ = problems(name)
    theta = near_start(problem, 3)
    cost, gradient, matrix = problem.normal(theta)
    r, jacobian = problem.jacobian(theta)
    jacobian = jacobian.dense()
    slope, curve = problem.prior_derivatives(theta)
    assert cost == pytest.approx(problem.cost(theta), rel=1e-9)
    assert cost == pytest.approx(0.5 * r @ r + problem.prior_cost(theta), rel=1e-9)
    np.testing.assert_allclose(gradient, jacobian.T @ r + slope, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(matrix, jacobian.T @ jacobian + np.diag(curve), atol=1e-9 * np.abs(matrix).max())


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("count", [1, 9, 40])
def test_costs_side_by_side_equal_costs_one_by_one(problems, name, count):
    problem, _ = problems(name)
    sets = np.array([near_start(problem, seed) for seed in range(count)])
    expected = [problem.cost(theta) for theta in sets]
    np.testing.assert_allclose(problem.costs(sets), expected, rtol=BACKENDS)


def test_a_set_that_runs_away_costs_infinitely_much_and_spoils_no_other():
    loop = tsm.Diagram(
        title="loop",
        blocks=dict(error=Sum(signs="+-"), k=Gain(gain=2.0), i=Integrator()),
        wires=["error -> k -> i -> error.minus"],
        inputs={"r": "error.plus"},
        outputs={"y": "i"},
    )
    problem, _ = pose(loop, record(r=U, y=U), free=["k.gain"])
    sets = np.array([[1.0], [-500.0], [3.0], [-1000.0]])
    found = problem.costs(sets)
    assert list(np.isinf(found)) == [False, True, False, True]
    assert list(found) == [pytest.approx(problem.cost(s), rel=BACKENDS) for s in sets]
    assert problem.costs(np.empty((0, 1))).shape == (0,)


def test_priors_weigh_as_much_as_their_deviation_says():
    diagram, data, given = CASES["priors and sigma"]
    problem, _ = pose(diagram, data, **given)
    theta = near_start(problem, 4)
    by_name = dict(zip(problem.unknowns.names, theta, strict=True))
    expected = ((by_name["tsm.A"] + 0.7) / 0.1) ** 2
    expected += sum(((by_name[f"tsm.delta@{e}"] - 0.1) / 0.2) ** 2 for e in ("one", "two"))
    assert problem.prior_cost(theta) == pytest.approx(expected / 2, rel=1e-12)
    assert attrs.evolve(problem, noise=3.0).prior_cost(theta) == pytest.approx(9 * expected / 2, rel=1e-12)


# ---- unknowns


def test_unknowns_of_one_experiment_stay_out_of_the_others(problems):
    problem, _ = problems("a shared number, start states, local ones")
    names = problem.unknowns.names
    assert names == (
        "motor.angle@one",
        "motor.angle@two",
        "motor.speed@one",
        "motor.speed@two",
        "tsm.A",
        "theta",
        "tsm.zeta@one",
        "tsm.zeta@two",
        "offset.bias@one",
        "offset.bias@two",
    )
    jacobian = problem.jacobian(problem.unknowns.start)[1].dense()
    half = problem.samples // 2
    for k, name in enumerate(names):
        here, there = (slice(0, half), slice(half, None)) if name.endswith("@one") else (slice(half, None), slice(half))
        if "@" in name:
            assert not jacobian[there, k].any()
            assert jacobian[here, k].any()


def test_a_shared_number_moves_all_that_name_it_and_one_freed_alone_leaves_it():
    shared, _ = pose(servo(), TWO[0], free=["theta"])
    assert shared.unknowns.settings(np.array([5.5]), 0) == {"theta": 5.5}
    alone, setup = pose(servo(), TWO[0], free=["tsm.theta"])
    assert alone.unknowns.settings(np.array([5.5]), 0) == {"tsm.theta": 5.5}
    fitted = setup.diagram.with_parameters({"tsm.theta": 5.5})
    assert (fitted.blocks["tsm"].theta, fitted.blocks["scale"].gain, fitted.values["theta"]) == (5.5, "$theta", 4.0)


def test_ties_are_worked_out_in_the_order_they_need(problems):
    problem, _ = problems("ties")
    theta = near_start(problem, 5)
    by_name = dict(zip(problem.unknowns.names, theta, strict=True))
    for e, name in enumerate(("one", "two")):
        found = problem.unknowns.settings(theta, e)
        alpha2 = 2 * by_name["tsm.alpha1"] - 0.1 * by_name["tsm.A"] ** 2
        assert found["tsm.alpha2"] == pytest.approx(alpha2, rel=1e-12)
        assert found["offset.bias"] == pytest.approx(alpha2 / 10, rel=1e-12)
        assert found["motor.K"] == 2.5
        assert found["tsm.delta"] == by_name[f"tsm.delta@{name}"]


# ---- constraints


LIMITED = dict(
    free=["tsm.*", "offset.bias"],
    local=["offset.bias"],
    ties={"tsm.delta": "A / 10"},
    constraints={
        "monotone": "alpha2 + A - abs(delta) > 0",
        "even": "alpha1 == alpha2",
        "shift": "bias**2 < 0.04 * A**2",
    },
)


def test_constraints_as_functions_of_the_unknowns():
    problem, _ = pose(servo(), TWO, **LIMITED)
    limits, theta = problem.constraints, near_start(problem, 6)
    v = dict(zip(problem.unknowns.names, theta, strict=True))
    assert limits.names == ("monotone", "even", "shift@one", "shift@two")
    assert list(limits.equal) == [False, True, False, False]
    expected = [
        v["tsm.alpha2"] + v["tsm.A"] - abs(v["tsm.A"] / 10),
        v["tsm.alpha1"] - v["tsm.alpha2"],
        0.04 * v["tsm.A"] ** 2 - v["offset.bias@one"] ** 2,
        0.04 * v["tsm.A"] ** 2 - v["offset.bias@two"] ** 2,
    ]
    np.testing.assert_allclose(limits.values(theta), expected, rtol=1e-12)
    slopes = np.array([(limits.values(theta + h) - limits.values(theta - h)) / 2e-6 for h in 1e-6 * np.eye(len(theta))])
    np.testing.assert_allclose(limits.jacobian(theta), slopes.T, atol=1e-8)
    missed = [max(-expected[0], 0), abs(expected[1]), max(-expected[2], 0), max(-expected[3], 0)]
    assert problem.violation(theta) == pytest.approx(sum(missed), rel=1e-12)


def test_a_start_is_moved_to_where_the_constraints_hold():
    problem, _ = pose(servo(), TWO, **LIMITED)
    start = problem.unknowns.start
    assert problem.violation(start) > 1e-3
    theta = feasible_start(problem, start)
    assert problem.violation(theta) <= 1e-9
    assert ((theta >= problem.unknowns.low) & (theta <= problem.unknowns.high)).all()
    assert np.abs(theta - start).max() < 0.3  # not further than it needs


def test_a_start_that_meets_them_stays():
    problem, _ = pose(servo(), TWO[0], free=["tsm.*"], constraints=["theta > 1"])
    start = problem.unknowns.start
    assert feasible_start(problem, start) is start


def test_what_is_no_number_counts_as_missed():
    problem, _ = pose(servo(), TWO[0], free=["offset.bias"], constraints=["sqrt(bias - 1) < 3"])
    assert problem.violation(problem.unknowns.start) == np.inf
    assert not problem.inside(problem.unknowns.start)
    with pytest.raises(ParameterError, match=r"sqrt\(bias - 1\) < 3 is no number"):
        feasible_start(problem, problem.unknowns.start)


# ---- recordings made ready


def test_a_step_is_found_that_resolves_a_fast_diagram():
    stiff = tsm.Diagram(
        title="fast", blocks=dict(lag=FirstOrderLag(time_constant=0.003)), inputs={"u": "lag"}, outputs={"y": "lag"}
    )
    problem, setup = pose(stiff, record(u=U, y=U), free=["lag.gain"])
    (trial,) = problem.experiments
    assert trial.times.h == pytest.approx(STEP / trial.times.every)
    assert trial.times.every >= 2  # at the samples' own step the rule is unstable here
    fine = tsm.simulate(stiff, step=STEP / 256, inputs={"u": tsm.Samples(T, U)})
    y = trial.outputs(problem.unknowns.parameters(problem.unknowns.start, 0))[:, 0]
    assert np.std(y - np.interp(T, fine.t, fine["y"])) < 1e-3 * U.std()
    assert setup.notes == ()


def test_a_step_follows_the_periods_of_a_sampled_loop():
    t = 0.02 * np.arange(200)
    blocks = dict(hold=ZeroOrderHold(period=0.005), lag=FirstOrderLag())
    diagram = tsm.Diagram(title="d", blocks=blocks, wires=["hold -> lag"], inputs={"u": "hold"}, outputs={"y": "lag"})
    problem, _ = pose(diagram, record(t=t, u=np.sin(t), y=np.sin(t)), free=["lag.gain"])
    assert 0.005 / problem.experiments[0].times.h == pytest.approx(round(0.005 / problem.experiments[0].times.h))


def test_rounded_times_count_as_even():
    t = np.round(T * 1.1, 5)
    problem, setup = pose(servo(), record(t=t, u=U, **MEASURED), free=["tsm.*"])
    assert problem.experiments[0].share is None
    assert [note for note in setup.notes if "spaced" in note] == []


def test_uneven_times_are_told():
    _, setup = pose(*CASES["uneven times"][:2], free=["tsm.*"])
    said = "the samples are unevenly spaced, so the simulation is interpolated between its steps."
    assert [note for note in setup.notes if "unit" not in note] == [f"one: {said}", f"two: {said}"]


def test_a_step_that_does_not_divide_the_samples_is_told():
    found = tsm.fit(
        tsm.load("tendon_sheath_linear"),
        tsm.Record("one", T, {"x_in": U, "x_out": U}, {"x_in": "rad", "x_out": "rad"}),
        step=0.4 * STEP,
        starts=1,
    )
    assert found.notes[0] == (
        "one: the samples, 0.01 s apart, are no multiples of the step of 0.004 s, so the simulation is interpolated "
        "between its steps."
    )


def test_records_in_other_units_are_the_same_record():
    play = tsm.load("tendon_sheath_play")
    plain, _ = pose(play, record(units={"x_in": "rad", "x_out": "rad"}, x_in=U, x_out=0.8 * U))
    mixed, _ = pose(play, record(units={"x_in": "deg", "x_out": "mrad"}, x_in=np.rad2deg(U), x_out=800 * U))
    bare, setup = pose(play, record(x_in=U, x_out=0.8 * U))
    theta = plain.unknowns.start
    np.testing.assert_allclose(mixed.residuals(theta), plain.residuals(theta), atol=1e-14)
    np.testing.assert_allclose(bare.residuals(theta), plain.residuals(theta), atol=1e-14)
    assert setup.notes == ("a: x_in and x_out have no unit and are taken to be in rad.",)


def test_several_outputs_count_by_their_spread_and_one_as_it_is(problems):
    problem, _ = problems("several experiments and outputs")
    np.testing.assert_allclose(problem.weights, [1 / np.std(MEASURED[k]) for k in ("x_in", "x_out", "scaled")])
    one, _ = pose(servo(), TWO, outputs="x_out")
    assert list(one.weights) == [1.0]
    given, setup = pose(servo(), TWO, outputs=["scaled", "x_out"], sigma={"x_out": 0.1, "scaled": 2.0})
    assert (setup.outputs, list(given.weights)) == (("scaled", "x_out"), [0.5, 10.0])


def test_an_output_asked_for_twice_counts_once():
    problem, _ = pose(servo(), TWO[0], outputs=["x_out", "x_out"])
    assert problem.samples == len(T)


def test_only_outputs_that_every_record_has_are_compared():
    less = record("less", u=U, x_out=U)
    _, setup = pose(servo(), [TWO[0], less])
    assert setup.outputs == ("x_out",)


def test_differences_over_a_reach_are_derivatives_where_nothing_jumps():
    problem, _ = pose(tsm.load("tendon_sheath_linear"), record(x_in=U, x_out=U))
    theta = np.array([0.8, 0.2])
    r, jacobian = problem.jacobian(theta)
    rough, secants = problem.jacobian(theta, np.array([0.1, 0.1]))
    np.testing.assert_allclose(rough, r, atol=1e-12)
    np.testing.assert_allclose(secants.dense(), jacobian.dense(), atol=1e-12)


def test_a_play_at_its_bound_is_followed_to_one_side():
    blocks = dict(play=Play(half_width=0.0), lag=FirstOrderLag())
    diagram = tsm.Diagram(title="d", blocks=blocks, wires=["play -> lag"], inputs={"u": "play"}, outputs={"y": "lag"})
    problem, _ = pose(diagram, record(u=U, y=U), free=["play.half_width", "lag.gain"])
    _, jacobian = problem.jacobian(problem.unknowns.start)
    assert jacobian.is_finite.all()
    _, secants = problem.jacobian(problem.unknowns.start, np.array([1e-4, 1e-4]))
    assert secants.is_finite.all()


def test_a_number_per_second_of_a_port_has_a_unit_that_can_be_read():
    """The integral of an acceleration is a speed, and not m/s^2*s, which could be read in two ways."""
    diagram = tsm.Diagram(
        blocks={"speed": Integrator(), "position": Integrator(), "gain": Gain(gain=1.0)},
        wires=["gain -> speed -> position"],
        inputs={"a": tsm.Inlet(["gain.u"], unit="m/s^2")},
        outputs={"x": "position"},
    )
    made = record(units={"a": "m/s^2", "x": "m"}, a=np.sin(T), x=T - np.sin(T))
    problem, _ = pose(diagram, made, start_states=True)
    units_of = {item.parameter: item.unit for item in problem.unknowns.items}
    assert (units_of["speed.integral"], units_of["position.integral"]) == ("m/s", "m")


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1e6, 1e12])
def test_a_bound_on_what_hardly_acts_is_met_whatever_its_unit(size):
    H, g = np.diag([1.0, 2.0]), np.array([1.0, 4.0])
    d, force = quadratic_step(H, g, size * np.array([[0.0, 1.0]]), size * np.array([-0.5]), np.array([False]))
    assert d == pytest.approx([-1.0, -0.5])
    assert force * size == pytest.approx([3.0])
