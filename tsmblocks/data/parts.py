"""Methods of ``Record`` for parts of it: a span of time, training and validation data, one period after another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data.grid import MIN_RECORD_SAMPLES
from tsmblocks.data.periods import best_period

if TYPE_CHECKING:
    from tsmblocks.data.record import Record


def part(self: Record, start: float | None = None, stop: float | None = None) -> Record:
    """Return the samples of a span of time.

    Parameters
    ----------
    start, stop : float or None, default None
        Ends of the span [s], both included; None is the end of the record.

    Returns
    -------
    Record
        The samples inside.

    Raises
    ------
    DataError
        When fewer than 4 remain.
    """
    t = self.t
    first, last = (t[0] if start is None else start), (t[-1] if stop is None else stop)
    kept = (t >= first) & (t <= last)
    count = int(kept.sum())
    _refuse_few(self, count, f"only {count} samples lie between {first:g} s and {last:g} s")
    return _samples_of(self, kept)


def split(self: Record, fraction: float = 0.5, *, at: float | None = None) -> tuple[Record, Record]:
    """Return two records, such as training and validation data: before a border, and from it on.

    Parameters
    ----------
    fraction : float, default 0.5
        Where the border lies, as a share of the time; between 0 and 1.
    at : float or None, default None
        Time of the border [s], in place of ``fraction``.

    Returns
    -------
    tuple of Record
        The two parts.

    Raises
    ------
    DataError
        When fewer than 4 samples are on one side.
    """
    t = self.t
    if at is None and not 0 < fraction < 1:
        raise DataError(
            f"{self.called}: the share of the first part must lie between 0 and 1, got {fraction:g}. "
            "For a time in s write split(at=…)."
        )
    border = t[0] + fraction * (t[-1] - t[0]) if at is None else at
    before = t < border
    smaller = int(min(before.sum(), (~before).sum()))
    _refuse_few(self, smaller, f"a split at {border:g} s leaves {smaller} samples on one side")
    return _samples_of(self, before), _samples_of(self, ~before)


def period(self: Record, name: str | None = None) -> float | None:
    """Return the period of a signal.

    Parameters
    ----------
    name : str or None, default None
        The signal, by default the one that repeats itself best.

    Returns
    -------
    float or None
        Period [s]; None when the record has no two periods alike.

    Raises
    ------
    DataError
        For an unknown signal.
    """
    return best_period(self.t, [self[k] for k in (self.names if name is None else (name,))])


def periods(self: Record, name: str | None = None) -> tuple[Record, ...]:
    """Return the whole periods of a signal that repeats itself, one record each.

    Parameters
    ----------
    name : str or None, default None
        The signal, by default the one that repeats itself best.

    Returns
    -------
    tuple of Record
        The periods in order.

    Raises
    ------
    DataError
        When nothing repeats itself.
    """
    length = period(self, name)
    if length is None:
        what = f"'{name}' does not repeat itself" if name else "no signal repeats itself"
        raise DataError(f"{self.called}: {what} at least twice, so there are no periods.")
    t = self.t
    count = int((t[-1] - t[0] + self.step) / length + 1e-6)
    place = np.floor((t - t[0]) / length + 1e-6)
    return tuple(_samples_of(self, place == k) for k in range(count))


def _refuse_few(record: Record, count: int, cut: str) -> None:
    if count < MIN_RECORD_SAMPLES:
        raise DataError(
            f"{record.called}: {cut}; {MIN_RECORD_SAMPLES} are the least. "
            f"The record is from {record.t[0]:g} s to {record.t[-1]:g} s."
        )


def _samples_of(record: Record, kept: np.ndarray) -> Record:
    """The record with some of its samples (a mask), and a note on their span."""
    t = record.t[kept]
    span = f"{t[0]:g} s to {t[-1]:g} s"
    note = f"Only {span} ({len(t)} of {len(record)} samples)."
    signals = {k: x[kept] for k, x in record.signals.items()}
    filled = {k: mask[kept] for k, mask in record.filled.items()}
    return record._changed(note, name=f"{record.name}, {span}", t=t, signals=signals, filled=filled)
