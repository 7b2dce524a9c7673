"""From TOML tables to a diagram, with every fault of a file collected and placed.

A block that cannot be read is replaced by one with any port, so that the wires to it are not reported as well. A file
is never executed; ``block_reader`` reads single blocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import date, time
from itertools import count, repeat
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
from tsmblocks.files.simulation_reader import SIMULATION_KEYS, read_simulation
from tsmblocks.files.toml_text import parse_tables
from tsmblocks.model.block import Block, Input, is_reference, leaves
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.validation import examine
from tsmblocks.model.wires import PlacedText

FORMAT = 1
"""Version of the format that is read and written."""
INLET_KEYS, OUTLET_KEYS = ("ports", "unit", "about"), ("signal", "unit")
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
        reading.add(f"{where}: tables are nested too deep.")
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
        rest = {k: v for k, v in table.items() if k not in ("format", *SIMULATION_KEYS)}
        if "blocks" not in rest and "blocks" not in misspelt_keys(rest, DIAGRAM_KEYS).values():
            self.fault((), "there are no [blocks].")
        part = self.diagram(self._clean(rest, ()), (), level)
        known = {k: self._clean(table[k], (k,)) for k in SIMULATION_KEYS if k in table}
        if known and isinstance(part.block, Diagram):
            simulation = read_simulation(self, known, part.block)
            return Part(part.block.with_simulation(simulation), part.size)
        return part

    def _clean(self, value: Any, path: tuple[str | int, ...]) -> Any:
        """TOML values without those that no diagram can hold, which are reported."""
        if isinstance(value, dict):
            return {k: self._clean(v, (*path, k)) for k, v in value.items()}
        if isinstance(value, list):
            items = [self._clean(v, path) for v in value]
            return REFUSED if any(v is REFUSED for v in items) else items
        if wrong := _refusal(value):
            self.fault(path, f"{dotted_name(path)} is {wrong}.")
        return REFUSED if wrong else value

    # ---- one diagram

    def diagram(self, table: dict[str, Any], path: KeyPath, level: int) -> Part:
        """Read a table with wires, blocks, inputs, outputs and values.

        Where a part could not be read, the rest is still checked, without the faults that could follow from it.
        """
        read = _Sections(self, table, path, level)
        blocks, size = read.blocks()
        parts: dict[str, Any] = dict(blocks=blocks, wires=read.wires(), inputs=read.inputs())
        parts["outputs"], parts["output_units"] = read.outputs()
        parts["values"] = read.values()
        words: dict[str, Any] = {key: self.text(table, key, path) for key in ("title", "source")}
        incomplete, unsure = read.incomplete, read.unsure
        if "blocks" in incomplete:
            return Part(None, 0)
        if "values" in incomplete:
            unsure += _references(blocks)
        if incomplete or unsure:
            silent = bool(incomplete & {"wires", "inputs"})
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


class _Sections:
    """The sections of one diagram's table.

    ``incomplete`` names those with entries missing, or that are missing and may be there under another spelling;
    ``unsure`` blocks without known ports and values without a number.
    """

    def __init__(self, page: DiagramPage, table: dict[str, Any], path: KeyPath, level: int) -> None:
        self.page, self.table, self.path, self.level = page, table, path, level
        self.incomplete = page.known_keys(table, DIAGRAM_KEYS, path, "a diagram")
        self.unsure: list[str] = []

    def _wrong(self, section: str, at: KeyPath, expected: str, value: Any) -> None:
        """Collect a fault of the type of a value that is missing in its section."""
        self.page.wrong(at, expected, value)
        self.incomplete.add(section)

    def _entries(self, section: str) -> Iterator[tuple[str, Any, KeyPath]]:
        """Name (with its place), value and path of each entry."""
        if not isinstance(self.table.get(section, {}), dict):
            self.incomplete.add(section)
        for name, value in self.page.table(self.table, section, self.path).items():
            at = (*self.path, section, name)
            yield PlacedText.at(name, self.page.place(*at)), value, at

    def blocks(self) -> tuple[dict[str, Any], int]:
        """The blocks, and how many they are with those inside."""
        blocks: dict[str, Any] = {}
        size = 0
        for name, spec, at in self._entries("blocks"):
            part = read_block(self.page, name, spec, at, self.level)
            if size + part.size > MOST_BLOCKS:
                many = f"up to block '{clip(name)}' there are {size + part.size:,} blocks"
                most = f"with those of the diagrams in use; at most {MOST_BLOCKS:,} are read."
                self.page.fault(at, f"{many}, {most}")
                self.incomplete.add("blocks")
                break
            size += part.size
            blocks[name] = part.block
            if part.block is None:
                blocks[name] = UnreadableBlock()
                self.unsure.append(name)
        return blocks, size

    def wires(self) -> list[str]:
        """The wires."""
        given, at = self.table.get("wires", []), (*self.path, "wires")
        if not isinstance(given, list):
            self._wrong("wires", at, 'wires must be a list such as ["error -> pid -> drive"]', given)
            return []
        texts: list[str] = []
        for k, value in enumerate(given):
            if isinstance(value, str):
                texts.append(PlacedText.at(value, self.page.place(*at, k)))
            else:
                self._wrong("wires", at, "a wire must be text such as 'error -> pid'", value)
        links = sum(text.count("->") + text.count(",") for text in texts)
        if links > MOST_LINKS:
            self.page.fault(at, f"the wires hold {links:,} connections; at most {MOST_LINKS:,} are read.")
            self.incomplete.add("wires")
            return []
        return texts

    def inputs(self) -> dict[str, Inlet]:
        """The inputs."""
        inputs = {}
        for name, spec, at in self._entries("inputs"):
            inner = spec if isinstance(spec, dict) else {"ports": spec}
            misspelt = self.page.known_keys(inner, INLET_KEYS, at, f"input '{clip(name)}'")
            if "ports" not in inner and "ports" not in misspelt:
                self.page.fault(at, f"input '{clip(name)}' needs ports, for example ports = \"motor.u\".")
            ports = inner.get("ports", REFUSED)
            ports = [ports] if isinstance(ports, str) else ports
            if not isinstance(ports, list) or not all(isinstance(port, str) for port in ports):
                self._wrong("inputs", at, f"input '{clip(name)}' must name a port, or list several", ports)
                ports = []
            inner_at = (*at, "ports") if isinstance(spec, dict) else at
            inputs[name] = Inlet(
                ports=[PlacedText.at(port, self.page.place(*inner_at, k)) for k, port in enumerate(ports)],
                unit=self.page.text(inner, "unit", at),
                about=self.page.text(inner, "about", at),
            )
        return inputs

    def outputs(self) -> tuple[dict[str, str], dict[str, str]]:
        """The outputs, and the units of those that declare one."""
        outputs, units = dict[str, str](), dict[str, str]()
        for name, spec, at in self._entries("outputs"):
            value = spec
            if isinstance(spec, dict):
                self.page.known_keys(spec, OUTLET_KEYS, at, f"output '{clip(name)}'")
                value, unit = spec.get("signal"), self.page.text(spec, "unit", at)
                units |= {str(name): unit} if unit else {}
            if isinstance(value, str):
                outputs[name] = PlacedText.at(value, self.page.place(*at, *(["signal"] if value is not spec else [])))
            else:
                expected = f"output '{clip(name)}' must name one signal, such as \"motor.y\""
                self._wrong("outputs", at, expected, value)
        return outputs, {k: unit for k, unit in units.items() if k in outputs}

    def values(self) -> dict[str, float]:
        """The shared numbers."""
        values = {}
        for name, value, at in self._entries("values"):
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                values[name] = float(value)
            else:
                self.page.wrong(at, f"value '{clip(name)}' must be a number", value)
                self.unsure.append(name)
        return values


class _AnyPort:
    """Ports of every name, and a default port.

    The default output has an empty name, so that it is shown as the block; the default input is another one each time,
    so that it never has two drivers.
    """

    def __init__(self, default_names: Iterator[str]) -> None:
        self._default_names = default_names

    def __contains__(self, name: object) -> bool:
        return name != ""

    def items(self) -> list[tuple[str, Input]]:
        """The default port."""
        return [(next(self._default_names), Input("a port of a block that could not be read"))]


class UnreadableBlock:
    """Replaces a block that could not be read: it has every port."""

    inports, outports = _AnyPort(f"?{k}" for k in count()), _AnyPort(repeat(""))


def _refusal(value: Any) -> str:
    """The fault of a single TOML value, ``""`` if a diagram can hold it."""
    if isinstance(value, float) and math.isnan(value):
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
