"""Options of commands that read recordings, and the recordings that they name."""

from __future__ import annotations

import argparse
import os
import re
import shlex
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import attrs

from tsmblocks.cli.common import SEVERAL, UsageError, finite_float, integer_from, name_and_value, passed, row_range
from tsmblocks.cli.console import print_note
from tsmblocks.common.errors import TsmError, near
from tsmblocks.common.headings import heading, split_heading

COLUMN_FORM = "NAME=COLUMN; a name with blanks needs quotes, such as 'x_in=Motor pos'"
"""What --map expects, in messages."""


def data_arguments(options: argparse._ActionsContainer, *, several: bool = False, condition: bool = True) -> None:
    """Declare the options of every command that reads a measurement, or several.

    ``condition`` is False for a command that does not use measured inputs, or filters them by default.
    """
    add = options.add_argument
    what = "measured signals: CSV and its relatives, NPZ, MAT, HDF5, JSON, XLSX, Parquet, MDF"
    if several:
        add("--data", metavar="FILE", help=f"{what}; each file is one experiment", **SEVERAL)
    else:
        add("--data", metavar="FILE", help=what)
    named = (
        "the column that holds a signal (or the time t), when it has another name; NAME has the unit where the "
        "file gives none: 'x_in [deg]=motor'"
    )
    add(
        "--map",
        metavar="NAME=COLUMN",
        type=partial(name_and_value, form=COLUMN_FORM),
        default=[],
        help=named,
        **SEVERAL,
    )
    columns = (
        "names of the columns, in order, where the file has no header, or in its place: 't, x_in [deg], , x_out' "
        "(empty for a column that is not read, as are those after the last name)"
    )
    add("--columns", metavar="A,B,C", help=columns)
    rows = "rows of the file to read, counted from 1"
    add("--rows", metavar="FIRST:LAST", type=row_range, default=(None, None), help=rows)
    add("--group", metavar="NAME", help="the structure, group or sheet of a file to read")
    sampling = "time in s from row to row, for a file without a time column"
    add("--sampling", metavar="S", type=finite_float, help=sampling)
    tail = "rows after a jump back in time: refuse the file (default), or drop them"
    add("--tail", choices=("refuse", "drop"), default="refuse", help=tail)
    gaps = "long gaps in time: refuse the file (default), or keep them"
    add("--gaps", choices=("refuse", "keep"), default="refuse", help=gaps)
    fewer = options.add_mutually_exclusive_group()
    every = "keep one of N samples, after a low-pass against aliasing"
    fewer.add_argument("--decimate", metavar="N", type=integer_from(1), default=1, help=every)
    grid = "resample to a step of DT s, after a low-pass against aliasing where that is longer"
    fewer.add_argument("--resample", metavar="DT", type=finite_float, help=grid)
    if condition:
        filtered = "filter the noise of measured inputs out first, as diagnose does"
        add("--condition", dest="conditioned", action="store_true", help=filtered)


def command_line(command: str, diagram: str, args: argparse.Namespace) -> str:
    """A command on the same recordings, read in the same way, as a shell takes it."""
    words = ["tsmblocks", command, diagram, "--data", *map(str, args.data)]
    words += ["--map", *(f"{name}={column}" for name, column in args.map)] if args.map else []
    for option, value in (("--columns", args.columns), ("--group", args.group), ("--sampling", args.sampling)):
        words += [option, str(value)] if value is not None else []
    first, last = args.rows
    words += ["--rows", f"{first or ''}:{last or ''}"] if args.rows != (None, None) else []
    for option, value in (("--tail", args.tail), ("--gaps", args.gaps)):
        words += [option, value] if value != "refuse" else []
    words += ["--decimate", str(args.decimate)] if args.decimate > 1 else []
    words += ["--resample", str(args.resample)] if args.resample is not None else []
    return shlex.join(words)


def with_option_notes(result: Any, args: argparse.Namespace) -> Any:
    """A result with options of the command in its notes."""
    return attrs.evolve(result, notes=tuple(with_condition_option(text, args) for text in result.notes))


def with_condition_option(text: str, args: argparse.Namespace) -> str:
    """A note that the input is noisy, with the option of the command in place of the call of Python."""
    if args.conditioned:
        return text
    return re.sub(r"Filter (it|them) first: (filtered|conditioned)\([^)]*\)\.", r"Filter \1 first: --condition.", text)


def read_record(
    args: argparse.Namespace,
    only: Iterable[str] | None,
    path: str | None = None,
    also: Iterable[str] = (),
    report: bool = True,
    drives: Iterable[str] = (),
    condition: Sequence[str] = (),
) -> Any:
    """Read the record that the data options describe; with ``report`` its repairs are printed on standard error.

    ``path`` is the file to read where the options name several; ``also`` are optional signals, and ``drives`` those
    that --condition filters, ``condition`` those that are filtered without it, as the diagram's file says.
    """
    from tsmblocks.data import read

    given = passed(args, "columns", "rows", "group", "tail", "gaps")
    record = read(path or args.data, map=_map(args), only=only, also=also, step=args.sampling, **given)
    if args.decimate > 1:
        record = record.decimated(args.decimate)
    elif args.resample is not None:
        record = record.resampled(args.resample)
    if getattr(args, "conditioned", False):
        record = record.conditioned(drives)
    elif condition:
        record = record.conditioned(condition)
    if report:
        print_repairs(args, record)
    return record


def print_repairs(args: argparse.Namespace, *records: Any, fault: str = "") -> None:
    """Print on standard error what was repaired in records, unless JSON is printed.

    A note on a signal that is missing is left out where the ``fault`` of the command is that.
    """
    for record in () if _json(args) else records:
        for text in record.notes:
            if not (way := text.partition("map it: ")[2].rstrip(".")) or way not in fault:
                print_note(f"{record.origin}: {text}")


def _json(args: argparse.Namespace) -> bool:
    return getattr(args, "json", False)


def take_hold(args: argparse.Namespace, diagram: Any) -> None:
    """Take the interpolation of inputs that the diagram's file gives, where the command gives none."""
    from tsmblocks.common.interpolation import AUTO

    if args.hold == AUTO:
        args.hold = diagram.simulation.hold or args.hold


def read_inputs(args: argparse.Namespace, diagram: Any, shown: str) -> tuple[Any, dict[str, Any]]:
    """Read the record, if any, and the inputs of a diagram from it; messages call the diagram ``shown``.

    Measured outputs are kept in the record.
    """
    wanted = diagram.inports
    if not args.data and wanted:
        name, port = next(iter(wanted.items()))
        column = heading(name, port.unit)
        raise UsageError(
            f"'{shown}' needs its input{'s' if len(wanted) > 1 else ''} {', '.join(wanted)}. "
            f"Give --data FILE with a column '{column}', or with --map '{column}=COLUMN'."
        )
    if not args.data:
        return None, {}
    if not wanted:
        raise UsageError(f"'{shown}' has no inputs, so there is nothing that --data could drive.")
    from tsmblocks.fitting.holds import hold_notes, resolved_holds
    from tsmblocks.fitting.recordings import with_adopted_units
    from tsmblocks.fitting.summary import rough_inputs
    from tsmblocks.simulation.compiled import equations

    measured = [name for name in diagram.outputs if name not in wanted]
    mapped = _mapped(args, [*wanted, *measured], lambda name: f"'{shown}' has no input or output '{name}'")
    only = [*wanted, *(k for k in measured if k in mapped)]
    record = read_record(args, only, also=measured, report=False, drives=wanted, condition=diagram.simulation.condition)
    diagram, adopted = with_adopted_units(diagram, {record.name: record})
    _refuse_doubtful(args, record, [diagram])
    wanted = diagram.inports
    eq = equations(diagram)
    holds = resolved_holds(record, wanted, args.hold, eq.orders)
    noisy = (with_condition_option(text, args) for text in rough_inputs(record, eq))
    record = attrs.evolve(record, notes=(*record.notes, *adopted, *noisy, *hold_notes(record, holds, args.hold)))
    print_repairs(args, record)
    _note_assumed_units(args, [record], [diagram])
    return record, {name: record.samples(name, port.unit, holds[name]) for name, port in wanted.items()}


def with_units_of(diagram: Any, record: Any) -> Any:
    """The diagram with the units of a recording, if any, for signals that it gives none."""
    if record is None:
        return diagram
    from tsmblocks.fitting.recordings import with_adopted_units

    return with_adopted_units(diagram, {record.name: record})[0]


def read_experiments(args: argparse.Namespace, *diagrams: Any, report: bool = True) -> dict[str, Any]:
    """Read the records that the data options name, by experiment, with the signals of the diagrams.

    Repairs are printed on standard error, unless ``report`` is False. Signals that every diagram needs are required.
    Raises UsageError without files, or for one given twice.
    """
    wanted = list(dict.fromkeys(name for d in diagrams for name in d.inputs))
    signals = [*wanted, *dict.fromkeys(name for d in diagrams for name in d.outputs)]
    if not args.data:
        raise UsageError(f"give --data FILE with the signals {', '.join(signals)}.")
    mapped = _mapped(args, signals, lambda name: f"there is no signal '{name}' to compare")
    _check_paths(args.data)
    only = [name for name in dict.fromkeys(signals) if name in mapped or all(name in d.inputs for d in diagrams)]
    also = [name for name in dict.fromkeys(signals) if name not in only]
    records: dict[str, Any] = {}
    filters = hasattr(args, "conditioned")  # a diagnosis filters inputs itself
    condition = list(dict.fromkeys(name for d in diagrams for name in d.simulation.condition if filters))
    for path in args.data:
        record = read_record(args, only, path, also, report, wanted, condition)
        if not any(k in record for d in diagrams for k in d.outputs):  # the error that follows names what is there
            with suppress(TsmError):
                record = read_record(args, None, path, report=False)
        _refuse_doubtful(args, record, diagrams)
        records[record.name if record.name not in records else str(path)] = record
    _note_assumed_units(args, [*records.values()], diagrams)
    return records


def _map(args: argparse.Namespace) -> dict[str, str]:
    """Columns of --map by name. Raises UsageError for a name with two columns."""
    seen: dict[str, str] = {}
    for written, column in args.map:
        name = split_heading(written)[0]
        if name in seen:
            raise UsageError(f"--map names '{name}' twice, for the columns '{seen[name]}' and '{column}'.")
        seen[name] = column
    return dict(args.map)


def _mapped(args: argparse.Namespace, known: Sequence[str], missing: Callable[[str], str]) -> list[str]:
    """The names in --map. Raises UsageError for one that is unknown and not the time; ``missing`` forms its message."""
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


def _note_assumed_units(args: argparse.Namespace, records: Sequence[Any], diagrams: Sequence[Any]) -> None:
    """Print the units assumed for signals without one, and how to give others, before any work is done."""
    from tsmblocks.data.missing_units import assumed_units, likely_unit

    wanted = _units(diagrams)
    groups: dict[str, list[Any]] = {}
    for record in () if _json(args) else records:
        texts = assumed_units(record, wanted)
        if texts:
            groups.setdefault(" ".join(texts), []).append(record)
    for text, those in groups.items():
        name = next(k for k in wanted if k in those[0] and wanted[k] and not those[0].unit(k))
        print_note(
            f"{', '.join(record.origin for record in those)}: {text} Where that is wrong, give the unit: "
            f"--map {_with_unit(args, name, likely_unit(wanted[name]))}."
        )


def _refuse_doubtful(args: argparse.Namespace, record: Any, diagrams: Sequence[Any]) -> None:
    """Raise DataError where angles without a unit would be many turns."""
    from tsmblocks.data.missing_units import refuse_doubtful

    def way(names: Sequence[str]) -> str:
        return f"--map {' '.join(_with_unit(args, name, 'deg') for name in names)}, or [rad]"

    refuse_doubtful(record.origin, record, _units(diagrams), way)


def _units(diagrams: Sequence[Any]) -> dict[str, str]:
    """Units of the signals of the diagrams; of several diagrams that of the first."""
    return {name: d.unit(name) for d in reversed(diagrams) for name in (*d.inputs, *d.outputs)}


def _with_unit(args: argparse.Namespace, name: str, unit: str) -> str:
    """The value of --map that gives a signal a unit."""
    column = next((column for written, column in args.map if written.strip() == name), name)
    return f"'{name} [{unit}]={column}'"


def _check_paths(paths: Sequence[str]) -> None:
    """Raise UsageError for a file given twice, and for a diagram in place of a recording."""
    from tsmblocks.files.shipped import shipped_names

    seen = set()
    for path in paths:
        if path in shipped_names() or path.endswith(".toml"):
            raise UsageError(f"--data takes recordings, and '{path}' is a diagram. Name diagrams before the options.")
        place = os.path.realpath(path)
        if place in seen:
            raise UsageError(f"--data names {path} twice; it would count as two experiments.")
        seen.add(place)


def as_json(records: dict[str, Any]) -> list[dict[str, Any]]:
    """Recordings in JSON: origin, number of samples and repairs."""
    return [
        {"experiment": name, "origin": r.origin, "samples": len(r), "notes": list(r.notes)}
        for name, r in records.items()
    ]
