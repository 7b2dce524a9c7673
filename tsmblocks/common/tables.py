"""Tables of text for a terminal, lists of names for messages, and unique names for columns."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

WIDTH, LONGEST_LINE = 80, 100
"""Characters of a line where no terminal says otherwise, and of a line of prose at most. Chosen: longer ones are hard
to read."""
_COLUMNS: ContextVar[int] = ContextVar("columns", default=WIDTH)
NO_CELL = " " * 5
"""What a row ends with whose last cells are empty. Derived: two spaces, a cell of a letter, and two spaces."""
NARROW = 24
"""Least characters for wrapped text beside a row, else it is put below. Chosen: about three words."""


@contextmanager
def as_wide_as(columns: int) -> Iterator[None]:
    """Texts and tables that are made meanwhile are for a terminal of so many columns."""
    token = _COLUMNS.set(columns)
    try:
        yield
    finally:
        _COLUMNS.reset(token)


def table_width() -> int:
    """Characters that a row of a table may have."""
    return _COLUMNS.get()


def line_width() -> int:
    """Characters that a line of prose may have."""
    return min(_COLUMNS.get(), LONGEST_LINE)


def columns(
    rows: Iterable[Sequence[str]], indent: str = "", left: Collection[int] = (0,), width: int | None = None
) -> str:
    """Rows with aligned cells; those in ``left`` (by default the first) are flush left.

    Where that is wider than ``width`` (by default that of the terminal), text in the last column (where it is flush
    left) is wrapped below itself, and a name in the first column that leaves too little room is put above its row.
    """
    table = [list(row) for row in rows]
    if not table:
        return ""
    width = width or table_width()
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    end = len(widths) - 1
    words = end > 0 and end in left
    rest = len(indent) + sum(w + 2 for w in (widths[1:end] if words else widths[1:])) + 2 * words
    if rest + widths[0] > width:
        widths[0] = max((len(row[0]) for row in table if rest + len(row[0]) <= width), default=0)
    room = width - rest - widths[0]
    lines = []
    for row in table:
        if len(row[0]) > widths[0]:
            lines.append(indent + row[0])
            row = ["", *row[1:]]
        cells = [c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        if not words or len(row[end]) <= room:
            lines.append((indent + "  ".join(cells)).rstrip())
        else:
            before = indent + "  ".join(cells[:-1]) + "  "
            lines += _with_words(before, row[end], width, f"{indent}    ", empty=not all(row[1:end]))
    return "\n".join(lines)


def _with_words(before: str, words: str, width: int, below: str, *, empty: bool) -> list[str]:
    """A row with text at its end: beside it in lines that fit, in place of ``empty`` cells, or below it."""
    if empty and before.endswith(NO_CELL) and len(before.rstrip()) + 2 + len(words) <= width:
        return [f"{before.rstrip()}  {words}"]
    beside = width - len(before) >= NARROW
    first, others = (before, " " * len(before)) if beside else (below, below)
    fold = textwrap.TextWrapper(max(width, len(others) + NARROW), first, others, break_long_words=False)
    fold.break_on_hyphens = False
    return fold.wrap(words) if beside else [before.rstrip(), *fold.wrap(words)]


def split_columns(rows: Iterable[Sequence[str]], width: int | None = None) -> str:
    """Aligned columns of numbers, split into several tables where one would be too wide; each has the first column."""
    width = width or table_width()
    names, *numbers = zip(*rows, strict=True)
    widest, *widths = (max(map(len, column)) for column in (names, *numbers))
    for each in range(len(numbers), 0, -1):
        starts = range(0, len(numbers), each)
        if all(widest + sum(w + 2 for w in widths[k : k + each]) <= width for k in starts):
            break
    return "\n\n".join(columns(zip(names, *numbers[k : k + each], strict=True), width=width) for k in starts)


def few(names: Iterable[str], most: int = 6) -> str:
    """``a, b, c``; beyond ``most`` names the rest is counted: ``a, b, … (9 in all)``."""
    every = list(names)
    shown = every if len(every) <= most else [*every[: most - 1], f"… ({len(every)} in all)"]
    return ", ".join(shown)


def unique_names(names: Iterable[str], *, case: bool = True) -> list[str]:
    """Names made unique: a second ``x`` becomes ``x_2``. Without ``case``, ``X`` and ``x`` count as equal."""
    made: dict[str, str] = {}
    for name in names:
        one, k = name, 1
        while (one if case else one.casefold()) in made:
            k += 1
            one = f"{name}_{k}"
        made[one if case else one.casefold()] = one
    return list(made.values())


def listed(names: Sequence[str], most: int = 5) -> str:
    """``a``, ``a and b``, ``a, b and c``; beyond ``most`` names the rest is counted."""
    shown = [*names] if len(names) <= most + 1 else [*names[:most], f"{len(names) - most} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"
