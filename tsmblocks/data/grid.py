"""The time axis of a record: its step, and how even it is."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common.errors import DataError

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

MIN_RECORD_SAMPLES = 4
"""Samples of a recording, or of a part of one, at least. Chosen: a cubic spline needs as many."""
MAX_JITTER = 0.01
"""Deviation of a step from the median, in steps, up to which samples count as evenly spaced. Chosen: what loggers that
round their times to a hundredth of the step make of an even grid."""

GAP_SHARE = 0.5
"""Deviation of a step from the median, in steps, from which it is a gap or a repeat. Chosen: half of a lost sample."""


def step_of(t: np.ndarray) -> float:
    """Median step [s]."""
    return float(np.median(np.diff(t)))


def mean_step(t: np.ndarray) -> float:
    """Mean step [s], without gaps: the median of steps with rounded or scattered times may be off by a share of it."""
    steps = np.diff(t)
    return float(np.mean(steps[np.abs(steps / np.median(steps) - 1) < GAP_SHARE]))


def jitter_of(steps: np.ndarray) -> float:
    """Largest deviation of a step from the median step, as a share of it (0 is a perfectly even grid)."""
    return float(np.abs(steps / np.median(steps) - 1).max())


def is_even(t: np.ndarray) -> bool:
    """Whether samples are evenly spaced."""
    return jitter_of(np.diff(t)) <= MAX_JITTER


def usual_step(t: np.ndarray) -> float:
    """Return the 90 % quantile of the steps [s], at least their median: longer steps of uneven samples may be gaps."""
    steps = np.diff(t)
    return float(max(np.median(steps), np.quantile(steps, 0.9, method="lower")))


def stretches(chosen: np.ndarray) -> np.ndarray:
    """First index of each run of True in a mask (n,), and the index after its last one; shape (runs, 2)."""
    return np.flatnonzero(np.diff(np.r_[False, chosen, False].astype(int))).reshape(-1, 2)


def refuse_uneven(record: Record, what: str) -> None:
    """Raise DataError unless the samples are evenly spaced; ``what`` (filtering) needs it."""
    if not record.uniform:
        raise DataError(
            f"{record.called}: {what} needs evenly spaced samples, but steps are up to "
            f"{100 * record.jitter:.0f} % off {record.step:.4g} s. Call resampled() first."
        )


def refuse_bad_times(record: Record, what: str) -> None:
    """Raise DataError unless there are several samples at finite times that increase; ``what`` needs them."""
    t = record.t
    if len(t) < 2:
        raise DataError(f"{record.called}: {what} needs several samples, and there are {len(t)}.")
    bad = np.flatnonzero(~np.isfinite(t))
    if not len(bad):
        bad = np.flatnonzero(np.diff(t) <= 0) + 1
    if len(bad):
        raise DataError(
            f"{record.called}: the time of sample {bad[0]} is {t[bad[0]]:g} s, and {what} needs times that increase."
        )


def refuse_not_finite(record: Record, names: Iterable[str], what: str) -> None:
    """Raise DataError for samples of these signals that are not finite; ``what`` (filtering) would spread them."""
    for name in names:
        bad = np.flatnonzero(~np.isfinite(record[name]))
        if len(bad):
            k = int(bad[0])
            raise DataError(
                f"{record.called}: sample {k} of {name} is not finite (t = {record.t[k]:g} s, value = "
                f"{record[name][k]:g}), and {what} needs every sample."
            )
