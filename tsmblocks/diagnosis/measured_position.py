"""A ripple over a position that is not measured, with the integral of the measured speed in place of the model's.

While an effect is missing, the model's speed is in error and its position more so: a ripple of many periods over that
position has little to do with the true one, and neither screening nor a fit from there leads to it.
"""

from __future__ import annotations

from collections.abc import Mapping

import attrs

from tsmblocks.blocks import Integrator
from tsmblocks.common.tables import unique_names
from tsmblocks.data.record import Record
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.signal_paths import source_of
from tsmblocks.model.arguments import Inlet
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import end_text

SPEED, POSITION = "measured_speed", "measured_position"
"""Names of the added input, and of the block that integrates it."""


def at_measured_position(
    candidate: Candidate, records: Mapping[str, Record]
) -> tuple[Candidate, dict[str, Record]] | None:
    """A candidate that reads the integral of a measured output, and the recordings with that output as an input.

    None where it reads no integral of an output, or needs no such start.
    """
    diagram, position = candidate.diagram, candidate.point.other
    output = _integrated_output(diagram, position) if candidate.trials.held_first else ""
    if not output:
        return None
    taken = {*diagram.blocks, *diagram.inputs, *diagram.outputs, *(k for one in records.values() for k in one.units)}
    *_, speed, integrator = unique_names([*taken, SPEED, POSITION])
    unit = diagram.unit(output)
    edited = diagram.rewire(
        cut=[f"{position} -> {candidate.block}.x"],
        add=[f"{integrator} -> {candidate.block}.x"],
        blocks={**diagram.blocks, integrator: diagram.blocks[_block(position)]},
        inputs={**diagram.inputs, speed: Inlet(f"{integrator}.u", unit=unit)},
    )
    with_it = {key: one.with_signal(speed, one.values(output, unit), unit) for key, one in records.items()}
    return attrs.evolve(candidate, diagram=edited), with_it


def in_own_names(values: Mapping[str, float], there: Candidate, own: Candidate) -> dict[str, float]:
    """Values of unknowns ``there``, in which the initial positions are those of the ``own`` integrator of the model."""
    (added,) = set(there.diagram.blocks) - set(own.diagram.blocks)
    mine = f"{_block(own.point.other)}."
    states = {k.replace(f"{added}.", mine, 1): v for k, v in values.items() if k.startswith(f"{added}.")}
    return {**values, **states}


def _integrated_output(diagram: Diagram, position: str) -> str:
    """The output that a signal is the integral of; empty where there is none."""
    if not isinstance(diagram.blocks.get(_block(position)), Integrator):
        return ""
    speed = source_of(diagram, f"{_block(position)}.u")
    return next((name for name, end in diagram.shown.items() if end_text(end) == speed), "")


def _block(signal: str) -> str:
    return signal.partition(".")[0]
