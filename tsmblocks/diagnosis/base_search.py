"""Whether the base explains a named effect's gain: a search of the base from the parameters of the model with it."""

from __future__ import annotations

import numpy as np

from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.model import Model, converged, nearest, optimized
from tsmblocks.diagnosis.partition import ROUGH_ERROR

LARGER_PART = 0.5
"""Share of the mean square of a rough base that a better one removes at least. Chosen: candidates are fitted from the
parameters of the diagram there as well, and a round takes long."""


def better_base(base: Model, named: FittedCandidate, noise_variance: float) -> Model | None:
    """The base where a search from the parameters beside a named effect leaves materially less; else None.

    The search of the base may have ended in another minimum, at a bound or at the limit of its step. What an effect
    explains is then counted from the better base.
    """
    beside = named.model.values
    names = base.problem.unknowns.names
    start = np.array([beside.get(name, value) for name, value in zip(names, base.theta, strict=True)])
    if np.array_equal(start, base.theta) or not np.isfinite(base.problem.cost(start)):
        return None
    found = optimized(base.problem, base.setup, start, coarse=False)
    rough = base.mean_square > ROUGH_ERROR
    material = LARGER_PART * base.mean_square if rough else MIN_VARIANCE_REDUCTION * noise_variance
    if found.mean_square > base.mean_square - material:
        return None
    return nearest(refine_memories(converged(found)))
