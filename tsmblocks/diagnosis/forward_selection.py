"""Forward selection: one effect after another, each refitted with all before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.candidates import candidates, surroundings
from tsmblocks.diagnosis.cross_validation import Parts
from tsmblocks.diagnosis.decision import (
    ALIKE,
    MATERIAL,
    Sizes,
    Tried,
    Verdict,
    decide,
    losses_of,
    mean,
    sizes_of,
    tried,
)
from tsmblocks.diagnosis.initial_states import settled_memories
from tsmblocks.diagnosis.insertion_points import sites
from tsmblocks.diagnosis.model import Asked, Model, polished, searched
from tsmblocks.diagnosis.screening import Promise, absorbing, promise
from tsmblocks.effects import Effect

MOST = 4
"""Effects named at most."""
FITTED = 3
"""Candidates fitted in a round at least, if there are so many."""
MORE = 14
"""Candidates fitted at most."""
WORTH = 0.02
"""Promised fall of the mean square, in variances of the noise, from which a candidate may be worth a fit."""
HALF = 0.5
"""Share of the excess that an effect has to remove."""
SLIGHT = 0.15
"""Share of all that was removed below which an effect after the first is taken for a fault of the first one's form."""
FURTHER = 0.2
"""Share of what is left that a further effect has to remove, where it removes more than the noise itself."""
CLOSE = 2.0
"""How many times the least that a candidate leaves another one may leave whose memories are looked at once more."""
MOSTLY = 0.8
"""Share of the excess that several have to remove, none of which removes half by itself."""
NEAR = 0.15
"""Share of the best promise from which it is."""

Tell = Callable[[str, int, int], None]


@attrs.frozen(eq=False)
class Round:
    """One look for an effect: the base of that round, its losses, what was promised and what was tried.

    ``beside`` is the look for the same effect beside all that were named later. ``narrow`` tells that only one effect
    was looked for, one that was known already.
    """

    base: Model
    losses: np.ndarray
    across: np.ndarray
    promises: tuple[Promise, ...]
    verdict: Verdict
    beside: Round | None = None
    narrow: bool = False

    @property
    def widest(self) -> Round:
        """The look that tried most: this one, or the one beside all others."""
        return self.beside if self.narrow and self.beside is not None else self

    @property
    def alike(self) -> tuple[Tried, ...]:
        """The effect named and those it cannot be told from, given all else that was named."""
        return (self.beside or self).verdict.alike


@attrs.frozen(eq=False)
class Search:
    """What every round needs: recordings, how models are set beside them, effects, blocks of time, the noise.

    ``floor`` is the mean square of the noise, in the variances that residuals are counted in. ``tell(stage, done, of)``
    is told how far it is.
    """

    records: Mapping[str, Record]
    asked: Asked
    effects: Sequence[Effect]
    parts: Parts
    floor: float
    tell: Tell


def look(model: Model, known: Sizes, search: Search) -> Round:
    """Try every effect on every wire of a model, fit the most promising, and decide.

    ``known`` are the effects in the model already.
    """
    named, measured = {key.partition(".")[0] for key in known}, next(iter(search.records.values())).units
    places = sites(model.fitted, search.asked.outputs, search.effects, named, measured)
    around = surroundings(model, places)
    base, made = absorbing(model), candidates(model, search.effects, around, places)
    promises, shows = [], MATERIAL * search.floor * model.problem.samples
    for k, candidate in enumerate(made):
        search.tell("tried", k, len(made))
        promises.append(promise(candidate, model, search.records, search.asked, around, base, shows))
    promises.sort(key=lambda one: -one.gain)
    best = promises[0].gain if promises else 0.0
    worth = max(WORTH * search.floor * model.problem.samples, NEAR * best)
    chosen = [p for k, p in enumerate(promises[:MORE]) if k < FITTED or p.gain > worth]
    models = []
    for k, one in enumerate(chosen):
        search.tell("fitted", k, len(chosen))
        models.append(fitted(one))
    least = min((one.mean_square for one in models), default=0.0)
    models = [settled_memories(one, 1) if one.mean_square <= CLOSE * least else one for one in models]
    found = [tried(p.candidate, one, search.parts, known) for p, one in zip(chosen, models, strict=True)]
    losses, across = losses_of(model, search.parts, known)
    verdict = decide(losses, found, search.parts, search.floor, search.asked.seed)
    return Round(model, losses, across, tuple(promises), verdict)


def fitted(one: Promise) -> Model:
    """The best end of searches from the starts of a promise."""
    ends = [searched(one.problem, one.setup, start) for start in one.starts]
    return min(ends, key=lambda m: m.mean_square)


def forward(model: Model, known: Sizes, search: Search, rounds: list[Round]) -> None:
    """Add rounds until nothing more passes; which of them count is for ``counted`` to say.

    ``known`` are the effects in the model already.
    """
    while len(rounds) <= MOST:
        try:
            one = look(model, known, search)
        except KeyboardInterrupt:  # what was named before still counts
            if rounds:
                rounds.append(_unlooked(model, known, search))
            raise
        rounds.append(one)
        if one.verdict.named is None:
            break
        model, known = onward(one.verdict.named, known)


def onward(named: Tried, known: Sizes) -> tuple[Model, Sizes]:
    """The model that the next look begins with, and the effects in it."""
    return settled_memories(polished(named.model)), {**known, **sizes_of(named.candidate)}


def _unlooked(model: Model, known: Sizes, search: Search) -> Round:
    """A round in which nothing was tried: only what the model leaves."""
    losses, across = losses_of(model, search.parts, known)
    return Round(model, losses, across, (), Verdict((), (), float("inf"), None, ()))


def counted(rounds: Sequence[Round], search: Search) -> int:
    """How many of the effects found count: those that together remove most of what can be removed.

    The first counts that removes half of the excess; where none does, two or more do that together remove four fifths,
    effects of the same size. A further one counts where it removes a good share of what is left, and is no mere fault
    of the form of those before: those are small beside the noise, and beside what was removed. None count that leave
    more than an effect that left its bounds would.
    """
    losses = [mean(one.losses, search.parts) for one in rounds]
    before, count, beyond = losses[0], 0, float("inf")
    for k in range(1, len(losses)):
        beyond = min(beyond, rounds[k - 1].verdict.beyond)
        if losses[k] > beyond:
            continue
        removed = losses[k - 1] - losses[k]
        step = removed / max(losses[k - 1] - search.floor, 1e-12)
        whole = (before - losses[k]) / max(before - search.floor, 1e-12)
        done = (before - losses[count]) / max(before - search.floor, 1e-12) if count else 0.0
        weighty = removed >= SLIGHT * (before - losses[k]) or removed >= search.floor or step >= MOSTLY
        if done < HALF:
            count = k if (step >= HALF and count == k - 1) or whole >= MOSTLY else count
        elif count == k - 1 and weighty and step >= (FURTHER if removed >= search.floor else HALF):
            count = k
    return count


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
