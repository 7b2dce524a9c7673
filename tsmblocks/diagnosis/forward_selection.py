"""Forward selection: one effect after another, each refitted with all before it; then exchange of early choices."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import accepted_count
from tsmblocks.diagnosis.base_search import better_base
from tsmblocks.diagnosis.candidate_fits import at_sufficient_step, known_starts
from tsmblocks.diagnosis.candidates import Candidate, candidates, replacement_candidates, wire_signals
from tsmblocks.diagnosis.commands import OtherCommands
from tsmblocks.diagnosis.critical_gains import critical_gains, critical_ratios, is_of_time
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
    converged,
    nearest,
    optimized,
    with_accurate_step,
    with_sufficient_step,
)
from tsmblocks.diagnosis.noise_filtering import filters_noise
from tsmblocks.diagnosis.oscillation import follows_motion, repeats_another
from tsmblocks.diagnosis.own_parameters import at_own_parameters
from tsmblocks.diagnosis.partition import ROUGH_ERROR
from tsmblocks.diagnosis.replacements import replacement_points
from tsmblocks.diagnosis.screening import screening_score
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
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
MAX_FITTED_CANDIDATES = 16
"""Candidates fitted in a round at most. Chosen: for the run time."""
MAX_FITTED_VARIANTS = 3
"""Variants and places of one effect that are fitted in a round, before those of all others. Chosen."""
MAX_FITTED_LOCAL = 4
"""Candidates with a value in each recording that are fitted in a round, before all others. Chosen."""
MIN_SCREENING_SCORE = 0.02
"""Predicted fall of the mean square [noise variances] from which a candidate is fitted. Chosen: a third of what is
needed for a name, since screening is of first order only."""
MIN_RELATIVE_SCORE = 0.15
"""Share of the best screening score from which a candidate is fitted. Chosen: for the run time."""
MEMORY_SEARCH_RATIO = 2.0
"""Mean square [those of the best candidate] up to which memories are searched again. Chosen: for the run time."""
MAX_ROUGH_FITS = 8
"""Candidates fitted from a rough base, and from the diagram's own parameters, at most. Chosen: for the run time."""
MAX_ROUGH_TRIALS, ROUGH_STEPS = 24, 12
"""Candidates that take a few steps from the diagram's own parameters, at most, and how many. Chosen: run time."""
LEAST_IMPROVEMENT = 0.9
"""Mean square after an optimisation beside a rough residual over that before, up to which it is repeated. Chosen: dry
friction has many small steps downhill."""
MAX_BETTER_BASES = 2
"""Times that a round is repeated from a better optimum of its base, at most. Chosen: for the run time."""


MIN_GAIN_BESIDE_MOTION = 2.0
"""Gain of an oscillation at a harmonic of the motion, over what is predicted from the motion, from which it is a
disturbance all the same. Chosen: more than half of it is then no function of the motion."""


class _Fit(NamedTuple):
    """A candidate fitted, and the screening score by which it is judged."""

    score: ScreeningScore
    candidate: Candidate
    model: Model


def search_round(
    model: Model, shrinkage: Shrinkage, search: SearchContext, found_in: SearchRound | None = None
) -> SearchRound:
    """Screen every effect on every admissible wire of a model, fit the best candidates, and decide by held-out losses.

    ``shrinkage`` is that of the effects in the model already. ``found_in`` is a search that named an effect in another
    model: its fit starts at the parameters there as well, and it is held against what the best of as many candidates
    as there were reaches in noise.
    """
    scores = _screened(model, shrinkage, search)
    known = found_in.verdict.named if found_in else None
    own = None if shrinkage else at_own_parameters(model)
    chosen = _chosen(scores, model, search, known)
    fits = _fits(chosen, known, search) if own is None else _rough_fits(scores, chosen, known, own, search)
    multiplicity = critical_ratios(scores, square(model.r))
    if found_in is not None:
        multiplicity = {k: max(one, found_in.multiplicity.get(k, 1.0)) for k, one in multiplicity.items()}
    limits = critical_gains(scores, square(model.r), multiplicity)
    by_motion = functools.cache(lambda: _predicted_gain(model, search))
    losses, fitted = held_out_losses(model, search.blocks, shrinkage), []
    base_loss = mean_loss(losses[0], search.blocks)
    for score, candidate, m in _with_memories(fits):
        gain, untenable = (model.mean_square - m.mean_square) * len(model.r), ""
        if gain <= limits[score]:
            untenable = "noise alone can remove as much"
        elif follows_motion(m, candidate) and gain < MIN_GAIN_BESIDE_MOTION * by_motion():
            untenable = "its frequency is that of the motion"
        elif repeats_another(m, candidate):
            untenable = "the same oscillation again"
        elif filters_noise(m, candidate, search.input_noise):
            untenable = "removes noise of the input only"
        found = fitted_candidate(candidate, m, search.blocks, shrinkage, untenable)
        fitted.append(at_sufficient_step(found, base_loss, model.mean_square, search.blocks, shrinkage))
    noise_variance = noise_beside(fitted, search.noise)
    verdict = decide(losses[0], fitted, search.blocks, noise_variance, search.settings.seed)
    verdict = with_distances_first(verdict, losses[0], search.blocks, search.only_frequency)
    return SearchRound(model, *losses, tuple(scores), verdict, multiplicity=multiplicity)


def _chosen(
    scores: Sequence[ScreeningScore], model: Model, search: SearchContext, known: FittedCandidate | None
) -> list[ScreeningScore]:
    """The candidates that are fitted, with that which is ``known``: it may seem small until it is fitted."""
    chosen = _worth_fitting(scores, model, search)
    if known is not None:
        chosen += [one for one in scores if one not in chosen and one.candidate.key == known.candidate.key]
    return chosen


def _fits(
    scores: Sequence[ScreeningScore], known: FittedCandidate | None, search: SearchContext, **options: Any
) -> list[_Fit]:
    """The candidates fitted from all their starting points, with the ``options`` of ``optimized``."""
    fits = []
    for k, one in enumerate(scores):
        search.progress("fitted", k, len(scores))
        starts = [*one.starts, *known_starts(one, known)]
        ends = [optimized(one.problem, one.setup, start, **options) for start in starts]
        fits.append(_Fit(one, one.candidate, min(ends, key=lambda m: m.mean_square)))
    return fits


def _rough_fits(
    scores: Sequence[ScreeningScore],
    chosen: Sequence[ScreeningScore],
    known: FittedCandidate | None,
    own: Model,
    search: SearchContext,
) -> list[_Fit]:
    """The fits beside a rough base: of each candidate the better of that from the base and that from ``own``.

    Screening says little from ``own``, so that all candidates take a few steps, and the best of them the rest. Finite
    differences take most of the time beside large errors: they lead to the optimum from ``own``, where dry friction is
    far from its level, and are left out from the base.
    """
    here, best = {one.candidate.key: one for one in scores}, dict[tuple[str, str, str], _Fit]()
    there = [k for k in _various(_screened(own, {}, search)) if k.candidate.key in here][:MAX_ROUGH_TRIALS]
    tried = sorted(_fits(there, known, search, iterations=ROUGH_STEPS), key=lambda one: one.model.mean_square)
    first = _various([one.score for one in tried])[:MAX_ROUGH_FITS]
    ends = [_continued(one) for one in tried if one.score in first]
    for one in (*ends, *_fits(chosen[:MAX_ROUGH_FITS], known, search, coarse=False)):
        key = one.candidate.key
        if key not in best or one.model.mean_square < best[key].model.mean_square:
            best[key] = one._replace(score=here[key])
    return list(best.values())


def _continued(one: _Fit) -> _Fit:
    """The fit continued from where it ended."""
    return one._replace(model=optimized(one.model.problem, one.model.setup, one.model.theta))


def _with_memories(fits: Sequence[_Fit]) -> list[_Fit]:
    """The fits, the memories of the best searched again."""
    least = MEMORY_SEARCH_RATIO * min((one.model.mean_square for one in fits), default=0.0)
    return [
        one._replace(model=refine_memories(one.model, 1)) if one.model.mean_square <= least else one for one in fits
    ]


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
    """The best candidates, by what exceeds noise: a few in any case, more where their score is near the best.

    Replacements are chosen in addition: they begin at no null, so that their score says less of what they reach.
    """
    best = scores[0].gain if scores else 0.0
    least = max(MIN_SCREENING_SCORE * search.noise_variance * model.problem.samples, MIN_RELATIVE_SCORE * best)
    some = _various(sorted(scores, key=lambda one: float(np.mean(one.noise_gains)) - one.gain))[:MAX_FITTED_CANDIDATES]
    chosen = [one for one in scores if one in some or one.candidate.effect.place == REPLACED]
    return [score for k, score in enumerate(chosen) if k < MIN_FITTED_CANDIDATES or score.gain > least]


def _various(scores: Sequence[ScreeningScore]) -> list[ScreeningScore]:
    """The first candidates, no more than a few variants of one effect if there are others.

    What has a value in each recording reaches much in anything, and would leave no room for other effects.
    """
    counts, local = Counter[str](), 0
    first, others = list[ScreeningScore](), list[ScreeningScore]()
    for one in scores:
        effect = one.candidate.effect
        counts[effect.name] += 1
        local += bool(effect.local)
        few = counts[effect.name] <= MAX_FITTED_VARIANTS and not (effect.local and local > MAX_FITTED_LOCAL)
        (first if few else others).append(one)
    return [*first, *others]


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
        except KeyboardInterrupt:
            rounds.append(SearchRound(named.model, named.losses, named.experiment_losses, (), Verdict()))
            raise


def _next_round(model: Model, shrinkage: Shrinkage, search: SearchContext, rounds: list[SearchRound]) -> SearchRound:
    """The search for one more effect. Where it is stopped, an empty round is added: what was named before is kept."""
    try:
        if shrinkage:
            search.check(model)
        return search_round(model, shrinkage, search)
    except (KeyboardInterrupt, OtherCommands):
        if rounds:
            rounds.append(SearchRound(model, *held_out_losses(model, search.blocks, shrinkage), (), Verdict()))
        raise


def next_base(named: FittedCandidate, shrinkage: Shrinkage, settings: ModelSettings) -> tuple[Model, Shrinkage]:
    """The base of the next round, and the shrinkage of the effects in it."""
    return nearest(_at_optimum(named.model, settings)), {**shrinkage, **shrinkage_of(named.candidate)}


def _at_optimum(model: Model, settings: ModelSettings) -> Model:
    """The model optimised at a sufficient step, again while that helps where its residual is rough."""
    error = np.inf
    while model.mean_square < LEAST_IMPROVEMENT * error:
        error = model.mean_square
        model = refine_memories(with_accurate_step(with_sufficient_step(converged(model), settings), settings))
        if error <= ROUGH_ERROR:
            break
    return model


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
    again = search_round(model, shrinkage, search, _with_all(rounds[k], rounds[count:]))
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
