"""TOML files that name a diagram and metrics of its runs: shared by files of studies and of guards.

Both have ``format``, ``title``, ``diagram`` (a ready-made one, or a file beside this one), numbers and texts that say
how it is run, ``[set]`` for parameters that all runs have, and ``[metrics]``. No text of a file is ever executed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tsmblocks.common.arguments import is_number
from tsmblocks.common.errors import FileError, TsmError, in_words
from tsmblocks.files import load_beside
from tsmblocks.files.faults import Page, Reading, TooManyFaults
from tsmblocks.files.toml_text import load_text, parse_tables
from tsmblocks.metrics.metrics import metric, metrics
from tsmblocks.model.diagram import Diagram
from tsmblocks.studies.study import signal_units

FORMAT = 1
"""Version of the file format, which a file states as ``format = 1``."""


class RunPage(Page):
    """One file of a study or a guard that is being read; ``raise_faults`` raises all of its faults at once.

    ``kind`` is what messages call such a file ("study"), ``keys`` are those of the file itself. Raises FileError for
    what is no TOML.
    """

    def __init__(self, path: str | Path, kind: str, keys: tuple[str, ...]) -> None:
        content, places = parse_tables(load_text(Path(path)), str(path))
        super().__init__(Reading(), str(path), places, Path(path).parent)
        self.kind, self.content = kind, content
        self.known_keys(content, keys, (), f"a {kind}")
        if content.get("format") != FORMAT or isinstance(content["format"], bool):
            self.fault(("format",), f"format = {FORMAT} is needed, got {in_words(content.get('format'))}.")

    def fault(self, path: tuple[str | int, ...], text: str) -> None:
        """Collect a fault of the value at ``path``; raises FileError when there are too many."""
        try:
            super().fault(path, text)
        except TooManyFaults:
            self.raise_faults()

    def raise_faults(self) -> None:
        """Raise FileError with every fault and its line, where there are any."""
        if self.reading.problems:
            raise FileError(self.where, self.reading.in_order())

    def attempt(self, make: Callable[[], Any], *path: str) -> Any:
        """Return what is made, or None where it is refused; the refusal is collected as a fault."""
        try:
            return make()
        except FileError as error:
            for problem in error.problems:
                self.fault(path, problem)
        except TsmError as error:
            self.fault(path, str(error))
        return None

    # ---- values

    def value(self, what: str, kind: type, value: Any, *path: str) -> Any:
        """Return a value of a kind (a whole number is a float too), or None where it is something else."""
        if kind is float and is_number(value):
            return float(value)
        if kind is not float and isinstance(value, kind):
            return value
        self.wrong(path, f"'{'.'.join(path)}' must be {what}", value)
        return None

    def section(self, key: str) -> dict[str, Any]:
        """Return a table of the file; an empty one where there is none."""
        return self.table(self.content, key, ())

    def run_arguments(self, numbers: Sequence[str], texts: Sequence[str]) -> dict[str, Any]:
        """Return those of these arguments of a run that the file has."""
        return {k: self.value("a number", float, self.content[k], k) for k in numbers if k in self.content} | {
            k: self.text(self.content, k, ()) for k in texts if k in self.content
        }

    def named_diagram(self) -> Diagram | None:
        """Return the diagram with the parameters of ``[set]``; None where it cannot be loaded."""
        if "diagram" not in self.content:
            self.fault((), f'a {self.kind} needs its diagram: diagram = "fig16_feedforward_feedback".')
            return None
        name = self.value("the name or file of a diagram", str, self.content["diagram"], "diagram")
        if name is None:
            return None
        loaded = self.attempt(partial(load_beside, self.folder or Path(), name), "diagram")
        for key, value in self.section("set").items() if loaded is not None else ():
            loaded = self.attempt(partial(loaded.with_parameters, {key: value}), "set", key) or loaded
        return loaded

    def check_metrics(self, given: Mapping[str, Any] | None, diagram: Diagram) -> None:
        """Collect the faults of every metric, or of the usual ones for None."""
        known = signal_units(diagram)
        if given is None:
            self.attempt(partial(metrics, None, known), "diagram")
        for name, text in (given or {}).items():
            self.attempt(partial(metric, text, known, name), "metrics", name)
