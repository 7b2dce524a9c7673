"""The texts on wires: values of signals with their units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.common.errors import TsmError, in_words, near
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class Notes:
    """Text by signal; a block's signal is ``(block, port)``, an input of the diagram ``(">name", "")``."""

    texts: Mapping[tuple[str, str], str]

    def at(self, end: tuple[str, str]) -> str:
        """The text on the wire that leaves ``end``; empty when there is none."""
        return self.texts.get(end, "")


def notes(diagram: Diagram, values: Mapping[str, Any] | None) -> Notes:
    """The texts that ``values`` gives for signals; numbers get the unit of their port.

    A name may be an output or input of the diagram, ``"block.port"``, or ``"block"`` where it has one
    output. Signals inside a block that is a diagram are passed over. Raises TsmError for any other.
    """
    ends: dict[str, tuple[str, str]] = {}
    for name, block in diagram.blocks.items():
        ends |= {f"{name}.{port}": (name, port) for port in block.outports}
        if len(block.outports) == 1:
            ends[name] = (name, *block.outports)  # type: ignore[assignment]
    ends |= {name: (">" + name, "") for name in diagram.inputs}
    ends |= {name: (end if end[0] else (">" + end[1], "")) for name, end in diagram.shown.items()}
    texts = {}
    for name, value in (values or {}).items():
        if name in ends:
            try:
                texts[ends[name]] = _text(value, diagram.unit(_full(ends[name])))
            except (TypeError, ValueError):
                wanted = "must be a number or text"
                raise TsmError(f"the value to write on '{name}' {wanted}, got {in_words(value)}.") from None
        elif not isinstance(diagram.blocks.get(name.partition(".")[0]), Diagram):
            raise TsmError(f"diagram '{diagram.title}' has no signal '{name}' to label.{near(name, ends)}")
    return Notes(texts)


def _full(end: tuple[str, str]) -> str:
    return end[0].removeprefix(">") if not end[1] else ".".join(end)


def _text(value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    return f"{float(value):.4g}{f' {unit}' if unit not in ('', '1') else ''}".replace("-", "−")
