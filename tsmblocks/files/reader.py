"""From TOML tables to a diagram, with every fault of a file collected and placed.

A block that cannot be read is replaced by one with any port, so that the wires to it are not reported as well. A file
is never executed; ``block_reader`` reads single blocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import date, time
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from tsmblocks.common.errors import DiagramError, FileError, TsmError, clip, in_words
from tsmblocks.files.block_reader import read_block
from tsmblocks.files.faults import (
    DIAGRAM_KEYS,
    REFUSED,
    UNEXPECTED_ERRORS,
    KeyPath,
    Page,
    Part,
    Reading,
    TooManyFaults,
    dotted_name,
    misspelt_keys,
    plain_value,
)
from tsmblocks.files.toml_text import parse_tables
from tsmblocks.model.block import Block, Input, is_reference, leaves
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.validation import examine
from tsmblocks.model.wires import PlacedText

FORMAT = 1
"""Version of the format that is read and written."""
INLET_KEYS = ("ports", "unit", "about")
"""Keys of an input that is a table."""
MOST_BLOCKS = 100_000
"""Blocks of one diagram, with those of the diagrams it uses. Chosen: far above any diagram drawn by hand."""
MOST_LINKS = 100_000
"""Connections of one diagram. Chosen: as ``MOST_BLOCKS``."""

T = TypeVar("T")


def diagram_from(text: str, where: str, folder: Path | None = None, own: Path | None = None) -> Diagram:
    """The diagram that a text describes.

    ``where`` is the name of the text in messages, ``folder`` that of the diagrams it uses, ``own`` its file. Raises
    FileError, or DiagramError when all faults are of the wiring.
    """
    reading, part, title = Reading(), Part(None, 0), ""
    reading.open += [own] if own else []
    try:
        table, places = parse_tables(text, where)
        title = table["title"] if isinstance(table.get("title"), str) else ""
        part = DiagramPage(reading, where, places, folder).whole(table, 1)
    except TooManyFaults:
        pass
    except RecursionError:
        reading.add(f"{where}: tables stand inside each other too deep.")
    if reading.problems and reading.only_wiring:
        raise DiagramError(clip(title) or Path(where).stem, reading.in_order(), where)
    if reading.problems or not isinstance(part.block, Diagram):
        raise FileError(where, reading.in_order())
    return part.block


class DiagramPage(Page):
    """One text that is being read as a diagram."""

    # ---- the whole file

    def whole(self, table: dict[str, Any], level: int) -> Part:
        """Read the outermost table of a file."""
        if not table:
            self.fault((), "the file is empty. A diagram begins with format = 1 and has [blocks].")
            return Part(None, 0)
        given = table.get("format")
        if type(given) is not int or given != FORMAT:
            shown = str(given) if isinstance(given, float) else in_words(plain_value(given))  # 1.0 is not 1
            found = f"the format is {shown}" if "format" in table else "there is no format"
            self.fault(("format",), f"{found}; this version reads format = {FORMAT}, at the top of the file.")
            return Part(None, 0)
        rest = {k: v for k, v in table.items() if k != "format"}
        if "blocks" not in rest and "blocks" not in misspelt_keys(rest, DIAGRAM_KEYS).values():
            self.fault((), "there are no [blocks].")
        return self.diagram(self._clean(rest, ()), (), level)

    def _clean(self, value: Any, path: tuple[str | int, ...]) -> Any:
        """TOML values without those that no diagram can hold, which are reported."""
        if type(value) is float and not math.isnan(value):
            return value
        if isinstance(value, dict):
            return {k: self._clean(v, (*path, k)) for k, v in value.items()}
        if isinstance(value, list):
            items = [self._clean(v, path) for v in value]
            return REFUSED if any(v is REFUSED for v in items) else items
        wrong = _refusal(value)
        if not wrong:
            return value
        self.fault(path, f"{dotted_name(path)} is {wrong}.")
        return REFUSED

    # ---- one diagram

    def diagram(self, table: dict[str, Any], path: KeyPath, level: int) -> Part:
        """Read a table with wires, blocks, inputs, outputs and values.

        Where a part could not be read, the rest is still checked, without the faults that could follow from it:
        ``misspelt`` are the sections that are missing and may be there under another spelling, ``sure_…`` is False
        where entries are missing, ``unsure`` names blocks without known ports and values without a number.
        """
        misspelt = self.known_keys(table, DIAGRAM_KEYS, path, "a diagram")
        blocks, size, sure_blocks = self._blocks(table, path, level)
        wires, sure_wires = self._wires(table, path)
        inputs, sure_inputs = self._inputs(table, path)
        outputs, sure_outputs = self._outputs(table, path)
        values, unsure = self._values(table, path)
        words: dict[str, Any] = {key: self.text(table, key, path) for key in ("title", "source")}
        if not sure_blocks or "blocks" in misspelt:
            return Part(None, 0)
        unsure += [k for k, v in blocks.items() if isinstance(v, UnreadableBlock)]
        unsure += _references(blocks) if "values" in misspelt else []
        silent = not (sure_wires and sure_inputs) or bool({"wires", "inputs"} & misspelt)
        parts: dict[str, Any] = dict(blocks=blocks, wires=wires, inputs=inputs, outputs=outputs, values=values)
        if silent or unsure or misspelt or not sure_outputs:
            found = self._faults_collected(path, lambda: examine(**parts, unsure=unsure, silent=silent))
            self._wiring_faults(path, [] if found is None else found.faults)
            return Part(None, size)
        return Part(self._faults_collected(path, lambda: Diagram(**words, **parts, where=self.where)), size)

    def _faults_collected(self, path: KeyPath, make: Callable[[], T]) -> T | None:
        """The result of ``make``, which takes sound parts; None with its faults collected."""
        try:
            return make()
        except DiagramError as error:
            self._wiring_faults(path, error.problems)
        except (TsmError, *UNEXPECTED_ERRORS) as error:
            self.fault(path, f"the blocks cannot be put together: {clip(str(error), 300)}")
        return None

    def _wiring_faults(self, path: KeyPath, faults: Iterable[str]) -> None:
        """Collect faults of the wiring."""
        for fault in faults:
            placed = fault.startswith(f"{self.where}:")
            self.reading.add(fault if placed else f"{self.place(*path)}: {fault}", wiring=True)

    def _blocks(self, table: dict[str, Any], path: KeyPath, level: int) -> tuple[dict[str, Any], int, bool]:
        """Read the blocks; the flag is False where the table itself is faulty."""
        blocks: dict[str, Any] = {}
        size = 0
        for name, spec in self.table(table, "blocks", path).items():
            part = read_block(self, name, spec, (*path, "blocks", name), level)
            if size + part.size > MOST_BLOCKS:
                many = f"up to block '{clip(name)}' there are {size + part.size:,} blocks"
                most = f"with those of the diagrams in use; at most {MOST_BLOCKS:,} are read."
                self.fault((*path, "blocks", name), f"{many}, {most}")
                return blocks, size, False
            size += part.size
            blocks[self._name(name, path, "blocks")] = UnreadableBlock() if part.block is None else part.block
        return blocks, size, isinstance(table.get("blocks", {}), dict)

    def _wires(self, table: dict[str, Any], path: KeyPath) -> tuple[list[str], bool]:
        """Read the wires; the flag is False where some are missing."""
        given = table.get("wires", [])
        if not isinstance(given, list):
            self.wrong((*path, "wires"), 'wires must be a list such as ["error -> pid -> drive"]', given)
            return [], False
        texts = [PlacedText.at(v, self.place(*path, "wires", k)) for k, v in enumerate(given) if isinstance(v, str)]
        for value in given:
            if not isinstance(value, str):
                self.wrong((*path, "wires"), "a wire must be text such as 'error -> pid'", value)
        links = sum(text.count("->") + text.count(",") for text in texts)
        if links > MOST_LINKS:
            self.fault((*path, "wires"), f"the wires hold {links:,} connections; at most {MOST_LINKS:,} are read.")
            return [], False
        return list(texts), len(texts) == len(given)

    def _inputs(self, table: dict[str, Any], path: KeyPath) -> tuple[dict[str, Inlet], bool]:
        """Read the inputs; the flag is False where some are missing."""
        inputs, sure = {}, isinstance(table.get("inputs", {}), dict)
        for name, spec in self.table(table, "inputs", path).items():
            at = (*path, "inputs", name)
            inner = spec if isinstance(spec, dict) else {"ports": spec}
            misspelt = self.known_keys(inner, INLET_KEYS, at, f"input '{clip(name)}'")
            if "ports" not in inner and "ports" not in misspelt:
                self.fault(at, f"input '{clip(name)}' needs ports, for example ports = \"motor.u\".")
            ports = inner.get("ports", REFUSED)
            ports = [ports] if isinstance(ports, str) else ports
            if not isinstance(ports, list) or not all(isinstance(port, str) for port in ports):
                self.wrong(at, f"input '{clip(name)}' must name a port, or list several", ports)
                sure, ports = False, []
            inner_at = (*at, "ports") if isinstance(spec, dict) else at
            inputs[self._name(name, path, "inputs")] = Inlet(
                ports=[PlacedText.at(port, self.place(*inner_at, k)) for k, port in enumerate(ports)],
                unit=self.text(inner, "unit", at),
                about=self.text(inner, "about", at),
            )
        return inputs, sure

    def _outputs(self, table: dict[str, Any], path: KeyPath) -> tuple[dict[str, str], bool]:
        """Read the outputs; the flag is False where some are missing."""
        outputs: dict[str, str] = {}
        sure = isinstance(table.get("outputs", {}), dict)
        for name, value in self.table(table, "outputs", path).items():
            at = (*path, "outputs", name)
            if isinstance(value, str):
                outputs[self._name(name, path, "outputs")] = PlacedText.at(value, self.place(*at))
            else:
                self.wrong(at, f"output '{clip(name)}' must name one signal, such as \"motor.y\"", value)
                sure = False
        return outputs, sure

    def _values(self, table: dict[str, Any], path: KeyPath) -> tuple[dict[str, float], list[str]]:
        """Read the shared numbers; the list names those that are no numbers."""
        values, unsure = {}, []
        for name, value in self.table(table, "values", path).items():
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                values[self._name(name, path, "values")] = float(value)
            else:
                self.wrong((*path, "values", name), f"value '{clip(name)}' must be a number", value)
                unsure.append(name)
        return values, unsure

    # ---- pieces

    def _name(self, name: str, path: KeyPath, section: str) -> str:
        """A name with its place."""
        return PlacedText.at(name, self.place(*path, section, name))


# ---- replacements and texts ----------------------------------------------------------------------


class UnreadableBlock:
    """Replaces a block that could not be read: it has every port."""

    def __init__(self) -> None:
        self.inports = self.outports = _AnyPort()


class _AnyPort(Mapping[str, Any]):
    """A mapping with every port; the default port is another one each time, so it never has two drivers."""

    _fresh = count()

    def __contains__(self, name: object) -> bool:
        return True

    def __getitem__(self, name: str) -> Input:
        return Input("a port of a block that could not be read")

    def __iter__(self) -> Iterator[str]:
        return iter([f"?{next(self._fresh)}"])

    def __len__(self) -> int:
        return 1


def _refusal(value: Any) -> str:
    """What is wrong with a single TOML value, ``""`` if a diagram can hold it."""
    if isinstance(value, float):
        return "nan, which is not a number"
    if isinstance(value, int) and abs(value) > 2**53:
        return "a whole number too large to be held exactly; write it with a point or an exponent"
    if isinstance(value, (date, time)):
        return f"a date or time ({value}), and a number or text is needed"
    return ""


def _references(blocks: Mapping[str, Any]) -> list[str]:
    """The entries of ``values`` that blocks refer to."""
    parameters = [v for b in blocks.values() if isinstance(b, Block) for v in b.parameters.values()]
    return [leaf[1:] for value in parameters for _, leaf in leaves(value) if is_reference(leaf)]
