"""The difference between two diagrams: blocks and wires added or removed, and parameters changed."""

from __future__ import annotations

from collections.abc import Sequence

import attrs

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.presentation import digits, unit_of
from tsmblocks.diagnosis.segment import NamedEffect
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

PARAMETER_TOLERANCE = 1e-9
"""Relative change of a parameter below which it is unchanged. Chosen: rounding of a fit."""


@attrs.frozen
class ChangedParameter:
    """A parameter that changed, in its own unit."""

    name: str
    before: float
    after: float
    unit: str

    @property
    def words(self) -> str:
        """``tsm.theta 3.94 -> 4.02 1/rad``, angles in degrees."""
        k, unit = display_unit(self.unit)
        before, after = (digits(k * value) if value else "0" for value in (self.before, self.after))
        return f"{self.name}  {before} -> {after} {unit}".rstrip()


@attrs.frozen
class Difference:
    """The changes from one diagram to another: blocks as code by name, wires in wire notation, changed parameters."""

    added: dict[str, str]
    removed: dict[str, str]
    wires_added: tuple[str, ...]
    wires_removed: tuple[str, ...]
    parameters: tuple[ChangedParameter, ...]

    @property
    def lines(self) -> list[tuple[str, str]]:
        """A (sign, text) for each addition (``+``), removal (``-``) and change (``~``)."""
        return [
            *(("-", f"{name} = {words}") for name, words in self.removed.items()),
            *(("+", f"{name} = {words}") for name, words in self.added.items()),
            *(("-", wire) for wire in self.wires_removed),
            *(("+", wire) for wire in self.wires_added),
            *(("~", one.words) for one in self.parameters),
        ]


def difference(before: Diagram, after: Diagram) -> Difference:
    """The changes from ``before`` to ``after``; initial states, which each recording has its own of, are no changes."""
    old, new = _all_wires(before), _all_wires(after)
    known, fields = before.parameters, numbers(after)
    replaced = {k for k, b in after.blocks.items() if k in before.blocks and _kind(b) != _kind(before.blocks[k])}
    parameters = tuple(
        ChangedParameter(name, known[name], value, unit_of(after, name))
        for name, value in after.parameters.items()
        if name in known
        and name.partition(".")[0] not in replaced
        and not is_start(fields.get(name, []))
        and abs(value - known[name]) > PARAMETER_TOLERANCE * max(abs(value), abs(known[name]))
    )
    return Difference(
        {k: in_code(b, states=False) for k, b in after.blocks.items() if k not in before.blocks or k in replaced},
        {k: in_code(b, states=False) for k, b in before.blocks.items() if k not in after.blocks or k in replaced},
        tuple(w for w in new if w not in old),
        tuple(w for w in old if w not in new),
        parameters,
    )


def changes(before: Diagram, after: Diagram, effects: Sequence[NamedEffect]) -> list[tuple[str, str]]:
    """The lines of a difference, and one for each effect with separate values, of which a diagram holds the first."""
    lines = difference(before, after).lines
    for effect in effects:
        names = [name.partition("@") for name in effect.parameters if "@" in name]
        if names:
            local = listed([f"{effect.block}.{name}" for name in dict.fromkeys(name for name, _, _ in names)], 4)
            lines.append(("~", f"{local}: a separate value in each experiment, here that of {names[0][2]}"))
    return lines


def _kind(block: Block | Diagram) -> object:
    """The class of a block, or those of the blocks of a diagram."""
    return {k: _kind(b) for k, b in block.blocks.items()} if isinstance(block, Diagram) else type(block)


def in_code(block: Block | Diagram, *, states: bool = True) -> str:
    """A block as a script makes it, with the parameters that are not at their default, and with initial states."""
    if isinstance(block, Diagram):
        return f"Diagram({', '.join(f'{k}={in_code(b, states=states)}' for k, b in block.blocks.items())})"
    defaults = {f.name: f.default for f in attrs.fields(type(block))}  # type: ignore[arg-type]
    known = block.fields()
    given = {k: v for k, v in block.parameters.items() if states or k not in known or not is_start([known[k]])}
    shown = [f"{k}={_literal(v)}" for k, v in given.items() if defaults.get(k, attrs.NOTHING) != v]
    return f"{type(block).__name__}({', '.join(shown)})"


def _literal(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (tuple, list)):
        return "(" + ", ".join(map(_literal, value)) + ("," if len(value) == 1 else "") + ")"
    return repr(value)


def _all_wires(diagram: Diagram) -> list[str]:
    """Every single wire, those from inputs and to outputs included."""
    result = [f"{name} -> {'.'.join(end)}" for name, ends in diagram.inlets.items() for end in ends]
    result += [f"{diagram.short(link.source)} -> {'.'.join(link.target)}" for link in diagram.links]
    result += [f"{diagram.short(end) if end[0] else end[1]} => {name}" for name, end in diagram.shown.items()]
    return result
