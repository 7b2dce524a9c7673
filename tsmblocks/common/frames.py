"""Results as pandas frames and xarray data sets: named columns and coordinates, units in ``attrs``.

Both libraries are optional, and imported on use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from tsmblocks.common.errors import TsmError

EXTRAS = {"pandas": "data", "xarray": "xarray"}
"""Libraries, and the extra of this package that brings each."""

Column = tuple[Sequence[str], Any, str]
"""Dimensions, values and unit of a variable; the unit is ``""`` where none is known."""


def optional_library(library: str) -> Any:
    """The library; raises TsmError with the command that installs it."""
    try:
        return import_module(library)
    except ImportError:
        extra = EXTRAS[library]
        raise TsmError(f'to_{library} needs {library}: pip install "tsmblocks[{extra}]"') from None


def frame(
    columns: Mapping[str, Any], index: Any = None, name: str | None = None, units: Mapping[str, str] | None = None
) -> Any:
    """A pandas frame of columns over a named index; ``attrs["units"]`` has the known units.

    Raises TsmError where pandas is not installed.
    """
    pd = optional_library("pandas")
    labels = None if index is None else index if isinstance(index, pd.Index) else pd.Index(index, name=name)
    made = pd.DataFrame(dict(columns), index=labels)
    made.attrs["units"] = {k: u for k, u in (units or {}).items() if u and (k in made.columns or k == name)}
    return made


def dataset(variables: Mapping[str, Column], coords: Mapping[str, Column], facts: Mapping[str, Any]) -> Any:
    """An xarray data set; ``facts`` are its attributes, in types that netCDF holds.

    Raises TsmError where xarray is not installed.
    """
    xr = optional_library("xarray")
    made = {k: (tuple(dims), _values(v), {"units": u} if u else {}) for k, (dims, v, u) in variables.items()}
    axes = {k: (tuple(dims), _values(v), {"units": u} if u else {}) for k, (dims, v, u) in coords.items()}
    return xr.Dataset(made, axes, {k: int(v) if isinstance(v, bool) else v for k, v in facts.items() if v is not None})


def _values(given: Any) -> np.ndarray:
    """An array of a type that netCDF holds: texts as texts, other objects (options) as their text."""
    array = np.asarray(given)
    return array if array.dtype.kind in "fiubcU" else np.array([str(v) for v in array.ravel()]).reshape(array.shape)
