"""Structures of MATLAB files as plain Python, and the signals in the layouts that Simulink and dSPACE give them."""

from __future__ import annotations

import re
from collections.abc import Mapping
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
        return _without_lone_dimension(
            [{k: tree_of_mat(item[k]) for k in value.dtype.names} for item in value.ravel(order="F")]
        )
    if value.dtype == object:
        return _without_lone_dimension([tree_of_mat(item) for item in value.ravel(order="F")])
    if value.dtype.kind in "US":
        return str(value.ravel()[0]) if value.size else ""
    return value


def _without_lone_dimension(items: list[Any]) -> Any:
    return items[0] if len(items) == 1 else items


def tree_of_hdf5(file: Any, item: Any, depth: int = 0) -> Any:
    """Plain Python of a group or data set of a MAT file of version 7.3, which keeps structures by references."""
    kind = _text_of(item.attrs.get("MATLAB_class", ""))
    if depth > MAX_NESTING or "MATLAB_object_decode" in item.attrs:
        return OBJECT
    if hasattr(item, "items"):
        return _structure(file, {k: v for k, v in item.items() if not k.startswith("#")}, depth)
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.empty(0)
    if item.dtype == object:
        cells = [tree_of_hdf5(file, file[ref], depth + 1) for ref in np.ravel(item[()]) if ref]
        return cells if kind == "cell" else _without_lone_dimension(cells)
    values = np.asarray(item[()])
    if kind == "char":
        return "".join(map(chr, values.ravel()))
    return values.T if kind else values


def _structure(file: Any, fields: Mapping[str, Any], depth: int) -> Any:
    """Return a structure, or the list of them when each field is a set of references of one size."""
    sets = {
        k: v
        for k, v in fields.items()
        if not hasattr(v, "items") and v.dtype == object and "MATLAB_class" not in v.attrs
    }
    if not sets or len(sets) < len(fields) or len({v.size for v in sets.values()}) != 1:
        return {k: tree_of_hdf5(file, v, depth + 1) for k, v in fields.items()}
    columns = {k: [tree_of_hdf5(file, file[ref], depth + 1) for ref in np.ravel(v[()])] for k, v in sets.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _text_of(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


# ---- layouts


@attrs.frozen(eq=False)
class Axis:
    """Signals on one time axis, as one structure holds them. ``time`` is empty when it has none."""

    time: np.ndarray
    unit: str
    signals: dict[str, np.ndarray]
    units: dict[str, str]


@attrs.frozen(eq=False)
class MatSignals:
    """Arrays of a file by name, with what is known of their units and notes on those left out."""

    arrays: dict[str, Any]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()


def signals_of(tree: Mapping[str, Any]) -> MatSignals:
    """Signals of every layout known here; arrays elsewhere by their path, ``structure/field``."""
    axes: list[tuple[str, Axis]] = []
    plain: dict[str, Any] = {}
    objects: list[str] = []
    _collect("", tree, axes, plain, objects)
    object_notes = (f"Left out, being objects of MATLAB: {', '.join(objects)}.",) if objects else ()
    if not axes:
        return MatSignals(plain, {}, object_notes, tuple(objects))
    name, first = max(axes, key=lambda pair: len(pair[1].signals))
    arrays, units, on_other_axes = dict(first.signals), dict(first.units), []
    for other, axis in axes:
        if axis is first:
            continue
        if not np.array_equal(axis.time, first.time):
            on_other_axes.append(other)
            continue
        for key, values in axis.signals.items():
            key = key if key not in arrays else f"{other}/{key}"
            arrays[key], units[key] = values, axis.units.get(key, "")
    notes = (f"Left out, being on another time axis than {name}: {', '.join(on_other_axes)}.",) if on_other_axes else ()
    notes = (*object_notes, *notes)
    if first.time.size:
        arrays, units = {"t": first.time, **arrays}, {"t": first.unit, **units}
    extra = {
        k: v
        for k, v in plain.items()
        if k not in arrays and np.size(v) == np.size(first.time) and not np.array_equal(np.ravel(v), first.time)
    }
    return MatSignals({**arrays, **extra}, units, notes, tuple(objects))


def _collect(
    name: str, value: Any, axes: list[tuple[str, Axis]], plain: dict[str, Any], objects: list[str], depth: int = 0
) -> None:
    if depth > MAX_NESTING:
        return
    if value is OBJECT:
        objects.append(name)
    elif isinstance(value, Mapping):
        found = [axis for layout in (_controldesk, _simulink, _timeseries) for axis in layout(name, value)]
        if found:
            axes.extend((name, axis) for axis in found)
            return
        for key, item in value.items():
            _collect(f"{name}/{key}" if name else str(key), item, axes, plain, objects, depth + 1)
    elif isinstance(value, list):
        for k, item in enumerate(value, 1):
            _collect(f"{name}_{k}", item, axes, plain, objects, depth + 1)
    elif isinstance(value, np.ndarray):
        plain[name] = value


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _flat_numbers(value: Any) -> np.ndarray:
    array = np.asarray(value) if isinstance(value, np.ndarray) else np.empty(0)
    return array.ravel().astype(float) if array.dtype.kind in "fiub" else np.empty(0)


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
    groups: dict[int, Axis] = {}
    for title, y in zip(titles, ys, strict=True):
        data, at = _flat_numbers(y["Data"]), _axis_of(y, xs)
        if at not in groups:
            groups[at] = Axis(_flat_numbers(xs[at]["Data"]), _clean_title(xs[at].get("Unit")), {}, {})
        groups[at].signals[title] = data
        groups[at].units[title] = _clean_title(y.get("Unit"))
    return list(groups.values())


def _axis_of(y: Mapping[str, Any], xs: list[Any]) -> int:
    index = _flat_numbers(y.get("XIndex"))
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
    axis = Axis(_flat_numbers(value.get("time")), "", {}, {})
    for k, part in enumerate(signals, 1):
        title = _clean_title(part.get("label")) or (f"{name}_{k}" if len(signals) > 1 else name)
        _add(axis, title, part["values"])
    return [axis]


def _timeseries(name: str, value: Mapping[str, Any]) -> list[Axis]:
    """A structure made of a timeseries: Time and Data, and Name where it was kept."""
    if not {"Time", "Data"} <= set(value):
        return []
    info = value.get("DataInfo")
    axis = Axis(_flat_numbers(value["Time"]), "", {}, {})
    title = _clean_title(value.get("Name")) or name
    _add(axis, title, value["Data"])
    unit = _clean_title(info.get("Units") if isinstance(info, Mapping) else value.get("Units"))
    axis.units.update(dict.fromkeys(axis.signals, unit))
    return [axis]


def _add(axis: Axis, title: str, values: Any) -> None:
    """Put a signal, or the elements of a vector signal under numbered names, on an axis."""
    array = np.asarray(values) if isinstance(values, np.ndarray) else np.empty(0)
    if array.dtype.kind not in "fiub" or not array.size:
        return
    if array.ndim > 2:  # a matrix at every instant: time comes last
        array = array.reshape(-1, array.shape[-1]).T
    if array.ndim == 2 and array.shape[0] != len(axis.time) and array.shape[1] == len(axis.time):
        array = array.T
    if array.ndim == 1 or 1 in array.shape:
        axis.signals[title] = array.ravel().astype(float)
        return
    for k in range(array.shape[1]):
        axis.signals[f"{title}_{k + 1}"] = array[:, k].astype(float)


def refuse_objects(path: Path | str, objects: tuple[str, ...]) -> None:
    """Raise DataError when a file holds objects of MATLAB classes and nothing else."""
    if objects:
        named = clip(", ".join(k for k in objects if k) or "without a name")
        raise DataError(
            f"{path}: it holds objects of MATLAB ({named}), such as timeseries, which only MATLAB can read. Save "
            "their numbers there: t = x.Time; x_in = x.Data; save('file.mat', 't', 'x_in')."
        )
