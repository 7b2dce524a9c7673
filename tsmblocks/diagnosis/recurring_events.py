"""Sudden changes that come and go at instants of their own in each experiment are no event that has a name."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.decision import FittedCandidate
from tsmblocks.diagnosis.forward_selection import SearchContext, SearchRound, accepted_count, rounds_for, search_round
from tsmblocks.diagnosis.model import Model

SAME_INSTANT = 10.0
"""Distance of two changes [transition times] up to which they are one event. Chosen: far from samples to events."""


def without_recurring_events(
    rounds: Sequence[SearchRound], search: SearchContext
) -> tuple[list[SearchRound], list[str]]:
    """Rounds without sudden changes, where there are several at different instants of each experiment, and a note.

    One change in each experiment is an event. With more of them, each of any size and at any instant, anything that
    comes and goes is imitated, such as sticking now and then.
    """
    rounds = list(rounds)
    count = accepted_count(rounds, search)
    named = [one.verdict.named for one in rounds[:count] if one.verdict.named is not None]
    events = [one for one in named if _has_own_instants(one)]
    last = rounds[count].base
    if not any(_apart(last, one, other) for k, one in enumerate(events) for other in events[:k]):
        return rounds, []
    kept = [one for one in named if one not in events]
    made, model, shrinkage = rounds_for(rounds[0].base, kept, search)
    effects = [one for one in search.effects if not any(one.name == event.candidate.effect.name for event in events)]
    ended = search_round(model, shrinkage, attrs.evolve(search, effects=effects))
    made.append(attrs.evolve(ended, verdict=attrs.evolve(ended.verdict, named=None, indistinguishable=())))
    words = ", ".join(dict.fromkeys(one.candidate.effect.words for one in events))
    text = (
        f"{len(events)} sudden changes ({words}) would be needed at different instants of each experiment: what comes "
        "and goes so often is no single event, and it is not named."
    )
    return made, [text]


def _has_own_instants(one: FittedCandidate) -> bool:
    """Whether an effect is a sudden change at an instant of its own in each experiment."""
    return bool(one.candidate.trials.refine) and one.candidate.trials.refine in one.candidate.effect.local


def _instants(model: Model, one: FittedCandidate) -> np.ndarray:
    """The instants [s] of an effect, one for each experiment."""
    name, items = f"{one.candidate.block}.{one.candidate.trials.refine}", model.problem.unknowns.items
    return np.array([value for item, value in zip(items, model.theta, strict=True) if item.parameter == name])


def _apart(model: Model, one: FittedCandidate, other: FittedCandidate) -> bool:
    """Whether two effects act at different instants, in most of the experiments."""
    distance = np.abs(_instants(model, one) - _instants(model, other))
    return bool(np.mean(distance > SAME_INSTANT * one.candidate.transition_time) > 0.5)
