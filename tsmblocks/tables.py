"""Tables as a terminal shows them: one function for all that is printed; and columns whose titles are not alike."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Sequence

NARROW = 24
"""Columns that words at the end of a row have at least, however narrow the terminal is."""


def columns(
    rows: Iterable[Sequence[str]], indent: str = "", left: Collection[int] = (0,), width: int | None = None
) -> str:  # fmt: skip
    """Rows with their cells in columns; those in ``left`` (by default the first) are flush left.

    With a ``width``, words in the last column go on below themselves where a row would be longer.
    """
    table = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))] if table else []
    lines = []
    for row in table:
        cells = [c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        before = indent + "".join(f"{cell}  " for cell in cells[:-1])
        last = [cells[-1]] if width is None else textwrap.wrap(
            row[-1], max(width - len(before), NARROW), break_long_words=False, break_on_hyphens=False
        ) or [""]  # fmt: skip
        lines += [
            f"{start}{part}".rstrip()
            for start, part in zip([before, *[" " * len(before)] * (len(last) - 1)], last, strict=True)
        ]
    return "\n".join(lines)


def unlike(names: Iterable[str]) -> list[str]:
    """Names of which no two are alike: a second ``x`` is ``x_2``."""
    made: list[str] = []
    for name in names:
        one, k = name, 1
        while one in made:
            k += 1
            one = f"{name}_{k}"
        made.append(one)
    return made
