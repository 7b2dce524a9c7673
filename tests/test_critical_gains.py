"""What candidates reach in noise: alone, and as the best of many."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tsmblocks.diagnosis.critical_gains import SURROGATES, critical_gains, critical_multiplicity

TOTAL = 1000.0


@attrs.frozen(eq=False)
class Score:
    candidate: SimpleNamespace
    noise_gains: np.ndarray
    squares: float
    noise_squares: float
    slow_part: tuple[float, float] | None


def score(seed, family="map", scale=1.0, shapes=1):
    """A candidate of so many shapes, whose gains in noise are those of the best of them."""
    gains = scale * np.random.default_rng(seed).chisquare(1, (shapes, 2000)).max(axis=0)
    return Score(
        candidate=SimpleNamespace(effect=SimpleNamespace(family=family, name=family, free=(), local=())),
        noise_gains=gains,
        squares=TOTAL,
        noise_squares=TOTAL,
        slow_part=None,
    )


def limit(one, scores, multiplicity=None):
    return critical_gains(scores, multiplicity or critical_multiplicity(scores))[one]


def test_one_candidate_is_held_against_its_own_gains_in_noise():
    one = score(0)
    assert limit(one, [one]) == pytest.approx(np.quantile(one.noise_gains, 0.95), rel=1e-2)


def test_one_in_twenty_searches_among_many_exceeds_any_limit_in_noise():
    every = [score(k) for k in range(20)]
    limits = critical_gains(every, critical_multiplicity(every))
    exceeded = np.any([one.noise_gains > limits[one] for one in every], axis=0)
    assert np.mean(exceeded) == pytest.approx(0.05, abs=0.01)


def test_an_effect_that_was_the_best_of_many_is_held_against_as_many_when_it_is_alone():
    every = [score(k) for k in range(20)]
    among = limit(every[3], every)
    assert limit(every[3], every[3:4]) < 0.7 * among
    assert limit(every[3], every[3:4], critical_multiplicity(every)) == pytest.approx(among)


def test_a_candidate_of_many_shapes_does_not_hide_one_of_few():
    plain, many = score(1), score(2, shapes=200)
    assert limit(plain, [plain, many]) < 0.6 * limit(many, [plain, many])


def test_effects_of_time_are_a_family_of_their_own():
    plain, slow = score(1), score(2, "time", scale=50.0)
    assert limit(plain, [plain, slow]) == pytest.approx(limit(plain, [plain]))


def test_a_slow_candidate_of_the_motion_is_judged_beside_the_slow_part_as_well():
    """Of 1000, 40 are slow: noise explains up to a tenth of these, so that 30 stand out; beside the rest 30 do not."""
    draw = np.random.default_rng(0)
    plain = [score(k, scale=30.0) for k in range(20)]
    slow = attrs.evolve(plain[0], noise_gains=draw.uniform(0, 4, 2000), slow_part=(40.0, 40.0))
    every = [slow, *plain]
    multiplicity = critical_multiplicity(every)
    limits = critical_gains(every, multiplicity)
    assert 3.8 <= limits[slow] < 30
    whole = attrs.evolve(slow, slow_part=None)
    assert limits[slow] <= critical_gains([whole, *plain], critical_multiplicity([whole, *plain]))[whole]
    assert [limits[one] for one in plain] == [critical_gains(plain, multiplicity)[one] for one in plain]


def test_of_two_kinds_of_noise_the_worse_counts():
    one = score(0)
    gains = np.random.default_rng(3).chisquare(1, 2 * SURROGATES)
    gains[SURROGATES:] *= 9.0
    both, worse = (attrs.evolve(one, noise_gains=part) for part in (gains, gains[SURROGATES:]))
    assert limit(both, [both]) == pytest.approx(limit(worse, [worse]))
    assert limit(both, [both]) > 2 * np.quantile(gains[:SURROGATES], 0.95)
