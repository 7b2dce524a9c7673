"""Screening: the predicted fall of the sum of squares of each candidate before it is fitted.

Base parameters are projected out. Source: Frisch and Waugh, Econometrica 1 (1933), 387-401.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate, WireSignals
from tsmblocks.diagnosis.model import Model, ModelSettings, pose_extended, signals_at
from tsmblocks.diagnosis.own_instants import Products, falls, for_each, joined, moved, noise_gains, regular
from tsmblocks.diagnosis.screening_score import MAX_SIZE_FACTOR, ScreeningScore, ShapeSensitivity
from tsmblocks.diagnosis.shape_trial import ShapeTrial, fit_starts
from tsmblocks.diagnosis.size_beyond_states import MAX_VALUES, size_beyond_states
from tsmblocks.diagnosis.slow_sums import is_slow
from tsmblocks.fitting.column_space import ColumnSpace
from tsmblocks.fitting.inner_products import product
from tsmblocks.fitting.residuals import Problem

REFINEMENT_SHAPES = 12
"""Shapes tried on each side of the best one in a refinement of the grid. Chosen."""
REFINEMENT_ROUNDS = 3
"""Refinements of the grid, at most. Chosen: each narrows it to a thirteenth, so three reach 100,000 samples."""
DIVERGENCE_THRESHOLD = 1e30
"""Change of an output [rms noise] from which a simulation has diverged. Chosen: far from both data and overflow."""
MIN_SENSITIVITY = 1e-4
"""Share of the change by an effect that the base cannot follow, below which the effect is not detectable at any size.
Chosen: the remainder is the error of a linear step."""
DOMINATING = 0.2
"""Effect of a parameter of the base on the outputs, as a share of the largest, from which it absorbs an effect.
Chosen."""
MAX_EXTRAPOLATION = 4.0
"""The same for effects whose size is part of the shape. Chosen: the distance of neighbouring shapes."""


def screening_score(
    candidate: Candidate,
    model: Model,
    records: Mapping,
    settings: ModelSettings,
    wires: WireSignals,
    base: ColumnSpace,
    noise: np.ndarray,
    screened: Model,
) -> ScreeningScore:
    """Simulate a candidate's shapes and sizes in one batch.

    ``noise`` (N, D) are surrogates of the residual with the base projected out. ``screened`` is the model at the step
    of screening; the fit of the candidate, which follows, has that of the ``model``.
    """
    trials, states = candidate.trials, candidate.initialised_states
    named = {f"{candidate.block}.{k}": pair for k, pair in trials.bounds.items()}
    bounds = {k: v for k, v in named.items() if settings.start_states or k in candidate.free}  # else fixed
    own = candidate.local
    posed = candidate.diagram, candidate.free, records, settings, bounds, states, own
    problem, setup = pose_extended(model, *posed)
    simulated = problem if screened is model else pose_extended(screened, *posed)[0]
    start = _starting_values(problem, model, candidate, wires)
    screening = _Screening(candidate, simulated, model, base, start, screened.r)
    coarse, fine = screening.of_each_experiment(noise) if screening.owns_shapes else screening.of_all(noise)
    gains = np.max([one.noise_gains for one in coarse], axis=0)
    shapes = tuple(ShapeSensitivity(one.shape, one.sensitivity, one.exceeds_range, one.absorbed_by) for one in coarse)
    best = max(fine, key=lambda one: one.gain)
    fitted, starts = fit_starts(problem, candidate, fine, base)
    return ScreeningScore(
        candidate,
        fitted,
        setup,
        best.gain,
        tuple(starts),
        gains,
        shapes,
        is_slow(model, best.output_change),
        functools.partial(screening.states_alone_explain, max(coarse, key=lambda one: one.gain), noise),
    )


def _starting_values(problem: Problem, model: Model, candidate: Candidate, wires: WireSignals) -> np.ndarray:
    """The unknowns with the base parameters, the effect at its null, its states at the initial values of the wire."""
    known, first, settled = model.values, wires.initial_values(candidate.point.signal), candidate.initialised_states
    theta, before = problem.unknowns.start.copy(), candidate.states_before
    for k, item in enumerate(problem.unknowns.items):
        if (same := f"{before.get(item.parameter)}@{item.experiment}") in known:
            theta[k] = known[same]
        elif item.name in known and (item.experiment or not candidate.owns(item.parameter)):
            theta[k] = known[item.name]
        elif item.parameter in settled:
            theta[k] = first[problem.unknowns.experiments.index(item.experiment)]
    return theta


@attrs.frozen(eq=False)
class _Screening:
    """A candidate with its problem, and the base to compare with.

    ``unchanged`` (N,) are the residuals of the base at the step of ``problem``.
    """

    candidate: Candidate
    problem: Problem
    model: Model
    base: ColumnSpace
    starting_values: np.ndarray
    unchanged: np.ndarray

    @property
    def output_range(self) -> float:
        """Largest range of the outputs [rms noise]."""
        return max(
            float(np.ptp(experiment.measured[:, i])) * weight
            for experiment in self.problem.experiments
            for i, weight in enumerate(self.problem.weights)
        )

    @property
    def sizes(self) -> tuple[tuple[str, float], ...]:
        """Each size of the effect and its trial value: one for each experiment (``name@experiment``), where local."""
        local, names = self.candidate.effect.local, self.problem.unknowns.experiments
        return tuple(
            (f"{name}@{own}" if own else name, value)
            for name, value in self.candidate.trials.strengths.items()
            for own in (names if name in local else ("",))
        )

    @property
    def owns_shapes(self) -> bool:
        """Whether each experiment has a separate shape."""
        return self.candidate.has_own_instants

    def of_all(self, noise: np.ndarray) -> tuple[list[ShapeTrial], list[ShapeTrial]]:
        """Every shape, with gains in surrogates; and the best ones of finer and finer grids."""
        trials = self.candidate.trials
        found = coarse = self.evaluated(trials.shapes, self._coarse_changes(), noise)
        for name in trials.refine * self._refinements:
            finer = _between(found, name)
            found = [*found, *self.evaluated(finer, self._changes_at(finer))]
            found = sorted(found, key=lambda one: -one.gain)[: 2 * REFINEMENT_SHAPES]
        return coarse, found

    def of_each_experiment(self, noise: np.ndarray) -> tuple[list[ShapeTrial], list[ShapeTrial]]:
        """The shape that has the best instant of each experiment, with gains in surrogates; and that of finer grids."""
        trials = self.candidate.trials
        found = coarse = self._chosen(self._in_each(trials.shapes), self._coarse_changes(), noise)
        distance = self._interval
        for _ in range(self._refinements):
            steps = [distance * k / (REFINEMENT_SHAPES + 1) for k in range(-REFINEMENT_SHAPES, REFINEMENT_SHAPES + 1)]
            for name in trials.refine:
                finer = [moved(found.shape, name, step) for step in steps]
                found = self._chosen(finer, self._changes_at(finer))
            distance /= REFINEMENT_SHAPES + 1
        return [coarse], [found]

    @property
    def _interval(self) -> float:
        """Time [s] between the instants of the first grid."""
        trials = self.candidate.trials
        grid = {one[trials.refine[0]] for one in trials.shapes}
        return (max(grid) - min(grid)) / max(len(grid) - 1, 1)

    @property
    def _refinements(self) -> int:
        """Refinements of the grid of instants until they are nearer than a transition takes; 0 where there is none."""
        if not self.candidate.trials.refine:
            return 0
        needed = math.log(max(self._interval / self.candidate.transition_time, 1.0), REFINEMENT_SHAPES + 1)
        return min(math.ceil(needed), REFINEMENT_ROUNDS)

    def _chosen(
        self, shapes: Sequence[Mapping[str, float]], changes: np.ndarray, noise: np.ndarray | None = None
    ) -> ShapeTrial:
        """The trial that has of each experiment the shape with the largest gain there, by the changes of all."""
        strengths, names = self.candidate.trials.strengths, self.problem.unknowns.experiments
        owner, k = self._owner, len(strengths)
        products, best, z = [], [], np.empty((len(changes), k, len(names)))
        for e in range(len(names)):  # one after another: for memory
            one = np.where(owner[:, None] == e, changes, 0.0)
            products.append(Products.of(one, k, self.base, self.model.r, noise))
            best.append(products[-1].best)
            z[:, :, e] = one[:, best[-1] * k : (best[-1] + 1) * k]
        (found,) = self._sized_trials([joined(shapes, best, names)], z.reshape(len(z), -1), None)
        return found if noise is None else attrs.evolve(found, noise_gains=noise_gains(products))

    def _changes_at(self, shapes: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Changes (N, shapes times sizes) of the outputs at every shape with each of the trial sizes."""
        single = [{name: size} for name, size in self.candidate.trials.strengths.items()] or [{}]
        return self._changes([self._unknowns_at({**shape, **one}) for shape in shapes for one in single])

    def _in_each(self, shapes: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Shapes with the same value of a local parameter for each experiment."""
        return [for_each(one, self.candidate.effect.local, self.problem.unknowns.experiments) for one in shapes]

    def _coarse_changes(self) -> np.ndarray:
        """The changes at all shapes of the trials.

        A change that ends again is, to first order, what begins at its first instant less what begins at its last. So
        many intervals need the simulations of their few instants.
        """
        trials = self.candidate.trials
        if not (steps := trials.without_end):
            return self._changes_at(self._in_each(trials.shapes))
        first, last = trials.refine
        changes = np.split(self._changes_at(self._in_each(steps)), len(steps), axis=1)
        begun = dict(zip((one[first] for one in steps), changes, strict=True))
        return np.concatenate([begun[one[first]] - begun[one[last]] for one in trials.shapes], axis=1)

    def evaluated(
        self, shapes: Sequence[Mapping[str, float]], changes: np.ndarray, noise: np.ndarray | None = None
    ) -> list[ShapeTrial]:
        """Every shape with its optimum size, by the changes, and with its gains in the surrogates ``noise`` (N, D)."""
        if not self.candidate.local:
            return self._sized_trials(shapes, changes, noise)
        parts = np.split(changes, len(shapes), axis=1)  # one after another: each experiment has separate sizes
        every = (
            self._sized_trials([one], self._by_experiment(part), noise) for one, part in zip(shapes, parts, strict=True)
        )
        return [one for (one,) in every]

    def _sized_trials(
        self, shapes: Sequence[Mapping[str, float]], changes: np.ndarray, noise: np.ndarray | None
    ) -> list[ShapeTrial]:
        """Every shape with its optimum size, by the changes (N, shapes times sizes) at its trial sizes."""
        count = changes.shape[1] // len(shapes)
        wide = np.ascontiguousarray(changes.T)
        inside = self.base.basis.transposed_times(changes)
        gradient = np.array([np.einsum("i,i->", row, self.model.r) for row in wide])
        gradient = gradient - inside.T @ self.base.basis.transposed_times(self.model.r)
        by_noise = None if noise is None else noise.T @ changes.astype(noise.dtype)
        results = []
        for k, shape in enumerate(shapes):
            mine = slice(k * count, (k + 1) * count)
            whole = product(wide[mine], changes[:, mine])
            m = whole - inside[:, mine].T @ inside[:, mine]
            trial = self._sized(shape, changes[:, mine], gradient[mine], m, inside[:, mine])
            if by_noise is not None:
                trial = attrs.evolve(trial, noise_gains=self._noise_gains(by_noise[:, mine], regular(m, whole)))
            results.append(trial)
        return results

    def states_alone_explain(self, one: ShapeTrial, noise: np.ndarray) -> bool:
        """Whether the sizes of a shape gain no more than in noise, beyond its states that may begin anywhere."""
        places, strengths = self._places_of_states, self.candidate.trials.strengths
        values = len(places) * len(self.problem.unknowns.experiments) * self.problem.samples
        if not places or not strengths or values > MAX_VALUES:
            return False
        sets = [self._unknowns_at({**one.shape, name: size}) for name, size in strengths.items()]
        for state, some in {"": [], **places}.items():
            sets.append(one.theta_base_fixed.copy())
            sets[-1][some] += self._half_range(state, one.theta_base_fixed) if state else 0.0
        changes, k = self._changes(sets), len(strengths)
        by_size = self._by_experiment(changes[:, :k]) if self.candidate.local else changes[:, :k]
        by_state = changes[:, k + 1 :] - changes[:, [k]]
        return size_beyond_states(by_size, by_state, self._owner, self.base, self.model.r, noise).is_noise

    @property
    def _places_of_states(self) -> dict[str, list[int]]:
        """Places of each state of the effect that may begin anywhere, one for each experiment."""
        own = {*self.candidate.local, *self.candidate.states_before}
        found: dict[str, list[int]] = {}
        for k, item in enumerate(self.problem.unknowns.items):
            mine = item.parameter.startswith(f"{self.candidate.block}.") and item.parameter not in own
            if item.experiment and mine and np.isinf(item.low) and np.isinf(item.high):
                found.setdefault(item.parameter, []).append(k)
        return found

    def _half_range(self, state: str, theta: np.ndarray) -> float:
        """The distance by which a state begins elsewhere: half its range, or that of the signal of the effect."""
        scales, ranges = self.candidate.scales, [float(np.ptp(x)) for x in signals_at(self.problem, [state], theta)]
        return 0.5 * max(ranges) or (scales.wire.reach if scales else 1.0)

    def _noise_gains(self, g: np.ndarray, m: np.ndarray) -> np.ndarray:
        """Gains (D,) of a shape with any size in surrogates, with products ``g`` (D, k) and ``m`` (k, k)."""
        gains = falls(m, g.T)
        one_way = not self.candidate.trials.strengths  # the size is part of the shape, and positive
        return np.where(g[:, 0] < 0, gains, 0.0) if one_way else gains

    def _unknowns_at(self, numbers: Mapping[str, float]) -> np.ndarray:
        theta, items = self.starting_values.copy(), self.problem.unknowns.items
        for name, value in numbers.items():
            for k in self._places.get(f"{self.candidate.block}.{name}", ()):
                theta[k] = min(max(value, items[k].low), items[k].high)
        return theta

    @functools.cached_property
    def _places(self) -> dict[str, list[int]]:
        """Places of the unknowns by parameter, all experiments together, and by name."""
        places = dict[str, list[int]]()
        for k, item in enumerate(self.problem.unknowns.items):
            for name in {item.parameter, item.name}:
                places.setdefault(name, []).append(k)
        return places

    def _by_experiment(self, changes: np.ndarray) -> np.ndarray:
        """Changes (N, strengths) as (N, sizes): those of a local strength for each experiment alone."""
        owner, columns = self._owner, []
        for name, column in zip(self.candidate.trials.strengths, changes.T, strict=True):
            local = name in self.candidate.effect.local
            columns += [np.where(owner == e, column, 0.0) for e in range(owner.max() + 1)] if local else [column]
        return np.stack(columns, axis=1)

    @functools.cached_property
    def _owner(self) -> np.ndarray:
        """The number of the experiment to which each sample belongs, shape (N,)."""
        owner, segments = np.empty(self.problem.samples, dtype=int), iter(self.problem.segments)
        for e, _ in enumerate(self.problem.experiments):
            for _ in self.problem.weights:
                owner[next(segments)] = e
        return owner

    def _changes(self, sets: list[np.ndarray]) -> np.ndarray:
        """Change of the weighted outputs against the base, shape (N, sets)."""
        results = np.empty((self.problem.samples, len(sets)))
        for e, (rows, y) in enumerate(zip(self.problem.rows, self.problem.output_sets(np.array(sets)), strict=True)):
            results[rows] = self.problem.residuals_of(e, y) - self.unchanged[rows, None]
        diverged = ~(np.abs(results) < DIVERGENCE_THRESHOLD).all(axis=0)
        results[:, diverged] = 0.0  # a diverged simulation has no gain
        return results

    def _sized(
        self, shape: Mapping[str, float], z: np.ndarray, g: np.ndarray, m: np.ndarray, inside: np.ndarray
    ) -> ShapeTrial:
        """A shape with the sizes of its strengths at the minimum of the sum of squares.

        ``z`` (N, k) are the changes of the outputs; with the base projected out, ``g`` (k,) are their products with the
        residual and ``m`` (k, k) those with each other; ``inside`` (directions, k) are their components in the base.
        """
        strengths = self.candidate.trials.strengths
        size = self._sizes(g, m) if strengths else np.ones(1)
        numbers = {k: s * v for (k, v), s in zip(self.sizes, size, strict=False)}
        base_fixed, unknowns = self._unknowns_at({**shape, **numbers}), self.problem.unknowns
        shift = dict(zip(self.model.problem.unknowns.names, -self.base.turn @ (inside @ size), strict=True))
        moved = [bool(item.experiment) or not self.candidate.owns(item.parameter) for item in unknowns.items]
        theta = base_fixed + np.where(moved, [shift.get(name, 0.0) for name in unknowns.names], 0.0)

        def fall(by: np.ndarray) -> float:
            return -float(2 * by @ g + by @ m @ by)

        gain = fall(size)
        if not strengths:  # the size is part of the shape: predict the gain of another one
            gain = max(gain, fall(np.clip(-g / max(m[0, 0], 1e-300), 0.0, MAX_EXTRAPOLATION)))
        theta = np.clip(theta, unknowns.low, unknowns.high)
        first = len(self.problem.unknowns.experiments) if self._first_is_local else 1
        exceeds_range = bool(np.abs(z[:, :first]).max(initial=0.0) > self.output_range)
        sensitivity, whole = float(m[:first, :first].sum()), float(np.square(z[:, :first].sum(axis=1)).sum())
        absorbed = {}
        if sensitivity <= MIN_SENSITIVITY * whole:
            components, names = inside[:, :first].sum(axis=1), self.model.problem.unknowns.names
            sensitivity, absorbed = 0.0, absorbing(self.base, components, names) if whole else {}
        return ShapeTrial(gain, theta, shape, z @ size, sensitivity, exceeds_range, base_fixed, absorbed)

    @property
    def _first_is_local(self) -> bool:
        """Whether the first strength has a separate value in each experiment."""
        return next(iter(self.candidate.trials.strengths), "") in self.candidate.effect.local

    def _sizes(self, g: np.ndarray, m: np.ndarray) -> np.ndarray:
        """Factors on the trial sizes, within bounds."""
        ridge = 1e-9 * np.diag(np.maximum(np.diag(m), 1e-300))
        try:
            size = -np.linalg.solve(m + ridge, g)
        except np.linalg.LinAlgError:  # the base absorbs the effect, so that only rounding remains of it
            size = -np.linalg.lstsq(m + ridge, g, rcond=None)[0]
        size = np.clip(size, -MAX_SIZE_FACTOR, MAX_SIZE_FACTOR)
        unknowns = self.problem.unknowns
        for j, (name, unit) in enumerate(self.sizes):
            k = unknowns.names.index(f"{self.candidate.block}.{name}")
            size[j] = np.clip(size[j] * unit, unknowns.low[k], unknowns.high[k]) / unit
        return size


def absorbing(base: ColumnSpace, components: np.ndarray, names: Sequence[str]) -> dict[str, float]:
    """The moves of the base's parameters that make a change of the outputs with these components (q,) in its space.

    Those with the dominating part of it, the largest first.
    """
    moves = base.turn @ components
    effects = np.abs(moves) * base.scale
    return {names[k]: float(moves[k]) for k in np.argsort(-effects) if effects[k] >= DOMINATING * effects.max()}


def _between(shape_trials: Sequence[ShapeTrial], name: str) -> list[dict[str, float]]:
    """Shapes between the best one and its neighbours."""
    best = max(shape_trials, key=lambda one: one.gain)
    here = best.shape[name]
    others = sorted({one.shape[name] for one in shape_trials} - {here}, key=lambda v: abs(v - here))
    distance = abs(others[0] - here) if others else 0.0
    steps = [k / (REFINEMENT_SHAPES + 1) for k in range(-REFINEMENT_SHAPES, REFINEMENT_SHAPES + 1) if k]
    return [{**best.shape, name: here + share * distance} for share in steps]
