"""Faults of measured numbers: each is repaired with a note, reported, or refused with its row.

A repair is a function from a table, whose first column is the time in s, to a table; a report yields notes. ``REPAIRS``
and ``REPORTS`` list them in the order in which they act; a new one is one function and one entry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.common.tables import listed
from tsmblocks.data import repair_time
from tsmblocks.data.grid import MIN_RECORD_SAMPLES, stretches
from tsmblocks.data.signals import first_wrap
from tsmblocks.data.table import Table, plural, rows_text

MAX_FILLED_GAP = 3
"""Missing samples in a row that are interpolated at most. Chosen: more would be invented data."""
SPIKE_DISTANCE = 0.5
"""Distance of a spike from the range of all other samples, as a share of that range. Chosen."""
MAX_SPIKE_SHARE = 0.005
"""Share of the samples up to which they are spikes, and not part of the measurement. Chosen."""
MAX_SPIKE_SAMPLES = 2
"""Samples in a row of a spike at most. Chosen: longer ones may be motion."""
FAULT_STEP_RATIO = 3.0
"""Steps to a fault and back, as a multiple of the largest step elsewhere. Chosen."""
MIN_SPIKE_RECORD = 50
"""Samples below which no spike is searched. Chosen: the range of fewer is not known well enough."""
MAX_SQUARABLE = 1e150
"""Magnitude up to which squares are finite in double precision (largest number 1.8e308)."""
MIN_DROPOUT = 20
"""Equal samples in a row from which a noisy sensor has dropped out. Chosen."""
MAX_EQUAL_SHARE = 0.02
"""Share of equal neighbours elsewhere up to which a signal never rests, and is not rounded either. Chosen."""
MIN_TURN_SHARE = 0.4
"""Share of sign changes in the second differences of a signal from which it is noisy. Chosen, below the two in three of
white noise."""


def refuse_few_samples(table: Table) -> Table:
    """Raise DataError for too few samples."""
    if len(table.values) < MIN_RECORD_SAMPLES:
        count = plural(len(table.values), "sample")
        raise DataError(f"{table.origin}: only {count} found; {MIN_RECORD_SAMPLES} are the least.")
    return table


def drop_empty_columns(table: Table) -> Table:
    """Columns without unit and without any number are left out, unless they were named or no other would remain."""
    empty = np.isnan(table.values).all(axis=0) & [not unit for unit in table.units]
    empty &= [k > 0 and name not in table.requested for k, name in enumerate(table.names)]
    kept = np.flatnonzero(~empty)
    if not empty.any() or len(kept) < 2:
        return table
    gone = listed([table.column(int(k)) for k in np.flatnonzero(empty)])
    note = f"{gone} {'hold no number and were' if empty.sum() > 1 else 'holds no number and was'} left out."
    table = table.noted(f"{note[0].upper()}{note[1:]}", table.values[:, kept])
    return attrs.evolve(
        table,
        names=tuple(table.names[k] for k in kept),
        units=tuple(table.units[k] for k in kept),
        places=tuple(table.places[k] for k in kept),
    )


def fill_gaps(table: Table) -> Table:
    """Short runs of missing numbers are interpolated in time; longer ones and those at an end are refused."""
    for k in range(1, len(table.names)):
        missing = np.isnan(table.values[:, k])
        if not missing.any():
            continue
        _refuse_long_gaps(table, k, missing)
        t, values = table.values[:, 0], table.values.copy()
        values[missing, k] = np.interp(t[missing], t[~missing], values[~missing, k])
        count = int(missing.sum())
        note = (
            f"{table.names[k]}: {plural(count, 'missing number')} ({rows_text(table.rows[missing])}) "
            f"{'were' if count > 1 else 'was'} interpolated."
        )
        table = attrs.evolve(table.noted(note, values=values), filled={**table.filled, table.names[k]: missing})
    return table


def _refuse_long_gaps(table: Table, k: int, missing: np.ndarray) -> None:
    for a, b in stretches(missing):
        at_end = a == 0 or b == len(missing)
        if b - a <= MAX_FILLED_GAP and not at_end:
            continue
        first, last = table.rows[a], table.rows[b - 1]
        where = f"row {first}" if b - a == 1 else f"rows {first} to {last}"
        if b - a == len(missing):
            why = "It is empty throughout: map another column"
        elif at_end:
            why = f"At the {'start' if a == 0 else 'end'} there is nothing to interpolate from: read fewer rows"
        else:
            why = f"At most {MAX_FILLED_GAP} samples are interpolated: read the rows before or after"
        place = f"{table.origin}: {table.column(k)}"
        raise DataError(f"{place} has no number in {where}. {why}, leave the column out, or correct the file.")


# ---- reports


def wraps(table: Table) -> Iterator[str]:
    """Angles that jump by a turn: an encoder that wraps looks like that, and so may a reference."""
    for (name, values), unit in zip(table.signals(), table.units[1:], strict=True):
        if (found := first_wrap(values, unit)) is not None:
            at, count, turn = found
            more = f" and in {plural(count - 1, 'more place')}" if count > 1 else ""
            yield (
                f"{name} jumps by about a turn ({f'{turn:g} {unit}'.strip()}) at row {table.rows[at]}{more}. If it is "
                f"an encoder that wraps, unwrapped('{name}') joins the parts."
            )


def constants(table: Table) -> Iterator[str]:
    """Constant signals: often a sensor was not connected."""
    for name, values in table.signals():
        if values.min() == values.max():
            yield f"{name} never changes (it is {values[0]:g} throughout)."


def spikes(table: Table) -> Iterator[str]:
    """One or two samples in a row far off all others, which a fit would follow."""
    for name, values in table.signals():
        at = _spikes(values)
        if not len(at):
            continue
        shown = ", ".join(f"row {table.rows[i]}: {values[i]:g}" for i in at[:3]) + (", …" if len(at) > 3 else "")
        rest = np.delete(values, at)
        yield (
            f"{name} has {plural(len(at), 'spike')} ({shown}) far off all other samples, which are between "
            f"{rest.min():g} and {rest.max():g}. A true pulse may be that short. A false one affects all results: "
            "empty its cell, and it is interpolated."
        )


def dropouts(table: Table) -> Iterator[str]:
    """Equal samples in a signal that is noisy everywhere else: its sensor may not have measured."""
    t, rows = table.values[:, 0], table.rows
    for name, values in table.signals():
        a, b = _longest_rest(values)
        rest = np.delete(values, slice(a, b + 1))
        if b - a >= MIN_DROPOUT and _is_noisy(rest) and not _clipped(values, a, b, rest):
            yield (
                f"{name} is constant at {values[a]:g} from {t[a]:g} s to {t[b]:g} s (rows {rows[a]} to {rows[b]}), and "
                "noisy elsewhere. Either it was at rest, or its sensor dropped out; then leave this time out: part, or "
                "--rows and --window."
            )


def _spikes(values: np.ndarray) -> np.ndarray:
    """Where spikes are, in order; empty where there are none, or more than a few."""
    few = max(int(MAX_SPIKE_SHARE * len(values)), 1)
    if len(values) < MIN_SPIKE_RECORD or not np.abs(values).max() < MAX_SQUARABLE:
        return np.array([], dtype=int)
    middle = np.sort(values)[few:-few]
    reach = float(np.ptp(middle))
    far = (values > middle.max() + SPIKE_DISTANCE * reach) | (values < middle.min() - SPIKE_DISTANCE * reach)
    first, after = stretches(far).T
    few_and_short = 0 < far.sum() <= few and int((after - first).max()) <= MAX_SPIKE_SAMPLES
    if not (reach > 0 and few_and_short and first[0] > 0 and after[-1] < len(values)):
        return np.array([], dtype=int)
    usual = float(np.abs(np.diff(values[~far])).max())
    sudden = min(np.abs(values[first] - values[first - 1]).min(), np.abs(values[after - 1] - values[after]).min())
    return np.flatnonzero(far) if sudden > FAULT_STEP_RATIO * usual else np.array([], dtype=int)


def _longest_rest(values: np.ndarray) -> tuple[int, int]:
    """First and last sample of the longest run of equal ones."""
    starts = np.r_[0, np.flatnonzero(values[1:] != values[:-1]) + 1, len(values)]
    k = int(np.argmax(np.diff(starts)))
    return int(starts[k]), int(starts[k + 1]) - 1


def _clipped(values: np.ndarray, first: int, last: int, rest: np.ndarray) -> bool:
    """Whether a signal approaches one of its ends without a step: a limit, which a diagnosis may find."""
    if rest.min() < values[first] < rest.max():
        return False
    edges = [(first - 1, first), (last, last + 1)]
    steps = [abs(float(values[b] - values[a])) for a, b in edges if a >= 0 and b < len(values)]
    return max(steps, default=0.0) <= FAULT_STEP_RATIO * float(np.quantile(np.abs(np.diff(rest)), 0.99))


def _is_noisy(values: np.ndarray) -> bool:
    """Whether a signal turns as noise does, and its neighbouring samples are hardly ever equal."""
    if len(values) < 2 * MIN_DROPOUT or float(np.mean(np.diff(values) == 0)) > MAX_EQUAL_SHARE:
        return False
    bends = np.diff(values, 2)
    return float(np.mean(bends[1:] * bends[:-1] < 0)) >= MIN_TURN_SHARE


REPAIRS: tuple[Callable[[Table], Table], ...] = (
    drop_empty_columns,
    repair_time.refuse_missing_times,
    repair_time.refuse_constant_time,
    repair_time.reverse_falling_times,
    repair_time.sort_late_rows,
    repair_time.end_at_jump_back,
    repair_time.merge_repeated_times,
    refuse_few_samples,
    fill_gaps,
    repair_time.note_missing_samples,
)
REPORTS: tuple[Callable[[Table], Iterator[str]], ...] = (repair_time.jitter, wraps, constants, spikes, dropouts)


def repaired(table: Table) -> Table:
    """Return the table after every repair. Raises DataError at the first fault that cannot be repaired."""
    for repair in REPAIRS:
        table = repair(table)
    for report in REPORTS:
        for note in report(table):
            table = table.noted(note)
    return table
