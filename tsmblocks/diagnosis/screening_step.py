"""The step at which candidates are screened: longer than that of the fits, where that makes many steps."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.diagnosis.model import Model

MAX_STEPS = 100_000
"""Steps of all experiments up to which candidates are screened at the step of the model. Chosen: for the run time."""
MAX_ERROR = 1e-3
"""Mean square of the error by a longer step, relative to that of the measured signal about its mean, at most. Chosen:
3 % in amplitude. A screening score compares two simulations at one step, and its error is common to both."""


def screening_model(model: Model) -> Model:
    """The model simulated in longer steps, experiment by experiment, where its own steps are many.

    Its residuals are those at these steps: the change of the outputs by a candidate is the difference from them.
    """
    setup, problem = model.setup, model.problem
    if sum(one.times.steps for one in setup.experiments) <= MAX_STEPS:
        return model
    experiments = list(setup.experiments)
    for e, rows in enumerate(problem.rows):
        allowed = MAX_ERROR * _mean_square_measured(model, e)
        while 2 * experiments[e].times.h <= experiments[e].record.step * (1 + 1e-9):
            try:
                longer = setup.prepared(e, step=2 * experiments[e].times.h)
            except RunError:  # a sample period of a block that this step does not divide
                break
            tried = attrs.evolve(problem, experiments=(*experiments[:e], longer, *experiments[e + 1 :]))
            with np.errstate(over="ignore", invalid="ignore"):
                error = float(np.mean((tried.residuals(model.theta)[rows] - model.r[rows]) ** 2))
            if not error <= allowed:
                break
            experiments[e] = longer
    problem = attrs.evolve(problem, experiments=tuple(experiments))
    setup = attrs.evolve(setup, experiments=problem.experiments, finer=())
    return attrs.evolve(model, problem=problem, setup=setup, r=problem.residuals(model.theta))


def _mean_square_measured(model: Model, e: int) -> float:
    """Mean square of the measured outputs of an experiment about their means, in the weights of the problem."""
    measured = model.problem.experiments[e].measured
    return float(np.mean(np.square(np.asarray(model.problem.weights) * (measured - measured.mean(axis=0)))))
