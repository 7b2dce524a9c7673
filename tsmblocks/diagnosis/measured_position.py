"""A ripple over a position that is not measured, with the integral of the measured speed in place of the model's.

While an effect is missing, the model's speed is in error and its position more so: a ripple of many periods over that
position has little to do with the true one, and neither screening nor a fit from there leads to it.
"""

from __future__ import annotations

from collections.abc import Mapping

import attrs
import numpy as np
from scipy.integrate import cumulative_trapezoid

from tsmblocks.blocks import Integrator
from tsmblocks.common.tables import unique_names
from tsmblocks.data.record import Record
from tsmblocks.diagnosis.candidates import Candidate, WireSignals
from tsmblocks.diagnosis.signal_paths import source_of
from tsmblocks.model.arguments import Inlet
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import end_text

POSITION = "measured_position"
"""Name of the added input."""


def at_measured_position(
    candidate: Candidate, records: Mapping[str, Record], wires: WireSignals
) -> tuple[Candidate, dict[str, Record]] | None:
    """A candidate that reads the integral of a measured output, and the recordings with it.

    None where it reads no integral of an output, or needs no such start.
    """
    diagram, position = candidate.diagram, candidate.point.other
    output = _integrated_output(diagram, position) if candidate.trials.held_first else ""
    if not output:
        return None
    unit, port = diagram.unit(position), f"{candidate.block}.x"
    taken = {*diagram.inputs, *diagram.outputs, *(k for record in records.values() for k in record.units)}
    name = unique_names([*taken, POSITION])[-1]
    inputs = {**diagram.inputs, name: Inlet(port, unit=unit)}
    edited = diagram.rewire(cut=[f"{position} -> {port}"], inputs=inputs)
    first = dict(zip(records, wires.initial_values(position), strict=True))
    with_it = {
        key: record.with_signal(name, first[key] + _integral(record, output, diagram.unit(output)), unit)
        for key, record in records.items()
    }
    return attrs.evolve(candidate, diagram=edited), with_it


def _integrated_output(diagram: Diagram, position: str) -> str:
    """The output that a signal is the integral of; empty where there is none."""
    block = position.partition(".")[0]
    if not isinstance(diagram.blocks.get(block), Integrator):
        return ""
    speed = source_of(diagram, f"{block}.u")
    return next((name for name, end in diagram.shown.items() if end_text(end) == speed), "")


def _integral(record: Record, output: str, unit: str) -> np.ndarray:
    return np.asarray(cumulative_trapezoid(record.values(output, unit), record.t, initial=0.0))
