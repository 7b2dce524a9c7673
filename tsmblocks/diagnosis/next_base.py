"""The model of the next round: with the effect that was named, at its optimum and at a sufficient step."""

from __future__ import annotations

from tsmblocks.diagnosis.decision import Shrinkage, shrinkage_of
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.model import Model, ModelSettings, converged, nearest, with_accurate_step, with_sufficient_step
from tsmblocks.diagnosis.partition import ROUGH_ERROR

LEAST_IMPROVEMENT = 0.9
"""Mean square after an optimisation beside a rough residual over that before, up to which it is repeated. Chosen: dry
friction has many small steps downhill. Near the noise a fall by one variance of the residual counts."""
NEAR_NOISE = 4.0
"""Mean square [noise variances] up to which a residual is near the noise. Chosen: an error of twice the noise."""


def next_base(named: FittedCandidate, shrinkage: Shrinkage, settings: ModelSettings) -> tuple[Model, Shrinkage]:
    """The base of the next round, and the shrinkage of the effects in it."""
    return at_optimum(named.model, settings), {**shrinkage, **shrinkage_of(named.candidate)}


def at_optimum(model: Model, settings: ModelSettings) -> Model:
    """The model optimised at a sufficient step, with the parameters nearest to where its search began.

    That is repeated while it helps, where the residual is rough or near the noise: near the noise memories that moved
    open further descents.
    """
    error = float("inf")
    while model.mean_square < _enough(model, error) * error:
        error = model.mean_square
        model = refine_memories(with_accurate_step(with_sufficient_step(converged(model), settings), settings))
        if NEAR_NOISE < error <= ROUGH_ERROR:
            break
    return nearest(model)


def _enough(model: Model, error: float) -> float:
    """The mean square over that before, ``error``, up to which an optimisation is repeated."""
    return 1 - 1 / len(model.r) if error <= NEAR_NOISE else LEAST_IMPROVEMENT
