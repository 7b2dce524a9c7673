"""Reading arrays by name from NPZ, MAT and HDF5 files, and from a pandas frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.data.record import heading
from tsmblocks.data.table import Rows, within
from tsmblocks.errors import DataError

_HDF5 = b"\x89HDF\r\n\x1a\n"


@attrs.frozen(eq=False)
class Arrays:
    """Arrays of one length with their headings."""

    origin: str
    headings: Sequence[str]
    columns: list[np.ndarray] = attrs.field(repr=False)
    notes: tuple[str, ...] = ()

    def numbers(self, chosen: Sequence[int], rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """See Source; the first sample is row 1."""
        at = np.arange(1, len(self.columns[0]) + 1)
        kept = within(at, rows)
        values = np.column_stack([self.columns[k] for k in chosen]) if chosen else np.empty((len(at), 0))
        values = np.where(np.isfinite(values), values, np.nan)
        return values[kept], at[kept]


def _plain(value: Any) -> np.ndarray | None:
    """Return an array of real numbers with lone dimensions dropped, else None."""
    array = np.squeeze(np.asarray(value)) if value is not None else np.empty(())
    return array.astype(float) if array.dtype.kind in "fiub" and array.ndim in (1, 2) else None


def arrays(origin: str, found: Mapping[str, Any], columns: Sequence[str] | None, units: Mapping[str, str]) -> Arrays:
    """Columns out of whatever arrays a file holds. Raises DataError when there are none of one length."""
    known = {name: array for name, value in found.items() if (array := _plain(value)) is not None}
    series = {name: array for name, array in known.items() if array.ndim == 1 and len(array) > 1}
    if columns or not series:
        return _matrix(origin, known, columns)
    lengths = [len(a) for a in series.values()]
    clock = next((k for k in series if k.rpartition("/")[2].lower() in ("t", "time")), None)
    length = len(series[clock]) if clock else max(set(lengths), key=lengths.count)
    kept = {k: a for k, a in series.items() if len(a) == length}
    left = [k for k in series if k not in kept]
    notes = (f"Left out, being of another length than {clock or next(iter(kept))}: {', '.join(left)}.",) if left else ()
    return Arrays(origin, [heading(k, units.get(k, "")) for k in kept], list(kept.values()), notes)


def _matrix(origin: str, known: Mapping[str, np.ndarray], columns: Sequence[str] | None) -> Arrays:
    """Columns of the one matrix that a file holds, under the names given."""
    tables = {k: a for k, a in known.items() if a.ndim == 2}
    inside = ", ".join(f"{k} {a.shape}" for k, a in known.items()) or "none"
    if len(tables) != 1:
        raise DataError(
            f"{origin}: no arrays of one length were found that could be signals. Numeric arrays: {inside}."
        )
    name, table = next(iter(tables.items()))
    if not columns or len(columns) != table.shape[1]:
        given = f"{len(columns)} names were given" if columns else "they have no names"
        raise DataError(f"{origin}: '{name}' has {table.shape[1]} columns, but {given}. Name them in order, "
                        "with units (columns = t, x_in [deg], …).")  # fmt: skip
    return Arrays(origin, list(columns), list(table.T))


def open_npz(path: Path, columns: Sequence[str] | None) -> Arrays:
    """Arrays of an NPZ (or NPY) file; ``units`` in it, as ``Run.save`` writes, gives their units."""
    try:
        with np.load(path, allow_pickle=False) as held:
            found = {k: held[k] for k in held.files}
    except (ValueError, OSError, EOFError) as error:
        raise DataError(f"{path}: this is not a NPZ file of plain numbers ({error}).") from None
    labels = [str(text).partition("=") for text in np.ravel(found.pop("units", []))]
    return arrays(str(path), found, columns, {name: unit for name, _, unit in labels})


def open_mat(path: Path, columns: Sequence[str] | None) -> Arrays:
    """Arrays of a MAT file, of version 5 through scipy or 7.3 through h5py."""
    with path.open("rb") as file:
        start = file.read(1024)
    if _HDF5 in start:
        return open_hdf5(path, columns)
    from scipy.io import loadmat

    try:
        found = loadmat(path)
    except Exception as error:  # scipy raises whatever a damaged file leads it to
        raise DataError(f"{path}: this is not a MAT file that can be read ({error}).") from None
    return arrays(str(path), {k: v for k, v in found.items() if not k.startswith("__")}, columns, {})


def open_hdf5(path: Path, columns: Sequence[str] | None) -> Arrays:
    """Arrays of an HDF5 file or a MAT file of version 7.3; those in groups are named ``group/name``."""
    try:
        import h5py
    except ImportError:
        raise DataError(f"{path}: MAT files of version 7.3 need h5py: pip install \"tsmblocks[data]\". "
                        "Or save the file with '-v7'.") from None  # fmt: skip
    found: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            found[name] = item[()]

    try:
        with h5py.File(path, "r") as file:
            file.visititems(keep)
    except OSError as error:
        raise DataError(f"{path}: this is not an HDF5 file that can be read ({error}).") from None
    return arrays(str(path), found, columns, {})


def frame_arrays(name: str, frame: Any) -> Arrays:
    """Columns of a pandas frame; its index is the time when it is named like one and no column is."""
    given = {str(k): frame[k] for k in frame.columns}
    if str(frame.index.name).partition(" ")[0].lower() in ("t", "time"):
        given = {str(frame.index.name): frame.index, **given}
    wrong = [k for k, v in given.items() if getattr(v, "dtype", np.dtype(object)).kind not in "fiub"]
    if wrong:
        raise DataError(f"{name}: column '{wrong[0]}' holds {given[wrong[0]].dtype} values, not numbers.")
    return Arrays(name, list(given), [np.asarray(v, dtype=float) for v in given.values()])
