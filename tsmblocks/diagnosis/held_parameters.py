"""Problems in which some of the unknowns are held."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.fitting.residuals import Problem

HELD_WITHIN = 1e-9
"""Relative half width of the bounds of an unknown that is held. Chosen: no output changes by as much as its noise."""


def with_held(problem: Problem, theta: np.ndarray, held: np.ndarray) -> Problem:
    """The problem with the unknowns that are ``held`` (n,) at their values in ``theta`` (n,).

    Their bounds have an inside, so that an optimisation may begin there.
    """
    items = list(problem.unknowns.items)
    for k in np.flatnonzero(held):
        value = float(theta[k])
        width = HELD_WITHIN * max(abs(value), HELD_WITHIN)
        items[k] = attrs.evolve(items[k], start=value, low=value - width, high=value + width)
    return problem.with_items(items)
