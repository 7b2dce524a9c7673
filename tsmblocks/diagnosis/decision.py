"""Which candidate is named, and which others it cannot be told from, by losses on blocks of time held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.cross_validation import Parts, held_out
from tsmblocks.diagnosis.model import Model

MATERIAL = 0.06
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
FLIPS = 999
"""Random signs from which the line is found that chance does not pass."""
LEVEL = 0.05
"""Probability that any candidate passes the line by chance."""
ALIKE_T = 2.0
"""Two candidates are alike where the paired t of their losses is below this ..."""
ALIKE = 0.01
"""... or their difference is below this share of the noise's variance ..."""
CLOSE = 0.002
"""... or of what the better one removes ..."""
APART = 0.2
"""... unless one leaves more than this share of what the other removes: a few blocks may then say it all."""


Sizes = Mapping[str, tuple[float, float]]
"""For each free parameter of effects, by full name: its null (NaN where it has none) and a size worth trying."""


@attrs.frozen(eq=False)
class Tried:
    """A candidate fitted together with the base, and what it leaves held out.

    ``losses`` (B,) by blocks, ``across`` (B,) with whole experiments held out; ``loss`` is their mean over all samples.
    """

    candidate: Candidate
    model: Model
    losses: np.ndarray = attrs.field(repr=False)
    across: np.ndarray = attrs.field(repr=False)
    loss: float

    @property
    def outside(self) -> tuple[str, ...]:
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
    def count(self) -> int:
        """Number of unknowns that hold for all experiments: start values make an effect no less simple."""
        return int(np.sum(~self.model.local))


def losses_of(model: Model, parts: Parts, known: Sizes) -> tuple[np.ndarray, np.ndarray]:
    """Losses of a model by blocks (B,), held out by folds and by experiments; ``known`` are the effects in it."""
    pull, null = weights(known, model)
    return (
        parts.losses(held_out(model, parts.fold, pull, null)),
        parts.losses(held_out(model, parts.experiment, pull, null)),
    )


def tried(candidate: Candidate, model: Model, parts: Parts, known: Sizes) -> Tried:
    """A fitted candidate with its losses. ``known`` are the effects named before."""
    losses, across = losses_of(model, parts, {**known, **sizes_of(candidate)})
    return Tried(candidate, model, losses, across, mean(losses, parts))


def mean(losses: np.ndarray, parts: Parts) -> float:
    """Mean over all samples of losses by blocks."""
    return float(losses @ parts.sizes / parts.sizes.sum())


def sizes_of(candidate: Candidate) -> Sizes:
    """Nulls and sizes of an effect's free parameters."""
    trials, effect = candidate.trials, candidate.effect
    made = {}
    for name in effect.free:
        shape = [abs(s[name]) for s in trials.shapes if name in s]
        size = trials.strengths.get(name) or (float(np.mean(shape)) if shape else 1.0)
        if name == trials.refine:  # found by trials, so it must not wander when its few samples are held out
            size = candidate.transition
        null = effect.null.get(name, np.nan)
        made[f"{candidate.block}.{name}"] = (null if abs(null) < FAR else np.nan, abs(size))
    return made


def weights(known: Sizes, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """How the unknowns are drawn to where effects are nothing: weights (n,) and nulls (n,)."""
    pull, null = np.zeros(len(model.theta)), model.theta.copy()
    for k, item in enumerate(model.problem.unknowns.items):
        if item.parameter in known:
            zero, size = known[item.parameter]
            pull[k] = 1 / (size if np.isnan(zero) else max(size, abs(model.theta[k]))) ** 2
            null[k] = model.theta[k] if np.isnan(zero) else zero
    return pull, null


@attrs.frozen(eq=False)
class Verdict:
    """Candidates from best to worst by held-out loss, each with its t, beside the line that chance does not pass.

    ``named`` is the one to name (None where none passes), ``alike`` those that it cannot be told from, itself first.
    ``beyond`` is the loss of an effect that left its bounds, and so is none, where it explains more than any other: the
    name then holds only together with further effects that leave less than that.
    """

    ranking: tuple[Tried, ...]
    t: tuple[float, ...]
    line: float
    named: Tried | None
    alike: tuple[Tried, ...]
    beyond: float = np.inf


def decide(base: np.ndarray, found: Sequence[Tried], parts: Parts, floor: float, seed: int) -> Verdict:
    """Name the candidate that removes most, if it removes enough, more than chance does, and more than others.

    ``base`` (B,) are the losses without any candidate, ``floor`` the mean square of the noise.
    """
    finite = [one for one in found if np.isfinite(one.losses).all()]
    if not finite:
        return Verdict((), (), float("inf"), None, ())
    ranking = sorted(finite, key=lambda one: (bool(one.outside), one.loss))
    gains = np.array([base - one.losses for one in ranking])
    t, line = student(gains, parts), max_t_line(gains, parts, seed)
    before, best = mean(base, parts), ranking[0]
    rare = _concentrated(gains[0]) and before - best.loss >= RARE * MATERIAL * floor
    shown = t[0] > line or rare
    beyond = min((one.loss for one in ranking if one.outside), default=np.inf)
    beyond = beyond if beyond < best.loss - BEYOND * (before - beyond) else np.inf
    if best.outside or not _passes(before - best.loss, before, shown, floor):
        return Verdict(tuple(ranking), tuple(t), line, None, ())
    apart = max(APART * (before - best.loss), ALIKE * floor)
    near = max(ALIKE * floor, CLOSE * (before - best.loss))
    inside = [one for one in ranking if not one.outside and one.loss - best.loss < apart]
    alike = [one for one in inside if _alike(one, best, parts, near, RARE * MATERIAL * floor)]
    close = [one for one in alike if before - one.loss >= NEARLY * (before - best.loss)]
    named = _plainest(min(close, key=lambda one: (one.count, one.loss)), ranking, before)
    says_more = named not in alike  # a general form that leaves no less says nothing else
    others = [
        one
        for one in alike
        if one is not named and (says_more or named.candidate.effect.name not in one.candidate.effect.contains)
    ]
    return Verdict(tuple(ranking), tuple(t), line, named, (named, *others), beyond)


def _plainest(named: Tried, ranking: Sequence[Tried], before: float) -> Tried:
    """The candidate, or a special case of it that removes nearly all that it does: the rest may be another effect."""
    special = [
        one
        for one in ranking
        if one.candidate.effect.name in named.candidate.effect.contains
        and not one.outside
        and before - one.loss >= NEARLY * (before - named.loss)
    ]
    return special[0] if special else named


def _passes(removed: float, before: float, shown: bool, floor: float) -> bool:
    """Whether what is removed is worth a name, and there was something to remove.

    What the noise of the inputs does to the base, ``floor`` - 1, an effect may imitate in part.
    """
    return shown and removed >= max(MATERIAL * floor, CARRIED * (floor - 1)) and before >= (1 + QUIET) * floor


def student(gains: np.ndarray, parts: Parts) -> np.ndarray:
    """Mean over standard error of gains by blocks (C, B), blocks weighed by their samples, shape (C,)."""
    weight = parts.sizes / parts.sizes.sum()
    centre = gains @ weight
    spread = np.sqrt(((gains - centre[:, None]) ** 2 * weight**2).sum(axis=1) * len(weight) / max(len(weight) - 1, 1))
    return centre / np.maximum(spread, 1e-12)


def max_t_line(gains: np.ndarray, parts: Parts, seed: int) -> float:
    """What the largest t of all candidates stays below in 19 of 20 draws of random signs for the blocks."""
    draw = np.random.default_rng(seed)
    signs = draw.choice([-1.0, 1.0], size=(FLIPS, gains.shape[1]))
    highest = [float(student(gains * sign, parts).max()) for sign in signs]
    return float(np.quantile(highest, 1 - LEVEL))


def _concentrated(gain: np.ndarray) -> bool:
    """Whether a few blocks gain far more than the others scatter: an effect that shows only now and then."""
    scatter = 1.4826 * float(np.median(np.abs(gain - np.median(gain)))) + 0.02
    largest = np.sort(gain)
    return bool(largest[-1] > 10 * scatter and largest[-1] > 5 * -min(largest[0], 0.0))


def _alike(one: Tried, best: Tried, parts: Parts, near: float, plain: float) -> bool:
    """Whether two candidates leave the same: a difference below ``near`` is none, one above ``plain`` that a few
    blocks show is one all the same, though no t can speak for it.
    """
    if one is best:
        return True
    difference = one.losses - best.losses
    worse = mean(difference, parts)
    if _concentrated(difference) and worse >= plain:
        return False
    return bool(student(difference[None, :], parts)[0] < ALIKE_T or worse < near)
