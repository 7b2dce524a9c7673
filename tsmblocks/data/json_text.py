"""Reading recordings from JSON: lists of numbers by name, rows as objects, or rows with names of columns."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsmblocks.common.errors import DataError, in_words, near
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.containers import COPIES, Arrays, arrays, refuse_twice, without_columns
from tsmblocks.data.structures import MAX_NESTING
from tsmblocks.data.text import MAX_COLUMNS

JSON_BYTES = 20
"""Bytes of memory for one of a JSON file. Derived: a list takes 56 bytes and its place in another 8, of "[],"."""
MAX_DIGITS = 300
"""Digits from which a whole number is infinite. Chosen: floats end at 1.8e308."""


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
        found = inner[0] if len(inner) == 1 and all(_numbers(v) is None for v in found.values()) else found
    if _are_rows(found):
        found = _columns_of_rows(path, found)
    if not isinstance(found, dict):
        raise DataError(
            f"{path}: the JSON must hold lists of numbers by name, or rows as objects, not {in_words(found)}."
        )
    units = found.get("units")
    labels = _labels(path, units) if isinstance(units, dict) else {}
    leaves = [(_encodable(name), value) for name, value in _leaves(found)]
    named = {name: numbers for name, value in leaves if (numbers := _numbers(value)) is not None}
    made = arrays(str(path), named, columns, labels)
    others = [name for name, value in leaves if isinstance(value, list) and value and name not in named]
    return without_columns(made, others)


def _labels(path: Path, units: Mapping[str, Any]) -> dict[str, str]:
    """Units by name, without those that are null. Raises DataError for one that is no text."""
    wrong = next((name for name, unit in units.items() if not isinstance(unit, str | None)), None)
    if wrong is not None:
        raise DataError(f"{path}: the unit of '{wrong}' must be text, not {in_words(units[wrong])}.")
    return {_encodable(name): _encodable(unit) for name, unit in units.items() if unit}


def _encodable(text: str) -> str:
    """A text that a file can hold: JSON has escapes for halves of characters."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _columns_of_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Columns of rows, each of which may have other names: NaN where a row does not have the name."""
    places, values = dict[str, list[int]](), dict[str, list[Any]]()
    for k, row in enumerate(rows):
        for name, value in row.items():
            places.setdefault(name, []).append(k)
            values.setdefault(name, []).append(value)
    if len(values) > MAX_COLUMNS:
        raise DataError(f"{path}: the rows have {len(values):,} names; at most {MAX_COLUMNS:,} columns are read.")
    refuse_too_large(COPIES * 8.0 * len(rows) * len(values), f"{path}: reading it")
    columns: dict[str, Any] = {}
    for name, listed in values.items():
        numbers = _numbers(listed)
        columns[name] = listed
        if numbers is not None and numbers.ndim == 1:
            columns[name] = np.full(len(rows), np.nan)
            columns[name][places[name]] = numbers
    return columns


def _split(path: Path, columns: list[Any], rows: list[Any]) -> dict[str, Any]:
    """Columns of a table as pandas writes it with ``orient="split"``. Raises DataError for a row of another length."""
    for k, row in enumerate(rows, 1):
        if not isinstance(row, list) or len(row) != len(columns):
            raise DataError(f"{path}: row {k} of 'data' must list {len(columns)} values, not {in_words(row)}.")
    refuse_twice(str(path), list(map(str, columns)))
    return {str(name): [row[i] for row in rows] for i, name in enumerate(columns)}


def _json(path: Path) -> Any:
    """The content of a JSON file, or the list of the lines of one that has an object on each."""
    refuse_too_large(JSON_BYTES * path.stat().st_size, f"{path}: reading it")
    text = path.read_text(encoding="utf-8", errors="replace").removeprefix("\ufeff")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            refuse_twice(str(path), [name for name, _ in pairs])
        return made

    read = functools.partial(json.loads, parse_int=_integer, object_pairs_hook=unique)
    try:
        return read(text)
    except (ValueError, RecursionError) as error:
        lines = [line for line in text.splitlines() if line.strip()]
        try:
            if len(lines) > 1:
                return [read(line) for line in lines]
        except (ValueError, RecursionError):
            pass
        raise DataError(f"{path}: this is not JSON that can be read ({error}).") from None


def _integer(text: str) -> float:
    """A whole number; infinity for one that no float holds, as JSON reads 1e400."""
    return int(text) if len(text) < MAX_DIGITS else float("-inf" if text.startswith("-") else "inf")


def _are_rows(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(isinstance(row, dict) for row in value)


def _numbers(value: Any) -> np.ndarray | None:
    """A list of numbers, null being none, or an array of them; None for anything else."""
    if isinstance(value, np.ndarray):
        return value
    if not isinstance(value, list) or not value:
        return None
    try:
        return np.array([np.nan if v is None else v for v in value], dtype=float)
    except (TypeError, ValueError):
        return None


def _leaves(found: Mapping[str, Any], above: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Every value that is no object, with its path."""
    for name, value in found.items():
        if isinstance(value, dict):
            if depth < MAX_NESTING:
                yield from _leaves(value, f"{above}{name}/", depth + 1)
        else:
            yield f"{above}{name}", value
