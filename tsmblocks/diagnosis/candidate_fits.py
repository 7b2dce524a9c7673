"""Fits of candidates: starts known from a model with other effects, and a finer step where derivatives fail."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import Shrinkage, fitted_candidate
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.held_parameters import with_held
from tsmblocks.diagnosis.measured_position import in_own_names
from tsmblocks.diagnosis.model import FINE_TOLERANCE, Model, ModelSettings, optimized
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.step_size import halved

Fitted = Callable[[Problem, Setup, np.ndarray], Model]
"""A fit of a problem from a start."""

MOST_HALVINGS = 2
"""Times that the step of a candidate is halved, at most. Chosen: for the run time."""
FAILED_RATIO = 2.0
"""Held-out loss over that of the base from which a candidate that fits better than the base has failed. Chosen: a few
parameters that overfit lose far less."""
MAX_STEP_SHARE = 0.01
"""Mean square of what halving a given step changes, over that of the residual, up to which a candidate may be named.
Chosen: effects that the step suits change by less than 1e-6 of it."""
MAX_STEP_RATIO = 2.0
"""The same over that of the base, which the same step may not suit either. Chosen."""


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
        if (half := halved(finer.model.problem, finer.model.setup)) is None:
            return one
        model = optimized(*half, finer.model.theta, FINE_TOLERANCE)
        finer = fitted_candidate(one.candidate, model, blocks, shrinkage, one.untenable)
        if finer.loss <= FAILED_RATIO * base_loss:
            return finer
    return one


def depends_on_given_step(fitted: Model, base: Model, settings: ModelSettings) -> bool:
    """Whether halving a step that was given changes the residual of a candidate visibly, and more than the base's.

    A part too stiff for the step, as a hard stop, is unstable where it acts: what it removes is no property of it.
    Without a given step the model with the effect is fitted at a sufficient one.
    """
    if settings.step is None:
        return False
    change = _change_by_halving(fitted)
    visible = not change <= max(1.0, MAX_STEP_SHARE * fitted.mean_square)
    return visible and not change <= MAX_STEP_RATIO * _change_by_halving(base)


def _change_by_halving(model: Model) -> float:
    """Mean square of what halving the step changes in the residual of a model [noise variances]."""
    if (half := halved(model.problem, model.setup)) is None:
        return 0.0
    return float(np.mean((half[0].residuals(model.theta) - model.r) ** 2))


def starts_of_fit(score: ScreeningScore, known: FittedCandidate | None, fitted: Fitted) -> list[np.ndarray]:
    """The starts of a candidate's fit, with those where fits end that hold some of its parameters.

    They are those of its screening, those at which it ends over a measured position, and that which is ``known``.
    """
    starts = [*score.starts, *_starts_at_measured_position(score, fitted)]
    held = [_with_first_held(score, start, fitted) for start in starts] if score.candidate.trials.held_first else []
    return [*starts, *held, *known_starts(score, known)]


def _with_first_held(score: ScreeningScore, start: np.ndarray, fitted: Fitted) -> np.ndarray:
    """Where a fit of a candidate ends that holds some of its parameters."""
    names = {f"{score.candidate.block}.{name}" for name in score.candidate.trials.held_first}
    held = np.array([item.parameter in names for item in score.problem.unknowns.items])
    return fitted(with_held(score.problem, start, held), score.setup, start).theta


def _starts_at_measured_position(score: ScreeningScore, fitted: Fitted) -> list[np.ndarray]:
    """Starts of a candidate's fit where fits over a measured position end, if it was screened there as well."""
    there = score.at_measured_position
    if there is None:
        return []
    found = [fitted(there.problem, there.setup, start).values for start in there.starts]
    ends = [in_own_names(one, there.candidate, score.candidate) for one in found]
    pairs = list(zip(score.problem.unknowns.names, score.starts[0], strict=True))
    return [np.array([end.get(name, value) for name, value in pairs]) for end in ends]


def known_starts(score: ScreeningScore, known: FittedCandidate | None) -> list[np.ndarray]:
    """The start of a candidate's fit at the parameters of the same effect in a model with other effects, if known."""
    if known is None or known.candidate.effect.name != score.candidate.effect.name:
        return []
    return [start_at(score, known.candidate, known.model)]


def start_at(score: ScreeningScore, other: Candidate, model: Model) -> np.ndarray:
    """The start of a candidate's fit where a model ended with ``other``, an effect of the same name."""
    values, there, here = model.values, f"{other.block}.", f"{score.candidate.block}."
    names = [item.name for item in score.problem.unknowns.items]
    same = [there + name.removeprefix(here) if name.startswith(here) else name for name in names]
    return np.array([values.get(k, value) for k, value in zip(same, score.starts[0], strict=True)])
