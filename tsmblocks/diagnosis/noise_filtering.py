"""Memories in front of a model that only remove the noise of its input."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate, inner_signal
from tsmblocks.diagnosis.model import Model

MIN_CHANGE_OF_INPUT = 2.0
"""Change of an input by a memory in front of the model [rms noise of the input] below which it may be one that only
takes noise away. Chosen: noise stays within twice its rms for 95 % of the time, and so within the memory."""

LOOP, HYSTERESIS = "loop", "hysteresis"
"""The family of effects that hold a signal back at reversals, and that which others of them contain."""


def filters_noise(model: Model, candidate: Candidate, input_noise: Mapping[str, float]) -> bool:
    """Whether a loop in front of the model changes the input by no more than the noise of its measurement.

    A gap passes on no motion that is smaller than itself. Where the mechanism did not have the noise that was recorded,
    such a gap improves the simulation and is not there. ``input_noise`` is the rms noise by input.
    """
    noise = input_noise.get(candidate.point.signal, 0.0)
    is_loop = candidate.effect.family == LOOP or HYSTERESIS in candidate.effect.contains
    if not is_loop or not noise:
        return False
    behind = inner_signal(model.diagram, f"{candidate.block}.y")
    signals = np.concatenate(model.signals([candidate.point.signal, behind]))
    change = signals[:, 1] - signals[:, 0]
    return bool(np.sqrt(np.mean(change**2)) < MIN_CHANGE_OF_INPUT * noise)
