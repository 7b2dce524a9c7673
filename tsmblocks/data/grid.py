"""The time axis of a record: its step, how even it is, and resampling onto another."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import attrs
import numpy as np

from tsmblocks.errors import DataError

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

UNEVEN = 0.01
"""Deviation of a step from the median, in steps, up to which a grid counts as even."""
PASSED = 0.7
"""Share of the new Nyquist frequency that is left by the low-pass before samples are thinned out."""
MOST_SAMPLES = 50_000_000
"""Samples of a resampled record; more is a step typed in the wrong unit."""


def step_of(t: np.ndarray) -> float:
    """Median step [s]."""
    return float(np.median(np.diff(t)))


def jitter_of(t: np.ndarray) -> float:
    """Largest deviation of a step from the median step, as a share of it (0 is a perfectly even grid)."""
    steps = np.diff(t)
    return float(np.abs(steps / np.median(steps) - 1).max())


def usual_step(t: np.ndarray) -> float:
    """Return the step [s] that nine in ten do not exceed, at least the median: what is no gap in uneven samples."""
    steps = np.diff(t)
    return float(max(np.median(steps), np.quantile(steps, 0.9, method="lower")))


def refuse_uneven(record: Record, what: str) -> None:
    """Raise DataError unless the samples are evenly spaced; ``what`` (filtering) needs it."""
    if not record.uniform:
        raise DataError(f"{record.called}: {what} needs evenly spaced samples, but steps are up to "
                        f"{100 * record.jitter:.0f} % off {record.step:.4g} s. Call resampled() first.")  # fmt: skip


def refuse_not_finite(record: Record, names: Iterable[str], what: str) -> None:
    """Raise DataError for a sample of these signals that is no finite number; ``what`` (filtering) would spread it."""
    for name in names:
        bad = np.flatnonzero(~np.isfinite(record[name]))
        if len(bad):
            k = int(bad[0])
            raise DataError(f"{record.called}: sample {k} of {name} is not finite (t = {record.t[k]:g} s, value = "
                            f"{record[name][k]:g}), and {what} needs every sample.")  # fmt: skip


def resampled(record: Record, step: float | None = None) -> Record:
    """Return the record on an even grid; see Record.resampled."""
    own = record.step
    step = own if step is None else float(step)
    t = record.t
    if not 0 < step <= (t[-1] - t[0]) / 3:
        raise DataError(f"{record.called}: the new step must be above 0 s and at most a third of the record "
                        f"({t[-1] - t[0]:g} s), got {step:g} s.")  # fmt: skip
    refuse_not_finite(record, record, "resampling")
    count = int((t[-1] - t[0]) / step * (1 + 1e-12) + 1e-6) + 1
    if count > MOST_SAMPLES:
        raise DataError(f"{record.called}: a step of {step:g} s makes {count} samples; is it in seconds?")
    grid = t[0] + step * np.arange(count)
    grid[-1] = min(grid[-1], t[-1])
    if step > 1.05 * own:
        return _thinned(record, grid, step)
    kinds = {name: better_interpolation(t, record[name]) for name in record}
    signals = {name: interpolation(t, record[name], kinds[name])(grid) for name in record}
    how = "; ".join(f"{kind}: {', '.join(found)}" for kind in ("cubic", "linear")
                    if (found := [n for n in record if kinds[n] == kind]))  # fmt: skip
    note = f"Resampled from {len(t)} to {count} samples, {step:g} s apart (interpolated; {how})."
    return attrs.evolve(record, t=grid, signals=signals, notes=(*record.notes, note))


def _thinned(record: Record, grid: np.ndarray, step: float) -> Record:
    """Fewer samples: what is too fast for them is taken out first, or it would come back as slow motion."""
    from tsmblocks.data.filters import low_pass

    even = record if record.uniform else resampled(record)
    cutoff = PASSED * 0.5 / step
    smooth = {name: low_pass(record[name] if even is record else even[name], even.step, cutoff, 8) for name in record}
    signals = {name: interpolation(even.t, values, "cubic")(grid) for name, values in smooth.items()}
    note = (f"Resampled from {len(record)} to {len(grid)} samples, {step:g} s apart, after a zero-phase low-pass at "
            f"{cutoff:.4g} Hz.")  # fmt: skip
    return attrs.evolve(record, t=grid, signals=signals, notes=(*even.notes, note))


def interpolation(t: np.ndarray, x: np.ndarray, kind: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function of time that goes through the samples: ``"linear"`` or ``"cubic"`` (a spline)."""
    if kind == "linear":
        return lambda at: np.interp(at, t, x)
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, x)


def better_interpolation(t: np.ndarray, x: np.ndarray) -> str:
    """Whichever of linear and cubic foretells every second sample better from the others.

    A smooth motion is followed by the spline, which rings at the edges of a square wave.
    """
    if len(t) < 9:
        return "linear"
    inner = slice(1, len(t) - 1 - len(t) % 2, 2)
    errors = {
        kind: float(np.sum((interpolation(t[::2], x[::2], kind)(t[inner]) - x[inner]) ** 2))
        for kind in ("linear", "cubic")
    }
    return "cubic" if errors["cubic"] < errors["linear"] else "linear"
