"""Searches without derivatives: search ranges, differential evolution, Nelder-Mead, and both on a diagram."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tsmblocks as tsm
from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.fitting.global_search import evolve, polish
from tsmblocks.fitting.multistart import Box, Range, search_range, spread


def sphere(x):
    return ((x - 0.3) ** 2).sum(axis=1)


def rosenbrock(x):
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


def rastrigin(x):
    x = x - 0.37
    return (10 + x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=1)


def ackley(x):
    x = x - 7.1
    return 20 + math.e - 20 * np.exp(-0.2 * np.sqrt((x**2).mean(axis=1))) - np.exp(np.cos(2 * np.pi * x).mean(axis=1))


def rugged(x):
    """A bowl with ripples too fine to see, so that contractions fail and the simplex shrinks."""
    return ((x - 0.45) ** 2).sum(axis=1) * (1.5 + np.sin(1e5 * x.sum(axis=1)))


FUNCTIONS = {
    "sphere": (sphere, Range(-5, 5)),
    "rosenbrock": (rosenbrock, Range(-2, 2)),
    "rastrigin": (rastrigin, Range(-5, 5)),
    "ackley": (ackley, Range(-32, 32)),
}


def g06(x):
    return (x[:, 0] - 10) ** 3 + (x[:, 1] - 20) ** 3


def g06_missed(x):
    return np.column_stack(
        [100 - (x[:, 0] - 5) ** 2 - (x[:, 1] - 5) ** 2, (x[:, 0] - 6) ** 2 + (x[:, 1] - 5) ** 2 - 82.81]
    )


def g08(x):
    with np.errstate(all="ignore"):
        a = np.sin(2 * np.pi * x[:, 0]) ** 3 * np.sin(2 * np.pi * x[:, 1])
        return -a / (x[:, 0] ** 3 * (x[:, 0] + x[:, 1]))


def g08_missed(x):
    return np.column_stack([x[:, 0] ** 2 - x[:, 1] + 1, 1 - x[:, 0] + (x[:, 1] - 4) ** 2])


CONSTRAINED = {  # cost, constraints, ranges, least cost: Koziel and Michalewicz, Evol. Comput. 7 (1999) 19
    "g06": (g06, g06_missed, [Range(13, 100), Range(0, 100)], -6961.81388),
    "g08": (g08, g08_missed, [Range(0, 10)] * 2, -0.095825),
}


class Interrupting:
    """A cost during which Ctrl-C is pressed, at the call of that number."""

    def __init__(self, cost, call):
        self.cost, self.call, self.seen = cost, call, []

    def __call__(self, thetas):
        if len(self.seen) == self.call:
            raise KeyboardInterrupt
        values = self.cost(thetas)
        self.seen.append(values.min())
        return values


# ---- ranges and places


@pytest.mark.parametrize(
    ("value", "low", "high", "expected"),
    [
        (5.0, 0.0, math.inf, Range(0.05, 500.0, True)),
        (5.0, 1.0, math.inf, Range(1.0, 500.0, True)),
        (5.0, 1e-9, math.inf, Range(0.05, 500.0, True)),
        (0.0, 0.0, math.inf, Range(0.0, 1.0)),
        (0.5, -math.inf, math.inf, Range(-5.0, 5.0)),
        (0.01, -math.inf, math.inf, Range(-1.0, 1.0)),
        (-3.0, -4.0, math.inf, Range(-4.0, 30.0)),
        (-3.0, -math.inf, -1.0, Range(-30.0, -1.0)),
        (2.0, 0.0, 20.0, Range(0.0, 20.0)),
        (2.0, 1.0, 20.0, Range(1.0, 20.0)),
        (2.0, 0.1, 20.0, Range(0.1, 20.0, True)),
        (2.0, 1e-9, 20.0, Range(0.02, 20.0, True)),
    ],
)
def test_a_search_range_follows_the_rule(value, low, high, expected):
    found = search_range(value, low, high)
    assert (found.low, found.high, found.log) == (
        pytest.approx(expected.low),
        pytest.approx(expected.high),
        expected.log,
    )


@given(
    value=st.floats(-1e6, 1e6),
    below=st.one_of(st.just(math.inf), st.floats(0, 1e6)),
    above=st.one_of(st.just(math.inf), st.floats(0, 1e6)),
)
def test_a_search_range_is_finite_and_keeps_to_the_bounds(value, below, above):
    low, high = value - below, value + above
    if low == high:
        return
    found = search_range(value, low, high)
    assert low <= found.low <= value <= found.high <= high
    assert found.low < found.high < math.inf
    assert found.low > -math.inf


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Range(2.0, 1.0), "a search range must have finite ends, the lower one first, got 2 to 1."),
        (
            lambda: Range(0.0, math.inf, name="tsm.A"),
            "the search range of 'tsm.A' must have finite ends, the lower one first, got 0 to inf.",
        ),
        (
            lambda: Range(0.0, 1.0, log=True),
            "a search range is searched in the logarithm, so both ends must be positive, got 0 to 1.",
        ),
        (
            lambda: search_range(3.0, 0.0, 2.0, name="tsm.n"),
            "'tsm.n' is 3, which does not lie within its bounds 0 to 2.",
        ),
        (
            lambda: search_range(math.nan),
            "a number to search for is nan, which does not lie within its bounds -inf to inf.",
        ),
        (
            lambda: search_range(2.0, 2.0, 2.0),
            "a number to search for has no room between its bounds 2 and 2; keep it as it is instead.",
        ),
        (lambda: spread([Range(0, 1)], 0, 1), "the number of places must be at least 1, got 0."),
        (lambda: spread([], 3, 1), "a search needs at least one number to look for, got no ranges."),
    ],
)
def test_ranges_that_cannot_be_searched_are_refused(make, message):
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value) == message


@given(count=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_places_are_spread_one_to_each_part(count, seed):
    ranges = [Range(-3.0, 5.0), Range(0.01, 100.0, True)]
    places = spread(ranges, count, seed)
    assert places.shape == (count, 2)
    parts = [(places[:, 0] + 3) / 8, np.log10(places[:, 1] / 0.01) / 4]
    for share in parts:
        assert sorted(np.minimum(np.floor(share * count + 1e-9), count - 1).astype(int)) == list(range(count))


def test_places_are_the_same_for_the_same_seed():
    ranges = [Range(-1, 1)] * 3
    assert np.array_equal(spread(ranges, 8, 5), spread(ranges, 8, 5))
    assert not np.array_equal(spread(ranges, 8, 5), spread(ranges, 8, 6))


@given(st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_shares_and_places_are_each_others_inverse(shares):
    box = Box((Range(-3.0, 5.0), Range(1e-3, 1e3, True), Range(7.0, 8.0)))
    theta = box.thetas(np.array(shares))
    assert ((theta >= box.low) & (theta <= box.high)).all()
    assert box.shares(theta) == pytest.approx(shares, abs=1e-12)


# ---- differential evolution, then Nelder-Mead


def test_a_cost_of_another_shape_is_refused():
    with pytest.raises(RunError) as caught:
        evolve(lambda x: x, [Range(0, 1)] * 2, seed=1)
    assert str(caught.value) == "the cost must give one number per set, shape (64,), got shape (64, 2)."
    with pytest.raises(RunError) as caught:
        polish(sphere, [0.5, 0.5], [Range(0, 1)] * 2, constraints=sphere)
    assert str(caught.value) == "the constraints must give one row per set, shape (1, constraints), got shape (1,)."


@pytest.mark.parametrize(
    ("name", "unknowns", "least"),
    [
        ("sphere", 1, 100),
        ("rastrigin", 1, 100),
        ("ackley", 2, 100),
        ("rosenbrock", 2, 100),
        ("rastrigin", 5, 95),
        ("rosenbrock", 5, 90),
    ],
)
def test_the_least_cost_is_found_from_nearly_every_seed(name, unknowns, least):
    """Rosenbrock's function of five unknowns has a second valley, in which a few searches end."""
    cost, one = FUNCTIONS[name]
    ranges = [one] * unknowns
    good = 0
    for seed in range(100):
        evolved = evolve(cost, ranges, seed=seed)
        good += polish(cost, evolved.theta, ranges).cost < 1e-3
    assert good >= least


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_ten_unknowns(name):
    cost, one = FUNCTIONS[name]
    evolved = evolve(cost, [one] * 10, seed=3)
    found = polish(cost, evolved.theta, [one] * 10)
    assert found.cost < 1e-4
    assert found.status == "converged"
    assert found.cost <= evolved.cost


@pytest.mark.parametrize("name", sorted(CONSTRAINED))
def test_the_least_cost_under_constraints(name):
    cost, missed, ranges, least = CONSTRAINED[name]
    for seed in range(10):
        evolved = evolve(cost, ranges, seed=seed, constraints=missed)
        found = polish(cost, evolved.theta, ranges, constraints=missed, restarts=2)
        assert evolved.violation == found.violation == 0
        assert missed(found.theta[None]).max() <= 0
        assert found.cost == pytest.approx(least, rel=1e-4)


def test_constraints_that_cannot_be_met_are_missed_by_as_little_as_can_be():
    def missed(x):
        return np.column_stack([x[:, 0] + 0.5, 2 * (0.5 - x[:, 0])])  # least sum at 0.5, where it is 1

    found = evolve(sphere, [Range(-1, 1)] * 2, seed=1, constraints=missed)
    assert found.violation == pytest.approx(1.0, abs=1e-3)
    assert np.isinf(found.history).all()
    assert found.status == "limit"


def test_half_of_the_box_without_a_cost():
    def cost(x):
        return np.where(x[:, 0] < 0.25, np.nan, sphere(x))  # the least cost lies next to the edge

    ranges = [Range(-4, 4)] * 3
    evolved = evolve(cost, ranges, seed=2)
    found = polish(cost, evolved.theta, ranges)
    assert found.cost < 1e-6
    assert np.isfinite(evolved.history).all()


def test_a_least_cost_at_the_very_edge_of_what_has_one():
    def cost(x):
        return np.where(x[:, 0] < 0.5, np.inf, x[:, 0] + x[:, 1] ** 2)

    ranges = [Range(-4, 4)] * 2
    found = polish(cost, evolve(cost, ranges, seed=2).theta, ranges)
    assert found.cost == pytest.approx(0.5, abs=1e-3)
    assert found.status == "converged"


def test_a_flat_cost_ends_early():
    def cost(x):
        return np.full(len(x), 4.0)

    evolved = evolve(cost, [Range(0, 1)] * 2, seed=1, patience=7)
    assert (evolved.status, evolved.iterations, evolved.cost) == ("stalled", 7, 4.0)
    found = polish(cost, evolved.theta, [Range(0, 1)] * 2)
    assert (found.status, found.cost) == ("converged", 4.0)
    assert np.array_equal(found.theta, evolved.theta)


def test_no_finite_cost_at_all_is_told():
    def cost(x):
        return np.full(len(x), np.nan)

    with pytest.raises(RunError) as caught:
        evolve(cost, [Range(0, 1)], seed=1, generations=2)
    assert str(caught.value) == (
        "none of 320 parameter sets has a finite cost. Narrow the search ranges, or start where the simulation is "
        "stable."
    )
    with pytest.raises(RunError) as caught:
        polish(cost, [0.5, 0.5], [Range(0, 1)] * 2)
    assert str(caught.value) == ("the start of Nelder-Mead has no finite cost. Begin where the simulation is stable.")


@pytest.mark.parametrize(
    "search", [lambda x: evolve(sphere, RANGES, seed=1, start=x), lambda x: polish(sphere, x, RANGES)]
)
@pytest.mark.parametrize(
    ("start", "message"),
    [
        ([0.5, 9.0], "the start has 'tsm.A' at 9, outside its search range -1 to 1."),
        ([-9.0, 0.5], "the start has number 0 at -9, outside its search range -1 to 1."),
        ([0.5, math.nan], "the start has 'tsm.A' at nan, outside its search range -1 to 1."),
        ([0.5], "the start must have one number for each of the 2 ranges, got [0.5]."),
        ("x", "the start must have one number for each of the 2 ranges, got 'x'."),
    ],
)
def test_a_start_outside_the_ranges_is_refused(search, start, message):
    with pytest.raises(ParameterError) as caught:
        search(start)
    assert str(caught.value) == message


RANGES = [Range(-1, 1), Range(-1, 1, name="tsm.A")]


@pytest.mark.parametrize("population", [0, 16, 50, -32])
def test_a_population_that_leaves_lanes_empty_is_refused(population):
    with pytest.raises(ParameterError) as caught:
        evolve(sphere, RANGES, seed=1, population=population)
    assert str(caught.value) == (
        f"the population must be a multiple of 32, the sets that run side by side, got {population}."
    )


# ---- laws


def test_the_same_seed_gives_the_same_result_bit_for_bit():
    first, again, other = (evolve(rastrigin, [Range(-5, 5)] * 4, seed=k, generations=20) for k in (7, 7, 8))
    assert np.array_equal(first.population, again.population)
    assert np.array_equal(first.history, again.history)
    assert not np.array_equal(first.population, other.population)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), unknowns=st.integers(1, 6), centre=st.floats(-2, 2), log=st.booleans())
def test_no_search_leaves_the_box_and_the_best_never_gets_worse(seed, unknowns, centre, log):
    low, high = (0.1, 2.5) if log else (-1.0, 1.0)
    ranges, seen = [Range(low, high, log)] * unknowns, []

    def cost(x):
        seen.append(x)
        return np.abs(x - centre).sum(axis=1) + np.sin(20 * x).sum(axis=1)

    evolved = evolve(cost, ranges, seed=seed, population=32, generations=12)
    found = polish(cost, evolved.theta, ranges, iterations=60)
    every = np.concatenate(seen)
    assert every.min() >= low
    assert every.max() <= high
    assert (np.diff(evolved.history) <= 0).all()
    assert (np.diff(evolved.costs) >= 0).all()
    path = cost(found.path)
    assert (np.diff(path) <= 1e-12).all()
    # rounding: the place found goes through the logarithm and back
    assert found.cost <= evolved.cost + 1e-9
    assert evolved.cost == cost(evolved.theta[None])[0] == min(cost(evolved.population))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.integers(-20, 20), shift=st.integers(-1000, 1000))
def test_scaling_and_shifting_the_cost_changes_no_step(seed, scale, shift):
    """Costs are whole multiples of a small number, so that scaling and shifting are exact."""

    def cost(x):
        return np.round(sphere(x) * 2**20) / 2**20

    def moved(x):
        return 2.0**scale * (cost(x) + shift)

    ranges = [Range(-5, 5)] * 3
    plain, other = (evolve(c, ranges, seed=seed, population=32, generations=15, patience=99) for c in (cost, moved))
    assert np.array_equal(plain.population, other.population)
    steps, others = (polish(c, plain.theta, ranges, iterations=40, xtol=0, ftol=0) for c in (cost, moved))
    assert np.array_equal(steps.path, others.path)


def test_generations_evaluations_and_progress_are_counted():
    told, asked = [], []

    def cost(x):
        asked.append(len(x))
        return rosenbrock(x)

    found = evolve(cost, [Range(-2, 2)] * 2, seed=4, population=32, generations=5, progress=lambda *a: told.append(a))
    assert asked == [32, 32, 32, 32, 32, 32]
    assert (found.iterations, found.evaluations, found.status) == (5, 192, "limit")
    assert [n for n, _ in told] == [32, 64, 96, 128, 160, 192]
    assert [c for _, c in told] == list(found.history)
    assert found.population.shape == (32, 2)


def test_places_to_include_are_included():
    best = np.array([[0.3, 0.3, 0.3], [0.4, 0.3, 0.3]])
    found = evolve(sphere, [Range(-5, 5)] * 3, seed=1, start=best, generations=0)
    assert found.theta == pytest.approx(best[0])
    assert found.population[1] == pytest.approx(best[1])
    assert found.evaluations == 64
    first = evolve(rosenbrock, [Range(-2, 2)] * 3, seed=1, generations=10)
    more = evolve(rosenbrock, [Range(-2, 2)] * 3, seed=2, generations=10, start=first.population)
    assert more.cost < first.cost


def test_a_generation_that_shrank_to_a_point_ends_the_search():
    found = evolve(sphere, [Range(-5, 5)] * 3, seed=1, generations=1000, patience=1000)
    assert found.status == "converged"
    assert found.iterations < 1000
    assert np.ptp(found.population, axis=0).max() < 1.1e-5


# ---- Ctrl-C


def test_ctrl_c_keeps_the_best_so_far():
    cost = Interrupting(rosenbrock, 6)
    found = evolve(cost, [Range(-2, 2)] * 2, seed=1)
    assert (found.status, found.iterations) == ("interrupted", 5)
    assert found.cost == min(cost.seen)
    cost = Interrupting(rosenbrock, 30)
    found = polish(cost, [-1.0, 1.0], [Range(-2, 2)] * 2)
    assert (found.status, found.evaluations) == ("interrupted", 30)
    assert found.cost == min(cost.seen)
    assert rosenbrock(found.theta[None])[0] == pytest.approx(found.cost)


def test_ctrl_c_before_there_is_anything_to_keep():
    with pytest.raises(KeyboardInterrupt):
        evolve(Interrupting(sphere, 0), RANGES, seed=1)
    with pytest.raises(KeyboardInterrupt):
        polish(Interrupting(sphere, 0), [0.0, 0.0], RANGES)


# ---- Nelder-Mead


@pytest.mark.parametrize(("name", "optimum"), [("sphere", 0.3), ("rosenbrock", 1.0)])
@pytest.mark.parametrize("unknowns", [2, 5])
def test_the_optimum_is_reached(name, optimum, unknowns):
    cost, one = FUNCTIONS[name]
    found = polish(cost, np.full(unknowns, 0.6), [one] * unknowns, xtol=1e-8)
    assert found.status == "converged"
    assert found.theta == pytest.approx(np.full(unknowns, optimum), abs=1e-5)


@pytest.mark.parametrize("corner", [0.0, 1.0])
def test_a_least_cost_in_a_corner_of_the_box(corner):
    def cost(x):
        return ((x - (3 * corner - 1)) ** 2).sum(axis=1)  # centre outside the box

    found = polish(cost, [0.4, 0.5, 0.6], [Range(0, 1)] * 3)
    assert found.theta == pytest.approx([corner] * 3, abs=1e-12)
    assert found.status == "converged"


def mckinnon(x):
    """A convex function on which the simplex collapses at a place that is no minimum.

    Source: McKinnon, SIAM J. Optim. 9 (1998) 148.
    """
    side = np.where(x[:, 0] <= 0, 360.0, 6.0)
    return side * x[:, 0] ** 2 + x[:, 1] + x[:, 1] ** 2


def test_a_simplex_gone_flat_is_built_anew():
    ranges = [Range(-1.0, 3.0), Range(-2.0, 2.0)]
    shape = (1 - math.sqrt(33)) / 8  # the corner with which every contraction goes to the inside
    start = np.array([0.0, 0.0])

    def sheared(x):  # so that edges along the ranges make McKinnon's simplex
        a, b = x[:, 0], x[:, 1]
        lam = (1 + math.sqrt(33)) / 8
        return 1 + mckinnon(np.column_stack([a + lam * b, a + shape * b]))  # above 0: spreads are relative

    stuck = polish(sheared, start, ranges, size=0.25, restarts=0)
    found = polish(sheared, start, ranges, size=0.25)
    assert stuck.cost > 1 - 0.01
    assert found.restarts > 0
    assert found.cost == pytest.approx(1 - 0.25, abs=1e-5)


def test_iterations_are_limited():
    found = polish(rosenbrock, [-1.0, 1.0], [Range(-2, 2)] * 2, iterations=10)
    assert (found.status, found.iterations, len(found.path)) == ("limit", 10, 11)


# ---- a diagram


def test_five_parameters_of_a_tendon_sheath_from_any_seed():
    """Two tones, noise of 0.005 rad: the sum of squares must come within 0.05 % of the least there is."""
    names = [f"tsm.{k}" for k in ("alpha1", "alpha2", "A", "theta", "delta")]
    diagram = tsm.load("tendon_sheath_asymmetric")
    true = np.array([diagram.parameters[k] for k in names])
    t = np.arange(0, 10.005, 0.01)
    inputs = {"x_in": tsm.Samples(t, 0.49 * np.sin(0.4 * np.pi * t) + 0.49 * np.sin(np.pi * t), "linear")}
    run = tsm.simulate(diagram, stop=10.0, step=0.01, inputs=inputs)
    measured = run["x_out"] + 0.005 * np.random.default_rng(0).standard_normal(len(run.t))

    def squares(t, y):
        with np.errstate(over="ignore", invalid="ignore"):
            return {"sum": ((y["x_out"] - measured[:, None]) ** 2).sum(axis=0)}

    def cost(thetas):
        sets = dict(zip(names, thetas.T, strict=True))
        return tsm.simulate_batch(diagram, sets, stop=10.0, step=0.01, inputs=inputs, reduce=squares, threads=1)["sum"]

    ranges = [Range(0.1, 3), Range(0.1, 3), Range(-5, 5), Range(0.01, 50, True), Range(-3, 3)]
    least = polish(cost, true, ranges, size=0.01, xtol=1e-7, ftol=1e-12)
    assert least.theta == pytest.approx(true, rel=0.1)
    for seed in range(5):
        evolved = evolve(cost, ranges, seed=seed)
        found = polish(cost, evolved.theta, ranges)
        assert found.cost < 1.0005 * least.cost
        assert found.theta == pytest.approx(least.theta, rel=0.01)
