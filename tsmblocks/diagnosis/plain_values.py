"""A diagnosis as plain values, as ``diagnosis.json`` has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common.displayed_units import display_unit

if TYPE_CHECKING:
    from tsmblocks.diagnosis.result import Diagnosis
    from tsmblocks.diagnosis.segment import DetectionLimit, Gap, Segment
    from tsmblocks.diagnosis.settings import FloorParts, Simulated

EFFECT_KEYS = {"across": "share_removed_across_experiments", "as_force": ""}
RANKING_KEYS = {"gain": "held_out_gain", "new": "share_across", "t": "statistic", "units": ""}
"""Field -> key of ``diagnosis.json`` where they differ; empty for a field that is left out."""


def diagnosis_values(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything of a diagnosis: numbers with six digits, texts, lists and mappings."""
    return {
        "format": 1,
        "diagram": diagnosis.diagram,
        "experiments": list(diagnosis.experiments),
        "windows": _json_value(diagnosis.windows),
        "seed": diagnosis.seed,
        "verdict": diagnosis.verdict,
        "complete": diagnosis.complete,
        "sentence": diagnosis.sentence,
        "status": diagnosis.status,
        "effects": [_named_values(e, EFFECT_KEYS) for e in diagnosis.effects],
        "effects_tried": len({name for s in diagnosis.segments for name in s.effects_tried}),
        "gap": _json_value(_gap(diagnosis.worst.gaps[0])),
        "where": _json_value(diagnosis.worst.where),
        "ranking": ranking_values(diagnosis),
        "detection_limits": {m.name: _json_value(m.value) for s in reversed(diagnosis.segments) for m in s.limits},
        "detection_limit_sizes": {m.name: _limit_size(m) for s in reversed(diagnosis.segments) for m in s.limits},
        "segments": [{**_json_value(_segment(s)), **_simulated(s.simulated)} for s in diagnosis.segments],
        "consequence": _json_value(diagnosis.consequence),
        "no_consequence": diagnosis.no_consequence,
        **_simulated(diagnosis.simulated),
        "provenance": _json_value(diagnosis.provenance),
        "notes": list(diagnosis.notes),
    }


def _simulated(how: Simulated | None) -> dict[str, Any]:
    """Estimated initial states and settings of the last simulation, numbers with all digits."""
    starts = {} if how is None else {k: dict(v) for k, v in how.start_states.items()}
    return {"start_states": starts, "simulated": None if how is None else how.to_dict()}


def ranking_values(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Every candidate of each round."""
    return [_named_values(r, RANKING_KEYS) for s in diagnosis.segments for r in s.ranking]


def _gap(gap: Gap) -> dict[str, Any]:
    return {
        "output": gap.output,
        "unit": gap.unit,
        "noise_floor": gap.noise_floor,
        "noise_floor_from": gap.method,
        "noise_floor_parts": None if gap.parts is None else _floor_parts(gap.parts),
        "train": {"before": gap.train[0], "after": gap.train[-1]},
        "held_out": {"before": gap.held_out[0], "after": gap.held_out[-1]},
        "steps": {"train": gap.train, "held_out": gap.held_out},
        "outliers": gap.outliers,
        "beside_input_noise": {"held_out": list(gap.whitened), "noise_floor": gap.sensor_floor}
        if gap.whitened
        else None,
        "experiments": gap.experiments,
    }


def _floor_parts(parts: FloorParts) -> dict[str, Any]:
    recordings = {
        name: {"value": one.floor, "low": one.low, "high": one.high, "from": one.method}
        for name, one in parts.recordings.items()
    }
    return {**attrs.asdict(parts, recurse=False), "recordings": recordings}


def _segment(s: Segment) -> dict[str, Any]:
    return {
        "name": s.name,
        "inputs": s.inputs,
        "outputs": s.outputs,
        "verdict": s.verdict,
        "complete": s.complete,
        "irregular": s.irregular,
        "stopped": s.stopped,
        "varies_with": s.varies_with,
        "predictable": {"before": s.predictable[0], "after": s.predictable[1]},
        "largest_noise": s.largest_noise,
        "filtered": s.filtered,
        "noise_of_inputs": {one.input: attrs.asdict(one) for one in s.noise_of_inputs},
        "excess": s.excess,
        "sentence": s.sentence,
        "effects": [e.name for e in s.effects],
        "effects_tried": len(s.effects_tried),
        "numbers": [] if s.fit is None else [e.to_dict() for e in s.fit],
        "cautions": s.cautions,
        "parameters_in_doubt": s.in_doubt,
        "ceiling": s.ceiling,
        "gaps": [_gap(g) for g in s.gaps],
        "where": s.where,
        "detection_limits": {m.name: None if m.value is None else _limit(m) for m in s.limits},
        "not_detectable": {
            m.name: {"cause": m.cause, "absorbed_by": m.absorbed_by} for m in s.limits if m.value is None
        },
    }


def _limit(m: DetectionLimit) -> dict[str, Any]:
    size = {"size": {"name": m.size_name, "value": m.size, "unit": m.size_unit}} if m.size_name else {}
    return {"parameter": m.parameter, "value": m.value, "unit": m.unit, "wire": m.wire, **size}


def _limit_size(m: DetectionLimit) -> dict[str, Any] | None:
    """The quantity that the text shows, in the unit in which it shows it."""
    if m.value is None:
        return None
    name, size, unit = limit_quantity(m)
    k, shown = display_unit(unit)
    return _json_value({"name": name, "value": k * size, "unit": shown})


def limit_quantity(m: DetectionLimit) -> tuple[str, float, str]:
    """Name, value and unit of what a detection limit is a size of: a measurable quantity, else a parameter."""
    if m.size_name or m.value is None:
        return m.size_name, m.size, m.size_unit
    return m.parameter.rpartition(".")[2], abs(m.value), m.unit


def _named_values(record: Any, keys: Mapping[str, str]) -> dict[str, Any]:
    """The fields of a record under the keys of ``diagnosis.json``."""
    return {keys.get(name, name): value for name, value in _json_value(record).items() if keys.get(name, name)}


def _json_value(value: Any) -> Any:
    """Records and mappings as dicts, tuples as lists; numbers with six digits, None for NaN and infinity."""
    if attrs.has(type(value)):
        return _json_value(attrs.asdict(value, recurse=False))
    if isinstance(value, Mapping):
        return {k: _json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_json_value(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{float(value):.6g}") if np.isfinite(value) else None  # more digits than any interval supports
    return value
