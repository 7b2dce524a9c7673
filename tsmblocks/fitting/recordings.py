"""Recordings as they are given to fits, scores and comparisons: read, checked, and which part of each counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import displayed_units, units
from tsmblocks.common.errors import DataError, DiagramError, in_words, near
from tsmblocks.data import Record, read
from tsmblocks.data.grid import MIN_RECORD_SAMPLES
from tsmblocks.data.missing_units import assumed_units, refuse_doubtful
from tsmblocks.data.spellings import spelling_notes
from tsmblocks.fitting.experiments import Window
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.unit_inference import unit_label

Data = Any
"""A recording (Record, file, pandas frame), a list of them, or a mapping from names to them."""


def recordings(data: Data) -> dict[str, Record]:
    """Recordings by the name of their experiment. Raises DataError when there is none, or two share a name."""
    if isinstance(data, Mapping):
        given = {str(name) or "experiment": _record(one, str(name)) for name, one in data.items()}
    else:
        several = list(data) if isinstance(data, (list, tuple)) else [data]
        records = [_record(one, f"experiment {k}") for k, one in enumerate(several, 1)]
        count = Counter(r.name for r in records)
        names = [f"{r.name}#{k}" if count[r.name] > 1 else r.name or "experiment" for k, r in enumerate(records, 1)]
        given = dict(zip(names, records, strict=True))
        if len(given) < len(names):
            same = Counter(names).most_common(1)[0][0]
            raise DataError(f"two experiments are named '{same}'; give a mapping with different names.")
    if not given:
        raise DataError("there are no recordings to compare with: give a Record (tsm.read), a list, or a mapping.")
    return given


def _record(one: Any, name: str) -> Record:
    """One recording, with samples, and times in order; one made by a script may have neither."""
    if isinstance(one, (str, Path)):
        one = read(one)
    elif not isinstance(one, Record) and hasattr(one, "columns") and hasattr(one, "index"):
        from tsmblocks.data import from_pandas

        one = from_pandas(one, name=name)
    if not isinstance(one, Record):
        raise DataError(
            f"'{name}' must be a recording (tsm.read), a file or a pandas frame, got {in_words(one)}. "
            "tsm.Record(name, t, signals, units) makes one from arrays."
        )
    title = f"experiment '{one.name}'"
    if len(one) < MIN_RECORD_SAMPLES:
        count = f"{len(one)} sample{'s' if len(one) != 1 else ''}"
        raise DataError(f"{title} has {count}, and at least {MIN_RECORD_SAMPLES} are needed.")
    late = np.flatnonzero(~(np.diff(one.t) > 0))
    if len(late) or not np.isfinite(one.t[[0, -1]]).all():
        k = int(late[0]) + 1 if len(late) else int(np.isinf(one.t[-1])) * (len(one) - 1)
        raise DataError(
            f"{title}: times must be finite and increase, and sample {k} is at {one.t[k]:g} s "
            f"after one at {one.t[max(k - 1, 0)]:g} s."
        )
    return one


def without_units(records: Mapping[str, Record], diagram: Diagram, outputs: Iterable[str]) -> list[str]:
    """Name signals without a unit and the unit that is assumed for them, and others that are spelt like an output.

    Raises DataError where they are angles of so many turns that it can hardly be so.
    """
    wanted = {k: diagram.unit(k) for k in (*diagram.inports, *outputs)}
    for name, record in records.items():
        refuse_doubtful(name, record, wanted)
    notes = list[str]()
    for name, record in records.items():
        unused = [k for k in record.names if k not in diagram.inputs and k not in diagram.outputs]
        texts = (*spelling_notes(diagram.outputs, record.names, unused), *assumed_units(record, wanted))
        notes += [f"{name}: {text}" for text in texts]
    return notes


def with_adopted_units(diagram: Diagram, records: Mapping[str, Record]) -> tuple[Diagram, list[str]]:
    """The diagram with units for recorded signals that it gives none, and a sentence for each that is converted.

    A signal adopts the quantity of the recordings at the scale the diagram has for it: in deg where all its angles are
    in deg, otherwise in the base unit (deg is converted to rad). So it is in one system of units with the signals
    whose units the diagram declares. Where it declares none, the numbers of the recordings stay as they are.
    """
    if not any(unit.dimension for unit in diagram.port_units.values()):
        return diagram, []
    notes = list[str]()
    for name in (*diagram.inports, *diagram.outputs):
        labels = [r.unit(name) for r in records.values() if name in r and r.unit(name) and units.is_unit(r.unit(name))]
        if not labels or diagram.unit(name):
            continue
        unit = _scaled_as(labels[0], diagram)
        try:
            if name in diagram.inputs:
                inlet = attrs.evolve(diagram.inputs[name], unit=unit)
                diagram = diagram._with(inputs={**diagram.inputs, name: inlet})
            else:
                diagram = diagram._with(output_units={**diagram.output_units, name: unit})
        except DiagramError:  # a block passes on the unit of another signal, which measures something else
            continue
        if any(not units.same(unit, label) for label in labels):
            notes.append(
                f"{name} has no unit in the diagram and is taken to be in {unit} there; the recording is converted "
                f"from {labels[0]}."
            )
    return diagram, notes


def as_recorded(diagram: Diagram, name: str, records: Iterable[Record]) -> str:
    """The unit of an input or output of a diagram, displayed in that of the first recording of it."""
    return displayed_units.displayed_in(diagram.unit(name), (r.unit(name) for r in records if name in r))


def _scaled_as(label: str, diagram: Diagram) -> str:
    """The unit of a quantity at the one scale that it and its rates have in a diagram, else its base unit."""
    own, base = units.parse(label), units.base_unit(label)
    factors = [unit.factor for unit in diagram.port_units.values() if _timeless(unit) == _timeless(own)]
    if not factors or not np.allclose(factors, factors[0], rtol=1e-9, atol=0.0):
        return base
    scaled = unit_label(units.Unit(factors[0], own.dimension))
    return next((k for k in (label, scaled) if units.is_unit(k) and units.same(k, scaled)), base)


def _timeless(unit: units.Unit) -> list[tuple[str, int]]:
    """The powers of base units but for those of time."""
    return [one for one in unit.dimension if one[0] != "s"]


def windows(given: Any, names: Iterable[str], what: str = "window") -> dict[str, Window]:
    """The part of each experiment that counts, in s. Raises DataError for anything but a pair of times."""
    names = list(names)
    each = dict(given) if isinstance(given, Mapping) else dict.fromkeys(names, given)
    for name in each:
        if name not in names:
            raise DataError(f"{what}: there is no experiment '{name}'.{near(name, names)}")
    made: dict[str, Window] = {}
    for name in names:
        pair = each.get(name)
        try:
            start, stop = (None, None) if pair is None else pair
            low, high = (None if v is None else float(v) for v in (start, stop))
        except (TypeError, ValueError):
            raise DataError(
                f"{what} must be a pair (start, stop) in s, None for an end, got {in_words(pair)}."
            ) from None
        if low is not None and high is not None and not low < high:
            raise DataError(f"{what} must be two times in order, got ({low:g}, {high:g}) s.")
        made[name] = low, high
    return made


def training_windows(
    records: Mapping[str, Record], train: Any, without: list[str]
) -> tuple[dict[str, Window], dict[str, Window]]:
    """Windows that are fitted and windows that are held out, by experiment; arguments as for ``compare``."""
    for name in without:
        if name not in records:
            raise DataError(f"held_out: there is no experiment '{name}'.{near(name, records)}")
    fitted: dict[str, Window] = {}
    tested: dict[str, Window] = dict.fromkeys(without, (None, None))
    for name, record in records.items():
        if name not in without:
            fitted[name], rest = _split(name, record, train, records)
            if rest is not None:
                tested[name] = rest
    if not fitted:
        raise DataError("every experiment is held out, so no data remain to fit.")
    return fitted, tested


def _split(name: str, record: Record, train: Any, records: Mapping[str, Record]) -> tuple[Window, Window | None]:
    """The part of a recording that is fitted, and the one that is held out (None: nothing)."""
    start, stop = float(record.t[0]), float(record.t[-1])
    if isinstance(train, (int, float)) and not isinstance(train, bool):
        if not 0 < train <= 1:
            raise DataError(
                f"train must be a share of each recording, above 0 and up to 1, or a window "
                f"(start, stop) in s, got {in_words(train)}."
            )
        low, high = None, None if train == 1 else start + train * (stop - start)
    else:
        low, high = windows(train, records, "train")[name]
    if high is not None and high < stop:
        return (low, high), (float(np.nextafter(high, np.inf)), None)
    if low is not None and low > start:
        return (low, high), (None, float(np.nextafter(low, -np.inf)))
    return (low, high), None
