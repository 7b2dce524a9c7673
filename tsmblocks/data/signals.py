"""Methods of ``Record`` for single signals: added, renamed, converted, angles unwrapped; and checks of signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, in_words

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


def unwrapped(self: Record, name: str, *, turn: float | None = None) -> Record:
    """Return the record with an angle made continuous: a step of more than half a turn counts as a wrap.

    Parameters
    ----------
    name : str
        The angle.
    turn : float or None, default None
        One turn in the signal's unit; known for rad, deg and rev.

    Returns
    -------
    Record
        The record with the continuous angle.

    Raises
    ------
    DataError
        When one turn is not known.
    """
    x, unit = self[name], self.unit(name)
    turn = turn if turn is not None else turn_in(unit)
    if turn is None:
        why = f"'{unit}' is no unit of angle" if unit else "it has no unit"
        raise DataError(f"{self.called}: one turn of '{name}' is not known, because {why}. Give it: turn = 360.")
    if not 0 < turn < np.inf:
        raise DataError(f"{self.called}: a turn must be a positive number, got {turn:g}.")
    joined = np.unwrap(x, period=turn)
    count = int(np.count_nonzero(np.diff(np.round((joined - x) / turn))))
    many = "1 jump of a turn was" if count == 1 else f"{count} jumps of a turn were"
    note = f"{name}: {many} joined (a turn is {f'{turn:g} {unit}'.strip()})."
    return self._changed(note, signals={**self.signals, name: joined})


def with_signal(self: Record, name: str, values: Any, unit: str = "") -> Record:
    """Return the record with a signal added or replaced.

    Parameters
    ----------
    name : str
        The signal.
    values : array_like, shape (N,)
        One finite number for each sample.
    unit : str, default ""
        Its unit.

    Returns
    -------
    Record
        The record with the signal.

    Raises
    ------
    DataError
        For another number of samples, and for samples that are not finite.
    """
    array = np.asarray(values, dtype=float)
    _refuse_length(self, name, array)
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise DataError(f"{self.called}: signal '{name}' holds {array[bad[0]]} in sample {bad[0]}.")
    note = f"{name} was {'replaced' if name in self else 'added'}."
    labels = {k: u for k, u in {**self.units, name: unit}.items() if u}
    filled = {k: mask for k, mask in self.filled.items() if k != name}
    return self._changed(note, signals={**self.signals, name: array}, units=labels, filled=filled)


def renamed(self: Record, names: Mapping[str, str]) -> Record:
    """Return the record with signals under other names.

    Parameters
    ----------
    names : mapping of str to str
        New names by the present ones: ``{"motor angle": "x_in"}``.

    Returns
    -------
    Record
        The record with the new names.

    Raises
    ------
    DataError
        For an unknown signal, and for a name that two signals would have.
    """
    _refuse_unknown(self, names)
    new = [names.get(k, k) for k in self]
    twice = next((k for k in new if new.count(k) > 1), None)
    if twice is not None:
        raise DataError(f"{self.called}: two signals would both be named '{twice}'.")
    changes = ", ".join(f"{a} is now {b}" for a, b in names.items())
    signals = dict(zip(new, self.signals.values(), strict=True))
    labels = {names.get(k, k): u for k, u in self.units.items()}
    filled = {names.get(k, k): mask for k, mask in self.filled.items()}
    return self._changed(f"Renamed: {changes}.", signals=signals, units=labels, filled=filled)


def converted(self: Record, wanted: Mapping[str, str]) -> Record:
    """Return the record with signals in other units.

    Parameters
    ----------
    wanted : mapping of str to str
        Units by signal: ``{"x_in": "rad"}``. A signal without a unit is taken to be in the one given.

    Returns
    -------
    Record
        The record in the new units.

    Raises
    ------
    DataError
        For an unknown signal or unit, and when units measure different things.
    """
    _refuse_unknown(self, wanted)
    for unit in wanted.values():
        try:
            units.parse(unit)
        except units.UnitError as error:
            raise DataError(f"{self.called}: {error}") from None
    signals = {**self.signals, **{k: self.values(k, unit) for k, unit in wanted.items()}}
    changes = ", ".join(
        f"{k} from {self.unit(k)} to {u}" if self.unit(k) else f"{k}, which had no unit, taken as {u}"
        for k, u in wanted.items()
    )
    return self._changed(f"Converted: {changes}.", signals=signals, units={**self.units, **wanted})


def _refuse_unknown(record: Record, names: Iterable[str]) -> None:
    for name in names:
        record[name]


def refuse_unsound(record: Record) -> None:
    """Raise DataError for signals of another length than the time, and for a unit of a misspelt signal.

    Units of signals that are not there are no mistake: one table of units serves many recordings.
    """
    if record.t.ndim != 1:
        raise DataError(f"{record.called}: the times must be one row of numbers, got {in_words(record.t)}.")
    for name, array in (*record.signals.items(), *record.filled.items()):
        _refuse_length(record, name, array)
    bare = [k for k in record.signals if k not in record.units]
    for lost in (k for k in record.units if k not in record.signals):
        if meant := get_close_matches(lost, bare, 1, MISSPELT_RATIO):
            raise DataError(
                f"{record.called}: a unit is given for '{lost}', which is no signal. Did you mean '{meant[0]}'?"
            )


def _refuse_length(record: Record, name: str, array: np.ndarray) -> None:
    if array.shape != record.t.shape:
        raise DataError(
            f"{record.called}: signal '{name}' must have one number for each of the {len(record)} samples, "
            f"got {in_words(array) if array.ndim > 1 else f'{array.size}'}."
        )
