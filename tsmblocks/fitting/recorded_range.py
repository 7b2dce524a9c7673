"""Parameters that act beyond the range of the recordings, such as a limit that is never reached."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import TsmError
from tsmblocks.fitting.parameters import numbers
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import no_step_warnings

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

MOST = 0.95
"""Share of the magnitudes of a signal that a scale is compared with. Chosen: a few samples do not determine it."""
COMPLETE = 2.0
"""Magnitude, in multiples of a scale, at which a transition is complete. Derived: tanh(2) and 1 - exp(-4) are above
96 %."""


def beyond_range(fit: Fit) -> list[str]:
    """A caution for each fitted parameter that is beyond the values of the signal with which it is compared."""
    if fit.status in ("interrupted", "limit"):
        return []
    fields, said = numbers(fit.diagram), []
    acting = [(e, fields[e.name][0]) for e in fit.estimates if fields.get(e.name) and fields[e.name][0].acts_at]
    runs: dict[str, Any] | None = None
    for estimate, field in acting:
        source = _source(fit.diagram, f"{estimate.name.rpartition('.')[0]}.{field.acts_at}")
        runs = _runs(fit) if runs is None else runs
        values = [run[source] for run in runs.values() if source in run] if source else []
        if not values or not np.isfinite(estimate.value):
            continue
        k, unit = display_unit(estimate.unit)
        own, all_values = k * estimate.value, k * np.concatenate(values)
        words = _beyond_limit(own, all_values, unit) if field.opposite else _large_scale(own, all_values, unit)
        if words:
            said.append(f"{estimate.name} ({own:.3g} {unit}".rstrip() + f") is {words.format(source)}")
    return said


def _large_scale(value: float, signal: np.ndarray, unit: str) -> str:
    """Words on a scale, such as a smoothing speed, beside which most magnitudes of a signal are small."""
    most = float(np.quantile(np.abs(signal), MOST))
    if not COMPLETE * value > most:
        return ""
    below, complete = (f"{x:.3g} {unit}".rstrip() for x in (most, COMPLETE * value))
    return (
        f"large beside {{}} in these recordings: {100 * MOST:.0f} % of its magnitudes are below {below}, and the "
        f"transition ends at about {complete}. What the block does there is an extrapolation."
    )


def _beyond_limit(value: float, signal: np.ndarray, unit: str) -> str:
    """Words on a limit that a signal does not reach."""
    low, high = float(signal.min()), float(signal.max())
    if low <= value <= high:
        return ""
    span = f"{low:.3g} to {high:.3g} {unit}".rstrip()
    return f"beyond the range of {{}} in these recordings ({span}), so it is an extrapolation."


def _source(diagram: Diagram, port: str) -> str:
    """The signal that drives an input port of a block; empty where it is inside of a nested diagram."""
    for link in diagram.links:
        if ".".join(link.target) == port:
            return ".".join(link.source)
    return next((name for name, inlet in diagram.inputs.items() if port in inlet.ports), "")


def _runs(fit: Fit) -> dict[str, Any]:
    """The fitted diagram simulated in each experiment; without those that fail."""
    return dict(_simulated(fit))


def _simulated(fit: Fit) -> Iterator[tuple[str, Any]]:
    for name, diagram in fit.diagrams.items():
        record, known = fit.records[name], diagram.simulation
        try:
            with no_step_warnings():
                run = simulate(
                    diagram,
                    inputs=dict.fromkeys(diagram.inports, record),
                    start=record.t[0],
                    step=known.step_of(name) or fit.step,
                    method=known.method or fit.integrator,
                    hold=fit.hold,
                    check_step=False,
                )
            yield name, run
        except TsmError:  # it was simulated in pieces, or diverges as a whole
            continue
