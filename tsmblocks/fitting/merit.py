"""Which of two places is better, where costs may be missing and constraints may be missed.

The rules are those of Deb (2000): a place that meets the constraints beats one that does not; of two
that do not, the one that misses them by less; of two that do, the one of lower cost. A place without
a finite cost loses to every place that has one.
"""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.multistart import Box

Costs = Callable[[np.ndarray], np.ndarray]
"""Places (sets, unknowns) in, costs (sets,) out."""
Constraints = Callable[[np.ndarray], np.ndarray]
"""Places (sets, unknowns) in, by how much each constraint is missed (sets, constraints) out; met at 0 or less."""

MISSED, COST = 1, 2
"""Columns of merits; column 0 is 1 where there is no finite cost, else 0."""


@attrs.define(eq=False)
class Judge:
    """Gives merits, and counts what it was asked for.

    A merit is a row (no finite cost, sum of missed constraints, cost); of two places the better one
    has the lesser row, compared from the left. Source: Deb, Comput. Methods Appl. Mech. Engrg. 186
    (2000) 311.
    """

    box: Box
    cost: Costs
    constraints: Constraints | None = None
    evaluations: int = 0
    calls: int = 0

    def merits(self, shares: np.ndarray) -> np.ndarray:
        """Merits of places given as shares of the ranges, shape (sets, 3).

        Raises RunError when costs or constraints come in another number than the places.
        """
        thetas, count = self.box.thetas(shares), len(shares)
        costs = np.asarray(self.cost(thetas), dtype=float)
        if costs.shape != (count,):
            raise RunError(f"the cost must give one number per set, shape ({count},), got shape {costs.shape}.")
        missed = np.zeros(count)
        if self.constraints is not None:
            values = np.asarray(self.constraints(thetas), dtype=float)
            if values.ndim != 2 or len(values) != count:
                raise RunError(
                    f"the constraints must give one row per set, shape ({count}, constraints), "
                    f"got shape {values.shape}."
                )
            missed = np.where(np.isnan(values), np.inf, np.maximum(values, 0.0)).sum(axis=1)
        self.evaluations += count
        self.calls += 1
        finite = np.isfinite(costs)
        return np.column_stack([~finite, missed, np.where(finite, costs, np.inf)])


def ordered(merits: np.ndarray) -> np.ndarray:
    """Places in the order from best to worst; of equals the first comes first."""
    return np.lexsort(merits.T[::-1])
