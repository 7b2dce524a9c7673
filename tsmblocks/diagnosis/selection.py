"""The effects of a model: the forward search with its revision, and again from the runners-up of its first round."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION, FittedCandidate, mean_loss
from tsmblocks.diagnosis.diagnosed_part import UNKNOWN_EXCESS, Omission
from tsmblocks.diagnosis.forward_selection import (
    MIN_JOINT_SHARE,
    SearchContext,
    SearchRound,
    accepted_count,
    attained_noise,
    exchange_effects,
    forward_search,
    next_base,
)
from tsmblocks.diagnosis.recurring_events import without_recurring_events
from tsmblocks.diagnosis.undetermined import without_undetermined

MAX_OTHER_FIRST_EFFECTS = 2
"""Runners-up of the first round from which the search begins again. Chosen: each takes as long as the search did."""


@attrs.frozen(eq=False)
class Selection:
    """Rounds whose effects hold beside all the others, notes on them, and the effects that were left out."""

    rounds: list[SearchRound]
    notes: Sequence[str]
    omitted: Sequence[Omission]

    def loss(self, search: SearchContext) -> float:
        """Held-out loss of the model with the accepted effects [noise variances]."""
        return mean_loss(self.rounds[accepted_count(self.rounds, search)].losses, search.blocks)


def selected(rounds: list[SearchRound], search: SearchContext) -> Selection:
    """The selection from the rounds of a forward search, or a better one that begins with another effect.

    Forward selection names one effect at a time. Where two act, the first one named may be a third that explains a
    part of both, and what it leaves has no name. Where that is a material part of the error, the search begins again
    with the runners-up of its first round, until one leaves less.
    """
    best, first = _revised(rounds, search), rounds[0]
    for other in _other_first_effects(first, best):
        if not _leaves_error(best, search):
            break
        start = attrs.evolve(first, verdict=attrs.evolve(first.verdict, named=other, indistinguishable=(other,)))
        model, shrinkage = next_base(other, {}, search.settings)
        again = [start]
        forward_search(model, shrinkage, search, again)
        found = _revised(again, search)
        if found.loss(search) < best.loss(search) - MIN_VARIANCE_REDUCTION * search.noise_variance:
            best = found
    return best


def _revised(rounds: list[SearchRound], search: SearchContext) -> Selection:
    kept, undetermined = without_undetermined(exchange_effects(rounds, search), search)
    kept, notes, recurring = without_recurring_events(kept, search)
    return Selection(kept, notes, [*undetermined, *recurring])


def _leaves_error(one: Selection, search: SearchContext) -> bool:
    """Whether effects were accepted that leave a material part of the error, which is no noise."""
    count = accepted_count(one.rounds, search)
    before, after = (mean_loss(one.rounds[k].losses, search.blocks) for k in (0, count))
    noise = search.noise.largest(float(np.median(one.rounds[count].losses)))
    large = after > (1 + UNKNOWN_EXCESS) * noise
    return count > 0 and large and before - after < MIN_JOINT_SHARE * (before - attained_noise(one.rounds, search))


def _other_first_effects(first: SearchRound, found: Selection) -> list[FittedCandidate]:
    """The best other candidates of a round that could have been named, one of each effect and variant."""
    verdict = first.verdict
    accepted = [verdict.named, *(one.verdict.named for one in found.rounds[:1])]
    seen = {(one.candidate.effect.name, one.candidate.effect.variant) for one in accepted if one is not None}
    result: list[FittedCandidate] = []
    for one, t in zip(verdict.ranking, verdict.t, strict=False):
        kind = one.candidate.effect.name, one.candidate.effect.variant
        if kind in seen or one.disqualifying_bounds or not one.tenable or t <= verdict.critical_value:
            continue
        seen.add(kind)
        result.append(one)
    return result[:MAX_OTHER_FIRST_EFFECTS] if verdict.named is not None else []
