"""Signals written to files that ``read`` takes again: CSV, NPZ and MAT."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from tsmblocks.errors import DataError
from tsmblocks.units import heading

TAKEN = ("t", "units", "file", "allow_pickle")
"""Names that NumPy's archives, or this package in them, use for something else."""


def written(path: str | Path, t: np.ndarray, signals: Mapping[str, np.ndarray], units: Mapping[str, str]) -> Path:
    """Write signals over the times ``t`` [s] to .csv, .npz or .mat; returns the path.

    Raises DataError for another ending, and for two signals that would take one name there.
    """
    path = Path(path)
    kinds: dict[str, Callable[[str], str]] = {
        ".csv": lambda name: heading(name, units.get(name, "")), ".npz": str, ".mat": _variable
    }  # fmt: skip
    kind = path.suffix.lower()
    if kind not in kinds:
        raise DataError(f"'{path}' ends in '{path.suffix}'; results are written to .csv, .npz or .mat.")
    columns = {"t [s]" if kind == ".csv" else "t": t}
    for name, values in signals.items():
        title = kinds[kind](name)
        if name == "t" or title in columns or (kind != ".csv" and title in TAKEN):
            raise DataError(
                f"signal '{name}' cannot be written to '{path.name}': the name '{title}' is taken there. "
                "Give the output another name, or leave it out with names=[...]."
            )
        columns[title] = values
    _put(path, kind, columns, [f"{name}={units.get(name, '')}" for name in signals])
    return path


def _put(path: Path, kind: str, columns: Mapping[str, np.ndarray], units: list[str]) -> None:
    if kind == ".csv":
        with path.open("w", encoding="utf-8", newline="\n") as text:
            np.savetxt(text, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns),
                       comments="", fmt="%.17g")  # fmt: skip
        return
    with path.open("wb") as file:  # a path would be given another ending where this one is in capitals
        if kind == ".npz":
            np.savez_compressed(file, **columns, units=np.array(units))  # type: ignore[arg-type]
        else:
            from scipy.io import savemat

            savemat(file, columns)


def _variable(name: str) -> str:
    """A MATLAB variable for a signal: no dots, and a letter in front."""
    plain = name.replace(".", "_")
    return plain if plain[0].isalpha() else f"x{plain}"
