"""Offsets: a constant that is added to what was measured."""

from __future__ import annotations

import attrs

from tsmblocks.blocks import Bias
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import in_proportion
from tsmblocks.effects.trials import Trials

OFFSET = Effect(
    "offset",
    "map",
    "an offset of the output",
    "output",
    Bias(bias=0.0),
    {"bias": 0.0},
    ("bias",),
    lambda scales: Trials({"bias": 0.02 * scales.wire.reach}),
    excites="an output that the initial states do not shift",
    confused=("even_nonlinearity", "drift", "jump"),
    separates="the sensor read at a known zero",
    sizes=(in_proportion("offset", "bias"),),
)
EFFECTS = (
    OFFSET,
    attrs.evolve(
        OFFSET,
        trials=lambda scales: None if scales.one_clock else OFFSET.trials(scales),
        variant="own sizes",
        local=("bias",),
    ),
)
