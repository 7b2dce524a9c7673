"""Accepted effects that are not determined beside the others are left out, and the search is repeated without them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.decision import Shrinkage, held_out_losses, mean_loss, shrinkage_of
from tsmblocks.diagnosis.determined import is_determined, lost_parameters
from tsmblocks.diagnosis.diagnosed_part import Omission
from tsmblocks.diagnosis.exchange import exchange_effects, rounds_for
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.forward_selection import closing_round, forward_search
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.quantities import Estimate
from tsmblocks.diagnosis.rejection import NO_SIZE, NOT_DETERMINED, TAKES_PLACE
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.effects import Effect, Relative

MAX_TURNS = 2
"""Times that the search continues without an effect that was left out. Chosen: for the run time."""
MAX_ROUNDS = 5
"""Rounds of these searches after which it does not continue again. Chosen: for the run time; where so many name nothing
that stays, the cause is hardly in the catalogue."""

LeftOut = tuple[list[SearchRound], Model, Shrinkage]
"""The rounds of the effects that stay, the model with them, and their shrinkage."""


def without_undetermined(
    rounds: Sequence[SearchRound], search: SearchContext
) -> tuple[list[SearchRound], list[Omission]]:
    """Rounds in which every accepted effect is determined beside all the others, and those that were left out.

    Effects that were left out beside one that has no determined size itself are candidates again without that one, if
    none is left.
    """
    left, omitted = _determined_rounds(rounds, search)
    alone = [one for one in omitted if one.reason == NO_SIZE]
    if accepted_count(left, search) or not alone or len(alone) == len(omitted):
        return left, omitted
    gone, again = [one.effect.candidate.effect for one in alone], list[SearchRound]()
    search = attrs.evolve(search, effects=[one for one in search.effects if all(_may_follow(one, x) for x in gone)])
    forward_search(rounds[0].base, {}, search, again)
    found, more = _determined_rounds(exchange_effects(again, search), search)
    return (found, [*alone, *more]) if accepted_count(found, search) else (left, omitted)


def _determined_rounds(
    rounds: Sequence[SearchRound], search: SearchContext
) -> tuple[list[SearchRound], list[Omission]]:
    """Rounds in which every accepted effect is determined beside all the others, and those that were left out.

    One that is not is left out, or the one that was named last and made it so, whichever leaves less; so is the last
    of several where parameters of the base are not determined any more. The search then continues without its name:
    the next best candidate is tried, which may be a simpler variant of the same effect.
    """
    rounds, base, omitted, more = list(rounds), rounds[0].base, list[Omission](), 0
    for turn in itertools.count():  # each leaves one effect out, and only the first ones search for more
        accepted = rounds[: accepted_count(rounds, search)]
        named = [one.verdict.named for one in accepted if one.verdict.named is not None]
        open_ones, reason = _open_effects(rounds, len(accepted), base), NOT_DETERMINED if len(named) > 1 else NO_SIZE
        if not open_ones and _loses_the_model(rounds, len(accepted)):
            open_ones, reason = named[-1:], TAKES_PLACE
        if not open_ones:
            break
        outs = [open_ones[-1]] if named[-1] is open_ones[-1] else [open_ones[-1], named[-1]]
        left = [rounds_for([one for one in accepted if one.verdict.named is not out], search, base) for out in outs]
        best = int(np.argmin([_loss(one, search) for one in left]))
        omitted.append(Omission.of(rounds, outs[best], reason))
        gone, (rounds, model, shrinkage) = outs[best].candidate.effect, left[best]
        search = attrs.evolve(search, effects=[one for one in search.effects if _may_follow(one, gone)])
        if turn < MAX_TURNS and more < MAX_ROUNDS:
            kept = len(rounds)
            forward_search(model, shrinkage, search, rounds)
            more += len(rounds) - kept
        else:
            rounds.append(closing_round(model, shrinkage, search))
    return rounds, omitted


def determined_count(rounds: Sequence[SearchRound], count: int) -> int:
    """How many of the first ``count`` effects are determined beside one another, from the first on.

    Where a search is stopped before those that are not are left out, with the effects named after them.
    """
    base = rounds[0].base
    while count and (_open_effects(rounds, count, base) or _loses_the_model(rounds, count)):
        count -= 1
    return count


def _loses_the_model(rounds: Sequence[SearchRound], count: int) -> bool:
    """Whether parameters of the base are not determined beside several effects, ``count`` of them.

    One effect may take the place of a part of the base, as a gap does of a loop of another shape.
    """
    return count > 1 and bool(lost_parameters(rounds[count].base, rounds[0].base))


def _open_effects(rounds: Sequence[SearchRound], count: int, base: Model) -> list[FittedCandidate]:
    """Those of the first ``count`` effects that are not determined in the model that adds all of them to a base."""
    named = [one.verdict.named for one in rounds[:count] if one.verdict.named is not None]
    return [one for one in named if not _is_determined(one, rounds[count].base, base)]


def _may_follow(one: Effect | Relative, gone: Effect) -> bool:
    """Whether an effect is still a candidate after one was left out: another, or a variant without more parameters."""
    more = (len(one.free), len(getattr(one, "local", ()))) > (len(gone.free), len(gone.local))
    return one.name != gone.name or not (more or getattr(one, "variant", "") == gone.variant)


def _is_determined(one: FittedCandidate, model: Model, base: Model) -> bool:
    """Whether an effect is clear of having no size, in a model that adds it to a base."""
    nulls = {k: null for k, (null, _) in shrinkage_of(one.candidate).items() if np.isfinite(null)}
    clear = is_determined(model, one.candidate, nulls, base)
    return clear and Estimate.of([base, model]).is_clear_of_zero(one.candidate)


def _loss(left: LeftOut, search: SearchContext) -> float:
    """Held-out loss of the model that stays."""
    _, model, shrinkage = left
    return mean_loss(held_out_losses(model, search.blocks, shrinkage)[0], search.blocks)
