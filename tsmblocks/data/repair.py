"""What may be wrong with measured numbers: each fault is repaired with a note, or refused with its row.

A repair is a function from a table, whose first column is the time in s, to a table. ``REPAIRS``
lists them in the order in which they act; a new one is one function and one entry.
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.data import dropouts, repair_time
from tsmblocks.data.signals import first_wrap
from tsmblocks.data.table import Table, noted, plural
from tsmblocks.errors import DataError
from tsmblocks.tables import listed

LONGEST_GAP = 3
"""Missing samples in a row that are interpolated; more would be inventing data."""
FEWEST = 4
"""Samples below which nothing can be said about a signal."""


def enough_samples(table: Table) -> Table:
    """Refuse a handful of samples: they are no measurement."""
    if len(table.values) < FEWEST:
        raise DataError(f"{table.origin}: only {plural(len(table.values), 'sample')} found; {FEWEST} are the least.")
    return table


def empty_columns_are_left_out(table: Table) -> Table:
    """Columns without unit and without any number are no sensor's: they go, where none asked for them and some stay."""
    empty = np.isnan(table.values).all(axis=0) & [not unit for unit in table.units]
    empty[0] = False
    empty &= [name not in table.asked for name in table.names]
    kept = np.flatnonzero(~empty)
    if not empty.any() or len(kept) < 2:
        return table
    gone = [table.column(int(k)) for k in np.flatnonzero(empty)]
    note = f"{listed(gone)} {'hold no number and were' if len(gone) > 1 else 'holds no number and was'} left out."
    return attrs.evolve(table, names=tuple(table.names[k] for k in kept), units=tuple(table.units[k] for k in kept),
                        places=tuple(table.places[k] for k in kept), values=table.values[:, kept],
                        notes=(*table.notes, f"{note[0].upper()}{note[1:]}"))  # fmt: skip


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
        note = (f"{table.names[k]}: {plural(count, 'missing number')} (row{'s' if count > 1 else ''} "
                f"{shown}) {'were' if count > 1 else 'was'} interpolated.")  # fmt: skip
        table = noted(table, values, table.rows, note)
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


def wraps_are_named(table: Table) -> Table:
    """Angles that jump by a turn are told: an encoder that wraps looks like that, and so may a reference."""
    notes = []
    for k in range(1, len(table.names)):
        found = first_wrap(table.values[:, k], table.units[k])
        if found is not None:
            at, count, turn = found
            unit = f" {table.units[k]}" if table.units[k] else ""
            more = f" and in {plural(count - 1, 'more place')}" if count > 1 else ""
            name = table.names[k]
            notes.append(f"{name} jumps by about a turn ({turn:g}{unit}) at row {table.rows[at]}{more}. If it is an "
                         f"encoder that wraps, unwrapped('{name}') joins the parts.")  # fmt: skip
    return attrs.evolve(table, notes=(*table.notes, *notes))


def constants_are_named(table: Table) -> Table:
    """Keep signals that never change, but say so: it is often a sensor that was not connected."""
    values = table.values[:, 1:]
    still = [k + 1 for k in np.flatnonzero(values.min(axis=0) == values.max(axis=0))] if values.size else []
    notes = [f"{table.names[k]} never changes (it is {table.values[0, k]:g} throughout)." for k in still]
    return attrs.evolve(table, notes=(*table.notes, *notes))


REPAIRS: tuple[Callable[[Table], Table], ...] = (
    empty_columns_are_left_out,
    repair_time.time_is_known,
    repair_time.time_moves,
    repair_time.backwards_is_turned,
    repair_time.disorder_is_sorted,
    repair_time.time_goes_forward,
    repair_time.repeats_are_merged,
    enough_samples,
    gaps_are_filled,
    repair_time.missing_rows_are_named,
    repair_time.jitter_is_measured,
    wraps_are_named,
    constants_are_named,
    dropouts.spikes_are_named,
    dropouts.dropouts_are_named,
)


def repaired(table: Table) -> Table:
    """Return the table after every repair. Raises DataError at the first fault that cannot be mended."""
    for repair in REPAIRS:
        table = repair(table)
    return table
