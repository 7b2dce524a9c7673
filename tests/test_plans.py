"""Plans against what they promise: combinations, strata, distributions, a fit's covariance; and what is no plan."""

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import tsmblocks as tsm
from tsmblocks.blocks import Gain
from tsmblocks.common.errors import ParameterError
from tsmblocks.studies import Normal, Uniform, grid, latin_hypercube, monte_carlo, sweep, table

RUNS = 4000


def test_a_grid_has_every_combination_once():
    plan = grid({"a": [1, 2, 3], "b": [0.5, 0.25], "c": ["x", "y"]})
    rows = [tuple(plan.row(k).values()) for k in range(len(plan))]
    assert len(plan) == len(set(rows)) == 12
    assert rows[:3] == [(1.0, 0.5, "x"), (1.0, 0.5, "y"), (1.0, 0.25, "x")]


def test_a_sweep_changes_one_number_at_a_time():
    plan = sweep({"a": [1, 3], "b": [5, 6, 7]})
    assert [plan.row(k) for k in range(len(plan))] == [{}, {"a": 1.0}, {"a": 3.0}, {"b": 5.0}, {"b": 6.0}, {"b": 7.0}]


def test_a_table_is_taken_as_it_is():
    import pandas as pd

    columns = {"a": [3.0, 1.0, 2.0], "b": [1, 1, 0]}
    for given_ in (columns, pd.DataFrame(columns)):
        plan = table(given_)
        assert {k: v.tolist() for k, v in plan.columns.items()} == columns


BELIEFS = {
    "uniform": (Uniform(-2.0, 3.0), stats.uniform(-2, 5)),
    "pair": ((-2, 3), stats.uniform(-2, 5)),
    "log": (Uniform(0.1, 100.0, log=True), stats.loguniform(0.1, 100)),
    "normal": (Normal(1.0, 0.3), stats.norm(1, 0.3)),
    "cut": (Normal(1.0, 0.5, low=0.5, high=3.0), stats.truncnorm(-1, 4, 1, 0.5)),
    "one side": (Normal(0.0, 1.0, low=0.0), stats.halfnorm()),
}


@pytest.mark.parametrize("name", BELIEFS)
@pytest.mark.parametrize("make", [latin_hypercube, monte_carlo])
def test_random_plans_have_the_distribution_asked_for(name, make):
    belief, expected = BELIEFS[name]
    values = make({"a": belief}, RUNS, seed=3)["a"]
    assert stats.kstest(values, expected.cdf).pvalue > 0.01


@given(st.integers(1, 200), st.integers(0, 10_000))
def test_a_latin_hypercube_has_one_value_in_each_interval(runs, seed):
    beliefs = {"a": Uniform(0.0, 1.0), "b": Normal(0.0, 1.0)}
    plan = latin_hypercube(beliefs, runs, seed=seed)
    for q in (plan["a"], stats.norm.cdf(plan["b"])):
        assert sorted(np.floor(q * runs * (1 - 1e-12)).astype(int)) == list(range(runs))


def test_the_same_seed_is_the_same_plan():
    for make in (latin_hypercube, monte_carlo):
        one, two, other = (make({"a": (0, 1), "b": (0, 1)}, 50, seed=s) for s in (4, 4, 5))
        assert all(np.array_equal(one[k], two[k]) for k in "ab")
        assert not np.array_equal(one["a"], other["a"])
        assert abs(np.corrcoef(one["a"], one["b"])[0, 1]) < 0.5


@pytest.fixture(scope="module")
def fitted():
    t = np.linspace(0, 10, 500)
    x = np.sin(t) + 0.3 * np.sin(3 * t)
    rng = np.random.default_rng(0)
    wires, ends = ["gain -> offset"], dict(inputs={"x": "gain"}, outputs={"y": "offset"})
    blocks = {"gain": Gain(), "offset": tsm.blocks.Bias(bias=0.0)}
    diagram = tsm.Diagram(title="line", blocks=blocks, wires=wires, **ends)
    record = tsm.Record("rig", t, {"x": x, "y": 0.9 * x + 0.1 + 0.05 * rng.standard_normal(500)}, {})
    return tsm.fit(diagram, {"rig": record})


def test_draws_from_a_fit_vary_together_as_it_says(fitted):
    plan = monte_carlo(fitted, RUNS, seed=1)
    assert plan.names == tuple(plan.columns)
    drawn = np.column_stack([plan[name] for name in fitted.names])
    assert drawn.mean(axis=0) == pytest.approx(list(fitted.values.values()), abs=5e-4)
    assert np.cov(drawn.T) == pytest.approx(fitted.covariance, rel=0.1, abs=0.05 * fitted.covariance.max())


def test_draws_from_a_fit_stay_within_bounds():
    t = np.linspace(0, 10, 200)
    rng = np.random.default_rng(0)
    x = np.sin(t)
    diagram = tsm.Diagram(
        title="rig",
        blocks={"lag": tsm.blocks.FirstOrderLag(time_constant=0.02)},
        inputs={"x": "lag"},
        outputs={"y": "lag"},
    )
    record = tsm.Record("rig", t, {"x": x, "y": np.sin(t - 0.02) + 0.2 * rng.standard_normal(200)}, {})
    found = tsm.fit(diagram, {"rig": record}, free=["lag.time_constant"])
    wide = attrs.evolve(found, covariance=np.array([[0.05**2]]))
    values = monte_carlo(wide, 500)["lag.time_constant"]
    assert values.min() > 0
    assert values.std() > 0.01


def test_what_the_data_leave_open_cannot_be_drawn(fitted):
    covariance = fitted.covariance.copy()
    covariance[0, :] = covariance[:, 0] = np.nan
    open_ = attrs.evolve(fitted, covariance=covariance)
    with pytest.raises(ParameterError, match=r"gain\.gain of the fit is not identifiable with its data, so no values"):
        monte_carlo(open_, 10)


REFUSED = {
    "no mapping": (
        lambda: grid([1, 2]),
        "a plan maps parameters to values, such as {'pid.kp': [1, 1.5, 2]}, got [1, 2].",
    ),
    "one number": (lambda: grid({"a": 3}), "'a' needs a list of values, got 3."),
    "a text": (lambda: grid({"a": "123"}), "'a' needs a list of values, got '123'."),
    "no value": (lambda: grid({"a": []}), "'a' needs a list of at least one value, got []."),
    "nan": (lambda: grid({"a": [1, float("nan")]}), "'a' has a value that is not finite."),
    "nothing": (lambda: grid({}), "a plan needs at least one parameter with at least one value."),
    "lengths": (
        lambda: table({"a": [1, 2], "b": [1]}),
        "a plan needs as many values of each parameter; a has 2, b has 1.",
    ),
    "words swept": (lambda: sweep({"a": ["x", "y"]}), "a sweep takes numbers; 'a' has 'x'. Use grid."),
    "no belief": (lambda: monte_carlo({"a": 3}, 5), "'a' varies by (low, high), Uniform or Normal, got 3."),
    "no beliefs": (
        lambda: monte_carlo({}, 5),
        "no parameter varies: write {'tsm.theta': (4, 6)} or {'tsm.theta': Normal(5, 0.5)}, got {}.",
    ),
    "upside down": (lambda: Uniform(2, 1), "low must be below high, got low=2, high=1."),
    "log of less than nothing": (lambda: Uniform(-1, 1, log=True), "Uniform with log=True needs low > 0, got low=-1."),
    "no spread": (lambda: Normal(1, 0), "Normal needs a deviation > 0, got mean=1, deviation=0."),
    "empty": (lambda: Normal(1, 1, low=3, high=2), "Normal needs low < high, got low=3, high=2."),
    "far off": (
        lambda: monte_carlo({"a": Normal(0, 1, low=60)}, 5),
        "Normal(mean=0, deviation=1) has nothing between 60 and inf.",
    ),
    "too large": (
        lambda: grid({k: range(2000) for k in "abc"}),
        "a plan of 8,000,000,000 runs is too large; 10,000,000 are the most.",
    ),
    "far too large": (
        lambda: monte_carlo({"a": (0, 1)}, 10**15),
        "a plan of 1,000,000,000,000,000 runs is too large; 10,000,000 are the most.",
    ),
    "words": (lambda: Uniform("a", 2), "a number of Uniform or Normal must be a finite number, got 'a'."),
    "a pair of words": (
        lambda: monte_carlo({"a": ("a", "b")}, 5),
        "bounds of 'a': a number of Uniform or Normal must be a finite number, got 'a'.",
    ),
    "no table": (lambda: table(None), "a table maps parameters to values, one per run, got None."),
    "a matrix": (lambda: table({"a": np.ones((2, 2))}), "'a' needs a list of values, got an array of shape (2, 2)."),
    "no runs": (lambda: monte_carlo({"a": (0, 1)}, 0), "runs must be a whole number of at least 1, got 0."),
    "no seed": (
        lambda: latin_hypercube({"a": (0, 1)}, 5, seed=-1),
        "seed must be a whole number of at least 0, got -1.",
    ),
    "unknown": (lambda: grid({"pid.kp": [1]})["pid.kd"], "the plan does not vary 'pid.kd'. Did you mean 'pid.kp'?"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_plan(name):
    make, said = REFUSED[name]
    with pytest.raises(tsm.TsmError) as found:
        make()
    assert str(found.value) == said


def test_plans_are_values():
    plan = grid({"a": [1.0, 2.0]})
    with pytest.raises(ValueError, match="read-only"):
        plan["a"][0] = 5.0
