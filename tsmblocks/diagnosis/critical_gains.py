"""What candidates gain in noise alone: the gain that one of them has to exceed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.decision import SIGNIFICANCE_LEVEL
from tsmblocks.diagnosis.oscillation import is_oscillation
from tsmblocks.diagnosis.screening_score import ScreeningScore

MOTION, SLOW, OSCILLATION = "motion", "slow", "oscillation"
"""Families of candidates, for each of which the level of significance holds."""
LEVEL_OF_SLOW = 0.01
"""Probability that any slow function of time exceeds the critical gain by chance. Chosen: below that of others, since
the slow part of a spectrum, which such effects resemble, is known from a few cycles only."""
OFFSET = "offset"
"""The effect that is a constant."""
SMALLEST_GAIN = 1e-9
"""Gain in noise, as a share of the sum of squares, that a candidate has at least. Chosen: rounding."""
NORMAL_POWER = 1 / 3
"""Power of a sum of squares of normal values that is itself about normal, however many there are. Source: Wilson and
Hilferty, Proc. National Academy of Sciences 17 (1931), 684-688."""
MIN_SPREAD = 0.03
"""Distance from the median to the 95 % point of such powers of gains in noise, relative to the median, at least.
Derived: that of a sum of 600 squares; candidates have fewer parameters."""
LARGEST_SHARE = 1 - 1e-6
"""Gain in noise, as a share of the sum of squares, that a candidate has at most. Chosen: rounding."""


def is_of_time(candidate: Candidate) -> bool:
    """Whether a candidate is a function of time, which slow noise may resemble: steps, slopes, or a line in it.

    So is an offset that differs from one experiment to the next.
    """
    effect = candidate.effect
    return effect.family == "time" or (effect.name == OFFSET and bool(getattr(effect, "local", ())))


def critical_gains(scores: Sequence[ScreeningScore], multiplicity: Mapping[str, float]) -> dict[ScreeningScore, float]:
    """The gain [noise variances] of each candidate that any of them exceeds in noise alone with a probability of 5 %.

    Of slow functions of time, 1 %. Gains count as they do in an F-test, gain over the rest. ``multiplicity`` is that of
    ``critical_multiplicity``.
    """
    result = {}
    for one in scores:
        middle, spread = _middle_and_spread(_ratios(one))
        limit = (middle + multiplicity[family_of(one.candidate)] * spread) ** (1 / NORMAL_POWER)
        result[one] = one.squares * limit / (1 + limit)
    return result


def family_of(candidate: Candidate) -> str:
    """Functions of the motion, slow functions of time, and oscillations, which slow noise resembles least."""
    if not is_of_time(candidate):
        return MOTION
    return OSCILLATION if is_oscillation(candidate) else SLOW


def critical_multiplicity(scores: Sequence[ScreeningScore]) -> dict[str, float]:
    """How far in its own distribution the best of all candidates of a family gets in noise: 0 the median, 1 its 95 %.

    With a probability of 5 %, and of 1 % for slow functions of time; at least 1.

    So one with many shapes, which follows any noise, does not hide one with few, nor one whose gains scatter widely
    one whose gains do not.
    Source: Westfall and Young, Resampling-Based Multiple Testing (1993), on balanced tests.
    """
    result = {}
    for name in (MOTION, SLOW, OSCILLATION):
        family = [_distances(_ratios(one)) for one in scores if family_of(one.candidate) == name]
        level = LEVEL_OF_SLOW if name == SLOW else SIGNIFICANCE_LEVEL
        result[name] = max(float(np.quantile(np.max(family, axis=0), 1 - level)), 1.0) if family else 1.0
    return result


def _ratios(score: ScreeningScore) -> np.ndarray:
    """Gains of a candidate in noise over what it leaves, one for each surrogate."""
    share = np.clip(score.noise_gains / np.maximum(score.noise_squares, SMALLEST_GAIN), SMALLEST_GAIN, LARGEST_SHARE)
    return np.asarray(share / (1 - share))


def _middle_and_spread(ratios: np.ndarray) -> tuple[float, float]:
    """The median of the cube roots of these, and how far above it their 95 % point is."""
    middle, high = np.quantile(ratios**NORMAL_POWER, (0.5, 1 - SIGNIFICANCE_LEVEL))
    return float(middle), max(float(high - middle), MIN_SPREAD * float(middle))


def _distances(ratios: np.ndarray) -> np.ndarray:
    """How far each of these is above their median, in units of their 95 % point."""
    middle, spread = _middle_and_spread(ratios)
    return np.asarray((ratios**NORMAL_POWER - middle) / spread)
