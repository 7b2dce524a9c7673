"""Signals that are constant within steps: functions of samples, memory, held inputs and jumps in time alone."""

from __future__ import annotations

from collections.abc import Callable

import attrs

from tsmblocks.compiler.flatten import FlatDiagram, Node


@attrs.frozen
class ConstantWith:
    """What a signal that may be constant within steps is made of.

    It is constant where the ``inputs`` of the diagram are; ``samples`` are the outputs of sampled blocks, by block and
    port.
    """

    inputs: frozenset[str]
    samples: tuple[tuple[str, ...], ...]


def constant_with(flat: FlatDiagram, source: Node, read_by: Callable[[str, str], Node]) -> ConstantWith | None:
    """What makes a signal constant within steps; None where it never is. ``read_by`` is what an input port reads."""
    seen, left = set[Node](), [source]
    inputs, samples = set[str](), list[tuple[str, ...]]()
    while left:
        node = left.pop()
        if node in seen:
            continue
        seen.add(node)
        kind, *key = node
        if kind == "y" and tuple(key) in flat.held:
            samples.append(tuple(key))
        elif kind == "u":
            inputs.add(key[0])
        elif kind == "past":
            left.append(flat.pasts[key[0], key[1]].source)
        elif kind == "y" and key[1] not in (shape := flat.structures[key[0]]).moving:
            left += [read_by(key[0], name) for name in shape.outputs[key[1]]]
        else:
            return None
    return ConstantWith(frozenset(inputs), tuple(samples))
