"""Fits of the candidates of a round, from a base near the measurements and from a rough one."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tsmblocks.diagnosis.candidate_fits import Fitted, start_at, starts_of_fit
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.model import Model, optimized
from tsmblocks.diagnosis.screened_candidates import screened_candidates, various
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.diagnosis.search_rounds import SearchContext
from tsmblocks.diagnosis.shape_trial import with_narrow_bounds
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.inner_products import square

MEMORY_SEARCH_RATIO = 2.0
"""Mean square [those of the best candidate] up to which memories are searched again. Chosen: for the run time."""
NEAR_INTERVALS, NEAR_INSTANTS = 3.0, 60
"""How far from the instant of a change others are tried [intervals of its grid], and how many. Chosen: for run time."""
VARIANTS_RATIO, CLEAR_SHARE = 2.0, 0.9
"""Mean square [that of the best candidate, that of the base] up to which a candidate is fitted from other starts, those
of its variants and other instants. Chosen: for the run time."""
RIVAL_SHARE, MAX_RIVALS = 0.75, 6
"""Predicted gain of a candidate [that of the best fit] from which it is fitted as well, and how many of those at most.
Chosen: a grid of instants predicts a few percent less than a fit finds, a bend of the equations up to a fifth."""
MAX_ROUGH_FITS = 8
"""Candidates fitted from a rough base, and from the diagram's own parameters, at most. Chosen: for the run time."""
MAX_ROUGH_TRIALS, ROUGH_STEPS = 24, 12
"""Candidates that take a few steps from the diagram's own parameters, at most, and how many. Chosen: run time."""


class Fit(NamedTuple):
    """A candidate fitted, and the screening score by which it is judged."""

    score: ScreeningScore
    model: Model


def fits_from_starts(
    scores: Sequence[ScreeningScore], known: FittedCandidate | None, search: SearchContext, **options: Any
) -> list[Fit]:
    """The candidates fitted from all their starting points, with the ``options`` of ``optimized``.

    Without those whose simulation fails wherever their fits end, as a root of what becomes negative does.
    """
    fits: list[Fit] = []
    fitted: Fitted = functools.partial(optimized, **options)
    for k, one in enumerate(scores):
        search.progress("fitted", k, len(scores))
        ends = [fitted(one.problem, one.setup, start) for start in starts_of_fit(one, known, fitted)]
        finite = [model for model in ends if np.isfinite(model.mean_square)]
        fits += [Fit(one, min(finite, key=lambda m: m.mean_square))] if finite else []
    return fits


def with_rivals(
    fits: list[Fit],
    limits: Mapping[ScreeningScore, float],
    model: Model,
    known: FittedCandidate | None,
    search: SearchContext,
) -> list[Fit]:
    """The fits, and those of candidates that were left out though they may be as good as the best.

    Only a few variants and places of one effect are fitted at first. Where one of them is the best, another may be
    better: a load that acts for a time, of a change that stays. ``limits`` are the gains of all candidates, best first,
    that are noise.
    """
    tried = {one.score.candidate.key for one in fits}
    best = min(fits, key=lambda one: one.model.mean_square, default=None)
    gain = 0.0 if best is None else (model.mean_square - best.model.mean_square) * len(model.r)
    if best is None or gain <= limits[best.score]:
        return fits
    rivals = [one for one in limits if one.candidate.key not in tried and one.gain >= RIVAL_SHARE * gain]
    return [*fits, *fits_from_starts(rivals[:MAX_RIVALS], known, search)]


def fits_beside_own(
    scores: Sequence[ScreeningScore],
    chosen: Sequence[ScreeningScore],
    known: FittedCandidate | None,
    own: Model,
    search: SearchContext,
    *,
    rough: bool,
) -> list[Fit]:
    """The fits from a base and from the diagram's ``own`` parameters: of each candidate the better of both.

    Screening says little from ``own``, so that all candidates take a few steps, and the best of them the rest. Finite
    differences take most of the time beside large errors: they lead to the optimum from ``own``, where dry friction is
    far from its level, and are left out from a base that is ``rough``.
    """
    here, best = {one.candidate.key: one for one in scores}, dict[tuple[str, str, str], Fit]()
    there = [k for k in various(screened_candidates(own, {}, search)) if k.candidate.key in here][:MAX_ROUGH_TRIALS]
    tried = sorted(
        fits_from_starts(there, known, search, iterations=ROUGH_STEPS), key=lambda one: one.model.mean_square
    )
    first = various([one.score for one in tried])[:MAX_ROUGH_FITS]
    ends = [_continued(one) for one in tried if one.score in first]
    if rough:
        usual = fits_from_starts(chosen[:MAX_ROUGH_FITS], known, search, coarse=False)
    else:
        usual = fits_from_starts(chosen, known, search)
    for one in (*ends, *usual):
        key = one.score.candidate.key
        if key not in best or one.model.mean_square < best[key].model.mean_square:
            best[key] = one._replace(score=here[key])
    return list(best.values())


def _continued(one: Fit) -> Fit:
    """The fit continued from where it ended."""
    return _better(one, optimized(one.model.problem, one.model.setup, one.model.theta))


def with_variants(fits: Sequence[Fit], most: float) -> list[Fit]:
    """The fits, those of variants of one effect at one place fitted from the best of them as well.

    An end stop and end stops at both ends, of which only one is reached, then end at the same optimum: which of two
    variants is named is no matter of where their fits began. Those are left as they are whose best leaves a larger mean
    square than ``most``.
    """
    best = dict[tuple[str, str], Fit]()
    for one in sorted(fits, key=lambda fit: fit.model.mean_square):
        best.setdefault(_of_variants(one), one)
    ends = list[Fit]()
    for one in fits:
        other, score = best[_of_variants(one)], one.score
        if other is not one and other.model.mean_square <= most:
            start = start_at(score, other.score.candidate, other.model)
            one = _better(one, optimized(score.problem, score.setup, start))
        ends.append(one)
    return ends


def at_best_instants(fits: Sequence[Fit], most: float) -> list[Fit]:
    """The fits of sudden changes, fitted from another instant as well where one beside it is better.

    While the drive is small or turns, a change of it does little, so that its sum of squares has several minima. Those
    that leave a larger mean square than ``most`` are left as they are.
    """
    return [_at_best_instant(one) if one.model.mean_square <= most else one for one in fits]


def _at_best_instant(one: Fit) -> Fit:
    """The fit from better instants, one after another."""
    for name in one.score.candidate.trials.refine:
        one = _at_best_value(one, name)
    return one


def _at_best_value(one: Fit, parameter: str) -> Fit:
    candidate, model, unknowns = one.score.candidate, one.model, one.model.problem.unknowns
    name = f"{candidate.block}.{parameter}"
    if name not in unknowns.names:
        return one
    k = unknowns.names.index(name)
    instants = sorted({shape[parameter] for shape in candidate.trials.shapes})
    interval = (instants[-1] - instants[0]) / (len(instants) - 1)
    near = model.theta[k] + NEAR_INTERVALS * interval * np.linspace(-1, 1, NEAR_INSTANTS)
    others = np.arange(len(model.theta)) != k  # parameters and initial states that make up for a part of the change
    space, starts, squares = column_space(model.J.with_columns(others), SQUARED_EFFECT_TOLERANCE), [], []
    for instant in np.clip(near, instants[0], instants[-1]):
        start = np.where(others, model.theta, instant)
        r = model.problem.residuals(start)
        inside = space.basis.transposed_times(r[:, None])[:, 0]
        start[others] -= space.turn @ inside
        starts.append(np.where(others, np.clip(start, unknowns.low, unknowns.high), instant))
        squares.append(square(r) - square(inside))
    best = starts[int(np.argmin(squares))]
    return _better(one, optimized(with_narrow_bounds(model.problem, candidate, best), model.setup, best))


def _better(one: Fit, model: Model) -> Fit:
    """The fit with a model that leaves less, or as it is."""
    return one._replace(model=model) if model.mean_square < one.model.mean_square else one


def _of_variants(fit: Fit) -> tuple[str, str]:
    """What variants of one effect at one place have in common."""
    name, _, place = fit.score.candidate.key
    return name, place


def refined_fits(fits: Sequence[Fit], base: float) -> list[Fit]:
    """The fits, the best of them from where variants of them end, at other instants, and from other memories.

    ``base`` is the mean square of the base: beside noise alone all fits are alike, and would all be the best.
    """
    least = min((one.model.mean_square for one in fits), default=0.0)
    most = min(VARIANTS_RATIO * least, CLEAR_SHARE * base)
    return with_memories(at_best_instants(with_variants(fits, most), most))


def with_memories(fits: Sequence[Fit]) -> list[Fit]:
    """The fits, the memories of the best searched again."""
    least = MEMORY_SEARCH_RATIO * min((one.model.mean_square for one in fits), default=0.0)
    return [
        one._replace(model=refine_memories(one.model, 1)) if one.model.mean_square <= least else one for one in fits
    ]
