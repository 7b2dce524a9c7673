"""Units of the parameters of effects, as the signals on which they act are displayed."""

from __future__ import annotations

from collections.abc import Mapping

from tsmblocks.common.displayed_units import displayed_in, times
from tsmblocks.common.units import is_one_of, is_unit, parse
from tsmblocks.diagnosis.candidates import Candidate, unit_of_signal
from tsmblocks.fitting.parameter_vector import Unknown

LOAD = "load"
"""The place of effects that make a force of the motion."""
FORCE = "force"
"""The block in them that does so: what it adds to the motion is converted to a force by a gain of 1."""


def displayed_unit(item: Unknown, candidate: Candidate, recorded: Mapping[str, str]) -> str:
    """The unit of a parameter of an effect, displayed as the signals on which it acts, and as their rates."""
    wire, other = units_on_wire(candidate, recorded)
    unit, name = item.unit, item.parameter.removeprefix(f"{candidate.block}.")
    if candidate.effect.place == LOAD and name.startswith(f"{FORCE}.") and _is_same_quantity(unit, other):
        unit = wire
    return displayed_in(unit, [wire, other, *recorded.values(), *(times(one, "s", -1) for one in (wire, other) if one)])


def units_on_wire(candidate: Candidate, recorded: Mapping[str, str]) -> tuple[str, str]:
    """The units of the signal on which an effect acts, and of the second one; empty where none is known.

    They are displayed in the unit of a recorded signal of the same quantity, of the one on the wire first.
    """
    point = candidate.point

    def unit(signal: str) -> str:
        own = [recorded.get(name, "") for name in (signal, point.output)]
        return displayed_in(unit_of_signal(candidate.diagram, signal), [*own, *recorded.values()])

    wire = unit(point.signal)
    return wire, unit(point.other) if point.other else wire


def _is_same_quantity(unit: str, other: str) -> bool:
    """Whether two units are known and measure the same quantity."""
    return bool(other) and is_unit(other) and is_one_of(unit, {parse(other).dimension})
