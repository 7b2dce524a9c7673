"""Equivalent diagrams that have a linear model: without rounding, and with switched parts as they are."""

from __future__ import annotations

from collections.abc import Mapping

from tsmblocks.blocks import Enable, Encoder, Gain, Quantiser
from tsmblocks.model.diagram import Diagram


def without_rounding(diagram: Diagram) -> Diagram:
    """The diagram with encoders and quantisers replaced by a gain of 1, their mean effect."""
    for name, block in diagram.blocks.items():
        if isinstance(block, (Encoder, Quantiser)):
            diagram = diagram.replace(name, Gain(unit=block.outports["y"].unit.removeprefix("?u")))
        elif isinstance(block, Diagram) and (inner := without_rounding(block)) is not block:
            diagram = diagram.replace(name, inner)
    return diagram


def switched_as_they_are(diagram: Diagram, memory: Mapping[str, float] | None = None, prefix: str = "") -> Diagram:
    """The diagram with parts permanently switched on or off, which needs no memory.

    Outputs of parts that are off are constants: as ``memory``, by name, has them.
    """
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            inner = switched_as_they_are(block, memory, f"{prefix}{name}.")
            diagram = diagram.replace(name, inner) if inner is not block else diagram
        elif isinstance(block, Enable) and not any(link.source == (name, "begins") for link in diagram.links):
            initial = block.initial
            if block.while_off == "hold":
                ports = [port for port, end in diagram.shown.items() if end[0] != name]
                held = [(memory or {}).get(f"{prefix}{name}.{port}.held") for port in ports]
                initial = tuple(v for v in held if v is not None) or initial
            steady = block.replace(restart="hold", while_off="reset", initial=initial)
            diagram = diagram.replace(name, steady) if steady != block else diagram
    return diagram
