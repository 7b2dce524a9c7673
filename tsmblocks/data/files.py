"""From a file to a record: which reader, which columns under which names, then the repairs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import DataError, clip, in_words, near
from tsmblocks.common.headings import split_heading
from tsmblocks.common.tables import listed
from tsmblocks.common.units import UnitError, factor, same
from tsmblocks.data import containers, formats, json_text, text
from tsmblocks.data.grid import usual_step
from tsmblocks.data.missing_units import how_to_map, map_argument
from tsmblocks.data.record import Record
from tsmblocks.data.repair import repaired
from tsmblocks.data.spellings import spelling_notes
from tsmblocks.data.table import Rows, Source, Table

READERS = {
    ".npy": containers.open_npy,
    ".npz": containers.open_npz,
    ".mat": containers.open_mat,
    ".h5": containers.open_hdf5,
    ".hdf5": containers.open_hdf5,
    ".json": json_text.open_json,
    ".jsonl": json_text.open_json,
    ".ndjson": json_text.open_json,
    ".xlsx": formats.open_xlsx,
    ".xlsm": formats.open_xlsx,
    ".parquet": formats.open_parquet,
    ".mf4": formats.open_mdf,
    ".mdf": formats.open_mdf,
}
"""Functions that open files by ending; one with another ending is read as text."""
TIME_NAMES = ("t", "time", "timestamp", "seconds", "tout")
"""Names of a time column, whatever their case, best first."""
MAX_PLAUSIBLE_STEP = 0.5
"""Time from row to row [s] from which a time without a unit may be in ms. Chosen: mechanisms are sampled faster."""
MIN_DOUBTED_ROWS = 50
"""Rows from which that is reported. Chosen: a short table of slow samples is usual."""


@attrs.frozen
class ReadOptions:
    """Arguments of ``read`` that hold for every format: names, units, parts, and the treatment of faults."""

    renamed: Mapping[str, str]
    units: Mapping[str, str]
    only: list[str] | None = attrs.field(converter=attrs.converters.optional(as_list))
    also: Iterable[str]
    rows: Rows
    step: float | None
    tail: str
    gaps: str

    @property
    def named(self) -> frozenset[str]:
        """Names that the arguments mention: a problem with these is a fault."""
        return frozenset([*self.renamed, *self.units, *(self.only or ()), *self.also])


def read(
    path: str | Path,
    *,
    columns: Sequence[str] | str | None = None,
    map: Mapping[str, str] | None = None,  # noqa: A002 - as the command line calls it
    units: Mapping[str, str] | None = None,
    only: Iterable[str] | None = None,
    also: Iterable[str] = (),
    rows: Rows = (None, None),
    step: float | None = None,
    group: str | None = None,
    tail: str = "refuse",
    gaps: str = "refuse",
) -> Record:
    r"""Read a measurement from a CSV-like text file, NPY, NPZ, MAT (5 or 7.3), HDF5, JSON, XLSX, Parquet or MDF.

    Dates and times in a text file (ISO 8601, ``22.11.2026 14:03:07``, or times of day, which may pass midnight) become
    seconds from the first on. Repeated and unsorted times, short gaps and missing numbers are repaired; the record's
    ``notes`` list the repairs. A column without unit and without any number is left out unless it was named.

    Parameters
    ----------
    path : str or Path
        The file.
    columns : sequence of str, str or None, default None
        Names of the columns in order, as a list or with commas (``"t, x_in [deg]"``; those with an empty name, or after
        the last one, are left out), for a file without a header, or instead of its header.
    map : mapping of str to str, default None
        Other names for columns, with a unit where the file gives none: ``{"x_in [deg]": "motor angle"}``, the time as
        ``"t"``. The end of a path such as ``Model Root/angle/Out1`` suffices.
    units : mapping of str to str, default None
        Units by name, the new one or that of the column.
    only : iterable of str or None, default None
        Signals to keep; all others stay unread, faults included. By default all are kept.
    also : iterable of str, default ()
        Signals to keep beside ``only`` where the file has them.
    rows : tuple of int or None, default (None, None)
        First and last row to keep, counted from 1 as an editor does; None is the start or the end.
    step : float or None, default None
        Time from row to row [s], for files without a time column.
    group : str or None, default None
        Structure or group of a MAT, HDF5, NPZ or JSON file, sheet of an XLSX file or channel group of an MDF file.
    tail : {"refuse", "drop"}, default "refuse"
        What to do with rows after a jump of the time backwards.
    gaps : {"refuse", "keep"}, default "refuse"
        What to do with a file that has long gaps in time.

    Returns
    -------
    Record
        The measurement, without its time column among the signals.

    Raises
    ------
    DataError
        With row and column, for contents that cannot be read or repaired.

    Examples
    --------
    >>> from pathlib import Path
    >>> import tsmblocks as tsm
    >>> _ = Path("sheath.csv").write_text("t [s],x_in [deg]\n0,0\n0.1,1\n0.2,2\n0.3,3\n")
    >>> tsm.read("sheath.csv")
    Record('sheath', 0 to 0.3 s, 4 samples, x_in [deg])
    """
    if not isinstance(path, str | os.PathLike):
        raise DataError(
            f"read takes the path of a file, got {in_words(path)}. tsm.from_pandas makes a recording from a frame, "
            "tsm.Record(name, t, signals, units) from arrays."
        )
    path = Path(path)
    columns = columns.split(",") if isinstance(columns, str) else columns
    formats.refuse_missing(path)
    formats.refuse_unread(path)
    renamed, labels = _names_and_units(str(path), map or {}, units or {})
    options = ReadOptions(renamed, labels, only, also, rows, step, tail, gaps)
    reader = READERS.get(path.suffix.lower())
    if reader is None and group:
        raise DataError(f"{path}: a group was given, but text files have none.")
    source = reader(path, columns, group) if reader else text.open_text(path, columns)
    return _record(source, path.stem if not group else f"{path.stem} {group}", options)


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
    """Return a record from a pandas frame whose columns are named like those of a file.

    The index is the time [s] when it is named ``t`` or ``time``. Units are those in the columns' names, or in
    ``attrs["units"]``, where ``to_pandas`` puts them.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns of numbers.
    name : str, default "frame"
        Name of the record.
    map, units, only, step, tail, gaps : optional
        As for ``read``.

    Returns
    -------
    Record
        The measurement.

    Raises
    ------
    DataError
        With the row and column, as ``read`` does; for columns that hold no numbers.

    Examples
    --------
    >>> import pandas
    >>> import tsmblocks as tsm
    >>> frame = pandas.DataFrame({"t": [0.0, 0.1, 0.2, 0.3], "x [deg]": [0.0, 1.0, 2.0, 3.0]})
    >>> tsm.from_pandas(frame, name="ramp")
    Record('ramp', 0 to 0.3 s, 4 samples, x [deg])
    """
    source = containers.frame_arrays(name, frame)
    renamed, labels = _names_and_units(name, map or {}, units or {})
    return _record(source, name, ReadOptions(renamed, labels, only, (), (None, None), step, tail, gaps))


def _names_and_units(
    origin: str, names: Mapping[str, str], labels: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Columns and units by name; a name that is mapped may have its unit with it: ``x_in [deg]``."""
    renamed, units = dict[str, str](), dict(labels)
    for title, column in names.items():
        name, unit = split_heading(title)
        if name in renamed:
            raise DataError(f"{origin}: '{name}' is mapped to two columns, '{renamed[name]}' and '{column}'.")
        renamed[name] = column
        if unit and units.setdefault(name, unit) != unit:
            raise DataError(f"{origin}: '{name}' is given two units, {units[name]} and {unit}.")
    return renamed, units


def _record(source: Source, name: str, options: ReadOptions) -> Record:
    origin, columns = source.origin, [split_heading(text) for text in source.headings]
    _check(origin, options)
    places = _places(source, columns, options)
    time = None if options.step is not None else _time(source, places)
    bare = any(not unit and name.lower() not in TIME_NAMES for name, unit in columns)
    unused = {*places} - {time, None}
    places = _selected(source, places, options, time, bare)
    wordy = (
        []
        if options.only is not None
        else source.words([p for k, p in places.items() if k not in options.named and k != time])
    )
    places = {k: place for k, place in places.items() if place not in wordy}
    labels = _labels(origin, places, columns, options.units)
    if time is not None:
        places = {time: places[time], **places}  # first
    values, rows = source.numbers([*places.values()], options.rows)
    if not len(rows) and options.rows != (None, None):
        _, every = source.numbers([*places.values()], (None, None))
        first, last = options.rows[0] or 1, options.rows[1] or "the end"
        there = f"they are in rows {every[0]} to {every[-1]}" if len(every) else "the file has none"
        raise DataError(f"{origin}: there are no samples from row {first} to {last}; {there}.")
    read_columns = [(k, labels[k], place + 1) for k, place in places.items()]
    if time is None:
        t, signals = float(options.step or 0.0) * np.arange(len(values)), values
        read_columns = [("t", "s", 0), *read_columns]
    else:
        t, signals = values[:, 0] * _time_factor(origin, labels[time]), values[:, 1:]
    names, units, numbers = zip(*read_columns, strict=True)
    requested = frozenset([*options.renamed, *options.units, *(options.only or ())])
    data = np.column_stack([t, signals])
    table = repaired(Table(origin, names, units, data, rows, numbers, (), options.tail, options.gaps, requested))
    notes = (*source.notes, *_column_notes(places, columns, labels), *_time_notes(source, options, table), *table.notes)
    notes += tuple(_left_out([columns[place][0] for place in wordy]))
    notes += tuple(spelling_notes([*options.also], [*places], sorted(unused - places.keys())))
    labels = {k: u for k, u in zip(table.names[1:], table.units[1:], strict=True) if u}
    return Record(name, table.values[:, 0], dict(table.signals()), labels, origin, notes, table.filled)


def _left_out(names: Sequence[str]) -> Iterator[str]:
    """A sentence on columns of text, which were not requested by name."""
    for name in names:
        yield f"{name} holds text and no number, and was left out."


def _column_notes(
    places: Mapping[str, int], columns: Sequence[tuple[str, str]], labels: Mapping[str, str]
) -> Iterator[str]:
    """A sentence for each column that is read under several names, or in another unit than the file gives."""
    named: dict[int, list[str]] = {}
    for name, place in places.items():
        named.setdefault(place, []).append(name)
    for place, names in named.items():
        if len(names) > 1:
            yield f"{listed(names)} are the same column, '{columns[place][0]}'."
    for name, place in places.items():
        own, unit = columns[place][1], labels[name]
        with suppress(UnitError):  # an unknown unit is refused where it is used
            if own and unit and not same(own, unit):
                yield f"{name} was read in {unit}, as requested; the file gives {own}."


def _time_notes(source: Source, options: ReadOptions, table: Table) -> Iterator[str]:
    """Cautions on the time: a time column that was not read, and a unit that is probably not s."""
    if options.step is not None:
        found = [text for text in source.headings if split_heading(text)[0].lower() in TIME_NAMES]
        if found:
            yield f"The column {found[0]} was not read: the rows follow each other at {options.step:g} s, as requested."
    elif not table.units[0] and len(table.values) >= MIN_DOUBTED_ROWS:
        usual, name = usual_step(table.values[:, 0]), split_heading(source.headings[table.places[0] - 1])[0]
        if usual >= MAX_PLAUSIBLE_STEP:
            yield (
                f"{name} has no unit and was taken to be in s, which makes {usual:.4g} s from row to row. If it is in "
                f"ms, give the unit: {map_argument('t [ms]', name)}."
            )


def _labels(
    origin: str, places: Mapping[str, int], columns: Sequence[tuple[str, str]], given: Mapping[str, str]
) -> dict[str, str]:
    """Units by the name in the record: those given for it, or for its column, before that of the file."""
    names = {columns[place][0]: k for k, place in places.items() if columns[place][0] not in places}
    unknown = next((k for k in given if k not in places and k not in names), None)
    if unknown is not None:
        raise DataError(f"{origin}: a unit is given for '{unknown}', which is not read.{near(unknown, places)}")
    wanted = {names.get(k, k): unit for k, unit in given.items()}
    return {k: wanted.get(k, columns[place][1]) for k, place in places.items()}


def _places(source: Source, columns: Sequence[tuple[str, str]], options: ReadOptions) -> dict[str, int]:
    """Column numbers by the name that the record will use, in the order of the columns."""
    names = [name for name, _ in columns]
    renamed = {name: _column(source, name, column, columns) for name, column in options.renamed.items()}
    places = {name: names.index(column) for name, column in renamed.items()}
    under_other_names = set(renamed.values()) - set(renamed)
    found: dict[str, int] = {}
    for place, name in enumerate(names):
        if not name or name in under_other_names or name in renamed:
            continue
        if name in found and (options.only is None or name in options.named or name.lower() in TIME_NAMES):
            raise DataError(
                f"{source.origin}: columns {found[name] + 1} and {place + 1} are both named '{name}'. "
                "Give the columns other names (columns = …)."
            )
        found.setdefault(name, place)
    return dict(sorted({**found, **places}.items(), key=lambda item: item[1]))


def _column(source: Source, name: str, column: str, columns: Sequence[tuple[str, str]]) -> str:
    """Return a column as the file names it: in full, with its unit, from its folder on, or by the end of its path."""
    known, (bare, unit) = [k for k, _ in columns], split_heading(column)
    fault = f"{source.origin}: '{name}' is mapped to column '{column}'"
    if unit and column not in known and bare in known:
        own = columns[known.index(bare)][1]
        if own == unit:
            return bare
        present = f"gives it in {own}" if own else "gives it no unit"
        usage = map_argument(f"{name} [{unit}]", bare)
        raise DataError(f"{fault}, and the file {present}. To give the unit, write it with the name: {usage}.")
    inner = column.removeprefix(f"{source.folder}/") if source.folder else column
    ends = [k for k in known if k.endswith(f"/{column}")]
    match = next((k for k in (column, inner) if k in known), ends[0] if len(ends) == 1 else None)
    if match is not None:
        return match
    if ends:
        raise DataError(f"{fault}, but {len(ends)} columns end like that: {clip(', '.join(ends))}.")
    raise DataError(f"{fault}, which is not there.{near(column, [k for k in known if k])}")


def _time(source: Source, places: Mapping[str, int]) -> str:
    """Return the name of the time column; one of dates and times may have any. Raises DataError when there is none."""
    for wanted in TIME_NAMES:
        for name in places:
            if name.lower() == wanted:
                return name
    ends = [name for name in places if name.rpartition("/")[2].lower() in TIME_NAMES]
    ends = ends or [name for name, place in places.items() if place in source.clocks]
    if len(ends) == 1:
        return ends[0]
    raise DataError(
        f"{source.origin}: no column is named t or time. Map t to the column that holds the time (there are "
        f"{clip(', '.join(places))}): {map_argument('t')}. Or give the step of the rows in s (step=…, or --sampling)."
    )


def _selected(
    source: Source, places: dict[str, int], options: ReadOptions, time: str | None, bare: bool
) -> dict[str, int]:
    """Columns that are kept. Raises DataError for one that is not there; ``bare``: columns have no units."""
    if options.only is None:
        return places
    wanted = [*options.only, *(k for k in options.also if k in places)]
    known = [k for k in places if k != time]
    for name in [k for k in wanted if k not in places]:
        ends = [k for k in known if k.endswith(f"/{name}")]
        if len(ends) == 1:  # the end of a path suffices
            places = {name if k == ends[0] else k: place for k, place in places.items()}
    missing = next((name for name in wanted if name not in places), None)
    if missing is not None:
        related = "".join(f" {note}" for note in source.notes if missing in note)
        raise DataError(
            f"{source.origin}: there is no column '{missing}'.{near(missing, known)} "
            f"If it has another name there, map it: {how_to_map(missing, bare=bare, known=known)}.{related}"
        )
    return {k: place for k, place in places.items() if k in wanted or k == time}


def _time_factor(origin: str, label: str) -> float:
    try:
        return factor(label or "s", "s")
    except UnitError as error:
        raise DataError(f"{origin}: the time is in '{label}'. {error}") from None


def _check(origin: str, options: ReadOptions) -> None:
    first, last = options.rows
    if (first is not None and first < 1) or (last is not None and last < (first or 1)):
        raise DataError(f"{origin}: rows=({first}, {last}) must be two row numbers in order, the first at least 1.")
    for what, value, other in (("tail", options.tail, "drop"), ("gaps", options.gaps, "keep")):
        if value not in ("refuse", other):
            raise DataError(f"{origin}: {what} must be 'refuse' or '{other}', got {in_words(value)}.")
    if options.step is not None and not 0 < options.step < float("inf"):
        wrong = "the step from row to row must be a positive number of seconds"
        raise DataError(f"{origin}: {wrong}, got {options.step:g}.")
