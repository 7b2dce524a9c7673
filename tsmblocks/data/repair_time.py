"""Faults of the time of a measurement: rows out of order, resets, missing rows, uneven steps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data.grid import MAX_JITTER, jitter_of, usual_step
from tsmblocks.data.table import Table, plural, rows_argument, rows_text

MAX_SORTED_DISTANCE = 8
"""Rows by which a late row may have to move to be sorted. Chosen: farther, it belongs to another recording."""
MAX_LATE_SHARE = 0.1
"""Share of the rows that may be late. Chosen: more is no accident of the logger."""
LONG_GAP = 10.0
"""Usual steps without a sample from which a gap is refused. Chosen: the inputs in between are then unknown."""
SHORT_GAP = 1.5
"""Usual steps without a sample from which samples are missing, rather than late. Derived: halfway to one missing."""
NOTABLE_DIFFERENCE = 5.0
"""Difference of two rows of one time, in rms differences of neighbouring samples, from which it is reported. Chosen."""


def refuse_missing_times(table: Table) -> Table:
    """Raise DataError for a row without a time."""
    missing = np.flatnonzero(np.isnan(table.values[:, 0]))
    if len(missing):
        place, count = f"row {table.rows[missing[0]]}", plural(len(missing), "such row")
        raise DataError(f"{table.origin}: {table.column(0)} has no number in {place} ({count}).")
    return table


def refuse_constant_time(table: Table) -> Table:
    """Raise DataError for a time that never changes: it is a wrong column."""
    t = table.values[:, 0]
    if len(t) > 1 and t.min() == t.max():
        raise DataError(
            f"{table.origin}: {table.column(0)} is {t[0]:g} s in all {len(t)} rows, so it cannot be the time. "
            "Map t to the column that is."
        )
    return table


def reverse_falling_times(table: Table) -> Table:
    """Rows in reverse order of time, newest first, are reversed."""
    if len(table.values) < 3 or not (np.diff(table.values[:, 0]) <= 0).all():
        return table
    note = "The time falls from row to row, the newest row coming first; the rows were reversed."
    return table.noted(note, values=table.values[::-1], rows=table.rows[::-1])


def sort_late_rows(table: Table) -> Table:
    """A few rows written a little late are sorted; anything else is refused by ``end_at_jump_back``.

    Sorting is a repair only where it gives no two rows the same time, as two recordings that overlap would have.
    """
    t = table.values[:, 0]
    late = np.flatnonzero(t < np.maximum.accumulate(t))
    if not len(late) or len(late) > max(1.0, MAX_LATE_SHARE * len(t)):
        return table
    order = np.argsort(t, kind="stable")
    places = int(np.abs(order - np.arange(len(t))).max())
    repeats = np.count_nonzero(np.diff(t[order]) == 0) - np.count_nonzero(np.diff(t) == 0)
    if places > MAX_SORTED_DISTANCE or repeats > 0:
        return table
    k = late[0]
    note = (
        f"{plural(len(late), 'row')} {'was' if len(late) == 1 else 'were'} out of order by up to "
        f"{plural(places, 'place')}, the first at row {table.rows[k]} ({t[k]:g} s after {t[k - 1]:g} s); "
        "the rows were sorted by time."
    )
    return table.noted(note, values=table.values[order], rows=table.rows[order])


def end_at_jump_back(table: Table) -> Table:
    """A time that jumps back separates two recordings (or a remainder of the logger): they are read one by one.

    With ``tail = "drop"`` the rows after the jump are left out.
    """
    t, rows = table.values[:, 0], table.rows
    back = np.flatnonzero(np.diff(t) < 0) + 1
    if not len(back):
        return table
    k = back[0]
    _refuse_lone_times(table, k, len(back))
    jump = f"ime jumps back at row {rows[k]}, from {t[k - 1]:g} s to {t[k]:g} s"
    share = f"{plural(len(t) - k, 'row')}, {100 * (len(t) - k) / len(t):.0f} %"
    if table.tail == "drop":
        note = f"T{jump}; everything from there on ({share}) was dropped, as requested."
        return table.noted(note, values=table.values[:k], rows=rows[:k])
    places = "" if len(back) == 1 else f", the first of {len(back)} such places"
    raise DataError(
        f"{table.origin}: t{jump}{places}. From there on ({share}) it is another recording or a tail. To keep the "
        f"first part, read rows {rows[0]} to {rows[k - 1]}: {rows_argument(rows[0], rows[k - 1])}; or drop the rest: "
        'tail="drop", or --tail drop.'
    )


def _refuse_lone_times(table: Table, k: int, places: int) -> None:
    """One wrong time among right ones is no tail: the row is named."""
    t, rows = table.values[:, 0], table.rows
    if k + 1 < len(t) and t[k - 1] < t[k + 1]:
        wrong = k
    elif k >= 2 and t[k - 2] < t[k]:
        wrong = k - 1
    else:
        return
    do = "Correct that row, or delete it." if places == 1 else f"There are {places} such places: correct the file."
    raise DataError(
        f"{table.origin}: the time in row {rows[wrong]} ({t[wrong]:g} s) does not fit between those of the "
        f"rows around it ({t[wrong - 1]:g} s and {t[wrong + 1]:g} s). {do}"
    )


def merge_repeated_times(table: Table) -> Table:
    """Rows with the time of the row before are replaced, group by group, by their mean."""
    t = table.values[:, 0]
    new = np.r_[True, np.diff(t) > 0]
    first, again = np.flatnonzero(new), np.flatnonzero(~new)
    if not len(again):
        return table
    known = np.isfinite(table.values)
    total = np.add.reduceat(np.where(known, table.values, 0.0), first, axis=0)
    count = np.add.reduceat(known.astype(float), first, axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 0, total / count, np.nan)
    mean[:, 0] = t[first]  # the mean of equal numbers is not always that number
    off = np.nan_to_num(np.abs(table.values[again, 1:] - table.values[first, 1:][np.cumsum(new)[again] - 1]))
    note = (
        f"{plural(len(again), 'row')} repeated the time of the row before ({rows_text(table.rows[again])})"
        f"{_largest_difference(table, again, off, mean)}; each group was replaced by its mean, leaving {len(first)} "
        f"of {len(t)} samples."
    )
    return table.noted(note, values=mean, rows=table.rows[first])


def _largest_difference(table: Table, again: np.ndarray, off: np.ndarray, mean: np.ndarray) -> str:
    """Largest difference between rows of one time, in the signal where it is largest relative to the motion."""
    if not off.any():
        return ", with the same values"
    with np.errstate(divide="ignore", invalid="ignore"):
        usual = np.sqrt(np.nanmean(np.diff(mean[:, 1:], axis=0) ** 2, axis=0)) if len(mean) > 1 else np.zeros(1)
        share = np.where(off.max(axis=0) > 0, off.max(axis=0) / usual, 0.0)
    k = int(np.argmax(share))
    worst = int(np.argmax(off[:, k]))
    size = f"{off[worst, k]:.3g} {table.units[k + 1]}".rstrip()
    far = ""
    if np.isinf(share[k]):
        far = ", while neighbouring samples do not differ"
    elif share[k] > NOTABLE_DIFFERENCE:
        far = f", {share[k]:.0f} times the difference of neighbouring samples"
    return f", their values up to {size} apart ({table.names[k + 1]}, row {table.rows[again[worst]]}{far})"


def note_missing_samples(table: Table) -> Table:
    """Places without samples: short ones are noted, long ones refused unless ``gaps = "keep"``.

    Across a long one the inputs are not known, so a run over it would be wrong without notice.
    """
    t, rows = table.values[:, 0], table.rows
    steps, usual = np.diff(t), usual_step(t)
    gaps, long = np.flatnonzero(steps > SHORT_GAP * usual), np.flatnonzero(steps > LONG_GAP * usual)
    if len(long) and table.gaps != "keep":
        k = long[0]
        more = f" (the first of {len(long)} such gaps)" if len(long) > 1 else ""
        raise DataError(
            f"{table.origin}: there are no samples between row {rows[k]} ({t[k]:g} s) and row {rows[k + 1]} "
            f"({t[k + 1]:g} s), {steps[k] / usual:.0f} times the usual step{more}. What happened in between is not "
            "known, so a run across it would be wrong. Read the rows before or after it: "
            f'{rows_argument(rows[0], rows[k])}; or keep it: gaps="keep", or --gaps keep.'
        )
    if not len(gaps):
        return table
    k = gaps[np.argmax(steps[gaps])]
    where, longest = ("one place", "It") if len(gaps) == 1 else (f"{len(gaps)} places", "The longest")
    kept = " Long gaps were kept, as requested." if len(long) else ""
    return table.noted(
        f"Samples are missing in {where}. {longest} lasts {steps[k] / usual:.1f} usual steps, before row "
        f"{rows[k + 1]} (from {t[k]:g} s to {t[k + 1]:g} s); signals are interpolated there.{kept}"
    )


def jitter(table: Table) -> Iterator[str]:
    """Uneven steps, which are kept as they were measured."""
    t = table.values[:, 0]
    steps = np.diff(t)
    steps = steps[steps <= SHORT_GAP * usual_step(t)]
    off = jitter_of(steps)
    if off > MAX_JITTER:
        yield (
            f"The steps between samples are uneven: {steps.min():.4g} s to {steps.max():.4g} s around "
            f"{np.median(steps):.4g} s (up to {100 * off:.0f} % off). resampled() gives an even grid."
        )
