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
_MARKS = frozenset("[]{},=\n")


class Places:
    """Lines of a TOML text, counted from 1, by path: ``("blocks", "pid", "kp")``, ``("wires", 2)``.

    ``repeated`` maps the line of a repeated key to its path and first line. ``trouble`` holds a line and a sentence
    where the text is nested too deep, or too long.
    """

    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self.repeated: dict[int, tuple[Path, int]] = {}
        self.trouble: tuple[int, str] | None = None
        self._text, self._at = text, 0
        self._line, self._newlines = 1, 0  # where the last token begins, and the line ends in it
        table: Path = ()
        while token := self._next():
            if token == "[":
                table = self._key((), self._next(), "]") or table
            elif token not in _MARKS:
                self._assignment(table, token)

    def line(self, *path: str | int) -> int | None:
        """The line of a key, or of the nearest enclosing one whose line is known."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return None

    # ---- reading

    def _next(self, in_array: bool = False) -> str:
        """The next mark, word, text or line end; ``""`` at the end, and after trouble."""
        while self.trouble is None:
            self._line, self._newlines = self._line + self._newlines, 0
            token = (in_array and _PLAIN.match(self._text, self._at)) or _TOKEN.match(self._text, self._at)
            if not token:
                break
            self._at, self._newlines = token.end(), token[0].count("\n")
            if token.lastgroup != "blank":
                return token[0]
        return ""

    def _assignment(self, table: Path, token: str) -> None:
        """A key of a table, from its first token on, and its value."""
        path = self._key(table, token, "=")
        if path:
            self._value(path, self._next())

    def _key(self, base: Path, token: str, end: str) -> Path | None:
        """The path of a key up to its end mark, with its line recorded; None where it has no end in its line."""
        parts: list[str] = []
        while token and token not in (end, "\n"):
            if token[0] in "\"'":
                parts.append(_unquoted(token))
            elif token not in _MARKS:
                parts += [part for part in token.split(".") if part]
            token = self._next()
        path = (*base, *parts)
        if token != end or not parts or self._too_deep(path):
            return None
        if path in self.lines:
            self.repeated[self._line] = path, self.lines[path]
        for length in range(len(base) + 1, len(path)):  # tables in a dotted path
            self.lines.setdefault(path[:length], self._line)
        self._record(path)
        return path

    def _value(self, path: Path, token: str) -> None:
        """A value, of which only texts in arrays have a line."""
        if token not in ("[", "{") or self._too_deep(path):
            return
        if token == "{":
            while (token := self._next()) and token != "}":
                if token not in _MARKS:
                    self._assignment(path, token)
            return
        index = 0
        while (token := self._next(in_array=True)) and token != "]":
            if token[0] in "\"'":
                self._record((*path, index))
            self._value((*path, index), token)
            index += token.count(",") if token[0] not in "\"'" else 0

    def _record(self, path: Path) -> None:
        self.lines.setdefault(path, self._line)
        if len(self.lines) > MOST_KEYS:
            self.trouble = self._line, f"the file holds more than {MOST_KEYS:,} keys and texts; it is not read further."

    def _too_deep(self, path: Path) -> bool:
        if len(path) > DEEPEST_KEY:
            self.trouble = self._line, f"keys and brackets are nested more than {DEEPEST_KEY} deep."
        return len(path) > DEEPEST_KEY


def _unquoted(text: str) -> str:
    """The name in a quoted key."""
    if "\\" not in text:
        return text[1:-1]
    try:
        return str(tomllib.loads(f"key = {text}")["key"])
    except tomllib.TOMLDecodeError:
        return text[1:-1]
