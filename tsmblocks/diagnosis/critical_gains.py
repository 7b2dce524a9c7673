"""What candidates gain in noise alone: the gain that one of them has to exceed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.decision import SIGNIFICANCE_LEVEL
from tsmblocks.diagnosis.oscillation import is_oscillation
from tsmblocks.diagnosis.screening_score import ScreeningScore

MOTION, SLOW, OSCILLATION, SLOW_MOTION = "motion", "slow", "oscillation", "slow motion"
"""Families of candidates, for each of which the level of significance holds; those of the motion that change the
outputs slowly are judged beside the slow part of the residual as well."""
SURROGATES = 99
"""Surrogates of the residual of each kind in which every candidate is tried. Chosen: for the run time."""
LEVEL_OF_SLOW = 0.01
"""Probability that any slow function of time exceeds the critical gain by chance. Chosen: below that of others, since
the slow part of a spectrum, which such effects resemble, is known from a few cycles only."""
OFFSET = "offset"
"""The effect that is a constant."""
WANDERING = (OFFSET, "drift", "jump")
"""Effects that add a slow function of time, as slow noise does. Changes of a gain move with the motion."""
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


def critical_gains(scores: Sequence[ScreeningScore], multiplicity: Mapping[str, float]) -> dict[ScreeningScore, float]:
    """The gain [noise variances] of each candidate that any of them exceeds in noise alone with a probability of 5 %.

    Of slow functions of time, and beside the slow part, 1 %. Gains count as they do in an F-test, gain over the rest.
    ``multiplicity`` is that of ``critical_multiplicity``.
    """
    limits = {one: _limit(one, multiplicity[family_of(one.candidate)]) for one in scores}
    slow = {one: _limit(part, multiplicity[SLOW_MOTION]) for one, part in _slow_parts(scores).items()}
    return {one: min(limit, slow.get(one, np.inf)) for one, limit in limits.items()}


def _limit(score: ScreeningScore, multiplicity: float) -> float:
    limit = multiplicity * _critical_alone(_ratios(score))
    return float(score.squares * limit / (1 + limit))


def _slow_parts(scores: Sequence[ScreeningScore]) -> dict[ScreeningScore, ScreeningScore]:
    """The scores of slow candidates of the motion, and what they are beside the slow part of the residual."""
    return {
        one: attrs.evolve(one, squares=one.slow_part[0], noise_squares=one.slow_part[1])
        for one in scores
        if one.slow_part is not None
    }


def is_wandering(candidate: Candidate) -> bool:
    """Whether a candidate adds a slow function of time and nothing else."""
    return is_of_time(candidate) and candidate.effect.name in WANDERING


def family_of(candidate: Candidate) -> str:
    """Functions of the motion, slow functions of time, and oscillations, which slow noise resembles least."""
    if not is_of_time(candidate):
        return MOTION
    return OSCILLATION if is_oscillation(candidate) else SLOW


def critical_multiplicity(scores: Sequence[ScreeningScore]) -> dict[str, float]:
    """How many times its own critical gain the best of all candidates of a family reaches in noise.

    With a probability of 5 %, and of 1 % for slow functions of time and beside the slow part; at least 1.

    Gains count in what the candidate itself reaches in noise (95 %), so that one with many shapes, which follows any
    noise, does not hide one with few.
    Source: Westfall and Young, Resampling-Based Multiple Testing (1993), on balanced tests.
    """
    result = {}
    families = {
        name: [one for one in scores if family_of(one.candidate) == name] for name in (MOTION, SLOW, OSCILLATION)
    }
    families[SLOW_MOTION] = list(_slow_parts(scores).values())
    for name, some in families.items():
        ratios = [_ratios(one) for one in some]
        largest = np.max([one / _critical_alone(one) for one in ratios], axis=0) if ratios else np.ones(1)
        level = LEVEL_OF_SLOW if name in (SLOW, SLOW_MOTION) else SIGNIFICANCE_LEVEL
        result[name] = max(_critical_alone(largest, level), 1.0)
    return result


def _ratios(score: ScreeningScore) -> np.ndarray:
    """Gains of a candidate in noise over what it leaves, one for each surrogate."""
    share = np.clip(score.noise_gains / np.maximum(score.noise_squares, SMALLEST_GAIN), SMALLEST_GAIN, LARGEST_SHARE)
    return np.asarray(share / (1 - share))


def _critical_alone(ratios: np.ndarray, level: float = SIGNIFICANCE_LEVEL) -> float:
    """What a share of these exceeds: one in twenty, or another ``level``; of two kinds of noise in the worse."""
    kinds = ratios.reshape(-1, SURROGATES) if len(ratios) % SURROGATES == 0 else ratios[None, :]
    return float(np.quantile(kinds, 1 - level, axis=1).max())
