"""Initial states of memories that an optimisation left where they have no influence, such as a play out of its gap."""

from __future__ import annotations

import math
from collections.abc import Iterator

import attrs
import numpy as np

from tsmblocks.diagnosis.model import COARSE_TOLERANCE, FINE_TOLERANCE, Model, optimized
from tsmblocks.diagnosis.piece_states import continued
from tsmblocks.fitting.memories import placed

COST_TOLERANCE = 1e-4
"""Relative difference of two sums of squares up to which they are equal. Chosen: far below any standard error."""
REACH_FACTOR = 10.0
"""Initial state, in multiples of the largest one seen, that is surely outside the range in which it matters. Chosen."""
LINEAR_REACH = 1e-18
"""Share of that below which the bisection is linear, and above which it is logarithmic. Chosen: optimisations may have
moved an idle initial state by many orders of magnitude."""
BISECTIONS = 25
"""Bisections for the edge of the range in which an initial state matters. Chosen: they reach a relative 1e-6."""
MAX_ROUNDS = 3
"""Searches of all initial states at most, as long as the loss falls. Chosen: for the run time."""


def refine_memories(model: Model, rounds: int = MAX_ROUNDS) -> Model:
    """The model with such initial states at their optimum in each experiment.

    A play may be engaged on either side when an experiment begins, or between the sides. Where other initial states
    compensate for the wrong side, each side is a local minimum, so all of them are tried.
    """
    for _ in range(rounds):
        better = _improved(model)
        if better is None:
            break
        model = better
    return model


def reset_idle_memories(model: Model) -> Model:
    """The model with idle memories that moved set back, if the loss does not grow: an effect may then need them."""
    moved = _moved(model)
    if not moved.any():
        return model
    start = np.where(moved, model.problem.unknowns.start, model.theta)
    reset = optimized(model.problem, model.setup, start, FINE_TOLERANCE)
    return reset if reset.mean_square <= (1 + COST_TOLERANCE) * model.mean_square else model


def clip_idle_memories(model: Model) -> Model:
    """The model with idle memories clipped to the edge of the range in which they matter: the same residuals."""
    idle = _idle(model)
    if not idle.any():
        return model
    edges = _edges(model, idle)
    theta = np.clip(model.theta, edges.min(axis=0), edges.max(axis=0))
    same = np.allclose(model.problem.residuals(theta), model.r, 0, COST_TOLERANCE)
    return attrs.evolve(model, theta=theta) if same else model


def _improved(model: Model) -> Model | None:
    """The model after one search of all idle initial states; None where the loss does not fall."""
    ends, enough = [model], COARSE_TOLERANCE * max(model.mean_square, 1.0)  # relative to a large residual
    runs = (start for start in _starts(model) if np.isfinite(model.problem.cost(start)))
    ends += [optimized(model.problem, model.setup, start, enough, coarse=False) for start in runs]
    if len(ends) > 1:
        costs = np.array([_by_experiment(end, end.r) for end in ends])
        mixed, unknowns = min(ends, key=lambda end: end.mean_square).theta.copy(), model.problem.unknowns
        for e, best in enumerate(np.argmin(costs, axis=0)):
            own = [k for k in unknowns.columns(e) if unknowns.items[k].experiment]
            mixed[own] = ends[best].theta[own]
        if np.isfinite(model.problem.cost(mixed)):
            ends.append(optimized(model.problem, model.setup, mixed, enough, coarse=False))
    found = min(ends, key=lambda end: end.mean_square)
    return found if found.mean_square < (1 - COST_TOLERANCE) * model.mean_square else None


def _starts(model: Model) -> Iterator[np.ndarray]:
    """Starting points (n,): states of pieces as the pieces before them have them; memories where the recordings begin,
    if that lowers the loss; the idle ones at their first values, at either edge of their range, and in its middle.
    """
    of_pieces = continued(model)
    if not np.array_equal(of_pieces, model.theta):
        yield of_pieces
    idle, unknowns = _idle(model), model.problem.unknowns
    at_recordings = placed(model.problem, model.theta)
    if not np.array_equal(at_recordings, model.theta):
        yield at_recordings
    if not idle.any():
        return
    yield np.where(idle, unknowns.start, model.theta)
    edges = _edges(model, idle)
    if not np.array_equal(edges[0], edges[1]):  # else they have no influence anywhere
        yield from (edges[0], edges[1], edges.mean(axis=0))


def _edges(model: Model, idle: np.ndarray) -> np.ndarray:
    """The range, shape (2, n), in which idle initial states matter; the others as they are."""
    items, edges = model.problem.unknowns.items, np.array([model.theta, model.theta])
    for name in dict.fromkeys(item.parameter for item, one in zip(items, idle, strict=True) if one):
        own = idle & np.array([item.parameter == name for item in items])
        edges[:, own] = _reach(model, name, own)[:, own]
    return edges


def _reach(model: Model, name: str, own: np.ndarray) -> np.ndarray:
    """The range, shape (2, n), in which an initial state matters; ``own`` (n,) marks it in each experiment.

    Where it has no influence at all, both edges are the model's value.
    """
    unknowns = model.problem.unknowns
    sizes = np.maximum(np.abs(model.theta), np.abs(unknowns.start))
    far = REACH_FACTOR * (max(sizes[[item.parameter == name for item in unknowns.items]]) or 1.0)
    of = np.zeros(len(own), dtype=int)  # the experiment of each unknown
    for e in range(len(model.problem.experiments)):
        of[unknowns.columns(e)] = e

    def values(way: np.ndarray) -> np.ndarray:
        return far * LINEAR_REACH * np.sinh(way)

    def costs(starts: np.ndarray) -> np.ndarray:
        theta = np.clip(np.where(own, starts[of], model.theta), unknowns.low, unknowns.high)
        return _by_experiment(model, model.problem.residuals(theta))

    ends = math.asinh(1 / LINEAR_REACH) * np.array([-1.0, 1.0])
    outside = [np.full(len(model.problem.experiments), end) for end in ends]
    plateaus = [costs(values(end)) for end in outside]
    matters = np.abs(plateaus[0] - plateaus[1]) > COST_TOLERANCE**2 * plateaus[0]
    edges: list[np.ndarray] = []
    for side in (0, 1):
        outer, inner = outside[side], outside[1 - side]
        for _ in range(BISECTIONS):
            middle = (outer + inner) / 2
            unchanged = np.abs(costs(values(middle)) - plateaus[side]) <= COST_TOLERANCE**2 * plateaus[side]
            outer, inner = np.where(unchanged, middle, outer), np.where(unchanged, inner, middle)
        edges.append(np.where(own & matters[of], values(outer)[of], model.theta))
    return np.clip(np.array(edges), unknowns.low, unknowns.high)


def _idle(model: Model) -> np.ndarray:
    """Which initial states, shape (n,), have no influence at the optimum, or next to none after moving."""
    return model.is_local & (model.J.norms == 0) | _moved(model)


def _moved(model: Model) -> np.ndarray:
    """Which initial states, shape (n,), the optimisation moved to where they have next to no influence."""
    start = model.problem.unknowns.start
    influence = model.J.norms * np.maximum(np.abs(model.theta), np.abs(start))
    return model.is_local & (model.theta != start) & (influence <= np.sqrt(COST_TOLERANCE) * np.linalg.norm(model.r))


def _by_experiment(model: Model, r: np.ndarray) -> np.ndarray:
    """Sum of the squares of ``r`` (N,) in each experiment, shape (experiments,)."""
    count, segments = len(model.setup.outputs), model.problem.segments
    squares = np.array([float(np.sum(r[part] ** 2)) for part in segments])
    return np.array([sum(own) for own in squares.reshape(-1, count)])
