"""Output of the commands: messages as wide as the terminal, JSON, progress, and letters that a console may lack."""

from __future__ import annotations

import codecs
import json
import math
import os
import shutil
import sys
import textwrap
import time
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePath
from typing import Any, TextIO

from tsmblocks.cli import colour
from tsmblocks.common.errors import CONTROLS, without_controls
from tsmblocks.common.tables import LONGEST_LINE

MIN_WIDTH = 40
"""Columns at least. Chosen: tables need some 40."""
UPDATE_INTERVAL = 0.05
"""Time in s between two updates of the progress line. Chosen: 20 per second look continuous and cost nothing."""
FIRST_LINE_AFTER = 10.0
"""Time [s] of work before the first line of progress in a file. Chosen: short work has no lines."""
LINE_INTERVAL = 60.0
"""Time [s] between two lines of one stage. Chosen: it shows that the work continues."""
SHORTEST_SHOWN = 1.0
"""Time [s] from which the rest of some work is estimated. Chosen: less says little of what follows."""
OUTPUT = "standard output"
"""Name of the stream in its errors."""
ENCODE_ERRORS = "tsmblocks.readable"
"""Name of the codec error handler that replaces letters which an encoding lacks."""
REPLACEMENTS = {
    **dict.fromkeys("−–", "-"),
    **dict.fromkeys("’‘", "'"),
    **dict.fromkeys("“”", '"'),
    "→": "->",
    "⇒": "=>",
    "±": "+/-",
    "·": "*",
    "×": "x",
    "°": "deg",
    "ß": "ss",
    "≤": "<=",
    "≥": ">=",
    "∞": "inf",
    "√": "sqrt",
    "µ": "u",
    "⁄": "/",
    "∫": "int",
    "⌊": "floor(",
    "⌋": ")",
    "↑": "up",
    "↓": "down",
    "\N{COMBINING CIRCUMFLEX ACCENT}": "_hat",
}
"""Replacements of letters that an encoding lacks; others become the nearest ASCII letter, Greek ones their name."""


# ---- letters ------------------------------------------------------------------------------------


def _replace_unencodable(error: UnicodeError) -> tuple[str | bytes, int]:
    """Letters that an encoding lacks, as ASCII."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(ascii_letter, error.object[error.start : error.end])), error.end


def ascii_letter(letter: str) -> str:
    """A letter in ASCII: ``->`` for an arrow, ``theta`` for the Greek letter, ``?`` where nothing is similar."""
    if letter in REPLACEMENTS:
        return REPLACEMENTS[letter]
    script, _, rest = unicodedata.name(letter, "").partition(" ")
    if script == "GREEK":
        name = rest.rpartition("LETTER ")[2].partition(" ")[0]
        return name.capitalize() if letter.isupper() else name.lower()
    power = "^" if unicodedata.decomposition(letter).startswith("<super>") else ""
    parts = (REPLACEMENTS.get(part, part) for part in unicodedata.normalize("NFKD", letter))
    return power + "".join(parts).encode("ascii", "ignore").decode() or "?"


codecs.register_error(ENCODE_ERRORS, _replace_unencodable)


class _WithoutControls:
    """A stream that writes no control characters, which texts of a file may hold, but for tabs and new lines.

    Errors of standard output name it. Those of standard error are suppressed: there is nowhere to report them.
    """

    def __init__(self, stream: TextIO, name: str) -> None:
        self.unfiltered, self._name = stream, name

    def write(self, text: str) -> int:
        """Write a text."""
        with self._errors():
            return self.unfiltered.write(without_controls(text))
        return len(text)

    def write_emphasised(self, text: str) -> None:
        """Write a text with colours, where the stream shows them."""
        plain = without_controls(text)
        with self._errors():
            self.unfiltered.write(colour.emphasised(plain) if colour.wanted(self.unfiltered) else plain)

    def flush(self) -> None:
        """Write what is buffered."""
        with self._errors():
            self.unfiltered.flush()

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if self._name == OUTPUT:
                error.filename = self._name
                raise

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unfiltered, name)


@contextmanager
def readable_streams() -> Iterator[None]:
    """Let both streams write a readable replacement of every letter that their encoding lacks, instead of failing.

    Nor do they write characters that would steer the terminal. A stream that was closed before the program began leads
    nowhere, and no file that is opened later gets its number.
    """
    changed, streams = [], (sys.stdout, sys.stderr)
    with ExitStack() as opened:
        for name, stream in zip((OUTPUT, "standard error"), streams, strict=True):
            before = getattr(stream, "errors", "")
            if before in ("strict", "backslashreplace") and hasattr(stream, "reconfigure"):
                stream.reconfigure(errors=ENCODE_ERRORS)
                changed.append((stream, before))
            there = stream or opened.enter_context(Path(os.devnull).open("w", encoding="utf-8", newline="\n"))
            setattr(sys, "stdout" if name == OUTPUT else "stderr", _WithoutControls(there, name))
        try:
            yield
        finally:
            sys.stdout, sys.stderr = streams
            for stream, before in changed:
                if not stream.closed:
                    with suppress(OSError):  # of what could not be written
                        stream.reconfigure(errors=before)


# ---- messages -----------------------------------------------------------------------------------


def print_text(text: str, stream: TextIO | None = None) -> None:
    """Print a text for people on standard output or another stream: with colours, where it shows them.

    Standard output is written at the end of the command: a fault of it is then one message.
    """
    stream = sys.stdout if stream is None else stream
    write = getattr(stream, "write_emphasised", stream.write)
    write(f"{text}\n")
    if stream is not sys.stdout:
        stream.flush()


def print_error(text: str) -> None:
    """Print one error on standard error, after the program's name; a file's only problem without a list."""
    where, only, problem = text.partition(" has 1 problem:\n  1. ")
    if only:
        text = problem if problem.startswith(f"{where}:") else f"{where}: {problem}"
    print_text(fold(f"tsmblocks: {text}", sys.stderr), sys.stderr)


def print_note(text: str) -> None:
    """Print one remark on standard error that needs no action."""
    print_text(fold(f"note: {text}", sys.stderr), sys.stderr)


def columns() -> int:
    """Columns of the terminal, or COLUMNS; 80 where neither is known."""
    return max(shutil.get_terminal_size().columns, MIN_WIDTH)


def width() -> int:
    """Columns of a text of sentences."""
    return min(columns(), LONGEST_LINE)


def fold(text: str, stream: TextIO) -> str:
    """A text in lines as wide as the terminal; unchanged where the stream is not one, so that programs can read it."""
    return wrap(text, width(), "  ") if stream.isatty() else text


def wrap(text: str, columns: int, others: str = "") -> str:
    """Every line of a text broken into lines that fit; all but the first of each begin with ``others``."""
    return "\n".join(
        textwrap.fill(line, columns, subsequent_indent=others, break_long_words=False, break_on_hyphens=False)
        for line in text.split("\n")
    )


# ---- JSON ---------------------------------------------------------------------------------------


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output, infinities and NaN as null.

    It is UTF-8, or ASCII with escapes where the stream has another encoding; every reader of JSON accepts both.
    """
    unicode = (getattr(sys.stdout, "encoding", None) or "utf-8").lower().startswith("utf")
    text = json.dumps(json_value(value), indent=2, ensure_ascii=not unicode, allow_nan=False)
    print(CONTROLS.sub(lambda found: f"\\u{ord(found[0]):04x}", text))


def json_value(value: Any) -> Any:
    """A value in types of JSON: numbers of NumPy as numbers, a path as text, infinities and NaN as None."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_value(v) for v in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, PurePath):
        return str(value)
    return json_value(value.tolist()) if hasattr(value, "tolist") else value


# ---- progress -----------------------------------------------------------------------------------


@contextmanager
def progress_line(text_of: Callable[..., str], *, quiet: bool = False) -> Iterator[Callable[..., None] | None]:
    """Yield a progress callback that writes ``text_of(...)`` on one line of standard error, which is erased at the end.

    Where standard error is no terminal, or one without a cursor (``TERM=dumb``), it has a line for each stage of long
    work instead. None is yielded with ``quiet``. The line is overwritten without escape codes: old consoles do not
    support them. ``text_of`` is called each time: it may count its calls.
    """
    if quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None if quiet else _stage_lines(text_of)
        return
    stream, length, last = getattr(sys.stderr, "unfiltered", sys.stderr), 0, -math.inf

    def overwrite(text: str) -> None:
        with suppress(OSError):  # a terminal that is gone
            stream.write(text)
            stream.flush()

    def show(*far: Any) -> None:
        nonlocal length, last
        text, now = without_controls(text_of(*far))[: shutil.get_terminal_size().columns - 1], time.monotonic()
        if now - last >= UPDATE_INTERVAL:
            overwrite(f"\r{text}{' ' * (length - len(text))}")
            length, last = len(text), now

    try:
        yield show
    finally:
        if length:
            overwrite(f"\r{' ' * length}\r")


def _stage_lines(text_of: Callable[..., str]) -> Callable[..., None]:
    """A progress callback that prints a line where a stage begins, its first argument, and then at times."""
    began, stage, last = time.monotonic(), "", -math.inf

    def show(*far: Any) -> None:
        nonlocal stage, last
        text, now, of = text_of(*far), time.monotonic(), far[0] if isinstance(far[0], str) else ""
        if now - began >= FIRST_LINE_AFTER and (of != stage or now - last >= LINE_INTERVAL):
            print_text(f"after {duration_text(now - began)}: {text}", sys.stderr)
            stage, last = of, now

    return show


class TimeLeft:
    """The time that work still takes, from what is done since the first call for the same ``of``."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._of, self._began, self._first = clock, "", -math.inf, math.inf

    def __call__(self, done: float, of: str = "") -> str:
        """``, about 12 s left`` after a share of the work is done; nothing until it can be known."""
        now = self._clock()
        if of != self._of or done < self._first:
            self._of, self._began, self._first = of, now, done
        gone, won = now - self._began, done - self._first
        if gone < SHORTEST_SHOWN or not won > 0 or done >= 1:
            return ""
        return f", about {duration_text(gone / won * (1 - done))} left"


def duration_text(seconds: float) -> str:
    """A duration as text: ``12 s``, ``3 min 20 s``, ``2 h 5 min``."""
    minutes, rest = divmod(math.ceil(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if minutes else f"{rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def percent_progress(what: str) -> Callable[[float], str]:
    """The text of progress as a percentage, with the time that is left."""
    left = TimeLeft()
    return lambda done: f"{what}: {100 * done:.0f} % done{left(done)}"


class StartCount:
    """The start that a search is at: each counts its runs from one."""

    def __init__(self) -> None:
        self._of, self._runs, self._start = "", 0, 1

    def __call__(self, of: str, runs: int) -> int:
        """The number of the start, after so many runs of it."""
        if of != self._of:
            self._of, self._start = of, 1
        elif runs < self._runs:
            self._start += 1
        self._runs = runs
        return self._start


def search_progress(what: str, starts: int) -> Callable[[str, int, float], str]:
    """The text of progress of a search from several starts: which it is, its runs and its rms, and the time left."""
    count, left = StartCount(), TimeLeft()

    def text(stage: str, runs: int, rms: float) -> str:
        start = min(count("", runs), starts)
        at = f", start {start} of {starts}" if starts > 1 else ""
        return f"{what} by {stage}{at}: {runs} runs, rms {rms:.4g}{left((start - 1) / starts)}"

    return text


def stage_progress() -> Callable[[str, float], str]:
    """The text of progress of stages, as a percentage of all, with the time that is left."""
    left = TimeLeft()
    return lambda stage, done: f"{100 * done:.0f} % done, {stage}{left(done)}"
