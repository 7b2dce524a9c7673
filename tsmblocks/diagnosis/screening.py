"""What each candidate promises before it is fitted: a trial of several sizes and shapes, less what the base absorbs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate, WireSignals
from tsmblocks.diagnosis.decision import MAX_FINITE_NULL
from tsmblocks.diagnosis.model import Model, ModelSettings, pose_extended
from tsmblocks.fitting.inner_products import product, square
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup

EIGENVALUE_TOLERANCE = 1e-12
"""Share of the largest eigenvalue below which a direction of the base counts as undetermined."""
REFINEMENT_SHAPES = 12
"""Shapes tried to each side of the best, where a shape is looked for again."""
REFINEMENT_ROUNDS = 3
"""How often."""
PINNING_WIDTHS = 10.0
"""Widths of a transition within which its instant is then fitted."""
SECOND_START_TRIALS = 8
"""Next best shapes among which a second start is looked for."""
DIVERGENCE_THRESHOLD = 1e30
"""Change of an output, in units of the noise, from which a simulation counts as one that runs away."""
MAX_SIZE_FACTOR = 40.0
"""How much larger than the size worth trying an effect may begin."""
MAX_EXTRAPOLATION = 4.0
"""How many times a size that was tried an effect is thought to grow in proportion; shapes lie no farther apart."""


@attrs.frozen(eq=False)
class BaseSubspace:
    """What the base can take up by other numbers: an orthonormal basis (N, k), and the way back to the unknowns."""

    basis: np.ndarray
    to_unknowns: np.ndarray

    def project_out(self, z: np.ndarray) -> np.ndarray:
        """What is left of columns (N, m)."""
        return z - product(self.basis, product(np.ascontiguousarray(self.basis.T), z))


def base_subspace(model: Model) -> BaseSubspace:
    """The directions in which the base moves."""
    J = model.J
    size = np.sqrt(np.einsum("ij,ij->j", J, J))
    size = np.where(size > 0, size, 1.0)
    scaled = J / size
    values, vectors = np.linalg.eigh(product(np.ascontiguousarray(scaled.T), scaled))
    kept = values > EIGENVALUE_TOLERANCE * values.max(initial=0.0)
    turn = vectors[:, kept] / np.sqrt(values[kept])
    return BaseSubspace(product(scaled, turn), turn / size[:, None])


@attrs.frozen(eq=False)
class ScreeningScore:
    """What a candidate promises: ``gain`` is the fall of the sum of squares, ``starts`` where to begin, best first.

    ``z`` (N,) is the best change of the outputs found, less what the base absorbs.
    """

    candidate: Candidate
    problem: Problem
    setup: Setup
    gain: float
    starts: tuple[np.ndarray, ...]
    z: np.ndarray = attrs.field(repr=False)
    detection_limit: float | None = None
    """The first parameter's size that would just show; None where these data do not excite it."""


@attrs.frozen(eq=False)
class _ShapeTrial:
    """One shape tried: the fall of the sum of squares, and the unknowns there."""

    gain: float
    theta: np.ndarray
    shape: Mapping[str, float]
    output_change: np.ndarray
    """Change of the outputs (N,)."""
    sensitivity: float
    """Sum of squares that the first size worth trying changes, beyond what the base absorbs."""
    exceeds_range: bool
    """Whether that size moves an output farther than it ever went, as in a loop that then runs away."""
    theta_base_fixed: np.ndarray
    """The unknowns with the base's as they were."""


def screening_score(
    candidate: Candidate,
    model: Model,
    records: Mapping,
    settings: ModelSettings,
    wires: WireSignals,
    base: BaseSubspace,
    shows: float,
) -> ScreeningScore:
    """Try a candidate's shapes and sizes, all side by side in lanes. ``shows`` is a change of the sum of squares."""
    trials = candidate.trials
    problem, setup = pose_extended(
        model,
        candidate.diagram,
        candidate.free,
        records,
        settings,
        _bounds(candidate, settings),
        candidate.initialised_states,
    )
    begin = _begin(problem, model, candidate, wires)
    screen = _Screen(candidate, problem, model, base, begin)
    tried = screen.tries(trials.shapes)
    detection_limit = _smallest(candidate, tried, shows)
    for _ in range(REFINEMENT_ROUNDS if trials.refine else 0):
        tried = [*tried, *screen.tries(_between(tried, trials.refine))]
        tried.sort(key=lambda one: -one.gain)
        tried = tried[: 2 * REFINEMENT_SHAPES]
    tried.sort(key=lambda one: -one.gain)
    best = tried[0]
    if trials.refine:
        return ScreeningScore(
            candidate,
            _pinned(problem, candidate, best),
            setup,
            best.gain,
            (best.theta,),
            base.project_out(best.output_change[:, None])[:, 0],
            detection_limit,
        )
    chosen = [best, *(one for one in tried[1:SECOND_START_TRIALS] if _differs(one, best, base))][:2]
    starts = [_sounder(problem, one) for one in chosen]
    return ScreeningScore(
        candidate,
        problem,
        setup,
        best.gain,
        tuple(starts),
        base.project_out(best.output_change[:, None])[:, 0],
        detection_limit,
    )


def _smallest(candidate: Candidate, tried: Sequence[_ShapeTrial], shows: float) -> float | None:
    """The size at which an effect changes the sum of squares by ``shows``, by the shape that shows it best."""
    strengths, first = candidate.trials.strengths, candidate.effect.free[0]
    null = candidate.effect.null.get(first, np.inf)
    sizes = []
    for one in tried:
        factor = float(np.sqrt(shows / one.sensitivity)) if one.sensitivity > 0 else np.inf
        if one.exceeds_range:  # it would be seen, but what is smaller is not in proportion
            factor = max(factor, 1.0)
        if strengths and factor < MAX_SIZE_FACTOR:
            sizes.append(abs(next(iter(strengths.values()))) * factor)
        elif not strengths and factor <= 1:  # towards its null; a limit has none, and counts as it is
            sizes.append(null + (one.shape[first] - null) * factor if abs(null) < MAX_FINITE_NULL else one.shape[first])
    return min(map(abs, sizes)) if sizes else None


def _bounds(candidate: Candidate, settings: ModelSettings) -> dict[str, tuple[float | None, float | None]]:
    """Bounds by full names; those of states count where states are free to begin anywhere."""
    named = {f"{candidate.block}.{k}": pair for k, pair in candidate.trials.bounds.items()}
    return {k: v for k, v in named.items() if settings.start_states or k in candidate.free}


def _begin(problem: Problem, model: Model, candidate: Candidate, wires: WireSignals) -> np.ndarray:
    """The unknowns at the base's numbers, with the effect at its null and at rest where each experiment begins."""
    known, first, settled = model.values, wires.initial_values(candidate.site.signal), candidate.initialised_states
    made = []
    for item in problem.unknowns.items:
        if item.name in known:
            made.append(known[item.name])
        elif item.parameter in settled:
            made.append(first[problem.unknowns.experiments.index(item.experiment)])
        else:
            made.append(item.start)
    return np.array(made)


@attrs.frozen(eq=False)
class _Screen:
    """A candidate ready to be tried."""

    candidate: Candidate
    problem: Problem
    model: Model
    base: BaseSubspace
    begin: np.ndarray

    @property
    def reach(self) -> float:
        """How far the outputs went, in units of the noise."""
        return max(
            float(np.ptp(trial.measured[:, i])) * weight
            for trial in self.problem.trials
            for i, weight in enumerate(self.problem.weights)
        )

    def tries(self, shapes: Sequence[Mapping[str, float]]) -> list[_ShapeTrial]:
        """Every shape with its best size."""
        strengths = self.candidate.trials.strengths
        sets = [
            self._set({**shape, **one}) for shape in shapes for one in ([{k: v} for k, v in strengths.items()] or [{}])
        ]
        changes = self._changes(sets)
        wide = np.ascontiguousarray(changes.T)
        inside = product(np.ascontiguousarray(self.base.basis.T), changes)
        slope = np.array([np.einsum("i,i->", row, self.model.r) for row in wide])
        slope = slope - inside.T @ (self.base.basis.T @ self.model.r)
        each, made = max(len(strengths), 1), []
        for k, shape in enumerate(shapes):
            mine = slice(k * each, (k + 1) * each)
            m = product(wide[mine], changes[:, mine]) - inside[:, mine].T @ inside[:, mine]
            made.append(self._sized(shape, changes[:, mine], slope[mine], m, inside[:, mine]))
        return made

    def _set(self, numbers: Mapping[str, float]) -> np.ndarray:
        theta = self.begin.copy()
        for name, value in numbers.items():
            k = self.problem.unknowns.names.index(f"{self.candidate.block}.{name}")
            theta[k] = np.clip(value, self.problem.unknowns.low[k], self.problem.unknowns.high[k])
        return theta

    def _changes(self, sets: list[np.ndarray]) -> np.ndarray:
        """Change of the weighted outputs against the base, shape (N, sets)."""
        made = np.empty((self.problem.samples, len(sets)))
        first = 0
        for e, trial in enumerate(self.problem.trials):
            y = self.problem.outputs(sets, e)
            for i, weight in enumerate(self.problem.weights):
                rows = slice(first, first + len(trial.t))
                made[rows] = weight * (y[:, i] - trial.measured[:, i, None]) - self.model.r[rows, None]
                first = rows.stop
        away = ~(np.abs(made) < DIVERGENCE_THRESHOLD).all(axis=0)
        made[:, away] = 0.0  # a size at which the simulation runs away promises nothing
        return made

    def _sized(
        self, shape: Mapping[str, float], z: np.ndarray, g: np.ndarray, m: np.ndarray, inside: np.ndarray
    ) -> _ShapeTrial:
        """A shape with the sizes of its strengths that leave least.

        ``z`` (N, k) are the changes of the outputs, ``g`` (k,) and ``m`` (k, k) what of them the base does not absorb
        times what is left and times each other, ``inside`` (directions, k) what it does.
        """
        strengths = self.candidate.trials.strengths
        size = np.ones(1) if not strengths else self._sizes(g, m, list(strengths.items()))
        numbers = {k: s * v for (k, v), s in zip(strengths.items(), size, strict=False)}
        theta = theta_base_fixed = self._set({**shape, **numbers})
        shift = dict(zip(self.model.problem.unknowns.names, -self.base.to_unknowns @ (inside @ size), strict=True))
        theta = theta + np.array([shift.get(name, 0.0) for name in self.problem.unknowns.names])

        def fall(by: np.ndarray) -> float:
            return -float(2 * by @ g + by @ m @ by)

        gain = fall(size)
        if not strengths:  # the size is part of the shape; count what another size in this direction would gain
            gain = max(gain, fall(np.clip(-g / max(m[0, 0], 1e-300), 0.0, MAX_EXTRAPOLATION)))
        inside_bounds = np.clip(theta, self.problem.unknowns.low, self.problem.unknowns.high)
        exceeds_range = bool(np.abs(z[:, 0]).max(initial=0.0) > self.reach)
        return _ShapeTrial(gain, inside_bounds, shape, z @ size, float(m[0, 0]), exceeds_range, theta_base_fixed)

    def _sizes(self, g: np.ndarray, m: np.ndarray, strengths: list[tuple[str, float]]) -> np.ndarray:
        """Factors on the sizes worth trying, in bounds."""
        ridge = 1e-9 * np.diag(np.maximum(np.diag(m), 1e-300))
        size = np.clip(-np.linalg.solve(m + ridge, g), -MAX_SIZE_FACTOR, MAX_SIZE_FACTOR)
        low, high, names = self.problem.unknowns.low, self.problem.unknowns.high, self.problem.unknowns.names
        for j, (name, unit) in enumerate(strengths):
            k = names.index(f"{self.candidate.block}.{name}")
            size[j] = np.clip(size[j] * unit, low[k], high[k]) / unit
        return size


def _sounder(problem: Problem, one: _ShapeTrial) -> np.ndarray:
    """Where to begin from a try: with the base moved as its derivatives say, or not, where they lead astray."""
    shifted, base_fixed = problem.costs(np.stack([one.theta, one.theta_base_fixed]))
    return one.theta_base_fixed if not shifted <= base_fixed else one.theta


def _between(tried: Sequence[_ShapeTrial], name: str) -> list[dict[str, float]]:
    """Shapes between the best one and its neighbours."""
    best = max(tried, key=lambda one: one.gain)
    here = best.shape[name]
    others = sorted({one.shape[name] for one in tried} - {here}, key=lambda v: abs(v - here))
    reach = abs(others[0] - here) if others else 0.0
    steps = [k / (REFINEMENT_SHAPES + 1) for k in range(-REFINEMENT_SHAPES, REFINEMENT_SHAPES + 1) if k]
    return [{**best.shape, name: here + share * reach} for share in steps]


def _pinned(problem: Problem, candidate: Candidate, best: _ShapeTrial) -> Problem:
    """The problem with a shape that was looked for by trials kept near what they found: slopes do not lead there."""
    name, unknowns = f"{candidate.block}.{candidate.trials.refine}", problem.unknowns
    k = unknowns.names.index(name)
    reach, value = PINNING_WIDTHS * candidate.transition_time, float(best.theta[k])
    item = attrs.evolve(
        unknowns.items[k],
        low=max(value - reach, unknowns.items[k].low),
        high=min(value + reach, unknowns.items[k].high),
    )
    items = (*unknowns.items[:k], item, *unknowns.items[k + 1 :])
    return attrs.evolve(problem, unknowns=attrs.evolve(unknowns, items=items))


def _differs(one: _ShapeTrial, best: _ShapeTrial, base: BaseSubspace) -> bool:
    """Whether two tries lead to different places: their changes of the outputs are not nearly the same."""
    a, b = base.project_out(np.stack([one.output_change, best.output_change], axis=1)).T
    return float(np.einsum("i,i->", a, b)) ** 2 < 0.8 * square(a) * square(b)
