"""What the benchmark of the diagnosis runs: lists of cases by group, one case in a worker, and what is kept of it."""

from __future__ import annotations

import math
import time
import traceback
import warnings
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from tests.hidden import MOTOR_EFFECTS, OUTSIDE, SENSOR_FAULTS, SHEATH_EFFECTS, UNEXCITED, Case, Spec, cases
from tests.hidden_bases import diagnosed

SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Excess asked for, in variances of the noise."""
GIVEN, FOUND = "given", "found"
"""Whether the noise floor is handed over or looked for in the recordings."""
MATCHED = {
    "dead_time": ("time", 1e-3),
    "jump": ("size", math.pi / 180),
    "coulomb_friction": ("friction.level", 1.0),
    "load_offset": ("bias", 1.0),
}
"""Effects whose form is that of the catalogue: (parameter, what turns the generator's amplitude into its unit)."""


def listed(seeds: int, first: int) -> dict[str, list[tuple[Spec, str]]]:
    """The cases of each group, each with the way the noise floor is had."""
    each, some = range(first, first + seeds), range(first, first + math.ceil(seeds / 5))
    half = range(first, first + math.ceil(seeds / 2))
    nulls = [Spec("null", seed=20 * s + k, protocol=p) for s in each for k, p in enumerate(_mix())]
    singles = [Spec("single", e, size, s) for s in each for size in SIZES for e in SHEATH_EFFECTS]
    both = [
        Spec("chain", f"{m}:{e}", 3.0, s)
        for s in some
        for m, names in (("motor", MOTOR_EFFECTS), ("sheath", SHEATH_EFFECTS))
        for e in names
    ]
    motor = {
        g: [Spec(g, e, size, s) for s in half for size in (1.0, 10.0) for e in MOTOR_EFFECTS]
        + [Spec(g, "none", seed=s) for s in each]
        for g in ("motor_open", "motor_closed")
    }
    made = {
        "null": nulls,
        "single": singles,
        "two": [Spec("two", seed=4 * s + k) for s in each for k in range(4)],
        "outside": [Spec("outside", e, size, s) for s in each for size in (1.0, 3.0) for e in OUTSIDE],
        "shape": [Spec("shape", seed=2 * s + k) for s in each for k in range(2)],
        "base_line": [Spec("base_line", size=size, seed=s) for s in each for size in (1.0, 10.0)],
        "front": [Spec("front", "backlash", size, s) for s in each for size in (0.3, 1.0, 10.0)],
        "poor": [Spec("poor", e, 1.0, s, p) for s in some for p in ("paper", "sine") for e in SHEATH_EFFECTS],
        "unexcited": [Spec("unexcited", e, seed=s) for s in each for e in UNEXCITED],
        **motor,
        "chain": [*both, *(Spec("chain", "none", seed=s) for s in each)],
        "sensor": [Spec("sensor", e, 3.0, s) for s in half for e in SENSOR_FAULTS],
    }
    found = {group: [(spec, GIVEN) for spec in specs] for group, specs in made.items()}
    found["null"] += [(spec, FOUND) for spec in nulls[::5]]
    found["single"] += [(spec, FOUND) for spec in singles if spec.size == 1.0][:: 1 if seeds == 1 else 5]
    return found


def _mix() -> list[str]:
    return ["rich"] * 8 + ["paper"] * 6 + ["sine"] * 6


def key_of(spec: Spec, floor: str) -> str:
    """What tells cases apart in the file of results."""
    return "|".join(str(v) for v in (*asdict(spec).values(), floor))


def batches(wanted: list[tuple[Spec, str]], size: int = 6) -> list[list[tuple[Spec, str]]]:
    """Cases of one kind are cheaper to make side by side; small batches keep both workers busy to the end."""
    kinds: dict[tuple[str, str, str], list[tuple[Spec, str]]] = {}
    for spec, floor in wanted:
        kinds.setdefault((spec.group, spec.effect, spec.protocol), []).append((spec, floor))
    return [some[k : k + size] for some in kinds.values() for k in range(0, len(some), size)]


def worked(batch: list[tuple[Spec, str]], tell: Any, baselines: bool) -> None:
    """Make the cases of a batch, diagnose each and hand over what is kept of it."""
    warnings.filterwarnings("ignore")
    for (spec, floor), case in zip(batch, cases([spec for spec, _ in batch]), strict=True):
        tell(row_of(spec, floor, case, baselines))


def row_of(spec: Spec, floor: str, case: Case, baselines: bool) -> dict[str, Any]:
    """Everything that the tables need of one case; a case that fails says why."""
    row = {
        "key": key_of(spec, floor),
        "spec": asdict(replace(spec, effect=case.effect)),
        "floor": floor,
        "truth": case.truth,
        "families": case.families,
        "at": case.segment,
        "protocol": case.protocol,
        "excess": excess_of(case),
        "excesses": {k: v for k, v in case.numbers.items() if "excess" in k},
        "samples": sum(len(e["t"]) for e in case.experiments.values()),
    }
    began = time.perf_counter()
    try:
        found = diagnosed(case, noise_floor="given" if floor == GIVEN else None)
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({at.name}, line {at.lineno})"
        return row | {"error": told, "trace": traceback.format_exc(), "seconds": time.perf_counter() - began}
    row |= {"seconds": time.perf_counter() - began} | said(found, case)
    if baselines and len(found.segments) == 1 and case.base.startswith("tendon"):
        from hidden_baselines import baseline

        row["baselines"] = baseline(found.segments[0])
    return row


def excess_of(case: Case) -> float:
    """How much there is to be seen: with the base refitted, where the generator knows."""
    numbers = case.numbers
    return float(numbers.get("excess_refit", numbers.get("excess", 0.0)))


def said(found: Any, case: Case) -> dict[str, Any]:
    """What is kept of a diagnosis."""
    worst = found.worst
    fitted = [r for r in worst.ranking if r.round == 1 and r.fitted]
    scale = worst.noise_floor[worst.outputs[0]] / worst.gaps[0].noise_floor
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "effects": [
            {
                "name": e.name,
                "family": e.family,
                "segment": e.segment,
                "wire": e.wire,
                "also": e.also_possible,
                "share": e.share_removed,
            }
            for e in found.effects
        ],
        "held_out": (worst.gaps[0].held_out[0], worst.gaps[0].held_out[-1], worst.gaps[0].noise_floor),
        "gain": max((r.gain for r in fitted), default=0.0) * scale,
        "line": max((r.line for r in fitted), default=0.0),
        "top": [(r.name, round(r.gain, 4), round(r.share, 3), round(r.t, 1)) for r in fitted[:4]],
        "segments": {s.name: {"verdict": s.verdict, "excess": s.excess} for s in found.segments},
        "bic": _bic(worst),
        "covered": _covered(found, case),
    }


def _bic(segment: Any) -> str:
    """What BIC with every sample counted as independent would name, on held-out losses; empty for nothing.

    Losses held out are in its favour: on those of the fit itself it would name still more.
    """
    samples = sum(len(t.t) for t in segment.traces)
    before = 1 + segment.excess
    best, named = 0.0, ""
    for r in segment.ranking:
        after = before - r.gain
        if r.round > 1 or not r.fitted or after <= 0:
            continue
        fall = samples * np.log(before / after) - len(r.parameters) * np.log(samples)
        if fall > best:
            best, named = fall, r.name
    return named


def _covered(found: Any, case: Case) -> bool | None:
    """Whether the interval of the effect named holds the truth; None where the forms are not the same."""
    if len(case.truth) != 1 or len(found.effects) != 1 or found.effects[0].name != case.truth[0]:
        return None
    name = case.truth[0]
    parameter, scale = MATCHED.get(name, ("", 1.0))
    quantity = found.effects[0].parameters.get(parameter)
    if quantity is None:
        return None
    size = scale * abs(case.numbers[f"{name}.amplitude"])
    return bool(min(abs(quantity.low), abs(quantity.high)) <= size <= max(abs(quantity.low), abs(quantity.high)))
