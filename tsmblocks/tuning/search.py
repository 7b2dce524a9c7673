"""The search behind ``tune``: exact gradients, constraints, several starts, the worst of several plants."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache

import attrs
import numpy as np

from tsmblocks.metrics.metrics import Metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions
from tsmblocks.simulation.batch import PreparedBatch, warn_of_sets
from tsmblocks.simulation.sensitivities import sensitivities_of
from tsmblocks.simulation.stability import MOST_CHECKED, RunStart, no_step_warnings
from tsmblocks.studies import Uniform, latin_hypercube, study, table
from tsmblocks.studies.runner import checked_batches, grouped, run_starts, set_labels
from tsmblocks.tuning.constraints import LIMIT_MARGIN, LIMIT_TOLERANCE, Limit
from tsmblocks.tuning.smooth_metrics import DifferentiableMetric, differentiable

SMOOTHING_SIZES = (0.05, 0.01, 0.002)
"""Widths over which peaks and shares are smoothed in successive searches, as shares of the signal's size. Chosen."""
RANDOM_SETS = 64
"""Random sets that are measured before the searches, which start at the best of them. Chosen."""
MARGIN_DIFFERENCE = 1e-4
"""Difference over which a stability margin is differentiated, as a share of the bounds. Chosen."""
MOST_STEPS = 40
"""Linear programs of one search, at most. Chosen."""
MOST_LAST_STEPS = 8
"""Iterations of SLSQP after them, at most. Chosen."""
FIRST_RADIUS, LEAST_RADIUS, LAST_RADIUS = 0.1, 1e-5, 0.05
"""Trust region at first and at least, and that of SLSQP, as shares of the bounds. Chosen."""
LIMIT_PENALTY = 10.0
"""Penalty for exceeding a limit by its own size, in sizes of the goal. Chosen."""
GOAL_TOLERANCE = 0.01
"""Share, of the goal or of what was gained, by which ends of searches may differ and still count as the same."""
IDLE_TOLERANCE = 1e-12
"""Relative change that is rounding. Chosen."""


@attrs.frozen(eq=False)
class Linearised:
    """The problem at one point: values of which the goal is the largest (m,), the excess of each limit in each case
    (k,), and their Jacobians by the scaled parameters (m, p) and (k, p).
    """

    goal: np.ndarray
    excess: np.ndarray
    goal_jacobian: np.ndarray
    excess_jacobian: np.ndarray

    @property
    def scale(self) -> float:
        """The size of the goal."""
        return max(float(np.abs(self.goal).max()), 1e-9)

    @property
    def largest_excess(self) -> float:
        """The largest excess, zero within all limits."""
        return float(self.excess.max(initial=0.0))

    @property
    def merit(self) -> float:
        """The worst case plus the penalty for exceeded limits; infinite where a value is not finite."""
        if not (np.isfinite(self.goal).all() and np.isfinite(self.excess).all()):
            return math.inf
        return float(self.goal.max()) + LIMIT_PENALTY * self.largest_excess * self.scale

    def improves_on(self, other: Linearised) -> bool:
        """Whether the merit is lower and no limit is exceeded more: where one is flat no penalty would lead back."""
        over, before = (max(one.largest_excess, LIMIT_MARGIN) for one in (self, other))
        return self.merit < other.merit - 1e-9 * abs(other.merit) and over <= before


@attrs.frozen(eq=False)
class Measured:
    """Sets of parameters with their ``results``: metrics and margins (sets,) by case and name.

    ``goal`` and ``over`` (sets,) are the goal in the worst case and the largest excess of a limit, infinite where one
    is not finite.
    """

    sets: Sequence[Mapping[str, float]]
    results: Mapping[str, Mapping[str, np.ndarray]]
    goal: np.ndarray
    over: np.ndarray

    def best(self, among: Sequence[int]) -> int:
        """Of the sets within the limits that with the smallest goal, else that with the smallest excess."""
        k = np.asarray(among)
        return int(k[np.lexsort((self.goal[k], np.maximum(self.over[k], LIMIT_TOLERANCE)))[0]])

    def agreeing(self, ends: Sequence[int], best: int) -> int:
        """Number of ``ends`` of searches about as good as the best; the first set is the diagrams' own."""
        over = np.maximum(self.over, LIMIT_TOLERANCE)
        gained = self.goal[0] - self.goal[best] if np.isfinite(self.goal[0]) else 0.0
        near = np.abs(self.goal - self.goal[best]) <= GOAL_TOLERANCE * max(abs(self.goal[best]), gained)
        return int(np.sum((near & (over <= over[best] + GOAL_TOLERANCE))[ends]))

    def of(self, k: int) -> dict[str, dict[str, float]]:
        """The metrics of one set, by case and name."""
        return {case: {name: float(v[k]) for name, v in each.items()} for case, each in self.results.items()}


@attrs.frozen(eq=False)
class Search:
    """The problem: cases, free parameters with bounds, the goal and the limits."""

    cases: Mapping[str, Diagram]
    bounds: Mapping[str, Uniform]
    goal: Metric
    limits: Sequence[Limit]
    options: RunOptions
    threads: int | None

    @property
    def metrics(self) -> list[Metric]:
        """The metrics of the runs: the goal, then those of the limits, each once."""
        named = (self.goal, *(one.metric for one in self.limits if one.metric is not None))
        return list({one.given_name: one for one in named}.values())

    @cached_property
    def _differentiable(self) -> list[DifferentiableMetric]:
        """The goal, then the metric of each limit that has one, with derivatives."""
        limited = [one.metric for one in self.limits if one.metric is not None]
        return [differentiable(one) for one in (self.goal, *limited)]

    @property
    def units(self) -> dict[str, str]:
        """Units of all metrics and margins by name."""
        return {self.goal.given_name: self.goal.unit, **{one.name: one.unit for one in self.limits}}

    @property
    def watched(self) -> list[str]:
        """Signals that the goal and the limits name, and outputs of the diagrams."""
        named = [name for one in self.metrics for name in one.signals]
        return list(dict.fromkeys([*named, *next(iter(self.cases.values())).outputs]))

    # ---- runs without smoothing

    def measured(self, sets: Sequence[Mapping[str, float]]) -> Measured:
        """Metrics and margins of each case, without smoothing."""
        plan = table({name: [one[name] for one in sets] for name in self.bounds})
        texts = {one.given_name: one.text for one in self.metrics}
        results: dict[str, dict[str, np.ndarray]] = {}
        for case, diagram in self.cases.items():
            with no_step_warnings():
                values = study(diagram, plan, texts, threads=self.threads, **self.options.arguments)
            results[case] = {name: values[name] for name in texts}
            for one in self.limits:
                if one.metric is None:
                    margins = [one.margin_of(diagram.with_parameters(numbers), self.options) for numbers in sets]
                    results[case][one.name] = np.array(margins)
                else:
                    results[case][one.name] = values[one.metric.given_name]
        goal = np.max([one[self.goal.given_name] for one in results.values()], axis=0)
        over = [limit.excess(one[limit.name]) for limit in self.limits for one in results.values()]
        most = np.max(over, axis=0) if over else np.full(len(goal), -np.inf)
        bad = ~np.isfinite(goal) | np.isnan(most)
        return Measured(sets, results, np.where(bad, np.inf, goal), np.where(bad, np.inf, most))

    def warn_of_step(self, own: Mapping[str, float]) -> None:
        """Warn, at the line that called the caller, of a step that is too long for runs with the diagrams' ``own``
        parameters, or in the first case for those with each at its bounds.
        """
        ends = [{**own, name: end} for name, one in self.bounds.items() for end in (one.low, one.high)]
        columns = {name: np.array([one[name] for one in (own, *ends)]) for name in own}
        starts, batches = list[RunStart](), list[PreparedBatch]()
        names = list[tuple[str, Callable[[int, int], str], int]]()
        for case, diagram in list(self.cases.items())[:MOST_CHECKED]:
            some = columns if not starts else {name: values[:1] for name, values in columns.items()}
            groups = grouped(diagram, some, self.options)
            named = f"case '{case}', " if len(self.cases) > 1 else ""
            made, label = checked_batches(groups, self.metrics), set_labels(groups, some)
            batches += made
            names += [(named, label, at) for at in range(len(made))]
            starts += [attrs.evolve(one, label=named + one.label) for one in run_starts(groups, made, some)]

        def name(batch: int, k: int) -> str:
            named, label, at = names[batch]
            return named + label(at, k)

        warn_of_sets(starts[:MOST_CHECKED], batches, name, RANDOM_SETS, 5)

    def promising(self, own: Mapping[str, float], count: int, seed: int) -> list[dict[str, float]]:
        """The best of some random sets, those that meet the limits first.

        Where none does, further sets have some of the parameters at their lower bounds, such as gains of zero, which
        random sets hardly reach. The diagrams' ``own`` parameters are always measured, which raises their errors.
        """
        plan = latin_hypercube(self.bounds, max(RANDOM_SETS, 4 * count), seed=seed)
        sets = [plan.row(k) for k in range(len(plan) if count else 0)]
        measured = self.measured([own, *sets])
        goal, over = measured.goal[1:], measured.over[1:]
        if sets and not np.any(over <= LIMIT_TOLERANCE):
            low = np.random.default_rng(seed).random((len(sets), len(self.bounds))) < 1 / 2
            more = [
                {name: self.bounds[name].low if off else row[name] for name, off in zip(row, mask, strict=True)}
                for row, mask in zip(sets, low, strict=True)
            ]
            measured = self.measured(more)
            sets, goal, over = [*sets, *more], np.append(goal, measured.goal), np.append(over, measured.over)
        order = np.lexsort((goal, np.maximum(over, LIMIT_TOLERANCE)))
        return [sets[k] for k in order[:count] if np.isfinite(goal[k])]

    def idle(self, values: Mapping[str, float]) -> list[str]:
        """Parameters without effect on the goal and the limits, from bound to bound."""
        sets = [{**values, name: end} for name, one in self.bounds.items() for end in (one.low, one.high)]
        measured = self.measured([values, *sets])
        goal, over = measured.goal, measured.over
        same_excess = (over == over[0]) | np.isclose(over, over[0], rtol=IDLE_TOLERANCE)
        same = np.isclose(goal, goal[0], rtol=IDLE_TOLERANCE, atol=0) & same_excess
        return [name for k, name in enumerate(self.bounds) if same[2 * k + 1 : 2 * k + 3].all()]

    # ---- one search

    def walk(self, begin: Mapping[str, float], trail: list[dict[str, float]]) -> None:
        """Search from a set, with less and less smoothing, each time from where the last search ended.

        Every set that is evaluated is added to the ``trail``: at its end a search is close to the limits, and a run in
        another form may just violate them.
        """
        z = np.clip([self._scaled(name, begin[name]) for name in self.bounds], 0.0, 1.0)
        smoothed = any(one.smoothed for one in self._differentiable)
        for smoothing in SMOOTHING_SIZES if smoothed else SMOOTHING_SIZES[-1:]:
            at = self._remembered(smoothing, trail)
            if math.isfinite(at(z).merit):
                z = self._refined(self._stepped(z, at), at)

    def _remembered(self, smoothing: float, trail: list[dict[str, float]]) -> Callable[[np.ndarray], Linearised]:
        """The problem at a point, cached for a few points; every point is added to the trail."""

        @lru_cache(maxsize=4)
        def linearised(point: bytes) -> Linearised:
            z = np.frombuffer(point)
            problem = self._linearised(z, smoothing)
            trail.append(self._values(z))
            return problem

        return lambda z: linearised(z.tobytes())

    def _stepped(self, z: np.ndarray, at: Callable[[np.ndarray], Linearised]) -> np.ndarray:
        """Sequential linear programs; the trust region grows with each success and shrinks with each failure.

        Source: Madsen, J. Inst. Maths Applics 16 (1975), doi 10.1093/imamat/16.3.321.
        """
        from scipy.optimize import linprog

        width = FIRST_RADIUS
        for _ in range(MOST_STEPS):
            here, count = at(z), len(z)
            # of the step, the worst case s and the excess e: min s + LIMIT_PENALTY e with s, e above all linear models
            m, k = len(here.goal), len(here.excess)
            slacks = np.block([[-np.ones((m, 1)), np.zeros((m, 1))], [np.zeros((k, 1)), -np.ones((k, 1))]])
            A = np.hstack([np.vstack([here.goal_jacobian / here.scale, here.excess_jacobian]), slacks])
            b = np.concatenate([-here.goal / here.scale, -here.excess])
            region = [(max(-width, -v), min(width, 1.0 - v)) for v in z]
            step = linprog([*np.zeros(count), 1.0, LIMIT_PENALTY], A, b, bounds=[*region, (None, None), (0.0, None)]).x
            if step is None:
                break
            ahead = np.clip(z + step[:count], 0.0, 1.0)
            if at(ahead).improves_on(here):
                z, width = ahead, min(2.0 * width, 0.5)
            else:
                width *= 0.3
            if width < LEAST_RADIUS:
                break
        return z

    def _refined(self, z: np.ndarray, at: Callable[[np.ndarray], Linearised]) -> np.ndarray:
        """The end of a search: SLSQP over the point and the worst case, which is above all values of the goal."""
        from scipy.optimize import minimize

        begin = at(z)
        size = max(abs(float(begin.goal.max())), 1e-9)

        def room(v: np.ndarray) -> np.ndarray:
            here = at(v[:-1])
            return np.concatenate([v[-1] - here.goal / size, -here.excess])

        def gradient(v: np.ndarray) -> np.ndarray:
            here = at(v[:-1])
            worst_case = np.repeat([1.0, 0.0], [len(here.goal), len(here.excess)])
            return np.column_stack([np.vstack([-here.goal_jacobian / size, -here.excess_jacobian]), worst_case])

        end = minimize(
            lambda v: v[-1],
            np.append(z, float(begin.goal.max()) / size),
            jac=lambda _: np.append(np.zeros(len(z)), 1.0),
            method="SLSQP",
            bounds=[(max(v - LAST_RADIUS, 0.0), min(v + LAST_RADIUS, 1.0)) for v in z] + [(None, None)],
            options={"maxiter": MOST_LAST_STEPS, "ftol": 1e-8},
            constraints=[{"type": "ineq", "fun": room, "jac": gradient}],
        ).x[:-1]
        end = np.clip(end, 0.0, 1.0) if np.isfinite(end).all() else z
        return end if at(end).improves_on(begin) else z

    # ---- derivatives

    def _linearised(self, z: np.ndarray, smoothing: float) -> Linearised:
        (goal, goal_jacobian), *others = self._metrics_at(z, smoothing)
        of_metrics = iter(others)
        excess, jacobians = [np.empty(0)], [np.empty((0, len(z)))]
        for one in self.limits:
            values, jacobian = next(of_metrics) if one.metric is not None else self._margins_at(one, z)
            excess.append(one.aimed(values))
            jacobians.append(one.sign / max(abs(one.most), 1e-9) * jacobian)
        return Linearised(
            goal, np.concatenate(excess), np.nan_to_num(goal_jacobian), np.nan_to_num(np.vstack(jacobians))
        )

    def _metrics_at(self, z: np.ndarray, smoothing: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """The values of each differentiable metric in all cases, and their Jacobian by the scaled parameters."""
        numbers = self._values(z)
        scale = np.array([self._slope(name, numbers[name]) for name in self.bounds])
        wanted = list(dict.fromkeys(name for one in self._differentiable for name in one.metric.signals))
        pieces: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in self._differentiable]
        for diagram in self.cases.values():
            run = sensitivities_of(diagram.with_parameters(numbers), list(self.bounds), self.options, wanted)
            signals = {name: run.y[:, k] for k, name in enumerate(wanted)}
            derivatives = {name: run.jacobian[:, k] for k, name in enumerate(wanted)}
            with np.errstate(all="ignore"):
                for of_cases, metric in zip(pieces, self._differentiable, strict=True):
                    of_cases.append(metric(run.t, signals, derivatives, smoothing))
        parts = [tuple(zip(*of_cases, strict=True)) for of_cases in pieces]
        return [(np.concatenate(values), np.vstack(jacobians) * scale) for values, jacobians in parts]

    def _margins_at(self, one: Limit, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A margin in all cases, and its Jacobian by central differences, since a linear model is cheap."""
        steps = MARGIN_DIFFERENCE * np.eye(len(z))
        points = [z, *(np.clip(z + side * step, 0.0, 1.0) for step in steps for side in (1, -1))]
        cases = self.cases.values()
        margins = np.array(
            [[one.margin_of(d.with_parameters(self._values(p)), self.options) for p in points] for d in cases]
        )
        width = np.array([np.abs(a - b).max() for a, b in zip(points[1::2], points[2::2], strict=True)])
        return margins[:, 0], (margins[:, 1::2] - margins[:, 2::2]) / width

    # ---- scaled parameters, from 0 to 1 between their bounds

    def _scaled(self, name: str, value: float) -> float:
        one = self.bounds[name]
        if one.log:
            return math.log(max(value, one.low) / one.low) / math.log(one.high / one.low)
        return (value - one.low) / (one.high - one.low)

    def _values(self, z: np.ndarray) -> dict[str, float]:
        return {name: float(one.quantile(np.asarray(v))) for (name, one), v in zip(self.bounds.items(), z, strict=True)}

    def _slope(self, name: str, value: float) -> float:
        """The derivative of a parameter by its scaled value."""
        one = self.bounds[name]
        return value * math.log(one.high / one.low) if one.log else one.high - one.low
