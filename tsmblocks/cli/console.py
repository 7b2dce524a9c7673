"""What leaves the program: messages as wide as the terminal, JSON, progress, and letters that a console may lack.

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
from contextlib import contextmanager
from pathlib import PurePath
from typing import Any, TextIO

NARROWEST, WIDEST = 40, 100
"""Columns that text is folded to at least and at most, whatever the terminal says."""
OFTEN = 0.05
"""Time in s between two changes of the line that tells how far things are."""
LEGIBLE = "tsmblocks.legible"
"""Name of the way in which letters are written that an encoding has not."""
PLAIN = {
    "−": "-",
    "–": "-",
    "→": "->",
    "⇒": "=>",
    "±": "+/-",
    "…": "...",
    "·": "*",
    "×": "x",
    "°": "deg",
    "ß": "ss",
    "’": "'",
    "‘": "'",
    "“": '"',
    "”": '"',
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
"""What stands for letters that an encoding has not; of others the nearest plain letter, or the name of a Greek one."""


# ---- letters ------------------------------------------------------------------------------------


def _legible(error: UnicodeError) -> tuple[str | bytes, int]:
    """Letters that an encoding has not, in letters that every encoding has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(plain_letter, error.object[error.start : error.end])), error.end


def plain_letter(letter: str) -> str:
    """A letter in ASCII: ``->`` for an arrow, ``theta`` for the Greek letter, ``?`` for what has no likeness."""
    if letter in PLAIN:
        return PLAIN[letter]
    script, _, rest = unicodedata.name(letter, "").partition(" ")
    if script == "GREEK":
        name = rest.rpartition("LETTER ")[2].partition(" ")[0]
        return name.capitalize() if letter.isupper() else name.lower()
    power = "^" if unicodedata.decomposition(letter).startswith("<super>") else ""
    parts = (PLAIN.get(part, part) for part in unicodedata.normalize("NFKD", letter))
    return power + "".join(parts).encode("ascii", "ignore").decode() or "?"


codecs.register_error(LEGIBLE, _legible)


@contextmanager
def legible() -> Iterator[None]:
    """Have both streams write something readable where their encoding lacks a letter, and never fail for it."""
    changed = []
    for stream in (sys.stdout, sys.stderr):
        before = getattr(stream, "errors", "")
        if before in ("strict", "backslashreplace") and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=LEGIBLE)
            changed.append((stream, before))
    try:
        yield
    finally:
        for stream, before in changed:
            if not stream.closed:
                stream.reconfigure(errors=before)


# ---- messages -----------------------------------------------------------------------------------


def complain(text: str) -> None:
    """One message to standard error under the program's name."""
    print(folded(f"tsmblocks: {text}", sys.stderr), file=sys.stderr)


def note(text: str) -> None:
    """Something the user should know but need not act on."""
    print(folded(f"note: {text}", sys.stderr), file=sys.stderr)


def width() -> int:
    """Columns that text is folded to: those of the terminal, or COLUMNS; 80 where neither is known."""
    return min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)


def folded(text: str, stream: TextIO) -> str:
    """A text in lines as wide as the terminal; as it is where nobody looks at it, so that programs can."""
    return wrapped(text, width(), "  ") if stream.isatty() else text


def wrapped(text: str, columns: int, others: str = "") -> str:
    """Every line of a text in lines that fit; those that follow begin with ``others``."""
    return "\n".join(
        textwrap.fill(line, columns, subsequent_indent=others, break_long_words=False, break_on_hyphens=False)
        for line in text.split("\n")
    )


# ---- JSON ---------------------------------------------------------------------------------------


def give(value: Mapping[str, Any]) -> None:
    """One JSON object on standard output, infinities and NaN as null.

    It is UTF-8, or where the stream has another encoding ASCII with escapes, which every reader of JSON takes.
    """
    unicode = (getattr(sys.stdout, "encoding", None) or "utf-8").lower().startswith("utf")
    print(json.dumps(plain(value), indent=2, ensure_ascii=not unicode, allow_nan=False))


def plain(value: Any) -> Any:
    """A value as JSON knows it: of NumPy the numbers, of a path its text, None for what is no number."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, PurePath):
        return str(value)
    return plain(value.tolist()) if hasattr(value, "tolist") else value


# ---- progress -----------------------------------------------------------------------------------


@contextmanager
def progress(words: Callable[..., str], *, quiet: bool = False) -> Iterator[Callable[..., None] | None]:
    """Give a function that shows ``words(...)`` on one line of standard error, which is gone at the end.

    None is given where nobody would see it: standard error is no terminal or one that moves no cursor (``TERM=dumb``),
    or with ``quiet``.
    """
    if quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None
        return
    line = _Line(sys.stderr)
    try:
        yield lambda *far: line.show(words, far)
    finally:
        line.show(lambda: "", ())


class _Line:
    """One line that is written over again and again, by plain letters alone: old consoles know no escape codes."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.length, self.last = stream, 0, -math.inf

    def show(self, words: Callable[..., str], far: tuple[Any, ...]) -> None:
        """Write the words over those before, cut to one line; as often as can be read, and always when there are none.

        Words are asked for each time: they may count.
        """
        text, now = words(*far)[: shutil.get_terminal_size().columns - 1], time.monotonic()
        if (text and now - self.last < OFTEN) or (not text and not self.length):
            return
        rest = " " * (self.length - len(text))
        self.stream.write(f"\r{text}{rest}" if text else f"\r{rest}\r")
        self.stream.flush()
        self.last, self.length = now, len(text)


def percent(what: str) -> Callable[[float], str]:
    """Words for how much of one thing is done."""
    return lambda done: f"{what}: {100 * done:3.0f} %"


def searched(what: str) -> Callable[[str, int, float], str]:
    """Words for how far a search has come."""
    return lambda stage, runs, rms: f"{what}: {stage}, {runs} runs, rms {rms:.4g}"
