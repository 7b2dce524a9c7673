"""Why a candidate that was fitted was not named, in a few words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.acceptance import MIN_EXCESS_SHARE
from tsmblocks.diagnosis.decision import (
    INDISTINGUISHABLE_NOISE_SHARE,
    MIN_EXCESS,
    MIN_VARIANCE_REDUCTION,
    is_more_general,
    mean_loss,
    noise_beside,
)
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.fitted_candidate import FROM_INPUTS, FittedCandidate
from tsmblocks.diagnosis.same_outputs import is_same_in_outputs
from tsmblocks.diagnosis.search_rounds import SearchRound

INDISTINGUISHABLE = "indistinguishable"
WORSE_BESIDE_OTHERS = "larger error beside the other effects"
NOT_DETERMINED = "left out: not determined beside the other effects"
NO_SIZE = "left out: its size is not determined with these data"
TAKES_PLACE = "left out: the parameters of the model are not determined beside it"
RECURRING = "left out: an error that comes and goes so often is irregular"
LEFT_OUT_FOR_INPUTS = f"left out: {FROM_INPUTS}"
LEFT_OUT = (NOT_DETERMINED, NO_SIZE, TAKES_PLACE, RECURRING, LEFT_OUT_FOR_INPUTS)
"""Reasons of effects that were accepted at first."""
NO_BETTER = "no better on held-out data"
NOT_SIGNIFICANT = "not significant"
NO_EXCESS = "the error is within the noise"
TOO_LITTLE = "removes too little"
LEAVES_MORE = "larger error than another"
MORE_GENERAL = "more parameters, no smaller error"
LEAVES_PREDICTED = "the recorded signals predict what it leaves"
NOT_ACCEPTED = "too little beside those named"


def why_not(diagnosed: DiagnosedPart, number: int, searched: SearchRound, one: FittedCandidate, t: float) -> str:
    """Why a fitted candidate of round ``number``, with t-statistic ``t``, was not named; empty for the one named."""
    verdict, accepted = searched.verdict, number <= diagnosed.count
    if accepted and one is verdict.named:
        return ""
    if accepted and one in verdict.indistinguishable:
        return INDISTINGUISHABLE
    if one.loss >= mean_loss(searched.losses, diagnosed.blocks):
        return NO_BETTER
    return (
        _unfit(one)
        or _unconvincing(diagnosed, searched, one, t)
        or (_beside_named(diagnosed, one, verdict.named) if accepted else _not_accepted(diagnosed, searched, one))
    )


def alternatives_to(named: FittedCandidate, indistinguishable: Sequence[FittedCandidate]) -> list[FittedCandidate]:
    """The candidates indistinguishable from the one named, without it and more general forms of the same effect.

    A form of an effect that has all of its parameters and more, as a ripple with a second harmonic, is no other effect.
    """
    return [one for one in indistinguishable if one is not named and not is_more_general(one, named)]


def why_named(named: FittedCandidate, indistinguishable: Sequence[FittedCandidate]) -> str:
    """Why an effect is named rather than those indistinguishable from it, in a sentence; empty where there are none,
    and where it was named before other effects were in the model, beside which others leave a little less.

    Of effects that explain the residual equally well the one with the fewest parameters is named, and of several with
    as few, the one that leaves the least error.
    """
    others = [one for one in indistinguishable if one is not named]
    if not others:
        return ""
    count, fewest = named.parameter_count, min(one.parameter_count for one in others)
    if count < fewest:
        return f"{named.candidate.effect.name} is named because the model with it has the fewest parameters."
    if all(named.loss <= one.loss for one in others):
        return f"{named.candidate.effect.name} is named because it leaves the least error on held-out data."
    lower = [one for one in others if one.loss < named.loss and one.parameter_count <= count]
    if lower and all(is_same_in_outputs(one, named) for one in lower):
        same = listed(list(dict.fromkeys(one.candidate.effect.name for one in lower)), 3)
        return (
            f"{named.candidate.effect.name} is named because with it the parameters of the model are nearest to those "
            f"of the diagram; the outputs are the same as with {same}."
        )
    if not lower:
        few = "of those with as few parameters it leaves the least error on held-out data"
        return f"{named.candidate.effect.name} is named because {few}."
    return ""


def _unfit(one: FittedCandidate) -> str:
    """Why a candidate may not be named, however much it removes."""
    if one.disqualifying_bounds:
        return f"ends at a bound ({listed(one.disqualifying_bounds, 2)})"
    return one.untenable


def _unconvincing(diagnosed: DiagnosedPart, searched: SearchRound, one: FittedCandidate, t: float) -> str:
    """Why held-out data do not support a candidate."""
    before = mean_loss(searched.losses, diagnosed.blocks)
    noise = noise_beside(searched.verdict.ranking, diagnosed.search.noise)
    if t <= searched.verdict.critical_value:
        return NOT_SIGNIFICANT
    if before < (1 + MIN_EXCESS) * noise:
        return NO_EXCESS
    return TOO_LITTLE if before - one.loss < MIN_VARIANCE_REDUCTION * noise else ""


def _beside_named(diagnosed: DiagnosedPart, one: FittedCandidate, named: FittedCandidate | None) -> str:
    """Why the candidate of an accepted round was named and not this one."""
    if named is None or one.loss > named.loss + INDISTINGUISHABLE_NOISE_SHARE * diagnosed.noise_variance:
        return LEAVES_MORE
    more = one.parameter_count > named.parameter_count
    return MORE_GENERAL if is_more_general(one, named) or more else LEAVES_MORE


def _not_accepted(diagnosed: DiagnosedPart, searched: SearchRound, one: FittedCandidate) -> str:
    """Why a round with a convincing candidate added no effect."""
    best = searched.verdict.named
    if best is None:
        return NOT_ACCEPTED
    if one is not best and one.loss > best.loss:
        return LEAVES_MORE
    if np.isfinite(searched.verdict.out_of_bounds_loss):
        return "another that may not be named leaves less"
    before = mean_loss(searched.losses, diagnosed.blocks)
    share = (before - one.loss) / max(before - diagnosed.noise_variance, 1e-12)
    if diagnosed.count:
        return NOT_ACCEPTED
    return LEAVES_PREDICTED if share >= MIN_EXCESS_SHARE else TOO_LITTLE
