"""Each threshold of the decision, from both of its sides, and what a verdict says of itself."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tests.test_diagnosis_parts import NOISE, even, stand_in
from tsmblocks.diagnosis.decision import (
    CONCENTRATED_RATIO,
    CONCENTRATED_SCATTERS,
    DISTINGUISHABLE_GAIN_SHARE,
    SIGNIFICANT_SHARE,
    SIMPLER_EFFECT_SHARE,
    Verdict,
    _concentrated,
    _is_indistinguishable,
    decide,
    max_t_critical_value,
    ridge_weights,
    shrinkage_of,
)
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate

PART = even(60)
BASE = 3.0 + NOISE[0]


def peaked(scatters, loss=0.0):
    """Gains that scatter by 0.1, by their median, with one peak of so many scatters and one loss beside it."""
    scatter = 0.1 / 0.674490 + 0.02  # a normal quantile at 3/4, and the least that counts
    return np.array([0.1, -0.1] * 29 + [-loss, scatters * scatter])


@pytest.mark.parametrize("far", [0.98, 1.02])
def test_gains_are_concentrated_from_ten_scatters_on(far):
    assert _concentrated(peaked(CONCENTRATED_SCATTERS * far)) == (far > 1)


@pytest.mark.parametrize("far", [0.98, 1.02])
def test_gains_are_not_concentrated_beside_as_large_a_loss(far):
    peak = peaked(30.0)[-1]
    assert _concentrated(peaked(30.0, peak / CONCENTRATED_RATIO / far)) == (far > 1)


@pytest.mark.parametrize(("peak", "concentrated"), [(0.19, False), (0.21, True)])
def test_where_nothing_scatters_a_peak_still_has_to_be_of_interest(peak, concentrated):
    gain = np.zeros(60)
    gain[7] = peak
    assert _concentrated(gain) == concentrated


@pytest.mark.parametrize(("difference", "together"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize(("removed", "noise", "tolerance"), [(2.0, 1.0, 0.01), (2.0, 2.0, 0.02), (20.0, 1.0, 0.04)])
def test_what_differs_by_next_to_nothing_is_indistinguishable_however_surely(
    removed, noise, tolerance, difference, together
):
    """Next to nothing is a hundredth of the noise, or a five-hundredth of what is removed."""
    base = noise + removed + 1e-3 * NOISE[0]
    best = stand_in(noise + 1e-3 * NOISE[1], name="best")
    other = stand_in(best.losses + difference * tolerance, 3, name="other")
    assert (other in decide(base, [best, other], PART, noise, 0).indistinguishable) == together


@pytest.mark.parametrize(("difference", "together"), [(0.9, True), (1.1, False)])
def test_what_differs_by_much_is_distinguishable_however_unsure(difference, together):
    scatter = NOISE[1] - NOISE[1].mean()
    best = stand_in(1.0 + 0 * scatter)
    other = stand_in(1.0 + difference * DISTINGUISHABLE_GAIN_SHARE * 2.0 + 80 * scatter, 3)
    assert (other in decide(3.0 + 0 * scatter, [best, other], PART, 1.0, 0).indistinguishable) == together


@pytest.mark.parametrize(("mean", "named"), [(0.26, False), (0.28, True)])
def test_a_gain_in_few_blocks_has_to_be_three_times_as_large_in_proportion_to_the_noise(mean, named):
    """3 times 6 % of a noise of 1.5."""
    gain = 0.001 * NOISE[1]
    gain[[7, 31]] += 30 * mean - gain.sum() / 2
    verdict = decide(BASE, [stand_in(BASE - gain)], PART, 1.5, 0)
    assert verdict.t[0] < verdict.critical_value
    assert (verdict.named is not None) == named


@pytest.mark.parametrize("far", [0.95, 1.05])
def test_a_significant_one_is_named_before_a_better_one_that_is_not(far):
    """The better one gains and loses by turns, as a flexible candidate does in a few blocks."""
    unsure = 40.0 * np.array([1.0, -1.0] * 30)
    best, other = stand_in(BASE - 1.0 - unsure, name="best"), stand_in(BASE - SIGNIFICANT_SHARE * far + 0.02 * NOISE[1])
    verdict = decide(BASE, [best, other], PART, 1.0, 0)
    assert verdict.ranking[0] is best
    assert verdict.named is (other if far > 1 else None)


def test_of_equal_ones_that_within_its_bounds_is_named():
    at_bound, within = stand_in(BASE - 2.0 + 0.02 * NOISE[1]), stand_in(BASE - 1.995 + 0.02 * NOISE[1])
    item = at_bound.model.problem.unknowns.items[1]
    item.parameter, item.high = "b.p1", 0.0
    assert at_bound.at_bounds == ("p1",)
    assert not at_bound.disqualifying_bounds
    verdict = decide(BASE, [at_bound, within], PART, 1.0, 0)
    assert verdict.named is within
    assert at_bound in verdict.indistinguishable


def test_a_sharp_corner_is_no_limit_of_a_form():
    """The best one is named at the bound at which its corner is sharp, as dry friction without smoothing."""
    sharp, within = stand_in(BASE - 2.0 + 0.02 * NOISE[1]), stand_in(BASE - 1.995 + 0.02 * NOISE[1])
    item, sharp.candidate.effect.sharp = sharp.model.problem.unknowns.items[1], ("p1",)
    item.low, item.high = 0.0, 1.0
    assert (sharp.at_bounds, sharp.at_limit_of_form) == (("p1",), False)
    assert decide(BASE, [sharp, within], PART, 1.0, 0).named is sharp
    item.low, item.high = -1.0, 0.0  # as smooth as it may be
    assert sharp.at_limit_of_form
    assert decide(BASE, [sharp, within], PART, 1.0, 0).named is within


def test_a_significant_one_that_may_not_be_named_is_not():
    unsure = 40.0 * np.array([1.0, -1.0] * 30)
    best, losses = stand_in(BASE - 1.0 - unsure, name="best"), BASE - 0.9 + 0.02 * NOISE[1]
    for other in (
        attrs.evolve(stand_in(losses), untenable="removes noise of the input only"),
        stand_in(losses, edge=0),
    ):
        assert decide(BASE, [best, other], PART, 1.0, 0).named is None


@pytest.mark.parametrize(("size", "together"), [(0.1, True), (0.5, False)])
def test_a_difference_in_few_blocks_counts_where_it_is_large(size, together):
    """Its t-statistic is that of one block."""
    best, losses = stand_in(np.ones(60)), np.ones(60)
    losses[7] += 60 * size
    assert _is_indistinguishable(stand_in(losses), best, PART, 0.01, concentrated_size=0.18) == together


def test_only_what_is_tenable_and_removes_nearly_as_much_is_named_for_being_simpler():
    def beside(loss, **more):
        best = stand_in(1.0 + NOISE[1], 5, name="best")
        simple = stand_in(loss + NOISE[1] + 30 * (NOISE[2] - NOISE[2].mean()), 3, name="simple")
        simple = FittedCandidate(simple.candidate, simple.model, simple.losses, simple.losses, simple.loss, **more)
        verdict = decide(BASE, [best, simple], PART, 1.0, 0)
        assert {one.candidate.effect.name for one in verdict.indistinguishable} == {"best", "simple"}
        return verdict.named.candidate.effect.name

    short = 2.0 * (1 - SIMPLER_EFFECT_SHARE)
    assert beside(1.0 + 0.8 * short) == "simple"
    assert beside(1.0 + 1.2 * short) == "best"
    assert beside(1.0 + 0.8 * short, untenable="noise") == "best"


def test_the_lowest_loss_at_a_disqualifying_bound_is_what_might_still_be_reached():
    near = stand_in(2.0 + NOISE[1])
    out, further = (stand_in(loss + NOISE[1], edge=0.0) for loss in (1.5, 1.0))
    verdict = decide(BASE, [further, near, out], PART, 1.0, 0)
    assert verdict.named is near
    assert verdict.out_of_bounds_loss == further.loss
    assert decide(BASE, [near], PART, 1.0, 0).out_of_bounds_loss == np.inf


@pytest.mark.parametrize(("distance", "at_bound"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize(("low", "high", "side"), [(2.0, 9.0, 1), (-9.0, -2.0, -1)])
def test_a_parameter_is_at_a_bound_within_a_thousandth(low, high, side, distance, at_bound):
    one = stand_in(1.0 + NOISE[1])
    item = one.model.problem.unknowns.items[0]
    item.low, item.high = low, high
    nearest = min((low, high), key=abs)
    one.model.theta[0] = nearest + side * distance * 1e-3 * abs(low)
    assert (one.at_bounds == ("p0",)) == at_bound


def test_the_significance_of_a_name_is_in_critical_values():
    one, other = stand_in(1.0 + NOISE[1]), stand_in(2.0 + NOISE[2])
    assert Verdict((other, one), (9.0, 6.0), 1.5, one).significance == 4.0
    assert Verdict((other, one), (9.0, 6.0), 0.0, one).significance == np.inf
    assert Verdict((other, one), (9.0, 6.0), 1.5).significance == np.inf


def candidate_of(free, null=(), shapes=(), strengths=(), refine=""):
    trials = SimpleNamespace(shapes=shapes, strengths=dict(strengths), refine=refine)
    effect = SimpleNamespace(free=free, null=dict(null))
    return SimpleNamespace(trials=trials, effect=effect, block="b", transition_time=0.25)


def test_effects_shrink_to_their_null_by_the_size_that_is_typical_of_them():
    """A strength is the size; else the mean of the shapes that name it, else 1; an instant counts in transitions."""
    found = shrinkage_of(
        candidate_of(
            free=("gain", "width", "limit", "instant", "other"),
            null={"gain": 1.0, "width": 0.0, "limit": np.inf, "instant": 0.0},
            shapes=({"width": -2.0}, {"width": 4.0}, {"limit": 5.0}),
            strengths={"gain": -0.5},
            refine="instant",
        )
    )
    expected = {
        "b.gain": (1.0, 0.5),
        "b.width": (0.0, 3.0),
        "b.limit": (np.nan, 5.0),  # a limit that never acts is no value to shrink to
        "b.instant": (0.0, 0.25),
        "b.other": (np.nan, 1.0),
    }
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        np.testing.assert_equal(found[key], value)


def test_weights_of_the_ridge():
    """1 / size^2, of an estimate larger than that 1 / estimate^2; nothing for parameters of the base."""
    items = [SimpleNamespace(parameter=name) for name in ("base", "b.small", "b.large", "b.free", "b.still", "b.none")]
    unknowns = SimpleNamespace(items=items)
    theta = np.array([7.0, 0.1, -4.0, 3.0, 0.0, 0.0])
    model = SimpleNamespace(theta=theta, problem=SimpleNamespace(unknowns=unknowns))
    sizes = {
        "b.small": (0.5, 2.0),
        "b.large": (0.0, 2.0),
        "b.free": (np.nan, 2.0),
        "b.still": (np.nan, 0.0),
        "b.none": (0.0, 0.0),
    }
    ridge, null = ridge_weights(sizes, model)
    assert ridge.tolist() == [0.0, 1 / 4, 1 / 16, 1 / 4, 1.0, 1.0]
    assert null.tolist() == [7.0, 0.5, 0.0, 3.0, 0.0, 0.0]


def test_a_loss_that_is_not_tenable_might_not_be_reached():
    near = stand_in(2.0 + NOISE[1])
    filtered = stand_in(1.0 + NOISE[1])
    filtered = FittedCandidate(
        filtered.candidate, filtered.model, filtered.losses, filtered.losses, filtered.loss, untenable="noise"
    )
    verdict = decide(BASE, [near, filtered], PART, 1.0, 0)
    assert verdict.ranking == (near, filtered)
    assert verdict.named is near
    assert verdict.out_of_bounds_loss == np.inf


@pytest.mark.parametrize(("value", "at_bound"), [(0.4996, True), (0.4993, False)])
def test_beside_a_bound_that_never_acts_the_value_itself_is_the_measure(value, at_bound):
    one = stand_in(1.0 + NOISE[1])
    item = one.model.problem.unknowns.items[0]
    item.low, item.high, one.model.theta[0] = -1e12, 0.5, value
    assert (one.at_bounds == ("p0",)) == at_bound


def test_signs_are_plus_and_minus_one_alike():
    """Of equal gains the t-statistics are those of a binomial: 36 of 60 give 1.568, 37 give 1.843; 95 % lies there."""
    assert 1.56 < max_t_critical_value(np.ones((1, 60)), PART, 0) < 1.85


def test_a_variant_with_further_shapes_is_no_alternative():
    """The fundamental of a ripple explains as much as two harmonics do."""
    base, plain = 3.0 + NOISE[0], stand_in(1.0 + NOISE[1], name="ripple")
    more = stand_in(plain.losses - 1e-3, 3, name="ripple")
    more.candidate.effect.free = ("p0", "p1", "p2")
    verdict = decide(base, [plain, more], even(60), 1.0, 0)
    assert verdict.named is plain
    assert verdict.indistinguishable == (plain,)
    more.candidate.effect.free = ("p0", "p2")  # another form, not a more general one
    assert set(decide(base, [plain, more], even(60), 1.0, 0).indistinguishable) == {plain, more}


def test_an_effect_at_the_input_that_is_as_good_at_the_output_is_named_there():
    base, inside = 3.0 + NOISE[0], stand_in(1.0 + NOISE[1], name="ripple")
    inside.candidate.effect.place = "input"
    outside = stand_in(inside.losses + 1e-3, name="ripple")
    verdict = decide(base, [inside, outside], even(60), 1.0, 0)
    assert verdict.named is outside
    assert verdict.indistinguishable == (outside, inside)
    outside.candidate.effect.name = "another"
    assert decide(base, [inside, outside], even(60), 1.0, 0).named is inside


def test_of_two_places_at_an_output_the_one_of_the_sensor_alone_is_named():
    base, loop = 3.0 + NOISE[0], stand_in(1.0 + NOISE[1], name="lag")
    sensor = stand_in(loop.losses + 1e-3, name="lag")
    sensor.candidate.point.before = "y"
    assert decide(base, [loop, sensor], even(60), 1.0, 0).named is sensor
    worse = stand_in(loop.losses + 0.5, name="lag")
    worse.candidate.point.before = "y"
    assert decide(base, [loop, worse], even(60), 1.0, 0).named is loop


def test_a_best_one_that_is_not_significant_gives_way_to_a_rare_effect():
    """A flexible one that gains here and loses there removes a little more than an effect that acts now and then."""
    base, scatter = 3.0 + np.zeros(60), np.random.default_rng(0).normal(0.0, 6.0, 60)
    flexible = stand_in(base - 0.5 - (scatter - scatter.mean()), 3, name="flexible")
    peak = np.zeros(60)
    peak[7] = 24.0
    rare = stand_in(base - peak, name="rare")
    assert decide(base, [flexible], PART, 1.0, 0).named is None
    assert decide(base, [flexible, rare], PART, 1.0, 0).named is rare
    seen = rare.model.mean_square + 0.2
    assert decide(base, [flexible, rare], PART, 1.0, 0, in_sample=seen).named is rare
    assert decide(base, [flexible, rare], PART, 1.0, 0, in_sample=seen - 0.15).named is None  # held out alone
    assert decide(base, [flexible, stand_in(base - peak / 3, name="small")], PART, 1.0, 0).named is None
