"""The noise that no model can explain: that of the sensors, and what the noise of measured inputs does on its way."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.data.conditioning import conditioned
from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.trials import prepare

DRAWS = 1
"""Draws of input noise for each experiment; thousands of samples make one enough."""


def carried(model: Model, raw: Mapping[str, Record], inputs: Iterable[str], seed: int) -> float:
    """Mean square, in variances of the outputs' noise, of what the noise of measured inputs does to the outputs.

    The conditioned inputs are taken for the true motion; noise as strong as that which was filtered out, and as white,
    is put on them, they are conditioned again, and the model is simulated with both.
    """
    names, draw = tuple(inputs), np.random.default_rng(seed)
    total = count = 0.0
    for e, trial in enumerate(model.setup.trials):
        clean = trial.record
        noisy = _noisy(clean, raw[trial.name], names, draw)
        if noisy is None:
            continue
        again = conditioned(noisy, names)
        other = prepare(trial.name, again, model.diagram, model.setup.eq, outputs=model.setup.outputs, rule=trial.rule,
                        step=trial.times.h, hold=trial.hold, window=(trial.t[0], trial.t[-1]),
                        backend=trial.backend)  # fmt: skip
        p = model.problem.unknowns.parameters(model.theta, e)
        change = (other.outputs(p) - trial.outputs(p)) * model.problem.weights
        total += float(np.sum(np.where(np.isfinite(change), change, 0.0) ** 2))
        count += change.size
    return total / count if count else 0.0


def _noisy(clean: Record, raw: Record, names: tuple[str, ...], draw: np.random.Generator) -> Record | None:
    """A conditioned record with fresh noise on its inputs; None where nothing was filtered out."""
    raw = raw if raw.uniform else raw.resampled()
    signals, found = dict(clean.signals), False
    for name in names:
        if name not in clean or len(raw) != len(clean):
            continue
        size = _white(raw[name] - clean[name])
        if size > 0:
            signals[name] = clean[name] + size * draw.standard_normal(len(clean))
            found = True
    return attrs.evolve(clean, signals=signals) if found else None


def _white(removed: np.ndarray) -> float:
    """Rms of white noise whose fast part is as strong as what a filter removed: from the upper half of the spectrum."""
    power = np.abs(np.fft.rfft(removed - removed.mean())) ** 2 / len(removed)
    return float(np.sqrt(np.median(power[len(power) // 2 :]) / np.log(2.0)))
