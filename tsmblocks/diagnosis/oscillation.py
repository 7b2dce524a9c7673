"""Oscillations that are no effect in addition: those that follow the motion, or another one in the model."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import experiment_of, rows_of_experiments
from tsmblocks.fitting.experiments import Experiment

MAX_HARMONIC = 8
"""Harmonics of the motion that are looked at. Chosen: higher ones of friction and gaps are below a hundredth."""
MIN_LINE_SHARE = 0.1
"""Share of an input's variance at one frequency from which that is a frequency of the motion. Chosen."""
LINE_RATIO, LEAST_LINE = 20.0, 1e-4
"""Share of an input's variance at one frequency, over those beside it, from which that is a line of the input, and such
a share at least. Chosen: noise exceeds it once in 10^8; less moves nothing that is seen."""
MOST_OF_GAIN = 0.5
"""Share of what an oscillation explains, in experiments with its frequency in their motion, from which it follows the
motion. Chosen: the larger part."""
FREQUENCIES = 41
"""Frequencies at which a line of the motion is looked for, over twice the resolution. Chosen: a twentieth of it."""

SAME_MOTION = 0.98
"""Correlation of each input in two experiments from which the motion is the same. Chosen: noise and a late start lower
it, and other motions of one kind have less."""
SAME_SIZE = 0.15
"""Difference of the amplitudes and phases of an oscillation in two experiments, as a share of it, up to which it is the
same. Derived: phases agree as well by chance in one case of twenty."""

PERIODS = ("frequency", "cycles")
"""Parameters that give the period of an oscillation, over the time or over a position."""


def is_oscillation(candidate: Candidate) -> bool:
    """Whether an effect is periodic; two of them with different periods are two effects."""
    return any(name in PERIODS for name in candidate.effect.free)


def follows_motion(model: Model, base: Model, candidate: Candidate) -> bool:
    """Whether the fitted frequency of an effect is a harmonic of a frequency of the motion, where it is needed.

    A model error that is a function of the motion has these frequencies. An oscillation of the time explains it as
    well as long as the motion keeps its phase, and not in another recording. What reduces the residual of the model
    ``base`` mostly in experiments whose motion has none of these frequencies does not follow the motion.
    """
    return _is_of_most(_is_harmonic, model, base, candidate)


def is_of_a_tone(model: Model, base: Model, candidate: Candidate) -> bool:
    """Whether the fitted frequency of an effect is that of a tone of an input, however small, as in a sum of sines.

    A disturbance would hardly have just that frequency: the model has an error there. Experiments count as in
    ``follows_motion``.
    """
    return _is_of_most(_is_tone, model, base, candidate)


def _is_of_most(
    is_in: Callable[[Sequence[Experiment], str, float], bool], model: Model, base: Model, candidate: Candidate
) -> bool:
    """Whether most of what an effect explains lies in experiments in whose motion its frequency is (``is_in``)."""
    own, names = _frequencies(model, candidate), model.diagram.inputs
    if not own:
        return False
    followed = [any(is_in(pieces, name, f) for f in own for name in names) for pieces in _pieces(model)]
    fall = base.differences**2 - model.differences**2
    rows = (rows_of_experiments(model, output).values() for output in range(len(model.setup.outputs)))
    gains = np.sum([[fall[own_rows].sum() for own_rows in of_output] for of_output in rows], axis=0)
    return bool(any(followed) and gains @ followed > MOST_OF_GAIN * gains.sum())


def _pieces(model: Model) -> list[list[Experiment]]:
    """The experiments, each in its pieces."""
    groups: dict[str, list[Experiment]] = {}
    for one in model.setup.experiments:
        groups.setdefault(experiment_of(one.name), []).append(one)
    return list(groups.values())


def _frequencies(model: Model, candidate: Candidate) -> list[float]:
    """The fitted frequencies [Hz] of an effect."""
    unknowns = zip(model.problem.unknowns.items, model.theta, strict=True)
    return [v for item, v in unknowns if item.parameter in candidate.free and item.parameter.endswith(".frequency")]


def comes_back_with_motion(model: Model, candidate: Candidate) -> bool:
    """Whether an oscillation has the same amplitude and phase in experiments of the same motion, taken together.

    In experiments of opposite motion, the opposite one. It is a function of the motion then, and not of the time; of
    several pairs, one has the same phase by chance.
    """
    values: dict[str, list[float]] = {}
    for item, value in zip(model.problem.unknowns.items, model.theta.tolist(), strict=True):
        if item.experiment and item.parameter in candidate.local:
            values.setdefault(item.experiment, []).append(value)
    pairs = itertools.combinations({k: np.array(v) for k, v in values.items()}.items(), 2)
    difference = size = 0.0
    for (name, one), (other_name, other) in pairs:
        if sign := _sign_of_motion(model, name, other_name):
            difference += float(np.sum((one - sign * other) ** 2))
            size += max(float(np.sum(one**2)), float(np.sum(other**2)))
    return size > 0 and difference <= SAME_SIZE**2 * size


def repeats_another(model: Model, candidate: Candidate) -> bool:
    """Whether an effect's oscillation is one with that of another block of its kind in the model.

    It is where both stay within half a period of one another, over the time of the recordings or over the range of the
    signal: together they are one oscillation of another amplitude.
    """
    kind, scales = type(candidate.diagram.blocks[candidate.block]), candidate.scales
    over_time, over_position = PERIODS
    spans = {over_time: max(float(np.ptp(one.record.t)) for one in model.setup.experiments)}
    if scales is not None:
        spans[over_position] = 2 * scales.wire.reach / (2 * np.pi)
    own, others = list[tuple[str, float]](), list[tuple[str, float]]()
    for item, value in zip(model.problem.unknowns.items, model.theta.tolist(), strict=True):
        block, _, name = item.parameter.rpartition(".")
        if name in spans and block == candidate.block:
            own.append((name, value))
        elif name in spans and block in candidate.diagram.blocks and type(candidate.diagram.blocks[block]) is kind:
            others.append((name, value))
    return any(n == m and abs(abs(f) - abs(g)) * spans[n] < 0.5 for n, f in own for m, g in others)


def _is_harmonic(experiments: Sequence[Experiment], name: str, frequency: float) -> bool:
    """Whether a frequency [Hz] is a multiple of one of an input, within the resolution of the recordings.

    Of one with a whole period in a recording: less of a sine is any slow motion.
    """
    resolution = 1 / max(float(np.ptp(one.record.t)) for one in experiments)
    for k in range(1, MAX_HARMONIC + 1):
        if frequency / k < resolution or not _line_share(experiments, name, frequency / k) > MIN_LINE_SHARE:
            continue
        _, line = _highest_line(experiments, name, frequency / k, resolution)
        if abs(frequency - k * line) <= resolution / 2:
            return True
    return False


def _highest_line(
    experiments: Sequence[Experiment], name: str, frequency: float, resolution: float
) -> tuple[float, float]:
    """The largest share of an input's variance near a frequency [Hz], and the frequency [Hz] that has it."""
    near = frequency + resolution * np.linspace(-1, 1, FREQUENCIES)
    shares = [_line_share(experiments, name, f) for f in near]
    return max(shares), float(near[int(np.argmax(shares))])


def _sign_of_motion(model: Model, name: str, other_name: str) -> float:
    """1 where all inputs of two experiments are the same, -1 where they are opposite, 0 where they are neither."""
    records = {one.name: one.record for one in model.setup.experiments}
    if not {name, other_name} <= records.keys():
        return 0.0  # they are in pieces
    signs = set()
    for k in model.diagram.inputs:
        one, other = (records[key][k] for key in (name, other_name))
        n = min(len(one), len(other))
        if min(np.ptp(one[:n]), np.ptp(other[:n])) > 0:
            alike = float(np.corrcoef(one[:n], other[:n])[0, 1])
            signs.add(float(np.sign(alike)) if abs(alike) >= SAME_MOTION else 0.0)
    return signs.pop() if len(signs) == 1 else 0.0


def _is_tone(experiments: Sequence[Experiment], name: str, frequency: float) -> bool:
    """Whether a frequency [Hz] is that of a line in the spectrum of an input in any of some experiments."""
    for experiment in experiments:
        resolution = 1 / float(np.ptp(experiment.record.t))
        beside = frequency + resolution * np.array([-6.0, -5.0, -4.0, -3.0, 3.0, 4.0, 5.0, 6.0])
        share, line = _highest_line([experiment], name, frequency, resolution)
        around = float(np.mean([_line_share([experiment], name, f) for f in beside if f > 0]))
        if share > max(LEAST_LINE, LINE_RATIO * around) and abs(frequency - line) <= resolution / 2:
            return True
    return False


def _line_share(experiments: Iterable[Experiment], name: str, frequency: float) -> float:
    """The share of an input's variance at one frequency [Hz], over some experiments."""
    explained = total = 0.0
    for experiment in experiments:
        t, x = experiment.record.t, experiment.record[name]
        x = x - x.mean()
        columns = np.stack([np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)], axis=1)
        columns -= columns.mean(axis=0)
        rest = x - columns @ np.linalg.lstsq(columns, x, rcond=None)[0]
        explained += float(x @ x - rest @ rest)
        total += float(x @ x)
    return explained / total if total > 0 else 0.0
