"""A record on another time axis: interpolated, or decimated after a low-pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data.filters import low_pass
from tsmblocks.data.grid import better_interpolation, interpolation, refuse_not_finite

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

PASSBAND_SHARE = 0.7
"""Cut-off of the low-pass before decimation, as a share of the new Nyquist frequency. Chosen: of order 8 twice, it has
fallen far enough at the Nyquist frequency."""
MAX_SAMPLES = 50_000_000
"""Samples of a resampled record at most. Chosen: more is a step typed in the wrong unit, and a gigabyte."""


def evenly_sampled(record: Record) -> Record:
    """The record itself where its samples are evenly spaced, else resampled at its median step."""
    return record if record.uniform else resampled(record)


def resampled(record: Record, step: float | None = None) -> Record:
    """Return the record on an even grid; see Record.resampled."""
    own = record.step
    step = own if step is None else float(step)
    t = record.t
    if not 0 < step <= (t[-1] - t[0]) / 3:
        raise DataError(
            f"{record.called}: the new step must be above 0 s and at most a third of the record "
            f"({t[-1] - t[0]:g} s), got {step:g} s."
        )
    refuse_not_finite(record, record, "resampling")
    count = int((t[-1] - t[0]) / step * (1 + 1e-12) + 1e-6) + 1
    if count > MAX_SAMPLES:
        raise DataError(f"{record.called}: a step of {step:g} s makes {count} samples; is it in seconds?")
    grid = t[0] + step * np.arange(count)
    grid[-1] = min(grid[-1], t[-1])
    if step > 1.05 * own:
        return _decimated(record, grid, step)
    kinds = {name: better_interpolation(t, record[name]) for name in record}
    signals = {name: interpolation(t, record[name], kinds[name])(grid) for name in record}
    how = "; ".join(
        f"{kind}: {', '.join(found)}"
        for kind in ("cubic", "linear")
        if (found := [n for n in record if kinds[n] == kind])
    )
    note = f"Resampled from {len(t)} to {count} samples, {step:g} s apart (interpolated; {how})."
    return attrs.evolve(record, t=grid, signals=signals, notes=(*record.notes, note))


def _decimated(record: Record, grid: np.ndarray, step: float) -> Record:
    """Fewer samples, after a low-pass against aliasing."""
    even = evenly_sampled(record)
    cutoff = PASSBAND_SHARE * 0.5 / step
    smooth = {name: low_pass(record[name] if even is record else even[name], even.step, cutoff, 8) for name in record}
    signals = {name: interpolation(even.t, values, "cubic")(grid) for name, values in smooth.items()}
    note = (
        f"Resampled from {len(record)} to {len(grid)} samples, {step:g} s apart, after a zero-phase low-pass at "
        f"{cutoff:.4g} Hz."
    )
    return attrs.evolve(record, t=grid, signals=signals, notes=(*even.notes, note))
