"""What a caller adds to the drawing of a diagram: blocks in the accent colour, and values on wires."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tsmblocks.common.errors import TsmError, in_words, near
from tsmblocks.model.diagram import Diagram


def highlighted(diagram: Diagram, names: Iterable[str]) -> set[str]:
    """Blocks to highlight; a name inside a block that is a diagram marks that block.

    Raises TsmError for any other name.
    """
    if not isinstance(names, Iterable):
        raise TsmError(f"highlight takes names of blocks, got {in_words(names)}.")
    found = set()
    for name in [names] if isinstance(names, str) else map(str, names):
        head, dot, _ = name.partition(".")
        if head not in diagram.blocks or (dot and not isinstance(diagram.blocks[head], Diagram)):
            hint = near(name, diagram.blocks)
            raise TsmError(f"diagram '{diagram.title}' has no block '{name}' to highlight.{hint}")
        found.add(head)
    return found


def wire_texts(diagram: Diagram, values: Mapping[str, Any] | None) -> dict[tuple[str, str], str]:
    """The texts that ``values`` gives for signals ``(block, port)`` or ``(">input", "")``; numbers with their unit.

    A name may be an output or input of the diagram, ``"block.port"``, or ``"block"`` where it has one
    output. Signals inside a block that is a diagram are passed over. Raises TsmError for any other.
    """
    ends: dict[str, tuple[str, str]] = {}
    for name, block in diagram.blocks.items():
        ends |= {f"{name}.{port}": (name, port) for port in block.outports}
        if len(block.outports) == 1:
            ends[name] = (name, next(iter(block.outports)))
    ends |= {name: (">" + name, "") for name in diagram.inputs}
    ends |= {name: (end if end[0] else (">" + end[1], "")) for name, end in diagram.shown.items()}
    texts = {}
    for name, value in (values or {}).items():
        if name in ends:
            block_name, port = ends[name]
            unit = diagram.unit(f"{block_name}.{port}" if port else block_name.removeprefix(">"))
            try:
                texts[ends[name]] = _text(value, unit)
            except (TypeError, ValueError):
                wanted = "must be a number or text"
                raise TsmError(f"the value to write on '{name}' {wanted}, got {in_words(value)}.") from None
        elif not isinstance(diagram.blocks.get(name.partition(".")[0]), Diagram):
            raise TsmError(f"diagram '{diagram.title}' has no signal '{name}' to label.{near(name, ends)}")
    return texts


def _text(value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    return f"{float(value):.4g}{f' {unit}' if unit not in ('', '1') else ''}".replace("-", "−")
