"""Output of the commands: messages as wide as the terminal, JSON, progress, and letters that a console may lack.

No colours are used, so there are none to switch off.
"""

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
from functools import partial
from pathlib import Path, PurePath
from typing import Any, TextIO

from tsmblocks.common.errors import CONTROLS, without_controls

MIN_WIDTH, MAX_WIDTH = 40, 100
"""Columns of text, at least and at most. Chosen: tables need some 40, and longer lines are hard to read."""
UPDATE_INTERVAL = 0.05
"""Time in s between two updates of the progress line. Chosen: 20 per second look continuous and cost nothing."""
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


def print_error(text: str) -> None:
    """Print one error on standard error, after the program's name."""
    print(fold(f"tsmblocks: {text}", sys.stderr), file=sys.stderr)


def print_note(text: str) -> None:
    """Print one remark on standard error that needs no action."""
    print(fold(f"note: {text}", sys.stderr), file=sys.stderr)


def width() -> int:
    """Columns of text: those of the terminal, or COLUMNS; 80 where neither is known."""
    return min(max(shutil.get_terminal_size().columns, MIN_WIDTH), MAX_WIDTH)


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

    None is yielded with ``quiet``, and where standard error is no terminal or one without a cursor (``TERM=dumb``).
    The line is overwritten without escape codes: old consoles do not support them. ``text_of`` is called each time:
    it may count its calls.
    """
    if quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None
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


def percent_progress(what: str) -> Callable[[float], str]:
    """The text of progress as a percentage."""
    return partial(stage_progress, what)


def search_progress(what: str) -> Callable[[str, int, float], str]:
    """The text of progress of a search: stage, number of runs and the least rms so far."""
    return lambda stage, runs, rms: f"{what}: {stage}, {runs} runs, rms {rms:.4g}"


def stage_progress(stage: str, done: float) -> str:
    """The text of progress of a stage, as a percentage."""
    return f"{stage}: {100 * done:3.0f} %"
