"""Discrimination: the experiment that separates indistinguishable effects, by the predictions of the fitted models.

Source: T-optimality, Atkinson and Fedorov, Biometrika 62 (1975), 57-70, doi 10.1093/biomet/62.1.57.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import attrs
import numpy as np

from tsmblocks.common.rounding import to_digits
from tsmblocks.data import Record
from tsmblocks.diagnosis.critical_gains import is_of_time
from tsmblocks.diagnosis.cross_validation import projected_jacobian, without_initial_states
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.model import Model, ModelSettings, pose_extended
from tsmblocks.diagnosis.partition import PIECE_SEPARATOR, split_into_pieces
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.effects import Span, span_of
from tsmblocks.fitting.parameter_vector import Unknowns
from tsmblocks.fitting.recordings import as_recorded

EXPERIMENT_SAMPLES = 2500
"""Samples of a proposed experiment, at the sampling step of the recordings. Chosen: as in the paper."""
MIN_SAMPLES_PER_PERIOD = 20
"""Samples of the fastest oscillation proposed, at least. Chosen: the simulation is accurate there."""
SMALL_AMPLITUDE = 0.1
"""Amplitude of a small motion, as a share of half the range. Chosen."""
MIN_SEPARATION = math.sqrt(MIN_VARIANCE_REDUCTION)
"""Rms difference of two predictions [rms noise] from which an experiment is proposed. Derived: an effect whose variance
is smaller is not named."""
MAX_SPEED_RATIO = 1.02
"""Highest speed of a proposed motion over that of the recordings. Chosen: rounding only."""


class Motion(NamedTuple):
    """A motion of the first input: ``values`` (SAMPLES,) in its unit."""

    words: str
    values: np.ndarray


class Separation(NamedTuple):
    """The rms difference [rms noise] between the predictions of two fitted models in an experiment.

    The other model is refitted to the present recordings and the predicted one together, so what it can reproduce is no
    difference.
    """

    words: str
    size: float


def separating_experiment(
    named: FittedCandidate, others: Sequence[FittedCandidate], records: Mapping[str, Record], settings: ModelSettings
) -> str:
    """The motion, no larger and faster than those recorded, that best separates ``named`` from ``others``, as text.

    That of the effect itself where no such motion separates them, or the diagram has no input.
    """
    own = named.candidate.effect
    rivals = [one for one in others if one.candidate.effect.name != own.name]
    if not rivals:
        return ""
    if own.separates and any(is_of_time(one.candidate) for one in (named, *rivals)) and _is_shorter(records):
        return own.separates
    best = max(separations(named, rivals, records, settings), key=lambda one: one.size, default=None)
    if best is None:
        return own.separates
    if settings.whitening:  # beside noise of the inputs the number is not known
        return best.words if best.size >= MIN_SEPARATION else own.separates
    if not best.size >= MIN_SEPARATION:
        return (
            f"{own.separates}; with a larger range or a higher speed than recorded, since no motion that was tried "
            f"within these separates them (expected difference {to_digits(best.size)} times the noise; "
            f"{to_digits(MIN_SEPARATION)} is needed)"
        )
    enough = f", rms; {to_digits(MIN_SEPARATION)} is enough" if best.size < 1 else ""  # of thousands of samples
    return f"{best.words} (expected difference {to_digits(best.size)} times the noise{enough})"


def _is_shorter(records: Mapping[str, Record]) -> bool:
    """Whether a proposed experiment is shorter than the recordings, in which an effect of time takes longer to show."""
    return any(len(one.t) > EXPERIMENT_SAMPLES for one in records.values())


def separations(
    named: FittedCandidate, others: Sequence[FittedCandidate], records: Mapping[str, Record], settings: ModelSettings
) -> Iterator[Separation]:
    """For each motion the separation from the closest of ``others``."""
    inputs, experiment = list(named.model.diagram.inputs), named.model.setup.experiments[0]
    if not inputs:
        return
    settings = attrs.evolve(settings, window=None, whitening={})  # all of a motion is compared
    # sampled blocks keep their sampling instants
    step = experiment.times.h * max(round(experiment.record.step / experiment.times.h), 1)
    unit = as_recorded(named.model.diagram, inputs[0], records.values())
    span = span_of([r.values(inputs[0], unit) for r in records.values()], [r.step for r in records.values()])
    piece = max(float(r.t[-1] - r.t[0]) for r in records.values())
    cut = any(PIECE_SEPARATOR in name for name in records)
    rivals = [(one.model, fisher_information(one.model)) for one in others]
    for motion in candidate_motions(span, step, unit):
        record = _record(motion, step, named.model, records)
        template = split_into_pieces({"proposed": record}, length=piece)[0] if cut else {"proposed": record}
        predicted = _predicted(named.model, template, settings)
        if predicted is not None:
            yield Separation(motion.words, min(separation(*one, predicted, settings) for one in rivals))


def fisher_information(model: Model) -> np.ndarray:
    """Fisher information (m, m) of the recordings on a model's parameters that are not at bounds."""
    known = projected_jacobian(model)[:, ~model.at_bound[~model.is_local]]
    return known.T @ known


def separation(model: Model, known: np.ndarray, predicted: Mapping[str, Record], settings: ModelSettings) -> float:
    r"""Residual rms [rms noise] of a model refitted to the prediction of another one.

    To first order: :math:`\min_\theta \lVert r + J \theta\rVert^2 + \theta^T H \theta`, where :math:`H` (``known``)
    is the Fisher information of the present recordings, and initial states are free.
    """
    problem, setup = pose_extended(model, model.fitted_diagram, (), predicted, settings)
    r, J = problem.jacobian(_initial_unknowns(model, problem.unknowns))
    new = Model(setup.diagram, problem, setup, problem.unknowns.start, r, J.with_finite_values())
    with np.errstate(all="ignore"):
        own = projected_jacobian(new)[:, ~model.at_bound[~model.is_local]]
        residual = without_initial_states(new, r[:, None])[:, 0]
        H = known + own.T @ own
        ridge = 1e-12 * np.diag(np.maximum(np.diag(H), 1e-300))
        slope = own.T @ residual
        square = float(residual @ residual - slope @ np.linalg.solve(H + ridge, slope))
    return math.sqrt(max(square, 0.0) / len(r)) if math.isfinite(square) else 0.0  # it diverges: nothing is known


def _predicted(model: Model, template: Mapping[str, Record], settings: ModelSettings) -> dict[str, Record] | None:
    """Recordings as the model predicts them; None where it diverges."""
    problem, _ = pose_extended(model, model.fitted_diagram, (), template, settings)
    theta, result = _initial_unknowns(model, problem.unknowns), {}
    for (name, record), sets in zip(template.items(), problem.output_sets(theta[None]), strict=True):
        y = sets[:, :, 0]
        if not np.isfinite(y).all():
            return None
        for i, output in enumerate(settings.outputs):
            record = record.with_signal(output, y[:, i], model.diagram.unit(output))
        result[name] = record
    return result


def _initial_unknowns(model: Model, unknowns: Unknowns) -> np.ndarray:
    """The unknowns of a new experiment: a model's parameters, and the medians of its initial states."""
    names = np.array([item.parameter for item in model.problem.unknowns.items])
    return np.array([np.median(model.theta[names == item.parameter]) for item in unknowns.items])


def _record(motion: Motion, step: float, model: Model, records: Mapping[str, Record]) -> Record:
    """A recording in which the first input moves, the others rest, and the outputs are zero."""
    first, *others = model.diagram.inputs
    signals = {first: motion.values}
    for name in others:
        rest = np.concatenate([r.values(name, model.diagram.unit(name)) for r in records.values()])
        signals[name] = np.full(EXPERIMENT_SAMPLES, float(np.median(rest)))
    signals |= {name: np.zeros(EXPERIMENT_SAMPLES) for name in model.setup.outputs}
    units = {name: model.diagram.unit(name) for name in signals}
    start = min(float(r.t[0]) for r in records.values())  # effects of time are as in the recordings
    return Record("proposed", start + np.arange(EXPERIMENT_SAMPLES) * step, signals, units)


# ---- motions --------------------------------------------------------------------------------------


def candidate_motions(span: Span, step: float, unit: str) -> list[Motion]:
    """Motions over the range of a signal at no more than its speed, with a text that describes each."""
    motions = _motions(np.arange(EXPERIMENT_SAMPLES) * step, span, unit)
    return [one for one in motions if np.max(np.abs(np.diff(one.values))) <= MAX_SPEED_RATIO * span.fastest * step]


def _motions(t: np.ndarray, span: Span, unit: str) -> list[Motion]:
    """Every motion considered, over the whole range."""
    long, reach, middle, small = float(t[-1]), span.reach, span.middle, SMALL_AMPLITUDE * span.reach
    lasts, slow = f"{to_digits(long)} s", 4 / long
    top, quick = (_frequency(amplitude, span, t) for amplitude in (reach, small))
    size = np.where(t < long / 2, 1.0, 0.2)
    return [
        Motion(f"a slow ramp over the whole range and back, {lasts}", middle + reach * _triangle(t / long)),
        Motion(
            f"a sine over the whole range at {to_digits(top)} Hz, {lasts}", middle + reach * np.sin(2 * np.pi * top * t)
        ),
        Motion(
            f"a sine at {to_digits(slow)} Hz over the whole range, then over a fifth of it, {lasts}",
            middle + reach * size * np.sin(2 * np.pi * slow * t),
        ),
        Motion(
            f"a triangle that decays from the whole range to zero in 8 periods, {lasts}",
            middle + reach * (1 - t / long) * _triangle(8 * t / long),
        ),
        Motion(
            f"a chirp of {in_display_units(small, unit)} from {to_digits(slow)} to {to_digits(quick)} Hz, {lasts}",
            middle + small * _chirp(t, slow, quick),
        ),
        Motion(
            f"a chirp over the whole range from {to_digits(slow / 4)} to {to_digits(top)} Hz, {lasts}",
            middle + reach * _chirp(t, slow / 4, top),
        ),
        Motion(
            f"a staircase over the whole range with a reversal of a tenth of it on each of 8 steps, {lasts}",
            middle + reach * _staircase(t / long, 8, SMALL_AMPLITUDE),
        ),
        Motion(
            f"steps over the whole range, each held for {to_digits(long / 6)} s, {lasts} in all",
            middle + reach * _holds(t, long, 2 * reach / (0.9 * span.fastest)),
        ),
    ]


def _frequency(amplitude: float, span: Span, t: np.ndarray) -> float:
    """The highest frequency [Hz] of a sine at the recorded speed that is still well sampled."""
    limits = (span.fastest / (2 * np.pi * max(amplitude, 1e-300)), 1 / (MIN_SAMPLES_PER_PERIOD * float(t[1] - t[0])))
    return float(f"{0.98 * min(limits):.2g}")


def _triangle(phase: np.ndarray) -> np.ndarray:
    """Triangle wave with amplitude 1 that starts at 0; ``phase`` in periods."""
    return 2 / np.pi * np.arcsin(np.sin(2 * np.pi * phase))


def _chirp(t: np.ndarray, low: float, high: float) -> np.ndarray:
    """Sine with an exponentially growing frequency."""
    rate = math.log(max(high / low, 1 + 1e-9)) / float(t[-1])
    return np.sin(2 * np.pi * low * np.expm1(rate * t) / rate)


def _staircase(share: np.ndarray, steps: int, back: float) -> np.ndarray:
    """Staircase up and down with a small reversal on each step; ``share`` runs from 0 to 1."""
    up = np.linspace(-1, 1, steps // 2 + 1)
    levels = np.concatenate([up, up[-2::-1]])[:, None]
    parts, moves = np.array([[0.0, 0.25, 0.4, 0.55, 0.7], [0.0, 0.0, -2 * back, 0.0, 0.0]])
    places = (np.arange(len(levels))[:, None] + parts) / len(levels)
    return np.interp(share, places.ravel(), (levels + moves * np.where(levels >= 0, 1, -1)).ravel())


def _holds(t: np.ndarray, long: float, takes: float) -> np.ndarray:
    """Steps up, down and half way, each held; a change over the whole range takes ``takes`` [s]."""
    places, values, now = [0.0], [0.0], 0.0
    for k, level in enumerate((1.0, -1.0, 0.5, -0.5, 1.0, 0.0)):
        start = k * long / 6
        places += [start + 1e-9 * long, start + takes * abs(level - now) / 2 + 2e-9 * long]
        values += [now, level]
        now = level
    return np.interp(t, places, values)
