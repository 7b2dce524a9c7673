"""What candidates gain in noise alone: the gain that one of them has to exceed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.decision import SIGNIFICANCE_LEVEL
from tsmblocks.diagnosis.screening_score import ScreeningScore

LEVEL_OF_TIME = 0.01
"""Probability that any effect of time exceeds the critical gain by chance. Chosen: below that of others, since the slow
part of a spectrum, which such effects resemble, is known from a few cycles only."""
OFFSET = "offset"
"""The effect that is a constant."""
SMALLEST_GAIN = 1e-9
"""Gain in noise, as a share of the sum of squares, that a candidate has at least. Chosen: rounding."""
LARGEST_SHARE = 1 - 1e-6
"""Gain in noise, as a share of the sum of squares, that a candidate has at most. Chosen: rounding."""


def is_of_time(candidate: Candidate) -> bool:
    """Whether a candidate is a function of time, which slow noise may resemble: steps, slopes, or a line in it.

    So is an offset that differs from one experiment to the next.
    """
    effect = candidate.effect
    return effect.family == "time" or (effect.name == OFFSET and bool(getattr(effect, "local", ())))


def critical_gains(
    scores: Sequence[ScreeningScore], total: float, multiplicity: Mapping[bool, float]
) -> dict[ScreeningScore, float]:
    """The gain [noise variances] of each candidate that any of them exceeds in noise alone with a probability of 5 %.

    ``total`` is the sum of squares of the residual. Gains count as they do in an F-test, gain over the rest.
    ``multiplicity`` is that of ``critical_ratios``.
    """
    limits = {one: multiplicity[is_of_time(one.candidate)] * _critical_alone(_ratios(one, total)) for one in scores}
    return {one: total * limit / (1 + limit) for one, limit in limits.items()}


def critical_ratios(scores: Sequence[ScreeningScore], total: float) -> dict[bool, float]:
    """How many times its own critical gain the best of all candidates reaches in noise, with a probability of 5 %
    (effects of time 1 %).

    Gains count in what the candidate itself reaches in noise (95 %), so that one with many shapes, which follows any
    noise, does not hide one with few. Effects of time, which slow noise resembles, are a family of their own (True).
    Source: Westfall and Young, Resampling-Based Multiple Testing (1993), on balanced tests.
    """
    result = {}
    for of_time in (False, True):
        family = [_ratios(one, total) for one in scores if is_of_time(one.candidate) == of_time]
        largest = np.max([one / _critical_alone(one) for one in family], axis=0) if family else np.ones(1)
        result[of_time] = max(_critical_alone(largest, LEVEL_OF_TIME if of_time else SIGNIFICANCE_LEVEL), 1.0)
    return result


def _ratios(score: ScreeningScore, total: float) -> np.ndarray:
    """Gains of a candidate in noise over what it leaves, one for each surrogate."""
    share = np.clip(score.noise_gains / max(total, SMALLEST_GAIN), SMALLEST_GAIN, LARGEST_SHARE)
    return np.asarray(share / (1 - share))


def _critical_alone(ratios: np.ndarray, level: float = SIGNIFICANCE_LEVEL) -> float:
    """What a share of these exceeds: one in twenty, or another ``level``."""
    return float(np.quantile(ratios, 1 - level))
