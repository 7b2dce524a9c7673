"""Another form of the effect that was named, where that explains it better at a finer step."""

from __future__ import annotations

import attrs

from tsmblocks.diagnosis.decision import Shrinkage, decide, fitted_candidate, noise_beside
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.next_base import at_optimum
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

MAX_FORMS = 2
"""Other forms that are tried, at most. Chosen: for the run time."""


def form_at_finer_step(
    one: SearchRound, model: Model, shrinkage: Shrinkage, search: SearchContext
) -> FittedCandidate | None:
    """Another form of the effect of a round, better than that at the step of the next ``model``; None without any.

    The candidates of a round are compared at the step of its base. Where the effect needs a finer one, a soft form of
    it may have made up for the error of the step. ``shrinkage`` is that of the effects before.
    """
    named = one.verdict.named
    if named is None or not _has_finer_step(model, named.model):
        return None
    others = [k for k in one.verdict.ranking if _is_form_of(k, named)][:MAX_FORMS]
    models = [(named, model), *((k, at_optimum(k.model, search.settings)) for k in others)]
    fitted = [fitted_candidate(k.candidate, m, search.blocks, shrinkage, "") for k, m in models]
    noise = noise_beside(fitted, search.noise)
    again = decide(one.losses, fitted, search.blocks, noise, search.settings.seed, one.base.mean_square)
    return None if again.named is fitted[0] else again.named


def with_form(one: SearchRound, form: FittedCandidate) -> SearchRound:
    """The round with another form of its effect as the one that is named."""
    verdict = one.verdict
    ranking = tuple(form if k.candidate is form.candidate else k for k in verdict.ranking)
    others = (k for k in verdict.indistinguishable if k is not verdict.named and k.candidate is not form.candidate)
    verdict = attrs.evolve(verdict, ranking=ranking, named=form, indistinguishable=(form, *others))
    return attrs.evolve(one, verdict=verdict)


def _has_finer_step(one: Model, before: Model) -> bool:
    """Whether any experiment of a model has a finer step than in another one."""
    return any(a.times.h < b.times.h for a, b in zip(one.setup.experiments, before.setup.experiments, strict=True))


def _is_form_of(one: FittedCandidate, named: FittedCandidate) -> bool:
    """Whether a candidate is another form of the effect that was named, on the wire of the same signal."""
    own, at = one.candidate, named.candidate
    same = (own.effect.name, own.point.signal) == (at.effect.name, at.point.signal)
    return same and one is not named and one.tenable
