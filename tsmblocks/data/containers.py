"""Reading arrays by name from NPZ, MAT and HDF5 files, from a pandas frame, and the matrix of an NPY file."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, near
from tsmblocks.common.headings import split_heading, unambiguous_heading
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data import structures
from tsmblocks.data.hdf5 import SIGNATURE, read_hdf5
from tsmblocks.data.mat5 import read_mat5
from tsmblocks.data.table import Rows, Source, within

TIME_ARRAY_NAMES = ("t", "time", "tout")
"""Names of an array of times, whatever their case; ``tout`` is Simulink's."""
COPIES = 3
"""Times that numbers are in memory while they are read. Derived: as in the file, as floats, as one table."""
MAX_COLUMNS = 64
"""Columns of a matrix up to which they are taken for signals. Chosen: a matrix of more is an image or a result."""


@attrs.frozen(eq=False)
class Arrays(Source):
    """Arrays of one length with their headings."""

    columns: Sequence[np.ndarray] = attrs.field(repr=False, kw_only=True)

    def numbers(self, chosen: Sequence[int], rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """See Source; the first sample is row 1."""
        at = np.arange(1, len(self.columns[0]) + 1)
        kept = within(at, rows)
        values = np.column_stack([self.columns[k] for k in chosen]) if chosen else np.empty((len(at), 0))
        values = np.where(np.isfinite(values), values, np.nan)
        return values[kept], at[kept]


def _real_array(value: Any) -> np.ndarray | None:
    """Return an array of real numbers without dimensions of length 1, else None."""
    array = np.squeeze(np.asarray(value)) if value is not None else np.empty(())
    return array.astype(float) if array.dtype.kind in "fiub" and array.ndim in (1, 2) else None


def arrays(origin: str, found: Mapping[str, Any], columns: Sequence[str] | None, units: Mapping[str, str]) -> Arrays:
    """Columns out of whatever arrays a file holds. Raises DataError when there are none of one length.

    An array that is not in ``units`` may have its unit in its name.
    """
    known = {name: array for name, value in found.items() if (array := _real_array(value)) is not None}
    series = {name: array for name, array in known.items() if array.ndim == 1 and len(array) > 1}
    if columns or not series:
        return _matrix(origin, known, columns)
    lengths = [len(a) for a in series.values()]
    clock = next((k for k in series if k.rpartition("/")[2].lower() in TIME_ARRAY_NAMES), None)
    length = len(series[clock]) if clock else max(set(lengths), key=lengths.count)
    kept = _of_length(known, length)
    others = ", ".join(f"{k} ({len(a)})" for k, a in series.items() if len(a) != length)
    of = clock or next(iter(kept))
    notes = (f"Left out, being of another length than {of} ({length}): {others}.",) if others else ()
    headings = [unambiguous_heading(k, units[k]) if k in units else k for k in kept]
    return Arrays(origin, headings, notes, columns=list(kept.values()))


def without_columns(made: Arrays, names: Sequence[str]) -> Arrays:
    """The arrays with a note of columns that do not hold numbers."""
    note = f"Left out, being no numbers: {', '.join(names)}."
    return attrs.evolve(made, notes=(*made.notes, note)) if names else made


def refuse_twice(origin: str, names: Sequence[str]) -> None:
    """Raise DataError for a name that several columns have: only one of them could be read under it."""
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise DataError(f"{origin}: there are {count} columns named '{name}'; give them different names.")


def _of_length(known: Mapping[str, np.ndarray], length: int) -> dict[str, np.ndarray]:
    """Series of this length, and the columns (or else rows) of matrices under numbered names."""
    kept: dict[str, np.ndarray] = {}
    for name, array in known.items():
        if array.ndim == 1 and len(array) == length:
            kept[name] = array
        elif array.ndim == 2 and length in array.shape and min(array.shape) <= MAX_COLUMNS:
            table = array.T if array.shape[0] == length else array
            kept.update({f"{name}_{k}": row for k, row in enumerate(table, 1)})
    return kept


def _matrix(origin: str, known: Mapping[str, np.ndarray], columns: Sequence[str] | None) -> Arrays:
    """Columns of the one matrix that a file holds, under the names given; its rows when those are as many."""
    tables = [(k, a) for k, a in known.items() if a.ndim == 2]
    if len(tables) != 1:
        inside = ", ".join(f"{k} {a.shape}" for k, a in known.items()) or "none"
        raise DataError(
            f"{origin}: no arrays of one length were found that could be signals. Numeric arrays: {inside}."
        )
    ((name, table),) = tables
    if columns and len(columns) == table.shape[0] != table.shape[1]:
        table = table.T
    if columns and len(columns) < table.shape[1]:  # what follows is left out
        columns = [*columns, *[""] * (table.shape[1] - len(columns))]
    if not columns or len(columns) != table.shape[1]:
        named = f"{len(columns)} names were given" if columns else "they have no names"
        raise DataError(
            f"{origin}: '{name}' has {table.shape[1]} columns, but {named}. Name them in order, "
            "with units (columns = t, x_in [deg], …)."
        )
    return Arrays(origin, list(columns), columns=list(table.T))


def _in_group(origin: str, found: Mapping[str, Any], group: str | None) -> Mapping[str, Any]:
    """Contents of one group of a file, named relative to it. Raises DataError with the near miss."""
    if not group:
        return found
    group = group.strip("/")
    if group in found:
        inner = found[group]
        return inner if isinstance(inner, Mapping) else {group: inner}
    part = {k.removeprefix(f"{group}/"): v for k, v in found.items() if k.startswith(f"{group}/")}
    if not part:
        groups = {k.partition("/")[0] for k in found if "/" in k} | {k for k, v in found.items() if isinstance(v, dict)}
        raise DataError(f"{origin}: there is no group '{group}'.{near(group, groups)}")
    return part


def _numpy_arrays(path: Path, kind: str) -> dict[str, Any]:
    """The arrays that NumPy reads from a file, a single one under the file's name; raises DataError."""
    try:
        with path.open("rb") as file:  # given a path, NumPy leaves a damaged file open
            _refuse_large_numpy(path, file)
            held = np.load(file, allow_pickle=False)
            return {path.stem: held} if isinstance(held, np.ndarray) else dict(held)
    except DataError:
        raise
    except Exception as error:  # NumPy and zipfile raise errors of any kind on a damaged file
        raise DataError(f"{path}: this is not a {kind} file of plain numbers ({error}).") from None


def _refuse_large_numpy(path: Path, file: Any) -> None:
    """Check the memory that a file would take: an archive states the size of each array, and no more is unpacked."""
    if zipfile.is_zipfile(file):
        file.seek(0)
        with zipfile.ZipFile(file) as archive:
            size = sum(one.file_size for one in archive.infolist())
    else:
        size = path.stat().st_size
    file.seek(0)
    refuse_too_large(COPIES * size, f"{path}: reading it")


def open_npy(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """The columns (or rows) of the one matrix in an NPY file, which contains no names."""
    found = _in_group(str(path), _numpy_arrays(path, "NPY"), group)
    return _matrix(str(path), {k: v for k, a in found.items() if (v := _real_array(a)) is not None}, columns)


def open_npz(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Arrays of an NPZ file; ``units`` in it, as ``Run.save`` writes, gives their units."""
    found = _numpy_arrays(path, "NPZ")
    labels = [str(text).rpartition("=") for text in np.ravel(found.pop("units", []))]
    return arrays(str(path), _in_group(str(path), found, group), columns, {name: unit for name, _, unit in labels})


def open_mat(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Signals of a MAT file, of version 5 through scipy or 7.3 through h5py.

    Plain arrays and structures of them; recordings of ControlDesk; what Simulink saves as structures.
    """
    with path.open("rb") as file:
        start = file.read(1024)
    tree = read_hdf5(path, mat=True) if SIGNATURE in start else read_mat5(path)
    found = structures.signals_of(_in_group(str(path), tree, group))
    if not found.arrays:
        structures.refuse_objects(path, found.objects)
    made = arrays(str(path), found.arrays, columns, {k: u for k, u in found.units.items() if u})
    folders = {split_heading(text)[0].rpartition("/")[0] for text in made.headings}
    folder = folders.pop() if len(folders) == 1 and not columns else ""
    short = [text.removeprefix(f"{folder}/") if folder else text for text in made.headings]
    return attrs.evolve(made, headings=short, folder=folder, notes=(*found.notes, *made.notes))


def open_hdf5(path: Path, columns: Sequence[str] | None, group: str | None = None) -> Arrays:
    """Arrays of an HDF5 file; those in groups are named ``group/name``."""
    return arrays(str(path), _in_group(str(path), read_hdf5(path, mat=False), group), columns, {})


def frame_arrays(name: str, frame: Any) -> Arrays:
    """Columns of a pandas frame; its index is the time when it is named like one and no column is."""
    given = {str(k): frame[k] for k in frame.columns}
    if str(frame.index.name).partition(" ")[0].lower() in ("t", "time"):
        given = {str(frame.index.name): frame.index, **given}
    wrong = next((k for k, v in given.items() if getattr(v, "dtype", np.dtype(object)).kind not in "fiub"), None)
    if wrong is not None:
        raise DataError(f"{name}: column '{wrong}' holds {given[wrong].dtype} values, not numbers.")
    units = {str(k): str(u) for k, u in dict(getattr(frame, "attrs", {}).get("units", {})).items()}  # from to_pandas
    headings = [k if units.get(k, "") in ("", split_heading(k)[1]) else unambiguous_heading(k, units[k]) for k in given]
    return Arrays(name, headings, columns=[np.asarray(v, dtype=float) for v in given.values()])
