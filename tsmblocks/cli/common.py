"""What the commands share: arguments, and how their results are handed over. Light: nothing heavy at import."""

from __future__ import annotations

import argparse
import math
import re
import textwrap
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tsmblocks.cli.console import complain, give, wrapped
from tsmblocks.common.errors import TsmError, near
from tsmblocks.common.tables import unlike

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells expect it."""
RESULTS = (".csv", ".npz", ".mat")
PICTURES = (".png", ".svg", ".pdf")


DIAGRAMS, BLOCKS, FILES, FOLDERS = "diagrams", "blocks", "files", "folders"
"""What a shell may offer, beside plain words."""
METHODS, HOLDS, BACKENDS = ("euler", "heun", "rk4"), ("zero", "linear", "cubic"), ("llvm", "casadi")
FITS = ("gauss-newton", "ipopt", "ga")


class UsageError(TsmError):
    """A command line that cannot be understood."""


class Formatter(argparse.HelpFormatter):
    """Help in lines as wide as the terminal; what is indented (an example) stays as it is."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        parts = [
            part if part.startswith(" ") else wrapped(" ".join(part.split()), width)
            for part in text.strip("\n").split("\n\n")
        ]
        return textwrap.indent("\n\n".join(parts), indent)


class Parser(argparse.ArgumentParser):
    """An argument parser that raises its complaints, so that all messages leave by one door."""

    def options(self) -> list[str]:
        """Every option it takes, as it is typed."""
        return [name for action in self._actions for name in action.option_strings]

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


def pair(text: str, form: str = "NAME=VALUE") -> tuple[str, str]:
    """``NAME=VALUE`` taken apart; ``form`` says what was expected."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is not {form}")
    return name.strip(), value.strip()


def count(text: str) -> int:
    """Return a whole number of at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least 0")
    return int(text)


def times(text: str) -> tuple[float | None, float | None]:
    """``START:STOP`` in s; either may be left out."""
    first, colon, last = text.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"'{text}' is not START:STOP in s, such as 2.5:10 or 5:")
    return (finite_float(first) if first else None), (finite_float(last) if last else None)


def part(text: str) -> float | tuple[float | None, float | None]:
    """A share such as ``0.5``, or ``START:STOP`` in s."""
    return times(text) if ":" in text else finite_float(text)


def bounds(text: str) -> tuple[str, tuple[float | None, float | None]]:
    """``NAME=LOW:HIGH``; either may be left out."""
    form = "NAME=LOW:HIGH, such as tsm.theta=0.1:50"
    name, value = pair(text, form)
    low, colon, high = value.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"'{text}' is not {form}")
    return name, (finite_float(low) if low else None, finite_float(high) if high else None)


def belief(text: str) -> tuple[str, tuple[float, float]]:
    """``NAME=MEAN:DEVIATION``."""
    form = "NAME=MEAN:DEVIATION, such as tsm.theta=5:0.5"
    name, value = pair(text, form)
    mean, colon, deviation = value.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"'{text}' is not {form}")
    return name, (finite_float(mean), finite_float(deviation))


def tie(text: str) -> tuple[str, str]:
    """``NAME=EXPRESSION``."""
    return pair(text, "NAME=EXPRESSION, such as alpha2=alpha1")


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
        known = f"{', '.join(endings[:-1])} or {endings[-1]}" if len(endings) > 1 else endings[0]
        raise UsageError(f"'{text}' must end in {known}.")
    if path.is_dir():
        raise UsageError(f"'{text}' is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise UsageError(f"there is no folder '{path.parent}' to write {path.name} into.")
    return path


def marked(path: Path, names: Iterable[str]) -> dict[str, Path]:
    """The paths of several files: each of ``names`` added before the ending, ``fitted_bend60.toml``.

    No two are alike, on disks that do not tell capitals apart either.
    """
    listed = list(names)
    plain = unlike((re.sub(r"[^a-zA-Z0-9_.-]+", "_", name).strip("_") for name in listed), case=False)
    return {name: path.with_name(f"{path.stem}_{one}{path.suffix}") for name, one in zip(listed, plain, strict=True)}


def figure_path(text: str | None) -> Path | None:
    """Check the path of a figure, and that there is something to draw it with."""
    path = result_path(text, PICTURES)
    if path is not None:
        from tsmblocks.plots.panels import need_matplotlib

        need_matplotlib()
    return path


def settings_argument(options: argparse._ActionsContainer) -> None:
    """Declare --set."""
    options.add_argument(
        "--set",
        dest="settings",
        metavar="NAME=VALUE",
        type=setting,
        nargs="+",
        action="extend",
        default=[],
        help="other values for parameters, such as pid.kp=2.2",
    )


def result_arguments(options: argparse._ActionsContainer, written: str) -> None:
    """Declare the options of a fit's results; ``written`` is what --out takes."""
    add = options.add_argument
    add("--out", metavar="FILE", help=f"write {written} to a .toml file")
    add("--plot", metavar="FILE", help="write a figure to a .png, .svg or .pdf file")
    json_argument(options)


def suggest(action: argparse.Action, what: str | Sequence[str]) -> None:
    """Say what a shell may offer for a value: words, or one of the kinds above."""
    vars(action)["suggests"] = what if isinstance(what, str) else tuple(what)


def hold_argument(options: argparse._ActionsContainer, default: str = "linear") -> None:
    """Declare --hold; ``default`` is that of the function behind the command."""
    words = [f"{one} (default)" if one == default else one for one in HOLDS]
    hold = options.add_argument(
        "--hold", default=default, metavar="HOLD", help=f"data between samples: {', '.join(words[:-1])} or {words[-1]}"
    )
    suggest(hold, HOLDS)


def json_argument(options: argparse._ActionsContainer) -> None:
    """Declare --json, which every command has that prints results."""
    options.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else; null is what is no finite number"
    )


# ---- what is said -------------------------------------------------------------------------------


def hand_over(facts: dict[str, Any], written: Sequence[str], args: argparse.Namespace) -> None:
    """Give what was found as JSON, or say what was written, apart from what stands above it."""
    if args.json:
        give({**facts, "written": [*written]})
    elif written:
        print("\n" + "\n".join(f"wrote {path}" for path in written))


def ended(interrupted: bool, written: Sequence[str], missing: Sequence[str] = ()) -> int:
    """Exit status of a search; one that Ctrl-C ended is said to be no more than the best so far."""
    if interrupted:
        seen = "what you see and what was written is" if written else "what you see is"
        left_out = f" Not reached: {', '.join(missing)}." if missing else ""
        complain(f"stopped before the search was over; {seen} the best so far.{left_out}")
    return INTERRUPTED if interrupted else 0


def finished(found: Any, facts: dict[str, Any], written: list[str], plot: Path | None, args: argparse.Namespace) -> int:
    """Draw and hand over what a search found; its exit status. ``facts`` are added in JSON."""
    if plot:
        found.plot().savefig(plot, dpi=150)
        written.append(str(plot))
    hand_over({**found.to_dict(), **facts}, written, args)
    return ended(found.status == "interrupted", written)


def as_typed(error: TsmError, typed: Iterable[tuple[str, str]]) -> TsmError:
    """The same complaint with arguments as they are typed here, not as they stand in a script.

    ``typed`` has pairs of a pattern and what stands in its place.
    """
    if len(error.args) == 1:
        text = str(error)
        for script, command in typed:
            text = re.sub(script, command, text)
        error.args = (text,)
    return error


def show(value: float) -> str:
    """Return a number as a table shows it."""
    return f"{value:.4g}"


def choose(name: str, known: Iterable[str], what: str) -> str:
    """Return a known name, whatever its case; raises UsageError with the near miss."""
    names = list(known)
    found = next((k for k in names if k == name), None) or next((k for k in names if k.lower() == name.lower()), None)
    if found is None:
        raise UsageError(f"there is no {what} '{name}'.{near(name, names)}")
    return found
