"""The model of the next round: with the effect that was named, at its optimum and at a sufficient step."""

from __future__ import annotations

from collections.abc import Collection

import attrs

from tsmblocks.diagnosis.decision import Shrinkage, shrinkage_of
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.initial_states import refine_memories
from tsmblocks.diagnosis.model import (
    Model,
    ModelSettings,
    converged,
    end_at,
    model_at,
    nearest,
    with_accurate_step,
    with_sufficient_step,
)
from tsmblocks.diagnosis.partition import ROUGH_ERROR
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import FINEST, Setup
from tsmblocks.fitting.step_size import halved

LEAST_IMPROVEMENT = 0.9
"""Mean square after an optimisation beside a rough residual over that before, up to which it is repeated. Chosen: dry
friction has many small steps downhill. Near the noise a fall by one variance of the residual counts."""
SHARPER, MOST_SHARPENED = 5.0, 2
"""By how much the bound of a smoothing is lowered, and how often. Chosen: each needs steps about as much shorter."""
HALVINGS = 3
"""How often the step is halved for a sharper corner. Chosen: beside it the motion is as much faster."""
MOST_STEPS = 0.75 * FINEST
"""Steps between two samples from which they are not halved for a sharper corner. Chosen: for the run time."""
MOST_IN_ALL = 500_000
"""Steps of all experiments up to which they are halved for it. Chosen: for the run time."""
NEAR_BOUND = 1.05
"""Value of a smoothing over its bound up to which it ended there. Chosen: its effect is next to linear in it."""
NEAR_NOISE = 4.0
"""Mean square [noise variances] up to which a residual is near the noise. Chosen: an error of twice the noise."""


def next_base(named: FittedCandidate, shrinkage: Shrinkage, settings: ModelSettings) -> tuple[Model, Shrinkage]:
    """The base of the next round, and the shrinkage of the effects in it."""
    model = at_optimum(named.model, settings)
    if corners := named.candidate.corners:
        model = sharpened(model, corners, settings)
    return model, {**shrinkage, **shrinkage_of(named.candidate)}


def sharpened(model: Model, corners: Collection[str], settings: ModelSettings) -> Model:
    """The model with ``corners`` (full names of parameters that smooth them) as sharp as the data ask for.

    The bound of a smoothing keeps the step of the candidates long. Where the fit ends there, and leaves less with a
    sharper corner at the step that this needs, the bound gives way: the creep of a smooth corner, where the mechanism
    sticks, would else be named as a further effect.
    """
    for _ in range(MOST_SHARPENED):
        items, theta = list(model.problem.unknowns.items), model.theta.copy()
        at = [k for k, item in enumerate(items) if item.parameter in corners and theta[k] <= NEAR_BOUND * item.low]
        if not at or (fine := _at_finer_step(model, settings)) is None:
            break
        for k in at:
            items[k] = attrs.evolve(items[k], low=items[k].low / SHARPER)
            theta[k] = NEAR_BOUND * items[k].low
        problem, setup = fine[0].with_items(items), fine[1]
        sharper = at_optimum(model_at(problem, setup, end_at(problem, theta)), settings)
        if not sharper.mean_square < _enough(model, model.mean_square) * model.mean_square:
            break
        model = sharper
    return model


def _at_finer_step(model: Model, settings: ModelSettings) -> tuple[Problem, Setup] | None:
    """The problem of a model at the step that a sharper corner needs, or nearer to it; None where none is finer."""
    if settings.step is not None:
        return None
    found, setup = None, model.setup
    for _ in range(HALVINGS):
        fine = any(e.record.step > MOST_STEPS * e.times.h for e in setup.experiments)
        if fine or 2 * sum(e.times.steps for e in setup.experiments) > MOST_IN_ALL:
            break
        if (half := halved(*(found or (model.problem, setup)))) is None:
            break
        found, setup = half, half[1]
    return found


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
