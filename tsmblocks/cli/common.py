"""Arguments, results and exit states that commands share. Nothing heavy is imported."""

from __future__ import annotations

import argparse
import math
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from tsmblocks.cli.console import print_error, print_json, print_text, wrap
from tsmblocks.common.atomic_write import replace_figure
from tsmblocks.common.errors import TsmError, near
from tsmblocks.common.loading import INTERRUPTED
from tsmblocks.common.tables import unique_names

PARAGRAPH = "\n\n"
"""What separates the paragraphs of a text."""
RESULTS = (".csv", ".npz", ".mat")
PICTURES = (".png", ".svg", ".pdf")
"""Endings of files of results, and of figures."""
DIAGRAMS, BLOCKS, FILES, FOLDERS = "diagrams", "blocks", "files", "folders"
"""Kinds of values that a shell can complete, beside fixed words."""
METHODS, HOLDS, BACKENDS = (
    ("euler", "heun", "rk4", "sdirk2", "sdirk3", "sdirk4"),
    ("auto", "zero", "linear", "cubic"),
    ("llvm", "casadi"),
)
FITS = ("gauss-newton", "ipopt", "ga")
"""Integration methods, holds, back ends and fitting methods: named here too, so that parsing imports nothing heavy."""


class UsageError(TsmError):
    """A command line that cannot be understood."""


class Formatter(argparse.HelpFormatter):
    """Help in lines as wide as the terminal; what is indented (an example) stays as it is."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        parts = text.strip("\n").split("\n\n")
        filled = (part if part.startswith(" ") else wrap(" ".join(part.split()), width) for part in parts)
        return textwrap.indent("\n\n".join(filled), indent)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises its errors, so that all messages are printed in one place."""

    def options(self) -> list[str]:
        """Every option it takes, as it is typed."""
        return [name for action in self._actions for name in action.option_strings]

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help with colours, where the stream shows them."""
        if message:
            print_text(message.removesuffix("\n"), file)

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with where to look."""
        more = ""
        if message.endswith("required: DIAGRAM") and any(action.nargs == "+" for action in self._actions):
            more = " Name it before the options."
        elif message.endswith(("expected one argument", "expected at least one argument")):
            option = message.partition(":")[0].removeprefix("argument ").partition("/")[0]
            more = f" A value that begins with a minus is written {option}=-…"
        raise UsageError(f"{message}.{more} '{self.prog} --help' shows what it takes.")


# ---- arguments ----------------------------------------------------------------------------------


def finite_float(text: str) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def integer_from(least: int) -> Callable[[str], int]:
    """What reads a whole number of at least ``least``."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least {least}")
        return int(text)

    return read


def row_range(text: str) -> tuple[int | None, int | None]:
    """``FIRST:LAST`` as row numbers; either may be left out."""
    first, colon, last = text.partition(":")
    if not colon or not all(part == "" or part.isdecimal() for part in (first, last)):
        raise argparse.ArgumentTypeError(f"'{text}' is not FIRST:LAST, such as 1:26328 or 100:")
    return (int(first) if first else None), (int(last) if last else None)


def number_range(text: str, form: str, whole: str = "") -> tuple[float | None, float | None]:
    """``LOW:HIGH``, either of which may be left out; ``form`` is the expected form of the ``whole`` in the error."""
    low, colon, high = text.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"'{whole or text}' is not {form}")
    return (finite_float(low) if low else None), (finite_float(high) if high else None)


def time_range(text: str) -> tuple[float | None, float | None]:
    """``START:STOP`` in s; either may be left out."""
    return number_range(text, "START:STOP in s, such as 2.5:10 or 5:")


def share_or_time_range(text: str) -> float | tuple[float | None, float | None]:
    """A share such as ``0.5``, or ``START:STOP`` in s."""
    return time_range(text) if ":" in text else finite_float(text)


def name_and_value(text: str, form: str = "NAME=VALUE") -> tuple[str, str]:
    """``NAME=VALUE`` as a pair; ``form`` is the expected form in the error."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is not {form}")
    return name.strip(), value.strip()


def setting(text: str) -> tuple[str, Any]:
    """``block.parameter=VALUE``, the value being a number, a list, true or false, or else text."""
    name, value = name_and_value(text)
    try:
        return name, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name, value


class HoldAction(argparse.Action):
    """A hold for all inputs, or ``NAME=HOLD`` for one, which may be repeated."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Keep a hold of all inputs as a word, those by name as a mapping."""
        name, equals, hold = values.partition("=")
        before = getattr(namespace, self.dest)
        each = {**before, name: hold} if isinstance(before, dict) else {name: hold}
        setattr(namespace, self.dest, each if equals else values)


SEVERAL: dict[str, Any] = dict(nargs="+", action="extend")
"""Settings of an option that takes several values and may be repeated."""
SHARED: dict[str, dict[str, Any]] = {
    "diagram": dict(metavar="DIAGRAM", help="a diagram file, or the name of a ready-made one"),
    "--set": dict(
        dest="settings",
        metavar="NAME=VALUE",
        type=setting,
        default=[],
        help="other values for parameters, such as pid.kp=2.2 or play.half_width=1deg",
        **SEVERAL,
    ),
    "--method": dict(
        metavar="M",
        default="rk4",
        help="euler, heun, rk4 (default), or for stiff diagrams sdirk2, sdirk3, sdirk4",
        suggests=METHODS,
    ),
    "--free": dict(metavar="PATTERN", help="free parameters, such as 'tsm.*' (default: all but known ones)", **SEVERAL),
    "--outputs": dict(metavar="NAME", help="outputs that are compared (default: all that were measured)", **SEVERAL),
    "--window": dict(metavar="START:STOP", type=time_range, help="times in s that count (default: all)"),
    "--starts": dict(
        metavar="N", type=integer_from(1), help="starts of each fit, random ones after the first (default %(default)s)"
    ),
    "--seed": dict(metavar="N", type=integer_from(0), default=0, help="seed of the random numbers (default 0)"),
    "--step": dict(metavar="H", type=finite_float, help="step of the simulation in s (default: chosen from the data)"),
    "--hold": dict(
        metavar="[NAME=]HOLD",
        action=HoldAction,
        default="auto",
        help="inputs between samples, all or one by name: zero, linear, cubic or auto (default: found from the data)",
        suggests=HOLDS,
    ),
    "--plot": dict(metavar="FILE", help="write a figure to a .png, .svg or .pdf file"),
    "--refuse-loops": dict(
        action="store_const", const="refuse", default="solve", dest="loops", help="treat algebraic loops as errors"
    ),
    "--no-step-check": dict(
        action="store_false", dest="check_step", help="skip the check that shorter steps give the same result"
    ),
    "--json": dict(
        action="store_true", help="print one JSON object and nothing else; a number that is not finite is null"
    ),
}
"""Arguments of several commands, with their settings; a command may change some."""


def add(options: argparse._ActionsContainer, *names: str, **settings: Any) -> None:
    """Declare arguments: those of SHARED, changed by the ``settings``, or a new one.

    ``suggests`` in the settings is what a shell completes a value with: fixed words, or one of the kinds above.
    """
    for name in names:
        chosen = SHARED.get(name, {}) | settings
        suggested = chosen.pop("suggests", None)
        action = options.add_argument(name, **chosen)
        if suggested:
            vars(action)["suggests"] = suggested


def result_arguments(parser: argparse.ArgumentParser, out: str, metavar: str = "FILE") -> argparse._ArgumentGroup:
    """Declare --out, --plot and --json in a group of their own, which is returned; ``out`` says what the first does."""
    results = parser.add_argument_group("results")
    add(results, "--out", metavar=metavar, help=out)
    add(results, "--plot", "--json")
    return results


def passed(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Arguments of the command that a function takes by the same names."""
    return {name: getattr(args, name) for name in names}


def result_path(text: str | None, endings: Sequence[str] = RESULTS) -> Path | None:
    """Check a path to be written before a long run, and not at its end."""
    if text is None:
        return None
    path = Path(text)
    if path.suffix.lower() not in endings:
        known = f"{', '.join(endings[:-1])} or {endings[-1]}" if len(endings) > 1 else endings[0]
        raise UsageError(f"'{text}' must end in {known}.")
    if path.is_dir():
        raise UsageError(f"'{text}' is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise UsageError(f"there is no folder '{path.parent}' to write {path.name} into.")
    return path


def paths_by_name(path: Path, names: Iterable[str]) -> dict[str, Path]:
    """The paths of several files: each of ``names`` added before the ending, ``fitted_bend60.toml``.

    All differ, also on file systems that ignore case.
    """
    listed = list(names)
    plain = unique_names((re.sub(r"[^a-zA-Z0-9_.-]+", "_", name).strip("_") for name in listed), case=False)
    return {name: path.with_name(f"{path.stem}_{one}{path.suffix}") for name, one in zip(listed, plain, strict=True)}


def figure_path(text: str | None) -> Path | None:
    """Check the path of a figure, and that matplotlib is installed."""
    path = result_path(text, PICTURES)
    if path is not None:
        from tsmblocks.plots.style import need_matplotlib

        need_matplotlib()
    return path


# ---- results ------------------------------------------------------------------------------------


def print_result(args: argparse.Namespace, facts: Mapping[str, Any], text: str) -> None:
    """Print a result: with --json its ``facts``, else the ``text``."""
    print_json(facts) if args.json else print_text(text)


def report_results(facts: dict[str, Any], written: Sequence[str], args: argparse.Namespace) -> None:
    """Print the results as JSON, or else the paths that were written, after an empty line."""
    if args.json or written:
        print_result(args, {**facts, "written": [*written]}, f"\n{wrote(written)}")


def wrote(paths: Iterable[Any]) -> str:
    """A line for each path that was written."""
    return "\n".join(f"wrote {path}" for path in paths)


def exit_status(interrupted: bool, written: Sequence[str], missing: Sequence[str] = ()) -> int:
    """Exit status of a search; a message says that the result of one that Ctrl-C ended is the best so far."""
    if interrupted:
        seen = "what you see and what was written is" if written else "what you see is"
        left_out = f" Not reached: {', '.join(missing)}." if missing else ""
        print_error(f"stopped before the search was over; {seen} the best so far.{left_out}")
    return INTERRUPTED if interrupted else 0


def finish(
    result: Any, facts: dict[str, Any], save: Callable[[], list[str]], plot: Path | None, args: argparse.Namespace
) -> int:
    """Print, save and plot the result of a search; its exit status. JSON has the ``facts`` too."""
    if not args.json:
        if vars(args).get("details"):  # in place of the last paragraph, which says how to get them
            print_text(f"{str(result).rpartition(PARAGRAPH)[0]}{PARAGRAPH}{result.details()}")
        else:
            print_text(str(result))
    written = save()
    if plot:
        replace_figure(plot, result.plot(), dpi=150)
        written.append(str(plot))
    report_results({**result.to_dict(), **facts}, written, args)
    return exit_status(result.status == "interrupted", written)


@contextmanager
def option_names(typed: Iterable[tuple[str, str]]) -> Iterator[None]:
    """Name options of the command in place of arguments of the function in errors.

    ``typed`` has pairs of a pattern and its replacement.
    """
    try:
        yield
    except TsmError as error:
        if len(error.args) == 1:
            text = str(error)
            for script, command in typed:
                text = re.sub(script, command, text)
            error.args = (text,)
        raise


def known_name(name: str, known: Iterable[str], what: str, hint: Callable[[str, Sequence[str]], str] = near) -> str:
    """The known name that equals ``name``, ignoring case; raises UsageError with a hint, by default the nearest one."""
    names = list(known)
    same = [k for k in names if k == name] or [k for k in names if k.lower() == name.lower()]
    if not same:
        raise UsageError(f"there is no {what} '{name}'.{hint(name, names)}")
    return same[0]
