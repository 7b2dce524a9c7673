"""Shapes of a candidate that were tried, and where its fit starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.fitting.column_space import ColumnSpace
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.residuals import Problem

PINNING_WIDTHS = 10.0
"""Half width [transition times] of the bounds of a refined instant in its fit. Chosen: derivatives lead no farther."""
SECOND_START_TRIALS = 8
"""Next best shapes among which a second starting point is selected. Chosen."""
MAX_SQUARED_CORRELATION = 0.8
"""Squared correlation of two output changes below which two shapes are different starting points. Chosen."""


@attrs.frozen(eq=False)
class ShapeTrial:
    """One shape: the predicted fall of the sum of squares, and the unknowns there.

    ``output_change`` (N,) is the change of the outputs, ``sensitivity`` its sum of squares at the trial size with base
    parameters projected out, zero where these absorb it. ``exceeds_range`` is True where the trial size moves an output
    beyond its recorded range, as a loop does that diverges. ``theta_base_fixed`` are the unknowns with the base
    parameters unchanged, ``absorbed_by`` the moves of those that absorb it; ``noise_gains`` (D,) the gains in
    surrogates of the residual, where these were given.
    """

    gain: float
    theta: np.ndarray
    shape: Mapping[str, float]
    output_change: np.ndarray
    sensitivity: float
    exceeds_range: bool
    theta_base_fixed: np.ndarray
    absorbed_by: Mapping[str, float] = attrs.field(factory=dict)
    noise_gains: np.ndarray = attrs.field(factory=lambda: np.zeros(0))


def fit_starts(
    problem: Problem, candidate: Candidate, shapes: Sequence[ShapeTrial], base: ColumnSpace
) -> tuple[Problem, list[np.ndarray]]:
    """The problem of a candidate's fit and its starting points: the best shape, and a different one."""
    ordered = sorted(shapes, key=lambda one: -one.gain)
    best = ordered[0]
    if candidate.trials.refine:
        return with_narrow_bounds(problem, candidate, best.theta), [_better_start(problem, best)]
    distinct = (one for one in ordered[1:SECOND_START_TRIALS] if _is_distinct(one, best, base))
    return problem, [_better_start(problem, one) for one in [best, *distinct][:2]]


def _better_start(problem: Problem, one: ShapeTrial) -> np.ndarray:
    """The starting point with the lower cost: base parameters moved as their derivatives predict, or unchanged."""
    shifted, base_fixed = problem.costs(np.stack([one.theta, one.theta_base_fixed]), quick=True)
    return one.theta_base_fixed if not shifted <= base_fixed else one.theta


def with_narrow_bounds(problem: Problem, candidate: Candidate, theta: np.ndarray) -> Problem:
    """The problem with bounds on a refined shape close to its values: the problem is nonsmooth in it."""
    items, distance = list(problem.unknowns.items), PINNING_WIDTHS * candidate.transition_time
    instants = {f"{candidate.block}.{name}": name for name in candidate.trials.refine}
    for k, item in enumerate(items):
        if item.parameter in instants:
            least, most = candidate.trials.bounds.get(instants[item.parameter], (None, None))
            low, high = -np.inf if least is None else least, np.inf if most is None else most
            value = float(theta[k])
            items[k] = attrs.evolve(item, low=max(value - distance, low), high=min(value + distance, high))
    return problem.with_items(items)


def _is_distinct(one: ShapeTrial, best: ShapeTrial, base: ColumnSpace) -> bool:
    """Whether two shapes are different starting points: their output changes are not strongly correlated."""
    a, b = base.project_out(np.stack([one.output_change, best.output_change], axis=1)).T
    return float(np.einsum("i,i->", a, b)) ** 2 < MAX_SQUARED_CORRELATION * square(a) * square(b)
