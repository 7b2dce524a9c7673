"""Outliers of a residual: single samples far off their neighbours, which are wrong readings or short events."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsmblocks.data.quantization import quantum_of
from tsmblocks.data.table import plural
from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.inner_products import square

FARTHEST = 6.0
"""Distance from the median that is an outlier [median distance]. Chosen: four standard deviations of a normal one."""
MIN_SHARE = 0.1
"""Share of the sum of squares from which outliers are reported. Chosen: less hardly changes a residual's rms."""


MIN_QUANTA = 3.0
"""Distance of an outlier of a quantised output [quanta], at least. Chosen: where its noise is smaller than a quantum,
most readings are the same, and their median distance is none of the noise."""


def without_outliers(r: np.ndarray, least: float = 0.0) -> np.ndarray:
    """A residual (n,) with what is farther out moved to the farthest distance of no outlier, ``least`` at least."""
    middle = np.median(r)
    most = max(FARTHEST * np.median(np.abs(r - middle)), least)
    return np.clip(r, middle - most, middle + most) if most > 0 else r


def isolated_outliers(r: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Which samples of a residual (n,) are outliers between two that are none; bursts of noise are longer."""
    out = without_outliers(r, least) != r
    beside = np.concatenate([[False], out, [False]])
    return out & ~beside[:-2] & ~beside[2:]


def outlier_notes(model: Model) -> list[str]:
    """A note on each output whose residual has outliers that hold much of its mean square."""
    notes, outputs = list[str](), model.setup.outputs
    for k, name in enumerate(outputs):
        own = list(zip(model.setup.experiments, model.problem.segments[k :: len(outputs)], strict=True))
        parts, share = [model.r[rows] for _, rows in own], reported_share(model, k)
        if not share:
            continue
        where = [isolated_outliers(r, _least(model, k)) for r in parts]
        count, samples = sum(int(at.sum()) for at in where), sum(len(r) for r in parts)
        most = int(np.argmax([np.abs(r[at]).max(initial=0.0) for r, at in zip(parts, where, strict=True)]))
        largest = int(np.argmax(np.where(where[most], np.abs(parts[most]), 0.0)))
        experiment = own[most][0]
        notes.append(
            f"{plural(count, 'sample')} of {name} ({100 * count / samples:.2g} %) with {100 * share:.0f} % of the "
            f"residual's mean square {'is an outlier' if count == 1 else 'are outliers'}, the largest at t = "
            f"{experiment.t[largest]:.6g} s of {experiment.name}: wrong readings, or short events."
        )
    return notes


def reported_share(model: Model, k: int) -> float:
    """Share of the mean square of the residual of output ``k`` that outliers hold; 0 where that is little."""
    parts = [model.r[rows] for rows in model.problem.segments[k :: len(model.setup.outputs)]]
    share = share_of_outliers(parts, _least(model, k))
    return share if share >= MIN_SHARE else 0.0


def _least(model: Model, k: int) -> float:
    """The distance of an outlier of output ``k``, at least [noise rms]: some quanta of its readings."""
    quanta = [quantum_of(one.measured[:, k]) or 0.0 for one in model.setup.experiments]
    return MIN_QUANTA * min(quanta) * float(model.problem.weights[k])


def share_of_outliers(parts: Sequence[np.ndarray], least: float = 0.0) -> float:
    """Share of the sum of squares of some residuals that isolated outliers hold."""
    held = sum(square(r[isolated_outliers(r, least)]) for r in parts)
    return held / max(sum(square(r) for r in parts), 1e-300)
