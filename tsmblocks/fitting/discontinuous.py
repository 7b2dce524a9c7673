"""Parameters in which the outputs are discontinuous, such as the instant of a step or the interval of a quantiser.

Derivatives say nothing of them, so many values of each are simulated side by side, by turns with a search in all
other parameters; their uncertainty is how far each can go before the residuals grow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.fitting.gauss_newton import gauss_newton, gauss_newton_differences
from tsmblocks.fitting.multistart import Box, search_range
from tsmblocks.fitting.optimizer import CONSTRAINT_TOLERANCE, OptimizerResult, ProgressCallback
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
EQUAL = 1e-12
"""Rounding relative to the cost. Chosen."""
CLOSE = 1e-10
"""Relative difference below which two values are the same. Chosen."""


@attrs.define(eq=False)
class _Walk:
    """Where the search is."""

    problem: Problem
    theta: np.ndarray
    cost: float
    evaluations: int
    tell: ProgressCallback | None
    status: str
    reach: np.ndarray | None = None
    blur: np.ndarray | None = None

    def costs(self, k: int, values: np.ndarray) -> np.ndarray:
        """Costs with other values of unknown ``k``; infinite where a constraint is missed."""
        thetas = np.repeat(self.theta[None], len(values), axis=0)
        thetas[:, k] = values
        self.evaluations += len(values)
        found = self.problem.costs(thetas)
        if self.problem.constraints.names:
            found = np.where([self.problem.violation(theta) <= CONSTRAINT_TOLERANCE for theta in thetas], found, np.inf)
        if self.tell is not None:
            self.tell("jumps", self.evaluations, min(self.cost, float(found.min())))
        return found

    def go(self, k: int, value: float, cost: float) -> None:
        """Go to another value of unknown ``k``."""
        self.theta = self.theta.copy()
        self.theta[k], self.cost = value, cost

    def follow(self, found: OptimizerResult) -> None:
        """Go on from the end of a search, where that is better."""
        self.evaluations += found.evaluations
        if found.cost < self.cost * (1 - EQUAL):
            self.theta, self.cost, self.status = found.theta, found.cost, found.status


def search_discontinuous(
    problem: Problem, ends: Sequence[OptimizerResult], *, iterations: int = 100, tell: ProgressCallback | None = None
) -> list[OptimizerResult]:
    """Go on from the best of the ends of searches where the outputs follow an unknown in jumps.

    The ends are given best first. A search downhill leaves such an unknown where it began, or ends at a wall: it would
    be taken for one without influence, or for one that is known all too well. What has no influence is put back to
    where it began.
    """
    best, others = ends[0], list(ends[1:])
    which = _jumping(problem, best)
    if best.status in ("interrupted", "limit") or not which:
        return list(ends)
    walk = _Walk(problem, best.theta, best.cost, best.evaluations, tell, best.status, best.reach)
    try:
        _walked(walk, which, iterations)
        _told_apart(walk, which, best)
        if walk.reach is not None:
            walk.follow(gauss_newton_differences(problem, walk.theta, walk.reach, iterations=iterations, tell=tell))
            walk.follow(gauss_newton(problem, walk.theta, iterations=iterations, tell=tell))  # what has a slope, by it
            _told_apart(walk, which, best)
        if walk.cost < best.cost * (1 - GAIN):
            others = [_again(walk, f, which, iterations) for f in others]
    except KeyboardInterrupt:
        walk.status = "interrupted"
    except RunError:  # so far off it cannot be run: as far as it went counts
        pass
    history = (*best.history, walk.cost)
    found = OptimizerResult(
        walk.theta, walk.cost, walk.status, len(history) - 1, walk.evaluations, history, walk.reach, walk.blur
    )
    return [found, *(attrs.evolve(f, reach=walk.reach, blur=walk.blur) for f in others)]


def _walked(walk: _Walk, which: Sequence[int], iterations: int) -> None:
    """Values tried along each by turns with a search of all other numbers, until nothing is gained."""
    for _ in range(ROUNDS):
        before = walk.cost
        for k in which:
            _try(walk, k)
        if before - walk.cost <= GAIN * before:
            break
        walk.follow(gauss_newton(walk.problem, walk.theta, iterations=iterations, tell=walk.tell))


def _jumping(problem: Problem, found: OptimizerResult) -> list[int]:
    """Unknowns that the outputs have no slope by, and a few by which slopes at a point say nothing of what is near."""
    matrix = problem.normal(found.theta)[2]
    flat = np.diag(matrix) - problem.prior_slopes(found.theta)[1] <= 0
    astray = np.zeros(len(flat), dtype=bool)
    if found.reach is not None:  # the search could not go by slopes
        slopes, rises = (
            problem.jacobian(found.theta)[1],
            problem.finite_difference_jacobian(found.theta, found.reach)[1],
        )
        with np.errstate(over="ignore", invalid="ignore"):
            astray = ~(np.linalg.norm(slopes - rises, axis=0) <= ASTRAY * np.linalg.norm(slopes, axis=0)) & ~flat
    few = astray.sum() <= FEW
    return [int(k) for k in np.flatnonzero(flat | astray if few else flat)]


def _range(problem: Problem, k: int) -> Box:
    """The range in which values of an unknown are looked for."""
    item = problem.unknowns.items[k]
    return Box((search_range(item.start, item.low, item.high),))


def _try(walk: _Walk, k: int) -> None:
    """Try many values of one unknown, then ever closer between the neighbours of the best."""
    item = walk.problem.unknowns.items[k]
    middles = dict.fromkeys((float(walk.theta[k]), item.start))

    def around(count: int) -> np.ndarray:
        parts = [m + AROUND * (abs(m) or 1.0) * np.linspace(-1.0, 1.0, count + 1) for m in middles]
        return np.clip(np.concatenate(parts), item.low, item.high)

    wide = _range(walk.problem, k).thetas(np.linspace(0.0, 1.0, WIDE)[:, None])[:, 0]
    values = np.unique(np.concatenate([wide, around(NEAR), [walk.theta[k]]]))
    costs = walk.costs(k, values)
    if np.mean(np.abs(costs - walk.cost) <= EQUAL * walk.cost) < 0.25:  # or it stands where nothing comes of it
        more = around(FINE)
        values, first = np.unique(np.concatenate([values, more]), return_index=True)
        costs = np.concatenate([costs, walk.costs(k, more)])[first]
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
        values, costs = between, walk.costs(k, between)
    best = int(np.argmin(costs))
    if costs[best] < walk.cost * (1 - EQUAL):
        walk.go(k, float(values[best]), float(costs[best]))


def _told_apart(walk: _Walk, which: Sequence[int], found: OptimizerResult) -> None:
    """How far to take differences over, and half of how far each unknown may go without any change."""
    problem, theta = walk.problem, walk.theta
    begun = problem.unknowns.start
    size = np.maximum(np.abs(theta), np.abs(begun))
    reach = found.reach if found.reach is not None else SMOOTH * np.where(size > 0, size, 1.0)
    reach, blur, seen = reach.copy(), np.zeros(len(theta)), found.reach is not None
    for k in which:
        middle, far, flat = _edges(walk, k)
        if not math.isinf(far):
            walk.go(k, middle, walk.cost)
            reach[k], blur[k], seen = far, flat, True
        elif walk.costs(k, begun[k : k + 1])[0] <= walk.cost * (1 + EQUAL):
            walk.go(k, float(begun[k]), walk.cost)
    if seen:
        walk.reach, walk.blur = reach, blur


def _edges(walk: _Walk, k: int) -> tuple[float, float, float]:
    """Middle and half width of where the cost stays the same, and how far it takes to grow by half a variance.

    What takes no end at one side has no influence to speak of: infinite.
    """
    item, box = walk.problem.unknowns.items[k], _range(walk.problem, k)
    at, variance = float(walk.theta[k]), 2 * walk.cost / max(walk.problem.samples, 1)
    steps = float(box.high[0] - box.low[0]) * 0.5 ** np.arange(HALVED)[::-1]
    far, flat = 0.0, list[float]()
    for side, bound in ((-1, item.low), (1, item.high)):
        values = at + side * np.append(steps[steps < abs(bound - at)], min(abs(bound - at), 2 * steps[-1]))
        rise = walk.costs(k, values) - walk.cost
        grown = np.flatnonzero(rise > 0.5 * variance)
        if not len(grown) and math.isinf(bound):
            return at, math.inf, math.inf
        last = grown[0] if len(grown) else len(values) - 1
        far = max(far, abs(values[last] - at))
        flat.append(_edge(walk, k, values, rise))
    return at + 0.5 * (flat[1] - flat[0]), far, 0.5 * (flat[0] + flat[1])


def _edge(walk: _Walk, k: int, values: np.ndarray, rise: np.ndarray) -> float:
    """How far an unknown may go to one side before anything changes, found between two of ``values``."""
    same = np.abs(rise) <= EQUAL * walk.cost
    first = int(np.argmin(same)) if not same.all() else len(values)
    if first == 0:
        return 0.0
    if first == len(values):
        return float(abs(values[-1] - walk.theta[k]))
    between = np.linspace(values[first - 1], values[first], BETWEEN + 1)
    same = np.abs(walk.costs(k, between) - walk.cost) <= EQUAL * walk.cost
    return float(abs(between[max(int(np.argmin(same)) - 1, 0)] - walk.theta[k]))


def _again(walk: _Walk, found: OptimizerResult, which: Sequence[int], iterations: int) -> OptimizerResult:
    """The search from another start, gone on with at the numbers found by trying."""
    problem, begin = walk.problem, found.theta.copy()
    begin[list(which)] = walk.theta[list(which)]
    if problem.violation(begin) > CONSTRAINT_TOLERANCE or not np.isfinite(problem.cost(begin)):
        return found
    again = gauss_newton(problem, begin, iterations=iterations, tell=walk.tell)
    return again if again.cost < found.cost else found
