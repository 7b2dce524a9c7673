"""Differentiable metrics: each reduction with its derivatives, peaks and shares smoothed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.errors import ParameterError
from tsmblocks.metrics.metrics import TIME, Metric, Part

Array = np.ndarray
Differentiated = tuple[float, Array]
"""A number of a signal (N,), and its derivative by each sample (N,)."""


def _highest(e: Array, _: Array, smoothing: float, least: float | None = None) -> Differentiated:
    """The smoothed maximum: the mean of the samples with weights exp((e - max) / width).

    The width is a share ``smoothing`` of the height above the lowest sample, or above ``least``.
    """
    size = max(float(e.max() - (e.min() if least is None else least)), 1e-300) * smoothing
    w = np.exp((e - e.max()) / size)
    w /= w.sum()
    value = float(w @ e)
    by = w * (1.0 + (e - value) / size)
    spread = smoothing * float(w @ (e - value) ** 2) / size**2  # the width depends on the signal too
    by[int(np.argmax(e))] -= spread
    if least is None:
        by[int(np.argmin(e))] += spread
    return value, by


def _lowest(e: Array, t: Array, smoothing: float) -> Differentiated:
    value, w = _highest(-e, t, smoothing)
    return -value, w


def _peak_to_peak(e: Array, t: Array, smoothing: float) -> Differentiated:
    (high, above), (low, below) = _highest(e, t, smoothing), _lowest(e, t, smoothing)
    return high - low, above - below


def _largest(e: Array, t: Array, smoothing: float) -> Differentiated:
    value, w = _highest(np.abs(e), t, smoothing, 0.0)  # above zero: the smallest sample changes its sign at zero
    return value, w * np.sign(e)


def _rms(e: Array, _: Array, __: float) -> Differentiated:
    value = float(np.sqrt(np.mean(e * e)))
    return value, e / (len(e) * max(value, 1e-300))


def _variation(e: Array, _: Array, __: float) -> Differentiated:
    return float(np.abs(np.diff(e)).sum()), np.convolve(np.sign(np.diff(e)), [-1.0, 1.0])


def _weighted(weights: Callable[[Array], Array]) -> Callable[..., Differentiated]:
    """A reduction that is a weighted sum of the samples, with the weights of their instants."""

    def reduction(e: Array, t: Array, _: float) -> Differentiated:
        w = weights(t)
        return float(w @ e), w

    return reduction


def _share(e: Array, _: Array, smoothing: float) -> Differentiated:
    """The share of samples above zero, smoothed over a share of the signal's size."""
    size = max(float(np.abs(e).max()), 1e-300) * smoothing
    above = 0.5 * (1.0 + np.tanh(0.5 * e / size))
    w = above * (1.0 - above) / (size * len(e))
    top = int(np.argmax(np.abs(e)))
    w[top] -= smoothing * np.sign(e[top]) * float(w @ e) / size  # the width depends on the signal too
    return float(above.mean()), w


def _overshoot(e: Array, t: Array, smoothing: float, target: float) -> Differentiated:
    way = target - e[0]
    value, w = _highest((e - target) / way, t, smoothing)
    first = float(w @ (e - target)) / way**2  # the height of the step depends on the first sample
    w = w / way
    w[0] += first
    return max(value, 0.0), w * (value > 0)


def _settling_time(e: Array, t: Array, _: float, band: float) -> Differentiated:
    """The instant after which the magnitude stays within the band, between two samples; beyond the end of a run that
    ends outside, by as much more as its end is larger than the band.
    """
    size, w = np.abs(e), np.zeros(len(e))
    outside = np.flatnonzero(size > band)
    if not len(outside):
        return 0.0, w
    k, span = int(outside[-1]), float(t[-1] - t[0])
    if k == len(e) - 1:
        w[k] = span * np.sign(e[k]) / max(band, 1e-300)
        return span * float(size[k]) / max(band, 1e-300), w
    step, fall, above = t[k + 1] - t[k], size[k] - size[k + 1], size[k] - band
    w[k : k + 2] = step / fall**2 * np.array([fall - above, above]) * np.sign(e[k : k + 2])
    return float(t[k] + step * above / fall - t[0]), w


SMOOTH_REDUCTIONS: Mapping[str, Callable[..., Differentiated]] = {
    "peak_to_peak": _peak_to_peak,
    "rms": _rms,
    "largest": _largest,
    "highest": _highest,
    "lowest": _lowest,
    "mean": _weighted(lambda t: np.full(len(t), 1.0 / len(t))),
    "final": _weighted(lambda t: np.eye(1, len(t), len(t) - 1)[0]),
    "integral": _weighted(lambda t: np.convolve(np.diff(t), [0.5, 0.5])),  # trapezoids
    "variation": _variation,
    "share": _share,
    "overshoot": _overshoot,
    "settling_time": _settling_time,
}
"""Differentiable reductions, as functions of (signal, instants, smoothing, further arguments)."""
SMOOTHED_REDUCTIONS = ("share", "highest", "lowest", "largest", "peak_to_peak", "overshoot")
"""Reductions that are smoothed."""
PEAK_INTERVALS = 40
"""Intervals of time of which each contributes its extreme, where a metric is a peak. Chosen."""


def _tops(e: Array) -> Array:
    """Positions of the maximum of each interval of a signal."""
    edges = np.unique(np.linspace(0, len(e), min(PEAK_INTERVALS, len(e)) + 1).astype(int))
    return np.array([a + int(np.argmax(e[a:b])) for a, b in pairwise(edges)])


def _peaks(name: str, e: Array, rows: Array, numbers: tuple[float, ...]) -> tuple[Array, Array] | None:
    """The extremes of which a reduction is the largest, (m,), with derivatives (m, p); None where it is no peak.

    ``rows`` (n, p) are the derivatives of the signal ``e`` (n,).
    """
    if name in ("highest", "lowest"):
        sign = 1.0 if name == "highest" else -1.0
        at = _tops(sign * e)
        return e[at], rows[at]
    if name == "largest":
        up, down = _tops(e), _tops(-e)
        return np.concatenate([e[up], -e[down]]), np.vstack([rows[up], -rows[down]])
    if name == "peak_to_peak":
        up, down = _tops(e), _tops(-e)
        top, bottom = int(np.argmax(e)), int(np.argmin(e))
        by = np.vstack([rows[up] - rows[bottom], rows[top] - rows[down]])
        return np.concatenate([e[up] - e[bottom], e[top] - e[down]]), by
    if name == "overshoot":
        way = numbers[0] - e[0]
        at = _tops(e / way)
        return (e[at] - numbers[0]) / way, rows[at] / way + ((e[at] - numbers[0]) / way**2)[:, None] * rows[0]
    return None


@attrs.frozen(eq=False)
class _Argument:
    """The argument of a reduction, with its derivatives; ``function`` gives its value and those by each signal."""

    part: Part
    function: ca.Function

    def __call__(
        self, t: Array, signals: Mapping[str, Array], derivatives: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """Its instants (n,), values (n,) and derivatives (n, p)."""
        kept = (t >= self.part.after - 1e-9) & (t <= self.part.before + 1e-9)
        names = self.part.expression.names
        values = self.function.map(int(kept.sum()))(*(signals[name][kept].reshape(1, -1) for name in names))
        e, *by = (np.asarray(v).ravel() for v in values)
        parts = [d[:, None] * derivatives[name][kept] for name, d in zip(names, by, strict=True)]
        return t[kept], e, np.sum(parts, axis=0)


@attrs.frozen(eq=False)
class DifferentiableMetric:
    """A metric with its derivatives: ``outer`` gives its value and derivatives from those of its reductions.

    A metric that is a peak (times ``gain``; None for others) has many values, the extremes of intervals, of which it is
    the largest (the smallest for ``lowest``): so a search takes all of them into account, not only the present peak.
    """

    metric: Metric
    outer: ca.Function
    arguments: tuple[_Argument, ...]
    gain: float | None

    def __call__(
        self, t: Array, signals: Mapping[str, Array], derivatives: Mapping[str, Array], smoothing: float
    ) -> tuple[Array, Array]:
        """Values (m,) and derivatives (m, p), from signals (N,) and their derivatives (N, p)."""
        if self.metric.timed:
            signals = {**signals, TIME: t}
            derivatives = {**derivatives, TIME: np.zeros_like(next(iter(derivatives.values())))}
        values, gradients = [], []
        for argument in self.arguments:
            kept, e, rows = argument(t, signals, derivatives)
            part = argument.part
            peaks = _peaks(part.reduction, e, rows, part.numbers) if self.gain is not None else None
            if peaks is not None:
                return self.gain * peaks[0], self.gain * peaks[1]
            value, w = SMOOTH_REDUCTIONS[part.reduction](e, kept, smoothing, *part.numbers)
            values.append(value)
            gradients.append(w @ rows)
        value, *by_part = (float(v) for v in self.outer(*values))
        gradient = sum(d * row for d, row in zip(by_part, gradients, strict=True))
        return np.array([self.metric.factor * value]), self.metric.factor * np.atleast_2d(gradient)

    @property
    def smoothed(self) -> bool:
        """Whether it depends on the smoothing."""
        smoothed = {part.reduction for part in self.metric.parts} & {*SMOOTHED_REDUCTIONS}
        return bool(smoothed if self.gain is None else smoothed & {"share"})  # other peaks are taken by interval


def differentiable(metric: Metric) -> DifferentiableMetric:
    """The metric with its derivatives. Raises ParameterError for a reduction that has none."""
    for part in metric.parts:
        if part.reduction not in SMOOTH_REDUCTIONS:
            raise ParameterError(
                f"metric '{metric.name}': {part.reduction} is not differentiable, so it cannot be used for tuning. "
                f"Known here: {', '.join(SMOOTH_REDUCTIONS)}."
            )
    numbers = [ca.SX.sym(f"m{k}") for k in range(len(metric.parts))]
    value = metric.outer.symbolic({f"#{k}": m for k, m in enumerate(numbers)})
    derivatives = [ca.jacobian(value, m) for m in numbers]
    outer = ca.Function("outer", numbers, [value, *derivatives])
    proportional = len(numbers) == 1 and derivatives[0].is_constant() and float(outer(0.0)[0]) == 0.0
    gain = metric.factor * float(derivatives[0]) if proportional and float(derivatives[0]) > 0 else None
    return DifferentiableMetric(metric, outer, tuple(map(_argument, metric.parts)), gain)


def _argument(part: Part) -> _Argument:
    signals = [ca.SX.sym(name) for name in part.expression.names]
    value = part.expression.symbolic(dict(zip(part.expression.names, signals, strict=True)))
    outputs = [ca.densify(v) for v in (value, *(ca.jacobian(value, one) for one in signals))]
    return _Argument(part, ca.Function("argument", signals, outputs))
