"""Blocks between a quantity and its measurement: encoder, noise, bias."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from tsmblocks.blocks.sources import white_noise
from tsmblocks.model.block import Block, Input, Output, Samples, Tape, block, option, parameter


@block
class Encoder(Block):
    r"""Encoder: an angle in whole counts.

    .. math:: y = q \left\lfloor \frac{u}{q} + r \right\rfloor, \qquad q = \frac{2 \pi}{N}

    with :math:`r = \tfrac12` for rounding to the nearest count and 0 for counting completed ones.
    Reading all four edges of a pulse gives four counts for each.
    """

    source = "Paper, section 2: encoders of 3600 pulses per revolution"
    symbol = "encoder"
    symbol_with_values = "encoder\n{counts} /rev"

    counts: float = parameter(default=3600.0, about="counts per revolution", unit="1/rev", above=0.0, known=True)
    rounding: str = option(
        default="nearest", about="rounding to the nearest count, or down", choices=("nearest", "down")
    )
    u = Input("true angle", unit="rad")
    y = Output("measured angle", unit="rad")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        interval = 2 * math.pi / self.counts
        shift = 0.5 if self.rounding == "nearest" else 0.0
        return dict(y=interval * ca.floor(u.u / interval + shift))


@block
class SensorNoise(Block):
    r"""Normal noise added to a signal; the same seed and block name give the same noise.

    .. math:: y = u + \sigma w_k, \qquad w_k \sim N(0, 1), \quad k = \lfloor t / T \rfloor
    """

    source = "definition"
    symbol = "+ noise"
    symbol_with_values = "+ noise\nσ {std:unit}"

    std: float = parameter(default=0.001, about="standard deviation", unit="?u", at_least=0.0)
    seed: int = option(default=0, about="seed; with the block's name it fixes the noise", at_least=0)
    interval: float = option(default=0.001, about="time for which each number is held", unit="s", above=0.0)
    u = Input("true value", unit="?u")
    w = Tape("white noise of unit spread")
    y = Output("measured value", unit="?u")

    def tapes(self, start: float, stop: float, name: str = "") -> dict[str, Samples]:
        return dict(w=white_noise(self.seed, self.interval, start, stop, name))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.std * u.w)


@block
class Bias(Block):
    r"""A constant error of a sensor.

    .. math:: y = u + b
    """

    source = "definition"
    symbol = "+ b"
    symbol_with_values = "+ {bias:unit}"

    bias: float = parameter(default=0.0, about="added to the signal", unit="?u")
    u = Input("true value", unit="?u")
    y = Output("measured value", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.bias)


@block
class GainError(Block):
    r"""A relative error of the sensor's gain.

    .. math:: y = (1 + e) u
    """

    source = "definition"
    symbol = "1 + e"
    symbol_with_values = "1 + {error}"

    error: float = parameter(default=0.0, about="error of the gain, as a share of it")
    u = Input("true value", unit="?u")
    y = Output("measured value", unit="?u")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=u.u + self.error * u.u)
