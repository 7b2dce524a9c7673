"""Which of several effects is named that give a model the same outputs: the one beside which it stays nearest.

Creep of the output of a sum of branches, for one, and a further lag in parallel with them are one transfer function:
no motion separates them. The parameters of the model differ, though, and the user knows something of these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import attrs
import numpy as np

from tsmblocks.diagnosis.credibility import with_a_scale
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate

SAME_SHARE = 1e-4
"""Mean square of the difference of two models, over that of their residuals, up to which their outputs are the same.
Chosen: a hundredth of the rms; noise moves the fits by as much."""
NEARER = 0.05
"""Least difference of two distances from the parameters of the diagram. Chosen: parameters that differ by 5 %."""


def nearest_first(verdict: Verdict, given: Mapping[str, float]) -> Verdict:
    """The verdict in which, of effects of as many parameters with the same outputs, the one is named beside which the
    parameters of the model are nearest to ``given``, those of the diagram.
    """
    named = verdict.named
    if named is None:
        return verdict
    name = named.candidate.effect.name  # of places of one effect another rule chooses
    others = [one for one in verdict.indistinguishable if one.tenable and one.candidate.effect.name != name]
    same = [one for one in others if is_same_in_outputs(one, named)]
    nearest = min(same, key=lambda one: _distance(one, given), default=named)
    if _distance(nearest, given) > _distance(named, given) - NEARER:
        return verdict
    rest = (one for one in verdict.indistinguishable if one is not nearest)
    return attrs.evolve(verdict, named=nearest, indistinguishable=(nearest, *rest))


def is_same_in_outputs(one: FittedCandidate, other: FittedCandidate) -> bool:
    """Whether two candidates have as many parameters and give the model the same outputs."""
    r, other_r = one.model.r, other.model.r
    if one.parameter_count != other.parameter_count or r.shape != other_r.shape:
        return False
    return float(np.mean((r - other_r) ** 2)) <= SAME_SHARE * float(np.mean(other_r**2))


def _distance(one: FittedCandidate, given: Mapping[str, float]) -> float:
    """How far the parameters of a model are from those of the diagram: sum of the logarithms of their ratios."""
    known = with_a_scale(given)
    ratios = (abs(value / known[name]) for name, value in one.model.parameters().items() if known.get(name))
    return sum(abs(math.log(max(ratio, 1e-6))) for ratio in ratios)
