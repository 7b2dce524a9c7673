"""Find the parameters of a controller: exact gradients, constraints, several starts, the worst of several plants."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from tsmblocks.arguments import prepared, whole
from tsmblocks.batch import sensitivities
from tsmblocks.diagram import Diagram
from tsmblocks.errors import ParameterError, RunError, in_words, near
from tsmblocks.metrics import Metric, metric
from tsmblocks.studies import Plan, Uniform, latin_hypercube, study, table
from tsmblocks.studies.plans import between
from tsmblocks.studies.study import signal_units
from tsmblocks.tuning.limits import Limit, limit
from tsmblocks.tuning.slopes import Sloped, sloped
from tsmblocks.tuning.tuned import Tuned

SHARP = (0.05, 0.01, 0.002)
"""How far a peak or a share is rounded, as a share of the signal's size, in one search after another."""
TRIED = 64
"""Sets that are looked at before the searches, for each of them to begin at a good one."""
APART = 1e-4
"""Share of a number's bounds over which a margin is differentiated."""
STEPS = 40
"""Steps of one search at most."""
LAST_STEPS = 8
"""Steps of the last search, with curvature, at most."""
FIRST, NARROWEST, NEAR = 0.1, 1e-5, 0.05
"""Width of the region that is trusted at first and at last, and that of the last search, as shares of the bounds."""
PRICE = 10.0
"""What exceeding a limit by its own size costs, in sizes of the goal."""
MET = 1e-3
"""Share of a limit by which it may be missed and still counts as met."""
EDGE = 1e-6
"""Distance from a bound, as a share of the bounds, that counts as lying on it."""
IDLE = 1e-12
"""Relative change that is rounding only."""
WIDE = 20.0
"""Ratio of bounds above which a number is searched by ratios."""


Rows = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def tune(
    diagrams: Diagram | Mapping[str, Diagram], free: Mapping[str, Any], minimise: str, *,
    subject_to: Sequence[str] = (), plants: Plan | None = None, stop: float | None = None, step: float = 1e-3,
    method: str = "rk4", inputs: Mapping[str, Any] | None = None, hold: str = "linear", starts: int = 4, seed: int = 0,
    threads: int | None = None, progress: Callable[[str, int, int], Any] | None = None, backend: str = "",
) -> Tuned:  # fmt: skip
    """Find parameters that make a metric small, in the worst case, within limits.

    ``free`` maps parameters to bounds ``(low, high)``; ``minimise`` is a metric such as
    ``"peak_to_peak(x_ref - x_out, after=10)"``, ``subject_to`` limits such as ``"share(abs(u) > 23.9) <= 0.01"``, or
    ``"phase_margin('controller -> drive') >= 45"`` [deg] and ``gain_margin`` (a ratio) of the loop opened at a wire.
    Several ``diagrams`` (signals, say) are cases, and so is every set of ``plants``; what counts is the worst of them.

    The searches use exact derivatives of the runs (shares are rounded off, less and less); they begin at the diagrams'
    own numbers and at the best of some random sets. The numbers returned are measured without rounding, and
    are never worse than the diagrams' own where those meet the limits. ``progress(stage, done, all)`` is called as it
    goes. Other arguments as for ``simulate``. Raises ParameterError.
    """
    named = _named(diagrams)
    cases = _cases(named, plants)
    bounds = _bounds(free, next(iter(cases.values())))
    units = signal_units(next(iter(cases.values())))
    goal = metric(minimise, units)
    limits = [limit(text, units, next(iter(cases.values()))) for text in subject_to]
    how = dict(stop=stop, step=step, method=method, inputs=inputs, hold=hold, backend=backend)
    search = _Search(cases, bounds, goal, limits, how, threads)
    tell = progress or (lambda *_: None)
    own = {name: next(iter(cases.values())).parameters[name] for name in bounds}
    inside = all(one.low <= own[name] <= one.high for name, one in bounds.items())
    tried, status = [own] if inside else [], "complete"
    try:
        begins = [own, *search.promising(whole("starts", starts, 1) - 1, seed)]
        for k, begin in enumerate(begins):
            tell("searched", k, len(begins))
            tried += search.ends(begin)
        tell("searched", len(begins), len(begins))
    except KeyboardInterrupt:
        if not tried:
            raise
        status = "interrupted"
    return search.best(tried, own, named, status)


@attrs.frozen(eq=False)
class _Search:
    """The problem: cases, free numbers with bounds, what is to be small and what is to hold."""

    cases: Mapping[str, Diagram]
    bounds: Mapping[str, Uniform]
    goal: Metric
    limits: Sequence[Limit]
    how: Mapping[str, Any]
    threads: int | None

    @property
    def metrics(self) -> list[Metric]:
        """What is measured in the runs: the goal, then what the limits name, each once."""
        named = (self.goal, *(one.metric for one in self.limits if one.metric is not None))
        return list({one.text: one for one in named}.values())

    @property
    def units(self) -> dict[str, str]:
        """All that is measured, by name, with its unit."""
        return {self.goal.text: self.goal.unit, **{one.name: one.unit for one in self.limits}}

    def measured(self, sets: Sequence[Mapping[str, float]]) -> dict[str, dict[str, np.ndarray]]:
        """Metrics and margins (sets,) of each case, without rounding."""
        plan = table({name: [one[name] for one in sets] for name in self.bounds})
        texts = {one.text: one.text for one in self.metrics}
        made = {}
        for case, diagram in self.cases.items():
            found = study(diagram, plan, texts, threads=self.threads, **self.how)
            made[case] = {one.text: found[one.text] for one in self.metrics}
            for one in self.limits:
                if one.metric is None:
                    margins = [one.margin_of(diagram.with_parameters(numbers)) for numbers in sets]
                    made[case][one.name] = np.array(margins)
                else:
                    made[case][one.name] = found[one.metric.text]
        return made

    def scores(self, sets: Sequence[Mapping[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        """The goal in the worst case and the largest excess of a limit, each (sets,); infinite where not finite."""
        return self._scores(self.measured(sets))

    def _scores(self, found: Mapping[str, Mapping[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
        goal = np.max([one[self.goal.text] for one in found.values()], axis=0)
        over = [limit.excess(one[limit.name]) for limit in self.limits for one in found.values()]
        most = np.max(over, axis=0) if over else np.full(len(goal), -np.inf)
        bad = ~np.isfinite(goal) | np.isnan(most)
        return np.where(bad, np.inf, goal), np.where(bad, np.inf, most)

    def promising(self, count: int, seed: int) -> list[dict[str, float]]:
        """The best of some random sets, those that meet the limits first."""
        if not count:
            return []
        plan = latin_hypercube(self.bounds, max(TRIED, 4 * count), seed=seed)
        sets = [plan.row(k) for k in range(len(plan))]
        goal, over = self.scores(sets)
        order = np.lexsort((goal, np.maximum(over, MET)))
        return [sets[k] for k in order[:count] if np.isfinite(goal[k])]

    def ends(self, begin: Mapping[str, float]) -> list[dict[str, float]]:
        """Where searches end that begin at a set: one for each sharpness, each from where the last one ended."""
        made, z = [], np.clip([self._scaled(name, begin[name]) for name in self.bounds], 0.0, 1.0)
        rounded = any(one.rounded for one in self._marks)
        for sharp in SHARP if rounded else SHARP[-1:]:
            z = self._searched(z, sharp)
            made.append(self._values(z))
        return made

    def _searched(self, z: np.ndarray, sharp: float) -> np.ndarray:
        """Where a search ends: steps by linear programs within a region that is trusted, then one with curvature.

        Source: Madsen, J. Inst. Maths Applics 16 (1975), doi 10.1093/imamat/16.3.321, for the linear programs.
        """
        from scipy.optimize import minimize

        at = self._remembered(sharp)
        if not np.isfinite(self._merit(*at(z)[:2])):
            return z
        z = self._stepped(z, at)
        size = max(abs(float(at(z)[0].max())), 1e-9)
        last = np.eye(len(z) + 1)[-1]

        def room(v: np.ndarray) -> np.ndarray:
            goal, over, *_ = at(v[:-1])
            return np.concatenate([v[-1] - goal / size, -over])

        def slope(v: np.ndarray) -> np.ndarray:
            _, _, by, beyond = at(v[:-1])
            return np.vstack([np.column_stack([-by / size, np.ones(len(by))]),
                              np.column_stack([-beyond, np.zeros(len(beyond))])])  # fmt: skip

        found = minimize(
            lambda v: v[-1], np.append(z, float(at(z)[0].max()) / size), jac=lambda _: last, method="SLSQP",
            bounds=[(max(v - NEAR, 0.0), min(v + NEAR, 1.0)) for v in z] + [(None, None)],
            options={"maxiter": LAST_STEPS, "ftol": 1e-8}, constraints=[{"type": "ineq", "fun": room, "jac": slope}],
        ).x[:-1]  # fmt: skip
        end = np.clip(found, 0.0, 1.0) if np.isfinite(found).all() else z
        return min((z, end), key=lambda one: self._merit(*at(one)[:2]))

    def _stepped(self, z: np.ndarray, at: Callable[[np.ndarray], Rows]) -> np.ndarray:
        """Steps, each to where the linear model of everything is least within a region, as wide as it proves right."""
        from scipy.optimize import linprog

        width, best = FIRST, self._merit(*at(z)[:2])
        for _ in range(STEPS):
            goal, over, by, beyond = at(z)
            size, count = max(float(np.abs(goal).max()), 1e-9), len(z)
            # of the step d, the worst case s and the excess e: min s + PRICE e with s, e above all linear models
            A = np.vstack([np.column_stack([by / size, -np.ones(len(by)), np.zeros(len(by))]),
                           np.column_stack([beyond, np.zeros(len(beyond)), -np.ones(len(beyond))])])  # fmt: skip
            b = np.concatenate([-goal / size, -over])
            region = [(max(-width, -v), min(width, 1.0 - v)) for v in z]
            found = linprog([*np.zeros(count), 1.0, PRICE], A, b, bounds=[*region, (None, None), (0.0, None)])
            if found.x is None:
                break
            ahead = np.clip(z + found.x[:count], 0.0, 1.0)
            merit = self._merit(*at(ahead)[:2])
            if merit < best - 1e-9 * abs(best):
                width = min(2.0 * width, 0.5)
                z, best = ahead, merit
            else:
                width *= 0.3
            if width < NARROWEST:
                break
        return z

    def _merit(self, goal: np.ndarray, over: np.ndarray) -> float:
        """The worst case, and what limits are exceeded at a price; infinite where something is no number."""
        if not (np.isfinite(goal).all() and np.isfinite(over).all()):
            return math.inf
        return float(goal.max()) + PRICE * max(float(over.max(initial=0.0)), 0.0) * max(float(np.abs(goal).max()), 1e-9)

    def _remembered(self, sharp: float) -> Callable[[np.ndarray], Rows]:
        """The rows at a point, the last few points kept."""
        known: dict[bytes, Rows] = {}

        def at(z: np.ndarray) -> Rows:
            key = z.tobytes()
            if key not in known:
                if len(known) > 3:
                    known.pop(next(iter(known)))
                known[key] = self._rows(z, sharp)
            return known[key]

        return at

    @cached_property
    def _marks(self) -> list[Sloped]:
        """What is differentiated: the goal, then each limit's metric."""
        return [sloped(self.goal), *(sloped(one.metric) for one in self.limits if one.metric is not None)]

    def _rows(self, z: np.ndarray, sharp: float) -> Rows:
        """All that the goal is the largest of (m,), how far limits are exceeded (k,), and the slopes of both."""
        (goal, by), *others = self._pieces(z, self._marks, sharp)
        pieces = iter(others)
        over, beyond = [np.empty(0)], [np.empty((0, len(z)))]
        for one in self.limits:
            found, along = next(pieces) if one.metric is not None else self._margins(one, z)
            over.append(one.excess(found))
            beyond.append(one.sign / max(abs(one.most), 1e-9) * along)
        return goal, np.concatenate(over), np.nan_to_num(by), np.nan_to_num(np.vstack(beyond))

    def _pieces(self, z: np.ndarray, marks: Sequence[Sloped], sharp: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each of ``marks`` its values in all cases, and their derivatives by the scaled numbers."""
        numbers = self._values(z)
        by = np.array([self._slope(name, numbers[name]) for name in self.bounds])
        wanted = list(dict.fromkeys(name for one in marks for name in one.metric.signals))
        found: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in marks]
        for diagram in self.cases.values():
            run = sensitivities(diagram.with_parameters(numbers), list(self.bounds), outputs=wanted, **self.how)
            signals = {name: run.y[:, k] for k, name in enumerate(wanted)}
            along = {name: run.jacobian[:, k] for k, name in enumerate(wanted)}
            with np.errstate(all="ignore"):
                for mine, mark in zip(found, marks, strict=True):
                    mine.append(mark(run.t, signals, along, sharp))
        return [(np.concatenate([v for v, _ in mine]), np.vstack([w for _, w in mine]) * by) for mine in found]

    def _margins(self, one: Limit, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A margin in all cases, and its derivatives by central differences: a linear model costs next to nothing."""
        points = [z, *(np.clip(z + side * APART * row, 0.0, 1.0) for row in np.eye(len(z)) for side in (1, -1))]
        found = np.array([[one.margin_of(d.with_parameters(self._values(p))) for p in points]
                          for d in self.cases.values()])  # fmt: skip
        width = np.array([np.abs(a - b).max() for a, b in zip(points[1::2], points[2::2], strict=True)])
        return found[:, 0], (found[:, 1::2] - found[:, 2::2]) / width

    # ---- scaled numbers

    def _scaled(self, name: str, value: float) -> float:
        one = self.bounds[name]
        if one.log:
            return math.log(max(value, one.low) / one.low) / math.log(one.high / one.low)
        return (value - one.low) / (one.high - one.low)

    def _values(self, z: np.ndarray) -> dict[str, float]:
        return {name: float(one.quantile(np.asarray(v)))
                for (name, one), v in zip(self.bounds.items(), z, strict=True)}  # fmt: skip

    def _slope(self, name: str, value: float) -> float:
        one = self.bounds[name]
        return value * math.log(one.high / one.low) if one.log else one.high - one.low

    # ---- what comes out

    def best(
        self, tried: Sequence[Mapping[str, float]], own: Mapping[str, float], diagrams: Mapping[str, Diagram],
        status: str,
    ) -> Tuned:  # fmt: skip
        """The best set: of those that meet the limits the one with the smallest goal, else the one that nearly does."""
        found = self.measured([own, *tried])
        goal, over = (side[1:] for side in self._scores(found))
        k = int(np.lexsort((goal, np.maximum(over, MET)))[0])
        if not np.isfinite(goal[k]):
            raise RunError("no set of numbers was found with which every case runs to its end.")
        before, after = ({case: {name: float(v[side]) for name, v in each.items()} for case, each in found.items()}
                         for side in (0, k + 1))  # fmt: skip
        values = dict(tried[k])
        made = {name: d.with_parameters(values) for name, d in diagrams.items()}
        idle = self._idle(values)
        held = self._at_bounds({name: v for name, v in values.items() if name not in idle})
        remarks = (*self._missed(after), *held, *(f"{name} changes nothing that was asked about." for name in idle))
        return Tuned(values, made, self.goal.text, self.units, before, after, bool(over[k] <= MET), status, remarks)

    def _missed(self, found: Mapping[str, Mapping[str, float]]) -> list[str]:
        """Limits that do not hold in the worst case."""
        said = []
        for one in self.limits:
            case, value = max(((c, v[one.name]) for c, v in found.items()), key=lambda pair: one.excess(pair[1]))
            if one.excess(value) > MET:
                where = f" in {case}" if len(found) > 1 else ""
                said.append(f"{one.text} is not met: it is {value:.4g} {one.unit}".rstrip() + f"{where}.")
        return said

    def _at_bounds(self, values: Mapping[str, float]) -> list[str]:
        """Numbers that their bounds hold."""
        made = []
        for name in values:
            z = self._scaled(name, values[name])
            if min(z, 1 - z) < EDGE:
                made.append(f"{name} lies at its {'upper' if z > 0.5 else 'lower'} bound.")
        return made

    def _idle(self, values: Mapping[str, float]) -> list[str]:
        """Numbers that change neither the goal nor a limit, from bound to bound."""
        names = list(self.bounds)
        sets = [{**values, name: end} for name in names for end in (self.bounds[name].low, self.bounds[name].high)]
        goal, over = self.scores([values, *sets])
        same = np.isclose(goal, goal[0], rtol=IDLE, atol=0) & ((over == over[0]) | np.isclose(over, over[0], rtol=IDLE))
        return [name for k, name in enumerate(names) if same[2 * k + 1 : 2 * k + 3].all()]


# ---- what is asked for ------------------------------------------------------------------------------


def _named(diagrams: Any) -> dict[str, Diagram]:
    if isinstance(diagrams, Mapping):
        if not diagrams:
            raise ParameterError("tune needs at least one diagram.")
        return {str(name): prepared(one) for name, one in diagrams.items()}
    one = prepared(diagrams)
    return {one.title or "diagram": one}


def _cases(named: dict[str, Diagram], plants: Plan | None) -> dict[str, Diagram]:
    """Every diagram with every plant."""
    if plants is None:
        return named
    if not isinstance(plants, Plan):
        raise ParameterError(f"plants is a plan such as monte_carlo gives, got {in_words(plants)}.")
    return {f"{name}, plant {k}": one.with_parameters(plants.row(k))
            for name, one in named.items() for k in range(len(plants))}  # fmt: skip


def _bounds(free: Any, diagram: Diagram) -> dict[str, Uniform]:
    if not isinstance(free, Mapping) or not free:
        raise ParameterError(f"free maps parameters to bounds, such as {{'pid.kp': (0.1, 5.0)}}, got {in_words(free)}.")
    made = {}
    for name, pair in free.items():
        if name not in diagram.parameters:
            hint = near(name, diagram.parameters)
            raise ParameterError(f"diagram '{diagram.title}' has no parameter '{name}'.{hint}")
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise ParameterError(f"'{name}' needs bounds (low, high), got {in_words(pair)}.") from None
        made[str(name)] = between(str(name), low, high, log=low > 0 and high / low > WIDE)
    return made
