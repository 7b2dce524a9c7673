"""Forward selection: one effect after another, each refitted with all before it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence

import attrs

from tsmblocks.diagnosis.base_search import better_base
from tsmblocks.diagnosis.candidate_fits import at_sufficient_step, depends_on_given_step
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.commands import OtherCommands
from tsmblocks.diagnosis.critical_gains import MOTION, critical_gains, critical_multiplicity, family_of, is_wandering
from tsmblocks.diagnosis.decision import (
    Shrinkage,
    Verdict,
    decide,
    fitted_candidate,
    held_out_losses,
    mean_loss,
    noise_beside,
)
from tsmblocks.diagnosis.determined import instants_are_determined
from tsmblocks.diagnosis.evidence import evidence
from tsmblocks.diagnosis.fitted_candidate import FROM_INPUTS, NO_INSTANTS, FittedCandidate
from tsmblocks.diagnosis.forms_at_finer_step import form_at_finer_step, with_form
from tsmblocks.diagnosis.general_forms import generalized
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.next_base import next_base
from tsmblocks.diagnosis.noise_filtering import filters_noise
from tsmblocks.diagnosis.oscillation import (
    comes_back_with_motion,
    follows_motion,
    is_of_a_tone,
    is_oscillation,
    repeats_another,
)
from tsmblocks.diagnosis.own_parameters import at_own_parameters, is_rough
from tsmblocks.diagnosis.round_fits import fits_beside_own, fits_from_starts, refined_fits, with_rivals
from tsmblocks.diagnosis.same_outputs import nearest_first
from tsmblocks.diagnosis.screened_candidates import BADLY_PREDICTED, chosen_candidates, screened_candidates
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.diagnosis.shift_in_time import SHIFT_IN_TIME, is_shift_in_time
from tsmblocks.diagnosis.slow_sums import explains_slowest
from tsmblocks.diagnosis.takes_over import switches_off
from tsmblocks.diagnosis.time_and_distance import with_distances_first

CLEAR_GAIN = 5.0
"""Gain of a fit [critical gains] from which it may be more than predicted. Chosen: gains in noise are predicted ones,
and fits gain more in noise too. Of a real effect little is predicted where the base is far from it."""
LEFT_OF_NOISE = 0.1
"""Share of the excess of a residual over fast noise that is left, below which it was an effect. Chosen: a few
parameters hardly explain nine tenths of noise."""
MAX_EFFECTS = 4
"""Effects named at most. Chosen: the recorded benchmarks (EMPS, cascaded tanks, Silverbox) need three at most."""
MAX_BETTER_BASES = 2
"""Times that a round is repeated from a better optimum of its base, at most. Chosen: for the run time."""
MOST_FROM_INPUTS = 3
"""Candidates at most that noise of the inputs explains before none is named. Chosen: for the run time."""
MIN_GAIN_BESIDE_MOTION = 2.0
"""Gain of an oscillation at a harmonic of the motion, over what is predicted from the motion, from which it is a
disturbance all the same. Chosen: more than half of it is then no function of the motion."""


def search_round(
    model: Model, shrinkage: Shrinkage, search: SearchContext, found_in: SearchRound | None = None
) -> SearchRound:
    """Screen every effect on every admissible wire of a model, fit the best candidates, and decide by held-out losses.

    ``shrinkage`` is that of the effects in the model already. ``found_in`` is a search that named an effect in another
    model: its fit starts at the parameters there as well, and it is held against what the best of as many candidates
    as there were reaches in noise.
    """
    scores = screened_candidates(model, shrinkage, search)
    known = found_in.verdict.named if found_in else None
    own = None if shrinkage else at_own_parameters(model)
    chosen = chosen_candidates(scores, model, search, known)
    if own is None:
        fits = fits_from_starts(chosen, known, search)
    else:
        fits = fits_beside_own(scores, chosen, known, own, search, rough=is_rough(model))
    multiplicity = critical_multiplicity(scores)
    if found_in is not None:
        multiplicity = {k: max(one, found_in.multiplicity.get(k, 1.0)) for k, one in multiplicity.items()}
    limits = critical_gains(scores, multiplicity)
    fits = with_rivals(fits, limits, model, known, search)
    by_motion = functools.cache(lambda: _predicted_gain(model, search))
    may_be_noise = model.mean_square <= search.likely_noise
    losses, fitted = held_out_losses(model, search.blocks, shrinkage), []
    base_loss = mean_loss(losses[0], search.blocks)
    for score, m in refined_fits(fits, model.mean_square):
        candidate, gain = score.candidate, (model.mean_square - m.mean_square) * len(model.r)
        untenable = next(_why_noise(score, m, model, gain, limits[score], known, may_be_noise), "")
        untenable = untenable or next(_why_untenable(m, model, candidate, search, gain, by_motion), "")
        found = fitted_candidate(candidate, m, search.blocks, shrinkage, untenable)
        fitted.append(at_sufficient_step(found, base_loss, model.mean_square, search.blocks, shrinkage))
    noise_variance = noise_beside(fitted, search.noise)

    def decided(fits: Sequence[FittedCandidate]) -> Verdict:
        seed = search.settings.seed
        found = decide(losses[0], fits, search.blocks, noise_variance, seed, model.mean_square)
        found = with_distances_first(found, losses[0], search.blocks, search.only_frequency)
        return nearest_first(found, search.given)

    verdict = _beside_noise(decided, fitted, lambda one: search.exceeds_noise(model, one, len(scores)))
    return SearchRound(model, *losses, tuple(scores), verdict, multiplicity=multiplicity)


def _beside_noise(
    decided: Callable[[Sequence[FittedCandidate]], Verdict],
    fitted: Sequence[FittedCandidate],
    exceeds: Callable[[FittedCandidate], bool],
) -> Verdict:
    """The verdict on fitted candidates in which noise of the inputs does not explain as much as the one named."""
    for _ in range(MOST_FROM_INPUTS):
        verdict = decided(fitted)
        if verdict.named is None or exceeds(verdict.named):
            return verdict
        gone = {verdict.named, *verdict.indistinguishable}
        fitted = [attrs.evolve(one, untenable=one.untenable or FROM_INPUTS) if one in gone else one for one in fitted]
    return decided(fitted).without_name


def _why_noise(
    score: ScreeningScore,
    fitted: Model,
    base: Model,
    gain: float,
    limit: float,
    known: FittedCandidate | None,
    may_be_noise: bool,
) -> Iterator[str]:
    """Why what a fitted candidate gains beside a base is no more than it may in noise; nothing where it is more.

    ``known`` is one that was named in another model, in which it is known to explain more than it leaves;
    ``may_be_noise`` is whether noise as large as the residual of the base is likely.
    """
    new = known is None or known.candidate.effect.name != score.candidate.effect.name
    predicted = may_be_noise and new and score.candidate.effect.place not in BADLY_PREDICTED
    clear = gain > CLEAR_GAIN * limit or _explains_all(fitted, base, score)
    if gain <= limit or (predicted and score.gain <= limit and not clear):
        yield "random noise of its spectrum is reduced as much"
    if new and is_wandering(score.candidate) and not explains_slowest(fitted, base):
        yield "what it leaves wanders more"
    if score.states_alone_explain():
        yield "its initial states alone explain as much"


def _explains_all(fitted: Model, base: Model, score: ScreeningScore) -> bool:
    """Whether an effect of the motion that is not slow leaves hardly more than the fast noise of a residual.

    A few parameters do not reduce noise of many frequencies to its fast part.
    """
    before, after = base.mean_square - 1.0, fitted.mean_square - 1.0
    of_motion = family_of(score.candidate) == MOTION and not score.is_slow
    return of_motion and before > 0 and after <= LEFT_OF_NOISE * before


def _why_untenable(
    fitted: Model, base: Model, candidate: Candidate, search: SearchContext, gain: float, by_motion: Callable[[], float]
) -> Iterator[str]:
    """Why a candidate, fitted in addition to a base, is no effect, whatever it gains; nothing for one that may be.

    ``by_motion`` is what the motion predicts of the same sum of squares.
    """
    of_motion = follows_motion(fitted, base, candidate)
    if gain < MIN_GAIN_BESIDE_MOTION * by_motion() if of_motion else is_of_a_tone(fitted, base, candidate):
        yield "its frequency is that of the motion"
    if is_oscillation(candidate) and comes_back_with_motion(fitted, candidate):
        yield "it comes back with the motion"
    if repeats_another(fitted, candidate):
        yield "the same oscillation again"
    if filters_noise(fitted, candidate, {**search.input_noise, **search.noise_left}):
        yield "removes noise of the input only"
    if is_shift_in_time(fitted, candidate):
        yield SHIFT_IN_TIME
    if switches_off(fitted, base, search.effects, search.given):
        yield "it replaces the model instead of adding to it"
    if depends_on_given_step(fitted, base, search.settings):
        yield "its fit depends on the given step"
    if not instants_are_determined(fitted, candidate, base):
        yield NO_INSTANTS


def closing_round(model: Model, shrinkage: Shrinkage, search: SearchContext) -> SearchRound:
    """The round after the last effect: its candidates are listed, and none is named."""
    found = search_round(model, shrinkage, search)
    return attrs.evolve(found, verdict=found.verdict.without_name)


def _predicted_gain(model: Model, search: SearchContext) -> float:
    """Fall of the sum of squares [noise variances] by what is predicted from the motion, held out."""
    return max(model.mean_square - evidence(model, search.settings.seed).rest, 0.0) * len(model.r)


def forward_search(model: Model, shrinkage: Shrinkage, search: SearchContext, rounds: list[SearchRound]) -> None:
    """Add rounds until no candidate is named; ``accepted_count`` decides how many of them are accepted.

    ``shrinkage`` is that of the effects in the model already.
    """
    bases, first, before = 0, len(rounds), shrinkage
    while len(rounds) <= MAX_EFFECTS:
        one = _next_round(model, shrinkage, search, rounds)
        if one.verdict.named is not None and bases < MAX_BETTER_BASES:
            try:
                better = better_base(model, one.verdict.named, search.noise_variance)
            except KeyboardInterrupt:  # the round is complete; the search ends below
                better = None
            if better is not None:  # the round again: the effect may have compensated for a poor optimum
                model, bases = better, bases + 1
                continue
        general = generalized(rounds[-1].verdict, one.verdict, search.noise_variance) if len(rounds) > first else None
        if general is not None:  # it replaces the effect before, and the search continues from there
            one, shrinkage = attrs.evolve(rounds.pop(), verdict=general), before
        rounds.append(one)
        if one.verdict.named is None:
            break
        before, named = shrinkage, one.verdict.named
        try:
            model, shrinkage = next_base(named, shrinkage, search.settings)
            if (form := form_at_finer_step(one, model, before, search)) is not None:
                rounds[-1] = with_form(one, form)
                model, shrinkage = next_base(form, before, search.settings)
        except KeyboardInterrupt:
            rounds.append(SearchRound(named.model, named.losses, named.experiment_losses, (), Verdict()))
            raise


def _next_round(model: Model, shrinkage: Shrinkage, search: SearchContext, rounds: list[SearchRound]) -> SearchRound:
    """The search for one more effect. Where it is stopped, an empty round is added: what was named before is kept."""
    try:
        if shrinkage:
            search.check(model)
        found = search_round(model, shrinkage, search)
        if found.verdict.named is not None:
            search.check_named(model, found.verdict.named)
        return found
    except (KeyboardInterrupt, OtherCommands):
        if rounds:
            rounds.append(SearchRound(model, *held_out_losses(model, search.blocks, shrinkage), (), Verdict()))
        raise
