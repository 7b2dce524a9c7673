"""Blocks that make signals out of time alone: steps, sines, sweeps, noise, a recording."""

from __future__ import annotations

import math
import zlib
from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.blocks.shared import UNIT, check_increasing
from tsmblocks.common.errors import ParameterError
from tsmblocks.model.block import Block, Output, Samples, Tape, block, option, parameter

PAPER_AMPLITUDE = math.radians(55.0)
"""Amplitude of the paper's sine [rad]."""
PAPER_TONE = math.radians(28.0)
"""Amplitude of each sine of the paper's two-tone signals [rad]."""
ROUNDING = 1e-12
"""Advance of a jump, as a share of its time: 3 * 0.1 s may fall short of 0.3 s. Chosen: above rounding."""


def white_noise(seed: int, interval: float, start: float, stop: float, name: str = "") -> Samples:
    """Draw normal noise of unit spread, one number per ``interval`` [s], over ``start`` to ``stop`` [s].

    The number at ``k * interval`` depends on ``seed``, ``name`` and ``k`` only: runs that begin, end or
    step differently see the same noise. Times before zero have a separate stream.
    """
    stream = zlib.crc32(name.encode())
    first, last = math.floor(start / interval) - 1, math.floor(stop / interval) + 1
    k = np.arange(first, last + 1)
    ahead = np.random.default_rng([seed, stream]).standard_normal(max(last + 1, 0))
    before = np.random.default_rng([seed, stream, 1]).standard_normal(max(-first, 0))
    return Samples(k * interval, np.concatenate([before[::-1], ahead])[k + len(before)], "zero")


@block
class Constant(Block):
    r"""Constant: the same value at all times.

    .. math:: y = c
    """

    source = "definition"
    symbol = "c"
    symbol_with_values = "{value:unit}"

    value: float = parameter(default=1.0, about="the value", unit="?y")
    unit: str = option(default="", about=UNIT)
    y = Output("the value", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.value)


@block
class Step(Block):
    r"""Step: one value up to an instant, another from then on.

    .. math:: y = y_0 \text{ for } t < t_0, \quad y_1 \text{ for } t \ge t_0
    """

    source = "definition"
    symbol = "step"
    symbol_with_values = "step\n{before:unit} → {after:unit} at {time} s"

    time: float = parameter(default=1.0, about="instant of the jump", unit="s")
    before: float = parameter(default=0.0, about="value before the jump", unit="?y")
    after: float = parameter(default=1.0, about="value from the jump on", unit="?y")
    unit: str = option(default="", about=UNIT)
    y = Output("the present value", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=ca.if_else(t + ROUNDING * ca.fabs(t) >= self.time, self.after, self.before))


@block
class Ramp(Block):
    r"""Ramp: a value that changes at a constant rate from an instant on.

    .. math:: y = y_0 + k \max(t - t_0, 0)
    """

    source = "definition"
    symbol = "ramp"
    symbol_with_values = "ramp\n{slope:unit}"

    start: float = parameter(default=0.0, about="instant at which the ramp begins", unit="s")
    slope: float = parameter(default=1.0, about="rate of change while it rises", unit="?y/s")
    initial: float = parameter(default=0.0, about="value before the ramp", unit="?y")
    unit: str = option(default="", about=UNIT)
    y = Output("the ramp", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.initial + self.slope * ca.fmax(t - self.start, 0.0))


@block
class Sine(Block):
    r"""A sine around an offset.

    .. math:: y = y_0 + a \sin(2 \pi f t + \varphi)
    """

    source = "Paper, Figs 13 and 17: 55 degrees at 0.2 Hz"
    symbol = "sin"
    symbol_with_values = "sin\n{amplitude:unit}, {frequency} Hz"

    amplitude: float = parameter(default=PAPER_AMPLITUDE, about="half of peak to peak", unit="?y")
    frequency: float = parameter(default=0.2, about="periods per second", unit="Hz", at_least=0.0)
    phase: float = parameter(default=0.0, about="phase at time zero", unit="rad")
    offset: float = parameter(default=0.0, about="mean value", unit="?y")
    unit: str = option(default="", about=UNIT)
    y = Output("the sine", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.offset + self.amplitude * ca.sin(2 * math.pi * self.frequency * t + self.phase))


@block
class MultiSine(Block):
    r"""A sum of sines.

    .. math:: y = \sum_k a_k \sin(2 \pi f_k t + \varphi_k)
    """

    source = "Paper, Fig. 14: 28 degrees at 0.2 Hz and 28 degrees at 0.5 Hz"
    symbol = "Σ sin"

    amplitudes: tuple[float, ...] = parameter(default=(PAPER_TONE,) * 2, about="amplitude of each sine", unit="?y")
    frequencies: tuple[float, ...] = parameter(default=(0.2, 0.5), about="frequency of each", unit="Hz", at_least=0.0)
    phases: tuple[float, ...] = parameter(default=(0.0, 0.0), about="phase of each sine at time zero", unit="rad")
    unit: str = option(default="", about=UNIT)
    y = Output("the sum of the sines", unit="?y", unit_option="unit")

    def check(self) -> None:
        lengths = len(self.amplitudes), len(self.frequencies), len(self.phases)
        if len(set(lengths)) > 1 or not lengths[0]:
            raise ParameterError(
                "MultiSine needs one amplitude, one frequency and one phase for each sine, "
                f"got {lengths[0]} amplitudes, {lengths[1]} frequencies and {lengths[2]} phases."
            )

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        sines = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        return dict(y=sum(a * ca.sin(2 * math.pi * f * t + p) for a, f, p in sines))


@block
class Chirp(Block):
    r"""A sine whose frequency changes linearly from one value to another, and then stays there.

    .. math::

        y = a \sin\left(2 \pi \left(f_0 s + \frac{f_1 - f_0}{2 T} s^2 + f_1 (t - s)\right)\right),
        \qquad s = \min(t, T)
    """

    source = "definition (phase is the integral of the frequency)"
    symbol = "chirp"
    symbol_with_values = "chirp\n{f0} … {f1} Hz"

    amplitude: float = parameter(default=PAPER_AMPLITUDE, about="half of peak to peak", unit="?y")
    f0: float = parameter(default=0.1, about="frequency at time zero", unit="Hz", at_least=0.0)
    f1: float = parameter(default=2.0, about="frequency at the end of the sweep and after it", unit="Hz", at_least=0.0)
    duration: float = parameter(default=20.0, about="how long the sweep takes", unit="s", above=0.0)
    unit: str = option(default="", about=UNIT)
    y = Output("the sweep", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        s = ca.fmin(t, self.duration)
        turns = self.f0 * s + (self.f1 - self.f0) / (2 * self.duration) * s * s + self.f1 * (t - s)
        return dict(y=self.amplitude * ca.sin(2 * math.pi * turns))


@block
class Random(Block):
    r"""Normal noise, a new number every interval; the same seed and block name give the same noise.

    .. math:: y = \mu + \sigma w_k, \qquad w_k \sim N(0, 1), \quad k = \lfloor t / T \rfloor
    """

    source = "definition"
    symbol = "noise"

    std: float = parameter(default=1.0, about="standard deviation", unit="?y", at_least=0.0)
    mean: float = parameter(default=0.0, about="mean value", unit="?y")
    seed: int = option(default=0, about="seed; with the block's name it fixes the noise", at_least=0)
    interval: float = option(default=0.01, about="time for which each number is held", unit="s", above=0.0)
    unit: str = option(default="", about=UNIT)
    w = Tape("white noise of unit spread")
    y = Output("the noise", unit="?y", unit_option="unit")

    def tapes(self, start: float, stop: float, name: str = "") -> dict[str, Samples]:
        return dict(w=white_noise(self.seed, self.interval, start, stop, name))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.mean + self.std * u.w)


@block
class Triangle(Block):
    r"""Triangle wave, rising from zero at time zero.

    .. math:: y = a (1 - 4 | p - \lfloor p \rfloor - \tfrac12 |), \qquad p = f t + \tfrac14
    """

    source = "definition"
    symbol = "triangle"
    symbol_with_values = "triangle\n{amplitude:unit}, {frequency} Hz"

    amplitude: float = parameter(default=PAPER_AMPLITUDE, about="half of peak to peak", unit="?y")
    frequency: float = parameter(default=0.2, about="periods per second", unit="Hz", at_least=0.0)
    unit: str = option(default="", about=UNIT)
    y = Output("the triangle", unit="?y", unit_option="unit")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        p = self.frequency * t + 0.25
        return dict(y=self.amplitude * (1 - 4 * ca.fabs(p - ca.floor(p) - 0.5)))


@block
class Staircase(Block):
    r"""Staircase: steps of equal height, up from zero, down past zero, back to zero, and again.

    .. math:: y = h \left(\bigl| (k - n) \bmod 2(n + m) - (n + m) \bigr| - m\right), \quad k = \lfloor t / T \rfloor

    with :math:`n` steps above zero and :math:`m` below. With ``down=0`` it never goes below zero.
    """

    source = "definition"
    symbol = "stairs"

    height: float = parameter(default=PAPER_AMPLITUDE / 4, about="height of one step", unit="?y")
    dwell: float = parameter(default=1.0, about="time spent on each step", unit="s", above=0.0)
    up: int = option(default=4, about="steps above zero", at_least=0)
    down: int = option(default=4, about="steps below zero", at_least=0)
    unit: str = option(default="", about=UNIT)
    y = Output("value of the present step", unit="?y", unit_option="unit")

    def check(self) -> None:
        if not self.up + self.down:
            raise ParameterError("Staircase needs at least one step, got up=0, down=0.")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        half = self.up + self.down
        k = ca.floor((t + ROUNDING * ca.fabs(t)) / self.dwell) - self.up
        within = k - 2 * half * ca.floor(k / (2 * half))
        return dict(y=self.height * (ca.fabs(within - half) - self.down))


@block
class Recorded(Block):
    r"""A signal given by its samples; a run that goes beyond them is refused.

    .. math:: y = y_0 + k\, w(t)

    Between samples the last value holds (``hold="zero"``), or straight lines or a cubic spline join them.
    """

    source = "definition"
    symbol = "record"

    times: tuple[float, ...] = option(default=(0.0, 1.0, 3.0, 4.0), about="instants of the samples", unit="s")
    values: tuple[float, ...] = option(default=(0.0, 1.0, -1.0, 0.0), about="values at these instants")
    hold: str = option(default="linear", about="signal between samples", choices=("zero", "linear", "cubic"))
    gain: float = parameter(default=1.0, about="factor on the recorded values")
    offset: float = parameter(default=0.0, about="added to the recorded values", unit="?y")
    unit: str = option(default="", about=UNIT)
    w = Tape("the signal as recorded")
    y = Output("the recorded signal", unit="?y", unit_option="unit")

    def check(self) -> None:
        for name in ("times", "values"):
            for k, number in enumerate(getattr(self, name)):
                if not isinstance(number, float) or not math.isfinite(number):
                    raise ParameterError(f"Recorded.{name}[{k}] must be a finite number, got {number!r}.")
        if len(self.times) != len(self.values) or not self.times:
            raise ParameterError(
                f"Recorded needs one value for each instant, got {len(self.times)} times and {len(self.values)} values."
            )
        if self.hold == "cubic" and len(self.times) < 4:
            raise ParameterError(f"Recorded with hold='cubic' needs at least 4 samples, got {len(self.times)}.")
        check_increasing(self, "times")

    def tapes(self, start: float, stop: float, name: str = "") -> dict[str, Samples]:
        return dict(w=Samples(np.array(self.times), np.array(self.values), self.hold))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.offset + self.gain * u.w)
