"""Reading recordings from Excel, Parquet and MDF files, and errors for other known formats."""

from __future__ import annotations

import gc
import io
import logging
import sys
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tsmblocks.common.errors import DataError, clip, near, near_file
from tsmblocks.common.interpolation import found_hold, interpolation
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.containers import COPIES, Arrays, arrays, refuse_twice, without_columns
from tsmblocks.data.grid import step_of
from tsmblocks.data.text import Text, text_of

UNREAD = {
    ".xls": "the Excel format before 2007",
    ".ods": "an OpenDocument spreadsheet",
    ".tdms": "a LabVIEW TDMS file",
    ".feather": "a Feather file",
    ".pkl": "a Python pickle, which may run any code",
    ".pickle": "a Python pickle, which may run any code",
}
"""Formats that are refused, by ending: read as text, each of them would give a misleading fault."""
XML_BYTES = 3
"""Bytes of memory for one of the XML in an Excel file. Chosen: a cell takes as much there as in memory, about."""
MOST_CELLS = 50_000_000
"""Cells that a sheet may cover. Chosen: passing them takes some ten seconds."""


def _refuse_without(path: Path, what: str, package: str, extra: str) -> NoReturn:
    """Raise DataError: the package that reads files of this kind is not installed."""
    raise DataError(f'{path}: {what} files need {package}: pip install "tsmblocks[{extra}]".') from None


def refuse_missing(path: Path) -> None:
    """Raise DataError unless there is a file."""
    try:
        if path.is_dir():
            raise DataError(f"{path} is a folder; give one file.")
        if path.exists():
            return
    except (OSError, ValueError):  # a name that no file can have
        raise DataError(f"there is no file {clip(str(path))}.") from None
    if not path.parent.is_dir():
        raise DataError(f"there is no file {path}: there is no folder '{path.parent}'.")
    raise DataError(f"there is no file {path}.{near_file(path.name, [p.name for p in path.parent.iterdir()])}")


def refuse_unread(path: Path) -> None:
    """Raise DataError for a format that is known not to be read."""
    what = UNREAD.get(path.suffix.lower())
    if what is not None:
        raise DataError(
            f"{path}: this is {what}, which is not read. Save it as CSV, XLSX, Parquet, MAT or HDF5, or read it with "
            "pandas and give the frame to tsm.from_pandas."
        )


# ---- Excel


def open_xlsx(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Text:
    """The table in a sheet of an Excel file, ``group`` or the first one, read as text with tabs would be."""
    try:
        from openpyxl import load_workbook
    except ImportError:
        _refuse_without(path, "Excel", "openpyxl", "excel")
    try:
        with path.open("rb") as file:  # openpyxl leaves a damaged one open
            with zipfile.ZipFile(file) as archive:
                size = sum(one.file_size for one in archive.infolist())
            refuse_too_large(XML_BYTES * size, f"{path}: reading it")
            book = load_workbook(file, read_only=True, data_only=True)
            names = [one.title for one in book.worksheets]  # without sheets that are charts
            if group is not None and group not in names:
                raise DataError(f"{path}: there is no sheet '{group}'.{near(group, names)}")
            sheet = book.worksheets[names.index(group) if group else 0]
            rows = _sheet_rows(path, sheet)
    except DataError:
        raise
    except Exception as error:  # openpyxl and zipfile raise errors of any kind on a damaged file
        raise DataError(f"{path}: this is not an XLSX file that can be read ({error}).") from None
    width = max((k + 1 for row in rows for k, cell in enumerate(row) if cell), default=0)
    whole = "\n".join("\t".join([*row[:width], *[""] * (width - len(row))]) for row in rows)
    others = [name for name in names if name != sheet.title]
    notes = (
        (f"Read from the sheet '{sheet.title}'; there are also {', '.join(others)}.",) if others and not group else ()
    )
    return text_of(path, whole, columns, notes)


def _sheet_rows(path: Path, sheet: Any) -> list[list[str]]:
    """The cells of a sheet as text. Raises DataError where one far off makes it cover more than a file can fill."""
    rows, visited, size = list[list[str]](), 0, 0
    for row in sheet.iter_rows(values_only=True):
        visited += len(row)
        if visited > MOST_CELLS:
            raise DataError(f"{path}: the sheet '{sheet.title}' covers more than {MOST_CELLS:,} cells.")
        filled = next((k for k in range(len(row), 0, -1) if row[k - 1] is not None), 0)
        rows.append([_cell(value) for value in row[:filled]])
        size += COPIES * sum(map(len, rows[-1]))  # a text that the file has once may stand in all of them
        refuse_too_large(size, f"{path}: reading it")
    return rows


def _cell(value: Any) -> str:
    """A cell as text: numbers with all digits, dates as in ISO 8601, durations in s, true and false as 1 and 0."""
    if isinstance(value, (bool, timedelta)):
        return str(int(value) if isinstance(value, bool) else value.total_seconds())
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(" ") if isinstance(value, datetime) else value.isoformat()
    return "" if value is None else " ".join(str(value).split())


# ---- Parquet


def open_parquet(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Columns of a Parquet file; ``unit`` in the metadata of a column gives its unit. Dates become seconds."""
    try:
        from pyarrow import parquet
    except ImportError:
        _refuse_without(path, "Parquet", "pyarrow", "parquet")
    if group:
        raise DataError(f"{path}: a group was given, but Parquet files have none.")
    try:
        with parquet.ParquetFile(path) as file:
            refuse_twice(str(path), file.schema_arrow.names)
            numeric = [field for field in file.schema_arrow if _is_numeric(field.type)]
            refuse_too_large(COPIES * 8.0 * file.metadata.num_rows * len(numeric), f"{path}: reading it")
            others = [field.name for field in file.schema_arrow if field not in numeric]
            table = file.read([field.name for field in numeric])  # texts may be any size
            found = {field.name: _parquet_column(table.column(k)) for k, field in enumerate(numeric)}
    except DataError:
        raise
    except Exception as error:  # pyarrow raises errors of any kind on a damaged file
        raise DataError(f"{path}: this is not a Parquet file that can be read ({error}).") from None
    units = {field.name: "s" for field in numeric if _is_time(field.type)}
    given = {field.name: (field.metadata or {}).get(b"unit", b"").decode(errors="replace") for field in numeric}
    units |= {name: label for name, label in given.items() if label}
    return without_columns(arrays(str(path), found, columns, units), others)


def _is_time(kind: Any) -> bool:
    from pyarrow import types

    return types.is_timestamp(kind) or types.is_duration(kind)


def _is_numeric(kind: Any) -> bool:
    from pyarrow import types

    number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
    return number or _is_time(kind)


def _parquet_column(values: Any) -> np.ndarray:
    """A column as floats, NaN where it is null; instants and durations in s, instants from the first one on."""
    from pyarrow import types

    if not _is_time(values.type):
        return np.array(values.to_pylist() if values.null_count else values.to_numpy(), dtype=float)
    ticks = values.to_numpy()  # in their own unit: in nanoseconds a far one would not fit
    known = ticks[~np.isnat(ticks)]
    begin = known[:1] if types.is_timestamp(values.type) else np.zeros(1, ticks.dtype)
    return (ticks - begin) / np.timedelta64(1, "s") if len(known) else np.full(len(ticks), np.nan)


# ---- MDF


def open_mdf(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Channels of an MDF file (version 3 or 4); ``group`` is the name or the number (from 0) of a channel group.

    Channels of other rates are interpolated at the times of the group with most samples, between their own first and
    last sample.
    """
    try:
        from asammdf import MDF
    except ImportError:
        _refuse_without(path, "MDF", "asammdf", "mdf")
    with path.open("rb") as start:
        if start.read(3) != b"MDF":  # of another file, asammdf leaves objects that fail when they are deleted
            raise DataError(f"{path}: this is not an MDF file: it does not begin with the letters MDF.")
    groups, names = _channel_groups(path, MDF)
    if group is not None:
        chosen = [k for k, name in enumerate(names) if group in (name, str(k))]
        if not chosen:
            raise DataError(f"{path}: there is no channel group '{group}'.{near(group, names)}")
        groups = [groups[chosen[0]]]
    found, units, slower = _on_one_grid(sorted((one for one in groups if one), key=lambda one: -len(one[0][1])))
    made = arrays(str(path), found, columns, units)
    if not slower:
        return made
    note = f"Interpolated at the times of the group with most samples: {', '.join(slower)}."
    return Arrays(made.origin, made.headings, (*made.notes, note), columns=made.columns)


def _channel_groups(path: Path, reader: Any) -> tuple[list[list[Channel]], list[str]]:
    """The channels of each group of an MDF file, and the names of the groups. Raises DataError where it is damaged."""
    with _nothing_printed():
        try:
            with reader(path) as file:
                groups = [_channels(file, k) for k in range(len(file.groups))]
                named = enumerate(file.groups)
                return groups, [str(getattr(one.channel_group, "acq_name", "") or k) for k, one in named]
        except Exception as error:  # asammdf raises errors of any kind on a damaged file
            said = str(error)
        gc.collect()  # such an object may be part of a cycle
    raise DataError(f"{path}: this is not an MDF file that can be read ({said}).")


@contextmanager
def _nothing_printed() -> Iterator[None]:
    """Print neither what asammdf says of damaged files nor tracebacks of objects that fail when they are deleted."""
    log = logging.getLogger("asammdf")
    shown, sys.unraisablehook = sys.unraisablehook, lambda _: None
    was, log.disabled = log.disabled, True
    try:
        with redirect_stdout(io.StringIO()):  # where a channel cannot be read it shows the whole file
            yield
    finally:
        sys.unraisablehook, log.disabled = shown, was


Channel = tuple[str, np.ndarray, np.ndarray, str]
"""Name, times [s], numbers and unit."""


def _on_one_grid(groups: Sequence[Sequence[Channel]]) -> tuple[dict[str, np.ndarray], dict[str, str], list[str]]:
    """All channels at the times of the first group, their units, and the names of those that were interpolated."""
    found, units, slower = dict[str, np.ndarray](), dict[str, str](), list[str]()
    for k, channels in enumerate(groups):
        for name, t, x, unit in channels:
            label = name if name not in found else f"{k}/{name}"
            if not found:
                found["t"], units["t"] = t, "s"
            if np.array_equal(t, found["t"]):
                found[label] = x
            else:
                found[label], left = _at(found["t"], t, x)
                slower.append(label + (f" ({left} of its samples left out, as time does not increase)" if left else ""))
            units |= {label: unit} if unit else {}
    return found, units, slower


def _channels(file: Any, group: int) -> list[Channel]:
    """Name, times [s], numbers and unit of each channel of a group that holds numbers."""
    made, master = [], file.masters_db.get(group)
    for k in range(len(file.groups[group].channels)):
        if k == master:
            continue
        signal = file.get(group=group, index=k)
        t, x = np.asarray(signal.timestamps, dtype=float), np.asarray(signal.samples)
        if x.ndim == 1 and x.dtype.kind in "fiub" and len(x) > 1 and len(t) == len(x):
            made.append((str(signal.name), t, x.astype(float), str(signal.unit or "")))
    return made


def _at(grid: np.ndarray, t: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, int]:
    """A channel at other times, NaN where it was not recorded; half a step beyond its ends it keeps its value.

    Samples at which time does not increase are left out; the second result is their number.
    """
    known = np.isfinite(x) & np.isfinite(t)
    t, x = t[known], x[known]
    later = np.append(True, t[1:] > np.maximum.accumulate(t)[:-1]) if len(t) else np.empty(0, dtype=bool)
    t, x, left = t[later], x[later], int(np.sum(~later))
    if len(t) < 2:
        return np.full(len(grid), np.nan), left
    made: np.ndarray = interpolation(t, x, found_hold(t, x))(np.clip(grid, t[0], t[-1]))
    beyond = 0.5 * step_of(t)
    return np.where((grid >= t[0] - beyond) & (grid <= t[-1] + beyond), made, np.nan), left
