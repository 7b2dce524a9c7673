"""How many of the effects that rounds of a search named are accepted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsmblocks.diagnosis.critical_gains import is_of_time
from tsmblocks.diagnosis.decision import mean_loss
from tsmblocks.diagnosis.oscillation import is_oscillation
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound

MIN_EXCESS_SHARE = 0.5
"""Share of the excess that an effect has to remove. Source: set on the development seeds of the method's prototype."""
FLOOR = 1.0
"""Mean square of the noise floor [noise variances]. Definition."""
MIN_JOINT_SHARE = 0.8
"""Share of the excess that several effects have to remove together, none of which removes ``MIN_EXCESS_SHARE``. Chosen:
stricter than for one effect, since several parameters fit more by chance."""
MIN_FURTHER_SHARE = 0.2
"""Share of the remaining excess that a further effect has to remove, where it removes more than the noise variance.
Calibrated on tests/benchmarks/hidden.py."""
MIN_SHARE_OF_REMOVED = 0.15
"""Share of all that was removed below which a further effect is taken for an error of form of the effects before.
Chosen: catalogue blocks and real effects differ in form by about as much."""
MIN_SHARE_BESIDE = 1e-3
"""Share of all that was removed, in every output, below which that holds however large it is beside the noise. Chosen:
the smoothed sign of a friction leaves more of a mechanism that sticks, where the noise is a hundred thousandth of the
motion."""
TINY_SHARE = 0.01
"""Share of all that was removed, below which a further effect that is small beside the noise has to be clearly
significant, of time or not. Chosen: a tenth of the error. A stop that is met a few times leaves events."""
MAX_HARM_SHARE = 0.5
"""Rise of the loss of experiments held out whole, over the fall of that of blocks, up to which a further effect is
accepted that has the same size in all of them. Chosen: one that is there lowers both, and an error of form does not
carry over."""
CLEAR_SIGNIFICANCE = 2.0
"""t-statistic over its critical value (95 %) from which a further effect that is small beside those before is accepted.
Derived: 3.29 / 1.64, the quantiles of a normal distribution at 99.95 % and 95 %."""


def accepted_count(rounds: Sequence[SearchRound], search: SearchContext) -> int:
    """The number of named effects that are accepted.

    The first one is accepted if it removes ``MIN_EXCESS_SHARE`` of the excess; where none does, several are that
    together remove ``MIN_JOINT_SHARE``. A further one is accepted if it removes a material share of the remaining
    excess and is no mere error of form of those before: such errors are small beside the noise and beside what was
    removed, or next to nothing beside that, and depend on the motion where those before do, or on time. One that leaves
    noise only is accepted all the same where it is clearly significant and no second effect of the same name. A tiny
    one of another kind has to be clearly significant as well. Several further ones are accepted that together remove
    ``MIN_JOINT_SHARE`` of what remained, more than errors of form do.
    Beside slow noise the first one may be a wandering of that, if it is one of time, or several of time may be: what
    they leave above the noise floor counts as well, so that they have to be larger than the slow noise.

    None are accepted that leave more than a candidate at a disqualifying bound would, and none beside others that make
    the error of experiments larger that are held out whole.
    """
    losses = [mean_loss(one.losses, search.blocks) for one in rounds]
    noise = attained_noise(rounds, search)
    before, count, limit = losses[0], 0, float("inf")
    for k in range(1, len(losses)):
        limit = min(limit, rounds[k - 1].verdict.out_of_bounds_loss)
        if losses[k] > limit:
            continue
        removed = losses[k - 1] - losses[k]
        share_of_rest = removed / max(losses[k - 1] - noise, 1e-12)
        above_floor = losses[k - 1] - _noise_beside(rounds[k - 1 : k], noise)
        joint_share = (before - losses[k]) / max(before - _noise_beside(rounds[:k], noise), 1e-12)
        share_so_far = (before - losses[count]) / max(before - noise, 1e-12) if count else 0.0
        large = removed >= noise
        if share_so_far < MIN_EXCESS_SHARE:
            first = removed >= MIN_EXCESS_SHARE * max(above_floor, 1e-12) and count == k - 1
            count = k if first or joint_share >= MIN_JOINT_SHARE else count
        elif not _carries_over(rounds, count, k, search):
            continue
        elif count == k - 1 and share_of_rest >= (MIN_FURTHER_SHARE if large else MIN_EXCESS_SHARE):
            share, complete = removed / (before - losses[k]), share_of_rest >= MIN_JOINT_SHARE
            large = large and _is_beside(rounds, k, share)
            small = share < MIN_SHARE_OF_REMOVED and _is_error_of_form(rounds, k - 1, complete, share < TINY_SHARE)
            count = k if large or not small else count
        elif count < k - 1:  # with those in between that were not accepted alone
            together = losses[count] - losses[k]
            material = together >= MIN_SHARE_OF_REMOVED * (before - losses[k])
            count = k if material and together >= MIN_JOINT_SHARE * (losses[count] - noise) else count
    return count


def _noise_beside(rounds: Sequence[SearchRound], noise: float) -> float:
    """The mean square of the noise beside which the effects of rounds count: the floor where all are of time."""
    return min(noise, FLOOR) if all(map(_is_of_time, rounds)) else noise


def _carries_over(rounds: Sequence[SearchRound], before: int, after: int, search: SearchContext) -> bool:
    """Whether further effects do not make the error of whole experiments larger that are held out.

    Those with a size of their own in each experiment cannot carry over, and are judged by blocks alone.
    """
    named = [one.verdict.named for one in rounds[before:after] if one.verdict.named is not None]
    if not search.blocks.experiment.any() or any(one.candidate.effect.local for one in named):
        return True
    a, b = rounds[before], rounds[after]
    harm = mean_loss(b.experiment_losses, search.blocks) - mean_loss(a.experiment_losses, search.blocks)
    return harm <= MAX_HARM_SHARE * (mean_loss(a.losses, search.blocks) - mean_loss(b.losses, search.blocks))


def _is_beside(rounds: Sequence[SearchRound], k: int, share: float) -> bool:
    """Whether effect ``k`` removes a material ``share`` of all that was removed, or of what was of one output.

    What it removes of that output is at least the noise variance.
    """
    if share >= MIN_SHARE_BESIDE:
        return True
    errors = [np.square(list(rounds[i].base.residual_rms.values())) for i in (0, k - 1, k)]
    removed, of = errors[1] - errors[2], errors[0] - errors[2]
    return bool(((removed >= 1) & (of > 0) & (removed >= MIN_SHARE_BESIDE * of)).any())


def _is_error_of_form(rounds: Sequence[SearchRound], k: int, complete: bool, tiny: bool) -> bool:
    """Whether a small effect of round ``k`` is an error of form of those before.

    ``complete``: it leaves noise only; ``tiny``: it removes next to nothing beside them.
    """
    clear = rounds[k].verdict.significance >= CLEAR_SIGNIFICANCE
    if not _is_like_those_before(rounds, k):
        return tiny and not clear
    return not (complete and clear) or _is_named_before(rounds, k)


def _is_like_those_before(rounds: Sequence[SearchRound], k: int) -> bool:
    """Whether the effect of round ``k`` is one of time where one named before is, or one of the motion likewise."""
    of_time = [_is_of_time(one) for one in rounds[: k + 1]]
    return of_time[-1] in of_time[:-1]


def _is_of_time(one: SearchRound) -> bool:
    """Whether a round named an effect of time."""
    return one.verdict.named is not None and is_of_time(one.verdict.named.candidate)


def _is_named_before(rounds: Sequence[SearchRound], k: int) -> bool:
    """Whether an effect of the name of round ``k`` is in the model already: the second one is an error of its form.

    Oscillations of different periods are different effects.
    """
    named = [one.verdict.named.candidate for one in rounds[: k + 1] if one.verdict.named is not None]
    return not is_oscillation(named[-1]) and named[-1].effect.name in {one.effect.name for one in named[:-1]}


def attained_noise(rounds: Sequence[SearchRound], search: SearchContext) -> float:
    """Mean square of the noise [noise variances], by the best of the models that rounds start from."""
    best = min(rounds, key=lambda one: mean_loss(one.losses, search.blocks))
    return search.noise.attained(mean_loss(best.losses, search.blocks), float(np.median(best.losses)))
