"""Errors of scale and zero: a gain and an offset that the model has no parameter for."""

from __future__ import annotations

import attrs

from tsmblocks.blocks import Bias, Gain
from tsmblocks.effects.effect import Effect, in_front
from tsmblocks.effects.sizes import PERCENT, Size, in_proportion
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
GAIN = Effect(
    "gain",
    "map",
    "a gain error",
    "output",
    Gain(gain=1.0),
    {"gain": 1.0},
    ("gain",),
    lambda _: Trials({"gain": 0.05}),
    excites="any motion",
    confused=("odd_nonlinearity", "creep", "parameter_change"),
    separates="slow motion over a known distance",
    sizes=(Size("change of the gain", lambda p, _: PERCENT * (p["gain"] - 1), "%"),),
)
EFFECTS = (
    GAIN,
    in_front(GAIN),
    OFFSET,
    in_front(OFFSET, "an offset of the input"),
    attrs.evolve(
        OFFSET,
        trials=lambda scales: None if scales.one_clock else OFFSET.trials(scales),
        variant="own sizes",
        local=("bias",),
    ),
)
