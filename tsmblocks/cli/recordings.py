"""What commands share that read measurements: their options, and recordings out of the files they name."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import attrs

from tsmblocks.cli.common import UsageError, finite_float, pair, span
from tsmblocks.cli.console import note
from tsmblocks.common.errors import near
from tsmblocks.common.units import heading, split_heading


def data_arguments(options: argparse._ActionsContainer, *, several: bool = False) -> None:
    """Declare the options of every command that reads a measurement, or several."""
    add = options.add_argument
    what = "measured signals: CSV and its relatives, NPZ, MAT"
    named = (
        "the column that holds a signal (or the time t), when it has another name; NAME has the unit where the "
        "file gives none: 'x_in [deg]=motor'"
    )
    if several:
        add("--data", metavar="FILE", nargs="+", action="extend", help=f"{what}; each file is one experiment")
    else:
        add("--data", metavar="FILE", help=what)
    add("--map", metavar="NAME=COLUMN", type=pair, nargs="+", action="extend", default=[], help=named)
    add(
        "--columns",
        metavar="A,B,C",
        help="names of the columns, in order, where the file has no header, or another one: 't, x_in [deg], , x_out' "
        "(empty for those to be left out)",
    )
    add(
        "--rows", metavar="FIRST:LAST", type=span, default=(None, None), help="rows of the file to read, counted from 1"
    )
    add("--group", metavar="NAME", help="the structure or group of a MAT, HDF5 or NPZ file to read")
    add(
        "--sampling", metavar="S", type=finite_float, help="time in s from row to row, for a file without a time column"
    )
    add(
        "--tail",
        choices=("refuse", "drop"),
        default="refuse",
        help="what comes after the time jumps back: refuse the file (default), or drop it",
    )
    add(
        "--gaps",
        choices=("refuse", "keep"),
        default="refuse",
        help="long gaps in time: refuse the file (default), or keep them",
    )


def condition_argument(options: argparse._ActionsContainer) -> None:
    """Declare --condition, for commands whose measured inputs drive a model as they are."""
    options.add_argument(
        "--condition",
        dest="conditioned",
        action="store_true",
        help="take the noise out of measured inputs first, as diagnose does",
    )


def in_options(text: str, args: argparse.Namespace) -> str:
    """A caution that the input is noisy, with the option in place of a call where it was not given yet."""
    if args.conditioned:
        return text
    return re.sub(r"Filter it first: filtered\('[^']*'\)\.", "Take the noise out first: --condition.", text)


def read_record(
    args: argparse.Namespace,
    only: Iterable[str],
    path: str | None = None,
    also: Iterable[str] = (),
    tell: bool = True,
    drives: Iterable[str] = (),
) -> Any:
    """Return the record that the data options describe, its repairs told on standard error where ``tell`` says so.

    ``path`` is the file to read where the options name several; ``also`` are signals kept where they are there, and
    ``drives`` those that --condition takes the noise out of.
    """
    from tsmblocks.data import read

    record = read(
        path or args.data,
        columns=args.columns,
        map=_map(args),
        only=only,
        also=also,
        rows=args.rows,
        step=args.sampling,
        group=args.group,
        tail=args.tail,
        gaps=args.gaps,
    )
    if getattr(args, "conditioned", False):
        record = record.conditioned(drives)
    if tell and not getattr(args, "json", False):
        repairs(record)
    return record


def repairs(record: Any) -> None:
    """Tell on standard error what was repaired in a record."""
    for text in record.notes:
        note(f"{record.origin}: {text}")


def read_inputs(args: argparse.Namespace, diagram: Any, shown: str) -> tuple[Any, dict[str, Any]]:
    """Return the measured record, if any, and the inputs out of it of a diagram that messages call ``shown``.

    Outputs that were measured are kept in the record where they are there.
    """
    wanted = diagram.inports
    if not args.data:
        if wanted:
            name, port = next(iter(wanted.items()))
            column = heading(name, port.unit)
            raise UsageError(
                f"'{shown}' needs its input{'s' if len(wanted) > 1 else ''} {', '.join(wanted)}. "
                f"Give --data FILE with a column '{column}', or with --map '{column}=COLUMN'."
            )
        return None, {}
    if not wanted:
        raise UsageError(f"'{shown}' has no inputs, so there is nothing that --data could drive.")
    measured = [name for name in diagram.outputs if name not in wanted]
    mapped = _mapped(args, [*wanted, *measured], lambda name: f"'{shown}' has no input or output '{name}'")
    only = [*wanted, *(k for k in measured if k in mapped)]
    record = read_record(args, only, also=measured, tell=False, drives=wanted)
    _refuse_doubtful(args, record, [diagram])
    record = attrs.evolve(record, notes=(*record.notes, *_noisy(args, record, diagram)))
    if not getattr(args, "json", False):
        repairs(record)
    _tell_units(args, [record], [diagram])
    return record, {name: record.samples(name, port.unit, args.hold) for name, port in wanted.items()}


def read_experiments(args: argparse.Namespace, *diagrams: Any, tell: bool = True) -> dict[str, Any]:
    """Return the records that the data options name, by experiment, with the signals the diagrams know.

    What was repaired is told on standard error, unless ``tell`` is False: what is printed later says it.
    Signals that every diagram needs must be there. Raises UsageError without files, or for one given twice.
    """
    wanted = list(dict.fromkeys(name for d in diagrams for name in d.inputs))
    compared = list(dict.fromkeys(name for d in diagrams for name in d.outputs))
    if not args.data:
        raise UsageError(f"give --data FILE with the signals {', '.join([*wanted, *compared])}.")
    mapped = _mapped(args, [*wanted, *compared], lambda name: f"there is no signal '{name}' to compare")
    _look_at(args.data)
    needed = [name for name in wanted if all(name in d.inputs for d in diagrams) or name in mapped]
    only = list(dict.fromkeys([*needed, *(name for name in compared if name in mapped)]))
    also = [name for name in dict.fromkeys([*wanted, *compared]) if name not in only]
    records: dict[str, Any] = {}
    for path in args.data:
        record = read_record(args, only, path, also, tell, wanted)
        _refuse_doubtful(args, record, diagrams)
        records[record.name if record.name not in records else str(path)] = record
    _tell_units(args, [*records.values()], diagrams)
    return records


def _map(args: argparse.Namespace) -> dict[str, str]:
    """What --map says: columns by name. Raises UsageError for a name that is given two."""
    seen: dict[str, str] = {}
    for written, column in args.map:
        name = split_heading(written)[0]
        if name in seen:
            raise UsageError(f"--map names '{name}' twice, for the columns '{seen[name]}' and '{column}'.")
        seen[name] = column
    return dict(args.map)


def _mapped(args: argparse.Namespace, known: Sequence[str], missing: Callable[[str], str]) -> list[str]:
    """The names that --map gives to columns. Raises UsageError for one that is neither known nor the time's.

    ``missing`` says that there is none of a name.
    """
    names = []
    for written, column in _map(args).items():
        name = split_heading(written)[0]
        if name not in known and name != "t":
            hint = near(name, [*known, "t"])
            if split_heading(column)[0] in known and not hint.startswith(" Did you mean"):
                hint = f" --map takes NAME=COLUMN: the other way round that is --map '{column}={written}'."
            raise UsageError(f"--map {name}=…: {missing(name)}.{hint}")
        names.append(name)
    return names


def _noisy(args: argparse.Namespace, record: Any, diagram: Any) -> list[str]:
    """Inputs whose noise would drive a model with memory, a sentence for each."""
    from tsmblocks.fitting.summary import rough_inputs
    from tsmblocks.simulation.compiled import equations

    return [in_options(text, args) for text in rough_inputs(record, equations(diagram))]


def _tell_units(args: argparse.Namespace, records: Sequence[Any], diagrams: Sequence[Any]) -> None:
    """Say once what signals without a unit are taken to be in, and how to say another, before any work is done."""
    from tsmblocks.data.missing_units import assumed_units

    wanted = _units(diagrams)
    said: dict[str, list[Any]] = {}
    for record in records if not getattr(args, "json", False) else ():
        texts = assumed_units(record, wanted)
        if texts:
            said.setdefault(" ".join(texts), []).append(record)
    for text, those in said.items():
        name = next(k for k in wanted if k in those[0] and wanted[k] and not those[0].unit(k))
        note(
            f"{', '.join(record.origin for record in those)}: {text} Where that is wrong, say the unit: "
            f"--map {_in_degrees(args, name)}."
        )


def _refuse_doubtful(args: argparse.Namespace, record: Any, diagrams: Sequence[Any]) -> None:
    """Raise DataError where angles without a unit would be many turns."""
    from tsmblocks.data.missing_units import refuse_doubtful

    def way(names: Sequence[str]) -> str:
        return f"--map {' '.join(_in_degrees(args, name) for name in names)}, or [rad]"

    refuse_doubtful(record.origin, record, _units(diagrams), way)


def _units(diagrams: Sequence[Any]) -> dict[str, str]:
    """The units that signals are wanted in; of several diagrams that of the first."""
    return {name: d.unit(name) for d in reversed(diagrams) for name in (*d.inputs, *d.outputs)}


def _in_degrees(args: argparse.Namespace, name: str) -> str:
    """How --map says that a signal is in degrees."""
    return f"'{name} [deg]={_column(args, name)}'"


def _column(args: argparse.Namespace, name: str) -> str:
    """What the file calls a signal."""
    return next((own for written, own in args.map if written.strip() == name), name)


def _look_at(paths: Sequence[str]) -> None:
    """Refuse files given twice, and diagrams that stand where recordings should."""
    from tsmblocks.files.shipped import shipped_names

    seen = set()
    for path in paths:
        if path in shipped_names() or path.endswith(".toml"):
            raise UsageError(f"--data takes recordings, and '{path}' is a diagram. Name diagrams before the options.")
        place = os.path.realpath(path)
        if place in seen:
            raise UsageError(f"--data names {path} twice; it would count for two experiments.")
        seen.add(place)


def as_json(records: dict[str, Any]) -> list[dict[str, Any]]:
    """What is said of recordings in JSON: where they come from and what was repaired."""
    return [
        {"experiment": name, "origin": r.origin, "samples": len(r), "notes": list(r.notes)}
        for name, r in records.items()
    ]
