"""From a file to TOML tables: bytes, characters, and the line of a fault. It knows TOML and no diagrams."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from tsmblocks.common.errors import FileError, clip, near_file
from tsmblocks.files.positions import Places

MOST_BYTES = 20_000_000
"""Bytes of one file. Chosen: recordings that need more belong in data files, not in a diagram."""


def load_text(path: Path) -> str:
    """The text of a file; raises FileError where it cannot be read."""
    where = clip(str(path))
    try:
        if path.is_dir():
            raise FileError(where, [f"{where}: this is a folder, and a file is needed."])
        if not path.is_file():
            beside = [p.name for p in path.parent.glob("*.toml")]
            raise FileError(where, [f"{where}: there is no such file.{near_file(path.name, beside) if beside else ''}"])
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FileError(where, [f"{where}: cannot be read: {(error.strerror or str(error)).lower()}."]) from None
    return _decoded(data, str(path))


def _decoded(data: bytes, where: str) -> str:
    """Bytes as text; raises FileError with the line of the first byte that is not UTF-8."""
    refuse_large(len(data), where, where)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
        seems = "it seems to be UTF-16" if utf16 else f"byte 0x{data[error.start]:02x} is not allowed in it"
        raise FileError(where, [f"{where}:{line}: the text is not UTF-8 ({seems}). Save it as UTF-8."]) from None


def refuse_large(size: int, owner: str, where: str = "") -> None:
    """Raise FileError for a text that is too large to be a diagram."""
    if size > MOST_BYTES:
        most = f"a diagram file holds at most {MOST_BYTES // 10**6} MB. Recordings belong in data files."
        raise FileError(owner, [f"{where}: {most}" if where else most])


def parse_tables(text: str, where: str) -> tuple[dict[str, Any], Places]:
    """The tables of a TOML text, and the lines of their keys; raises FileError."""
    refuse_large(len(text), where, where)
    text = text.removeprefix("\ufeff").replace("\r\n", "\n")
    places = Places(text)
    try:
        if places.trouble is None:
            return tomllib.loads(text), places
        fault = "{}: {}".format(*places.trouble)
    except tomllib.TOMLDecodeError as error:
        fault = _in_line(str(error), text, places)
    except RecursionError:
        fault = " brackets are nested too deep."
    except ValueError:  # Python refuses whole numbers of more digits than these
        digits = re.search(r"[0-9_]{4300}", text)
        line = text.count("\n", 0, digits.start()) + 1 if digits else 1
        fault = f"{line}: a whole number has thousands of digits."
    raise FileError(where, [f"{where}:{fault}"])


def _in_line(message: str, text: str, places: Places) -> str:
    """``line: sentence`` for a message of tomllib."""
    found = re.fullmatch(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", message, re.DOTALL)
    if found is None:
        return f"1: this is not TOML: {clip(message)}."
    what, line, column = found[1], int(found[2] or text.count("\n") + 1), found[3]
    if re.search("overwrite|twice|Duplicate|already", what):
        again = [n for n in places.repeated if n <= line]
        if again:
            path, first = places.repeated[again[-1]]
            name = clip(".".join(map(str, path)))
            return f"{again[-1]}: '{name}' is given a second time; the first is in line {first}."
    if what.startswith("Illegal character '\\n'"):
        what = "a text is not closed; it needs a quotation mark at its end"
    shown = clip(text.split("\n")[line - 1].strip(), 60)
    here = f" (column {column}: {shown})" if column else " (at the end)"
    return f"{line}: this is not TOML: {what[:1].lower()}{clip(what[1:])}{here}."
