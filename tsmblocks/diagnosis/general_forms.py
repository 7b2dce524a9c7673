"""A general form of an effect, named where it explains as much as its special case and a further effect together."""

from __future__ import annotations

import attrs

from tsmblocks.diagnosis.decision import INDISTINGUISHABLE_NOISE_SHARE, Verdict


def generalized(verdict: Verdict, following: Verdict, noise_variance: float) -> Verdict | None:
    """The verdict of a round with a general form of the effect that it names; None where it stands.

    A special case is named where it removes nearly as much as its general form, since the rest may be another effect.
    ``following`` is the verdict of the next round: what it names, beside the special case, must leave less than the
    general form alone, or one effect explains what two do.
    """
    special, further = verdict.named, following.named
    if special is None or further is None:
        return None
    largest = further.loss + INDISTINGUISHABLE_NOISE_SHARE * noise_variance
    forms = [
        one
        for one in verdict.ranking
        if special.candidate.effect.name in one.candidate.effect.contains
        and one.tenable
        and not one.disqualifying_bounds
        and one.loss <= min(largest, special.loss)
    ]
    if not forms:
        return None
    named = min(forms, key=lambda one: one.loss)
    others = tuple(one for one in verdict.indistinguishable if one is not named and one is not special)
    return attrs.evolve(verdict, named=named, indistinguishable=(named, *others))
