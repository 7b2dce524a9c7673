"""A wire of a diagram on which a block may be inserted."""

from __future__ import annotations

from collections.abc import Callable

import attrs

from tsmblocks.blocks import Bias
from tsmblocks.diagnosis.signal_paths import driven_by
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class InsertionPoint:
    """A wire on which a block may be inserted.

    ``before`` is the port, or ports with commas, ``after`` the signal or input of the diagram that is cut (one of both
    is empty). ``signal`` names the signal of the wire, ``other`` a second signal or input that a block there may read,
    and ``output`` the measured output it leads to. ``opposite`` is True where the wire moves ``other`` backwards.
    """

    place: str
    output: str
    signal: str
    other: str = ""
    after: str = ""
    before: str = ""
    opposite: bool = False
    adds: Callable[[Diagram, str], Diagram] | None = None

    def put(self, diagram: Diagram, name: str, block: Block | Diagram) -> Diagram:
        """The diagram with ``block`` on this wire under ``name``."""
        wires = self._wires(name, block)
        if _has_several_outputs(block):  # insert takes blocks of one output, so a placeholder first
            edited = diagram.insert(name, Bias(), after=self.after, before=self.before)
            edited = edited.rewire(blocks={**edited.blocks, name: block}, add=wires)
        else:
            edited = diagram.insert(name, block, after=self.after, before=self.before, wires=wires)
        return edited if self.adds is None else self.adds(edited, name)

    def code(self, name: str, block: Block | Diagram) -> str:
        """The edit of ``put`` as an expression of a script, with ``…`` for the block."""
        place = f"before={self.before!r}" if self.before else f"after={self.after!r}"
        wires = self._wires(name, block)
        if _has_several_outputs(block):
            added = f", add={wires!r}" if wires else ""
            edited = (
                f"diagram.insert({name!r}, Bias(), {place}).rewire(blocks={{**diagram.blocks, {name!r}: …}}{added})"
            )
        else:
            edited = f"diagram.insert({name!r}, …, {place}{f', wires={wires!r}' if wires else ''})"
        return edited if self.adds is None else f"{getattr(self.adds, '__name__', 'adds')}({edited}, {name!r})"

    def _wires(self, name: str, block: Block | Diagram) -> list[str]:
        return [f"{self.other} -> {name}.x"] if "x" in block.inports else []

    @property
    def edit(self) -> tuple[object, ...]:
        """The key of the wire, and of the signals that a block there changes."""
        return self.place, self.after, self.before, self.other, self.adds

    def is_in(self, diagram: Diagram) -> bool:
        """Whether it is on a wire of a diagram, and not beside a block that this one does not have."""
        ends = [end.rpartition(".")[0] for end in (self.signal, *self.before.split(", ")) if "." in end]
        return all(block.partition(".")[0] in diagram.blocks for block in ends)

    def words(self, diagram: Diagram) -> str:
        """The wire in wire notation, as it was before."""
        if self.before:
            return f"{self.signal} -> {self.before}"
        ends = [".".join(e) for e in diagram.inlets.get(self.after, ())]
        ends += driven_by(diagram, self.after)
        ends += [k for k, end in diagram.shown.items() if ".".join(filter(None, end)) == self.after]
        return f"{self.signal} -> {', '.join(dict.fromkeys(ends))}"


def _has_several_outputs(block: Block | Diagram) -> bool:
    return "y" in block.outports and len(block.outports) > 1
