"""Differentiable metrics: each reduction with its derivatives, peaks and shares smoothed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from itertools import pairwise

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.errors import ParameterError
from tsmblocks.metrics.metrics import Metric, Part

Array = np.ndarray
Weighed = tuple[float, Array]
"""A number of a signal (N,), and its derivative by each sample (N,)."""


def _peak(e: Array, sharp: float, least: float | None = None) -> Weighed:
    """The smoothed maximum: the mean of the samples with weights exp((e - max) / width).

    The width is a share ``sharp`` of the height above the lowest sample, or above ``least``.
    """
    size = max(float(e.max() - (e.min() if least is None else least)), 1e-300) * sharp
    w = np.exp((e - e.max()) / size)
    w /= w.sum()
    value = float(w @ e)
    by = w * (1.0 + (e - value) / size)
    spread = sharp * float(w @ (e - value) ** 2) / size**2  # the width depends on the signal too
    by[int(np.argmax(e))] -= spread
    if least is None:
        by[int(np.argmin(e))] += spread
    return value, by


def _highest(e: Array, _: Array, sharp: float) -> Weighed:
    return _peak(e, sharp)


def _lowest(e: Array, _: Array, sharp: float) -> Weighed:
    value, w = _peak(-e, sharp)
    return -value, w


def _peak_to_peak(e: Array, t: Array, sharp: float) -> Weighed:
    (high, above), (low, below) = _highest(e, t, sharp), _lowest(e, t, sharp)
    return high - low, above - below


def _largest(e: Array, _: Array, sharp: float) -> Weighed:
    value, w = _peak(np.abs(e), sharp, 0.0)  # above zero: the smallest sample changes its sign at zero
    return value, w * np.sign(e)


def _rms(e: Array, _: Array, __: float) -> Weighed:
    value = float(np.sqrt(np.mean(e * e)))
    return value, e / (len(e) * max(value, 1e-300))


def _mean(e: Array, _: Array, __: float) -> Weighed:
    return float(e.mean()), np.full(len(e), 1.0 / len(e))


def _final(e: Array, _: Array, __: float) -> Weighed:
    w = np.zeros(len(e))
    w[-1] = 1.0
    return float(e[-1]), w


def _integral(e: Array, t: Array, _: float) -> Weighed:
    w = np.zeros(len(e))
    w[:-1] += 0.5 * np.diff(t)
    w[1:] += 0.5 * np.diff(t)
    return float(w @ e), w


def _variation(e: Array, _: Array, __: float) -> Weighed:
    sides, w = np.sign(np.diff(e)), np.zeros(len(e))
    w[1:] += sides
    w[:-1] -= sides
    return float(np.abs(np.diff(e)).sum()), w


def _share(e: Array, _: Array, sharp: float) -> Weighed:
    """The share of samples above zero, smoothed over a share of the signal's size."""
    size = max(float(np.abs(e).max()), 1e-300) * sharp
    above = 0.5 * (1.0 + np.tanh(0.5 * e / size))
    w = above * (1.0 - above) / (size * len(e))
    top = int(np.argmax(np.abs(e)))
    w[top] -= sharp * np.sign(e[top]) * float(w @ e) / size  # the width depends on the signal too
    return float(above.mean()), w


def _overshoot(e: Array, t: Array, sharp: float, target: float) -> Weighed:
    way = target - e[0]
    value, w = _highest((e - target) / way, t, sharp)
    first = float(w @ (e - target)) / way**2  # the height of the step depends on the first sample
    w = w / way
    w[0] += first
    return max(value, 0.0), w * (value > 0)


SMOOTH_REDUCTIONS: Mapping[str, Callable[..., Weighed]] = {
    "peak_to_peak": _peak_to_peak,
    "rms": _rms,
    "largest": _largest,
    "highest": _highest,
    "lowest": _lowest,
    "mean": _mean,
    "final": _final,
    "integral": _integral,
    "variation": _variation,
    "share": _share,
    "overshoot": _overshoot,
}
"""Differentiable reductions, as functions of (signal, instants, smoothing, further arguments)."""


PEAK_INTERVALS = 40
"""Intervals of time of which each contributes its extreme, where a metric is a peak. Chosen."""


def _tops(e: Array) -> Array:
    """Positions of the maximum of each interval of a signal."""
    edges = np.unique(np.linspace(0, len(e), min(PEAK_INTERVALS, len(e)) + 1).astype(int))
    return np.array([a + int(np.argmax(e[a:b])) for a, b in pairwise(edges)])


def _peaks(name: str, e: Array, along: Array, numbers: tuple[float, ...]) -> tuple[Array, Array] | None:
    """The extremes of which a reduction is the largest, (m,), with derivatives (m, p); None where it is no peak."""
    rows = along
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
        return (
            np.concatenate([e[up] - e[bottom], e[top] - e[down]]),
            np.vstack([rows[up] - rows[bottom], rows[top] - rows[down]]),
        )
    if name == "overshoot":
        way = numbers[0] - e[0]
        at = _tops(e / way)
        return (e[at] - numbers[0]) / way, rows[at] / way + ((e[at] - numbers[0]) / way**2)[:, None] * rows[0]
    return None


@attrs.frozen(eq=False)
class DifferentiableMetric:
    """A metric with its derivatives.

    A metric that is a peak has many values, the extremes of intervals, of which it is the largest (the smallest for
    ``lowest``): so a search takes all of them into account, not only the present peak.
    """

    metric: Metric
    _outer: ca.Function
    _inner: tuple[Callable[..., list[Array]], ...]
    _gain: float | None

    def __call__(
        self, t: Array, signals: Mapping[str, Array], derivatives: Mapping[str, Array], sharp: float
    ) -> tuple[Array, Array]:
        """Values (m,) and derivatives (m, p), from signals (N,) and their derivatives (N, p)."""
        if self._gain is not None:
            (part,), (inner,) = self.metric.parts, self._inner
            e, along = _along(part, inner, t, signals, derivatives)
            peaks = _peaks(part.reduction, e, along, part.numbers)
            if peaks is not None:
                return self._gain * peaks[0], self._gain * peaks[1]
        values, weights = [], []
        for part, inner in zip(self.metric.parts, self._inner, strict=True):
            e, along = _along(part, inner, t, signals, derivatives)
            kept = t[_inside(part, t)]
            value, w = SMOOTH_REDUCTIONS[part.reduction](e, kept, sharp, *part.numbers)
            values.append(value)
            weights.append(w @ along)
        made, *by_part = (float(v) for v in self._outer(*values))
        derivative = sum(d * w for d, w in zip(by_part, weights, strict=True))
        return np.array([self.metric.factor * made]), self.metric.factor * np.atleast_2d(derivative)

    @property
    def rounded(self) -> bool:
        """Whether it depends on the smoothing."""
        one = self._gain is not None and self.metric.parts[0].reduction not in ("share",)
        return not one and any(part.reduction in SMOOTHED_REDUCTIONS for part in self.metric.parts)


SMOOTHED_REDUCTIONS = ("share", "highest", "lowest", "largest", "peak_to_peak", "overshoot")
"""Reductions that are smoothed."""


def _inside(part: Part, t: Array) -> Array:
    return (t >= part.after - 1e-9) & (t <= part.before + 1e-9)


def _along(
    part: Part,
    inner: Callable[..., list[Array]],
    t: Array,
    signals: Mapping[str, Array],
    derivatives: Mapping[str, Array],
) -> tuple[Array, Array]:
    """The argument of a reduction (n,) and its derivatives (n, p), at its instants."""
    kept, names = _inside(part, t), part.of.names
    e, *by = (np.broadcast_to(np.asarray(v).ravel(), kept.sum()) for v in inner(*(signals[k][kept] for k in names)))
    parts = [d[:, None] * derivatives[name][kept] for name, d in zip(names, by, strict=True)]
    return e, np.sum(parts, axis=0)


def differentiable(metric: Metric) -> DifferentiableMetric:
    """The metric with its derivatives. Raises ParameterError for a reduction that has none."""
    for part in metric.parts:
        if part.reduction not in SMOOTH_REDUCTIONS:
            raise ParameterError(
                f"metric '{metric.name}': {part.reduction} is not differentiable, so nothing can be tuned by "
                f"it. Known here: {', '.join(SMOOTH_REDUCTIONS)}."
            )
    marks = [ca.SX.sym(f"m{k}") for k in range(len(metric.parts))]
    value = metric.outer.symbolic({f"#{k}": m for k, m in enumerate(marks)})
    derivatives = [ca.jacobian(value, m) for m in marks]
    outer = ca.Function("outer", marks, [value, *derivatives])
    plain = (
        len(marks) == 1 and derivatives[0].is_constant() and float(outer(0.0)[0]) == 0.0 and float(derivatives[0]) > 0
    )
    gain = metric.factor * float(derivatives[0]) if plain else None
    return DifferentiableMetric(metric, outer, tuple(_inner(part) for part in metric.parts), gain)


def _inner(part: Part) -> Callable[..., list[Array]]:
    """The expression of a reduction and its derivative by each signal, sample by sample."""
    one = [ca.SX.sym(f"s{k}") for k in range(len(part.of.names))]
    value = part.of.symbolic(dict(zip(part.of.names, one, strict=True)))
    single = ca.Function("one", one, [ca.densify(v) for v in (value, *(ca.jacobian(value, s) for s in one))])

    @lru_cache(maxsize=8)
    def along(count: int) -> ca.Function:
        return single.map(count)

    def many(*columns: Array) -> list[Array]:
        return [np.asarray(v) for v in along(len(columns[0]))(*(np.asarray(c).reshape(1, -1) for c in columns))]

    return many
