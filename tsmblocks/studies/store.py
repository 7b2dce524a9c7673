"""Results of a study in a CSV file: written as runs end, continued after a kill, the same bytes however it was run.

It is a plain table: a heading and a row per run, as any program reads it. Rows are added in the order in which runs
end, and put in order once all are there. The facts of the study, by which a later call knows whether it is the same
one, are JSON in a file beside it: ``gains.study.json`` of ``gains.csv``.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.atomic_write import replace_file
from tsmblocks.common.errors import DataError, clip

FORMAT = 1
"""Version of the format of the facts."""
RUN_DIGITS = 18
"""Digits of the number of a run, at most. Derived: NumPy counts with 64 bits."""
DIGESTS = {"diagram": "other blocks, wires or numbers", "plan": "other parameters or values", "inputs": "other samples"}
"""Facts of which only a digest is kept, with the reason that a message gives where they differ."""


def facts_path(path: Path) -> Path:
    """The file with the facts of the study, beside the file of its results."""
    return path.with_suffix(".study.json")


@attrs.frozen
class Table:
    """Contents of the files: ``facts`` of the study, its ``heading``, and the cells of each row by run."""

    facts: Mapping[str, Any]
    heading: tuple[str, ...]
    rows: Mapping[int, tuple[str, ...]]


def read_table(path: Path) -> Table:
    """Read results and facts; a last line that was cut off is ignored. Raises DataError with the line."""
    text, beside = _text_of(path), facts_path(path)
    if not beside.exists():
        raise DataError(f"{path}: this is not a file of results of a study: there is no {beside.name} beside it.")
    try:
        facts = json.loads(_text_of(beside))
    except json.JSONDecodeError:
        facts = None
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise DataError(f"{beside}: this does not describe a study.")
    lines = list(csv.reader(io.StringIO(text[: text.rfind("\n") + 1])))
    heading = tuple(lines[0]) if lines else ()
    rows = {}
    for k, row in enumerate(lines[1:], start=2):
        if len(row) != len(heading) or not (row[0].isascii() and row[0].isdecimal() and len(row[0]) <= RUN_DIGITS):
            raise DataError(
                f"{path}:{k}: {len(heading)} columns are expected, the first being the number of a run; "
                f"got {clip(','.join(row), 60)!r}."
            )
        rows[int(row[0])] = tuple(row[1:])
    return Table(facts, heading, rows)


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or 'it is no text'}.") from None


@attrs.define
class Store:
    """Files that are being written; ``done`` has the rows of the runs in them. Without ``path`` nothing is written.

    ``parameters`` are the columns of the plan.
    """

    path: Path | None
    facts: Mapping[str, Any]
    heading: tuple[str, ...]
    parameters: tuple[np.ndarray, ...]
    done: dict[int, tuple[str, ...]] = attrs.field(factory=dict)

    def begin(self) -> None:
        """Continue an earlier run of the same study, or start a new one. Raises DataError for another study."""
        if self.path is None:
            return
        if self.path.exists() and self.path.stat().st_size:
            before = read_table(self.path)
            known = dict.fromkeys([*self.facts, *before.facts])
            other = [k for k in known if json.dumps(self.facts.get(k)) != json.dumps(before.facts.get(k))]
            if other:
                raise DataError(
                    f"{self.path} holds another study: {_difference(other[0], before.facts, self.facts)}. "
                    "Name another file, or remove that one to start again."
                )
            if before.heading != self.heading:
                raise DataError(f"{self.path}:1: the heading has been changed; it was {','.join(self.heading)}.")
            for run, row in before.rows.items():
                self._check(run, row)
            self.done.update(before.rows)
        replace_file(facts_path(self.path), json.dumps(self.facts, ensure_ascii=False, indent=1) + "\n")
        self.finish()

    def _check(self, run: int, row: Sequence[str]) -> None:
        """Raise DataError for a row that no run of this study can have."""
        count = len(self.parameters)
        wanted = tuple(cell_text(column[run]) for column in self.parameters) if run < self.facts["runs"] else None
        metrics = [parsed_cell(text) for text in row[count:]]
        if tuple(row[:count]) != wanted or not all(isinstance(value, float) for value in metrics):
            raise DataError(
                f"{self.path}: the row of run {run} has been changed: {clip(','.join(row), 80)!r}. Remove it, and the "
                "run is repeated."
            )

    def add(self, runs: Iterable[int], columns: Iterable[Iterable[Any]]) -> None:
        """Add the rows of some runs, columns side by side; they are on the disk when this returns."""
        made = {int(run): tuple(map(cell_text, values)) for run, *values in zip(runs, *columns, strict=True)}
        self.done.update(made)
        if self.path is not None:
            with self.path.open("ab") as file:
                file.write(_csv_text((k, *v) for k, v in made.items()).encode())
                file.flush()
                os.fsync(file.fileno())

    def finish(self) -> None:
        """Put all rows in order. The file is at any moment the old one or the new one."""
        if self.path is not None:
            rows = [self.heading, *((k, *self.done[k]) for k in sorted(self.done))]
            replace_file(self.path, _csv_text(rows))


def cell_text(value: Any) -> str:
    """A value as text of the file; a number reads back as the same number."""
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def parsed_cell(text: str) -> Any:
    """The value of a cell: a number where it is one, else the text."""
    try:
        return float(text)
    except ValueError:
        return text


def _csv_text(rows: Iterable[Sequence[Any]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def _difference(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    if name in DIGESTS:
        return f"its {name} has {DIGESTS[name]}"
    there, here = (str(side.get(name, "missing")) for side in (before, now))
    return f"its {name} is {clip(there, 60)}, and not {clip(here, 60)}"
