"""What every reader returns: headings, and numbers with their rows and columns in the file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import attrs
import numpy as np

from tsmblocks.common.units import heading

Rows = tuple[int | None, int | None]
"""First and last row to keep, both included, numbered as in the file; None is the end."""


@attrs.frozen(eq=False)
class Table:
    """Columns of numbers. ``values`` has one column per name, NaN where the file has no number.

    ``rows`` holds the row number of each sample and ``places`` the column number of each column,
    both counted from 1 as an editor or a spreadsheet counts them. ``tail`` and ``gaps`` are arguments of
    ``read``, ``requested`` the columns that its arguments name.
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

    def column(self, k: int) -> str:
        """Return a column as a message names it."""
        return f"column {self.places[k]} ({heading(self.names[k], self.units[k])})"


def noted(table: Table, values: np.ndarray, rows: np.ndarray, note: str) -> Table:
    """Return the table with other numbers, and a note of what was changed."""
    return attrs.evolve(table, values=values, rows=rows, notes=(*table.notes, note))


def plural(n: int, word: str) -> str:
    """``1 row``, ``2 rows``."""
    return f"{n} {word}{'' if n == 1 else 's'}"


class Source(Protocol):
    """A file whose headings are known and whose numbers have not been read yet."""

    @property
    def headings(self) -> Sequence[str]:
        """Heading of each column: a name, perhaps with a unit."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or left out, one sentence each."""
        ...

    def numbers(self, chosen: Sequence[int], rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Values of the chosen columns, shape (samples, columns), and the row number of each sample."""
        ...


def within(numbers: np.ndarray, rows: Rows) -> np.ndarray:
    """Which of these row numbers are to be kept."""
    first, last = rows
    return (numbers >= (1 if first is None else first)) & (numbers <= (np.inf if last is None else last))
