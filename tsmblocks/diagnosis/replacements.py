"""Candidates that replace a block of the diagram by a relative, such as Coulomb friction by Dahl friction."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import attrs

from tsmblocks.common.errors import TsmError
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.signal_paths import source_of
from tsmblocks.effects import REPLACED, Relative, Replacement, Scales, replacement
from tsmblocks.effects.relatives_friction import RATE_BLOCK
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class ReplacementPoint(InsertionPoint):
    """A block that may be replaced: ``before`` is its port, ``ports`` are those of a relative by those of the block.

    ``signal`` is its output, ``other`` what it reads; ``rate`` is the ``Derivative`` that is removed with it, if any.
    """

    relative: Relative = attrs.field(kw_only=True)
    rate: str = attrs.field(default="", kw_only=True)

    @property
    def replaced(self) -> str:
        """The name of the block."""
        return self.before.partition(".")[0]

    def put(self, diagram: Diagram, name: str, block: Block | Diagram) -> Diagram:
        """The diagram with the old block replaced by ``block``, under the same name."""
        edited = diagram.replace(name, block, ports=self.relative.ports)
        return edited.remove(self.rate) if self.rate else edited

    def code(self, name: str, block: Block | Diagram) -> str:
        """The edit of ``put`` as an expression of a script, with ``…`` for the block."""
        ports = f", ports={dict(self.relative.ports)!r}" if self.relative.ports else ""
        removed = f".remove({self.rate!r})" if self.rate else ""
        return f"diagram.replace({name!r}, …{ports}){removed}"

    @property
    def edit(self) -> tuple[object, ...]:
        """The key of the block and its relative."""
        return self.place, self.before, id(self.relative)

    def words(self, diagram: Diagram) -> str:
        """The wire into the block, in wire notation."""
        return f"{source_of(diagram, self.before)} -> {self.before}"


def replacement_points(
    diagram: Diagram, output: str, relatives: Iterable[Relative], named: Collection[str]
) -> list[ReplacementPoint]:
    """Every block of a diagram that has relatives, with each of them; blocks in ``named`` were named before."""
    found = list[ReplacementPoint]()
    for name, block in diagram.blocks.items():
        own = [one for one in relatives if type(block) is one.of and name not in named]
        if not own or isinstance(block, Diagram):
            continue
        port = next((k for k, p in block.inports.items() if not p.rate_of), "")
        try:
            reads = source_of(diagram, f"{name}.{port}")
        except StopIteration:  # nothing drives it
            continue
        rate = _rate_in_front(diagram, reads)
        for one in own:
            if one.instead_of_rate and not rate:
                continue
            other = source_of(diagram, f"{rate}.u") if one.instead_of_rate else reads
            found.append(
                ReplacementPoint(
                    REPLACED,
                    output,
                    f"{name}.{next(iter(block.outports))}",
                    other,
                    before=f"{name}.{port}",
                    relative=one,
                    rate=rate if one.instead_of_rate else "",
                )
            )
    return found


def _rate_in_front(diagram: Diagram, signal: str) -> str:
    """The block that forms a rate, if ``signal`` is one that nothing else reads and no output shows."""
    head = signal.partition(".")[0]
    readers = [x for x in diagram.links if x.source[0] == head]
    shown = any(end[0] == head for end in diagram.shown.values())
    alone = isinstance(diagram.blocks.get(head), RATE_BLOCK) and len(readers) == 1 and not shown
    return head if alone else ""


def replacements(
    diagram: Diagram, points: Sequence[ReplacementPoint], scales_of: Callable[[InsertionPoint], Scales]
) -> Iterator[tuple[Replacement, ReplacementPoint]]:
    """The effect of each replacement, made for the block as it is fitted.

    Those that its parameters rule out are left out.
    """
    for point in points:
        old = _with_values(diagram.blocks[point.replaced], diagram.values)
        try:
            yield replacement(point.relative, point.replaced, old, scales_of(point)), point
        except TsmError:  # its fitted parameters are beyond the bounds of the relative
            continue


def _with_values(block: Any, values: Mapping[str, Any]) -> Block:
    """The block with the shared values of the diagram in place of their names."""
    given = {k: values[v[1:]] for k, v in block.parameters.items() if isinstance(v, str) and v[1:] in values}
    return block.replace(**given) if given else block
