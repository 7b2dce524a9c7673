"""Errors of scale and zero: a gain and an offset that the model has no parameter for."""

from __future__ import annotations

from tsmblocks.blocks import Bias, GainError
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import PERCENT, in_proportion
from tsmblocks.effects.trials import Trials
from tsmblocks.effects.variants import in_front, separate

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
GAIN_ERROR = Effect(
    "gain_error",
    "map",
    "a gain error",
    "output",
    GainError(),
    {"error": 0.0},
    ("error",),
    lambda _: Trials({"error": 0.05}),
    excites="any motion",
    confused=("odd_nonlinearity", "creep", "parameter_change"),
    separates="slow motion over a known distance",
    sizes=(in_proportion("error of the gain", "error", "%", PERCENT),),
    of_gain=True,
)
_GAIN_OF_RECORDING = "a gain that differs between recordings"
EFFECTS = (
    GAIN_ERROR,
    in_front(GAIN_ERROR),
    separate(GAIN_ERROR, words=_GAIN_OF_RECORDING),
    separate(in_front(GAIN_ERROR), words=_GAIN_OF_RECORDING),
    OFFSET,
    in_front(OFFSET, "an offset of the input"),
    separate(OFFSET, words="an offset that differs between recordings"),
)
