"""A diagram beside recordings, fitted: a diagnosis compares such models, the base and the base with effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.fitting.experiments import Window
from tsmblocks.fitting.fit import begins
from tsmblocks.fitting.gauss_newton import gauss_newton
from tsmblocks.fitting.noise import Floor
from tsmblocks.fitting.optimizer import Found, feasible_start, held
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup, pose
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import equations

MAX_ITERATIONS = 40
"""Iterations of one search at most; an effect that needs more is not determined by these data."""

ACTIVE_BOUND_TOLERANCE = 1e-6
"""Distance from a bound, as a share of the number's size, that counts as lying on it."""
COARSE_TOLERANCE = 0.3
"""Promised fall of the sum of squares, in variances of a sample, at which a candidate is fitted well enough to be
compared: a thousandth of what decides between candidates."""

FINE_TOLERANCE = 1e-3
"""The same for models that further ones are built on, and that are shown."""


@attrs.frozen
class ModelSettings:
    """How models are set beside recordings: the same for the base and for every candidate.

    ``free`` are patterns of the base's parameters (None for all but start values); ``sigma`` is the noise of each
    output, in whose units everything is counted; ``step`` [s] is that of the simulation, None where it is still to
    be found; ``seed`` that of random starts. ``window`` is the part of each experiment that counts [s], None for all.
    """

    free: tuple[str, ...] | None
    sigma: Mapping[str, float]
    outputs: tuple[str, ...]
    start_states: bool = True
    step: float | None = None
    integrator: str = "rk4"
    hold: str = "cubic"
    starts: int = 6
    seed: int = 0
    window: Mapping[str, Window] | None = None


@attrs.frozen(eq=False)
class Model:
    """A diagram with numbers found, and what it leaves.

    ``theta`` (n,) are the unknowns of ``problem``; ``r`` (N,) what is left, in units of the noise, ``J`` (N, n) its
    derivatives. ``scales`` (n,) are positive for unknowns that belong to effects: sizes that pull them to ``null``.
    """

    diagram: Diagram
    problem: Problem = attrs.field(repr=False)
    setup: Setup = attrs.field(repr=False)
    theta: np.ndarray = attrs.field(repr=False)
    r: np.ndarray = attrs.field(repr=False)
    J: np.ndarray = attrs.field(repr=False)
    status: str = ""

    @property
    def mean_square(self) -> float:
        """Mean square of what is left, in units of the noise's."""
        return float(np.mean(self.r**2))

    @property
    def residual_rms(self) -> dict[str, float]:
        """Rms of what is left of each output, in units of its noise."""
        count = len(self.setup.outputs)
        rows = {
            name: [self.r[part] for part in self.problem.segments[k::count]]
            for k, name in enumerate(self.setup.outputs)
        }
        return {name: float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for name, parts in rows.items()}

    @property
    def values(self) -> dict[str, float]:
        """Each unknown by name (``parameter`` or ``parameter@experiment``)."""
        return dict(zip(self.problem.unknowns.names, self.theta.tolist(), strict=True))

    @property
    def is_local(self) -> np.ndarray:
        """Which unknowns belong to one experiment alone, shape (n,)."""
        return np.array([bool(item.experiment) for item in self.problem.unknowns.items], dtype=bool)

    @property
    def at_bound(self) -> np.ndarray:
        """Which unknowns lie on a bound, shape (n,): what is left would fall beyond it, where they must not go."""
        low, high = self.problem.unknowns.low, self.problem.unknowns.high
        near = ACTIVE_BOUND_TOLERANCE * np.maximum(np.abs(self.theta), 1e-12)
        return (self.theta - low <= near) | (high - self.theta <= near)

    @property
    def fitted_diagram(self) -> Diagram:
        """The diagram with the numbers that hold for all experiments."""
        items = self.problem.unknowns.items
        own = {i.parameter: float(v) for i, v in zip(items, self.theta, strict=True) if not i.experiment}
        return self.diagram.with_parameters(own)


def calibrate(diagram: Diagram, records: Mapping[str, Record], settings: ModelSettings, tell: Any = None) -> Model:
    """The base model: all its free numbers found from several starts. Raises what ``tsm.fit`` raises."""
    problem, setup = pose_model(diagram, records, settings, settings.free)
    begin = feasible_start(problem, problem.unknowns.start)
    ends = [
        gauss_newton(problem, one, iterations=MAX_ITERATIONS, enough=COARSE_TOLERANCE, tell=tell)
        for one in begins(problem, setup, begin, settings.starts, settings.seed)
    ]
    best = min(ends, key=lambda found: found.cost)
    return model_at(
        problem, setup, gauss_newton(problem, best.theta, iterations=MAX_ITERATIONS, enough=FINE_TOLERANCE, tell=tell)
    )


def pose_model(
    diagram: Diagram,
    records: Mapping[str, Record],
    settings: ModelSettings,
    free: Iterable[str] | None,
    bounds: Mapping[str, Any] | None = None,
    local: Iterable[str] | None = None,
) -> tuple[Problem, Setup]:
    """The problem of fitting a diagram, weighed by the noise; ``is_local`` names what belongs to one experiment."""
    known = {k: Floor(k, v, diagram.unit(k)) for k, v in settings.sigma.items()}
    return pose(
        diagram,
        dict(records),
        free=free,
        bounds=bounds,
        start=None,
        local=local or (),
        start_states=settings.start_states and local is None,
        constraints=None,
        ties=None,
        priors=None,
        sigma=known,
        outputs=settings.outputs,
        window=settings.window,
        step=settings.step,
        integrator=settings.integrator,
        hold=settings.hold,
        backend="",
    )


def pose_extended(
    model: Model,
    diagram: Diagram,
    more: Iterable[str],
    records: Mapping[str, Record],
    settings: ModelSettings,
    bounds: Mapping[str, Any] | None = None,
    begins: Iterable[str] = (),
) -> tuple[Problem, Setup]:
    """The problem of a diagram that has more blocks than a model: the model's unknowns, and ``more`` of its own.

    States of the added blocks, and the memories named in ``begins``, start free in each experiment, as those of the
    model do.
    """
    items = model.problem.unknowns.items
    free = [item.parameter for item in items if not item.experiment]
    local = list(dict.fromkeys(item.parameter for item in items if item.experiment))
    if settings.start_states:
        states = [*(k for k in equations(diagram).x if k not in model.setup.eq.x), *begins]
        local += [k for k in dict.fromkeys(states) if k not in local]
    kept = {i.parameter: (i.low, i.high) for i in items}
    settings = attrs.evolve(settings, step=model.setup.trials[0].times.h)
    return pose_model(diagram, records, settings, [*free, *more], {**kept, **(bounds or {})}, local)


def optimized(
    problem: Problem, setup: Setup, start: np.ndarray, enough: float = COARSE_TOLERANCE, coarse: bool = True
) -> Model:
    """The model at the end of a search downhill from ``start``, where nothing else is left by coarse differences."""
    begin = held(problem, start)
    return model_at(
        problem, setup, gauss_newton(problem, begin, iterations=MAX_ITERATIONS, enough=enough, coarse=coarse)
    )


def converged(model: Model) -> Model:
    """The same model, searched to its end."""
    return optimized(model.problem, model.setup, model.theta, FINE_TOLERANCE)


def model_at(problem: Problem, setup: Setup, found: Found) -> Model:
    """The model where a search ended."""
    theta = found.theta
    r, J = problem.jacobian(theta) if found.reach is None else problem.secants(theta, found.reach)
    return Model(setup.diagram, problem, setup, theta, r, np.where(np.isfinite(J), J, 0.0), found.status)
