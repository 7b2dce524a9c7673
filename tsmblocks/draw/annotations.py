"""What a caller adds to the drawing of a diagram: blocks and loops in the accent colour, and values on wires."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import attrs

from tsmblocks.common.arguments import as_mapping
from tsmblocks.common.errors import TsmError, in_words, near
from tsmblocks.model.diagram import Diagram

SOLVED = "↻"
"""Mark on a signal for which an algebraic loop is solved."""


@attrs.frozen
class Loops:
    """Algebraic loops in a drawing: their ``signals``, those for which they are ``solved``, blocks with one inside."""

    signals: frozenset[tuple[str, str]] = frozenset()
    solved: frozenset[tuple[str, str]] = frozenset()
    blocks: frozenset[str] = frozenset()

    def noted(self, texts: Mapping[tuple[str, str], str]) -> dict[tuple[str, str], str]:
        """The texts on wires, with the mark of the loops."""
        return {**texts, **{end: f"{SOLVED} {texts.get(end, '')}".strip() for end in self.solved}}

    def about(self, end: tuple[str, str]) -> str:
        """What a tooltip adds on a signal."""
        if end not in self.signals:
            return ""
        return ", in an algebraic loop" + (" that is solved for it" if end in self.solved else "")


def drawn_loops(diagram: Diagram, loops: Iterable[Any]) -> Loops:
    """Algebraic loops (those of a run, or lists of signals around each) in terms of the signals that are drawn.

    Raises TsmError for a signal that the diagram does not have.
    """
    ends = {name: end for end in _outputs(diagram) for name in _names(diagram, end)}
    signals, solved, blocks = set[tuple[str, str]](), set[tuple[str, str]](), set[str]()
    for loop in _listed(loops):
        path = [str(name).removeprefix("d/dt ") for name in _listed(getattr(loop, "path", loop))]
        for name in path:
            if name.partition(".")[0] not in (*diagram.blocks, *diagram.inputs):
                hint = near(name, ends)
                raise TsmError(f"diagram '{diagram.title}' has no signal '{name}' of an algebraic loop.{hint}")
        around = {name.partition(".")[0] for name in path}
        if len(around) == 1 and isinstance(diagram.blocks.get(*around), Diagram):
            blocks |= around
        else:
            signals |= {ends[name] for name in path if name in ends}
            solved |= {ends[name] for name in path[:1] if name in ends}
    return Loops(frozenset(signals), frozenset(solved), frozenset(blocks))


def _listed(given: Any) -> Iterable[Any]:
    """Loops, or the signals around one. Raises TsmError for what is no list of them."""
    if not isinstance(given, Iterable) or isinstance(given, str):
        raise TsmError(f"loops takes algebraic loops or lists of the signals around each, got {in_words(given)}.")
    return given


def _outputs(diagram: Diagram) -> Iterator[tuple[str, str]]:
    for name, block in diagram.blocks.items():
        yield from ((name, port) for port in block.outports)


def _names(diagram: Diagram, end: tuple[str, str]) -> list[str]:
    """Names of the signal at an output: its own, and that of the block inside which makes it."""
    name, port = end
    block = diagram.blocks[name]
    if not isinstance(block, Diagram):
        return [f"{name}.{port}"]
    inner, switches = block.shown[port], [k for k, b in block.blocks.items() if getattr(b, "switches", "")]
    names = [f"{k}.{port}.y" for k in switches] + (_names(block, inner) if inner[0] else [])
    return [f"{name}.{one}" for one in names]


def nested(diagram: Diagram, path: str) -> Diagram:
    """The diagram inside a diagram at a path of names (``"controller.observer"``).

    Raises TsmError where there is none.
    """
    inner, passed = diagram, ""
    for name in str(path).split(".") if path != "" else ():
        within = {k: block for k, block in inner.blocks.items() if isinstance(block, Diagram)}
        if name not in within:
            where = f"'{passed}' of diagram '{diagram.title}'" if passed else f"diagram '{diagram.title}'"
            raise TsmError(f"{where} has no diagram '{name}' inside.{near(name, within)}")
        inner, passed = within[name], f"{passed}.{name}".lstrip(".")
    return inner


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
    for name, value in as_mapping("values", values, '"motor.y": 0.5').items():
        if name in ends:
            block_name, port = ends[name]
            unit = diagram.unit(f"{block_name}.{port}" if port else block_name.removeprefix(">"))
            try:
                texts[ends[name]] = _text(value, unit)
            except (TypeError, ValueError, OverflowError):  # an integer of hundreds of digits
                wanted = "must be a number or text"
                raise TsmError(f"the value to write on '{name}' {wanted}, got {in_words(value)}.") from None
        elif not isinstance(diagram.blocks.get(name.partition(".")[0]), Diagram):
            raise TsmError(f"diagram '{diagram.title}' has no signal '{name}' to label.{near(name, ends)}")
    return texts


def _text(value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    return f"{float(value):.4g}{f' {unit}' if unit not in ('', '1') else ''}".replace("-", "−")
