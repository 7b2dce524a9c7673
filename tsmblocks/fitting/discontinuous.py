"""Parameters in which the outputs are discontinuous, such as the instant of a step or the interval of a quantiser.

Derivatives carry no information on them, so many values of each are simulated side by side, alternating with a search
in all other parameters; their uncertainty is how far each can be moved before the residuals grow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.multistart import Box, search_range
from tsmblocks.fitting.optimizer import CONSTRAINT_TOLERANCE, OptimizerResult, ProgressCallback, no_progress
from tsmblocks.fitting.residuals import Problem

WIDE, NEAR, FINE, BETWEEN = 64, 32, 1024, 32
"""Values simulated over the whole range, near the current one, more closely around it, and between two neighbours.

Chosen: multiples of the lanes of a batch.
"""
AROUND = 0.5
"""Half width of the near range relative to the value. Chosen."""
ROUNDS = 6
"""Most turns between these values and a search in the other parameters. Chosen."""
ZOOMS = 8
"""Refinements between the neighbours of the best value. Chosen."""
HALVED = 40
"""Bisections for the value from which on the residuals grow. Chosen: to 1e-12 of the range."""
SMOOTH = 1e-2
"""Step of finite differences relative to a parameter in which the outputs are smooth. Chosen."""
GAIN = 1e-6
"""Gain relative to the cost that counts as one. Chosen."""
ASTRAY, FEW = 0.5, 3
"""Relative deviation of a finite difference from the derivative; most unknowns examined for it. Chosen."""
UNRESOLVED = 1e-8
"""Change of an unknown, relative to its size, from which on the cost grows where the simulation does not resolve the
outputs. Chosen: data determine no unknown so well."""
EQUAL = 1e-12
"""Rounding relative to the cost. Chosen."""
CLOSE = 1e-10
"""Relative difference below which two values are the same. Chosen."""


@attrs.define(eq=False)
class _Search:
    """The best point so far, and how far to take differences (``steps``) and no output changes (``plateau``) there."""

    problem: Problem
    theta: np.ndarray
    cost: float
    evaluations: int
    status: str
    iterations: int
    progress: ProgressCallback
    steps: np.ndarray | None
    plateau: np.ndarray | None = None

    def costs(self, k: int, values: np.ndarray) -> np.ndarray:
        """Costs with other values of unknown ``k``; infinite where a constraint is violated."""
        thetas = np.repeat(self.theta[None], len(values), axis=0)
        thetas[:, k] = values
        self.evaluations += len(values)
        costs = self.problem.costs(thetas)
        if self.problem.constraints.names:
            costs = np.where([self.problem.violation(theta) <= CONSTRAINT_TOLERANCE for theta in thetas], costs, np.inf)
        self.progress("jumps", self.evaluations, min(self.cost, float(costs.min())))
        return costs

    def move(self, k: int, value: float, cost: float) -> None:
        """Give unknown ``k`` another value."""
        self.theta = self.theta.copy()
        self.theta[k], self.cost = value, cost

    def descend(self, steps: np.ndarray | None = None) -> None:
        """Search in all unknowns by derivatives, or differences over ``steps``; its end is taken where it is better."""
        found = self.gauss_newton(self.theta, steps)
        self.evaluations += found.evaluations
        if found.cost < self.cost * (1 - EQUAL):
            self.theta, self.cost, self.status = found.theta, found.cost, found.status

    def gauss_newton(self, start: np.ndarray, steps: np.ndarray | None = None) -> OptimizerResult:
        """A search by derivatives from ``start``."""
        return gauss_newton(self.problem, start, iterations=self.iterations, progress=self.progress, steps=steps)


def search_discontinuous(
    problem: Problem,
    ends: Sequence[OptimizerResult],
    *,
    iterations: int = 100,
    progress: ProgressCallback = no_progress,
) -> list[OptimizerResult]:
    """Continue from the best of the ends of searches where the outputs are discontinuous in an unknown.

    The ends are given best first. A descent leaves such an unknown at its initial value, or ends at a jump: it would
    seem to have no influence, or a far too small uncertainty. An unknown without influence is set back to its initial
    value.
    """
    best, others = ends[0], list(ends[1:])
    which = _discontinuous(problem, best)
    if best.status in ("interrupted", "limit") or not which:
        return list(ends)
    search = _Search(
        problem, best.theta, best.cost, best.evaluations, best.status, iterations, progress, best.difference_steps
    )
    try:
        for _ in range(ROUNDS):
            before = search.cost
            for k in which:
                _search_values(search, k)
            if before - search.cost <= GAIN * before:
                break
            search.descend()
        _measure_plateaus(search, which, best.difference_steps)
        if search.steps is not None:
            search.descend(search.steps)
            search.descend()  # unknowns in which the outputs are smooth, by their derivatives
            _measure_plateaus(search, which, best.difference_steps)
        if search.cost < best.cost * (1 - GAIN):
            others = [_again(search, end, which) for end in others]
    except KeyboardInterrupt:
        search.status = "interrupted"
    except RunError:  # the simulation diverges there: the best point so far counts
        pass
    history = (*best.history, search.cost)
    found = OptimizerResult(search.theta, search.cost, search.status, len(history) - 1, search.evaluations, history)
    return [attrs.evolve(f, difference_steps=search.steps, plateau=search.plateau) for f in (found, *others)]


def _discontinuous(problem: Problem, found: OptimizerResult) -> list[int]:
    """Unknowns of zero derivative, and a few whose derivatives at a point differ from differences around it."""
    matrix = problem.normal(found.theta)[2]
    flat = np.diag(matrix) - problem.prior_derivatives(found.theta)[1] <= 0
    astray = np.zeros(len(flat), dtype=bool)
    if found.difference_steps is not None:  # the search could not go by derivatives
        exact, rises = (problem.jacobian(found.theta, steps)[1] for steps in (None, found.difference_steps))
        with np.errstate(over="ignore", invalid="ignore"):
            astray = ~((exact - rises).norms <= ASTRAY * exact.norms) & ~flat
    few = astray.sum() <= FEW
    return [int(k) for k in np.flatnonzero(flat | astray if few else flat)]


def _range(problem: Problem, k: int) -> Box:
    """The search range of an unknown."""
    item = problem.unknowns.items[k]
    return Box((search_range(item.start, item.low, item.high),))


def _search_values(search: _Search, k: int) -> None:
    """Try many values of one unknown, then finer ones between the neighbours of the best."""
    item = search.problem.unknowns.items[k]
    middles = dict.fromkeys((float(search.theta[k]), item.start))

    def around(count: int) -> np.ndarray:
        parts = [m + AROUND * (abs(m) or 1.0) * np.linspace(-1.0, 1.0, count + 1) for m in middles]
        return np.clip(np.concatenate(parts), item.low, item.high)

    wide = _range(search.problem, k).thetas(np.linspace(0.0, 1.0, WIDE)[:, None])[:, 0]
    values = np.unique(np.concatenate([wide, around(NEAR), [search.theta[k]]]))
    costs = search.costs(k, values)
    if np.mean(np.abs(costs - search.cost) <= EQUAL * search.cost) < 0.25:  # else its value has no effect there
        more = around(FINE)
        values, first = np.unique(np.concatenate([values, more]), return_index=True)
        costs = np.concatenate([costs, search.costs(k, more)])[first]
    for _ in range(ZOOMS):
        best = int(np.argmin(costs))
        low, high = values[max(best - 1, 0)], values[min(best + 1, len(values) - 1)]
        if (
            not costs[best] < np.inf
            or np.sum(costs <= costs[best] * (1 + EQUAL)) > 2
            or high - low <= CLOSE * abs(high)
        ):
            break
        between = np.linspace(low, high, BETWEEN + 1)
        values, costs = between, search.costs(k, between)
    best = int(np.argmin(costs))
    if costs[best] < search.cost * (1 - EQUAL):
        search.move(k, float(values[best]), float(costs[best]))


def _measure_plateaus(search: _Search, which: Sequence[int], given: np.ndarray | None) -> None:
    """How far to take differences over, and half of how far each unknown may go without any change."""
    problem, theta = search.problem, search.theta
    begun = problem.unknowns.start
    size = np.maximum(np.abs(theta), np.abs(begun))
    steps = SMOOTH * np.where(size > 0, size, 1.0) if given is None else given.copy()
    plateau, any_jumps = np.zeros(len(theta)), given is not None
    for k in which:
        middle, far, flat = _edges(search, k)
        if not math.isinf(far):
            search.move(k, middle, search.cost)
            if far >= UNRESOLVED * size[k]:
                steps[k] = far
            plateau[k], any_jumps = flat, True
        elif search.costs(k, begun[k : k + 1])[0] <= search.cost * (1 + EQUAL):
            search.move(k, float(begun[k]), search.cost)
    if any_jumps:
        search.steps, search.plateau = steps, plateau


def _edges(search: _Search, k: int) -> tuple[float, float, float]:
    """Middle of the plateau of equal cost, how far the cost takes to grow by half a variance, and half the plateau.

    Infinite where the cost never grows to one side: the unknown has no influence there.
    """
    item, box = search.problem.unknowns.items[k], _range(search.problem, k)
    at, variance = float(search.theta[k]), 2 * search.cost / max(search.problem.samples, 1)
    steps = float(box.high[0] - box.low[0]) * 0.5 ** np.arange(HALVED)[::-1]
    far, flat = 0.0, list[float]()
    for side, bound in ((-1, item.low), (1, item.high)):
        values = at + side * np.append(steps[steps < abs(bound - at)], min(abs(bound - at), 2 * steps[-1]))
        rise = search.costs(k, values) - search.cost
        grown = np.flatnonzero(rise > 0.5 * variance)
        if not len(grown) and math.isinf(bound):
            return at, math.inf, math.inf
        last = grown[0] if len(grown) else len(values) - 1
        far = max(far, abs(values[last] - at))
        flat.append(_edge(search, k, values, rise))
    return at + 0.5 * (flat[1] - flat[0]), far, 0.5 * (flat[0] + flat[1])


def _edge(search: _Search, k: int, values: np.ndarray, rise: np.ndarray) -> float:
    """How far an unknown may go to one side before anything changes, found between two of ``values``."""
    same = np.abs(rise) <= EQUAL * search.cost
    first = int(np.argmin(same)) if not same.all() else len(values)
    if first == 0:
        return 0.0
    if first == len(values):
        return float(abs(values[-1] - search.theta[k]))
    between = np.linspace(values[first - 1], values[first], BETWEEN + 1)
    same = np.abs(search.costs(k, between) - search.cost) <= EQUAL * search.cost
    return float(abs(between[max(int(np.argmin(same)) - 1, 0)] - search.theta[k]))


def _again(search: _Search, found: OptimizerResult, which: Sequence[int]) -> OptimizerResult:
    """The search from another start, continued with the values found for the discontinuous unknowns."""
    problem, begin = search.problem, found.theta.copy()
    begin[list(which)] = search.theta[list(which)]
    if problem.violation(begin) > CONSTRAINT_TOLERANCE or not np.isfinite(problem.cost(begin)):
        return found
    again = search.gauss_newton(begin)
    return again if again.cost < found.cost else found
