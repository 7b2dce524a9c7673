"""The variables of a MAT file up to version 7, through SciPy, once the file has been found to be whole.

SciPy's reader follows types, sizes and counts as a file gives them: wrong ones end the process, or take memory without
end. So the elements are walked before, as "MAT-File Level 5 File Format" (The MathWorks, 2023) describes them.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import attrs

from tsmblocks.common.errors import DataError
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.structures import MAX_NESTING, tree_of_mat

ITEM_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
"""Bytes of an item by the type of its element (table 1-1 of the format)."""
MATRIX, COMPRESSED = 14, 15
CELL, STRUCTURE, OBJECT, TEXT, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMBERS = range(6, 16)
"""Classes of arrays of numbers."""
LOGICAL_OR_COMPLEX = 0x08
HEADER_BYTES = 128
PIECE = 1 << 20


class _Wrong(Exception):
    """A file that is not as the format says."""


def read_mat5(path: Path) -> dict[str, Any]:
    """The variables of a MAT file of version 4 to 7 as trees. Raises DataError for one that is damaged or too large."""
    from scipy.io import loadmat
    from scipy.io.matlab import matfile_version

    try:
        with path.open("rb") as file:
            if matfile_version(file)[0] == 1:
                check(str(path), path.read_bytes())
        found = loadmat(path)
    except DataError:
        raise
    except Exception as error:  # scipy raises errors of any kind on a damaged file
        raise DataError(f"{path}: this is not a MAT file that can be read ({error}).") from None
    return {k: tree_of_mat(v) for k, v in found.items() if not k.startswith("__")}


def check(origin: str, content: bytes) -> None:
    """Raise an error unless every element of the file lies within the one that holds it and has what it announces."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise _Wrong("its byte order is not given")
    file = _Part(order, memoryview(content), HEADER_BYTES)
    while file.at < len(content):
        kind, body = file.element(padded=False)
        if kind == COMPRESSED:
            body = _Part(order, memoryview(_inflated(origin, body.content)))
            kind, body = body.element()
        if kind != MATRIX:
            raise _Wrong(f"a variable begins with an element of type {kind}")
        _check_matrix(body)


@attrs.define
class _Part:
    """Bytes with elements one after the other, and the place of the next."""

    order: str
    content: memoryview
    at: int = 0

    def element(self, padded: bool = True) -> tuple[int, _Part]:
        """Type and content of the next element."""
        kind, size = self._integers("II")
        if kind >> 16:  # both in four bytes, and the data in the next four
            kind, size, start, self.at = kind & 0xFFFF, kind >> 16, self.at + 4, self.at + 8
            if size > 4:
                raise _Wrong("a short element is longer than four bytes")
        else:
            start = self.at + 8
            self.at = start + size + (-size % 8 if padded and kind != COMPRESSED else 0)
        if start + size > len(self.content):
            raise _Wrong(f"an element of {size} bytes is cut off")
        return kind, _Part(self.order, self.content[start : start + size])

    def data(self, *kinds: int) -> tuple[int, memoryview]:
        """Number of items and bytes of the next element, which holds data (of one of these types)."""
        kind, body = self.element()
        if kind not in (kinds or ITEM_BYTES) or len(body.content) % ITEM_BYTES[kind]:
            raise _Wrong(f"an element of type {kind} and {len(body.content)} bytes is found where data are expected")
        return len(body.content) // ITEM_BYTES[kind], body.content

    def integers(self, *kinds: int) -> tuple[int, ...]:
        """The items of the next element, integers of four bytes."""
        count, content = self.data(*kinds)
        return struct.unpack(f"{self.order}{count}{'I' if kinds == (6,) else 'i'}", content)

    def _integers(self, form: str) -> tuple[int, ...]:
        if self.at + 8 > len(self.content):
            raise _Wrong("it ends within an element")
        return struct.unpack_from(self.order + form, self.content, self.at)


def _check_matrix(part: _Part, depth: int = 0) -> None:
    """Check an array of any class, and those inside."""
    if not len(part.content):
        return  # an empty array, in a cell or a field
    if depth > 4 * MAX_NESTING:
        raise _Wrong("structures lie too deep in each other")
    flags = part.integers(6)
    if len(flags) != 2:
        raise _Wrong("flags of an array have another size")
    of_class, is_complex = flags[0] & 0xFF, flags[0] >> 8 & LOGICAL_OR_COMPLEX
    if of_class == OPAQUE:
        _check_opaque(part)
        return
    size = part.integers(5)
    if len(size) < 2 or min(size) < 0:
        raise _Wrong(f"an array has the size {size}")
    part.data(1, 2)  # the name
    if of_class in NUMBERS:
        _check_numbers(part, math.prod(size), bool(is_complex))
    elif of_class == TEXT:
        _check_text(part, math.prod(size))
    elif of_class == SPARSE:
        _check_sparse(part, size, bool(is_complex))
    else:
        _check_inner(part, math.prod(size) * _arrays_in_each(part, of_class), depth)


def _arrays_in_each(part: _Part, of_class: int) -> int:
    """The arrays in each item of an array that holds others."""
    if of_class in (CELL, FUNCTION):
        return 1
    if of_class in (STRUCTURE, OBJECT):
        return _fields(part, of_class)
    raise _Wrong(f"there is no class {of_class} of arrays")


def _check_text(part: _Part, count: int) -> None:
    if part.at < len(part.content) and part.data()[0] > count:
        raise _Wrong("a text is longer than its size")


def _check_numbers(part: _Part, count: int, is_complex: bool) -> None:
    for _ in range(2 if is_complex else 1):
        found = part.data()[0]
        if found != count:
            raise _Wrong(f"an array of {count} numbers has {found}")


def _check_sparse(part: _Part, size: tuple[int, ...], is_complex: bool) -> None:
    rows, starts = part.integers(5), part.integers(5)
    values = [part.data()[0] for _ in range(2 if is_complex else 1)]
    wrong = len(starts) != size[1] + 1 or any(a > b for a, b in zip((0, *starts), (*starts, len(rows)), strict=True))
    if wrong or min(values) < starts[-1] or any(not 0 <= row < size[0] for row in rows[: starts[-1]]):
        raise _Wrong("the places of a sparse array do not fit its size")


def _fields(part: _Part, of_class: int) -> int:
    """The number of fields of a structure."""
    if of_class == OBJECT:
        part.data(1, 2)  # the name of its class
    length = part.integers(5)
    names = len(part.data(1, 2)[1])
    if len(length) != 1 or length[0] < 1 or names % length[0]:
        raise _Wrong("the names of fields do not fit their length")
    return names // length[0]


def _check_inner(part: _Part, count: int, depth: int) -> None:
    if count > len(part.content) // 8:  # each takes eight bytes at least
        raise _Wrong(f"{count} arrays are announced in {len(part.content)} bytes")
    for _ in range(count):
        kind, inner = part.element()
        if kind != MATRIX:
            raise _Wrong(f"an element of type {kind} is found where an array is expected")
        _check_matrix(inner, depth + 1)


def _check_opaque(part: _Part) -> None:
    """Check an object of a MATLAB class: three names, and an array."""
    for _ in range(3):
        part.data(1, 2)
    _check_inner(part, 1, 0)


def _inflated(origin: str, content: memoryview) -> bytes:
    """The content of a compressed element. Raises DataError when it is larger than the memory."""
    made = bytearray()
    for piece in _inflate(content):
        made += piece
        refuse_too_large(2 * len(made), f"{origin}: a variable, unpacked,")
    return bytes(made)


def _inflate(content: memoryview) -> Iterator[bytes]:
    stream = zlib.decompressobj()
    rest = bytes(content)
    while rest and not stream.eof:
        yield stream.decompress(rest, PIECE)
        rest = stream.unconsumed_tail
    yield stream.flush()
