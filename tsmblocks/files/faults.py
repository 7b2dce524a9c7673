"""The faults of a file, collected while it is read, each with its line; shared by all readers of TOML tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from tsmblocks.common.errors import clip, in_words, near
from tsmblocks.files.positions import Places
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

DIAGRAM_KEYS = ("title", "source", "wires", "blocks", "inputs", "outputs", "values")
"""Keys of a diagram's table."""
MOST_FAULTS = 200
"""Faults after which the rest of a file is not read. Chosen: more than a person corrects at once."""
REFUSED: Any = type("Refused", (), {"__repr__": lambda _: "REFUSED"})()
"""Replaces a value whose fault has been reported, so that no other fault of it is."""
UNEXPECTED_ERRORS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""Errors that a block's own check may raise on values that its author did not foresee."""

KeyPath = tuple[str, ...]


class Part(NamedTuple):
    """A block or diagram that was read (None if it is faulty), and its number of blocks."""

    block: Block | Diagram | None
    size: int


class TooManyFaults(Exception):
    """So many faults that the rest of the file is not read."""


class Reading:
    """The state of one ``load``: faults so far, files being read, and files read already."""

    def __init__(self) -> None:
        self.problems: list[str] = []
        self.only_wiring = True  # whether all faults are of those that Diagram itself finds
        self.open: list[Path] = []
        self.done: dict[Path, Part] = {}

    def add(self, problem: str, *, wiring: bool = False) -> None:
        """Collect a fault, each once; raises TooManyFaults when there are many."""
        if problem not in self.problems:
            self.problems.append(problem)
        self.only_wiring = self.only_wiring and wiring
        if len(self.problems) >= MOST_FAULTS:
            raise TooManyFaults

    def in_order(self) -> list[str]:
        """The faults file by file and line by line; those without a line come last.

        The place is read back from the text, since faults of the wiring come as texts from ``Diagram``.
        """
        files: dict[str, int] = {}

        def place(problem: str) -> tuple[int, float]:
            found = re.match(r"(.*?):(\d+): ", problem, re.DOTALL)
            name = found[1] if found else ""
            return files.setdefault(name, len(files)) if found else 10**9, int(found[2]) if found else 0

        return sorted(self.problems, key=place)


class Page:
    """One text that is being read: its name, the lines of its keys, and its folder."""

    def __init__(self, reading: Reading, where: str, places: Places, folder: Path | None) -> None:
        self.reading, self.where, self.places, self.folder = reading, where, places, folder

    # ---- places and faults

    def place(self, *path: str | int) -> str:
        """``file:line`` of a key."""
        line = self.places.line(*path)
        return f"{self.where}:{line}" if line else self.where

    def fault(self, path: tuple[str | int, ...], text: str) -> None:
        """Collect a fault of the value at ``path``."""
        self.reading.add(f"{self.place(*path)}: {text}")

    def block_fault(self, path: KeyPath, text: str, *key: str) -> None:
        """Collect a fault of a block, at a key of its table where that is given."""
        self.fault((*path, *key), f"block '{dotted_name(path)}': {text}")

    def wrong(self, at: tuple[str | int, ...], expected: str, value: Any, hint: str = "") -> None:
        """Collect a fault of the type of a value, unless the value has been refused already."""
        if value is REFUSED:
            self.reading.only_wiring = False
        else:
            self.fault(at, f"{expected}, got {in_words(plain_value(value))}.{hint}")

    def known_keys(self, table: Mapping[str, Any], known: tuple[str, ...], path: KeyPath, owner: str) -> set[str]:
        """Report unknown keys; returns the absent keys that they may be misspellings of."""
        for key in table:
            if key not in known:
                self.fault((*path, key), f"'{clip(key)}' is not a key of {owner}.{near(key, known)}")
        return set(misspelt_keys(table, known).values()) - set(table)

    def table(self, table: dict[str, Any], key: str, path: KeyPath) -> dict[str, Any]:
        """The table under ``key``; an empty one where it is absent or something else, which is reported."""
        value = table.get(key, {})
        if isinstance(value, dict):
            return value
        self.wrong((*path, key), f"{key} must be a table, written [{'.'.join((*path, key))}]", value)
        return {}

    def text(self, table: Mapping[str, Any], key: str, path: KeyPath) -> str:
        """The text under ``key``, ``""`` where it is absent or something else, which is reported."""
        value = table.get(key, "")
        if isinstance(value, str):
            return value
        self.wrong((*path, key), f"{key} must be text", value)
        return ""


# ---- texts --------------------------------------------------------------------------------------


def dotted_name(path: tuple[str | int, ...]) -> str:
    """A path as a dotted name: ``blocks.motor.blocks.drive.high`` is ``motor.drive.high``."""
    said: list[str] = []
    while len(path) > 1 and path[0] == "blocks":
        said.append(str(path[1]))
        path = path[2:]
    return clip(".".join([*said, *map(str, path)]))


def plain_value(value: Any) -> Any:
    """A value that a message may print: a whole number of a million digits is replaced."""
    if isinstance(value, dict):
        return dict.fromkeys(list(value)[:3], "…")
    if isinstance(value, list):
        return [plain_value(v) for v in value[:10]]
    return "a huge number" if isinstance(value, int) and abs(value) > 2**53 else value


def misspelt_keys(given: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """The keys that look like a misspelt known one, with that one."""
    strange = [key for key in given if key not in known and len(key) < 50][:100]
    close = {key: get_close_matches(key, known, n=1) for key in strange}
    return {key: match[0] for key, match in close.items() if match}
