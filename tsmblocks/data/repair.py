"""What may be wrong with measured numbers: each fault is repaired with a note, or refused with its row.

A repair is a function from a table, whose first column is the time in s, to a table. ``REPAIRS``
lists them in the order in which they act; a new one is one function and one entry.
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.data.table import Table
from tsmblocks.errors import DataError

LONGEST_GAP = 3
"""Missing samples in a row that are interpolated; more would be inventing data."""
FEWEST = 4
"""Samples below which nothing can be said about a signal."""


def _noted(table: Table, values: np.ndarray, rows: np.ndarray, note: str) -> Table:
    return attrs.evolve(table, values=values, rows=rows, notes=(*table.notes, note))


def _plural(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def time_is_known(table: Table) -> Table:
    """Every row must have a time: without it nothing else in the row has a place."""
    missing = np.flatnonzero(np.isnan(table.values[:, 0]))
    if len(missing):
        raise DataError(f"{table.origin}: {table.column(0)} has no number in row {table.rows[missing[0]]}"
                        f" ({_plural(len(missing), 'such row')}).")  # fmt: skip
    return table


def time_moves(table: Table) -> Table:
    """Time that never changes is a wrong column."""
    t = table.values[:, 0]
    if len(t) > 1 and t.min() == t.max():
        raise DataError(f"{table.origin}: {table.column(0)} is {t[0]:g} s in all {len(t)} rows, so it cannot "
                        "be the time. Map t to the column that is.")  # fmt: skip
    return table


def time_goes_forward(table: Table) -> Table:
    """Time that jumps back separates two recordings (or a tail the logger left): they are read one by one."""
    t, rows = table.values[:, 0], table.rows
    back = np.flatnonzero(np.diff(t) < 0) + 1
    if not len(back):
        return table
    k = back[0]
    places = "" if len(back) == 1 else f", the first of {len(back)} such places"
    rest = len(t) - k
    raise DataError(
        f"{table.origin}: time jumps back at row {rows[k]}, from {t[k - 1]:g} s to {t[k]:g} s{places}. "
        f"From there on ({_plural(rest, 'row')}, {100 * rest / len(t):.0f} %) it is another recording "
        f"or a tail. To keep the first part, read rows {rows[0]} to {rows[k - 1]}: "
        f"rows=({rows[0]}, {rows[k - 1]}), or --rows {rows[0]}:{rows[k - 1]}."
    )


def repeats_are_merged(table: Table) -> Table:
    """Rows with the time of the row before are replaced, group by group, by their mean."""
    t = table.values[:, 0]
    first = np.flatnonzero(np.r_[True, np.diff(t) > 0])
    if len(first) >= len(t):
        return table
    known = np.isfinite(table.values)
    total = np.add.reduceat(np.where(known, table.values, 0.0), first, axis=0)
    count = np.add.reduceat(known.astype(float), first, axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 0, total / count, np.nan)
    mean[:, 0] = t[first]  # the mean of equal numbers is not always that number
    note = (f"{_plural(len(t) - len(first), 'row')} repeated the time of the row before; each group was "
            f"replaced by its mean, leaving {len(first)} of {len(t)} samples.")  # fmt: skip
    return _noted(table, mean, table.rows[first], note)


def enough_samples(table: Table) -> Table:
    """Refuse a handful of samples: they are no measurement."""
    if len(table.values) < FEWEST:
        raise DataError(f"{table.origin}: only {_plural(len(table.values), 'sample')} found; {FEWEST} are the least.")
    return table


def gaps_are_filled(table: Table) -> Table:
    """Short runs of missing numbers are interpolated in time; longer ones and those at an end are refused."""
    for k in range(1, len(table.names)):
        missing = np.isnan(table.values[:, k])
        if not missing.any():
            continue
        _refuse_long_gaps(table, k, missing)
        t, values = table.values[:, 0], table.values.copy()
        values[missing, k] = np.interp(t[missing], t[~missing], values[~missing, k])
        shown = ", ".join(map(str, table.rows[missing][:5])) + (", …" if missing.sum() > 5 else "")
        count = int(missing.sum())
        note = (f"{table.names[k]}: {_plural(count, 'missing number')} (row{'s' if count > 1 else ''} "
                f"{shown}) {'were' if count > 1 else 'was'} interpolated.")  # fmt: skip
        table = _noted(table, values, table.rows, note)
    return table


def _refuse_long_gaps(table: Table, k: int, missing: np.ndarray) -> None:
    edges = np.flatnonzero(np.diff(np.r_[False, missing, False].astype(int)))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        at_end = a == 0 or b == len(missing)
        if b - a <= LONGEST_GAP and not at_end:
            continue
        first, last = table.rows[a], table.rows[b - 1]
        where = f"row {first}" if b - a == 1 else f"rows {first} to {last}"
        if b - a == len(missing):
            why = "It is empty throughout: map another column"
        elif at_end:
            why = f"At the {'start' if a == 0 else 'end'} there is nothing to interpolate from: read fewer rows"
        else:
            why = f"At most {LONGEST_GAP} samples are interpolated: read the rows before or after"
        place = f"{table.origin}: {table.column(k)}"
        raise DataError(f"{place} has no number in {where}. {why}, leave the column out, or correct the file.")


def constants_are_named(table: Table) -> Table:
    """Keep signals that never change, but say so: it is often a sensor that was not connected."""
    values = table.values[:, 1:]
    still = [k + 1 for k in np.flatnonzero(values.min(axis=0) == values.max(axis=0))] if values.size else []
    notes = [f"{table.names[k]} never changes (it is {table.values[0, k]:g} throughout)." for k in still]
    return attrs.evolve(table, notes=(*table.notes, *notes))


REPAIRS: tuple[Callable[[Table], Table], ...] = (
    time_is_known, time_moves, time_goes_forward, repeats_are_merged, enough_samples, gaps_are_filled,
    constants_are_named,
)  # fmt: skip


def repaired(table: Table) -> Table:
    """Return the table after every repair. Raises DataError at the first fault that cannot be mended."""
    for repair in REPAIRS:
        table = repair(table)
    return table
