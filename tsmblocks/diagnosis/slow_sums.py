"""Sums of squares of the slow part of a residual, beside which effects that change the outputs slowly are judged.

White noise is most of a residual and tells nothing of what is slow: beside all of it, a step that explains all that is
slow looks no better than one that explains a part of slow noise. So does a ripple of the force behind which a motor
comes to rest elsewhere.
"""

from __future__ import annotations

import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import rows_of_experiments
from tsmblocks.fitting.inner_products import square

BLOCKS = 100
"""Averages of a residual in each experiment that hold its slow part. Chosen: steps and slopes are slower, and of white
noise in thousands of samples next to nothing is left."""
SLOWEST_BLOCKS = 10
"""Averages of a residual in each experiment that hold its slowest part. Chosen: an effect of time lasts for tenths of a
recording, and of noise that is slow but shorter little is left."""
SLOW_SHARE = 0.9
"""Share of the square of a change of the outputs in its averages from which it is slow. Chosen: a step within one of
them loses less."""


def slow_sums(model: Model, columns: np.ndarray, blocks: int = BLOCKS) -> np.ndarray:
    """The sum of squares of the slow part of residuals (N, D), shape (D,): of averages over so many blocks."""
    total = np.zeros(columns.shape[1])
    for output in range(len(model.setup.outputs)):
        for rows in rows_of_experiments(model, output).values():
            part = columns[rows].astype(float)
            first = np.arange(0, len(part), max(1, len(part) // blocks))
            lengths = np.diff(np.append(first, len(part)))
            total += np.sum(np.add.reduceat(part, first, axis=0) ** 2 / lengths[:, None], axis=0)
    return total


def explains_slowest(fitted: Model, base: Model) -> bool:
    """Whether a model with one slow function of time more explains half of the slowest part of a residual.

    Else the residual that remains wanders more than the effect does, and the effect is a part of that.
    """
    before, after = (float(slow_sums(one, one.r[:, None], SLOWEST_BLOCKS)[0]) for one in (base, fitted))
    return after <= before / 2


def is_slow(model: Model, change: np.ndarray) -> bool:
    """Whether a change of the outputs (N,) is slow."""
    return float(slow_sums(model, change[:, None])[0]) >= SLOW_SHARE * square(change) > 0
