"""From a file to a record: which reader, which columns under which names, then the repairs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsmblocks import units as unit_labels
from tsmblocks.data import containers, text
from tsmblocks.data.record import Record, heading, split_heading
from tsmblocks.data.repair import repaired
from tsmblocks.data.table import Rows, Source, Table
from tsmblocks.errors import DataError, near

_READERS = {
    ".npz": containers.open_npz,
    ".mat": containers.open_mat,
    ".h5": containers.open_hdf5,
    ".hdf5": containers.open_hdf5,
}
TIMES = ("t", "time", "timestamp", "seconds")
"""Names of a time column, whatever their case, best first."""


def read(
    path: str | Path,
    *,
    columns: Sequence[str] | str | None = None,
    map: Mapping[str, str] | None = None,  # noqa: A002 - the word of the command line
    units: Mapping[str, str] | None = None,
    only: Iterable[str] | None = None,
    rows: Rows = (None, None),
    step: float | None = None,
) -> Record:
    """Read a measurement from a CSV-like text file, NPZ, MAT (5 or 7.3) or HDF5.

    ``columns`` names the columns of a file without a header, in order, as a list or with commas
    (``"t, x_in [deg]"``; an empty name skips one). ``map`` gives columns other names:
    ``{"x_in": "motor angle"}``, the time as ``"t"``.
    ``units`` gives units by name where the file does not. ``only`` keeps these signals and leaves the
    rest unread, faults included. ``rows`` keeps the rows from the first to the last given, both counted
    from 1 as an editor does (None: from the start, to the end). ``step`` is the time in s from row to
    row, for files without a time column.

    What was repaired stands in the record's ``notes``. Raises DataError, with row and column, for what
    cannot be repaired.
    """
    path = Path(path)
    columns = columns.split(",") if isinstance(columns, str) else columns
    if path.is_dir():
        raise DataError(f"{path} is a folder; give one file.")
    if not path.exists():
        beside = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise DataError(f"there is no file {path}.{near(path.name, beside)}")
    source = _READERS.get(path.suffix.lower(), text.open_text)(path, columns)
    return _record(source, path.stem, str(path), map or {}, units or {}, only, rows, step)


def from_pandas(
    frame: Any,
    *,
    name: str = "frame",
    map: Mapping[str, str] | None = None,  # noqa: A002 - as in read
    units: Mapping[str, str] | None = None,
    only: Iterable[str] | None = None,
    step: float | None = None,
) -> Record:
    """Return a record from a pandas frame whose columns are named like those of a file; see read.

    The index is the time [s] when it is named ``t`` or ``time``.
    """
    source = containers.frame_arrays(name, frame)
    return _record(source, name, name, map or {}, units or {}, only, (None, None), step)


def _record(
    source: Source, name: str, origin: str, renamed: Mapping[str, str], units: Mapping[str, str],
    only: Iterable[str] | None, rows: Rows, step: float | None,
) -> Record:  # fmt: skip
    _check_rows(origin, rows)
    split = [split_heading(text) for text in source.headings]
    found = _named(origin, [name for name, _ in split], renamed)
    time = None if step is not None else _time(origin, found)
    found = _selected(origin, found, only, time)
    labels = {k: units.get(k, split[place][1]) for k, place in found.items()}
    unknown = next((k for k in units if k not in labels and k != time), None)
    if unknown is not None:
        raise DataError(f"{origin}: a unit is given for '{unknown}', which is not read.{near(unknown, labels)}")
    values, at = source.numbers([*found.values()], rows)
    if time is None:
        table = _clocked(origin, found, labels, values, at, float(step or 0.0))
    else:
        order = [time, *(k for k in found if k != time)]
        keys = list(found)
        values = values[:, [keys.index(k) for k in order]]
        values[:, 0] *= _time_factor(origin, labels[time])
        places = tuple(found[k] + 1 for k in order)
        table = Table(origin, tuple(order), tuple(labels[k] for k in order), values, at, places)
    table = repaired(table)
    signals = {k: table.values[:, i] for i, k in enumerate(table.names) if i}
    told = {k: u for k, u in zip(table.names[1:], table.units[1:], strict=True) if u}
    return Record(name, table.values[:, 0], signals, told, origin, (*source.notes, *table.notes))


def _clocked(
    origin: str,
    found: Mapping[str, int],
    labels: Mapping[str, str],
    values: np.ndarray,
    at: np.ndarray,
    step: float,
) -> Table:
    """Return a table whose rows follow each other at a known step."""
    if not 0 < step < float("inf"):
        raise DataError(f"{origin}: the step from row to row must be a positive number of seconds, got {step:g}.")
    t = step * np.arange(len(values))
    return Table(origin, ("t", *found), ("s", *(labels[k] for k in found)), np.column_stack([t, values]), at,
                 (0, *(place + 1 for place in found.values())))  # fmt: skip


def _named(origin: str, names: list[str], renamed: Mapping[str, str]) -> dict[str, int]:
    """Column numbers by the name the record will use."""
    for name, column in renamed.items():
        if column not in names:
            hint = near(column, [n for n in names if n])
            raise DataError(f"{origin}: '{name}' is mapped to column '{column}', which is not there.{hint}")
    found: dict[str, int] = {}
    moved = set(renamed.values()) - set(renamed)
    for place, name in enumerate(names):
        if not name or name in moved or name in renamed:
            continue
        if name in found:
            raise DataError(f"{origin}: columns {found[name] + 1} and {place + 1} are both named '{name}'. "
                            "Name the columns anew (columns = …).")  # fmt: skip
        found[name] = place
    mapped = {name: names.index(column) for name, column in renamed.items()}
    return dict(sorted({**found, **mapped}.items(), key=lambda item: item[1]))


def _time(origin: str, found: Mapping[str, int]) -> str:
    """Return the name of the time column. Raises DataError when none is named like one."""
    for wanted in TIMES:
        for name in found:
            if name.lower() == wanted:
                return name
    known = ", ".join(found)
    raise DataError(f"{origin}: no column is named t or time. Map t to the column that holds the time (there "
                    f"are {known}), or give the step between rows in s.")  # fmt: skip


def _selected(origin: str, found: dict[str, int], only: Iterable[str] | None, time: str | None) -> dict[str, int]:
    if only is None:
        return found
    wanted = [only] if isinstance(only, str) else list(only)
    known = [k for k in found if k != time]
    missing = [name for name in wanted if name not in found]
    if missing:
        raise DataError(f"{origin}: there is no column '{missing[0]}'.{near(missing[0], known)} "
                        f"If it has another name there, map it ({missing[0]}=COLUMN).")  # fmt: skip
    return {k: place for k, place in found.items() if k in wanted or k == time}


def _time_factor(origin: str, label: str) -> float:
    try:
        return unit_labels.factor(label or "s", "s")
    except unit_labels.UnitError as error:
        raise DataError(f"{origin}: the time is in '{label}'. {error}") from None


def _check_rows(origin: str, rows: Rows) -> None:
    first, last = rows
    if (first is not None and first < 1) or (last is not None and last < (first or 1)):
        raise DataError(f"{origin}: rows=({first}, {last}) must be two row numbers in order, the first at least 1.")


__all__ = ["from_pandas", "heading", "read", "split_heading"]
