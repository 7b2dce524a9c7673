"""A record on an even time axis: interpolated, or decimated after a low-pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.errors import DataError, in_words
from tsmblocks.common.interpolation import found_hold, interpolation
from tsmblocks.data.filters import low_pass
from tsmblocks.data.grid import mean_step, refuse_bad_times, refuse_not_finite

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

PASSBAND_SHARE = 0.7
"""Cut-off of the low-pass before decimation, as a share of the new Nyquist frequency. Chosen: of order 8 twice, it has
fallen far enough at the Nyquist frequency."""
MAX_SAMPLES = 50_000_000
"""Samples of a resampled record at most. Chosen: more is a step typed in the wrong unit, and a gigabyte."""


def evenly_sampled(record: Record) -> Record:
    """The record itself where its samples are evenly spaced, else resampled at its mean step."""
    return record if record.uniform else resampled(record)


def resampled(self: Record, step: float | None = None) -> Record:
    """Return the record on an even grid.

    Piecewise constant signals are held from sample to sample, and jump at the nearest instant of the new grid;
    others are interpolated by a cubic spline or linearly, whichever predicts samples better from their neighbours. When
    the new step is longer, a zero-phase low-pass at 0.7 of the new Nyquist frequency precedes it against aliasing.

    Parameters
    ----------
    step : float or None, default None
        Step [s], by default the mean step of the record without its gaps: a grid of another step would drift against
        the samples.

    Returns
    -------
    Record
        The record on the new grid.

    Raises
    ------
    DataError
        For a step that does not fit, and for samples that are not finite.
    """
    refuse_bad_times(self, "resampling")
    t, own = self.t, self.step
    step = mean_step(t) if step is None else float(step)
    span = float(t[-1]) - float(t[0])
    if not 0 < step <= span / 3:
        raise DataError(
            f"{self.called}: the new step must be above 0 s and at most a third of the record ({span:g} s), "
            f"got {step:g} s."
        )
    refuse_not_finite(self, self, "resampling")
    if span / step >= MAX_SAMPLES:
        raise DataError(f"{self.called}: a step of {step:g} s makes {span / step + 1:.12g} samples; is it in seconds?")
    count = int(span / step * (1 + 1e-12) + 1e-6) + 1
    grid = t[0] + step * np.arange(count)
    grid[-1] = min(grid[-1], t[-1])
    if step > 1.05 * own:
        return _decimated(self, grid, step)
    kinds = {name: found_hold(t, self[name]) for name in self}
    late = {"zero": step / 2}  # the last sample before an instant would put a jump off by up to a step, always late
    signals = {name: interpolation(t, self[name], kind)(grid + late.get(kind, 0.0)) for name, kind in kinds.items()}
    used = {kind: [name for name in kinds if kinds[name] == kind] for kind in ("cubic", "linear", "zero")}
    words = {"cubic": "cubic", "linear": "linear", "zero": "held"}
    how = "; ".join(f"{words[kind]}: {', '.join(names)}" for kind, names in used.items() if names)
    note = f"Resampled from {len(t)} to {count} samples, {step:g} s apart (interpolated; {how})."
    return self._changed(note, t=grid, signals=signals, filled=_filled_on(self, grid))


def _decimated(record: Record, grid: np.ndarray, step: float) -> Record:
    """Fewer samples, after a low-pass against aliasing."""
    even = evenly_sampled(record)
    cutoff = PASSBAND_SHARE * 0.5 / step
    smooth = {name: low_pass(even[name], even.step, cutoff, 8) for name in even}
    signals = {name: interpolation(even.t, values, "cubic")(grid) for name, values in smooth.items()}
    note = (
        f"Resampled from {len(record)} to {len(grid)} samples, {step:g} s apart, after a zero-phase low-pass at "
        f"{cutoff:.4g} Hz."
    )
    return even._changed(note, t=grid, signals=signals, filled=_filled_on(record, grid))


def decimated(self: Record, factor: int) -> Record:
    """Return the record at a step that is so many times as long, after a zero-phase low-pass against aliasing.

    Parameters
    ----------
    factor : int
        New step in steps of the record.

    Returns
    -------
    Record
        The record with fewer samples.

    Raises
    ------
    DataError
        For a factor below 1 or one that leaves no record, and for samples that are not finite.
    """
    if isinstance(factor, bool) or not isinstance(factor, int) or factor < 1:
        raise DataError(f"{self.called}: decimated takes a whole number of at least 1, got {in_words(factor)}.")
    return self if factor == 1 else resampled(self, factor * self.step)


def _filled_on(record: Record, grid: np.ndarray) -> dict[str, np.ndarray]:
    """Which samples on a new grid lie beside one that was not measured."""
    return {name: np.interp(grid, record.t, mask.astype(float)) > 0 for name, mask in record.filled.items()}
