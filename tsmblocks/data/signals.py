"""Changes of single signals of a record: added, renamed, converted, angles unwrapped."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, in_words, near

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

TURNS = (2 * np.pi, 360.0)
"""A turn in rad and in deg, for angles without a unit."""
MISSPELT_RATIO = 0.85
"""Similarity of two names (``difflib`` ratio) from which one is taken for the other misspelt. Chosen."""


def turn_in(unit: str) -> float | None:
    """Return one turn in this unit, or None when the unit is none of angle."""
    try:
        return units.factor("rev", unit) if unit else None
    except units.UnitError:
        return None


def first_wrap(x: np.ndarray, unit: str) -> tuple[int, int, float] | None:
    """Where an angle jumps by about a turn: index after the first jump, number of jumps, the turn in its unit.

    An encoder that wraps stays within one turn, crosses it in one sample and moves little in the others. A square wave
    of that height does the same, so this is a note and no repair.
    """
    own, size = turn_in(unit), float(np.abs(x).max(initial=0.0))
    for turn in (own,) if own else () if unit else TURNS:
        if not 0.4 * turn < size < 2 * turn:
            continue
        jumps, span = np.abs(np.diff(x)), float(np.ptp(x))
        far = np.flatnonzero(jumps > 0.8 * turn)
        moves = np.count_nonzero(jumps) > 3 * len(far) and np.median(jumps) < 0.1 * turn
        if len(far) and moves and span <= 1.02 * turn:
            return int(far[0]) + 1, len(far), turn
    return None


def unwrapped(record: Record, name: str, turn: float | None = None) -> Record:
    """See Record.unwrapped."""
    x, unit = record[name], record.unit(name)
    turn = turn if turn is not None else turn_in(unit)
    if turn is None:
        why = f"'{unit}' is no unit of angle" if unit else "it has no unit"
        raise DataError(f"{record.called}: one turn of '{name}' is not known, because {why}. Give it: turn = 360.")
    if not 0 < turn < np.inf:
        raise DataError(f"{record.called}: a turn must be a positive number, got {turn:g}.")
    joined = np.unwrap(x, period=turn)
    count = int(np.count_nonzero(np.diff(np.round((joined - x) / turn))))
    many = "1 jump of a turn was" if count == 1 else f"{count} jumps of a turn were"
    note = f"{name}: {many} joined (a turn is {f'{turn:g} {unit}'.strip()})."
    return attrs.evolve(record, signals={**record.signals, name: joined}, notes=(*record.notes, note))


def with_signal(record: Record, name: str, values: Any, unit: str = "") -> Record:
    """Return the record with one signal more; see Record.with_signal."""
    array = np.asarray(values, dtype=float)
    _fits(record, name, array)
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise DataError(f"{record.called}: signal '{name}' holds {array[bad[0]]} in sample {bad[0]}.")
    note = f"{name} was {'replaced' if name in record else 'added'}."
    labels = {**{k: u for k, u in record.units.items() if k != name}, **({name: unit} if unit else {})}
    return attrs.evolve(record, signals={**record.signals, name: array}, units=labels, notes=(*record.notes, note))


def checked(record: Record) -> None:
    """Raise DataError for signals of another length than the time, and for a unit of a misspelt signal.

    Units of signals that are not there are no mistake: one table of units serves many recordings.
    """
    if record.t.ndim != 1:
        raise DataError(f"{record.called}: the times must be one row of numbers, got {in_words(record.t)}.")
    for name, array in record.signals.items():
        _fits(record, name, array)
    bare = [k for k in record.signals if k not in record.units]
    for lost in (k for k in record.units if k not in record.signals):
        meant = get_close_matches(lost, bare, 1, MISSPELT_RATIO)
        if meant:
            raise DataError(
                f"{record.called}: a unit is given for '{lost}', which is no signal. Did you mean '{meant[0]}'?"
            )


def _fits(record: Record, name: str, array: np.ndarray) -> None:
    if array.shape != record.t.shape:
        raise DataError(
            f"{record.called}: signal '{name}' must have one number for each of the {len(record)} samples, "
            f"got {in_words(array) if array.ndim > 1 else f'{array.size}'}."
        )


def renamed(record: Record, names: Mapping[str, str]) -> Record:
    """Return the record with signals under other names; see Record.renamed."""
    _refuse_unknown(record, names)
    new = [names.get(k, k) for k in record]
    twice = next((k for k in new if new.count(k) > 1), None)
    if twice is not None:
        raise DataError(f"{record.called}: two signals would both be named '{twice}'.")
    changes = ", ".join(f"{a} is now {b}" for a, b in names.items())
    signals = dict(zip(new, record.signals.values(), strict=True))
    labels = {names.get(k, k): u for k, u in record.units.items()}
    return attrs.evolve(record, signals=signals, units=labels, notes=(*record.notes, f"Renamed: {changes}."))


def converted(record: Record, wanted: Mapping[str, str]) -> Record:
    """Return the record with signals in other units; see Record.converted."""
    _refuse_unknown(record, wanted)
    for unit in wanted.values():
        try:
            units.parse(unit)
        except units.UnitError as error:
            raise DataError(f"{record.called}: {error}") from None
    signals = {**record.signals, **{k: record.values(k, unit) for k, unit in wanted.items()}}
    changes = ", ".join(
        f"{k} from {record.unit(k)} to {u}" if record.unit(k) else f"{k}, which had no unit, taken as {u}"
        for k, u in wanted.items()
    )
    labels = {**record.units, **wanted}
    return attrs.evolve(record, signals=signals, units=labels, notes=(*record.notes, f"Converted: {changes}."))


def _refuse_unknown(record: Record, names: Mapping[str, str]) -> None:
    for name in names:
        if name not in record:
            raise DataError(f"{record.called}: there is no signal '{name}'.{near(name, record.names)}")
