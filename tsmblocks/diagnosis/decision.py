"""Which candidate is named, and which others it cannot be told from, by losses on blocks of time held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.cross_validation import TimeBlocks, held_out_residuals
from tsmblocks.diagnosis.model import Model

MIN_VARIANCE_REDUCTION = 0.06
"""Fall of the mean square, in variances of the noise, below which an effect is not worth a name."""
CARRIED = 0.5
"""Share of what the noise of the inputs does to the base that an effect has to remove at least."""
RARE = 3.0
"""How much more than that an effect removes which shows in a few blocks only, so that no t can speak for it."""
QUIET = 0.05
"""Excess over the noise, as a share of it, below which nothing is looked for."""
TOUCHING = 1e-3
"""Distance from a bound, as a share of its size, that counts as lying on it."""
FAR = 1e9
"""A null beyond this is no number to be drawn to: a limit that never acts."""
BEYOND = 0.1
"""Share of what it removes by which an effect that left its bounds may be better than any other, before it matters."""
NEARLY = 0.95
"""Share of what another effect removes from which a simpler one, or a special case of it, is named instead."""
PERMUTATIONS = 999
"""Random signs from which the line is found that chance does not pass."""
SIGNIFICANCE_LEVEL = 0.05
"""Probability that any candidate passes the line by chance."""
INDISTINGUISHABLE_T = 2.0
"""Two candidates are alike where the paired t of their losses is below this ..."""
ALIKE = 0.01
"""... or their difference is below this share of the noise's variance ..."""
CLOSE = 0.002
"""... or of what the better one removes ..."""
APART = 0.2
"""... unless one leaves more than this share of what the other removes: a few blocks may then say it all."""


Shrinkage = Mapping[str, tuple[float, float]]
"""For each free parameter of effects, by full name: its null (NaN where it has none) and a size worth trying."""


@attrs.frozen(eq=False)
class FittedCandidate:
    """A candidate fitted together with the base, and what it leaves held out.

    ``losses`` (B,) are the held-out losses by time blocks, ``experiment_losses`` (B,) those with whole experiments held
    out; ``loss`` is the mean of ``losses`` over all samples.
    """

    candidate: Candidate
    model: Model
    losses: np.ndarray = attrs.field(repr=False)
    experiment_losses: np.ndarray = attrs.field(repr=False)
    loss: float

    @property
    def disqualifying_bounds(self) -> tuple[str, ...]:
        """Parameters on a bound beyond which the effect would be another, so that its name does not hold."""
        return tuple(k for k in self.at_bounds if k in self.candidate.effect.within)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters of the effect that lie on a bound."""
        unknowns, block, found = self.model.problem.unknowns, self.candidate.block, []
        for item, value in zip(unknowns.items, self.model.theta, strict=True):
            if item.parameter in self.candidate.free:
                near = TOUCHING * max(abs(item.low) if abs(item.low) < FAR else 0.0, abs(value), 1e-12)
                if min(abs(value - item.low), abs(item.high - value)) <= near:
                    found.append(item.parameter.removeprefix(f"{block}."))
        return tuple(found)

    @property
    def parameter_count(self) -> int:
        """Number of unknowns that hold for all experiments: start values make an effect no less simple."""
        return int(np.sum(~self.model.is_local))


def held_out_losses(model: Model, blocks: TimeBlocks, shrinkage: Shrinkage) -> tuple[np.ndarray, np.ndarray]:
    """Losses of a model by blocks (B,), held out by folds and by experiments; ``shrinkage`` are the effects in it."""
    pull, null = ridge_weights(shrinkage, model)
    return (
        blocks.losses(held_out_residuals(model, blocks.fold, pull, null)),
        blocks.losses(held_out_residuals(model, blocks.experiment, pull, null)),
    )


def fitted_candidate(candidate: Candidate, model: Model, blocks: TimeBlocks, shrinkage: Shrinkage) -> FittedCandidate:
    """A fitted candidate with its losses. ``shrinkage`` are the effects named before."""
    losses, experiment_losses = held_out_losses(model, blocks, {**shrinkage, **shrinkage_of(candidate)})
    return FittedCandidate(candidate, model, losses, experiment_losses, mean_loss(losses, blocks))


def mean_loss(losses: np.ndarray, blocks: TimeBlocks) -> float:
    """Mean over all samples of losses by blocks."""
    return float(losses @ blocks.sizes / blocks.sizes.sum())


def shrinkage_of(candidate: Candidate) -> Shrinkage:
    """Nulls and sizes of an effect's free parameters."""
    trials, effect = candidate.trials, candidate.effect
    made = {}
    for name in effect.free:
        shape = [abs(s[name]) for s in trials.shapes if name in s]
        size = trials.strengths.get(name) or (float(np.mean(shape)) if shape else 1.0)
        if name == trials.refine:  # found by trials, so it must not wander when its few samples are held out
            size = candidate.transition_time
        null = effect.null.get(name, np.nan)
        made[f"{candidate.block}.{name}"] = (null if abs(null) < FAR else np.nan, abs(size))
    return made


def ridge_weights(shrinkage: Shrinkage, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """How the unknowns are drawn to where effects are nothing: weights (n,) and nulls (n,)."""
    pull, null = np.zeros(len(model.theta)), model.theta.copy()
    for k, item in enumerate(model.problem.unknowns.items):
        if item.parameter in shrinkage:
            zero, size = shrinkage[item.parameter]
            pull[k] = 1 / (size if np.isnan(zero) else max(size, abs(model.theta[k]))) ** 2
            null[k] = model.theta[k] if np.isnan(zero) else zero
    return pull, null


@attrs.frozen(eq=False)
class Verdict:
    """Candidates from best to worst by held-out loss, their t-statistics, and the critical value of the largest.

    ``named`` is the accepted candidate (None where none is accepted), ``indistinguishable`` those that the data do not
    separate from it, itself first. ``out_of_bounds_loss`` is the loss of a candidate at a disqualifying bound that
    explains more than every other one: the name then holds only together with further effects that reach a lower loss.
    """

    ranking: tuple[FittedCandidate, ...]
    t: tuple[float, ...]
    critical_value: float
    named: FittedCandidate | None
    indistinguishable: tuple[FittedCandidate, ...]
    out_of_bounds_loss: float = np.inf


def decide(
    base: np.ndarray, found: Sequence[FittedCandidate], blocks: TimeBlocks, noise_variance: float, seed: int
) -> Verdict:
    """Name the candidate that removes most, if it removes enough, more than chance does, and more than others.

    ``base`` (B,) are the losses without any candidate, ``noise_variance`` the mean square of the noise.
    """
    finite = [one for one in found if np.isfinite(one.losses).all()]
    if not finite:
        return Verdict((), (), float("inf"), None, ())
    ranking = sorted(finite, key=lambda one: (bool(one.disqualifying_bounds), one.loss))
    gains = np.array([base - one.losses for one in ranking])
    t, critical_value = t_statistics(gains, blocks), max_t_critical_value(gains, blocks, seed)
    before, best = mean_loss(base, blocks), ranking[0]
    rare = _concentrated(gains[0]) and before - best.loss >= RARE * MIN_VARIANCE_REDUCTION * noise_variance
    shown = t[0] > critical_value or rare
    out_of_bounds_loss = min((one.loss for one in ranking if one.disqualifying_bounds), default=np.inf)
    out_of_bounds_loss = (
        out_of_bounds_loss if out_of_bounds_loss < best.loss - BEYOND * (before - out_of_bounds_loss) else np.inf
    )
    if best.disqualifying_bounds or not _is_acceptable(before - best.loss, before, shown, noise_variance):
        return Verdict(tuple(ranking), tuple(t), critical_value, None, ())
    apart = max(APART * (before - best.loss), ALIKE * noise_variance)
    near = max(ALIKE * noise_variance, CLOSE * (before - best.loss))
    inside = [one for one in ranking if not one.disqualifying_bounds and one.loss - best.loss < apart]
    indistinguishable = [
        one
        for one in inside
        if _is_indistinguishable(one, best, blocks, near, RARE * MIN_VARIANCE_REDUCTION * noise_variance)
    ]
    close = [one for one in indistinguishable if before - one.loss >= NEARLY * (before - best.loss)]
    named = _simplest(min(close, key=lambda one: (one.parameter_count, one.loss)), ranking, before)
    says_more = named not in indistinguishable  # a general form that leaves no less says nothing else
    others = [
        one
        for one in indistinguishable
        if one is not named and (says_more or named.candidate.effect.name not in one.candidate.effect.contains)
    ]
    return Verdict(tuple(ranking), tuple(t), critical_value, named, (named, *others), out_of_bounds_loss)


def _simplest(named: FittedCandidate, ranking: Sequence[FittedCandidate], before: float) -> FittedCandidate:
    """The candidate, or a special case of it that removes nearly all that it does: the rest may be another effect."""
    special = [
        one
        for one in ranking
        if one.candidate.effect.name in named.candidate.effect.contains
        and not one.disqualifying_bounds
        and before - one.loss >= NEARLY * (before - named.loss)
    ]
    return special[0] if special else named


def _is_acceptable(removed: float, before: float, shown: bool, noise_variance: float) -> bool:
    """Whether what is removed is worth a name, and there was something to remove.

    What the noise of the inputs does to the base, ``noise_variance`` - 1, an effect may imitate in part.
    """
    return (
        shown
        and removed >= max(MIN_VARIANCE_REDUCTION * noise_variance, CARRIED * (noise_variance - 1))
        and before >= (1 + QUIET) * noise_variance
    )


def t_statistics(gains: np.ndarray, blocks: TimeBlocks) -> np.ndarray:
    """Mean over standard error of gains by blocks (C, B), blocks weighed by their samples, shape (C,)."""
    weight = blocks.sizes / blocks.sizes.sum()
    centre = gains @ weight
    spread = np.sqrt(((gains - centre[:, None]) ** 2 * weight**2).sum(axis=1) * len(weight) / max(len(weight) - 1, 1))
    return centre / np.maximum(spread, 1e-12)


def max_t_critical_value(gains: np.ndarray, blocks: TimeBlocks, seed: int) -> float:
    """What the largest t of all candidates stays below in 19 of 20 draws of random signs for the blocks."""
    draw = np.random.default_rng(seed)
    signs = draw.choice([-1.0, 1.0], size=(PERMUTATIONS, gains.shape[1]))
    highest = [float(t_statistics(gains * sign, blocks).max()) for sign in signs]
    return float(np.quantile(highest, 1 - SIGNIFICANCE_LEVEL))


def _concentrated(gain: np.ndarray) -> bool:
    """Whether a few blocks gain far more than the others scatter: an effect that shows only now and then."""
    scatter = 1.4826 * float(np.median(np.abs(gain - np.median(gain)))) + 0.02
    largest = np.sort(gain)
    return bool(largest[-1] > 10 * scatter and largest[-1] > 5 * -min(largest[0], 0.0))


def _is_indistinguishable(
    one: FittedCandidate, best: FittedCandidate, blocks: TimeBlocks, near: float, rare_threshold: float
) -> bool:
    """Whether the losses of two candidates do not differ: a difference below ``near`` never counts, and one above
    ``rare_threshold`` that is concentrated in a few blocks always does, whatever its t-statistic.
    """
    if one is best:
        return True
    difference = one.losses - best.losses
    worse = mean_loss(difference, blocks)
    if _concentrated(difference) and worse >= rare_threshold:
        return False
    return bool(t_statistics(difference[None, :], blocks)[0] < INDISTINGUISHABLE_T or worse < near)
