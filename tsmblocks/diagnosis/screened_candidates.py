"""All candidates of a round screened, and those of them that are worth a fit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data.record import Record
from tsmblocks.diagnosis.candidates import Candidate, candidates, replacement_candidates, wire_signals
from tsmblocks.diagnosis.critical_gains import MOTION, SLOW, SURROGATES, family_of, is_of_time
from tsmblocks.diagnosis.decision import Shrinkage
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.measured_position import at_measured_position
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.replacements import replacement_points
from tsmblocks.diagnosis.screening import screening_score
from tsmblocks.diagnosis.screening_score import ScreeningScore, gain_beyond_noise
from tsmblocks.diagnosis.screening_step import screening_model
from tsmblocks.diagnosis.search_rounds import SearchContext
from tsmblocks.diagnosis.slow_sums import slow_sums
from tsmblocks.diagnosis.surrogates import surrogates
from tsmblocks.effects import REPLACED, Effect, Relative
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, ColumnSpace, column_space
from tsmblocks.fitting.inner_products import square

DEFLECTION = "deflection"
"""The place of effects in the deflection of a spring."""
ELEMENT = "element"
"""The place of changes of a stiffness or a friction."""
BADLY_PREDICTED = (REPLACED, DEFLECTION)
"""Places of effects of which screening predicts little: they act with a spring that was fitted without them."""
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


def screened_candidates(model: Model, shrinkage: Shrinkage, search: SearchContext) -> list[ScreeningScore]:
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
    scores, screened = [], screening_model(model)
    noise, slow_noise = _noise(model, base, search)
    whole = square(model.r)
    slow = {k: (float(slow_sums(model, model.r[:, None])[0]), one) for k, one in slow_noise.items()}

    def score_of(one: Candidate, records: Mapping[str, Record]) -> ScreeningScore:
        own = noise[is_of_time(one)]
        return screening_score(one, model, records, search.settings, wires, base, own, screened)

    for k, one in enumerate(every):
        search.progress("tried", k, len(every))
        score = score_of(one, search.records)
        if (over := at_measured_position(one, search.records)) is not None:
            there = score_of(*over)
            noisy = np.maximum(score.noise_gains, there.noise_gains)
            score = attrs.evolve(score, gain=max(score.gain, there.gain), noise_gains=noisy, at_measured_position=there)
        own_slow, family = slow[is_of_time(one)] if score.is_slow else None, family_of(one)
        if family == MOTION and not score.is_slow:  # slow noise does not resemble it
            score = attrs.evolve(score, noise_gains=np.tile(score.noise_gains[:SURROGATES], 2))
        squares, by_noise = own_slow if own_slow and family == SLOW else (whole, whole)
        part = own_slow if family == MOTION else None
        scores.append(attrs.evolve(score, squares=squares, noise_squares=by_noise, slow_part=part))
    return sorted(scores, key=lambda one: -one.gain)


def _noise(
    model: Model, base: ColumnSpace, search: SearchContext
) -> tuple[dict[bool, np.ndarray], dict[bool, np.ndarray]]:
    """Surrogates for effects of time (True), and of both kinds, one after another, for effects of the motion (False);
    and the sums of squares of their slow parts.

    Slow noise as large as the residual explains nothing of what the motion may cause where noise is hardly so large.
    """
    seed = search.settings.seed
    of_time, of_motion = (surrogates(model, base, SURROGATES, seed, of_time=one) for one in (True, False))
    possible = np.sqrt(min(1.0, search.likely_noise / max(model.mean_square, 1e-300)))
    slow = [slow_sums(model, one) for one in (of_motion, of_time)]
    noise = {True: of_time, False: np.concatenate([of_motion, possible * of_time], axis=1, dtype=of_time.dtype)}
    return noise, {True: slow[1], False: np.concatenate(slow)}


def chosen_candidates(
    scores: Sequence[ScreeningScore], model: Model, search: SearchContext, known: FittedCandidate | None
) -> list[ScreeningScore]:
    """The candidates that are fitted, with that which is ``known``: it may seem small until it is fitted."""
    chosen = worth_fitting(scores, model, search)
    if known is not None:
        chosen += [one for one in scores if one not in chosen and one.candidate.key == known.candidate.key]
    return chosen


def worth_fitting(scores: Sequence[ScreeningScore], model: Model, search: SearchContext) -> list[ScreeningScore]:
    """The best candidates, by what exceeds noise: a few in any case, more where their score is near the best.

    Replacements and effects in the deflection of a spring are chosen in addition: what they reach, with a spring that
    was fitted without them, is far from what their score says. So are a few changes of an element: what swings for long
    is soon out of step, which a first order does not see.
    """
    best = scores[0].gain if scores else 0.0
    least = max(MIN_SCREENING_SCORE * search.noise_variance * model.problem.samples, MIN_RELATIVE_SCORE * best)
    ordered = sorted(scores, key=lambda one: -gain_beyond_noise(one))
    of_elements = [one for one in ordered if one.candidate.effect.place == ELEMENT][:MAX_FITTED_VARIANTS]
    some = [*various(ordered)[:MAX_FITTED_CANDIDATES], *of_elements]
    chosen = [one for one in scores if one in some or one.candidate.effect.place in BADLY_PREDICTED]
    enough = [score.gain > (0.0 if score.candidate.effect.place == DEFLECTION else least) for score in chosen]
    return [score for k, score in enumerate(chosen) if k < MIN_FITTED_CANDIDATES or enough[k]]


def various(scores: Sequence[ScreeningScore]) -> list[ScreeningScore]:
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
