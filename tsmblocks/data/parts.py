"""Parts of a record: a span of time, training and validation data, one period after another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data.grid import MIN_RECORD_SAMPLES
from tsmblocks.data.periods import find_period

if TYPE_CHECKING:
    from tsmblocks.data.record import Record


def part(record: Record, start: float | None = None, stop: float | None = None) -> Record:
    """Return the samples from start to stop; see Record.part."""
    t = record.t
    first, last = (t[0] if start is None else start), (t[-1] if stop is None else stop)
    kept = (t >= first) & (t <= last)
    count = np.count_nonzero(kept)
    if count < MIN_RECORD_SAMPLES:
        raise DataError(
            f"{record.called}: only {count} samples lie between {first:g} s and {last:g} s; "
            f"{MIN_RECORD_SAMPLES} are the least. The record is from {t[0]:g} s to {t[-1]:g} s."
        )
    return _samples_of(record, kept)


def _samples_of(record: Record, kept: np.ndarray) -> Record:
    """The record with some of its samples (a mask), and a note on their span."""
    t = record.t[kept]
    span = f"{t[0]:g} s to {t[-1]:g} s"
    note = f"Only {span} ({len(t)} of {len(record)} samples)."
    signals = {k: x[kept] for k, x in record.signals.items()}
    return attrs.evolve(record, name=f"{record.name}, {span}", t=t, signals=signals, notes=(*record.notes, note))


def split(record: Record, fraction: float = 0.5, at: float | None = None) -> tuple[Record, Record]:
    """Return what comes before an instant, and the rest; see Record.split."""
    t = record.t
    if at is None and not 0 < fraction < 1:
        raise DataError(
            f"{record.called}: the share of the first part must lie between 0 and 1, got {fraction:g}. "
            "For a time in s write split(at=…)."
        )
    boundary = t[0] + fraction * (t[-1] - t[0]) if at is None else at
    before = t < boundary
    smaller = min(np.count_nonzero(before), np.count_nonzero(~before))
    if smaller < MIN_RECORD_SAMPLES:
        raise DataError(
            f"{record.called}: a split at {boundary:g} s leaves {smaller} samples on one side; "
            f"{MIN_RECORD_SAMPLES} are the least. The record is from {t[0]:g} s to {t[-1]:g} s."
        )
    return _samples_of(record, before), _samples_of(record, ~before)


def period(record: Record, name: str | None = None) -> float | None:
    """Return the period of a signal, or of the one that repeats itself best; see Record.period."""
    names = record.names if name is None else (name,)
    found = [p for k in names if (p := find_period(record.t, record[k])) is not None]
    return min(found, key=lambda pair: pair[1])[0] if found else None


def periods(record: Record, name: str | None = None) -> tuple[Record, ...]:
    """Return the whole periods one by one; see Record.periods."""
    length = period(record, name)
    if length is None:
        what = f"'{name}' does not repeat itself" if name else "no signal repeats itself"
        raise DataError(f"{record.called}: {what} at least twice, so there are no periods.")
    t = record.t
    count = int((t[-1] - t[0] + record.step) / length + 1e-6)
    place = np.floor((t - t[0]) / length + 1e-6)
    return tuple(_samples_of(record, place == k) for k in range(count))
