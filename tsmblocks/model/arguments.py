"""The arguments of a diagram: the form in which it keeps them, and what they mean."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import attrs

from tsmblocks.common.errors import DiagramError
from tsmblocks.model.block import Block
from tsmblocks.model.unit_inference import units_inside
from tsmblocks.model.validation import Checked, examine, kind_faults
from tsmblocks.model.values import plain
from tsmblocks.model.wires import chains, end_text, not_a_block

if TYPE_CHECKING:
    from tsmblocks.model.diagram import Diagram

_PACKAGE = str(Path(__file__).parent.parent)
DEEPEST = 64
"""Largest number of levels of diagrams inside diagrams. Chosen: far above any real diagram, and safe for recursion."""


def _ports(given: Any) -> tuple[str, ...]:
    return tuple(given) if isinstance(given, (list, tuple)) else (given,)


@attrs.frozen
class Inlet:
    """An input of a diagram.

    Parameters
    ----------
    ports : str or sequence of str
        The input ports that it drives (``"motor.u"``).
    unit : str, default ""
        Its unit; ``""`` takes the unit of these ports.
    about : str, default ""
        Meaning of the signal.
    """

    ports: tuple[str, ...] = attrs.field(converter=_ports, eq=frozenset)
    unit: str = ""
    about: str = ""


def read_only(given: Any) -> Any:
    """A read-only copy of a mapping; anything else unchanged, to be refused with a message."""
    return MappingProxyType(dict(given)) if isinstance(given, Mapping) else given


def as_inlets(given: Any) -> Any:
    """The inputs as inlets, read-only."""
    is_mapping = isinstance(given, Mapping)
    return read_only({k: v if isinstance(v, Inlet) else Inlet(v) for k, v in given.items()} if is_mapping else given)


def as_values(given: Any) -> Any:
    """The table of values as plain numbers, read-only."""
    return read_only({k: plain(v) for k, v in given.items()} if isinstance(given, Mapping) else given)


def as_wires(given: Any) -> Any:
    """The wires as a tuple; one text, or no list, unchanged, to be refused with the other faults."""
    try:
        return given if isinstance(given, str) else tuple(given)
    except TypeError:
        return given


def caller() -> str:
    """``file:line`` of the first frame outside this package: the line of a script that made the diagram."""
    frame: Any = sys._getframe(1)
    while frame and (frame.f_code.co_filename.startswith((_PACKAGE, "<attrs"))):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}" if frame else ""


def meaning(diagram: Diagram, diagrams: type[Diagram]) -> dict[str, Any]:
    """Every field that follows from the arguments of a diagram; ``diagrams`` is the class of those inside it.

    Raises DiagramError with every fault.
    """
    checked = _checked(diagram, diagrams)
    links = tuple(dict.fromkeys(checked.links))
    # one spelling of each end, so that "tsm" and "tsm.y" make equal diagrams
    ports = {k: [".".join(end) for end in ends] for k, ends in checked.inlets.items()}
    return {
        "links": links,
        "wires": tuple(chains(links, diagram.blocks)),
        "inputs": read_only({k: attrs.evolve(v, ports=ports[k]) for k, v in diagram.inputs.items()}),
        "outputs": read_only({k: end_text(end) for k, end in checked.shown.items()}),
        "inlets": read_only(checked.inlets),
        "shown": read_only(checked.shown),
        "port_units": read_only({**checked.port_units, **units_inside(diagram.blocks, checked.port_units)}),
        "interface": read_only(checked.interface),
    }


def _checked(diagram: Diagram, diagrams: type[Diagram]) -> Checked:
    """The meaning of wires, inputs and outputs. Raises DiagramError with every fault."""
    blocks = diagram.blocks
    wrong = [*kind_faults(diagram._fields())]
    if not wrong:
        wrong = [not_a_block(k, v) for k, v in blocks.items() if not isinstance(v, (Block, diagrams))]
    if not wrong and diagram.depth > DEEPEST:
        wrong = [f"diagrams are nested more than {DEEPEST} deep."]
    if wrong:
        raise DiagramError(diagram.title, wrong, diagram.where)
    checked = examine(
        blocks, diagram.wires, diagram.inputs, diagram.outputs, diagram.values, output_units=diagram.output_units
    )
    if checked.faults:
        raise DiagramError(diagram.title, checked.faults, diagram.where)
    return checked
