"""Positions in a TOML text: the line of every key and of every text in an array.

``tomllib`` gives values without lines, so the text is read a second time here, for lines only. This reader is lenient:
``tomllib`` refuses what is not TOML. Brackets and dots nested deeper than any diagram needs are refused here, before
``tomllib`` exhausts the stack, or takes too long, on them.
"""

from __future__ import annotations

import re
import tomllib

Path = tuple[str | int, ...]

DEEPEST_KEY = 160
"""Parts of a key, counted through tables. Derived: 64 diagrams inside each other need 130."""
MOST_KEYS = 250_000
"""Keys and texts in one file. Chosen: a hundred times the largest diagram drawn by hand."""

_TOKEN = re.compile(
    r"""
    (?P<blank>  [ \t\r]+ | \#[^\n]* )
  | (?P<line>   \n )
  | (?P<mark>   [][{},=] )
  | (?P<word>   [^\s"'\#\[\]{},=]+ )
  | (?P<text>   "{3} [^"\\]*+ (?:(?:\\.|"{1,2}(?!")) [^"\\]*+)*+ "{3,5} | '{3} .*? '{3,5}
              | " [^"\\\n]*+ (?:\\.[^"\\\n]*+)*+ " | ' [^'\n]* ' )
    """,
    re.VERBOSE | re.DOTALL,
)
_PLAIN = re.compile(r"[^\"'#\[\]{}\n]+")
"""Numbers and commas, of which a long array has thousands, as one token."""


class Places:
    """Lines of a TOML text, counted from 1, by path: ``("blocks", "pid", "kp")``, ``("wires", 2)``.

    ``repeated`` maps the line of a repeated key to its path and first line. ``trouble`` holds a line and a sentence
    where the text is nested too deep, or too long.
    """

    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self.repeated: dict[int, tuple[Path, int]] = {}
        self.trouble: tuple[int, str] | None = None
        self._line = 1
        self._table: Path = ()  # the section whose keys are being read
        self._parts: list[str] = []  # of the key being read
        self._open: list[tuple[Path, int | None]] = []  # brackets: an array with its index, or a table
        self._at: Path = ()  # the key whose value is being read
        self._in_key = True
        self._in_header = False
        self._read(text)

    def line(self, *path: str | int) -> int | None:
        """The line of a key, or of the nearest enclosing one whose line is known."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return None

    # ---- reading

    def _read(self, text: str) -> None:
        at, end = 0, len(text)
        while at < end and self.trouble is None:
            token = self._in_array() and _PLAIN.match(text, at)
            if token:
                at = token.end()
                self._next(token[0].count(","))
                continue
            token = _TOKEN.match(text, at)
            if token is None:
                return
            at = token.end()
            kind, shown = token.lastgroup, token[0]
            if kind == "line":
                self._new_line()
            elif kind == "mark":
                self._mark(shown)
            elif kind != "blank":
                self._content(shown, kind == "text")
                self._line += shown.count("\n")

    def _new_line(self) -> None:
        self._line += 1
        if not self._open:
            self._in_key, self._in_header, self._parts = True, False, []

    def _content(self, shown: str, quoted: bool) -> None:
        """Take a word or a text: as parts of a key, or as a value, of which only texts in arrays have a line."""
        if not self._in_key:
            if quoted:
                self._element()
            return
        self._parts += [_unquoted(shown)] if quoted else [part for part in shown.split(".") if part]
        self._check_depth(len(self._parts))

    def _element(self) -> None:
        """Record the line of a text in an array."""
        if self._in_array():
            self._record(self._here())

    def _in_array(self) -> bool:
        return bool(self._open) and self._open[-1][1] is not None

    def _here(self) -> Path:
        """The path of the value that is being read."""
        path, index = self._open[-1] if self._open else ((), None)
        return self._at if index is None else (*path, index)

    def _next(self, commas: int) -> None:
        """Go on after commas: to a later element of an array, or to the next key of an inline table."""
        path, index = self._open[-1]
        if index is not None:
            self._open[-1] = path, index + commas
        elif commas:
            self._in_key, self._parts = True, []

    def _record(self, path: Path) -> None:
        self.lines.setdefault(path, self._line)
        if len(self.lines) > MOST_KEYS:
            self.trouble = (
                self._line,
                f"the file holds more than {MOST_KEYS:,} keys and texts; it is not read further.",
            )

    def _check_depth(self, more: int) -> None:
        around = self._open[-1][0] if self._open else self._table
        if len(around) + more > DEEPEST_KEY:
            self.trouble = self._line, f"keys and brackets stand inside each other more than {DEEPEST_KEY} deep."

    # ---- marks

    def _mark(self, mark: str) -> None:
        if self._in_key and not self._open and mark in "[]":
            self._header(mark)
        elif mark == "=":
            self._assign()
        elif mark in "[{":
            self._enter(mark)
        elif mark in "]}":
            if self._open:
                self._open.pop()
                self._in_key = False
        elif self._open:  # a comma
            self._next(1)

    def _header(self, mark: str) -> None:
        """Begin or end a section's header, ``[blocks.pid]``."""
        if mark == "[":
            self._in_header, self._table, self._parts = True, (), []
        elif self._parts:
            self._table, self._parts = tuple(self._parts), []
            self._record_key((), self._table)

    def _assign(self) -> None:
        """End a key at its equals sign."""
        if not self._in_key or self._in_header:
            return
        base = self._open[-1][0] if self._open else self._table
        self._at = (*base, *self._parts)
        self._record_key(base, self._at)
        self._in_key, self._parts = False, []

    def _record_key(self, base: Path, path: Path) -> None:
        """Record the line of a key, and of the tables in its dotted path that are new."""
        if path in self.lines:
            self.repeated[self._line] = path, self.lines[path]
        for length in range(len(base) + 1, len(path)):
            self.lines.setdefault(path[:length], self._line)
        self._record(path)

    def _enter(self, mark: str) -> None:
        """Open an array or an inline table."""
        self._open.append((self._here(), 0 if mark == "[" else None))
        self._in_key, self._parts = mark == "{", []
        self._check_depth(0)


def _unquoted(text: str) -> str:
    """The name in a quoted key."""
    if "\\" not in text:
        return text[1:-1]
    try:
        return str(tomllib.loads(f"key = {text}")["key"])
    except tomllib.TOMLDecodeError:
        return text[1:-1]
