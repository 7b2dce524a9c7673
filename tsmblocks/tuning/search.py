"""The search behind ``tune``: exact gradients, constraints, several starts, the worst of several plants."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.metrics.metrics import Metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.run_options import RunOptions
from tsmblocks.simulation.sensitivities import sensitivities_of
from tsmblocks.simulation.stability import MOST_CHECKED, RunStart, no_step_warnings
from tsmblocks.studies import Uniform, latin_hypercube, study, table
from tsmblocks.studies.runner import checked_batches, grouped, run_starts
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
Rows = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


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

    @property
    def units(self) -> dict[str, str]:
        """Units of all metrics and margins by name."""
        return {self.goal.given_name: self.goal.unit, **{one.name: one.unit for one in self.limits}}

    def measured(self, sets: Sequence[Mapping[str, float]]) -> dict[str, dict[str, np.ndarray]]:
        """Metrics and margins (sets,) of each case, without smoothing."""
        plan = table({name: [one[name] for one in sets] for name in self.bounds})
        texts = {one.given_name: one.text for one in self.metrics}
        made = {}
        for case, diagram in self.cases.items():
            with no_step_warnings():
                found = study(diagram, plan, texts, threads=self.threads, **self.options.arguments)
            made[case] = {one.given_name: found[one.given_name] for one in self.metrics}
            for one in self.limits:
                if one.metric is None:
                    margins = [one.margin_of(diagram.with_parameters(numbers)) for numbers in sets]
                    made[case][one.name] = np.array(margins)
                else:
                    made[case][one.name] = found[one.metric.given_name]
        return made

    def run_starts(self, own: Mapping[str, float]) -> list[RunStart]:
        """Starts of runs with the diagrams' ``own`` parameters, and in the first case with each at its bounds."""
        ends = [{**own, name: end} for name, one in self.bounds.items() for end in (one.low, one.high)]
        columns = {name: np.array([one[name] for one in (own, *ends)]) for name in own}
        made: list[RunStart] = []
        for case, diagram in list(self.cases.items())[:MOST_CHECKED]:
            groups = grouped(diagram, columns, self.options)
            found = run_starts(groups, checked_batches(groups, self.metrics), columns)[: 1 if made else None]
            named = f"case '{case}', " if len(self.cases) > 1 else ""
            made += [attrs.evolve(one, label=named + one.label) for one in found]
        return made[:MOST_CHECKED]

    @property
    def watched(self) -> list[str]:
        """Signals that the goal and the limits name, and outputs of the diagrams."""
        named = [name for one in self.metrics for name in one.signals]
        return list(dict.fromkeys([*named, *next(iter(self.cases.values())).outputs]))

    def _scores(self, found: Mapping[str, Mapping[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
        """The goal in the worst case and the largest excess of a limit, each (sets,); infinite where not finite."""
        goal = np.max([one[self.goal.given_name] for one in found.values()], axis=0)
        over = [limit.excess(one[limit.name]) for limit in self.limits for one in found.values()]
        most = np.max(over, axis=0) if over else np.full(len(goal), -np.inf)
        bad = ~np.isfinite(goal) | np.isnan(most)
        return np.where(bad, np.inf, goal), np.where(bad, np.inf, most)

    def promising(self, own: Mapping[str, float], count: int, seed: int) -> list[dict[str, float]]:
        """The best of some random sets, those that meet the limits first.

        Where none does, further sets have some of the parameters at their lower bounds, such as gains of zero, which
        random sets hardly reach. The diagrams' ``own`` parameters are always measured, which raises their errors.
        """
        plan = latin_hypercube(self.bounds, max(RANDOM_SETS, 4 * count), seed=seed)
        sets = [plan.row(k) for k in range(len(plan) if count else 0)]
        goal, over = (side[1:] for side in self._scores(self.measured([own, *sets])))
        if sets and not np.any(over <= LIMIT_TOLERANCE):
            low = np.random.default_rng(seed).random((len(sets), len(self.bounds))) < 1 / 2
            more = [
                {name: self.bounds[name].low if off else row[name] for name, off in zip(row, mask, strict=True)}
                for row, mask in zip(sets, low, strict=True)
            ]
            found = self._scores(self.measured(more))
            sets, goal, over = [*sets, *more], np.append(goal, found[0]), np.append(over, found[1])
        order = np.lexsort((goal, np.maximum(over, LIMIT_TOLERANCE)))
        return [sets[k] for k in order[:count] if np.isfinite(goal[k])]

    def walk(self, begin: Mapping[str, float], trail: list[dict[str, float]]) -> None:
        """Search from a set, for one sharpness after another, each from where the last one ended.

        Every set that is evaluated is added to the ``trail``: at its end a search is close to the limits, and a run in
        another form may just violate them.
        """
        z = np.clip([self._scaled(name, begin[name]) for name in self.bounds], 0.0, 1.0)
        rounded = any(one.rounded for one in self._differentiable)
        for sharp in SMOOTHING_SIZES if rounded else SMOOTHING_SIZES[-1:]:
            z = self._searched(z, sharp, trail)

    def _searched(self, z: np.ndarray, sharp: float, trail: list[dict[str, float]]) -> np.ndarray:
        """The end of a search: sequential linear programs in a trust region, then SLSQP.

        Source: Madsen, J. Inst. Maths Applics 16 (1975), doi 10.1093/imamat/16.3.321, for the linear programs.
        """
        from scipy.optimize import minimize

        at = self._remembered(sharp, trail)
        if not np.isfinite(self._merit(*at(z)[:2])):
            return z
        z = self._stepped(z, at)
        size = max(abs(float(at(z)[0].max())), 1e-9)
        last = np.eye(len(z) + 1)[-1]

        def room(v: np.ndarray) -> np.ndarray:
            goal, over, *_ = at(v[:-1])
            return np.concatenate([v[-1] - goal / size, -over])

        def gradient(v: np.ndarray) -> np.ndarray:
            _, _, by, beyond = at(v[:-1])
            return np.vstack(
                [np.column_stack([-by / size, np.ones(len(by))]), np.column_stack([-beyond, np.zeros(len(beyond))])]
            )

        found = minimize(
            lambda v: v[-1],
            np.append(z, float(at(z)[0].max()) / size),
            jac=lambda _: last,
            method="SLSQP",
            bounds=[(max(v - LAST_RADIUS, 0.0), min(v + LAST_RADIUS, 1.0)) for v in z] + [(None, None)],
            options={"maxiter": MOST_LAST_STEPS, "ftol": 1e-8},
            constraints=[{"type": "ineq", "fun": room, "jac": gradient}],
        ).x[:-1]
        end = np.clip(found, 0.0, 1.0) if np.isfinite(found).all() else z
        return end if self._leads_on(at(z), at(end)) else z

    def _stepped(self, z: np.ndarray, at: Callable[[np.ndarray], Rows]) -> np.ndarray:
        """Sequential linear programs; the trust region grows with each success and shrinks with each failure."""
        from scipy.optimize import linprog

        width = FIRST_RADIUS
        for _ in range(MOST_STEPS):
            goal, over, by, beyond = at(z)
            size, count = max(float(np.abs(goal).max()), 1e-9), len(z)
            # of the step d, the worst case s and the excess e: min s + PRICE e with s, e above all linear models
            A = np.vstack(
                [
                    np.column_stack([by / size, -np.ones(len(by)), np.zeros(len(by))]),
                    np.column_stack([beyond, np.zeros(len(beyond)), -np.ones(len(beyond))]),
                ]
            )
            b = np.concatenate([-goal / size, -over])
            region = [(max(-width, -v), min(width, 1.0 - v)) for v in z]
            found = linprog([*np.zeros(count), 1.0, LIMIT_PENALTY], A, b, bounds=[*region, (None, None), (0.0, None)])
            if found.x is None:
                break
            ahead = np.clip(z + found.x[:count], 0.0, 1.0)
            if self._leads_on(at(z), at(ahead)):
                width = min(2.0 * width, 0.5)
                z = ahead
            else:
                width *= 0.3
            if width < LEAST_RADIUS:
                break
        return z

    def _leads_on(self, now: Rows, ahead: Rows) -> bool:
        """Whether a point is better and exceeds the limits no more: where a limit is flat (a saturation) no penalty
        would lead back.
        """
        best, over = self._merit(*now[:2]), [max(float(one[1].max(initial=0.0)), LIMIT_MARGIN) for one in (now, ahead)]
        return self._merit(*ahead[:2]) < best - 1e-9 * abs(best) and over[1] <= over[0]

    def _merit(self, goal: np.ndarray, over: np.ndarray) -> float:
        """The worst case plus the penalty for exceeded limits; infinite where a value is not finite."""
        if not (np.isfinite(goal).all() and np.isfinite(over).all()):
            return math.inf
        return float(goal.max()) + LIMIT_PENALTY * max(float(over.max(initial=0.0)), 0.0) * max(
            float(np.abs(goal).max()), 1e-9
        )

    def _remembered(self, sharp: float, trail: list[dict[str, float]]) -> Callable[[np.ndarray], Rows]:
        """The rows at a point, cached for a few points; every point is added to the trail."""
        known: dict[bytes, Rows] = {}

        def at(z: np.ndarray) -> Rows:
            key = z.tobytes()
            if key not in known:
                if len(known) > 3:
                    known.pop(next(iter(known)))
                known[key] = self._rows(z, sharp)
                trail.append(self._values(z))
            return known[key]

        return at

    @cached_property
    def _differentiable(self) -> list[DifferentiableMetric]:
        """The goal, then the metric of each limit, with derivatives."""
        return [
            differentiable(self.goal),
            *(differentiable(one.metric) for one in self.limits if one.metric is not None),
        ]

    def _rows(self, z: np.ndarray, sharp: float) -> Rows:
        """Values of which the goal is the largest (m,), the excess of the limits (k,), and the derivatives of both."""
        (goal, by), *others = self._pieces(z, self._differentiable, sharp)
        pieces = iter(others)
        over, beyond = [np.empty(0)], [np.empty((0, len(z)))]
        for one in self.limits:
            found, along = next(pieces) if one.metric is not None else self._margins(one, z)
            over.append(one.aimed(found))
            beyond.append(one.sign / max(abs(one.most), 1e-9) * along)
        return goal, np.concatenate(over), np.nan_to_num(by), np.nan_to_num(np.vstack(beyond))

    def _pieces(
        self, z: np.ndarray, marks: Sequence[DifferentiableMetric], sharp: float
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each of ``marks`` its values in all cases, and their derivatives by the scaled parameters."""
        numbers = self._values(z)
        by = np.array([self._scale(name, numbers[name]) for name in self.bounds])
        wanted = list(dict.fromkeys(name for one in marks for name in one.metric.signals))
        found: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in marks]
        for diagram in self.cases.values():
            run = sensitivities_of(diagram.with_parameters(numbers), list(self.bounds), self.options, wanted)
            signals = {name: run.y[:, k] for k, name in enumerate(wanted)}
            along = {name: run.jacobian[:, k] for k, name in enumerate(wanted)}
            with np.errstate(all="ignore"):
                for mine, mark in zip(found, marks, strict=True):
                    mine.append(mark(run.t, signals, along, sharp))
        return [(np.concatenate([v for v, _ in mine]), np.vstack([w for _, w in mine]) * by) for mine in found]

    def _margins(self, one: Limit, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A margin in all cases, and its derivatives by central differences, since a linear model is cheap."""
        points = [
            z,
            *(np.clip(z + side * MARGIN_DIFFERENCE * row, 0.0, 1.0) for row in np.eye(len(z)) for side in (1, -1)),
        ]
        found = np.array(
            [[one.margin_of(d.with_parameters(self._values(p))) for p in points] for d in self.cases.values()]
        )
        width = np.array([np.abs(a - b).max() for a, b in zip(points[1::2], points[2::2], strict=True)])
        return found[:, 0], (found[:, 1::2] - found[:, 2::2]) / width

    # ---- scaled parameters

    def _scaled(self, name: str, value: float) -> float:
        one = self.bounds[name]
        if one.log:
            return math.log(max(value, one.low) / one.low) / math.log(one.high / one.low)
        return (value - one.low) / (one.high - one.low)

    def _values(self, z: np.ndarray) -> dict[str, float]:
        return {name: float(one.quantile(np.asarray(v))) for (name, one), v in zip(self.bounds.items(), z, strict=True)}

    def _scale(self, name: str, value: float) -> float:
        one = self.bounds[name]
        return value * math.log(one.high / one.low) if one.log else one.high - one.low

    # ---- result

    def idle(self, values: Mapping[str, float]) -> list[str]:
        """Parameters without effect on the goal and the limits, from bound to bound."""
        sets = [{**values, name: end} for name, one in self.bounds.items() for end in (one.low, one.high)]
        goal, over = self._scores(self.measured([values, *sets]))
        same = np.isclose(goal, goal[0], rtol=IDLE_TOLERANCE, atol=0) & (
            (over == over[0]) | np.isclose(over, over[0], rtol=IDLE_TOLERANCE)
        )
        return [name for k, name in enumerate(self.bounds) if same[2 * k + 1 : 2 * k + 3].all()]

    def judged(self, own: Mapping[str, float], trails: Sequence[Sequence[Mapping[str, float]]]) -> Judged:
        """The diagrams' ``own`` parameters and all sets of the trails, measured."""
        sets = [own, *(one for trail in trails for one in trail)]
        found = self.measured(sets)
        goal, over = self._scores(found)
        ends = np.cumsum([1, *(len(trail) for trail in trails)])
        of = [np.arange(a, b) for a, b in pairwise(ends)]
        return Judged(sets, found, goal, over, [_best(goal, over, among) for among in of if len(among)])


@attrs.frozen(eq=False)
class Judged:
    """Sets of parameters, the diagrams' own first, with ``found``: metrics (sets,) by case and name.

    ``goal`` and ``over`` (sets,) are the goal in the worst case and the largest excess of a limit; ``ends`` are the
    positions of the best set of each trail.
    """

    sets: Sequence[Mapping[str, float]]
    found: Mapping[str, Mapping[str, np.ndarray]]
    goal: np.ndarray
    over: np.ndarray
    ends: Sequence[int]

    @property
    def best(self) -> int:
        """Position of the best set. Raises RunError where no run of any set comes to its end."""
        k = _best(self.goal, self.over, np.array(self.ends))
        if not np.isfinite(self.goal[k]):
            raise RunError("no set of parameters was found with which every case runs to its end.")
        return k

    @property
    def agreeing(self) -> int:
        """Number of trails with a set about as good as the best."""
        best, ends = self.best, np.array(self.ends)
        gained = self.goal[0] - self.goal[best] if np.isfinite(self.goal[0]) else 0.0
        near = np.abs(self.goal[ends] - self.goal[best]) <= GOAL_TOLERANCE * max(abs(self.goal[best]), gained)
        return int(
            np.sum(
                near
                & (
                    np.maximum(self.over[ends], LIMIT_TOLERANCE)
                    <= max(self.over[best], LIMIT_TOLERANCE) + GOAL_TOLERANCE
                )
            )
        )

    def of(self, k: int) -> dict[str, dict[str, float]]:
        """The metrics of one set, by case and name."""
        return {case: {name: float(v[k]) for name, v in each.items()} for case, each in self.found.items()}


def _best(goal: np.ndarray, over: np.ndarray, among: np.ndarray) -> int:
    """Of the sets within the limits that with the smallest goal, else that with the smallest excess."""
    return int(among[np.lexsort((goal[among], np.maximum(over[among], LIMIT_TOLERANCE)))[0]])
