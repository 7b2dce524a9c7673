"""The result of screening a candidate: its predicted gain, starting points, and how its shapes change the outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.fitted_candidate import MAX_FINITE_NULL
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup

MAX_SIZE_FACTOR = 40.0
"""Largest size of an effect at the start of its fit [trial sizes]. Chosen: beyond it a linear prediction fails."""


def gain_beyond_noise(score: ScreeningScore) -> float:
    """The predicted gain of a candidate less its mean gain in surrogates, which hold noise alone."""
    return score.gain - float(np.mean(score.noise_gains))


@attrs.frozen
class SizeLimit:
    """The smallest detectable ``value`` of a ``parameter`` of an effect, and the shape for which it holds."""

    parameter: str
    value: float
    shape: Mapping[str, float]


@attrs.frozen(eq=False)
class ShapeSensitivity:
    """How a shape of an effect changes the outputs at its trial size.

    ``sensitivity`` is the change of the sum of squares, zero where the parameters of the base absorb it; these then
    move by ``absorbed_by``. ``exceeds_range`` is True where the size exceeds the range of an output.
    """

    shape: Mapping[str, float]
    sensitivity: float
    exceeds_range: bool
    absorbed_by: Mapping[str, float] = attrs.field(factory=dict)


@attrs.frozen(eq=False)
class ScreeningScore:
    """The screening of a candidate: ``gain`` is the predicted fall of the sum of squares [noise variances].

    ``starts`` are the starting points of its fit, best first. ``noise_gains`` (D,) are the gains in surrogates of the
    residual, which hold noise alone. ``shapes`` are those that were tried. ``is_slow`` is True where its change of the
    outputs is. Gains count beside ``squares``, the sum of squares of the residual, and ``noise_squares`` (D,) of the
    surrogates: all of it, or the slow part. ``slow_part`` are these of the slow part, where a candidate of the
    motion is slow. ``states_alone_explain()`` is whether the size gains no more than in noise, beyond initial states
    that are free. ``at_measured_position`` is the screening over a measured position, where that of the model is not.
    """

    candidate: Candidate
    problem: Problem
    setup: Setup
    gain: float
    starts: tuple[np.ndarray, ...]
    noise_gains: np.ndarray
    shapes: tuple[ShapeSensitivity, ...] = ()
    is_slow: bool = False
    states_alone_explain: Callable[[], bool] = lambda: False
    squares: float = 1.0
    noise_squares: np.ndarray | float = 1.0
    slow_part: tuple[float, np.ndarray] | None = None
    at_measured_position: ScreeningScore | None = None

    def limits(self, detectable: float) -> list[SizeLimit]:
        """The sizes that change the sum of squares by ``detectable``, one for each shape, the smallest first.

        Empty where these data do not excite the effect, or the base absorbs it.
        """
        trials, first = self.candidate.trials, self.candidate.effect.free[0]
        null = self.candidate.effect.null
        found: list[tuple[float, SizeLimit]] = []
        for one in self.shapes:
            factor = float(np.sqrt(detectable / one.sensitivity)) if one.sensitivity > 0 else np.inf
            if one.exceeds_range:  # smaller sizes are not in proportion to it
                factor = max(factor, 1.0)
            if trials.strengths and factor < MAX_SIZE_FACTOR:
                name, size = next(iter(trials.strengths.items()))
                found.append((abs(size) * factor, SizeLimit(name, abs(size) * factor, one.shape)))
            elif not trials.strengths and factor <= 1 and abs(null.get(first, np.inf)) < MAX_FINITE_NULL:
                shape = {k: null.get(k, v) + (v - null.get(k, v)) * factor for k, v in one.shape.items()}
                found.append((abs(shape[first]), SizeLimit(first, abs(shape[first]), shape)))
            elif not trials.strengths and factor <= 1:  # a limit that is infinite without it: the least that acts
                name = self._acting(one.shape)
                found.append((one.sensitivity, SizeLimit(name, one.shape[name], one.shape)))
        return [limit for _, limit in sorted(found, key=lambda one: one[0]) if limit.value]

    def _acting(self, shape: Mapping[str, float]) -> str:
        """The first limit of a shape that is within the range of the signal, where it has the unit of the signal."""
        scales, effect, names = self.candidate.scales, self.candidate.effect, [*shape]
        free = [k for k in effect.free if k in names and abs(effect.null.get(k, np.inf)) >= MAX_FINITE_NULL]
        if scales is None or {"low", "high"} - {k.rpartition(".")[2] for k in free}:
            return free[0]
        return next((k for k in free if scales.wire.low < shape[k] < scales.wire.high), free[0])
