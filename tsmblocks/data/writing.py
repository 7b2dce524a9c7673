"""Signals written to files that ``read`` takes again: CSV, NPZ and MAT."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tsmblocks.common.atomic_write import replace_mat, replacing
from tsmblocks.common.errors import DataError, in_words
from tsmblocks.common.headings import split_heading, unambiguous_heading

ENDINGS = (".csv", ".npz", ".mat")
"""Endings of files that are written."""
RESERVED_NAMES = ("t", "units", "file", "allow_pickle")
"""Names that NumPy's archives, or this package in them, use for something else."""
_MATLAB = re.compile(r"[A-Za-z]\w{0,62}", re.ASCII)
_CONTROL = re.compile(r"[\x00-\x1f\x7f\ud800-\udfff]")
"""Control characters and lone surrogates, which end a line or a name in an archive."""


def written(
    path: str | Path, t: np.ndarray, signals: Mapping[str, np.ndarray], units: Mapping[str, str], advice: str
) -> Path:
    """Write signals over the times ``t`` [s] to .csv, .npz or .mat; returns the path.

    ``advice`` is the remedy for a name that cannot be written. Raises DataError for another ending, a folder that is
    not there, two signals that would take one name there, and names that would not be read again as they are.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in ENDINGS:
        raise DataError(f"'{path}' ends in '{path.suffix}'; results are written to .csv, .npz or .mat.")
    if not path.parent.is_dir():
        raise DataError(f"there is no folder '{path.parent}' to write {path.name} into.")
    columns = {"t [s]" if kind == ".csv" else "t": t}
    for name, values in signals.items():
        title, why = _title(name, units.get(name, ""), kind)
        if not why and (name == "t" or title in columns or (kind != ".csv" and title in RESERVED_NAMES)):
            why = f"the name '{title}' is taken there"
        if why:
            raise DataError(f"signal {in_words(name)} cannot be written to '{path.name}': {why}. {advice}")
        columns[title] = values
    _write(path, kind, columns, [f"{name}={units.get(name, '')}" for name in signals])
    return path


def _title(name: str, unit: str, kind: str) -> tuple[str, str]:
    """The name of a signal in a file, and why it cannot be written there unchanged, or ``""``."""
    if kind == ".mat":
        title = _matlab_name(name)
        return title, "" if _MATLAB.fullmatch(title) else "MATLAB has no variables of such names"
    title = unambiguous_heading(name, unit)
    kept = name and split_heading(title) == (name, unit) and not _CONTROL.search(title)
    if kept and (kind == ".csv" or "=" not in unit):
        return title if kind == ".csv" else name, ""
    return title, f"it would not be read from there as it is{f', in {in_words(unit)}' if unit else ''}"


def _write(path: Path, kind: str, columns: Mapping[str, np.ndarray], units: list[str]) -> None:
    if kind == ".mat":
        replace_mat(path, columns)
        return
    with replacing(path) as file:
        if kind == ".csv":
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")  # names with commas and quotes in quotes
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())  # the fewest digits that are read as it
            file.write(text.getvalue().encode())
        else:
            np.savez_compressed(file, **columns, units=np.array(units))  # type: ignore[arg-type]


def _matlab_name(name: str) -> str:
    """A MATLAB variable for a signal: no dots, and a letter in front."""
    plain = name.replace(".", "_")
    return plain if not plain or plain[0].isalpha() else f"x{plain}"
