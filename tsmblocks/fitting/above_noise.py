"""Residuals relative to the noise of the recordings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common import displayed_units
from tsmblocks.common.errors import DataError
from tsmblocks.data import Record
from tsmblocks.data.fast_noise import sample_to_sample_noise
from tsmblocks.data.noise_floor import HIGH_FREQUENCIES, MIN_NOISE_SAMPLES, method_text, noise_of_recordings
from tsmblocks.fitting.residual_cause import cause_text, spike_text, starts_wrong
from tsmblocks.fitting.score import Difference, Differences

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

FAR = 1.5
"""Error relative to the noise from which advice is given. Chosen."""
NEGLIGIBLE = 1e-4
"""Residual, as a share of the output's spread, up to which no advice is given: simulated outputs may have no noise.
Chosen."""


MAX_FLOOR_RATIO = 1.5
"""Noise of an output over that of a residual from which it is implausible. Chosen: noise alone gives about 1."""


def output_noise(own: Sequence[Difference], records: Mapping[str, Record], inputs: Iterable[str]) -> tuple[float, str]:
    """Noise of an output, rms in its unit, and how it was estimated; NaN without an estimate.

    ``own`` are the residuals of that output by experiment.
    """
    try:
        noise, method = noise_of_recordings(records, own[0].output, own[0].unit, inputs)
    except DataError:  # too few samples
        return float("nan"), ""
    fast = fast_noise((d.t, d.residual) for d in own)
    return (fast if contains_jumps(noise, method, fast) else noise), method


def fast_noise(residuals: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """The noise from sample to sample in residuals (times, values), the median; infinite where all are too short."""
    found = [sample_to_sample_noise(t, r).floor for t, r in residuals if len(t) >= MIN_NOISE_SAMPLES]
    return float(np.median(found)) if found else np.inf


def contains_jumps(noise: float, method: str, fast: float) -> bool:
    """Whether the fast noise of an output holds jumps that a model simulates, whose residual has the ``fast`` noise.

    Where an input passes to the output at once, those of a staircase look like noise.
    """
    return method == HIGH_FREQUENCIES and fast * MAX_FLOOR_RATIO < noise


def factor_text(ratio: float) -> str:
    """A ratio in two digits, or more where it is 100 or above."""
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"


def material_residuals(differences: Differences) -> Iterator[list[Difference]]:
    """The residuals of each output, by experiment, that are not negligible beside its spread."""
    for name in dict.fromkeys(d.output for d in differences):
        own = [d for d in differences if d.output == name]
        spread = float(np.sqrt(np.mean(np.concatenate([d.measured - d.measured.mean() for d in own]) ** 2)))
        if _rms(own) > NEGLIGIBLE * spread:
            yield own


def _rms(own: Sequence[Difference]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([d.residual for d in own]) ** 2)))


def is_far(own: Sequence[Difference], noise: float) -> bool:
    """Whether the residual of an output is far above its ``noise``, where that is known."""
    return noise > 0 and _rms(own) >= FAR * noise


def beyond_noise(fit: Fit) -> list[str]:
    """A caution for each output whose residual is far above the noise of the recordings, or is in a few samples."""
    said = []
    for own in material_residuals(fit.differences):
        name, spike = own[0].output, "" if starts_wrong(fit, own) else spike_text(own)
        if spike:  # it may have enlarged the noise that is found
            said.append(f"The residual of {name} has {spike}: check the recording there.")
        elif fit.status not in ("interrupted", "limit"):
            said += _far(fit, own)
    return said


def _far(fit: Fit, own: Sequence[Difference]) -> list[str]:
    """A caution where the residual of an output is far above the noise."""
    noise, method = output_noise(own, fit.records, fit.diagram.inports)
    if not is_far(own, noise):
        return []
    k, unit = displayed_units.display_unit(own[0].unit)
    size = f"{k * noise:.3g} {unit}".rstrip()
    return [
        f"The residual of {own[0].output} is {factor_text(_rms(own) / noise)} times the noise floor ({size} rms, "
        f"{method_text(method)}): {cause_text(fit, own, only_fast=method == HIGH_FREQUENCIES)}"
    ]
