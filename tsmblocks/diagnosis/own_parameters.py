"""A second starting point of a search: the diagram's own parameters, where the base is far from the measurements."""

from __future__ import annotations

import numpy as np

from tsmblocks.diagnosis.credibility import far_from, with_a_scale
from tsmblocks.diagnosis.held_parameters import with_held
from tsmblocks.diagnosis.model import Model, end_at, model_at, optimized

FAR_ERROR = 1e3
"""Mean square [noise variances] of a base from which fits start at the diagram's own parameters as well. Chosen: beside
an error of 30 times the noise, the stiffness of a shaft with a gap was fitted at half of its value."""


def is_rough(model: Model) -> bool:
    """Whether a base is so far from the measurements that its parameters say little."""
    return model.mean_square > FAR_ERROR


def at_own_parameters(model: Model) -> Model | None:
    """A base with the parameters of the diagram, of which initial states alone are fitted.

    None where the base is near the measurements with parameters near the diagram's, or the parameters of the diagram do
    not simulate. Parameters that were fitted without a large effect compensate for it, and from those no fit with the
    effect may arrive at its optimum.
    """
    if not (is_rough(model) or _has_moved_far(model)):
        return None
    unknowns = model.problem.unknowns
    held = with_held(model.problem, unknowns.start, ~unknowns.is_local)
    starts = (unknowns.start, np.where(unknowns.is_local, model.theta, unknowns.start))
    costs = [model.problem.cost(start) for start in starts]
    best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
    if not np.isfinite(costs[best]):
        return None
    theta = optimized(held, model.setup, starts[best]).theta
    return model_at(model.problem, model.setup, end_at(model.problem, theta))


def _has_moved_far(model: Model) -> bool:
    """Whether a parameter was fitted to several times the diagram's, or changed its sign."""
    starts = {one.parameter: one.start for one in model.problem.unknowns.items if not one.experiment}
    return bool(far_from(model, with_a_scale(starts)))
