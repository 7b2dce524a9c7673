"""Effects that take a time and effects that take a distance: indistinguishable in one motion at one frequency.

A dead time T and a presliding distance or gap d shift a sine of amplitude X and frequency f alike where
d is about 2 pi f T X: only a second frequency, or a second amplitude, separates them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import SIMPLER_EFFECT_SHARE, Verdict, mean_loss
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.presentation import digits

TIME_LIKE = frozenset({"dead_time", "first_order_lag", "rate_dependence"})
"""Effects whose size is a time."""
DISTANCE_LIKE = frozenset({"presliding_friction", "backlash", "hysteresis", "asymmetric_hysteresis", "nonlocal_memory"})
"""Effects whose size is a distance."""
OTHER_KIND_SHARE = 0.8
"""Share of what the named effect removes from which one of the other kind is listed beside it at one frequency. Source:
8/pi^2, the share of a square wave (a gap crossed at each reversal) that is at its first line (a delay of a sine)."""
MIN_LINE_SHARE = 0.9
"""Share of the variance at one frequency from which a motion has one. Chosen: a triangle has 98 % at its first line."""
LINE_HALF_WIDTH = 2
"""Spectral lines on each side that count as one frequency. Chosen: half the main lobe of a Hann window."""
MAX_FURTHER_PARAMETERS = 1
"""Fitted parameters that a distance may have beyond those of a time, to be named instead of it where the motion has
several frequencies. Chosen: a law of memory has a shape beside its size."""
SAME_MOTION_RATIO = 1.25
"""Ratio of two frequencies or amplitudes up to which two motions are the same. Chosen: beyond it a delay shows."""
MIN_LINES = 8
"""Samples of a recording below which it has no spectrum to speak of. Chosen."""


def only_frequency(records: Mapping[str, Record], inputs: Sequence[str]) -> float | None:
    """The frequency [Hz] of all recordings together; None where they hold several, or several amplitudes."""
    found = list[tuple[float, float]]()
    for record in records.values():
        for name in (k for k in inputs if k in record):
            x = np.asarray(record[name])
            if len(x) < MIN_LINES or not np.ptp(x) > 0:
                continue
            line = _line(x, record.step)
            if line is None:
                return None
            found.append((line, float(np.std(x))))
    if not found:
        return None
    frequencies, sizes = zip(*found, strict=True)
    same = all(max(some) <= SAME_MOTION_RATIO * min(some) for some in (frequencies, sizes))
    return float(np.median(frequencies)) if same else None


def _line(x: np.ndarray, step: float) -> float | None:
    """The frequency [Hz] that holds nearly all of the variance of a signal, if there is one."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
    top = int(np.argmax(power))
    around = power[max(top - LINE_HALF_WIDTH, 0) : top + LINE_HALF_WIDTH + 1]
    return top / (len(x) * step) if top > 0 and around.sum() >= MIN_LINE_SHARE * power.sum() else None


def with_distances_first(verdict: Verdict, base: np.ndarray, blocks: TimeBlocks, frequency: float | None) -> Verdict:
    """The verdict in which no time is named where a distance explains as much.

    ``base`` (B,) are the losses without any candidate. Where the motion has one ``frequency`` [Hz], a distance that
    explains nearly as much comes first too, and what is of the other kind is listed beside it.
    """
    named = verdict.named
    if named is None or named.candidate.effect.name not in TIME_LIKE | DISTANCE_LIKE:
        return verdict
    before = mean_loss(base, blocks)

    def rivals(kind: frozenset[str], share: float) -> list[FittedCandidate]:
        """Candidates of a kind that remove at least a share of what the named effect does."""
        least, some = share * (before - named.loss), _tenable(verdict)
        return [one for one in some if one.candidate.effect.name in kind and before - one.loss >= least]

    first = named
    if named.candidate.effect.name in TIME_LIKE:
        distances = rivals(DISTANCE_LIKE, SIMPLER_EFFECT_SHARE if frequency is not None else 1.0)
        if frequency is None:  # a time and a distance differ in shape: many parameters make up for the wrong one
            most = named.parameter_count + MAX_FURTHER_PARAMETERS
            distances = [one for one in distances if one.parameter_count <= most]
        first = min(distances, key=lambda one: (one.parameter_count, one.loss), default=named)
    others = [one for one in verdict.indistinguishable if one is not first]
    if frequency is not None:
        other_kind = TIME_LIKE if first.candidate.effect.name in DISTANCE_LIKE else DISTANCE_LIKE
        others += [one for one in rivals(other_kind, OTHER_KIND_SHARE) if one not in others]
    return attrs.evolve(verdict, named=first, indistinguishable=(first, *others))


def _tenable(verdict: Verdict) -> list[FittedCandidate]:
    """The candidates that could be named."""
    return [one for one in verdict.ranking if one.tenable and not one.disqualifying_bounds]


def second_frequency(named: str, others: Iterable[str], frequency: float | None) -> str:
    """The experiment that separates a time from a distance, in words; empty where that is not the question."""
    kinds = {named, *others}
    if frequency is None or not (kinds & TIME_LIKE and kinds & DISTANCE_LIKE):
        return ""
    slower, faster = digits(frequency / 2), digits(2 * frequency)
    return (
        f"the same motion at a second frequency, such as {slower} or {faster} Hz: a delay keeps its time, presliding "
        "and backlash keep their distance"
    )
