"""The result of every reader: headings, and numbers with their rows and columns in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime

import attrs
import numpy as np

from tsmblocks.common.headings import heading

Rows = tuple[int | None, int | None]
"""First and last row to keep, both included, numbered as in the file; None is the end."""


MAX_LISTED_ROWS = 5
"""Row numbers that a note lists at most. Chosen."""


@attrs.frozen(eq=False)
class Table:
    """Columns of numbers. ``values`` has one column per name, NaN where the file has no number.

    ``rows`` holds the row number of each sample and ``places`` the column number of each column,
    both counted from 1 as an editor or a spreadsheet counts them. ``tail`` and ``gaps`` are arguments of
    ``read``, ``requested`` the columns that its arguments name. ``filled`` marks, by column, the samples that were
    interpolated.
    """

    origin: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    rows: np.ndarray
    places: tuple[int, ...]
    notes: tuple[str, ...] = ()
    tail: str = "refuse"
    gaps: str = "refuse"
    requested: frozenset[str] = frozenset()
    filled: Mapping[str, np.ndarray] = attrs.field(factory=dict, repr=False)

    def column(self, k: int) -> str:
        """Return a column as a message names it."""
        return f"column {self.places[k]} ({heading(self.names[k], self.units[k])})"

    def signals(self) -> Iterator[tuple[str, np.ndarray]]:
        """Name and values of each column but the first, which is the time."""
        return zip(self.names[1:], self.values.T[1:], strict=True)

    def noted(self, note: str, values: np.ndarray | None = None, rows: np.ndarray | None = None) -> Table:
        """The table with other numbers, and a note of a change or a caution."""
        values, rows = self.values if values is None else values, self.rows if rows is None else rows
        return attrs.evolve(self, values=values, rows=rows, notes=(*self.notes, note))


def plural(n: int, word: str) -> str:
    """``1 row``, ``2 rows``."""
    return f"{n} {word}{'' if n == 1 else 's'}"


def rows_text(rows: np.ndarray) -> str:
    """``row 7``, ``rows 7, 8, 9``; of many the first."""
    shown = ", ".join(map(str, rows[:MAX_LISTED_ROWS])) + (", …" if len(rows) > MAX_LISTED_ROWS else "")
    return f"row{'s' if len(rows) > 1 else ''} {shown}"


def rows_argument(first: int, last: int) -> str:
    """How to read these rows alone, in Python and by a command."""
    return f"rows=({first}, {last}), or --rows {first}:{last}"


@attrs.frozen(eq=False)
class Source:
    """A file whose headings are known and whose numbers have not been read yet.

    ``headings`` are names, perhaps with a unit each; ``notes`` say what was assumed or left out. ``folder`` is the
    group that all columns lie in, if any; ``clocks`` are the columns of dates and times, with the first of each.
    """

    origin: str
    headings: Sequence[str]
    notes: tuple[str, ...] = ()
    folder: str = ""
    clocks: Mapping[int, datetime] = attrs.field(factory=dict, repr=False)

    def words(self, places: Sequence[int]) -> list[int]:
        """The columns that hold text, and no number in any row."""
        return []

    def numbers(self, chosen: Sequence[int], rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Values of the chosen columns, shape (samples, columns), and the row number of each sample."""
        raise NotImplementedError


def within(numbers: np.ndarray, rows: Rows) -> np.ndarray:
    """Which of these row numbers are to be kept."""
    first, last = rows
    return (numbers >= (1 if first is None else first)) & (numbers <= (np.inf if last is None else last))
