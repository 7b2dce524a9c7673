"""Fits of candidates: starts known from a model with other effects, and a finer step where derivatives fail."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import Shrinkage, fitted_candidate
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.model import FINE_TOLERANCE, optimized
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.fitting.step_size import halved

MOST_HALVINGS = 2
"""Times that the step of a candidate is halved, at most. Chosen: for the run time."""
FAILED_RATIO = 2.0
"""Held-out loss over that of the base from which a candidate that fits better than the base has failed. Chosen: a few
parameters that overfit lose far less."""


def at_sufficient_step(
    one: FittedCandidate, base_loss: float, base_mean_square: float, blocks: TimeBlocks, shrinkage: Shrinkage
) -> FittedCandidate:
    """The candidate fitted at a finer step where its held-out loss has failed and a finer step mends it.

    A state that is too fast for the step where the motion is fast (Dahl's law over a small distance) diverges there. An
    output that hardly depends on it is still right, its derivatives are not, and losses on held-out data follow from
    these.
    """
    if not (one.loss > FAILED_RATIO * base_loss and one.model.mean_square < base_mean_square):
        return one
    finer = one
    for _ in range(MOST_HALVINGS):
        try:
            problem, setup = halved(finer.model.problem, finer.model.setup)
        except RunError:  # more steps than fit into memory
            return one
        model = optimized(problem, setup, finer.model.theta, FINE_TOLERANCE)
        finer = fitted_candidate(one.candidate, model, blocks, shrinkage, one.untenable)
        if finer.loss <= FAILED_RATIO * base_loss:
            return finer
    return one


def known_starts(score: ScreeningScore, known: FittedCandidate | None) -> list[np.ndarray]:
    """The start of a candidate's fit at the parameters of the same effect in a model with other effects, if known."""
    if known is None or known.candidate.effect.name != score.candidate.effect.name:
        return []
    values, there, here = known.model.values, f"{known.candidate.block}.", f"{score.candidate.block}."
    names = [item.name for item in score.problem.unknowns.items]
    same = [there + name.removeprefix(here) if name.startswith(here) else name for name in names]
    return [np.array([values.get(k, value) for k, value in zip(same, score.starts[0], strict=True)])]
