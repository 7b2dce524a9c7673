"""Searches without derivatives, by SciPy: differential evolution over whole ranges, and Nelder-Mead downhill."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError
from tsmblocks.fitting.multistart import Box, Range, hypercube
from tsmblocks.fitting.runs import LANES

MUTATION, CROSSOVER = (0.3, 0.8), 0.2
"""Differential weight, redrawn for each generation, and crossover probability (no unit).

Chosen: of 16 pairs, these find the optimum of the test functions in tests/test_fit_genetic.py from most seeds.
"""
NARROW = 1e-6
"""Width of a population relative to the search ranges at which it has converged. Chosen: Nelder-Mead starts wider."""
FIRST_EDGE = 0.05
"""Edge of the first simplex relative to the search ranges. Chosen: leads out of a narrow feasible region."""
RESTARTS = 5
"""How often a simplex is rebuilt around its best corner, each time four times smaller. Chosen."""
FLAT = 1e-7
"""Ratio of the least to the greatest extent of a simplex below which it has collapsed to a plane. Chosen."""

Costs = Callable[[np.ndarray], np.ndarray]
"""Parameter sets (sets, unknowns) in, costs (sets,) out; a cost that is not finite counts as the highest."""
Violations = Callable[[np.ndarray], np.ndarray]
"""Parameter sets (sets, unknowns) in, violation of each constraint (sets, constraints) out; met at 0 or less."""
Progress = Callable[[int, float], None]
"""Receives the number of evaluations and the lowest cost after each generation or iteration."""


@attrs.frozen(eq=False)
class SearchResult:
    """Outcome of a search without derivatives.

    ``theta`` (unknowns,) is the best parameter set, ``cost`` its cost (infinite where none meets the constraints),
    ``violation`` the sum of its constraint violations. ``history`` holds the lowest cost after each generation or
    iteration, the initial one included, ``path`` (iterations + 1, unknowns) the best set of each. ``population``
    (sets, unknowns) and ``costs`` (sets,) are the last generation from best to worst. ``status`` is
    ``converged``, ``stalled`` (no gain for many generations), ``limit`` (of iterations) or ``interrupted``.
    """

    theta: np.ndarray
    cost: float
    violation: float
    iterations: int
    evaluations: int
    restarts: int
    status: str
    history: np.ndarray = attrs.field(repr=False)
    path: np.ndarray = attrs.field(repr=False)
    population: np.ndarray = attrs.field(factory=lambda: np.empty((0, 0)), repr=False)
    costs: np.ndarray = attrs.field(factory=lambda: np.empty(0), repr=False)


@attrs.define(eq=False)
class _Objective:
    """Costs and constraints over shares 0 to 1 of the search ranges; remembers the best set that was evaluated."""

    box: Box
    cost: Costs
    violations: Violations | None
    progress: Progress | None
    evaluations: int = 0
    restarts: int = 0
    status: str = "limit"
    last: Any = None
    best: tuple[float, float] = (np.inf, np.inf)
    theta: np.ndarray | None = None
    history: list[float] = attrs.field(factory=list)
    path: list[np.ndarray] = attrs.field(factory=list)

    def costs(self, shares: np.ndarray) -> np.ndarray:
        """Costs (sets,) of shares (sets, unknowns), infinite where they are not finite."""
        count = len(shares)
        if not count:
            return np.empty(0)
        thetas = self.box.thetas(shares)
        costs = np.asarray(self.cost(thetas), dtype=float)
        if costs.shape != (count,):
            raise RunError(f"the cost must give one number per set, shape ({count},), got shape {costs.shape}.")
        self.evaluations += count
        costs = np.where(np.isfinite(costs), costs, np.inf)
        self._remember(0.0, float(costs.min()), thetas[int(np.argmin(costs))])
        return costs

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Violations (sets, constraints) of shares (sets, unknowns), infinite where they are no numbers."""
        assert self.violations is not None
        thetas = self.box.thetas(shares)
        values = np.asarray(self.violations(thetas), dtype=float)
        if values.ndim != 2 or len(values) != len(shares):
            raise RunError(
                f"the constraints must give one row per set, shape ({len(shares)}, constraints), got shape "
                f"{values.shape}."
            )
        values = np.where(np.isnan(values), np.inf, values)
        total = np.maximum(values, 0.0).sum(axis=1)
        least = int(np.argmin(total))
        if total[least] > 0:
            self._remember(float(total[least]), np.inf, thetas[least])
        return values

    def feasible_costs(self, shares: np.ndarray) -> np.ndarray:
        """Costs (sets,), infinite where a constraint is violated."""
        if self.violations is None:
            return self.costs(shares)
        meets = (self.values(shares) <= 0).all(axis=1)
        costs = np.full(len(shares), np.inf)
        costs[meets] = self.costs(shares[meets])
        return costs

    def generation(self, x: np.ndarray) -> np.ndarray:
        """Costs (sets,) of a generation as SciPy has it, shares (unknowns, sets)."""
        costs = self.costs(x.T)
        if not self.history:  # the first population
            self.note()
        return costs

    def scipy_violations(self, x: np.ndarray) -> np.ndarray:
        """Violations (constraints, sets) of a generation as SciPy has it; of one set (unknowns,) first."""
        values = self.values(np.atleast_2d(x.T))
        return values[0] if x.ndim == 1 else values.T

    def ends(self, generation: Any, patience: int, tolerance: float) -> bool:
        """Record a generation; whether the search is at its end."""
        self.note()
        self.last = generation
        if np.ptp(generation.population, axis=0).max() <= NARROW:
            self.status = "converged"
        elif len(self.history) > patience and np.isfinite(self.history[-1]):
            gained = self.history[-1 - patience] - self.history[-1]
            self.status = "stalled" if gained <= tolerance * abs(self.history[-1]) else "limit"
        return self.status != "limit"

    def note(self) -> None:
        """Record the best so far after a generation or an iteration."""
        self.history.append(self.best[1])
        if self.theta is not None:
            self.path.append(self.theta)
        if self.progress is not None:
            self.progress(self.evaluations, self.best[1])

    def _remember(self, violation: float, cost: float, theta: np.ndarray) -> None:
        if (violation, cost) < self.best:
            self.best, self.theta = (violation, cost), theta

    def result(self, **more: Any) -> SearchResult:
        """The best set so far."""
        assert self.theta is not None
        history, path = np.array(self.history), np.array(self.path)
        violation, cost = self.best
        steps = max(len(history) - 1, 0)
        return SearchResult(
            self.theta, cost, violation, steps, self.evaluations, self.restarts, self.status, history, path, **more
        )


def evolve(
    cost: Costs,
    ranges: Sequence[Range],
    *,
    seed: int,
    population: int | None = None,
    generations: int | None = None,
    constraints: Violations | None = None,
    start: Any = None,
    progress: Progress | None = None,
    patience: int = 30,
    tolerance: float = 1e-3,
) -> SearchResult:
    """Search all ranges for the lowest cost by differential evolution, a whole generation in one call of ``cost``.

    ``start`` holds sets to include, one or several (the ``population`` of an earlier search). ``population`` is a
    multiple of 32, by default the nearest to 12 for each unknown and at least 64. The search ends after
    ``generations`` (12 for each unknown and 5 more, at least 36; three times as many under constraints, where only the
    feasible sets are simulated), when the lowest cost fell by less than the share
    ``tolerance`` within ``patience`` generations, or when the population has shrunk to a point. Same seed, same
    result. Ctrl-C keeps the best so far. Infeasible sets rank by their violation, below all feasible ones.

    Raises ParameterError for a start outside the ranges, RunError when no set has a finite cost.
    Source: Storn and Price, J. Global Optim. 11 (1997) 341; constraints as Lampinen, CEC (2002) 1468.
    """
    from scipy.optimize import NonlinearConstraint, differential_evolution

    box, rng = Box(tuple(ranges)), np.random.default_rng(seed)
    objective, n = _Objective(box, cost, constraints, progress), len(ranges)
    most = max(36, 5 + 12 * n) * (1 if constraints is None else 3) if generations is None else generations
    limits = () if constraints is None else NonlinearConstraint(objective.scipy_violations, -np.inf, 0.0)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # costs may be huge
            objective.last = differential_evolution(
                objective.generation,
                [(0.0, 1.0)] * n,
                init=_first_population(box, rng, population, start),
                maxiter=most,
                mutation=MUTATION,
                recombination=CROSSOVER,
                rng=rng,
                vectorized=True,
                updating="deferred",
                polish=False,
                atol=-1.0,  # the callback alone decides on the end
                tol=0.0,
                constraints=limits,
                callback=lambda intermediate_result: objective.ends(intermediate_result, patience, tolerance),
            )
    except KeyboardInterrupt:
        if objective.theta is None:
            raise
        objective.status = "interrupted"
    return _evolved(objective)


def _first_population(box: Box, rng: np.random.Generator, population: int | None, start: Any) -> np.ndarray:
    """Shares (sets, unknowns): what is given to start from, and a Latin hypercube."""
    n = len(box.ranges)
    size = LANES * max(2, round(12 * n / LANES)) if population is None else population
    if size < LANES or size % LANES:
        raise ParameterError(
            f"the population must be a multiple of {LANES}, the sets that run side by side, got {size}."
        )
    shares = hypercube(rng, size, n)
    if start is None:
        return shares
    return np.concatenate([box.shares(box.inside(start, "the start")), shares])[:size]


def _evolved(objective: _Objective) -> SearchResult:
    """The outcome, with the last population from best to worst."""
    if objective.best == (0.0, np.inf):
        raise RunError(
            f"none of {objective.evaluations} parameter sets has a finite cost. Narrow the search ranges, or start "
            "where the simulation is stable."
        )
    if objective.last is None:
        return objective.result()
    order = np.argsort(objective.last.population_energies, kind="stable")
    population = objective.box.thetas(objective.last.population[order])
    return objective.result(population=population, costs=objective.last.population_energies[order])


def polish(
    cost: Costs,
    start: Any,
    ranges: Sequence[Range],
    *,
    constraints: Violations | None = None,
    size: float = FIRST_EDGE,
    xtol: float = 1e-4,
    ftol: float = 1e-7,
    iterations: int | None = None,
    restarts: int = RESTARTS,
    progress: Progress | None = None,
) -> SearchResult:
    """Search downhill from ``start`` to the lowest cost nearby, within the ranges, by Nelder and Mead's simplex.

    ``size`` is the edge of the first simplex relative to the ranges. The search ends when the simplex is smaller
    than ``xtol`` of each range and its costs differ by less than the share ``ftol`` of the first, or after
    ``iterations`` (300 for each unknown). A simplex that collapsed to a plane is rebuilt, smaller, around its best
    corner, at most ``restarts`` times. Sets that violate a constraint count as those without a finite cost. Ctrl-C
    keeps the best so far.

    Raises ParameterError for a start outside the ranges, RunError for one without a finite cost.
    Source: Nelder and Mead, Computer Journal 7 (1965) 308; from five unknowns on with the coefficients of Gao and
    Han, Comput. Optim. Appl. 51 (2012) 259.
    """
    from scipy.optimize import minimize

    box = Box(tuple(ranges))
    objective, best = _Objective(box, cost, constraints, progress), box.shares(box.inside(start, "the start"))[0]
    n = len(best)
    most = 300 * n if iterations is None else iterations
    first = float(objective.feasible_costs(best[None])[0])
    if np.isinf(first):
        raise RunError("the start of Nelder-Mead has no finite cost. Begin where the simulation is stable.")
    objective.note()
    try:
        for again in range(restarts + 1):
            objective.restarts, edge = again, size / 4.0**again
            inward = np.where(best + edge <= 1.0, edge, -edge)
            ended = minimize(
                lambda x: float(objective.feasible_costs(x[None])[0]),
                best,
                method="Nelder-Mead",
                bounds=[(0.0, 1.0)] * n,
                callback=lambda xk: objective.note(),  # noqa: ARG005 - SciPy reads the name of the argument
                options={
                    "initial_simplex": np.clip(np.vstack([best, best + np.diag(inward)]), 0.0, 1.0),
                    "adaptive": n > 4,
                    "xatol": xtol,
                    "fatol": ftol * abs(first),
                    "maxiter": most - len(objective.history) + 2,  # SciPy makes one iteration less
                },
            )
            objective.status, gained = "converged" if ended.success else "limit", ended.fun < first
            best, first = ended.x, float(ended.fun)
            if not ended.success or not _collapsed(ended.final_simplex[0]) or (objective.restarts and not gained):
                break
    except KeyboardInterrupt:
        objective.status = "interrupted"
    return objective.result()


def _collapsed(corners: np.ndarray) -> bool:
    """Whether a simplex lies next to a plane, in which it stays."""
    extents = np.linalg.svd(corners[1:] - corners[0], compute_uv=False)
    return bool(extents[-1] <= FLAT * extents[0])
