"""TOML files that name a diagram and metrics of its runs: what files of studies and of guards have in common.

Both have ``format``, ``title``, ``diagram`` (a ready-made one, or a file beside this one), numbers and texts that say
how it is run, ``[set]`` for numbers that all runs have, and ``[metrics]``. Nothing that a file says is ever run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tsmblocks.common.errors import FileError, TsmError, in_words, near
from tsmblocks.files import load_beside
from tsmblocks.files.toml_text import read, tables
from tsmblocks.metrics.metrics import metric, metrics
from tsmblocks.model.diagram import Diagram
from tsmblocks.studies.study import signal_units

FORMAT = 1


class Page:
    """One file that is being read, and the faults found so far; ``checked`` raises them all at once.

    ``kind`` is what messages call such a file ("study"), ``keys`` are those of the file itself. Raises FileError for
    what is no TOML.
    """

    def __init__(self, path: str | Path, kind: str, keys: Sequence[str]) -> None:
        self.where, self.kind, self.folder = str(path), kind, Path(path).parent
        self.table, self.places = tables(read(Path(path)), self.where)
        self.faults: list[tuple[int, str]] = []
        for key in self.table:
            if key not in keys:
                self.fault(f"there is no '{key}' in a {kind}.{near(key, keys, 12)}", key)
        if self.table.get("format") != FORMAT or isinstance(self.table["format"], bool):
            self.fault(f"format = {FORMAT} is needed, got {in_words(self.table.get('format'))}.", "format")

    def fault(self, text: str, *path: str) -> None:
        """Note what is wrong, and where it stands."""
        self.faults.append((self.places.line(*path) or 0, text))

    def checked(self) -> None:
        """Raise FileError with every fault and its line, where there are any."""
        if self.faults:
            raise FileError(
                self.where, [f"{self.where}{f':{line}' if line else ''}: {text}" for line, text in sorted(self.faults)]
            )

    def tried(self, make: Callable[[], Any], *path: str) -> Any:
        """What is made, or None where it is refused."""
        try:
            return make()
        except FileError as error:
            for problem in error.problems:
                self.fault(problem, *path)
        except TsmError as error:
            self.fault(str(error), *path)
        return None

    # ---- values

    def of(self, what: str, kind: type, value: Any, *path: str) -> Any:
        """A value of a kind (a whole number is a float too), or None where it is something else."""
        if kind is float and isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
        if kind is not float and isinstance(value, kind) and not isinstance(value, bool):
            return value
        self.fault(f"'{'.'.join(path)}' must be {what}, got {in_words(value)}.", *path)
        return None

    def section(self, key: str) -> dict[str, Any]:
        """A table of the file; empty where there is none."""
        return self.of(f"a table: [{key}]", dict, self.table.get(key, {}), key) or {}

    def how(self, numbers: Sequence[str], texts: Sequence[str]) -> dict[str, Any]:
        """Those of these keys that the file has."""
        return {k: self.of("a number", float, self.table[k], k) for k in numbers if k in self.table} | {
            k: self.of("a text", str, self.table[k], k) for k in texts if k in self.table
        }

    @property
    def title(self) -> str:
        """The title, empty where there is none."""
        return self.of("a text", str, self.table.get("title", ""), "title") or ""

    def diagram(self) -> Diagram | None:
        """The diagram with the numbers of ``[set]``; None where it cannot be had."""
        if "diagram" not in self.table:
            self.fault(f'a {self.kind} needs its diagram: diagram = "fig16_feedforward_feedback".')
            return None
        name = self.of("the name or file of a diagram", str, self.table["diagram"], "diagram")
        if name is None:
            return None
        found = self.tried(partial(load_beside, self.folder, name), "diagram")
        for key, value in self.section("set").items() if found is not None else ():
            found = self.tried(partial(found.with_parameters, {key: value}), "set", key) or found
        return found

    def metrics(self, asked: Mapping[str, Any] | None, diagram: Diagram) -> None:
        """Look at every metric, or at the usual ones for None."""
        known = signal_units(diagram)
        if asked is None:
            self.tried(lambda: metrics(None, known), "diagram")
            return
        for name, text in asked.items():
            self.tried(partial(metric, text, known, name), "metrics", name)
