"""What candidates reach in noise: alone, and as the best of many."""

from types import SimpleNamespace

import numpy as np
import pytest

from tsmblocks.diagnosis.critical_gains import critical_gains, critical_multiplicity

TOTAL = 1000.0


class Score(SimpleNamespace):
    __hash__ = object.__hash__


def score(seed, family="map", scale=1.0, shapes=1):
    """A candidate of so many shapes, whose gains in noise are those of the best of them."""
    gains = scale * np.random.default_rng(seed).chisquare(1, (shapes, 2000)).max(axis=0)
    return Score(
        candidate=SimpleNamespace(effect=SimpleNamespace(family=family, name=family, free=(), local=())),
        noise_gains=gains,
        squares=TOTAL,
        noise_squares=TOTAL,
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
