"""Units of the parameters of blocks in a diagram, where these depend on the signals at the block."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from tsmblocks.common import displayed_units, units
from tsmblocks.model.block import Field
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.unit_inference import RATIO_OF_UNITS, SHARED_UNIT


def unit_of(name: str, diagram: Diagram, fields: Sequence[Field]) -> str:
    """The unit of a number: as declared, or that which the wires give the ports of its block; ``""`` without either."""
    declared = next((f.unit for f in fields if f.unit and "?" not in f.unit), "")
    return declared or (_unit_of_ports(name, diagram, fields[0].unit) if fields else "")


def _unit_of_ports(name: str, diagram: Diagram, label: str) -> str:
    """The unit of a number that depends on those of the ports of its block, such as ``?u*s`` or ``?y/?u``."""
    block: Any = diagram
    *way, _ = name.split(".")
    for part in way:
        block = block.blocks.get(part) if isinstance(block, Diagram) else None
    if not way or isinstance(block, Diagram | None):
        return ""
    ports = {**block.inports, **block.outports}

    def of_letter(letter: str) -> str:
        """The unit of the ports that share a letter."""
        alike = [port for port, spec in ports.items() if spec.unit == f"?{letter}"]
        found = (diagram.unit(".".join([*way, port])) for port in alike)
        known = ports.get(letter)  # where an option of the block gives its unit, it is the port of that letter
        return next(filter(None, found), known.unit if known is not None and known.unit_option and not alike else "")

    if ratio := RATIO_OF_UNITS.fullmatch(label):
        return units.quotient(of_letter(ratio[1]), of_letter(ratio[2]))
    shared = SHARED_UNIT.fullmatch(label)
    if shared is None:
        return ""
    unit = of_letter(shared[1])
    for sign, base, power in re.findall(r"([*/])(\w+)(?:\^(\d+))?", shared[2] if unit else ""):
        for _ in range(int(power or 1)):
            unit = displayed_units.times(unit, base, 1 if sign == "*" else -1)
    return unit
