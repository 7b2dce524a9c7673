"""The candidates of a diagnosis, round by round: what each removed, and why it was not named."""

from __future__ import annotations

from collections.abc import Collection

import attrs

from tsmblocks.diagnosis.candidate_units import displayed_unit
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION, mean_loss
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.quantities import recorded_units
from tsmblocks.diagnosis.rejection import INDISTINGUISHABLE, MORE_GENERAL, WORSE_BESIDE_OTHERS, alternatives_to, why_not
from tsmblocks.diagnosis.search_rounds import SearchRound
from tsmblocks.diagnosis.segment import RankedCandidate

MAX_MEANINGFUL_SHARE = 10.0
"""Share of the excess above which the excess was too small for a share to have a meaning. Chosen."""


def ranking(diagnosed: DiagnosedPart) -> tuple[RankedCandidate, ...]:
    """Every candidate of every accepted round, and of the one after.

    Those marked as indistinguishable are the ones that are reported beside an effect: they are so with all other
    effects in the model, and one that was fitted there only has a row too.
    """
    result: list[RankedCandidate] = []
    for number, first in enumerate(diagnosed.rounds[: diagnosed.count + 1], 1):
        one, final = first.most_complete, first.repeated or first
        accepted = number <= diagnosed.count
        kept = alternatives_to(diagnosed.named[number - 1], first.indistinguishable) if accepted else []
        names = {tried.candidate.effect.name for tried in kept}
        rows = [_fitted_row(diagnosed, number, one, tried, names) for tried in one.verdict.ranking]
        shown = {row.name for row in rows if row.in_set}
        extra = [tried for tried in kept if tried.candidate.effect.name not in shown]
        rows += [_fitted_row(diagnosed, number, final, tried, names) for tried in extra]
        fitted = {tried.candidate.key for tried in (*one.verdict.ranking, *extra)}
        result += _with_omitted(diagnosed, number, rows)
        result += [
            _row(diagnosed, number, one, score.candidate, score.gain / len(one.base.r))
            for score in one.screening_scores
            if score.candidate.key not in fitted
        ]
    return tuple(result)


def _with_omitted(diagnosed: DiagnosedPart, number: int, rows: list[RankedCandidate]) -> list[RankedCandidate]:
    """The rows of a round with the effects that were named in it and left out later, with the reason."""
    result, last = list(rows), diagnosed.count + 1
    for gone in diagnosed.omitted:
        if min(gone.index + 1, last) != number:
            continue
        row = attrs.evolve(
            _fitted_row(diagnosed, number, gone.searched, gone.effect, ()),
            in_set=False,
            named=False,
            why_not=gone.reason,
        )
        same = (row.name, row.variant, row.wire)
        result = [one for one in result if one.named or (one.name, one.variant, one.wire) != same]
        if not any((one.name, one.variant, one.wire) == same for one in result):
            result.append(row)
    return result


def _fitted_row(
    diagnosed: DiagnosedPart,
    number: int,
    searched: SearchRound,
    one: FittedCandidate,
    indistinguishable: Collection[str],
) -> RankedCandidate:
    """A candidate that was fitted; ``indistinguishable`` are the names of those that are so from the one named."""
    verdict, blocks, block = searched.verdict, diagnosed.blocks, one.candidate.block
    items = {
        item.name.removeprefix(f"{block}."): item
        for item in one.model.problem.unknowns.items
        if item.parameter in one.candidate.free
    }
    t = float(verdict.t[verdict.ranking.index(one)])
    named, in_set, reason = _outcome(diagnosed, number, searched, one, indistinguishable)
    across = mean_loss(searched.experiment_losses, blocks)
    several = diagnosed.has_several_experiments and not one.candidate.effect.local
    recorded = recorded_units(one.model.setup)
    removed = across - mean_loss(one.experiment_losses, blocks) if several else float("nan")
    return attrs.evolve(
        _row(diagnosed, number, searched, one.candidate, mean_loss(searched.losses, blocks) - one.loss),
        across=removed,
        new=share_above_noise(removed, across, diagnosed),
        t=t,
        in_set=in_set,
        named=named,
        fitted=True,
        at_bound=one.at_bounds,
        why_not=reason,
        parameters={name: one.model.values[item.name] for name, item in items.items()},
        units={name: displayed_unit(item, one.candidate, recorded) for name, item in items.items()},
    )


def _outcome(
    diagnosed: DiagnosedPart,
    number: int,
    searched: SearchRound,
    one: FittedCandidate,
    indistinguishable: Collection[str],
) -> tuple[bool, bool, str]:
    """Whether a fitted candidate was named, is indistinguishable from the one named or is it, and why it was not."""
    verdict, name = searched.verdict, one.candidate.effect.name
    named = one is verdict.named and number <= diagnosed.count
    named = named and name == diagnosed.named[number - 1].candidate.effect.name
    same = verdict.named is not None and one in alternatives_to(verdict.named, verdict.indistinguishable)
    in_set = named or (same and name in indistinguishable)
    reason = why_not(diagnosed, number, searched, one, float(verdict.t[verdict.ranking.index(one)]))
    if reason == INDISTINGUISHABLE and not in_set:
        reason = WORSE_BESIDE_OTHERS if same else MORE_GENERAL
    return named, in_set, reason


def _row(
    diagnosed: DiagnosedPart, number: int, searched: SearchRound, candidate: Candidate, gain: float
) -> RankedCandidate:
    """A candidate as it was screened."""
    return RankedCandidate(
        number,
        diagnosed.part.name,
        candidate.effect.name,
        candidate.effect.variant,
        candidate.effect.family,
        candidate.point.words(searched.base.diagram),
        gain,
        share_above_noise(gain, mean_loss(searched.losses, diagnosed.blocks), diagnosed),
        line=searched.verdict.critical_value,
        words=candidate.words,
    )


def share_above_noise(gain: float, loss: float, diagnosed: DiagnosedPart) -> float:
    """A gain over the loss above the noise floor, at most 1: noise that is overestimated leaves less to remove.

    NaN where so little of the loss is above the noise that a share of it has no meaning: less than an effect removes.
    """
    noise = min(diagnosed.noise_variance, diagnosed.search.noise.low)
    least = MIN_VARIANCE_REDUCTION * noise
    share = gain / max(loss - noise, least)
    meaningful = max(loss - noise, gain) >= least and share <= MAX_MEANINGFUL_SHARE
    return min(share, 1.0) if meaningful else float("nan")
