"""Reading recordings from JSON, Excel, Parquet and MDF files, and errors for other known formats."""

from __future__ import annotations

import gc
import json
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date, datetime, time
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tsmblocks.common.errors import DataError, clip, in_words, near
from tsmblocks.common.interpolation import found_hold, interpolation
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.containers import COPIES, Arrays, arrays
from tsmblocks.data.grid import step_of
from tsmblocks.data.structures import MAX_NESTING
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
JSON_BYTES = 20
"""Bytes of memory for one of a JSON file. Derived: a list takes 56 bytes and its place in another 8, of "[],"."""
XML_BYTES = 3
"""Bytes of memory for one of the XML in an Excel file. Chosen: a cell takes as much there as in memory, about."""
MOST_CELLS = 50_000_000
"""Cells that a sheet may cover. Chosen: passing them takes some ten seconds."""
MAX_DIGITS = 300
"""Digits from which a whole number is infinite. Chosen: floats end at 1.8e308."""


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
    raise DataError(f"there is no file {path}.{near(path.name, [p.name for p in path.parent.iterdir()])}")


def refuse_unread(path: Path) -> None:
    """Raise DataError for a format that is known not to be read."""
    what = UNREAD.get(path.suffix.lower())
    if what is not None:
        raise DataError(
            f"{path}: this is {what}, which is not read. Save it as CSV, XLSX, Parquet, MAT or HDF5, or read it with "
            "pandas and give the frame to tsm.from_pandas."
        )


# ---- JSON


def open_json(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Lists of numbers by name, rows as objects (in one list, or one on each line), or rows with ``columns``.

    An object ``units`` gives units by name. Objects within objects are named ``group/name``.
    """
    found = _json(path)
    for key in (group or "").strip("/").split("/") if group else ():
        if not isinstance(found, dict) or key not in found:
            raise DataError(
                f"{path}: there is no group '{group}'.{near(key, found if isinstance(found, dict) else ())}"
            )
        found = found[key]
    if isinstance(found, dict) and isinstance(found.get("columns"), list) and isinstance(found.get("data"), list):
        found = _split(path, found["columns"], found["data"])
    if isinstance(found, dict):
        inner = [v for v in found.values() if _are_rows(v)]
        found = inner[0] if len(inner) == 1 and not any(map(_numbers, found.values())) else found
    if _are_rows(found):
        names = dict.fromkeys(k for row in found for k in row)
        found = {k: [row.get(k) for row in found] for k in names}
    if not isinstance(found, dict):
        raise DataError(
            f"{path}: the JSON must hold lists of numbers by name, or rows as objects, not {in_words(found)}."
        )
    units = found.get("units")
    labels = {str(k): str(v) for k, v in units.items()} if isinstance(units, dict) else {}
    named = {k: v for k, v in _flat(found) if v is not None}
    return arrays(str(path), named, columns, labels)


def _split(path: Path, columns: list[Any], rows: list[Any]) -> dict[str, Any]:
    """Columns of a table as pandas writes it with ``orient="split"``. Raises DataError for a row of another length."""
    for k, row in enumerate(rows, 1):
        if not isinstance(row, list) or len(row) != len(columns):
            raise DataError(f"{path}: row {k} of 'data' must list {len(columns)} values, not {in_words(row)}.")
    return {str(name): [row[i] for row in rows] for i, name in enumerate(columns)}


def _json(path: Path) -> Any:
    """The content of a JSON file, or the list of the lines of one that has an object on each."""
    refuse_too_large(JSON_BYTES * path.stat().st_size, f"{path}: reading it")
    text = path.read_text(encoding="utf-8", errors="replace").removeprefix("\ufeff")
    try:
        return json.loads(text, parse_int=_integer)
    except (ValueError, RecursionError) as error:
        lines = [line for line in text.splitlines() if line.strip()]
        try:
            if len(lines) > 1:
                return [json.loads(line, parse_int=_integer) for line in lines]
        except (ValueError, RecursionError):
            pass
        raise DataError(f"{path}: this is not JSON that can be read ({error}).") from None


def _integer(text: str) -> float:
    """A whole number; infinity for one that no float holds, as JSON reads 1e400."""
    return int(text) if len(text) < MAX_DIGITS else float("-inf" if text.startswith("-") else "inf")


def _are_rows(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(isinstance(row, dict) for row in value)


def _numbers(value: Any) -> np.ndarray | None:
    """A list of numbers, null being none; None for anything else."""
    if not isinstance(value, list) or not value:
        return None
    try:
        return np.array([np.nan if v is None else v for v in value], dtype=float)
    except (TypeError, ValueError):
        return None


def _flat(found: Mapping[str, Any], above: str = "", depth: int = 0) -> Iterator[tuple[str, np.ndarray | None]]:
    """Every list of numbers with its path."""
    for name, value in found.items():
        if isinstance(value, dict):
            if depth < MAX_NESTING:
                yield from _flat(value, f"{above}{name}/", depth + 1)
        else:
            yield f"{above}{name}", _numbers(value)


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
            if group is not None and group not in book.sheetnames:
                raise DataError(f"{path}: there is no sheet '{group}'.{near(group, book.sheetnames)}")
            sheet = book[group] if group else book.worksheets[0]
            rows = _sheet_rows(path, sheet)
    except DataError:
        raise
    except Exception as error:  # openpyxl and zipfile raise errors of any kind on a damaged file
        raise DataError(f"{path}: this is not an XLSX file that can be read ({error}).") from None
    width = max((k + 1 for row in rows for k, cell in enumerate(row) if cell), default=0)
    whole = "\n".join("\t".join([*row[:width], *[""] * (width - len(row))]) for row in rows)
    others = [name for name in book.sheetnames if name != sheet.title]
    notes = (
        (f"Read from the sheet '{sheet.title}'; there are also {', '.join(others)}.",) if others and not group else ()
    )
    return text_of(path, whole, columns, notes)


def _sheet_rows(path: Path, sheet: Any) -> list[list[str]]:
    """The cells of a sheet as text. Raises DataError where one far off makes it cover more than a file can fill."""
    rows, visited = [], 0
    for row in sheet.iter_rows(values_only=True):
        visited += len(row)
        if visited > MOST_CELLS:
            raise DataError(f"{path}: the sheet '{sheet.title}' covers more than {MOST_CELLS:,} cells.")
        filled = next((k for k in range(len(row), 0, -1) if row[k - 1] is not None), 0)
        rows.append([_cell(value) for value in row[:filled]])
    return rows


def _cell(value: Any) -> str:
    """A cell as text: numbers with all digits, dates as in ISO 8601."""
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(" ") if isinstance(value, datetime) else value.isoformat()
    return "" if value is None else " ".join(str(value).split())


# ---- Parquet


def open_parquet(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Columns of a Parquet file; ``unit`` in the metadata of a column gives its unit. Dates become seconds."""
    try:
        from pyarrow import parquet, types
    except ImportError:
        _refuse_without(path, "Parquet", "pyarrow", "parquet")
    if group:
        raise DataError(f"{path}: a group was given, but Parquet files have none.")
    try:
        about = parquet.read_metadata(path)
        refuse_too_large(COPIES * 8.0 * about.num_rows * about.num_columns, f"{path}: reading it")
        table = parquet.read_table(path)
    except DataError:
        raise
    except Exception as error:  # pyarrow raises errors of any kind on a damaged file
        raise DataError(f"{path}: this is not a Parquet file that can be read ({error}).") from None
    found, units = dict[str, Any](), dict[str, str]()
    for field in table.schema:
        values, name = table.column(field.name), str(field.name)
        if types.is_timestamp(field.type):
            instants = values.to_numpy().astype("datetime64[ns]")
            found[name], units[name] = (instants - instants[:1]) / np.timedelta64(1, "s"), "s"
        elif types.is_integer(field.type) or types.is_floating(field.type) or types.is_boolean(field.type):
            found[name] = np.array(values.to_pylist() if values.null_count else values.to_numpy(), dtype=float)
        label = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        units |= {name: label} if label else {}
    return arrays(str(path), found, columns, units)


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
    with _failing_deletions_ignored():
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
def _failing_deletions_ignored() -> Iterator[None]:
    """Show no traceback of an object that fails when it is deleted, as asammdf leaves for damaged files."""
    shown, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = shown


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
            if not np.array_equal(t, found["t"]):
                slower.append(label)
            found[label] = x if np.array_equal(t, found["t"]) else _at(found["t"], t, x)
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


def _at(grid: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A channel at other times, NaN where it was not recorded; half a step beyond its ends it keeps its value."""
    known = np.isfinite(x)
    t, x = t[known], x[known]
    if len(t) < 2:
        return np.full(len(grid), np.nan)
    made: np.ndarray = interpolation(t, x, found_hold(t, x))(np.clip(grid, t[0], t[-1]))
    beyond = 0.5 * step_of(t)
    return np.where((grid >= t[0] - beyond) & (grid <= t[-1] + beyond), made, np.nan)
