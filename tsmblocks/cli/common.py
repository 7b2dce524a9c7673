"""What the commands share: reading arguments, tables, notes, progress. Light: nothing heavy at import."""

from __future__ import annotations

import argparse
import json
import math
import sys
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tsmblocks.errors import TsmError, near

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells expect it."""
RESULTS = (".csv", ".npz", ".mat")
PICTURES = (".png", ".svg", ".pdf")


class UsageError(TsmError):
    """A command line that cannot be understood."""


class Parser(argparse.ArgumentParser):
    """An argument parser that raises its complaints, so that all messages leave by one door."""

    def options(self) -> list[str]:
        """Every option it takes, as it is typed."""
        return [name for action in self._actions for name in action.option_strings]

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with where to look."""
        raise UsageError(f"{message}. '{self.prog} --help' shows what it takes.")


# ---- arguments ----------------------------------------------------------------------------------


def number(text: str) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def whole(text: str) -> int:
    """Return a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least 1")
    return int(text)


def span(text: str) -> tuple[int | None, int | None]:
    """``FIRST:LAST`` as row numbers; either may be left out."""
    first, colon, last = text.partition(":")
    if not colon or not all(part == "" or part.isdecimal() for part in (first, last)):
        raise argparse.ArgumentTypeError(f"'{text}' is not FIRST:LAST, such as 1:26328 or 100:")
    return (int(first) if first else None), (int(last) if last else None)


def pair(text: str) -> tuple[str, str]:
    """``NAME=VALUE`` taken apart."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE")
    return name.strip(), value.strip()


def setting(text: str) -> tuple[str, Any]:
    """``block.parameter=VALUE``, the value being a number, a list, true or false, or else text."""
    name, value = pair(text)
    try:
        return name, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name, value


def result_path(text: str | None, endings: Sequence[str] = RESULTS) -> Path | None:
    """Check a path to be written: what would fail at the end of a long run is refused before it."""
    if text is None:
        return None
    path = Path(text)
    if path.suffix.lower() not in endings:
        raise UsageError(f"'{text}' must end in {', '.join(endings[:-1])} or {endings[-1]}.")
    if path.is_dir():
        raise UsageError(f"'{text}' is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise UsageError(f"there is no folder '{path.parent}' to write {path.name} into.")
    return path


def data_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of every command that reads a measurement."""
    add = parser.add_argument
    add("--data", metavar="FILE", help="measured signals: CSV and its relatives, NPZ, MAT")
    add("--columns", metavar="A,B,C", help="names of a headerless file's columns, in order: 't, x_in [deg]'")
    add("--map", metavar="NAME=COLUMN", type=pair, action="append", default=[],
        help="the column that holds a signal (or the time t), when it has another name; NAME may have a "
        "unit: 'x_in [deg]=motor'")  # fmt: skip
    add("--rows", metavar="FIRST:LAST", type=span, default=(None, None),
        help="rows of the file to read, counted from 1")  # fmt: skip


def read_record(args: argparse.Namespace, only: Iterable[str]) -> Any:
    """Return the record that the data options describe, its repairs told on standard error."""
    from tsmblocks.data import read, split_heading

    mapped = [(*split_heading(heading), column) for heading, column in args.map]
    record = read(
        args.data, columns=args.columns, map={name: column for name, _, column in mapped},
        units={name: unit for name, unit, _ in mapped if unit}, only=only, rows=args.rows,
    )  # fmt: skip
    if not getattr(args, "json", False):
        for text in record.notes:
            note(f"{record.origin}: {text}")
    return record


# ---- what is said -------------------------------------------------------------------------------


def complain(text: str) -> None:
    """One message to standard error under the program's name."""
    print(f"tsmblocks: {text}", file=sys.stderr)


def note(text: str) -> None:
    """Something the user should know but need not act on."""
    print(f"note: {text}", file=sys.stderr)


def give(value: dict[str, Any]) -> None:
    """One JSON object on standard output, infinities and NaN as null."""
    print(json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def columns(rows: Iterable[Sequence[str]], indent: str = "", left: frozenset[int] | None = None) -> str:
    """Rows with their cells in columns; those in ``left`` (by default the first) are flush left."""
    table = [list(row) for row in rows]
    left = frozenset({0}) if left is None else left
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    lines = []
    for row in table:
        cells = [c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append((indent + "  ".join(cells)).rstrip())
    return "\n".join(lines)


def show(value: float) -> str:
    """Return a number as a table shows it."""
    return f"{value:.4g}"


def progress(what: str) -> Callable[[float], None] | None:
    """Give a line that says how far a long run has come; none when standard error is no terminal."""
    if not sys.stderr.isatty():
        return None

    def tell(done: float) -> None:
        print(f"\r{what}: {100 * done:3.0f} %", end="" if done < 1 else "\n", file=sys.stderr, flush=True)

    return tell


def clear_progress(tell: Callable[[float], None] | None) -> None:
    """Take the line of ``progress`` away again."""
    if tell is not None:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def choose(name: str, known: Iterable[str], what: str) -> str:
    """Return a known name, whatever its case; raises UsageError with the near miss."""
    names = list(known)
    found = next((k for k in names if k == name), None) or next((k for k in names if k.lower() == name.lower()), None)
    if found is None:
        raise UsageError(f"there is no {what} '{name}'.{near(name, names)}")
    return found
