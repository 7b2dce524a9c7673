"""The table of relatives: by which blocks a block of a model may be replaced, and where their fits start."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.blocks import Saturation, SoftSaturation
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.relatives_friction import FRICTION
from tsmblocks.effects.relatives_linear import RELATIVES_OF_OSCILLATORS
from tsmblocks.effects.relatives_loops import RELATIVES_OF_LOOPS
from tsmblocks.effects.sizes import in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block


def _soft(old: Any, scales: Scales) -> Block:
    return SoftSaturation(low=old.low, high=old.high, softness=0.1 * scales.wire.reach)


def _soft_trials(old: Any, scales: Scales) -> Trials | None:
    limits = {k: v for k, v in (("low", float(old.low)), ("high", float(old.high))) if np.isfinite(v)}
    if len(limits) < 2:
        return None
    shapes = tuple({**limits, "softness": share * scales.wire.reach} for share in (0.03, 0.12, 0.4))
    return Trials({}, shapes, bounds={"softness": (1e-3 * scales.wire.reach, 2 * scales.wire.reach)})


SOFT_SATURATION = Relative(
    of=Saturation,
    name="saturation",
    family="map",
    words="a saturation replaced by one that is reached gradually",
    block=_soft,
    trials=_soft_trials,
    free=("low", "high", "softness"),
    excites="large amplitudes",
    confused=("odd_nonlinearity", "rate_limit"),
    separates="several amplitudes",
    variant="soft",
    sizes=(in_proportion("lower limit", "low"), in_proportion("upper limit", "high")),
)

RELATIVES: tuple[Relative, ...] = (*FRICTION, *RELATIVES_OF_LOOPS, SOFT_SATURATION, *RELATIVES_OF_OSCILLATORS)
"""All relatives of the toolbox."""
