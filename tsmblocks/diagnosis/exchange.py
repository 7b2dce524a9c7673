"""Exchange of early choices: every effect named is searched for again beside all the others."""

from __future__ import annotations

from collections.abc import Sequence

import attrs

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.decision import (
    INDISTINGUISHABLE_NOISE_SHARE,
    MIN_VARIANCE_REDUCTION,
    Shrinkage,
    is_more_general,
    mean_loss,
)
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.forward_selection import forward_search, search_round
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.next_base import next_base
from tsmblocks.diagnosis.screening_score import gain_beyond_noise
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.effects import Effect, Relative

MAX_EXCHANGES = 2
"""Effects that are exchanged for others, at most. Chosen: for the run time; where more change, none is there."""
MIN_REPEATED_SHARE = 0.1
"""Predicted gain of an effect beyond that in noise [the largest of its round] from which it is searched for again
beside the others. Chosen: candidates that are fitted have more; for the run time."""


def exchange_effects(rounds: Sequence[SearchRound], search: SearchContext) -> list[SearchRound]:
    """Rounds in which every effect is still the one that would be named beside all the others.

    Forward selection names the first effect while the others are not in the model yet: one effect may then replace two
    others, or another one. Each round but the last is repeated beside the effects of all the others.
    """
    rounds = list(rounds)
    for _ in range(MAX_EXCHANGES):
        count = accepted_count(rounds, search)
        for k in range(count - 1):
            better = _repeated_beside_others(rounds, k, count, search)
            if better is not None:
                rounds = better
                break
        else:
            return rounds
    return rounds


def _repeated_beside_others(
    rounds: list[SearchRound], k: int, count: int, search: SearchContext
) -> list[SearchRound] | None:
    """New rounds, if effect ``k`` would not be named beside the others and they are better; else None."""
    this, others, base = rounds[k].verdict.named, [*rounds[:k], *rounds[k + 1 : count]], rounds[0].base
    other_rounds, model, shrinkage = rounds_for(others, search, base)
    known = _with_all(rounds[k], rounds[count:])
    again = search_round(model, shrinkage, attrs.evolve(search, effects=_worth_repeating(known, search)), known)
    if again.verdict.named is None:
        again = search_round(model, shrinkage, search, known)
    new = again.verdict.named if again.verdict.out_of_bounds_loss == float("inf") else None
    if this is not None and new is not None and _same_effect(this, new) and not is_more_general(this, new):
        rounds[k] = attrs.evolve(rounds[k], repeated=again)
        return None
    if new is not None and any(_has_name_of(new, one) for one in others):  # a pair of one effect explains much
        return None
    if new is None:  # beside the others no effect would be named here
        made, least, allowed = [*other_rounds, again], len(other_rounds), MIN_VARIANCE_REDUCTION
    else:
        made, model, shrinkage = rounds_for([*rounds[:k], again, *rounds[k + 1 : count]], search, base)
        if len(made) < count:
            return None
        least, allowed = count, INDISTINGUISHABLE_NOISE_SHARE
        forward_search(model, shrinkage, search, made)
    kept = accepted_count(made, search)
    loss, before = (mean_loss(some[n].losses, search.blocks) for some, n in ((made, kept), (rounds, count)))
    return made if kept >= least and loss <= before + allowed * search.noise_variance else None


def _worth_repeating(found: SearchRound, search: SearchContext) -> list[Effect | Relative]:
    """The effects whose predicted gain in a round is a given share of the largest, and all forms of the one named."""
    if not found.screening_scores:
        return list(search.effects)
    gains = {one: gain_beyond_noise(one) for one in found.screening_scores}
    least = MIN_REPEATED_SHARE * max(gains.values())
    kept = {id(search.tried_as(one.candidate)) for one, gain in gains.items() if gain >= least}
    name = found.verdict.named.candidate.effect.name if found.verdict.named else ""
    return [one for one in search.effects if id(one) in kept or one.name == name]


def _with_all(found: SearchRound, after: Sequence[SearchRound]) -> SearchRound:
    """A round with the parameters of its effect in the model with all effects, which is the base ``after`` them."""
    if found.verdict.named is None or not after:
        return found
    named = attrs.evolve(found.verdict.named, model=after[0].base)
    return attrs.evolve(found, verdict=attrs.evolve(found.verdict, named=named))


def _same_effect(this: FittedCandidate, new: FittedCandidate) -> bool:
    """Whether the same effect is named again, or a more general form of it."""
    name, effect = this.candidate.effect.name, new.candidate.effect
    return effect.name == name or name in effect.contains


def _has_name_of(new: FittedCandidate, one: SearchRound) -> bool:
    """Whether an effect has the name of that which a round named."""
    return one.verdict.named is not None and one.verdict.named.candidate.effect.name == new.candidate.effect.name


def _is_simpler_form(one: Effect | Relative, other: Effect | Relative) -> bool:
    """Whether one is the same effect at the same kind of place, with fewer parameters."""
    if not (isinstance(one, Effect) and isinstance(other, Effect)):
        return False
    fewer = set(one.free) < set(other.free) and set(one.local) <= set(other.local)
    return fewer and (one.name, one.place) == (other.name, other.place)


def rounds_for(
    found: Sequence[SearchRound], search: SearchContext, model: Model
) -> tuple[list[SearchRound], Model, Shrinkage]:
    """Rounds that search for the effects named in these only, the model with them, and their shrinkage.

    ``model`` is the one without any effect. Effects that are not named alone are left out. A simpler form of an effect
    takes its place where it explains as much: it may have been no candidate beside those that are gone.
    """
    made = list[SearchRound]()
    shrinkage: Shrinkage = {}
    for one in found:
        if one.verdict.named is None:
            continue
        alone = search.tried_as(one.verdict.named.candidate)
        forms = [alone, *(other for other in search.effects if _is_simpler_form(other, alone))]
        again = search_round(model, shrinkage, attrs.evolve(search, effects=forms), one)
        if again.verdict.named is None:
            continue
        made.append(attrs.evolve(again, single_effect=True, repeated=one.repeated or one))
        model, shrinkage = next_base(again.verdict.named, shrinkage, search.settings)
    return made, model, shrinkage
