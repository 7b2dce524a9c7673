"""Tables of numbers from text: CSV and its relatives, with or without a header."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import date, datetime, time
from pathlib import Path

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, in_words
from tsmblocks.common.headings import heading, split_heading
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.data.table import Rows, Source, plural, within

COMMENTS = ("#", "%", "//")
"""Beginnings of a line of comment."""
BLANK = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "+inf", "-inf"})
"""Contents of a cell without a number. An infinity is no number either."""
TIME_FORMATS = "Dates and times are read as 2026-11-22 14:03:07.5, 22.11.2026 14:03:07.5 or 14:03:07.5."
"""Hint beside a cell that may be meant as a time."""
DAY = 86400.0
"""Length of a day [s]."""
MAX_MIDNIGHT_GAP = 3600.0
"""Longest gap [s] between times of day over midnight. Chosen: with a longer one, time has jumped back."""
MAX_LINE = 1_000_000
"""Characters of a line. Chosen: 10,000 columns of numbers with all digits take a quarter of it."""
MAX_COLUMNS = 10_000
"""Columns of a table. Chosen: recordings have tens."""
TEXT_BYTES = 10
"""Bytes of memory for one of a text file. Measured: 8 for lines of 20 characters."""
_DOTTED = re.compile(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})[ T]+(?=\d)")
_WORD = re.compile(r"\"[^\"]*\"|[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?")


def _decoded(path: Path, raw: bytes) -> tuple[str, tuple[str, ...]]:
    """Return the text of a file, and a note where it is not in UTF-8. Raises DataError where it is no text."""
    if not raw.strip():
        raise DataError(f"{path}: the file is empty.")
    if raw[:4] == b"PK\x03\x04":
        raise DataError(f"{path}: this is a spreadsheet or an archive. Export the sheet as CSV.")
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return raw.decode("utf-16"), ("Read as UTF-16 text.",)
        except UnicodeDecodeError:
            raise DataError(f"{path}: this begins as UTF-16 text and continues as none. Save it as UTF-8.") from None
    if b"\0" in raw:
        raise DataError(f"{path}: this is not text (zero byte in row {raw[: raw.index(0)].count(10) + 1}).")
    try:
        return raw.decode("utf-8-sig"), ()
    except UnicodeDecodeError as error:
        row, byte = raw[: error.start].count(b"\n") + 1, raw[error.start]
    made = raw.decode("cp1252", errors="replace")
    if "\ufffd" in made or any(not c.isprintable() and c not in "\t\r\n\xa0\xad" for c in set(made)):
        raise DataError(f"{path}: row {row} is not UTF-8 text (byte 0x{byte:02x}). Save the file as UTF-8.")
    shown = bytes([byte]).decode("cp1252")
    return made, (
        f"Row {row} is not UTF-8 text: the file was read as Windows-1252, where byte 0x{byte:02x} is {shown}.",
    )


def _separator(lines: Sequence[str]) -> str | None:
    """The separator of the cells; None is white space."""
    return next((c for c in ";\t," if 2 * sum(c in line for line in lines) > len(lines)), None)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return [cell.strip('"') for cell in _WORD.findall(line)]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:  # a cell longer than the reader's limit, which holds no number
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _number(cell: str) -> float | None:
    """Return the number in a cell, NaN for a blank one, None for text."""
    text = cell.strip().strip('"').strip()
    if text.lower() in BLANK:
        return float("nan")
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def _instant(cell: str) -> datetime | None:
    """The date and time, or the time of day, in a cell: as ISO 8601 writes them, or the day first, with points."""
    text = _DOTTED.sub(lambda m: f"{m[3]}-{m[2]:>02}-{m[1]:>02} ", cell.strip().strip('"').strip())
    if ":" not in text:
        return None
    with suppress(ValueError):
        return datetime.fromisoformat(text)
    with suppress(ValueError):
        return datetime.combine(date.min, time.fromisoformat(text))
    return None


def _seconds(cell: str, first: datetime) -> float | None:
    """Seconds since ``first``, NaN for a blank cell, None for anything else (one of both having a time zone too)."""
    instant = _instant(cell)
    if instant is None:
        return float("nan") if cell.strip().lower() in BLANK else None
    return (instant - first).total_seconds() if (instant.tzinfo is None) == (first.tzinfo is None) else None


def _over_midnight(seconds: np.ndarray) -> np.ndarray:
    """Times of day [s] continued over midnight, where no more than ``MAX_MIDNIGHT_GAP`` passes."""
    known = np.flatnonzero(np.isfinite(seconds))
    steps = np.diff(seconds[known])
    made = seconds.copy()
    made[known[1:]] += DAY * np.cumsum((steps < 0) & (steps + DAY <= MAX_MIDNIGHT_GAP))
    return made


def _is_numeric(cells: Sequence[str]) -> bool:
    return all(_number(cell) is not None or _instant(cell) is not None for cell in cells)


@attrs.frozen(eq=False)
class Text(Source):
    """A text file split into lines (with their row numbers), its headings read, its numbers not yet.

    Columns of dates and times become seconds since the first.
    """

    separator: str | None = attrs.field(kw_only=True)
    lines: list[str] = attrs.field(repr=False, kw_only=True)
    at: np.ndarray = attrs.field(repr=False, kw_only=True)

    def numbers(self, chosen: Sequence[int], rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """See Source. Raises DataError with row and column for text, and for rows of another length."""
        kept = within(self.at, rows)
        at = self.at[kept]
        lines = [line for line, keep in zip(self.lines, kept, strict=True) if keep]
        if not lines:
            return np.empty((0, len(chosen))), at
        if any('"' in line for line in lines) or set(chosen) & set(self.clocks):  # a quoted cell may hold the separator
            return self._one_by_one(lines, at, chosen), at
        self._check_lengths(lines, at)
        try:
            values = np.loadtxt(lines, delimiter=self.separator, usecols=chosen, ndmin=2, comments=None)
        except ValueError:
            return self._one_by_one(lines, at, chosen), at
        return np.where(np.isfinite(values), values, np.nan), at

    def words(self, places: Sequence[int]) -> list[int]:
        """The columns that hold text, and no number in any row."""
        open_places = [k for k in places if k not in self.clocks]
        filled: set[int] = set()
        for line in self.lines:
            if not open_places:
                break
            cells = _cells(line, self.separator)
            found = {k: _number(cells[k]) for k in open_places if k < len(cells)}
            filled |= {k for k, number in found.items() if number is None}
            open_places = [k for k in open_places if (number := found.get(k)) is None or np.isnan(number)]
        return [k for k in open_places if k in filled]

    def _check_lengths(self, lines: list[str], at: np.ndarray) -> None:
        c = self.separator
        counts = np.array([line.count(c) + 1 for line in lines] if c else [len(line.split()) for line in lines])
        bad = np.flatnonzero(counts != len(self.headings))
        if not len(bad):
            return
        k = bad[0]
        advice = "Every row needs the same number of cells."
        if c == "," and (counts > len(self.headings)).all():
            advice += " If these are numbers with a decimal comma, save them with semicolons between the cells."
        if len(bad) == 1 and k == len(at) - 1 > 0:
            advice = f"The file seems to have been cut while it was written: rows=(1, {at[k] - 1}) leaves that row out."
        raise DataError(
            f"{self.origin}: row {at[k]} has {counts[k]} cells, but there are {len(self.headings)} columns"
            f"{_and_more(len(bad), 'row')}. {advice}"
        )

    def _one_by_one(self, lines: list[str], at: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
        values, wrong = np.full((len(lines), len(chosen)), np.nan), []
        for row, line in enumerate(lines):
            cells = _cells(line, self.separator)
            for k, place in enumerate(chosen):
                cell, first = cells[place] if place < len(cells) else "", self.clocks.get(place)
                number = _number(cell) if first is None else _seconds(cell, first)
                if number is None:
                    wrong.append((row, place, cell))
                else:
                    values[row, k] = number
        if wrong:
            row, place, cell = wrong[0]
            throughout = sum(place == other for _, other, _ in wrong) == len(lines)
            what = "a date and time as in the first row" if place in self.clocks else "a number"
            raise DataError(
                f"{self.origin}: row {at[row]}, column {place + 1} ({self.headings[place]}) holds {in_words(cell)}, "
                f"which is not {what}{_and_more(len(wrong), 'cell')}."
                f"{self._advice(place, cell, chosen if throughout else ())}"
            )
        for k, place in enumerate(chosen):
            if place in self.clocks and self.clocks[place].date() == date.min:
                values[:, k] = _over_midnight(values[:, k])
        return values

    def _advice(self, place: int, cell: str, throughout: Sequence[int]) -> str:
        """Advice on a cell of text; where all cells of its column are text, how to read the other columns."""
        if ":" in cell and place not in self.clocks:
            return f" {TIME_FORMATS}"
        others = [split_heading(text)[0] for k, text in enumerate(self.headings) if k in throughout and k != place]
        return f" To leave that column out, name the others: only={others}." if others else ""


def _and_more(count: int, what: str) -> str:
    return f" (and {count - 1} more such {plural(count - 1, what).partition(' ')[2]})" if count > 1 else ""


def open_text(path: Path, columns: Sequence[str] | None) -> Text:
    """Split a text file into headings and lines. Raises DataError when it is no table or has no header."""
    refuse_too_large(TEXT_BYTES * path.stat().st_size, f"{path}: reading it")
    whole, notes = _decoded(path, path.read_bytes())
    return text_of(path, whole, columns, notes)


def _lines(path: Path, whole: str) -> tuple[list[str], list[int], str]:
    """Lines with content, their row numbers, and the last comment before the first. Raises DataError without any."""
    lines, at, remark = list[str](), list[int](), ""
    for number, line in enumerate(re.split("\r?\n|\r", whole), 1):
        bare = line.strip()
        if bare.startswith(COMMENTS):
            remark = remark if lines else bare.lstrip("#%/ ")
        elif len(bare) > MAX_LINE:
            raise DataError(f"{path}: row {number} has {len(bare):,} characters; at most {MAX_LINE:,} are read.")
        elif bare.strip(",; "):
            lines.append(bare if "\t" not in line else line)
            at.append(number)
    if not lines:
        raise DataError(f"{path}: the file holds no numbers, only comments.")
    return lines, at, remark


def text_of(path: Path, whole: str, columns: Sequence[str] | None, noted: Iterable[str]) -> Text:
    """Headings and lines of a text; ``noted`` is what was assumed of it so far. Raises DataError as ``open_text``."""
    lines, at, remark = _lines(path, whole)
    separator, notes = _separator(lines[:50]), list(noted)
    first = _cells(lines[0], separator)
    if len(first) > MAX_COLUMNS:
        raise DataError(f"{path}: row {at[0]} has {len(first):,} cells; at most {MAX_COLUMNS:,} columns are read.")
    headings = _headings(path, columns, first, remark, separator)
    if not _is_numeric(first):
        lines, at = lines[1:], at[1:]
        if columns:
            notes.append("The header of the file was replaced by the columns given.")
        below = [cell.strip().strip("[]()").strip() for cell in _cells(lines[0], separator)] if lines else []
        if _are_units(below, len(first)):
            headings = [_with_unit(text, unit) for text, unit in zip(headings, below, strict=True)]
            notes.append(f"Row {at[0]} was read as the units of the columns ({', '.join(filter(None, below))}).")
            lines, at = lines[1:], at[1:]
    if separator in (";", "\t") and any("," in line for line in lines[:50]):
        lines = [line.replace(",", ".") for line in lines]
        notes.append("Decimal commas were read as points.")
    row = _cells(lines[0], separator)[: len(headings)] if lines else []
    instants = {place: _instant(cell) for place, cell in enumerate(row)}
    clocks = {place: begin for place, begin in instants.items() if begin is not None}
    for place, begin in clocks.items():
        name = split_heading(headings[place])[0]
        headings[place] = heading(name, "s")
        since = begin.time().isoformat() if begin.date() == date.min else begin.isoformat(" ")
        notes.append(f"{name} was read as seconds since {since}.")
    rows = np.array(at, dtype=int)
    return Text(str(path), headings, tuple(notes), "", clocks, separator=separator, lines=lines, at=rows)


def _are_units(cells: list[str], columns: int) -> bool:
    """Whether a row under the header holds units: no number in it, and a known unit in half of its cells."""
    filled = [cell for cell in cells if cell]
    numbers = any(_number(cell) is not None and cell.lower() not in BLANK for cell in filled)
    if len(cells) != columns or not filled or numbers:
        return False
    return 2 * sum(map(_is_unit, filled)) >= len(filled)


def _is_unit(label: str) -> bool:
    return units.is_unit(label) or label in BLANK


def _with_unit(text: str, unit: str) -> str:
    """Return a heading with the unit from the row below, unless it has one already."""
    name, own = split_heading(text)
    return text if own or unit in BLANK else heading(name, unit)


def _headings(
    path: Path, columns: Sequence[str] | None, first: list[str], remark: str, separator: str | None
) -> list[str]:
    """Headings of the columns: those given, those of the file, or those in the comment just above."""
    if columns:
        if first[-1] == "" and len(columns) == len(first) - 1:  # lines that end with the separator
            columns = [*columns, ""]
        if len(columns) < len(first):  # what follows is left out
            columns = [*columns, *[""] * (len(first) - len(columns))]
        if len(columns) != len(first):
            raise DataError(
                f"{path}: the file has {len(first)} columns, but {len(columns)} names were given "
                f"({', '.join(columns)})."
            )
        return list(columns)
    if not _is_numeric(first):
        return first
    above = _cells(remark, separator)
    if len(above) == len(first) and not any(_number(cell) is not None for cell in above):
        return above
    shown = ", ".join(first[:8]) + (", …" if len(first) > 8 else "")
    raise DataError(
        f"{path}: the file has no header. Name its {len(first)} columns in order, with units "
        f"(columns = t, x_in [deg], …). The first row holds {shown}."
    )
