"""From a file to a record: which reader, which columns under which names, then the repairs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units as unit_labels
from tsmblocks.common.errors import DataError, clip, in_words, near
from tsmblocks.common.tables import listed
from tsmblocks.common.units import heading, split_heading
from tsmblocks.data import containers, text
from tsmblocks.data.grid import usual_step
from tsmblocks.data.missing_units import how_to_map
from tsmblocks.data.record import Record
from tsmblocks.data.repair import repaired
from tsmblocks.data.table import Rows, Source, Table

_READERS = {
    ".npy": containers.open_npy,
    ".npz": containers.open_npz,
    ".mat": containers.open_mat,
    ".h5": containers.open_hdf5,
    ".hdf5": containers.open_hdf5,
}
TIMES = ("t", "time", "timestamp", "seconds", "tout")
"""Names of a time column, whatever their case, best first."""


SLOW = 0.5
"""Time from row to row from which a time without a unit is doubted to be in seconds [s]."""
MANY = 50
"""Rows from which that is worth a word."""
TAILS = ("refuse", "drop")
GAPS = ("refuse", "keep")


def _names(given: Iterable[str] | None) -> tuple[str, ...] | None:
    """Names from one of them or several, which may be read only once."""
    return (given,) if isinstance(given, str) else None if given is None else tuple(given)


@attrs.frozen
class Wish:
    """What a caller says about a file: names, units, parts, and what to do with its faults. See read."""

    renamed: Mapping[str, str]
    units: Mapping[str, str]
    only: tuple[str, ...] | None = attrs.field(converter=_names)
    also: Iterable[str]
    rows: Rows
    step: float | None
    tail: str
    gaps: str


def read(
    path: str | Path,
    *,
    columns: Sequence[str] | str | None = None,
    map: Mapping[str, str] | None = None,  # noqa: A002 - the word of the command line
    units: Mapping[str, str] | None = None,
    only: Iterable[str] | None = None,
    also: Iterable[str] = (),
    rows: Rows = (None, None),
    step: float | None = None,
    group: str | None = None,
    tail: str = "refuse",
    gaps: str = "refuse",
) -> Record:
    """Read a measurement from a CSV-like text file, NPY, NPZ, MAT (5 or 7.3) or HDF5.

    ``columns`` names the columns of a file without a header, or in place of its header, in order, as a list or with
    commas (``"t, x_in [deg]"``; an empty name skips one). ``map`` gives columns other names, and a unit where the file
    gives none: ``{"x_in [deg]": "motor angle"}``, the time as ``"t"``; of a path like ``Model Root/angle/Out1`` the
    end will do. ``units`` gives units by name, the new one or that of the column. ``only`` keeps these signals and
    leaves the rest unread, faults included; those in ``also`` are kept where they are there. ``rows`` keeps the
    rows from the first to the last given, both counted from 1 as an editor does (None: from the start, to the
    end). ``step`` is the time in s from row to row, for files without a time column. ``group`` is the
    structure or group of a MAT, HDF5 or NPZ file to read. Dates and times in a text file (ISO 8601, ``22.11.2026
    14:03:07``, or times of day, which may pass midnight) become seconds from the first on. A column without
    unit and without any number is left out where none asked for it.

    ``tail="drop"`` leaves out what comes after a jump of the time backwards, ``gaps="keep"`` reads a file with long
    gaps in time all the same; both are refused otherwise. What was repaired stands in the record's ``notes``.
    Raises DataError, with row and column, for what cannot be repaired.
    """
    if not isinstance(path, str | os.PathLike):
        raise DataError(
            f"read takes the path of a file, got {in_words(path)}. Of a frame tsm.from_pandas makes a "
            "recording, of arrays tsm.Record(name, t, signals, units)."
        )
    path = Path(path)
    columns = columns.split(",") if isinstance(columns, str) else columns
    if path.is_dir():
        raise DataError(f"{path} is a folder; give one file.")
    if not path.exists():
        if not path.parent.is_dir():
            raise DataError(f"there is no file {path}: there is no folder '{path.parent}'.")
        raise DataError(f"there is no file {path}.{near(path.name, [p.name for p in path.parent.iterdir()])}")
    named, told = _told(str(path), map or {}, units or {})
    wish = Wish(named, told, only, also, rows, step, tail, gaps)
    reader = _READERS.get(path.suffix.lower())
    if reader is None and group:
        raise DataError(f"{path}: a group was asked for, but text files have none.")
    source = reader(path, columns, group) if reader else text.open_text(path, columns)
    return _record(source, path.stem if not group else f"{path.stem} {group}", str(path), wish)


def from_pandas(
    frame: Any,
    *,
    name: str = "frame",
    map: Mapping[str, str] | None = None,  # noqa: A002 - as in read
    units: Mapping[str, str] | None = None,
    only: Iterable[str] | None = None,
    step: float | None = None,
    tail: str = "refuse",
    gaps: str = "refuse",
) -> Record:
    """Return a record from a pandas frame whose columns are named like those of a file; see read.

    The index is the time [s] when it is named ``t`` or ``time``. Units are those in the columns' names, or in
    ``attrs["units"]``, where ``to_pandas`` puts them.
    """
    source, (named, told) = containers.frame_arrays(name, frame), _told(name, map or {}, units or {})
    return _record(source, name, name, Wish(named, told, only, (), (None, None), step, tail, gaps))


def _told(origin: str, named: Mapping[str, str], labels: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Columns and units by name; a name that is mapped may have its unit with it: ``x_in [deg]``."""
    renamed, told = dict[str, str](), dict(labels)
    for told_name, column in named.items():
        name, unit = split_heading(told_name)
        if name in renamed:
            raise DataError(f"{origin}: '{name}' is mapped to two columns, '{renamed[name]}' and '{column}'.")
        renamed[name] = column
        if unit and told.setdefault(name, unit) != unit:
            raise DataError(f"{origin}: '{name}' is given two units, {told[name]} and {unit}.")
    return renamed, told


def _record(source: Source, name: str, origin: str, wish: Wish) -> Record:
    _check(origin, wish)
    split = [split_heading(text) for text in source.headings]
    found = _named(origin, split, wish.renamed, getattr(source, "folder", ""))
    time = None if wish.step is not None else _time(origin, found, getattr(source, "clocks", ()))
    bare = any(not unit and name.lower() not in TIMES for name, unit in split)
    found = _selected(origin, found, wish, time, bare, source.notes)
    labels = _labels(origin, found, split, wish.units)
    values, at = source.numbers([*found.values()], wish.rows)
    if not len(at) and wish.rows != (None, None):
        _, every = source.numbers([*found.values()], (None, None))
        first, last = wish.rows[0] or 1, wish.rows[1] or "the end"
        there = f"they stand in rows {every[0]} to {every[-1]}" if len(every) else "the file has none"
        raise DataError(f"{origin}: there are no samples from row {first} to {last}; {there}.")
    if time is None:
        table = _clocked(origin, found, labels, values, at, float(wish.step or 0.0))
    else:
        order = [time, *(k for k in found if k != time)]
        keys = list(found)
        values = values[:, [keys.index(k) for k in order]]
        values[:, 0] *= _time_factor(origin, labels[time])
        places = tuple(found[k] + 1 for k in order)
        table = Table(origin, tuple(order), tuple(labels[k] for k in order), values, at, places)
    asked = frozenset([*wish.renamed, *wish.units, *(wish.only or ())])
    table = repaired(attrs.evolve(table, tail=wish.tail, gaps=wish.gaps, asked=asked))
    signals = {k: table.values[:, i] for i, k in enumerate(table.names) if i}
    told = {k: u for k, u in zip(table.names[1:], table.units[1:], strict=True) if u}
    named = (*_twice(found, split), *_overruled(found, split, labels))
    notes = (*source.notes, *named, *_of_the_clock(source, wish, table), *table.notes)
    return Record(name, table.values[:, 0], signals, told, origin, notes)


def _twice(found: Mapping[str, int], split: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Columns that were read under several names, a sentence for each."""
    for place in dict.fromkeys(found.values()):
        names = [name for name, own in found.items() if own == place]
        if len(names) > 1:
            yield f"{listed(names)} are the same column, '{split[place][0]}'."


def _overruled(found: Mapping[str, int], split: Sequence[tuple[str, str]], labels: Mapping[str, str]) -> Iterator[str]:
    """Columns read in another unit than the file says, a sentence for each."""
    for name, place in found.items():
        own, told = split[place][1], labels[name]
        with suppress(unit_labels.UnitError):  # one that is not known is told by what needs it
            if own and told and not unit_labels.same(own, told):
                yield f"{name} was read in {told}, as asked; the file says {own}."


def _of_the_clock(source: Source, wish: Wish, table: Table) -> Iterator[str]:
    """What to mind of the time: a column that was not heeded, and seconds that may be none."""
    if wish.step is not None:
        found = [text for text in source.headings if split_heading(text)[0].lower() in TIMES]
        if found:
            yield f"The column {found[0]} was not read: the rows follow each other at {wish.step:g} s, as asked."
    elif not table.units[0] and len(table.values) >= MANY and (usual := usual_step(table.values[:, 0])) >= SLOW:
        name = split_heading(source.headings[table.places[0] - 1])[0]
        yield (
            f"{name} has no unit and was taken to be in s, which makes {usual:.4g} s from row to row. If it is in "
            f"ms, say so: map={{'t [ms]': '{name}'}}, or --map 't [ms]={name}'."
        )


def _labels(
    origin: str, found: Mapping[str, int], split: Sequence[tuple[str, str]], given: Mapping[str, str]
) -> dict[str, str]:
    """Units by the name in the record: those given for it, or for its column, before that of the file."""
    columns = {split[place][0]: k for k, place in found.items() if split[place][0] not in found}
    unknown = next((k for k in given if k not in found and k not in columns), None)
    if unknown is not None:
        raise DataError(f"{origin}: a unit is given for '{unknown}', which is not read.{near(unknown, found)}")
    told = {columns.get(k, k): unit for k, unit in given.items()}
    return {k: told.get(k, split[place][1]) for k, place in found.items()}


def _clocked(
    origin: str, found: Mapping[str, int], labels: Mapping[str, str], values: np.ndarray, at: np.ndarray, step: float
) -> Table:
    """Return a table whose rows follow each other at a known step."""
    if not 0 < step < float("inf"):
        raise DataError(f"{origin}: the step from row to row must be a positive number of seconds, got {step:g}.")
    t = step * np.arange(len(values))
    return Table(
        origin,
        ("t", *found),
        ("s", *(labels[k] for k in found)),
        np.column_stack([t, values]),
        at,
        (0, *(place + 1 for place in found.values())),
    )


def _named(origin: str, split: list[tuple[str, str]], renamed: Mapping[str, str], folder: str) -> dict[str, int]:
    """Column numbers by the name the record will use."""
    names = [name for name, _ in split]
    renamed = {name: _column(origin, name, column, split, folder) for name, column in renamed.items()}
    found: dict[str, int] = {}
    moved = set(renamed.values()) - set(renamed)
    for place, name in enumerate(names):
        if not name or name in moved or name in renamed:
            continue
        if name in found:
            raise DataError(
                f"{origin}: columns {found[name] + 1} and {place + 1} are both named '{name}'. "
                "Name the columns anew (columns = …)."
            )
        found[name] = place
    mapped = {name: names.index(column) for name, column in renamed.items()}
    return dict(sorted({**found, **mapped}.items(), key=lambda item: item[1]))


def _column(origin: str, name: str, column: str, split: list[tuple[str, str]], folder: str) -> str:
    """Return a column as the file names it: in full, with its unit, from its folder on, or by the end of its path."""
    names, (bare, unit) = [known for known, _ in split], split_heading(column)
    if unit and column not in names and bare in names:
        own = split[names.index(bare)][1]
        if own == unit:
            return bare
        said = f"says that it is in {own}" if own else "gives it no unit"
        way = f"map={{'{name} [{unit}]': '{bare}'}}, or --map '{name} [{unit}]={bare}'"
        raise DataError(
            f"{origin}: '{name}' is mapped to column '{column}', and the file {said}. To say the unit, "
            f"give it with the name: {way}."
        )
    inner = column.removeprefix(f"{folder}/") if folder else column
    ends = [known for known in names if known.endswith(f"/{column}")]
    match = next((known for known in (column, inner) if known in names), ends[0] if len(ends) == 1 else None)
    if match is not None:
        return match
    if ends:
        raise DataError(
            f"{origin}: '{name}' is mapped to column '{column}', but {len(ends)} end like that: "
            f"{clip(', '.join(ends))}."
        )
    hint = near(column, [n for n in names if n])
    raise DataError(f"{origin}: '{name}' is mapped to column '{column}', which is not there.{hint}")


def _time(origin: str, found: Mapping[str, int], clocks: Iterable[int]) -> str:
    """Return the name of the time column; one of dates and times may have any. Raises DataError when there is none."""
    for wanted in TIMES:
        for name in found:
            if name.lower() == wanted:
                return name
    ends = [name for name in found if name.rpartition("/")[2].lower() in TIMES]
    ends = ends or [name for name, place in found.items() if place in clocks]
    if len(ends) == 1:
        return ends[0]
    known = ", ".join(found)
    raise DataError(
        f"{origin}: no column is named t or time. Map t to the column that holds the time (there "
        f"are {known}), or give the step between rows in s (step=…, or --sampling)."
    )


def _selected(
    origin: str, found: dict[str, int], wish: Wish, time: str | None, bare: bool, notes: Sequence[str]
) -> dict[str, int]:
    """Columns that are kept. Raises DataError for one that is not there; ``bare``: columns have no units."""
    only = wish.only
    if only is None:
        return found
    wanted = [*only]
    wanted += [k for k in wish.also if k in found and k not in wanted]
    known = [k for k in found if k != time]
    for name in [k for k in wanted if k not in found]:
        ends = [k for k in known if k.endswith(f"/{name}")]
        if len(ends) == 1:  # the end of a path will do
            found = {name if k == ends[0] else k: place for k, place in found.items()}
    missing = [name for name in wanted if name not in found]
    if missing:
        left = "".join(f" {note}" for note in notes if missing[0] in note)
        raise DataError(
            f"{origin}: there is no column '{missing[0]}'.{near(missing[0], known)} "
            f"If it has another name there, map it: {how_to_map(missing[0], bare=bare)}.{left}"
        )
    return {k: place for k, place in found.items() if k in wanted or k == time}


def _time_factor(origin: str, label: str) -> float:
    try:
        return unit_labels.factor(label or "s", "s")
    except unit_labels.UnitError as error:
        raise DataError(f"{origin}: the time is in '{label}'. {error}") from None


def _check(origin: str, wish: Wish) -> None:
    first, last = wish.rows
    if (first is not None and first < 1) or (last is not None and last < (first or 1)):
        raise DataError(f"{origin}: rows=({first}, {last}) must be two row numbers in order, the first at least 1.")
    for what, value, choices in (("tail", wish.tail, TAILS), ("gaps", wish.gaps, GAPS)):
        if value not in choices:
            raise DataError(f"{origin}: {what} must be '{choices[0]}' or '{choices[1]}', got {in_words(value)}.")


__all__ = ["from_pandas", "heading", "read", "split_heading"]
