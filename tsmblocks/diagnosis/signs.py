"""A base whose parameters have the signs of the diagram, where others describe the recordings as well."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsmblocks.common.errors import TsmError
from tsmblocks.diagnosis.model import Model, optimized

MAX_RISE = 0.01
"""Relative rise of the mean square up to which the fit with the signs of the diagram is taken. Chosen: within noise."""


def with_signs(model: Model, parameters: Mapping[str, float]) -> Model:
    """The model, or one as good in which no gain has another sign than in the diagram.

    Two gains in a row may change their signs together, and so may all of a loop, as a spring that pulls on a mass of
    the other sign. The outputs do not show it, and effects that have a sign, such as friction, would not fit there.
    ``parameters`` are those of the diagram.
    """
    items = model.problem.unknowns.items
    before = np.array([parameters.get(one.parameter, 0.0) if not one.experiment else 0.0 for one in items])
    flipped = before * model.theta < 0
    if not any(flag and one.parameter.endswith(".gain") for flag, one in zip(flipped, items, strict=True)):
        return model
    try:
        other = optimized(model.problem, model.setup, np.where(flipped, -model.theta, model.theta))
    except TsmError:  # it cannot be simulated there
        return model
    as_good = other.mean_square <= (1 + MAX_RISE) * model.mean_square
    return other if as_good and (before * other.theta < 0).sum() < flipped.sum() else model
