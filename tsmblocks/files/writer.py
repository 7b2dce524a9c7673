"""From a diagram to the text of a file, in the layout of one written by hand.

A block is written on one line where it fits, each wire on its own, and defaults are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import tomli_w

from tsmblocks.common.errors import FileError, clip, in_words
from tsmblocks.files.reader import FORMAT
from tsmblocks.files.toml_text import refuse_large
from tsmblocks.model.block import REGISTRY, Block
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.model.simulation import Simulation

LINE_WIDTH = 100
"""Characters of a line. Chosen: the width of an editor beside a second window."""


BARE_KEY = re.compile("[A-Za-z0-9_-]+")
"""Keys that TOML takes without quotes."""


class _Unwritable(Exception):
    """A sentence about a value that a file cannot hold."""


def text_of(diagram: Diagram) -> str:
    """The text of a diagram file; raises FileError with everything that a file cannot hold."""
    writer = _Writer()
    lines = [f"format = {FORMAT}", *writer.body(diagram, ""), *_simulation(diagram.simulation)]
    title = (
        clip(str(diagram.title)).encode(errors="backslashreplace").decode()
    )  # an incomplete character cannot be shown
    owner = f"diagram '{title}'"
    if writer.problems:
        raise FileError(owner, writer.problems)
    text = "\n".join(lines) + "\n"
    refuse_large(len(text), owner)
    return text


Entry = tuple[str, list[tuple[str, str]]]
"""A name with the keys and values of its table; a value without a table has the single key ``""``."""


class _Writer:
    """Writes the lines of a diagram, and collects faults."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def body(self, diagram: Diagram, prefix: str) -> Iterator[str]:
        """Yield the lines of a diagram whose sections begin with ``prefix``."""
        for key in ("title", "source"):
            if getattr(diagram, key) != "":
                yield f"{key} = {self.value(getattr(diagram, key), key, str)}"
        if not prefix:
            yield ""
        wires = [line for wire in diagram.wires for line in split_wire(wire)]
        yield from ["wires = [", *(f"  {toml(line)}," for line in wires), "]"] if wires else ["wires = []"]
        yield from _section(
            f"{prefix}values", [(k, [("", self.value(v, k, float))]) for k, v in diagram.values.items()]
        )
        yield from self._blocks(diagram, prefix)
        yield from _section(f"{prefix}inputs", [(k, self._inlet(k, v)) for k, v in diagram.inputs.items()])
        yield from _section(f"{prefix}outputs", [(k, self._outlet(k, v, diagram)) for k, v in diagram.outputs.items()])

    def _blocks(self, diagram: Diagram, prefix: str) -> Iterator[str]:
        plain = [(k, self._block(f"{prefix}{k}", b)) for k, b in diagram.blocks.items() if isinstance(b, Block)]
        inner = {k: b for k, b in diagram.blocks.items() if isinstance(b, Diagram)}
        yield from _section(f"{prefix}blocks", plain, always=not inner)
        for name, block in inner.items():
            yield from ["", f"[{prefix}blocks.{name}]", *self.body(block, f"{prefix}blocks.{name}.")]

    def _block(self, name: str, block: Block) -> list[tuple[str, str]]:
        kind, said = type(block), name.replace("blocks.", "")
        known = REGISTRY.get(kind.__name__)
        if known is None or (known.__module__, known.__qualname__) != (kind.__module__, kind.__qualname__):
            self.problems.append(f"block '{said}': {kind.__name__} is not registered, so no file can name it.")
        if "type" in kind.fields():
            self.problems.append(f"block '{said}': its parameter 'type' cannot be distinguished from the block's type.")
        pairs = [("type", toml(kind.__name__))]
        for key, field in kind.fields().items():
            given = getattr(block, key)
            if repr(given) != repr(field.default_in_files):  # unlike ==, this distinguishes -0.0 from 0.0
                pairs.append((key, self.value(given, f"{said}.{key}")))
        return pairs

    def _inlet(self, name: str, inlet: Inlet) -> list[tuple[str, str]]:
        ports = toml(inlet.ports[0] if len(inlet.ports) == 1 else inlet.ports)
        words = {key: getattr(inlet, key) for key in ("unit", "about") if getattr(inlet, key) != ""}
        if not words:
            return [("", ports)]
        return [("ports", ports), *((k, self.value(v, f"{name}.{k}", str)) for k, v in words.items())]

    def _outlet(self, name: str, signal: str, diagram: Diagram) -> list[tuple[str, str]]:
        unit = diagram.output_units.get(name, "")
        return (
            [("signal", toml(signal)), ("unit", self.value(unit, f"{name}.unit", str))]
            if unit
            else [("", toml(signal))]
        )

    def value(self, value: Any, name: str, kind: type = object) -> str:
        """A value as TOML; one that cannot be written becomes a problem."""
        try:
            if not isinstance(value, kind):
                raise _Unwritable(f"is {in_words(value)}")
            return toml(value)
        except _Unwritable as fault:
            self.problems.append(f"{name} {fault}, which a file cannot hold.")
            return '""'


def _simulation(one: Simulation) -> Iterator[str]:
    """Yield the sections that say how a diagram was simulated on recordings."""
    given = {"step": one.step, "method": one.method, "hold": one.hold, "condition": one.condition}
    given["stop_when"] = one.stop_when
    given = {key: value for key, value in given.items() if value not in (None, "", ())}
    if given:
        yield from ["", "[simulation]", *(f"{key} = {_inline(value)}" for key, value in given.items())]
    for name, states in one.start.items():
        yield from ["", f"[start.{_key(name)}]", *(f"{_key(k)} = {toml(float(v))}" for k, v in states.items())]


def _inline(value: Any) -> str:
    """A value as TOML; a mapping as an inline table."""
    if not isinstance(value, Mapping):
        return toml(value)
    return f"{{ {', '.join(f'{_key(k)} = {toml(v)}' for k, v in value.items())} }}"


def _key(name: str) -> str:
    """A key as TOML: quoted, unless it is of letters, digits, dashes and underscores alone."""
    return name if BARE_KEY.fullmatch(name) else toml(name)


# ---- layout -----------------------------------------------------------------------------------


def _section(header: str, entries: list[Entry], always: bool = False) -> Iterator[str]:
    """Yield a section: tables that fit on one line are written so, the others as separate sections."""
    inside: list[str] = []
    apart: list[Entry] = []
    for name, pairs in entries:
        line = f"{name} = {{ {', '.join(f'{k} = {v}' for k, v in pairs)} }}"
        if not pairs[0][0]:
            inside += _folded(name, pairs[0][1])
        elif len(line) <= LINE_WIDTH:
            inside.append(line)
        else:
            apart.append((name, pairs))
    if inside or (always and not apart):
        yield from ["", f"[{header}]", *inside]
    for name, pairs in apart:
        yield from ["", f"[{header}.{name}]", *(line for k, v in pairs for line in _folded(k, v))]


class _Array(str):
    """The text of an array, with the texts of its elements."""

    items: list[str]


def _folded(key: str, value: str) -> list[str]:
    """``key = value``; an array that is too wide is spread over several lines."""
    line = f"{key} = {value}"
    if len(line) <= LINE_WIDTH or not isinstance(value, _Array):
        return [line]
    rows = _filled(value.items, ", ", LINE_WIDTH - 3)
    return [f"{key} = [", *(f"  {row}," for row in rows), "]"]


def _filled(items: Iterable[str], mark: str, width: int) -> list[str]:
    """The items joined by ``mark``, in as few rows of at most ``width`` as possible."""
    rows: list[list[str]] = []
    used = 0
    for item in items:
        if not rows or used + len(mark) + len(item) > width:
            rows.append([])
            used = -len(mark)
        rows[-1].append(item)
        used += len(mark) + len(item)
    return [mark.join(row) for row in rows]


def split_wire(wire: str) -> list[str]:
    """A chain as one or more that fit the line, joined at shared blocks."""
    if len(wire) + 5 <= LINE_WIDTH:
        return [wire]
    first, *stages, last = wire.split(" -> ")
    lines, line = list[str](), first
    for stage in (*stages, last):
        if len(line) + len(stage) + 9 > LINE_WIDTH and " -> " in line:
            lines.append(line)
            line = line.rpartition(" -> ")[2].partition(".")[0]
        line += f" -> {stage}"
    line = line.removesuffix(f" -> {last}")
    receivers = _filled(last.split(", "), ", ", max(20, LINE_WIDTH - len(line) - 9))
    return [*lines, *(f"{line} -> {row}" for row in receivers)]


# ---- values -----------------------------------------------------------------------------------


def toml(value: Any) -> str:
    """One value as TOML; raises _Unwritable."""
    if isinstance(value, tuple):
        items = [toml(v) for v in value]
        array = _Array(f"[{', '.join(items)}]")
        array.items = items
        return array
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise _Unwritable(f"is {in_words(value)}, with an incomplete character in it") from None
        value = str(value)  # names from a file have a position
    elif isinstance(value, float):
        if math.isnan(value):
            raise _Unwritable("is nan")
        value = float(value)
    elif not isinstance(value, int):
        raise _Unwritable(f"is {in_words(value)}")
    return tomli_w.dumps({"k": value})[4:-1]
