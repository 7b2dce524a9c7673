"""The values nearest to the diagram's own of all that fit equally well: a search may end anywhere among these.

Some models have such directions by their structure (an offset behind a plant that has an offset), others with
what was recorded. The step along them is the shortest in parameters divided by their sizes; initial states do not count
there, since a diagram's own say nothing of a recording.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.identifiability import null_directions
from tsmblocks.fitting.optimizer import OptimizerResult, within_bounds
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.summary import active_constraints, natural_sizes, unknown_sizes

SUSPECT = 1e-9
"""Least eigenvalue, relative to the largest with all parameters scaled alike, below which there may be a null
direction. Chosen: far above rounding."""
SAME_COST = 1e-9
"""Relative rise of the cost that counts as none. Chosen: far below any standard error."""
ALIKE = 1e-6
"""Relative difference of the costs of two ends of searches that fit alike. Chosen: far above their tolerance."""
CLOSE = 1e-5
"""Step in sizes of the parameters below which the nearest values are reached. Chosen."""
MOST_MOVED = 2
"""Ends that are moved, those that are nearest before it. Chosen: for the run time."""
DIGITS = 6
"""Digits to which distances are compared: the first of those that are alike is taken. Chosen."""
MOST_STEPS = 20
"""Steps along null directions, which may be curved. Chosen."""
MOST_CUTS = 8
"""Times that a step is halved before it is given up. Chosen."""
HARDLY_COUNTED = 30.0
"""Size of a parameter that hardly counts [what changes the outputs by their own norm]. Chosen: coefficients cancel one
another by less."""
RETURNS = 8
"""Iterations back to the optimum after a step along a curved direction. Chosen: two or three suffice."""


def nearest_of(
    problem: Problem,
    setup: Setup,
    ends: Sequence[OptimizerResult],
    tolerance: float = 0.0,
    given: Mapping[str, float] | None = None,
) -> list[OptimizerResult]:
    """Ends of searches, best first, with the one first that is moved nearest to the diagram's own parameters.

    These are the ``given`` ones, and no others count; without them all at which the search began. Costs that differ by
    up to ``tolerance`` are alike. Where the best leaves no direction open, all stay as they are.
    """
    if given is not None:
        items = problem.unknowns.items
        problem = problem.with_items(attrs.evolve(one, start=given.get(one.parameter, one.start)) for one in items)
    best = ends[0]
    if best.plateau is not None or best.status == "interrupted" or not _may_be_open(problem, best.theta):
        return list(ends)
    least = best.cost + max(ALIKE * best.cost, problem.rounding, tolerance)
    same = {k: _with_own_factors(problem, setup, end) for k, end in enumerate(ends) if end.cost <= least}
    move = _Moves(problem, setup, _sizes(problem, same[0].theta, same[0].theta != best.theta), given)
    alike = sorted(same, key=lambda k: (round(move.distance(same[k].theta), DIGITS), k))[:MOST_MOVED]
    moved = {k: move.to_nearest(same[k]) for k in alike}
    first = min(alike, key=lambda k: (round(move.distance(moved[k].theta), DIGITS), k))
    return [moved[first], *(end for k, end in enumerate(ends) if k != first)]


def _may_be_open(problem: Problem, theta: np.ndarray) -> bool:
    """Whether there may be a null direction, from the matrix of the normal equations alone."""
    matrix = problem.normal(theta)[2]
    size = np.sqrt(np.diag(matrix))
    if not np.isfinite(matrix).all() or not (size > 0).all():
        return True
    values = np.linalg.eigvalsh(matrix / np.outer(size, size))
    return bool(values[0] <= SUSPECT * values[-1])


def _sizes(problem: Problem, theta: np.ndarray, scaled: np.ndarray) -> np.ndarray:
    """Size of each unknown where the search began.

    Those that are ``scaled`` (n,) and began at zero count next to nothing: they say nothing of a common factor.
    """
    jacobian = problem.jacobian(theta)[1]
    sizes = unknown_sizes(problem, problem.unknowns.start, jacobian)
    return np.where(scaled, np.maximum(sizes, HARDLY_COUNTED * natural_sizes(problem, jacobian)), sizes)


def _with_own_factors(problem: Problem, setup: Setup, end: OptimizerResult) -> OptimizerResult:
    """The end with the parameters of blocks with a free common factor brought to the size of the diagram's own.

    So have the coefficients of a transfer function. Steps would shrink those to nothing of which some are zero in the
    diagram: these are nearest to it there.
    """
    known, start, theta = numbers(setup.diagram), problem.unknowns.start, end.theta
    blocks: dict[str, list[int]] = {}
    for k, item in enumerate(problem.unknowns.items):
        if not is_start(known[item.parameter]):
            blocks.setdefault(item.parameter.partition(".")[0], []).append(k)
    for own in blocks.values():
        ratios = theta[own][start[own] != 0] / start[own][start[own] != 0]
        if 0 < len(ratios) < len(own) and (square := float(ratios @ ratios)) > 0:
            factor = float(ratios.sum()) / square
            scaled = theta.copy()
            scaled[own] *= factor
            if factor and np.array_equal(scaled, within_bounds(problem, scaled)):
                theta = scaled if _is_as_good(problem, scaled, end.cost) else theta
    return end if theta is end.theta else attrs.evolve(end, theta=theta)


def _is_as_good(problem: Problem, theta: np.ndarray, cost: float) -> bool:
    """Whether the cost does not rise above that of an end of a search."""
    return problem.violation(theta) <= 0 and problem.cost(theta) <= (1 + SAME_COST) * cost + problem.rounding


@attrs.define(eq=False)
class _Moves:
    """Moves of the unknowns of a problem along null directions."""

    problem: Problem
    setup: Setup
    scales: np.ndarray
    """Size of each unknown where the search began, shape (n,)."""
    given: Collection[str] | None = None
    """Parameters that count in the distance; None for all but initial states."""
    counted: np.ndarray = attrs.field(init=False)
    """Which unknowns count in the distance, shape (n,): all but initial states."""

    def __attrs_post_init__(self) -> None:
        known = numbers(self.setup.diagram)
        names = [k.parameter for k in self.problem.unknowns.items]
        counted = [not is_start(known[k]) and (self.given is None or k in self.given) for k in names]
        self.counted = np.array(counted, dtype=bool)

    def distance(self, theta: np.ndarray) -> float:
        """Distance from the diagram's own parameters, in sizes."""
        return float(np.linalg.norm(((theta - self.problem.unknowns.start) / self.scales)[self.counted]))

    def to_nearest(self, end: OptimizerResult) -> OptimizerResult:
        """The end moved along null directions, within the bounds, as far as the cost does not rise."""
        theta, cost = end.theta, end.cost
        for _ in range(MOST_STEPS):
            d = self.step(theta)
            if d is None or not np.isfinite(d).all():
                break
            better = self.moved(theta, d, end.cost)
            if better is None:
                break
            theta, cost = better
        return attrs.evolve(end, theta=theta, cost=min(cost, end.cost)) if theta is not end.theta else end

    def step(self, theta: np.ndarray) -> np.ndarray | None:
        """The step along the null directions that leads nearest, ended at bounds; None where there is none."""
        problem = self.problem
        _, J = problem.jacobian(theta)
        if not J.is_finite.all():
            return None
        scales = self.scales
        rows = active_constraints(problem, theta)[1]
        prior = np.diag(problem.prior_derivatives(theta)[1]) if len(problem.priors.which) else None
        null = null_directions(J, scales, prior, rows if len(rows) else None)
        own = null[self.counted]
        if not own.size:
            return None
        off = ((theta - problem.unknowns.start) / scales)[self.counted]
        d = scales * (null @ np.linalg.lstsq(own, -off, rcond=1e-8)[0])
        if np.abs(d / scales)[self.counted].max(initial=0.0) <= CLOSE:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(d > 0, problem.unknowns.high - theta, problem.unknowns.low - theta) / d
        return d * float(min(1.0, np.where(d != 0, room, np.inf).min(initial=1.0)))

    def moved(self, theta: np.ndarray, d: np.ndarray, allowed: float) -> tuple[np.ndarray, float] | None:
        """Where a step, or half of it, and so on, leads without a rise above the cost ``allowed``, and the cost there.

        A curved direction is left by a straight step: a few iterations lead back.
        """
        problem, limit, share = self.problem, (1 + SAME_COST) * allowed + self.problem.rounding, 1.0
        for _ in range(MOST_CUTS):
            new = within_bounds(problem, theta + share * d)
            if problem.violation(new) <= 0:
                cost = problem.cost(new)
                if np.isfinite(cost) and cost > limit:
                    back = gauss_newton(problem, new, iterations=RETURNS, coarse=False)
                    new, cost = back.theta, back.cost
                if cost <= limit and self.distance(new) < self.distance(theta):
                    return new, cost
            share /= 2
        return None
