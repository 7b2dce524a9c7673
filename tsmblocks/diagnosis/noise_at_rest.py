"""Noise floors from stand-still that contain motion which the base model simulates, such as what rings after a step."""

from __future__ import annotations

from collections.abc import Mapping

import attrs

from tsmblocks.data import Record
from tsmblocks.data.noise_floor import noise_over_recordings
from tsmblocks.data.noise_methods import STAND_STILL
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.noise_floor import NoiseFloors
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.fitting.above_noise import MAX_FLOOR_RATIO
from tsmblocks.fitting.recordings import as_recorded


def without_motion_at_rest(
    found: NoiseFloors, base: Model, records: Mapping[str, Record], scales: Mapping[str, float]
) -> tuple[NoiseFloors, list[str]]:
    """Noise floors from stand-still no higher than what the base leaves there, and notes on those that changed.

    The inputs rest, and a mechanism with little damping does not yet. ``records`` are those that the base was fitted
    to, whole; its residuals are in the ``scales`` of the outputs.
    """
    sigma, low, high = dict(found.sigma), dict(found.low), dict(found.high)
    recordings, notes = dict(found.recordings), list[str]()
    for name in (k for k, method in found.method.items() if method == STAND_STILL):
        unit = base.diagram.unit(name)
        left = _residual_records(base, records, name, scales[name])
        if left is None:
            continue
        own = noise_over_recordings(left, name, unit, base.diagram.inports)
        if own.method != STAND_STILL or not 0 < own.floor * MAX_FLOOR_RATIO < sigma[name]:
            continue
        shown = as_recorded(base.diagram, name, records.values())
        before, after = (in_display_units(rms, shown) for rms in (sigma[name], own.floor))
        notes.append(
            f"the noise of {name} estimated from stand-still, {before} rms, contains motion that the base model "
            f"simulates. Taken for the noise floor instead: what the model leaves there, {after} rms."
        )
        sigma[name], low[name], high[name] = own.floor, own.low, own.high
        recordings.pop(name, None)
    return attrs.evolve(found, sigma=sigma, low=low, high=high, recordings=recordings), notes


def _residual_records(base: Model, records: Mapping[str, Record], name: str, scale: float) -> dict[str, Record] | None:
    """The recordings with the residual of an output in its place; None where they are in pieces, or have gaps."""
    count, k = len(base.setup.outputs), base.setup.outputs.index(name)
    rows = base.problem.segments[k::count]
    residuals = {one.name: base.r[part] for one, part in zip(base.setup.experiments, rows, strict=True)}
    if any(len(residuals.get(key, ())) != len(record) for key, record in records.items()):
        return None
    return {
        key: attrs.evolve(
            record,
            signals={**record.signals, name: residuals[key] * scale / record.factor(name, base.diagram.unit(name))},
        )
        for key, record in records.items()
    }
