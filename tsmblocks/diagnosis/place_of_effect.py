"""Which place of an effect is named, of several at which it explains as much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsmblocks.diagnosis.determined import directions_without_effect
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.fitting.identifiability import SMALL


def at_best_place(named: FittedCandidate, close: Sequence[FittedCandidate]) -> FittedCandidate:
    """The candidate, or the same effect at another place where that explains as much and says more.

    At a measured output its size has the unit of a measurement; of two places there the one behind all else is taken,
    where only the sensor is. Elsewhere it is a place where its size does not depend on how gains of the model in a row
    share their product. A characteristic at the output with one parameter more is taken before a spring: it does not
    say what bends.
    """
    effect = named.candidate.effect
    most = named.parameter_count + (effect.place == "load" and effect.family == "map")
    if effect.place == "output" and is_of_sensor(named):
        return named
    counts = range(named.parameter_count, most + 1)
    same = [one for one in close if one.candidate.effect.name == effect.name and one.parameter_count in counts]
    at_output = [one for one in same if one.candidate.effect.place == "output"]
    if effect.place == "output":
        at_output = [one for one in at_output if is_of_sensor(one)]
    if at_output or effect.place == "output":
        return min(at_output, key=lambda one: (not is_of_sensor(one), one.loss), default=named)
    if len(same) > 1 and not _has_a_size(named):
        return min(filter(_has_a_size, same), key=lambda one: one.loss, default=named)
    return named


def is_of_sensor(one: FittedCandidate) -> bool:
    """Whether a candidate is on the wire to a measured output that drives nothing else."""
    point = one.candidate.point
    return point.before == point.output


def _has_a_size(one: FittedCandidate) -> bool:
    """Whether no parameter of the effect can be changed along with those of the model, with the same outputs."""
    own = [item.parameter in one.candidate.free for item in one.model.problem.unknowns.items]
    return bool(np.abs(directions_without_effect(one.model)[own]).max(initial=0.0) < SMALL)
