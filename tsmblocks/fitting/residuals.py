"""A fit as mathematics: differences between simulation and measurement as functions of the unknowns.

Every method of search sees a fit through this class and knows nothing of diagrams or engines.
"""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor

import attrs
import numpy as np

from tsmblocks.common.interrupt import checkpoint
from tsmblocks.fitting import runs
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.inner_products import products, square
from tsmblocks.fitting.jacobian import Jacobian
from tsmblocks.fitting.parameter_vector import Constraints, Unknown, Unknowns
from tsmblocks.fitting.whitening import Whitening

ROUNDING = 1e-12
"""Rounding of simulated outputs relative to the measured signals. Chosen."""

DIVERGED = 1e8
"""Change of the outputs that derivatives predict, for an unknown that moves by its size, over the rms of the signals,
from which they diverge. Chosen: unstable derivatives grow by powers of ten from step to step."""
DIFFERENCE_SHARE = 1e-2
"""Central differences in place of such derivatives, as a share of each unknown. Chosen."""


@attrs.frozen(eq=False)
class Priors:
    """Priors: ``mean`` and standard ``deviation`` of some unknowns, whose indices are ``which``."""

    which: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray


@attrs.frozen(eq=False)
class Problem:
    """Least squares of weighted differences, in bounds and under constraints.

    ``weights`` has one factor per output; ``noise`` is the deviation of one weighted difference, which
    sets what a prior weighs beside the samples. ``whitening`` makes weighted differences of an experiment whose errors
    are correlated white, by number of the experiment; of the others they are as they are.
    """

    unknowns: Unknowns
    constraints: Constraints
    experiments: tuple[Experiment, ...]
    weights: np.ndarray
    priors: Priors
    noise: float = 1.0
    whitening: Mapping[int, Whitening] = attrs.field(factory=dict)
    size: float = attrs.field(init=False)
    """Root mean square of the weighted measured signals, the scale of the residuals."""

    @size.default
    def _measured_size(self) -> float:
        total = sum(square((experiment.measured * self.weights).ravel()) for experiment in self.experiments)
        return float(np.sqrt(total / max(self.samples, 1)))

    def with_items(self, items: Iterable[Unknown]) -> Problem:
        """The same problem with other starts or bounds of its unknowns, in their order."""
        return attrs.evolve(self, unknowns=attrs.evolve(self.unknowns, items=tuple(items)))

    @property
    def rounding(self) -> float:
        """The cost that rounding of the outputs alone may cause."""
        return 0.5 * self.samples * (ROUNDING * self.size) ** 2

    @property
    def samples(self) -> int:
        """Number of differences."""
        return sum(experiment.measured.size for experiment in self.experiments)

    @property
    def segments(self) -> list[slice]:
        """Slices of the residual vector, one for each experiment and output, in that order.

        They are not the segments of multiple shooting.
        """
        made, first = [], 0
        for experiment in self.experiments:
            for _ in range(experiment.measured.shape[1]):
                made.append(slice(first, first + len(experiment.t)))
                first += len(experiment.t)
        return made

    @property
    def rows(self) -> tuple[slice, ...]:
        """Slices of the residual vector, one for each experiment."""
        ends = np.cumsum([0, *(experiment.measured.size for experiment in self.experiments)]).tolist()
        return tuple(slice(a, b) for a, b in itertools.pairwise(ends))

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """Weighted differences, simulation less measurement, shape (samples,); whitened where errors are correlated."""
        pairs = zip(runs.outputs(self.experiments, self._parameters(theta)), self.experiments, strict=True)
        return self.whitened(np.concatenate([(e.residuals(y) * self.weights).ravel(order="F") for y, e in pairs]))

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """Weighted differences (samples,) as residuals: whitened where errors are correlated."""
        return self._each(values, lambda whitening, part: whitening.whitened(part))

    def restored(self, residuals: np.ndarray) -> np.ndarray:
        """Weighted differences (samples,) of residuals, as they are before they are whitened."""
        return self._each(residuals, lambda whitening, part: whitening.restored(part))

    def _each(self, values: np.ndarray, change: Callable[[Whitening, np.ndarray], np.ndarray]) -> np.ndarray:
        """Values (samples,) with those of experiments with correlated errors changed."""
        if not self.whitening:
            return values
        result, rows = values.copy(), self.rows
        for e, whitening in self.whitening.items():
            result[rows[e]] = change(whitening, values[rows[e]])
        return result

    def jacobian(self, theta: np.ndarray, steps: np.ndarray | None = None) -> tuple[np.ndarray, Jacobian]:
        """Weighted residuals (samples,) and their derivatives (samples, unknowns).

        With ``steps`` (unknowns,), central differences over that far to each side: where the outputs jump (an encoder
        in a loop) or bend (a stop), these lead downhill. So they are where the derivatives diverge and the outputs do
        not: dry friction of a narrow smoothing is bounded at any step, and its slope is not.
        """
        residuals, J = self._derivatives(theta, steps)
        if steps is not None or not self._diverges(J, theta, residuals):
            return residuals, J
        size = np.maximum(np.abs(theta), np.abs(self.unknowns.start))
        return self._derivatives(theta, DIFFERENCE_SHARE * np.where(size > 0, size, 1.0))

    def _diverges(self, J: Jacobian, theta: np.ndarray, residuals: np.ndarray) -> bool:
        """Whether derivatives would move the outputs far beyond the signals, for an unknown that moves by its size.

        They do so in the course of a run; one that is infinite from the first sample on is so by its equation.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            moved = J.norms * np.abs(theta)
            signals = np.sqrt(self.samples) * self.size + np.sqrt(square(residuals))
        far = ~(moved <= DIVERGED * signals)
        return np.isfinite(signals) and bool(far.any()) and bool(J.has_finite_values[far].all())

    def _derivatives(self, theta: np.ndarray, steps: np.ndarray | None) -> tuple[np.ndarray, Jacobian]:
        """As ``jacobian``, by derivatives or differences as they are."""
        unknowns, residuals = self.unknowns, np.empty(self.samples)
        common = np.empty((self.samples, len(unknowns.common)))
        own = np.zeros((self.samples, max((len(columns) for columns in unknowns.own), default=0)))
        for rows, (columns, r, J) in zip(self.segments, self._blocks(theta, steps), strict=True):
            local = unknowns.is_local[columns]
            residuals[rows], common[rows], own[rows, : local.sum()] = r, J[:, ~local], J[:, local]
        return residuals, Jacobian(common, own, self.rows, unknowns.common, unknowns.own)

    def _blocks(
        self, theta: np.ndarray, steps: np.ndarray | None
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """For each experiment and output: columns of its unknowns, weighted residuals, their derivatives."""
        p = self._parameters(theta)
        pairs: Iterable[tuple[np.ndarray, list[np.ndarray]]]
        if steps is None:
            pairs = runs.derivatives(self.experiments, p, self.unknowns.jacobians(p))
        else:
            pairs = zip(runs.outputs(self.experiments, p), self._finite_differences(theta, steps), strict=True)
        for e, (y, derivatives) in enumerate(pairs):
            experiment, columns = self.experiments[e], self.unknowns.columns(e)
            r, counted = experiment.residuals(y), experiment.counted
            parts = list[tuple[np.ndarray, np.ndarray]]()
            for i, weight in enumerate(self.weights):
                J = derivatives[i] if weight == 1 else weight * derivatives[i]
                parts.append((weight * r[:, i], J if counted is None else J * counted[:, i, None]))
            if (whitening := self.whitening.get(e)) is not None:
                whole, matrix = (whitening.whitened(np.concatenate(one)) for one in zip(*parts, strict=True))
                parts = list(zip(np.split(whole, len(parts)), np.split(matrix, len(parts)), strict=True))
            for part, J in parts:
                yield columns, part, J

    def _parameters(self, theta: np.ndarray) -> np.ndarray:
        """Parameters of each experiment, shape (experiments, parameters)."""
        return self.unknowns.sets(theta[None])[:, :, 0]

    def _finite_differences(self, theta: np.ndarray, steps: np.ndarray) -> Iterator[list[np.ndarray]]:
        """Central differences in bounds of each output, by the unknowns of each experiment, side by side in lanes.

        An unknown of one experiment moves in the same run as that of every other one.
        """
        unknowns = self.unknowns
        low, high = np.maximum(theta - steps, unknowns.low), np.minimum(theta + steps, unknowns.high)
        every = [unknowns.columns(e) for e in range(len(self.experiments))]
        sets = np.repeat(theta[None], 2 * len(every[0]), axis=0)
        for columns in every:
            for side, end in enumerate((low, high)):
                sets[2 * np.arange(len(columns)) + side, columns] = end[columns]
        for columns, y in zip(every, self.output_sets(sets), strict=True):
            rise = y[:, :, 1::2] - y[:, :, ::2]
            yield [rise[:, i] / (high - low)[columns] for i in range(len(self.weights))]

    def output_sets(self, thetas: np.ndarray) -> Iterator[np.ndarray]:
        """Outputs (samples, outputs, sets) of each experiment for ``thetas`` (sets, unknowns)."""
        return runs.output_sets(self.experiments, self.unknowns.sets(thetas), self._vary)

    @property
    def _vary(self) -> frozenset[int]:
        """Places of the parameters that differ from one set to another."""
        return frozenset(self.unknowns.changed(0))

    def cost(self, theta: np.ndarray) -> float:
        """Half the sum of squares, priors included; infinite where the simulation is not finite."""
        with np.errstate(over="ignore", invalid="ignore"):
            total = 0.5 * square(self.residuals(theta)) + self.prior_cost(theta)
        return total if np.isfinite(total) else np.inf

    def normal(self, theta: np.ndarray, steps: np.ndarray | None = None) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, its gradient (unknowns,), and the Gauss-Newton matrix (unknowns, unknowns); ``steps`` as above."""
        n = len(theta)
        squares, gradient, matrix = 0.0, np.zeros(n), np.zeros((n, n))
        with np.errstate(over="ignore", invalid="ignore"):
            for columns, r, J in self._blocks(theta, steps):
                squares += square(r)
                part, whole = products(J, r)
                gradient[columns] += part
                matrix[np.ix_(columns, columns)] += whole
        slope, curvature = self.prior_derivatives(theta)
        cost = 0.5 * squares + self.prior_cost(theta)
        return cost if np.isfinite(cost) else np.inf, gradient + slope, matrix + np.diag(curvature)

    def costs(self, thetas: np.ndarray, *, quick: bool = False) -> np.ndarray:
        """Cost of many sets at once, shape (sets,), run side by side in lanes and threads; ``quick`` for a few."""
        if self.whitening:
            return self._costs_whitened(thetas)
        count = len(thetas)
        lanes = runs.lanes_for(count)
        groups = [thetas[np.minimum(np.arange(a, a + lanes), count - 1)] for a in range(0, count, lanes)]
        jobs = list[tuple[Experiment, runs.Prepared]]()
        for group in groups:
            made = runs.lane_runs(self.experiments, self.unknowns.sets(group), self._vary, quick=quick)
            jobs += zip(self.experiments, made, strict=True)

        def squares(job: tuple[Experiment, runs.Prepared]) -> np.ndarray:
            return job[0].squares(*job[1], self.weights)

        found = map(squares, jobs) if len(jobs) == 1 else _threads(os.getpid()).map(squares, jobs)
        each = np.array(list(_stoppable(found))).reshape(len(groups), len(self.experiments), lanes)
        total = 0.5 * each.sum(axis=1).ravel()[:count]
        if len(self.priors.which):
            total = total + np.array([self.prior_cost(theta) for theta in thetas])
        return np.where(np.isfinite(total), total, np.inf)

    def _costs_whitened(self, thetas: np.ndarray) -> np.ndarray:
        """The same where errors are correlated."""
        total = np.array([self.prior_cost(theta) for theta in thetas])
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, len(thetas), runs.LANES):  # for memory
                some = slice(first, first + runs.LANES)
                for e, y in enumerate(self.output_sets(thetas[some])):
                    stacked, whitening = self._stacked(e, y), self.whitening.get(e)
                    total[some] += 0.5 * (
                        np.sum(stacked**2, axis=0) if whitening is None else whitening.squares(stacked)
                    )
        return np.where(np.isfinite(total), total, np.inf)

    def residuals_of(self, e: int, y: np.ndarray) -> np.ndarray:
        """Residuals (rows, sets) of experiment ``e`` with the outputs ``y`` (samples, outputs, sets)."""
        stacked, whitening = self._stacked(e, y), self.whitening.get(e)
        return stacked if whitening is None else whitening.whitened(stacked)

    def _stacked(self, e: int, y: np.ndarray) -> np.ndarray:
        """The same before they are whitened."""
        experiment = self.experiments[e]
        r = (y - experiment.measured[:, :, None]) * self.weights[:, None]
        r = r if experiment.counted is None else r * experiment.counted[:, :, None]
        return r.transpose(1, 0, 2).reshape(-1, y.shape[2])

    def prior_derivatives(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and curvature that the priors add, both of shape (unknowns,)."""
        slope, curvature, priors = np.zeros(len(theta)), np.zeros(len(theta)), self.priors
        weight = (self.noise / priors.deviation) ** 2
        np.add.at(slope, priors.which, weight * (theta[priors.which] - priors.mean))
        np.add.at(curvature, priors.which, weight)
        return slope, curvature

    def prior_cost(self, theta: np.ndarray) -> float:
        """The contribution of the priors to the cost."""
        priors = self.priors
        off = (theta[priors.which] - priors.mean) / priors.deviation
        return 0.5 * self.noise**2 * float(off @ off)

    def inside(self, theta: np.ndarray) -> bool:
        """Whether bounds and inequalities hold."""
        unknowns = self.unknowns
        return bool((theta >= unknowns.low).all() and (theta <= unknowns.high).all()) and not self.violation(theta) > 0

    def violation(self, theta: np.ndarray) -> float:
        """Sum of the violations of all constraints; infinite where one is NaN."""
        if not self.constraints.names:
            return 0.0
        violations = self.constraints.violations(theta)
        return float(np.where(np.isnan(violations), np.inf, violations).sum())


def _stoppable(results: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """Results of threads as they come, until the search is to end; what has not begun by then never does."""
    for one in results:
        checkpoint()
        yield one


@functools.lru_cache(maxsize=1)
def _threads(process: int) -> ThreadPoolExecutor:  # noqa: ARG001 - the key of the cache
    """Threads kept between calls, for one process: a fork does not inherit the threads of its parent."""
    return ThreadPoolExecutor(os.cpu_count() or 1)
