"""Which candidates of a round are fitted, and which of their fits count."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest

from tsmblocks.diagnosis import round_fits
from tsmblocks.diagnosis.round_fits import MAX_RIVALS, Fit, fits_from_starts, with_rivals

BASE = SimpleNamespace(mean_square=10.0, r=np.zeros(100))
SEARCH = SimpleNamespace(progress=lambda *_: None)


@attrs.frozen(eq=False)
class Score:
    candidate: SimpleNamespace
    gain: float
    starts: tuple
    problem: None = None
    setup: None = None
    at_measured_position: None = None


def score(name, gain, starts=(0.0,)):
    return Score(candidate=SimpleNamespace(key=name, trials=SimpleNamespace(held_first=())), gain=gain, starts=starts)


def left(mean_square):
    return SimpleNamespace(mean_square=mean_square)


@pytest.mark.parametrize(
    ("least", "more"), [(5.0, ["B", "C"]), (1.0, ["B"]), (0.1, []), (9.5, []), (9.4, ["B", "C"]), (11.0, [])]
)
def test_what_may_be_as_good_as_the_best_is_fitted_as_well(monkeypatch, least, more):
    """The best fit takes 10 - ``least`` off the mean square of 100 samples; B promised 740, C 400.

    Up to 50 is noise.
    """
    monkeypatch.setattr(round_fits, "fits_from_starts", lambda scores, *_: [Fit(one, left(3.0)) for one in scores])
    scores = [score("A", 900.0), score("B", 740.0), score("C", 400.0), score("D", 30.0)]
    fits = [Fit(scores[0], left(least)), Fit(score("E", 20.0), left(12.0))]
    found = with_rivals(fits, dict.fromkeys([*scores, fits[1].score], 50.0), BASE, None, SEARCH)
    assert found[:2] == fits
    assert [one.score.candidate.key for one in found[2:]] == more


def test_few_more_are_fitted(monkeypatch):
    monkeypatch.setattr(round_fits, "fits_from_starts", lambda scores, *_: [Fit(one, left(3.0)) for one in scores])
    scores = [score(str(k), 900.0) for k in range(20)]
    found = with_rivals([Fit(scores[0], left(1.0))], dict.fromkeys(scores, 50.0), BASE, None, SEARCH)
    assert len(found) == 1 + MAX_RIVALS


@pytest.mark.parametrize(("ends", "kept"), [((np.nan, 4.0), [4.0]), ((np.inf, np.nan), []), ((5.0, 4.0), [4.0])])
def test_a_fit_whose_simulation_fails_does_not_count(monkeypatch, ends, kept):
    """The root of what becomes negative: one such candidate once ended the whole search."""
    by_start = dict(enumerate(ends))
    monkeypatch.setattr(round_fits, "optimized", lambda problem, setup, start: left(by_start[start]))
    found = fits_from_starts([score("A", 1.0, starts=(0, 1))], None, SEARCH)
    assert [one.model.mean_square for one in found] == kept
