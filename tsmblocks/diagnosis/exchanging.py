"""What was named one after another, looked at once more beside all the rest: kept, exchanged, or dropped."""

from __future__ import annotations

from collections.abc import Sequence

import attrs

from tsmblocks.diagnosis.deciding import ALIKE, MATERIAL, Sizes, Tried, mean
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.rounds import MOST, Round, Search, counted, forward, look, onward


def exchanged(rounds: Sequence[Round], search: Search) -> list[Round]:
    """Rounds in which every effect still is what would be named beside all the others.

    Greedy search names the first effect while the others are not in the model yet: it may take two for one, or for
    another that imitates both. Each round but the last gets what was found beside the effects of all the others.
    """
    rounds = list(rounds)
    for _ in range(MOST):
        count = counted(rounds, search)
        for k in range(count - 1):
            better = _beside_others(rounds, k, count, search)
            if better is not None:
                rounds = better
                break
        else:
            return rounds
    return rounds


def _beside_others(rounds: list[Round], k: int, count: int, search: Search) -> list[Round] | None:
    """Other rounds, where effect ``k`` would not be named beside the others; else None, and what was found is kept."""
    named = [one.verdict.named for one in rounds[:count] if one.verdict.named is not None]
    this, others = named[k], named[:k] + named[k + 1 :]
    start = _chain(rounds[0].base, others, search)
    again = look(start[1], start[2], search)
    new = again.verdict.named if again.verdict.beyond == float("inf") else None
    if new is not None and _kept(this, new):
        rounds[k] = attrs.evolve(rounds[k], beside=again)
        return None
    if new is None:  # beside the others nothing would be named here
        made, least, allowed = [*start[0], again], len(start[0]), MATERIAL
    else:
        whole = _chain(rounds[0].base, [*named[:k], new, *named[k + 1 :]], search)
        if len(whole[0]) < count:
            return None
        made, least, allowed = whole[0], count, ALIKE
        made[k] = attrs.evolve(made[k], beside=again)
        forward(whole[1], whole[2], search, made)
    kept = counted(made, search)
    loss, before = (mean(some[n].losses, search.parts) for some, n in ((made, kept), (rounds, count)))
    return made if kept >= least and loss <= before + allowed * search.floor else None


def _kept(this: Tried, new: Tried) -> bool:
    """Whether the same effect is named again, or one that merely says it in more general terms."""
    name, effect = this.candidate.effect.name, new.candidate.effect
    return effect.name == name or name in effect.contains


def _chain(model: Model, effects: Sequence[Tried], search: Search) -> tuple[list[Round], Model, Sizes]:
    """Rounds that look for these effects alone, the model with them, and their sizes; one that is not found is left
    out.
    """
    made: list[Round] = []
    known: Sizes = {}
    for one in effects:
        found = look(model, known, attrs.evolve(search, effects=[one.candidate.effect]))
        if found.verdict.named is None:
            continue
        made.append(attrs.evolve(found, narrow=True))
        model, known = onward(found.verdict.named, known)
    return made, model, known
