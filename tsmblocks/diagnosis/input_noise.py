"""Noise of measured inputs: what it adds to the outputs, and how residuals are weighted beside it.

Where a plant integrates its input, as an axis driven by a measured force, noise of the input is most of the residual: a
random walk, common to all outputs. An effect that is fitted to it explains a part of it, though the model is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import attrs
import numpy as np

from tsmblocks.common.interpolation import is_held
from tsmblocks.common.interrupt import checkpoint
from tsmblocks.data import Record
from tsmblocks.data.conditioning import conditioned
from tsmblocks.data.fast_noise import sample_to_sample_noise
from tsmblocks.data.filters import MIN_FILTERED_SAMPLES, smoothed, white_noise_power
from tsmblocks.data.resampling import evenly_sampled
from tsmblocks.diagnosis.input_spectrum import Errors, ErrorsByInput
from tsmblocks.diagnosis.model import FINE_TOLERANCE, Model, nearest, optimized, whitened_problem
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.whitening import Whitening
from tsmblocks.model.diagram import Diagram

MIN_PROPAGATED = 0.1
"""Variance that noise of the inputs adds to the outputs [output noise variances] from which residuals are whitened.
Chosen: an effect that is named removes 6 % of the noise at least."""
MOST_NODES = 5000
"""Instants of all experiments and inputs together at which errors of inputs are independent, at most. Chosen: for the
run time; each takes a simulation of its experiment."""
MOST_VALUES = 20_000_000
"""Values of the changes of the outputs by these errors, at most, unless recordings are very long. Chosen: 160 MB."""
FEW_NODES = 600
"""The same where the spectrum of the noise is estimated. Chosen: for the run time."""
FEWEST_NODES = 16
"""Such instants of each input of an experiment, at least. Chosen: an integrating plant answers to the slowest errors
most."""
BAND = (2.0, 4.0)
"""Frequencies over the cut-off of a filter at which the noise of an input is seen. Chosen: the motion is below them,
and the noise not far from where the filter leaves it."""
FEWEST_FREQUENCIES = 64
"""Frequencies in that band, at least; with fewer the noise is taken to be white. Derived: their median is then known to
a fifth."""
MAX_UNFILTERED = 0.02
"""Noise from sample to sample over the deviation of an input that is not filtered, up to which it is noise. Chosen: a
command with a new value at each sample differs by more."""
FACTORS = tuple(2.0 ** (k / 2) for k in range(5))
"""Factors on the noise that is seen above the cut-off of a filter. Chosen: noise that falls with the frequency is
stronger below it. The residuals of the base tell by how much; where an effect is missing they tell too much, and small
effects on the input are missed beside it."""


@attrs.frozen
class NoiseOfInput:
    """Noise of an input, above whose ``cutoff`` [Hz] a filter has removed it; None where it is all there.

    ``rms`` is that of white noise as strong as the noise above its motion, in the unit of the recording.
    """

    rms: float
    cutoff: float | None = None


NoiseByInput = Mapping[str, Mapping[str, NoiseOfInput]]
"""The noise of inputs by recording and input."""


@attrs.frozen
class InputNoise:
    """What noise of the inputs adds to the outputs, beside which residuals are whitened where it is much.

    ``propagated`` is the mean square [output noise variances] that it adds, and ``left`` the part of it that the
    whitening does not account for. ``whitening`` is by experiment; it is empty where little is added.
    """

    propagated: float
    left: float
    whitening: Mapping[str, Whitening] = attrs.field(factory=dict)

    def whitened_base(self, base: Model) -> Model:
        """A base optimised on with residuals that are whitened."""
        problem = whitened_problem(base.problem, base.setup, self.whitening)
        return nearest(optimized(problem, base.setup, base.theta, FINE_TOLERANCE))

    def scaled_to(self, base: Model) -> InputNoise:
        """The noise as many times as large as is most likely by the residuals of a base, of ``FACTORS``."""
        factor = _likeliest(base, FACTORS)
        whitening = {name: one.scaled(factor) for name, one in self.whitening.items()}
        return InputNoise(factor**2 * self.propagated, factor**2 * self.left, whitening)


def input_noise(model: Model, noises: NoiseByInput, seed: int) -> InputNoise:
    """What noise of the inputs adds to the outputs of a base."""
    change = _change(model, noises, seed)
    propagated = float(np.mean(change**2))
    if propagated < MIN_PROPAGATED:
        return InputNoise(propagated, propagated)
    found = dict[str, Whitening]()
    most = min(MOST_NODES // len(model.setup.experiments), MOST_VALUES // model.problem.samples)
    for e, experiment in enumerate(model.setup.experiments):
        own = errors_of_inputs(model, e, noises.get(experiment_of(experiment.name), {}), most)
        causes = [one.causes for one in own.values()]
        if causes and (whitening := Whitening.of(np.concatenate(causes, axis=1))) is not None:
            found[experiment.name] = whitening
    expected = sum(float(np.sum(one.sizes**2 / (1 + one.sizes**2))) for one in found.values())
    left = float(np.sum(whitened_problem(model.problem, model.setup, found).whitened(change) ** 2)) - expected
    return InputNoise(propagated, max(left / len(change), 0.0), found)


def factor_beside(model: Model) -> float:
    """The share of the noise of inputs that is taken for possible which is most likely beside a model."""
    return _likeliest(model, [1 / k for k in FACTORS])


def correlated_noise(model: Model, factor: float) -> dict[str, float]:
    """Mean square by output [output noise variances] of the errors that are whitened; empty where none are.

    It is that of the residual, less what initial states take of it, with errors ``factor`` times as large; together
    with the noise of the outputs it is no more than the residual has.
    """
    outputs, problem = model.setup.outputs, model.problem
    if not problem.whitening:
        return {}
    blocks, totals = list(model.J.own_blocks()), np.zeros(len(outputs))
    for e, whitening in problem.whitening.items():
        columns = blocks[e].values
        spread, turn = whitening.restored(columns), np.linalg.pinv(columns.T @ columns)
        left = factor**2 * whitening.variances - np.einsum("ij,jk,ik->i", spread, turn, spread)
        totals += np.maximum(left.reshape(len(outputs), -1).sum(axis=1), 0.0)
    surplus = [max(rms**2 - 1, 0.0) for rms in model.residual_rms_beside({}).values()]
    return dict(zip(outputs, np.minimum(totals * len(outputs) / len(model.r), surplus).tolist(), strict=True))


def _likeliest(model: Model, factors: Iterable[float]) -> float:
    """The factor on the correlated errors of a model that is most likely by its residuals."""
    differences, rows = model.differences, model.problem.rows

    def deviance(factor: float) -> float:
        pairs = model.problem.whitening.items()
        return sum(one.scaled(factor).deviance(differences[rows[e]]) for e, one in pairs)

    return min(factors, key=deviance)


def noise_by_input(
    raw: Mapping[str, Record], inputs: Iterable[str], *, filtered: bool = True
) -> dict[str, dict[str, NoiseOfInput]]:
    """The noise of measured inputs, by recording and input; ``raw`` are whole recordings before it is ``filtered``."""
    names = tuple(inputs)
    even = {key: evenly_sampled(record) for key, record in raw.items()}
    found = {key: {name: _noise_of(one, name) for name in names if name in one} for key, one in even.items()}
    known = {key: {k: noise for k, noise in some.items() if noise is not None} for key, some in found.items()}
    if filtered:
        return known
    return {key: {k: attrs.evolve(noise, cutoff=None) for k, noise in some.items()} for key, some in known.items()}


def _noise_of(record: Record, name: str) -> NoiseOfInput | None:
    """The noise of an input of a recording; None where none is seen."""
    x, step = record[name], record.step
    if len(x) < MIN_FILTERED_SAMPLES or not np.ptp(x) > 0 or is_held(x):
        return None
    smooth, cutoff = smoothed(x, step)
    if cutoff is None:
        rms = sample_to_sample_noise(record.t, x).floor
        return NoiseOfInput(rms) if 0 < rms <= MAX_UNFILTERED * np.std(x) else None
    removed = x - smooth
    power = _power(removed)
    frequency = np.fft.rfftfreq(len(removed), step)
    near = power[(frequency >= BAND[0] * cutoff) & (frequency <= BAND[1] * cutoff)]
    variance = float(np.median(near)) / np.log(2.0) if len(near) >= FEWEST_FREQUENCIES else _white(power)
    return NoiseOfInput(float(np.sqrt(variance)), cutoff) if variance > 0 else None


def errors_of_noise(model: Model, noises: NoiseByInput) -> dict[int, ErrorsByInput]:
    """What errors of noisy inputs change in the outputs of a model, by number of the experiment."""
    experiments = model.setup.experiments
    most = min(FEW_NODES, MOST_VALUES // model.problem.samples) // len(experiments)
    found = {
        e: errors_of_inputs(model, e, noises.get(experiment_of(one.name), {}), most)
        for e, one in enumerate(experiments)
    }
    return {e: one for e, one in found.items() if one}


def errors_of_inputs(model: Model, e: int, noises: Mapping[str, NoiseOfInput], most: int) -> dict[str, Errors]:
    """Independent errors of the inputs of one experiment, each of one standard deviation, ``most`` in all.

    White noise below the cut-off of a filter is a sum of triangles, a quarter of its period apart.
    """
    experiment, found = model.setup.experiments[e], dict[str, Errors]()
    record, p = experiment.record, model.problem.unknowns.parameters(model.theta, e)
    clean = experiment.outputs(p)
    most = max(most // max(len(noises), 1), FEWEST_NODES)
    for name, one in noises.items():
        distance = max(0.25 / (one.cutoff * record.step) if one.cutoff else 1.0, len(record) / most, 1.0)
        columns = list[np.ndarray]()
        for middle in np.arange(0.0, len(record) - 1 + distance, distance):
            checkpoint()
            triangle = np.maximum(1 - np.abs(np.arange(len(record)) - middle) / distance, 0.0)
            error = one.rms / np.sqrt(distance) * triangle
            moved = attrs.evolve(record, signals={**record.signals, name: record[name] + error})
            columns.append(_weighted(model.setup.prepared(e, record=moved).outputs(p) - clean, model, experiment))
        share = one.rms**2 / max(float(np.var(record[name])), 1e-300)
        found[name] = Errors(np.stack(columns, axis=1), distance * record.step, share, record.step, one.cutoff)
    return found


def _weighted(change: np.ndarray, model: Model, experiment: Experiment) -> np.ndarray:
    """A change of the outputs (samples, outputs) as one of the residuals (rows,): 0 where nothing was measured."""
    counted = 1.0 if experiment.counted is None else experiment.counted
    weighted: np.ndarray = np.where(np.isfinite(change), change * counted, 0.0) * model.problem.weights
    return weighted.ravel(order="F")


def propagated_input_noise(model: Model, noises: NoiseByInput, seed: int) -> float:
    """Variance of the outputs caused by the noise of measured inputs [output noise variances]."""
    return float(np.mean(_change(model, noises, seed) ** 2))


def _change(model: Model, noises: NoiseByInput, seed: int) -> np.ndarray:
    """Change of the weighted outputs (N,) by a draw of the noise of measured inputs.

    The conditioned inputs are taken as the true motion. White noise is added to them, they are conditioned again where
    they were, and the model is simulated with both. One draw of the noise for each experiment is enough, since an
    experiment has many samples.
    """
    draw, result = np.random.default_rng(seed), np.zeros(model.problem.samples)
    for e, (experiment, rows) in enumerate(zip(model.setup.experiments, model.problem.rows, strict=True)):
        record, own = experiment.record, noises.get(experiment_of(experiment.name), {})
        if not own:
            continue
        noisy = {name: record[name] + one.rms * draw.standard_normal(len(record)) for name, one in own.items()}
        record = attrs.evolve(record, signals={**record.signals, **noisy})
        filtered = [name for name, one in own.items() if one.cutoff]
        other = model.setup.prepared(e, record=conditioned(record, filtered))
        p = model.problem.unknowns.parameters(model.theta, e)
        result[rows] = _weighted(other.outputs(p) - experiment.outputs(p), model, experiment)
    return result


def input_noise_rms(
    diagram: Diagram, clean: Mapping[str, Record], raw: Mapping[str, Record], inputs: Iterable[str]
) -> dict[str, float]:
    """Rms of the white noise that was filtered out of each input, in its unit in the diagram, the largest of all."""
    result = dict.fromkeys(inputs, 0.0)
    for name, record in clean.items():
        before = evenly_sampled(raw[name])
        for key in (k for k in result if k in record and len(before) == len(record)):
            unit = diagram.unit(key)
            removed = before.values(key, unit) - record.values(key, unit)
            result[key] = max(result[key], float(np.sqrt(_white(_power(removed)))))
    return result


def noise_left_in(diagram: Diagram, records: Mapping[str, Record], noises: NoiseByInput) -> dict[str, float]:
    """Rms noise of each input that no filter takes out of it, in its unit in the diagram, the largest of all."""
    result = dict[str, float]()
    for key, one in (pair for own in noises.values() for pair in own.items()):
        if one.cutoff is None:
            factor = next(record for record in records.values() if key in record).factor(key, diagram.unit(key))
            result[key] = max(result.get(key, 0.0), one.rms * factor)
    return result


def _power(removed: np.ndarray) -> np.ndarray:
    """Spectrum of what a filter removed, in which white noise of unit variance has the mean 1."""
    result: np.ndarray = np.abs(np.fft.rfft(removed - removed.mean())) ** 2 / len(removed)
    return result


def _white(power: np.ndarray) -> float:
    """Variance of white noise with a spectrum that a filter removed."""
    return white_noise_power(power, np.log(2.0))
