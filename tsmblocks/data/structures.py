"""Structures of MATLAB files as plain Python, and the signals in the layouts that Simulink and dSPACE give them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, clip

MAX_NESTING = 12
"""Structures within structures that are followed at most. Chosen: references of a file may form a ring."""
OBJECT = object()
"""Denotes an object of a MATLAB class, which only MATLAB can read."""


# ---- trees: dict for a structure, list for an array of them or a cell array, str, numbers, OBJECT


def tree_of_mat(value: Any) -> Any:
    """Plain Python of what scipy.io.loadmat gives for one variable."""
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        return OBJECT
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        return without_lone_dimension(
            [{k: tree_of_mat(item[k]) for k in value.dtype.names} for item in value.ravel(order="F")]
        )
    if value.dtype == object:
        return without_lone_dimension([tree_of_mat(item) for item in value.ravel(order="F")])
    if value.dtype.kind in "US":
        return str(value.ravel()[0]) if value.size else ""
    return value


def without_lone_dimension(items: list[Any]) -> Any:
    """A list, or its item where there is one."""
    return items[0] if len(items) == 1 else items


# ---- layouts


@attrs.frozen(eq=False)
class Axis:
    """Signals on one time axis, as one structure holds them. ``time`` is empty when it has none."""

    time: np.ndarray
    unit: str = ""
    signals: dict[str, np.ndarray] = attrs.field(factory=dict)
    units: dict[str, str] = attrs.field(factory=dict)


@attrs.frozen(eq=False)
class MatSignals:
    """Arrays of a file by name, with what is known of their units and notes on those left out."""

    arrays: dict[str, Any]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()


def signals_of(tree: Mapping[str, Any]) -> MatSignals:
    """Signals of every layout known here; arrays elsewhere by their path, ``structure/field``."""
    leaves = list(_leaves("", tree))
    axes = [(name, value) for name, value in leaves if isinstance(value, Axis)]
    plain = {name: value for name, value in leaves if isinstance(value, np.ndarray)}
    objects = tuple(name for name, value in leaves if value is OBJECT)
    notes = (f"Left out, being objects of MATLAB: {', '.join(objects)}.",) if objects else ()
    if not axes:
        return MatSignals(plain, {}, notes, objects)
    name, first = max(axes, key=lambda pair: len(pair[1].signals))
    arrays, units, on_other_axes = dict(first.signals), dict(first.units), []
    for other, axis in axes:
        if not np.array_equal(axis.time, first.time):
            on_other_axes.append(other)
            continue
        for key, values in axis.signals.items() if axis is not first else ():
            key = key if key not in arrays else f"{other}/{key}"
            arrays[key], units[key] = values, axis.units.get(key, "")
    if on_other_axes:
        notes = (*notes, f"Left out, being on another time axis than {name}: {', '.join(on_other_axes)}.")
    if first.time.size:
        arrays, units = {"t": first.time, **arrays}, {"t": first.unit, **units}
    for key, values in plain.items():
        if np.size(values) == np.size(first.time) and not np.array_equal(np.ravel(values), first.time):
            arrays.setdefault(key, values)
    return MatSignals(arrays, units, notes, objects)


def _leaves(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Names and values of axes of the known layouts, of other arrays, and of objects."""
    if depth > MAX_NESTING:
        return
    if value is OBJECT or isinstance(value, np.ndarray):
        yield name, value
    elif isinstance(value, Mapping):
        axes = [axis for layout in (_controldesk, _simulink, _timeseries) for axis in layout(name, value)]
        yield from ((name, axis) for axis in axes)
        for key, item in value.items() if not axes else ():
            yield from _leaves(f"{name}/{key}" if name else str(key), item, depth + 1)
    elif isinstance(value, list):
        for k, item in enumerate(value, 1):
            yield from _leaves(f"{name}_{k}", item, depth + 1)


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _numbers(value: Any) -> np.ndarray:
    """An array of numbers as floats; an empty one of anything else."""
    return value.astype(float) if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" else np.empty(0)


def _clean_title(value: Any) -> str:
    """A title without the quotes and braces of dSPACE, and without brackets that would be taken for a unit."""
    text = value if isinstance(value, str) else ""
    text = re.sub(r"[\"{}]", "", text).strip().strip("/")
    return re.sub(r"[\[(](\d+)[\])]", r"_\1", text)


def _controldesk(_name: str, value: Mapping[str, Any]) -> list[Axis]:
    """A recording of dSPACE ControlDesk: X(i).Data the times, Y(k).Name and Y(k).Data the signals.

    Where there are several times, Y(k).XIndex or the name of the Raster says which one belongs to a signal.
    """
    xs, ys = _as_list(value.get("X")), _as_list(value.get("Y"))
    if not all(isinstance(part, Mapping) and "Data" in part for part in (*xs, *ys)):
        return []
    titles = _without_common_folders([_clean_title(y.get("Name")) or f"y_{k}" for k, y in enumerate(ys, 1)])
    axes: dict[int, Axis] = {}
    for title, y in zip(titles, ys, strict=True):
        at = _axis_of(y, xs)
        axis = axes.setdefault(at, Axis(_numbers(xs[at]["Data"]).ravel(), _clean_title(xs[at].get("Unit"))))
        axis.signals[title], axis.units[title] = _numbers(y["Data"]).ravel(), _clean_title(y.get("Unit"))
    return list(axes.values())


def _axis_of(y: Mapping[str, Any], xs: list[Any]) -> int:
    index = _numbers(y.get("XIndex")).ravel()
    if index.size == 1 and 1 <= index[0] <= len(xs):
        return int(index[0]) - 1
    raster = y.get("Raster")
    named = [k for k, x in enumerate(xs) if isinstance(raster, str) and x.get("Raster") == raster]
    fits = [k for k, x in enumerate(xs) if np.size(x["Data"]) == np.size(y["Data"])]
    return next(iter(named or fits), 0)


def _without_common_folders(names: list[str]) -> list[str]:
    """Paths without the folders that all of them share, at either end, as long as they stay different."""
    parts = [re.split(r"/+", name) for name in names]
    for kept in (slice(1, None), slice(None, -1)):
        while len(parts) > 1 and min(map(len, parts)) > 1:
            if len({p[0 if kept.start else -1] for p in parts}) > 1:
                break
            parts = [p[kept] for p in parts]
    return ["/".join(p) for p in parts]


def _simulink(name: str, value: Mapping[str, Any]) -> list[Axis]:
    """What To Workspace writes as a structure: time (empty in one form), and signals(k).values, .label."""
    signals = _as_list(value.get("signals"))
    if not all(isinstance(part, Mapping) and "values" in part for part in signals):
        return []
    axis = Axis(_numbers(value.get("time")).ravel())
    for k, part in enumerate(signals, 1):
        title = _clean_title(part.get("label")) or (f"{name}_{k}" if len(signals) > 1 else name)
        axis.signals.update(_elements(title, part["values"], len(axis.time)))
    return [axis]


def _timeseries(name: str, value: Mapping[str, Any]) -> list[Axis]:
    """A structure made of a timeseries: Time and Data, and Name where it was kept."""
    if not {"Time", "Data"} <= set(value):
        return []
    info = value.get("DataInfo")
    unit = _clean_title(info.get("Units") if isinstance(info, Mapping) else value.get("Units"))
    time = _numbers(value["Time"]).ravel()
    signals = _elements(_clean_title(value.get("Name")) or name, value["Data"], len(time))
    return [Axis(time, "", signals, dict.fromkeys(signals, unit))]


def _elements(title: str, values: Any, length: int) -> dict[str, np.ndarray]:
    """A signal, or the elements of a vector signal under numbered names, each of ``length`` samples."""
    array = _numbers(values)
    if not array.size:
        return {}
    if array.ndim > 2:  # a matrix at every instant: time comes last
        array = array.reshape(-1, array.shape[-1]).T
    if array.ndim == 2 and array.shape[0] != length and array.shape[1] == length:
        array = array.T
    if array.ndim == 1 or 1 in array.shape:
        return {title: array.ravel()}
    return {f"{title}_{k}": column for k, column in enumerate(array.T, 1)}


def refuse_objects(path: Path | str, objects: tuple[str, ...]) -> None:
    """Raise DataError when a file holds objects of MATLAB classes and nothing else."""
    if objects:
        named = clip(", ".join(k for k in objects if k) or "without a name")
        raise DataError(
            f"{path}: it holds objects of MATLAB ({named}), such as timeseries, which only MATLAB can read. Save "
            "their numbers there: t = x.Time; x_in = x.Data; save('file.mat', 't', 'x_in')."
        )
