"""The contents of HDF5 files: all data sets by their paths, or the variables of a MAT file of version 7.3 as trees.

What a file announces is measured before it is read, and links into other files are not followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, clip
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.structures import MAX_NESTING, OBJECT, without_lone_dimension

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""Beginning of an HDF5 file, from its format specification; that of a MAT file has 512 bytes before."""
MOST_ITEMS = 20_000
"""Groups and data sets that are read at most. Chosen: a recording has hundreds, and references may form rings."""


def read_hdf5(path: Path, mat: bool) -> dict[str, Any]:
    """All data sets by their paths, or (of a MAT file) the variables as trees. Raises DataError."""
    try:
        import h5py
    except ImportError:
        what = "MAT files of version 7.3 need" if mat else "HDF5 files need"
        other = " Or save the file with '-v7'." if mat else ""
        raise DataError(f'{path}: {what} h5py: pip install "tsmblocks[data]".{other}') from None
    try:
        with h5py.File(path, "r") as file:
            content = _Content(str(path), file)
            return {k: content.tree(v) for k, v in content.members(file)} if mat else content.data_sets()
    except DataError:
        raise
    except Exception as error:  # h5py raises errors of any kind on a damaged file
        raise DataError(f"{path}: this is not an HDF5 file that can be read ({error}).") from None


@attrs.define
class _Content:
    """An open file, with the number of items and of bytes read from it."""

    origin: str
    file: Any
    items: int = 0
    bytes: int = 0

    def data_sets(self) -> dict[str, Any]:
        """All data sets by their paths."""
        import h5py

        found: dict[str, Any] = {}

        def keep(name: Any, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not _name(name).startswith("#"):
                found[_name(name)] = self.values(item)

        self.file.visititems(keep)
        return found

    def members(self, group: Any) -> Iterator[tuple[str, Any]]:
        """Names and items of a group. Raises DataError for a link that leads nowhere, or into another file."""
        import h5py

        for key in group:
            name = _name(key)
            if name.startswith("#"):
                continue
            if isinstance(key, bytes):
                raise DataError(f"{self.origin}: the name '{name}' in it is not UTF-8 text.")
            link = group.get(key, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                where = clip(f"{_name(link.filename)}: {_name(link.path)}")
                raise DataError(f"{self.origin}: '{name}' is a link into another file ({where}), which is not read.")
            item = group.get(key)
            if item is None:
                raise DataError(f"{self.origin}: '{name}' is a link to an item that is not in the file.")
            yield name, item

    def values(self, item: Any) -> Any:
        """The content of a data set. Raises DataError where it is too large, or in another file."""
        self._count()
        if item.is_virtual or item.external:
            raise DataError(f"{self.origin}: the data of '{_path(item)}' are in another file, which is not read.")
        self.bytes += (item.size or 0) * max(item.dtype.itemsize, np.dtype(float).itemsize)
        refuse_too_large(self.bytes, f"{self.origin}: its content up to '{_path(item)}' {item.shape}")
        return item[()]

    def _count(self) -> None:
        self.items += 1
        if self.items > MOST_ITEMS:
            raise DataError(f"{self.origin}: it leads to more than {MOST_ITEMS:,} groups and data sets.")

    def tree(self, item: Any, depth: int = 0) -> Any:
        """Plain Python of a group or data set of a MAT file, which keeps structures by references."""
        self._count()
        kind = _name(item.attrs.get("MATLAB_class", b""))
        if depth > MAX_NESTING or "MATLAB_object_decode" in item.attrs:
            return OBJECT
        if hasattr(item, "items"):
            return self._structure(dict(self.members(item)), depth)
        if not hasattr(item, "shape"):  # a named type
            return OBJECT
        if item.attrs.get("MATLAB_empty", 0):
            return "" if kind == "char" else np.empty(0)
        values = self.values(item)
        if item.dtype == object:
            cells = self._referenced(values, depth)
            return cells if kind == "cell" else without_lone_dimension(cells)
        values = np.asarray(values)
        if kind == "char":
            return "".join(map(chr, values.ravel()))
        return values.T if kind else values

    def _referenced(self, values: Any, depth: int) -> list[Any]:
        """What references lead to; a text has no reference."""
        return [self.tree(self.file[ref], depth + 1) for ref in np.ravel(values) if ref and hasattr(ref, "typecode")]

    def _structure(self, fields: Mapping[str, Any], depth: int) -> Any:
        """Return a structure, or the list of them when each field is a set of references of one size."""
        values = fields.values()
        of_references = all(_holds_references(v) and "MATLAB_class" not in v.attrs for v in values)
        if not fields or not of_references or len({v.size for v in values}) != 1:
            return {k: self.tree(v, depth + 1) for k, v in fields.items()}
        columns = [[self.tree(self.file[ref], depth + 1) for ref in np.ravel(self.values(v))] for v in values]
        return [dict(zip(fields, row, strict=True)) for row in zip(*columns, strict=True)]


def _path(item: Any) -> str:
    """Where an item lies in the file."""
    return _name(item.name)


def _holds_references(item: Any) -> bool:
    return getattr(getattr(item, "dtype", None), "kind", "") == "O"


def _name(text: Any) -> str:
    """A name of the file, which is bytes where it is not UTF-8."""
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
