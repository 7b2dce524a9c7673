"""From search rounds to the result of a segment: effects with intervals, errors, ranking, detection limits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.cross_validation import TimeBlocks, held_out_residuals
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION, FittedCandidate, mean_loss, ridge_weights, shrinkage_of
from tsmblocks.diagnosis.discrimination import separating_experiment
from tsmblocks.diagnosis.evidence import MIN_PREDICTED_EXCESS, Evidence, is_material
from tsmblocks.diagnosis.forward_selection import (
    MIN_EXCESS_SHARE,
    SearchContext,
    SearchRound,
    attained_noise,
    critical_gains,
)
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.noise_floor import NoiseFloors
from tsmblocks.diagnosis.partition import Part, experiment_of, in_whole_diagram, rows_of_experiments
from tsmblocks.diagnosis.quantities import Estimate, detectable_size
from tsmblocks.diagnosis.refinement import as_fit
from tsmblocks.diagnosis.residual_location import coordinates, explainable_share, residual_coordinates
from tsmblocks.diagnosis.result import DetectionLimit, Gap, NamedEffect, RankedCandidate, Segment, Trace
from tsmblocks.diagnosis.time_and_distance import second_frequency
from tsmblocks.diagnosis.varying_factor import VaryingFactor
from tsmblocks.diagnosis.verdict_text import verdict_sentence
from tsmblocks.effects import Effect
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.model.diagram import Diagram

UNKNOWN_EXCESS = 0.2
"""Excess over a given noise floor, or over the largest noise that is plausible where nothing predicts the residual
[noise variances], from which the verdict is "unknown". Source: set on the prototype's development seeds."""
INPUT_NOISE_THRESHOLD = 1e-3
"""Variance caused by input noise [output noise variances] from which it is reported. Chosen: below three digits."""


@attrs.frozen(eq=False)
class DiagnosedPart:
    """The search for one part of a diagram: its rounds, how many effects are accepted, and the final model."""

    part: Part
    search: SearchContext
    floors: NoiseFloors
    rounds: Sequence[SearchRound]
    count: int
    final: Model
    """The last accepted model, at a step that its intervals cover."""
    predicted: Evidence
    """The predictable part of the base's residual."""
    left: Evidence
    """The predictable part of the final model's residual."""
    varying: VaryingFactor | None = None
    """The coordinate to which the final model's residual is proportional by a factor that varies."""

    @property
    def blocks(self) -> TimeBlocks:
        """The time blocks of the search."""
        return self.search.blocks

    @property
    def losses(self) -> list[float]:
        """Held-out loss of the base, and after each accepted effect [noise variances]."""
        return [mean_loss(one.losses, self.blocks) for one in self.rounds[: self.count + 1]]

    @property
    def noise_variance(self) -> float:
        """Mean square of the noise [output noise variances]."""
        noise = attained_noise(self.rounds[: self.count + 1], self.search)
        if self.varying is None or not self.varies:
            return noise
        return min(noise, (1 - self.varying.share) * self.losses[-1])  # the rest of it is a model error

    @property
    def is_irregular(self) -> bool:
        """Whether the last model leaves more than noise may be, and no function of what was recorded."""
        large = self.losses[-1] > (1 + UNKNOWN_EXCESS) * self.largest_noise or self.varies
        return large and not self.leaves_predictable

    @property
    def varies(self) -> bool:
        """Whether what the last model leaves is proportional to the motion by a factor that varies, materially."""
        return self.varying is not None and self.varying.material and not self._is_within_given_noise

    @property
    def _is_within_given_noise(self) -> bool:
        """Whether the last model leaves no more than the noise that the user gave."""
        noise = self.search.noise
        return noise.is_given and self.losses[-1] <= (1 + UNKNOWN_EXCESS) * noise.low

    @property
    def largest_noise(self) -> float:
        """The largest mean square of noise that is plausible in the residual of the last model [noise variances]."""
        last = self.rounds[self.count]
        return self.search.noise.largest(float(np.median(last.losses)))

    @property
    def leaves_predictable(self) -> bool:
        """Whether what the last model leaves is predicted, and material beside the noise."""
        if self._is_within_given_noise:
            return False
        material = self.left.material and self.left.predicted >= MIN_PREDICTED_EXCESS * self.search.noise.low
        return material or is_material(self.rejected_share)

    @property
    def rejected_share(self) -> float:
        """Share of the base's mean square that the best effect removes, where it removes too little to be accepted."""
        rejected = None if self.count else self.rounds[0].verdict.named
        return 0.0 if rejected is None else max(1 - rejected.loss / self.losses[0], 0.0)

    @property
    def models(self) -> list[Model]:
        """The base, and the model after each accepted effect."""
        return [*(one.base for one in self.rounds[: self.count]), self.final]

    @property
    def named(self) -> list[FittedCandidate]:
        """The accepted effects."""
        return [one.verdict.named for one in self.rounds[: self.count] if one.verdict.named is not None]


def segment_summary(diagnosed: DiagnosedPart, whole_diagram: Diagram) -> Segment:
    """The result of a segment."""
    noise_variance, blocks, base = diagnosed.noise_variance, diagnosed.blocks, diagnosed.models[0]
    losses = diagnosed.losses
    excess = losses[0] / noise_variance - 1
    known = _coordinates(base, diagnosed.part)
    excess_variance = max(base.mean_square - noise_variance, 0.0)
    ceiling = explainable_share(base.r, known, blocks, excess_variance)
    remains = diagnosed.leaves_predictable or diagnosed.is_irregular
    verdict = "named" if diagnosed.count else "unknown" if remains else "none"
    held = _held_out(diagnosed)
    result = Segment(
        diagnosed.part.name,
        tuple(diagnosed.part.diagram.inputs),
        diagnosed.part.outputs,
        verdict,
        float(excess),
        {k: v * np.sqrt(diagnosed.search.noise_variance) for k, v in diagnosed.floors.sigma.items()},
        _effects(diagnosed, losses, whole_diagram),
        tuple(_gap(diagnosed, i, held) for i in range(len(base.setup.outputs))),
        residual_coordinates(base.r, known, blocks, excess_variance),
        _ranking(diagnosed),
        _limits(diagnosed),
        _traces(diagnosed),
        ceiling,
        "",
        as_fit(diagnosed.final),
        complete=not remains,
        irregular=diagnosed.is_irregular,
        varies_with=diagnosed.varying.words if diagnosed.varying is not None and diagnosed.varies else "",
        predictable=(
            max(diagnosed.predicted.share, diagnosed.rejected_share, 0.0),
            max(diagnosed.left.share, diagnosed.rejected_share, 0.0),
        ),
        largest_noise={k: v * np.sqrt(diagnosed.largest_noise) for k, v in diagnosed.floors.sigma.items()},
    )
    return attrs.evolve(result, sentence=verdict_sentence(result))


def _held_out(diagnosed: DiagnosedPart) -> list[np.ndarray]:
    """Held-out residuals (N,) of each model."""
    result, shrinkage = [], dict[str, tuple[float, float]]()
    for model, one in itertools.zip_longest(diagnosed.models, diagnosed.named):
        ridge, null = ridge_weights(shrinkage, model)
        result.append(held_out_residuals(model, diagnosed.blocks.fold, ridge, null))
        shrinkage |= {} if one is None else shrinkage_of(one.candidate)
    return result


def _effects(diagnosed: DiagnosedPart, losses: Sequence[float], whole_diagram: Diagram) -> tuple[NamedEffect, ...]:
    """The effects, in the order in which they were accepted."""
    if not diagnosed.count:
        return ()
    estimate = Estimate.of(diagnosed.models)
    return tuple(_named(diagnosed, k, losses, whole_diagram, estimate) for k in range(diagnosed.count))


def _named(
    diagnosed: DiagnosedPart, k: int, losses: Sequence[float], whole_diagram: Diagram, estimate: Estimate
) -> NamedEffect:
    """One effect, with its parameters and sizes in the final model."""
    indistinguishable, candidate = diagnosed.rounds[k].indistinguishable, diagnosed.named[k].candidate
    effect, point = candidate.effect, in_whole_diagram(candidate.point, diagnosed.part)
    across = None
    if _has_several_experiments(diagnosed):
        whole_losses = [mean_loss(one.experiment_losses, diagnosed.blocks) for one in diagnosed.rounds]
        across = min(_share_removed(whole_losses, k, diagnosed.noise_variance), 1.0)
    also = dict.fromkeys(one.candidate.effect.name for one in indistinguishable)
    # Beside the others its more general form may come first; the experiment is for the effect that was named.
    same = next((one for one in indistinguishable if one.candidate.effect.name == effect.name), diagnosed.named[k])
    return NamedEffect(
        effect.name,
        effect.family,
        effect.words,
        diagnosed.part.name,
        point.words(_with_effects(diagnosed, k, whole_diagram)),
        candidate.block,
        estimate.parameters(candidate),
        float(np.clip(_share_removed(losses, k, diagnosed.noise_variance), 0.0, 1.0)),
        across,
        tuple(name for name in also if name != effect.name),
        second_frequency(effect.name, also, diagnosed.search.only_frequency)
        or separating_experiment(same, indistinguishable, diagnosed.search.records, diagnosed.search.settings),
        point.code(candidate.block, effect.block),
        estimate.sizes(candidate),
    )


def _share_removed(losses: Sequence[float], k: int, noise_variance: float) -> float:
    """The share of the base's excess that effect ``k`` removes, by the losses of the base and after each effect."""
    return (losses[k] - losses[k + 1]) / max(losses[0] - noise_variance, 1e-12)


def _with_effects(diagnosed: DiagnosedPart, k: int, whole_diagram: Diagram) -> Diagram:
    """The whole diagram with the first ``k`` effects in place."""
    result = whole_diagram
    for one in diagnosed.named[:k]:
        c = one.candidate
        result = in_whole_diagram(c.point, diagnosed.part).put(result, c.block, c.effect.block)
    return result


def _has_several_experiments(diagnosed: DiagnosedPart) -> bool:
    """Whether there is more than one experiment, so that whole ones can be held out."""
    return len({experiment_of(t.name) for t in diagnosed.models[0].setup.experiments}) > 1


def _gap(diagnosed: DiagnosedPart, i: int, held: Sequence[np.ndarray]) -> Gap:
    """The error of one output before and after each effect, fitted and held out."""
    base = diagnosed.models[0]
    name = base.setup.outputs[i]
    sigma, groups = diagnosed.floors.sigma[name], rows_of_experiments(base, i)
    rows = np.concatenate(list(groups.values()))

    def rms(r: np.ndarray, some: np.ndarray) -> float:
        return sigma * float(np.sqrt(np.mean(r[some] ** 2)))

    given = diagnosed.floors.given.get(name, "")
    if given:
        more = ", and noise of the inputs" if diagnosed.search.noise_variance > 1 + INPUT_NOISE_THRESHOLD else ""
        given = f"{given} given{more}"
    return Gap(
        name,
        base.diagram.unit(name),
        sigma * float(np.sqrt(diagnosed.search.noise_variance)),
        diagnosed.floors.method[name],
        tuple(rms(m.r, rows) for m in diagnosed.models),
        tuple(rms(r, rows) for r in held),
        {key: tuple(rms(r, some) for r in held) for key, some in groups.items()},
        given,
    )


def _ranking(diagnosed: DiagnosedPart) -> tuple[RankedCandidate, ...]:
    """Every candidate of every accepted round, and of the one after."""
    result: list[RankedCandidate] = []
    for number, one in enumerate((r.most_complete for r in diagnosed.rounds[: diagnosed.count + 1]), 1):
        fitted = {tried.candidate.key for tried in one.verdict.ranking}
        result += [
            _fitted_row(diagnosed, number, one, tried, float(t))
            for tried, t in zip(one.verdict.ranking, one.verdict.t, strict=True)
        ]
        result += [
            _row(diagnosed, number, one, score.candidate, score.gain / len(one.base.r))
            for score in one.screening_scores
            if score.candidate.key not in fitted
        ]
    return tuple(result)


def _fitted_row(
    diagnosed: DiagnosedPart, number: int, searched: SearchRound, one: FittedCandidate, t: float
) -> RankedCandidate:
    """A candidate that was fitted."""
    verdict, blocks, block = searched.verdict, diagnosed.blocks, one.candidate.block
    items = {
        item.name.removeprefix(f"{block}."): item
        for item in one.model.problem.unknowns.items
        if item.parameter in one.candidate.free
    }
    added = verdict.named is not None and number <= diagnosed.count
    across = mean_loss(searched.experiment_losses, blocks)
    several = _has_several_experiments(diagnosed)
    removed = across - mean_loss(one.experiment_losses, blocks) if several else float("nan")
    return attrs.evolve(
        _row(diagnosed, number, searched, one.candidate, mean_loss(searched.losses, blocks) - one.loss),
        across=removed,
        new=removed / _excess(across, diagnosed.noise_variance),
        t=t,
        in_set=added and one in verdict.indistinguishable,
        named=added and one is verdict.named,
        fitted=True,
        at_bound=one.at_bounds,
        parameters={name: one.model.values[item.name] for name, item in items.items()},
        units={name: item.unit for name, item in items.items()},
    )


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
        gain / _excess(mean_loss(searched.losses, diagnosed.blocks), diagnosed.noise_variance),
        line=searched.verdict.critical_value,
    )


def _excess(loss: float, noise_variance: float) -> float:
    """The loss of a base above the noise; of a base at the noise floor the least excess, so that shares are finite."""
    return max(loss - noise_variance, MIN_VARIANCE_REDUCTION * noise_variance)


def _limits(diagnosed: DiagnosedPart) -> tuple[DetectionLimit, ...]:
    """For each effect the smallest size detectable in these experiments, given the residual of the last model."""
    found: dict[str, DetectionLimit] = {}
    last = diagnosed.rounds[diagnosed.count]
    scores = last.screening_scores or diagnosed.rounds[0].screening_scores
    by_noise, noise = critical_gains(scores), diagnosed.noise_variance
    excess = max(diagnosed.losses[-1] - noise, 0.0)  # an effect has to remove its share of this as well
    material = max(MIN_VARIANCE_REDUCTION * noise, excess * MIN_EXCESS_SHARE / (1 - MIN_EXCESS_SHARE))
    for p in scores:
        detectable = max(material * len(last.base.r), by_noise[p])
        effect, limit = p.candidate.effect, p.detection_limit(detectable)
        parameter = next(iter(p.candidate.trials.strengths), effect.free[0])
        unit = next((i.unit for i in p.problem.unknowns.items if i.parameter == f"{p.candidate.block}.{parameter}"), "")
        old = found.get(effect.name)
        if old is None or (old.value is None and limit is not None):
            size = ("", 0.0, "") if limit is None else detectable_size(p.candidate, parameter, limit)
            found[effect.name] = DetectionLimit(effect.name, parameter, limit, unit, effect.excites, *size)
    for one in diagnosed.search.effects:
        found.setdefault(one.name, DetectionLimit(one.name, one.free[0], None, "", one.excites))
    order: dict[str, int] = {}
    for k, one in enumerate(diagnosed.search.effects):
        if isinstance(one, Effect) or one.name not in order:
            order[one.name] = k
    return tuple(sorted(found.values(), key=lambda m: order[m.name]))


def _coordinates(model: Model, part: Part) -> dict[str, np.ndarray]:
    """Coordinates of the motion at every residual: of the first input, or of the output where there is none."""
    experiments, inputs = model.setup.experiments, list(part.diagram.inputs)
    number = {name: k for k, name in enumerate(dict.fromkeys(experiment_of(t.name) for t in experiments))}
    result: dict[str, list[np.ndarray]] = {}
    for experiment in experiments:
        x = _drive(experiment, model, inputs[0]) if inputs else experiment.measured[:, 0]
        for name, values in coordinates(experiment.t, x, number[experiment_of(experiment.name)]).items():
            result.setdefault(name, []).extend([values] * experiment.measured.shape[1])
    return {name: np.concatenate(values) for name, values in result.items()}


def _drive(experiment: Experiment, model: Model, name: str) -> np.ndarray:
    """An input at the compared instants, in the unit of the diagram."""
    return np.interp(experiment.t, experiment.record.t, experiment.record.values(name, model.diagram.unit(name)))


def _traces(diagnosed: DiagnosedPart) -> tuple[Trace, ...]:
    """Measured and simulated signals for figures."""
    base, final, inputs = diagnosed.models[0], diagnosed.models[-1], list(diagnosed.part.diagram.inputs)
    outputs, result, segments = list(enumerate(base.setup.outputs)), list[Trace](), iter(base.problem.segments)
    for experiment, (i, name) in itertools.product(base.setup.experiments, outputs):
        rows, sigma, measured = next(segments), diagnosed.floors.sigma[name], experiment.measured[:, i]
        trace = Trace(
            experiment.name,
            name,
            base.diagram.unit(name),
            experiment.t,
            measured,
            measured + sigma * base.r[rows],
            measured + sigma * final.r[rows],
            _drive(experiment, base, inputs[0]) if inputs else np.empty(0),
            inputs[0] if inputs else "",
            _blocks(base.r[rows], diagnosed.blocks.block[rows], experiment.t),
        )
        result.append(trace)
    return tuple(result)


def _blocks(r: np.ndarray, block: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Start, stop [s] and mean square of each block of an experiment, shape (blocks, 3)."""
    groups = np.split(np.arange(len(r)), np.flatnonzero(np.diff(block)) + 1)
    return np.array([[t[g[0]], t[g[-1]], np.mean(r[g] ** 2)] for g in groups])
