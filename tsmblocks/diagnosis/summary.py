"""From search rounds to the result of a segment: effects with intervals, errors, ranking, detection limits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate, with_scales_in
from tsmblocks.diagnosis.cross_validation import held_out_residuals
from tsmblocks.diagnosis.decision import mean_loss, ridge_weights, shrinkage_of
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.discrimination import separating_experiment
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.limits import detection_limits
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.outliers import reported_share
from tsmblocks.diagnosis.partition import Part, experiment_of, in_whole_diagram, rows_of_experiments
from tsmblocks.diagnosis.quantities import Estimate, recorded_units
from tsmblocks.diagnosis.ranking import ranking
from tsmblocks.diagnosis.refinement import as_fit
from tsmblocks.diagnosis.rejection import alternatives_to, why_named
from tsmblocks.diagnosis.residual_location import coordinates, explainable_share, residual_coordinates
from tsmblocks.diagnosis.segment import Gap, InputNoiseRms, NamedEffect, Segment, Trace
from tsmblocks.diagnosis.settings import FloorParts
from tsmblocks.diagnosis.time_and_distance import second_frequency
from tsmblocks.diagnosis.verdict_text import verdict_sentence
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.model.diagram import Diagram

NOISE_OF_INPUTS = ", and noise of the inputs"
"""What is added where noise of measured inputs is a part of the noise floor."""
INPUT_NOISE_THRESHOLD = 1e-3
"""Variance caused by input noise [output noise variances] from which it is reported. Chosen: below three digits."""
MOST_OF_EXCESS = 0.5
"""Share of the mean square above the outputs' noise that noise of inputs has to cause to be reported. Chosen."""


def segment_summary(diagnosed: DiagnosedPart, whole_diagram: Diagram) -> Segment:
    """The result of a segment."""
    noise_variance, blocks, base = diagnosed.noise_variance, diagnosed.blocks, diagnosed.models[0]
    losses = diagnosed.losses
    excess = losses[0] / noise_variance - 1
    known = _coordinates(base, diagnosed.part)
    drive = next(((name, base.diagram.unit(name)) for name in diagnosed.part.diagram.inputs), ("", ""))
    excess_variance = max(base.mean_square - noise_variance, 0.0)
    ceiling = explainable_share(base.r, known, blocks, excess_variance)
    remains = diagnosed.leaves_predictable or diagnosed.is_irregular
    verdict = "named" if diagnosed.count else "unknown" if remains else "none"
    whitened = _held_out(diagnosed)
    held = [one.problem.restored(r) for one, r in zip(diagnosed.models, whitened, strict=True)]
    tied = verdict == "named" or diagnosed.leaves_predictable  # else a coordinate follows the residual by chance
    result = Segment(
        diagnosed.part.name,
        tuple(diagnosed.part.diagram.inputs),
        diagnosed.part.outputs,
        verdict,
        float(excess),
        {k: diagnosed.with_input_noise(k, diagnosed.search.noise_variance) for k in diagnosed.floors.sigma},
        _effects(diagnosed, losses, whole_diagram),
        tuple(_gap(diagnosed, i, held, whitened) for i in range(len(base.setup.outputs))),
        residual_coordinates(base.r, known, blocks, excess_variance, drive) if tied else (),
        ranking(diagnosed),
        detection_limits(diagnosed),
        _traces(diagnosed),
        ceiling,
        "",
        as_fit(diagnosed.final, base, diagnosed.corners),
        complete=not (remains or diagnosed.leaves_unexamined),
        irregular=diagnosed.is_irregular,
        stopped=diagnosed.leaves_unexamined,
        varies_with=diagnosed.varying.words if diagnosed.varying is not None and diagnosed.varies else "",
        predictable=_predictable(diagnosed),
        largest_noise={k: diagnosed.with_input_noise(k, diagnosed.largest_noise) for k in diagnosed.floors.sigma},
        filtered=tuple(name for name, rms in diagnosed.search.input_noise.items() if rms > 0),
        noise_of_inputs=_noise_of_inputs(diagnosed),
        in_doubt=diagnosed.in_doubt,
        delays_if_held=diagnosed.delays_if_held,
    )
    return attrs.evolve(result, sentence=verdict_sentence(result))


def _predictable(diagnosed: DiagnosedPart) -> tuple[float, float]:
    """Shares of the residual of the base, and of the last model, that are predicted."""
    before, after = (max(one.share, diagnosed.rejected_share, 0.0) for one in (diagnosed.predicted, diagnosed.left))
    return before, after


def _noise_of_inputs(diagnosed: DiagnosedPart) -> tuple[InputNoiseRms, ...]:
    """The noise of inputs that may cause what the last model leaves, in the units of the recordings."""
    beside = diagnosed.beside_inputs
    if beside is None or not diagnosed.may_be_noise_of_inputs:
        return ()
    whole = float(np.mean(diagnosed.final.differences**2))
    if whole - beside.square < MOST_OF_EXCESS * (whole - 1):  # the most likely noise causes next to nothing of it
        return ()
    records = list(diagnosed.search.records.values())
    spreads = {k: max(float(np.std(one[k])) for one in records if k in one) for k in beside.noise}
    units = {k: next(one.unit(k) for one in records if k in one) for k in beside.noise}
    return tuple(InputNoiseRms(k, share * spreads[k], units[k], share) for k, share in beside.noise.items())


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
    final = with_scales_in(diagnosed.models[-1], [one.candidate for one in diagnosed.named])
    return tuple(_named(diagnosed, k, one, losses, whole_diagram, estimate) for k, one in enumerate(final))


def _named(
    diagnosed: DiagnosedPart,
    k: int,
    candidate: Candidate,
    losses: Sequence[float],
    whole_diagram: Diagram,
    estimate: Estimate,
) -> NamedEffect:
    """Effect ``k``, with its parameters and sizes in the final model, in which ``candidate`` has its scales."""
    indistinguishable = diagnosed.rounds[k].indistinguishable
    effect, point = candidate.effect, in_whole_diagram(candidate.point, diagnosed.part)
    across = None
    if diagnosed.has_several_experiments and not effect.local:
        whole_losses = [mean_loss(one.experiment_losses, diagnosed.blocks) for one in diagnosed.rounds]
        as_named = mean_loss(diagnosed.named[k].experiment_losses, diagnosed.blocks)
        # Held-out losses are of first order: those of the effect as it was named, or as it was refitted, may be off.
        whole_losses[k + 1] = min(whole_losses[k + 1], as_named)
        across = min(_share_removed(whole_losses, k, diagnosed.noise_variance), 1.0)
    others = alternatives_to(diagnosed.named[k], indistinguishable)
    also = dict.fromkeys(one.candidate.effect.name for one in others)
    before = _with_effects(diagnosed, k, whole_diagram)
    elsewhere, forms = _places_and_forms(diagnosed, k, others, before)
    reference = estimate.reference(candidate)
    sizes = estimate.sizes(candidate, reference)
    # Beside the others its more general form may come first; the experiment is for the effect that was named.
    same = next((one for one in indistinguishable if one.candidate.effect.name == effect.name), diagnosed.named[k])
    return NamedEffect(
        effect.name,
        effect.family,
        candidate.words,
        diagnosed.part.name,
        point.words(before),
        candidate.block,
        estimate.parameters(candidate),
        float(np.clip(_share_removed(losses, k, diagnosed.noise_variance), 0.0, 1.0)),
        across,
        tuple(name for name in also if name != effect.name),
        second_frequency(effect.name, also, diagnosed.search.only_frequency)
        or separating_experiment(same, indistinguishable, diagnosed.search.records, diagnosed.search.settings),
        point.code(candidate.block, effect.block),
        sizes,
        elsewhere,
        forms,
        why_named(same, [one for one in others if one is not same]),
        estimate.forces(candidate, sizes),
        estimate.absent_in(candidate, sizes),
        reference,
    )


def _places_and_forms(
    diagnosed: DiagnosedPart, k: int, others: Sequence[FittedCandidate], before: Diagram
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The other places at which effect ``k`` explains as much, as wires of the diagram ``before`` it, and its other
    forms that do, as names of variants. One of another form is no other place.
    """
    named, name = diagnosed.named[k].candidate, diagnosed.named[k].candidate.effect.name
    alike = [one.candidate for one in diagnosed.rounds[k].indistinguishable if one.candidate.effect.name == name]
    at_places = [one for one in alike if one.effect.block == named.effect.block]
    points = [in_whole_diagram(one.point, diagnosed.part) for one in (named, *at_places)]
    _, *elsewhere = dict.fromkeys(one.words(before) for one in points if one is points[0] or one.is_in(before))
    also = [one.candidate for one in others if one.candidate.effect.name == name]
    forms = [one.effect.variant for one in also if one.key[2] == named.key[2] or one not in at_places]
    return tuple(elsewhere), tuple(dict.fromkeys(one for one in forms if one != named.effect.variant))


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


def _gap(diagnosed: DiagnosedPart, i: int, held: Sequence[np.ndarray], whitened: Sequence[np.ndarray]) -> Gap:
    """The error of one output before and after each effect, fitted and held out.

    ``held`` (N,) are the held-out differences with each model, ``whitened`` the residuals of these.
    """
    base = diagnosed.models[0]
    name = base.setup.outputs[i]
    sigma, groups = diagnosed.floors.sigma[name], rows_of_experiments(base, i)
    rows = np.concatenate(list(groups.values()))

    def rms(r: np.ndarray, some: np.ndarray) -> float:
        return sigma * float(np.sqrt(np.mean(r[some] ** 2)))

    given = diagnosed.floors.given.get(name, "")
    if given:
        more = (
            NOISE_OF_INPUTS
            if not diagnosed.correlated_noise and diagnosed.from_inputs(name) > INPUT_NOISE_THRESHOLD
            else ""
        )
        given = f"{given} given{more}"
    return Gap(
        name,
        recorded_units(base.setup)[name],
        diagnosed.with_input_noise(name, diagnosed.search.noise_variance),
        diagnosed.floors.method[name],
        tuple(rms(m.differences, rows) for m in diagnosed.models),
        tuple(rms(r, rows) for r in held),
        {key: tuple(rms(r, some) for r in held) for key, some in groups.items()},
        given,
        _floor_parts(diagnosed, name),
        reported_share(diagnosed.models[-1], i),
        tuple(rms(r, rows) for r in whitened) if diagnosed.correlated_noise else (),
        diagnosed.sensor_noise(name),
    )


def _floor_parts(diagnosed: DiagnosedPart, name: str) -> FloorParts | None:
    """What the noise floor of an output consists of; None where it was given."""
    floors, share = diagnosed.floors, diagnosed.from_inputs(name)
    if name in floors.given or name not in floors.low:
        return None
    sigma = floors.sigma[name]
    from_inputs = sigma * float(np.sqrt(share)) if share > INPUT_NOISE_THRESHOLD else 0.0
    return FloorParts(sigma, floors.low[name], floors.high[name], from_inputs, floors.recordings.get(name, {}))


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
    units, before, after = recorded_units(base.setup), base.differences, final.differences
    for experiment, (i, name) in itertools.product(base.setup.experiments, outputs):
        rows, sigma, measured = next(segments), diagnosed.floors.sigma[name], experiment.measured[:, i]
        trace = Trace(
            experiment.name,
            name,
            units[name],
            experiment.t,
            measured,
            measured + sigma * before[rows],
            measured + sigma * after[rows],
            _drive(experiment, base, inputs[0]) if inputs else np.empty(0),
            inputs[0] if inputs else "",
            _blocks(before[rows], diagnosed.blocks.block[rows], experiment.t),
            units[inputs[0]] if inputs else "",
        )
        result.append(trace)
    return tuple(result)


def _blocks(r: np.ndarray, block: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Start, stop [s] and mean square of each block of an experiment, shape (blocks, 3)."""
    groups = np.split(np.arange(len(r)), np.flatnonzero(np.diff(block)) + 1)
    return np.array([[t[g[0]], t[g[-1]], np.mean(r[g] ** 2)] for g in groups])
