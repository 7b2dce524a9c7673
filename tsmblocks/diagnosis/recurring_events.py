"""Sudden changes at several instants of each experiment are irregular, and not named as single events."""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import accepted_count, attained_noise
from tsmblocks.diagnosis.decision import mean_loss
from tsmblocks.diagnosis.diagnosed_part import Omission
from tsmblocks.diagnosis.evidence import evidence
from tsmblocks.diagnosis.exchange import rounds_for
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.forward_selection import closing_round
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.quantities import Estimate
from tsmblocks.diagnosis.rejection import RECURRING
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

MAX_OWN = 2
"""Effects of time with separate sizes in each experiment that are named, at most. Chosen: with three of them, any
error that comes and goes is imitated."""
MIN_RECORDINGS, MOST = 3, 0.5
"""Recordings at least, and share of them, in which a sudden change of a loop is clear of zero, from which it is no
event: what has changed stays so, and does not begin anew in each recording. Chosen: two may be a coincidence."""
COMPLETE = 0.95
"""Share of the excess that changes of a loop remove with the effects named before, from which they are events: another
change at another instant in each recording imitates a part of any error, as of form of those before. Alone they may
then be in every recording. Chosen."""
SAME_LINE = 0.02
"""Relative distance of a frequency from a multiple of another one up to which they are one line. Chosen."""
SAME_INSTANT = 10.0
"""Distance of two changes [transition times] up to which they are one event. Chosen: far from samples to events."""


def without_recurring_events(
    rounds: Sequence[SearchRound], search: SearchContext
) -> tuple[list[SearchRound], list[str], list[Omission]]:
    """Rounds without effects of time that imitate an irregular error, a note on them, and these effects.

    One sudden change in each experiment is an event. With more of them, each of any size and at any instant, anything
    that comes and goes is imitated, such as sticking now and then; so it is by several disturbances of any phase.
    """
    rounds = list(rounds)
    count = accepted_count(rounds, search)
    named = [one.verdict.named for one in rounds[:count] if one.verdict.named is not None]
    events = _imitations(rounds[: count + 1], named, search)
    if not events:
        return rounds, [], []
    kept = [one for one in rounds[:count] if one.verdict.named not in events]
    made, model, shrinkage = rounds_for(kept, search, rounds[0].base)
    effects = [one for one in search.effects if not any(one.name == event.candidate.effect.name for event in events)]
    made.append(closing_round(model, shrinkage, attrs.evolve(search, effects=effects)))
    names = ", ".join(dict.fromkeys(one.candidate.effect.name for one in events))
    text = (
        f"a sudden change ({names}) of another size at another instant in each experiment takes up a part of the "
        "residual: such changes imitate any error, and no effect is named for it."
        if len(events) == 1
        else f"to explain the residual takes {len(events)} changes over time ({names}), each with another size in each "
        "experiment: an error that comes and goes so often is irregular, and no effect is named for it."
    )
    return made, [text], [Omission.of(rounds, one, RECURRING) for one in events]


def _explain_everything(rounds: Sequence[SearchRound], search: SearchContext) -> bool:
    """Whether the effects of all rounds but the last leave noise only."""
    before, after = (mean_loss(one.losses, search.blocks) for one in (rounds[0], rounds[-1]))
    noise = attained_noise(rounds, search)
    return (
        before - after >= COMPLETE * (before - noise) and not evidence(rounds[-1].base, search.settings.seed).material
    )


def _imitations(
    rounds: Sequence[SearchRound], named: Sequence[FittedCandidate], search: SearchContext
) -> list[FittedCandidate]:
    """The named effects that imitate an irregular error; the last round is the one after them."""
    base, last = rounds[0].base, rounds[-1].base
    sudden = [one for one in named if one.candidate.has_own_instants]
    if any(_apart(last, one, other) for k, one in enumerate(sudden) for other in sudden[:k]):
        return sudden
    own = [one for one in named if one.candidate.effect.family == "time" and one.candidate.local]
    alone = [one for k, one in enumerate(own) if not any(_harmonic(last, one, other) for other in own[:k])]
    if len(alone) > MAX_OWN:
        return own
    loops = [one for one in sudden if one.candidate.effect.variant.startswith("hysteresis")]
    everywhere = [one for one in loops if _is_everywhere(last, base, one)]
    if loops and _explain_everything(rounds, search):
        return everywhere if len(named) > 1 else []
    return loops if len(named) > 1 else everywhere


def _is_everywhere(last: Model, base: Model, one: FittedCandidate) -> bool:
    """Whether the first size of an effect is clear of zero in most of the experiments."""
    sizes = Estimate.of([base, last]).sizes(one.candidate)
    first = one.candidate.effect.sizes[0].name
    clear = [size.low > 0 or size.high < 0 for name, size in sizes.items() if name.startswith(f"{first}@")]
    return len(clear) >= MIN_RECORDINGS and sum(clear) > MOST * len(clear)


def _harmonic(last: Model, one: FittedCandidate, other: FittedCandidate) -> bool:
    """Whether two effects have frequencies of which one is a multiple of the other."""
    values = [last.values.get(f"{effect.candidate.block}.frequency", 0.0) for effect in (one, other)]
    low, high = sorted(values)
    return low > 0 and abs(high / low - round(high / low)) < SAME_LINE * high / low


def _instants(model: Model, one: FittedCandidate) -> np.ndarray:
    """The instants [s] of an effect, one for each experiment."""
    name, items = f"{one.candidate.block}.{one.candidate.trials.refine[0]}", model.problem.unknowns.items
    return np.array([value for item, value in zip(items, model.theta, strict=True) if item.parameter == name])


def _apart(model: Model, one: FittedCandidate, other: FittedCandidate) -> bool:
    """Whether two effects act at different instants, in most of the experiments."""
    distance = np.abs(_instants(model, one) - _instants(model, other))
    return bool(np.mean(distance > SAME_INSTANT * one.candidate.transition_time) > 0.5)
