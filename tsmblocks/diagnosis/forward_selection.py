"""Forward selection: one effect after another, each refitted with all before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.candidates import candidates, wire_signals
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import (
    INDISTINGUISHABLE_NOISE_SHARE,
    MIN_VARIANCE_REDUCTION,
    FittedCandidate,
    Shrinkage,
    Verdict,
    decide,
    fitted_candidate,
    held_out_losses,
    mean_loss,
    shrinkage_of,
)
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.model import Model, ModelSettings, converged, optimized
from tsmblocks.diagnosis.screening import ScreeningScore, base_subspace, screening_score
from tsmblocks.effects import Effect

MAX_EFFECTS = 4
"""Effects named at most."""
MIN_FITTED_CANDIDATES = 3
"""Candidates fitted in a round at least, if there are so many."""
MAX_FITTED_CANDIDATES = 14
"""Candidates fitted at most."""
MIN_SCREENING_SCORE = 0.02
"""Promised fall of the mean square, in variances of the noise, from which a candidate may be worth a fit."""
MIN_EXCESS_SHARE = 0.5
"""Share of the excess that an effect has to remove."""
MIN_SHARE_OF_REMOVED = 0.15
"""Share of all that was removed below which an effect after the first is taken for a fault of the first one's form."""
MIN_FURTHER_SHARE = 0.2
"""Share of what is left that a further effect has to remove, where it removes more than the noise itself."""
MEMORY_SEARCH_RATIO = 2.0
"""How many times the least that a candidate leaves another one may leave whose memories are looked at once more."""
MIN_JOINT_SHARE = 0.8
"""Share of the excess that several have to remove, none of which removes half by itself."""
MIN_RELATIVE_SCORE = 0.15
"""Share of the best promise from which it is."""

ProgressCallback = Callable[[str, int, int], None]


@attrs.frozen(eq=False)
class SearchRound:
    """One look for an effect: the base of that round, its losses, what was promised and what was tried.

    ``repeated`` is the same search repeated with all effects that were named later in the model. ``single_effect`` is
    True where the round searched for one given effect only.
    """

    base: Model
    losses: np.ndarray
    experiment_losses: np.ndarray
    screening_scores: tuple[ScreeningScore, ...]
    verdict: Verdict
    repeated: SearchRound | None = None
    single_effect: bool = False

    @property
    def most_complete(self) -> SearchRound:
        """The look that tried most: this one, or the one beside all others."""
        return self.repeated if self.single_effect and self.repeated is not None else self

    @property
    def indistinguishable(self) -> tuple[FittedCandidate, ...]:
        """The effect named and those it cannot be told from, given all else that was named."""
        return (self.repeated or self).verdict.indistinguishable


@attrs.frozen(eq=False)
class SearchContext:
    """What every round needs: recordings, how models are set beside them, effects, blocks of time, the noise.

    ``noise_variance`` is the mean square of the noise, in the variances that residuals are counted in.
    ``tell(stage, done, of)`` is the progress callback.
    """

    records: Mapping[str, Record]
    settings: ModelSettings
    effects: Sequence[Effect]
    blocks: TimeBlocks
    noise_variance: float
    progress: ProgressCallback


def search_round(model: Model, shrinkage: Shrinkage, search: SearchContext) -> SearchRound:
    """Try every effect on every wire of a model, fit the most promising, and decide.

    ``shrinkage`` are the effects in the model already.
    """
    named, measured = {key.partition(".")[0] for key in shrinkage}, next(iter(search.records.values())).units
    places = insertion_points(model.fitted_diagram, search.settings.outputs, search.effects, named, measured)
    around = wire_signals(model, places)
    base, made = base_subspace(model), candidates(model, search.effects, around, places)
    screening_scores, shows = [], MIN_VARIANCE_REDUCTION * search.noise_variance * model.problem.samples
    for k, candidate in enumerate(made):
        search.progress("tried", k, len(made))
        screening_scores.append(screening_score(candidate, model, search.records, search.settings, around, base, shows))
    screening_scores.sort(key=lambda one: -one.gain)
    best = screening_scores[0].gain if screening_scores else 0.0
    worth = max(MIN_SCREENING_SCORE * search.noise_variance * model.problem.samples, MIN_RELATIVE_SCORE * best)
    chosen = [
        p for k, p in enumerate(screening_scores[:MAX_FITTED_CANDIDATES]) if k < MIN_FITTED_CANDIDATES or p.gain > worth
    ]
    models = []
    for k, one in enumerate(chosen):
        search.progress("fitted", k, len(chosen))
        models.append(fit_candidate(one))
    least = min((one.mean_square for one in models), default=0.0)
    models = [refine_memories(one, 1) if one.mean_square <= MEMORY_SEARCH_RATIO * least else one for one in models]
    found = [
        fitted_candidate(p.candidate, one, search.blocks, shrinkage) for p, one in zip(chosen, models, strict=True)
    ]
    losses, experiment_losses = held_out_losses(model, search.blocks, shrinkage)
    verdict = decide(losses, found, search.blocks, search.noise_variance, search.settings.seed)
    return SearchRound(model, losses, experiment_losses, tuple(screening_scores), verdict)


def fit_candidate(one: ScreeningScore) -> Model:
    """The best end of searches from the starts of a promise."""
    ends = [optimized(one.problem, one.setup, start) for start in one.starts]
    return min(ends, key=lambda m: m.mean_square)


def forward_search(model: Model, shrinkage: Shrinkage, search: SearchContext, rounds: list[SearchRound]) -> None:
    """Add rounds until nothing more passes; which of them count is for ``accepted_count`` to say.

    ``shrinkage`` are the effects in the model already.
    """
    while len(rounds) <= MAX_EFFECTS:
        try:
            one = search_round(model, shrinkage, search)
        except KeyboardInterrupt:  # what was named before still counts
            if rounds:
                rounds.append(_unlooked(model, shrinkage, search))
            raise
        rounds.append(one)
        if one.verdict.named is None:
            break
        model, shrinkage = next_base(one.verdict.named, shrinkage)


def next_base(named: FittedCandidate, shrinkage: Shrinkage) -> tuple[Model, Shrinkage]:
    """The model that the next look begins with, and the effects in it."""
    return refine_memories(converged(named.model)), {**shrinkage, **shrinkage_of(named.candidate)}


def _unlooked(model: Model, shrinkage: Shrinkage, search: SearchContext) -> SearchRound:
    """A round in which nothing was tried: only what the model leaves."""
    losses, experiment_losses = held_out_losses(model, search.blocks, shrinkage)
    return SearchRound(model, losses, experiment_losses, (), Verdict((), (), float("inf"), None, ()))


def accepted_count(rounds: Sequence[SearchRound], search: SearchContext) -> int:
    """How many of the effects found count: those that together remove most of what can be removed.

    The first counts that removes half of the excess; where none does, two or more do that together remove four fifths,
    effects of the same size. A further one counts where it removes a good share of what is left, and is no mere fault
    of the form of those before: those are small beside the noise, and beside what was removed. None count that leave
    more than an effect that left its bounds would.
    """
    losses = [mean_loss(one.losses, search.blocks) for one in rounds]
    before, count, beyond = losses[0], 0, float("inf")
    for k in range(1, len(losses)):
        beyond = min(beyond, rounds[k - 1].verdict.out_of_bounds_loss)
        if losses[k] > beyond:
            continue
        removed = losses[k - 1] - losses[k]
        step = removed / max(losses[k - 1] - search.noise_variance, 1e-12)
        whole = (before - losses[k]) / max(before - search.noise_variance, 1e-12)
        done = (before - losses[count]) / max(before - search.noise_variance, 1e-12) if count else 0.0
        weighty = (
            removed >= MIN_SHARE_OF_REMOVED * (before - losses[k])
            or removed >= search.noise_variance
            or step >= MIN_JOINT_SHARE
        )
        if done < MIN_EXCESS_SHARE:
            count = k if (step >= MIN_EXCESS_SHARE and count == k - 1) or whole >= MIN_JOINT_SHARE else count
        elif (
            count == k - 1
            and weighty
            and step >= (MIN_FURTHER_SHARE if removed >= search.noise_variance else MIN_EXCESS_SHARE)
        ):
            count = k
    return count


def exchange_effects(rounds: Sequence[SearchRound], search: SearchContext) -> list[SearchRound]:
    """Rounds in which every effect still is what would be named beside all the others.

    Greedy search names the first effect while the others are not in the model yet: it may take two for one, or for
    another that imitates both. Each round but the last gets what was found beside the effects of all the others.
    """
    rounds = list(rounds)
    for _ in range(MAX_EFFECTS):
        count = accepted_count(rounds, search)
        for k in range(count - 1):
            better = _beside_others(rounds, k, count, search)
            if better is not None:
                rounds = better
                break
        else:
            return rounds
    return rounds


def _beside_others(rounds: list[SearchRound], k: int, count: int, search: SearchContext) -> list[SearchRound] | None:
    """Other rounds, where effect ``k`` would not be named beside the others; else None, and what was found is kept."""
    named = [one.verdict.named for one in rounds[:count] if one.verdict.named is not None]
    this, others = named[k], named[:k] + named[k + 1 :]
    start = _chain(rounds[0].base, others, search)
    again = search_round(start[1], start[2], search)
    new = again.verdict.named if again.verdict.out_of_bounds_loss == float("inf") else None
    if new is not None and _kept(this, new):
        rounds[k] = attrs.evolve(rounds[k], repeated=again)
        return None
    if new is None:  # beside the others nothing would be named here
        made, least, allowed = [*start[0], again], len(start[0]), MIN_VARIANCE_REDUCTION
    else:
        whole = _chain(rounds[0].base, [*named[:k], new, *named[k + 1 :]], search)
        if len(whole[0]) < count:
            return None
        made, least, allowed = whole[0], count, INDISTINGUISHABLE_NOISE_SHARE
        made[k] = attrs.evolve(made[k], repeated=again)
        forward_search(whole[1], whole[2], search, made)
    kept = accepted_count(made, search)
    loss, before = (mean_loss(some[n].losses, search.blocks) for some, n in ((made, kept), (rounds, count)))
    return made if kept >= least and loss <= before + allowed * search.noise_variance else None


def _kept(this: FittedCandidate, new: FittedCandidate) -> bool:
    """Whether the same effect is named again, or one that merely says it in more general terms."""
    name, effect = this.candidate.effect.name, new.candidate.effect
    return effect.name == name or name in effect.contains


def _chain(
    model: Model, effects: Sequence[FittedCandidate], search: SearchContext
) -> tuple[list[SearchRound], Model, Shrinkage]:
    """Rounds that look for these effects alone, the model with them, and their sizes; one that is not found is left
    out.
    """
    made: list[SearchRound] = []
    shrinkage: Shrinkage = {}
    for one in effects:
        found = search_round(model, shrinkage, attrs.evolve(search, effects=[one.candidate.effect]))
        if found.verdict.named is None:
            continue
        made.append(attrs.evolve(found, single_effect=True))
        model, shrinkage = next_base(found.verdict.named, shrinkage)
    return made, model, shrinkage
