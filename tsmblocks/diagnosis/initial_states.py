"""Start values of memories that a search left where nothing depends on them, such as a gap thrown beyond its reach."""

from __future__ import annotations

import math
from collections.abc import Iterator

import attrs
import numpy as np

from tsmblocks.diagnosis.model import COARSE_TOLERANCE, FINE_TOLERANCE, Model, optimized

COST_TOLERANCE = 1e-4
"""Share of the sum of squares by which two ends are the same."""
REACH_FACTOR = 10.0
"""How many times the largest of its start values is surely beyond the reach of a memory."""
LINEAR_REACH = 1e-18
"""Share of that below which the way is halved as it is; above, its logarithm is, since searches throw far."""
BISECTIONS = 25
"""How often the way from there to the edge of its reach is halved."""
MAX_ROUNDS = 3
"""How often all of it is done at most, as long as it leaves less."""


def refine_memories(model: Model, rounds: int = MAX_ROUNDS) -> Model:
    """The model with such memories where they leave least, for each experiment by itself.

    A play may be engaged on either side when an experiment begins, or on its way from one to the other. Where the
    other states of the start make up for the wrong one, no step downhill leads across; so all of them are tried.
    """
    for _ in range(rounds):
        better = _turned(model)
        if better is None:
            break
        model = better
    return model


def reset_idle_memories(model: Model) -> Model:
    """The model with idle memories that moved where they began, if that leaves no more: an effect may then use them."""
    moved = _moved(model)
    if not moved.any():
        return model
    anew = optimized(
        model.problem, model.setup, np.where(moved, model.problem.unknowns.start, model.theta), FINE_TOLERANCE
    )
    return anew if anew.mean_square <= (1 + COST_TOLERANCE) * model.mean_square else model


def clip_idle_memories(model: Model) -> Model:
    """The model with idle memories at the edge beyond which a search threw them: the same, with numbers to show."""
    idle = _idle(model)
    if not idle.any():
        return model
    edges = _edges(model, idle)
    theta = np.clip(model.theta, edges.min(axis=0), edges.max(axis=0))
    return (
        attrs.evolve(model, theta=theta)
        if np.allclose(model.problem.residuals(theta), model.r, 0, COST_TOLERANCE)
        else model
    )


def _turned(model: Model) -> Model | None:
    """The model after one round; None where that leaves no less."""
    ends, enough = [model], COARSE_TOLERANCE * max(model.mean_square, 1.0)  # while much is left, much is near enough
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
    """Unknowns (n,) with the idle ones where they began, at either edge of their reach, and amid it."""
    idle, unknowns = _idle(model), model.problem.unknowns
    if not idle.any():
        return
    yield np.where(idle, unknowns.start, model.theta)
    edges = _edges(model, idle)
    if np.array_equal(edges[0], edges[1]):  # wherever they are, nothing depends on them
        return
    yield from (edges[0], edges[1], edges.mean(axis=0))


def _edges(model: Model, idle: np.ndarray) -> np.ndarray:
    """Between what values the idle ones matter, shape (2, n); the others as they are."""
    items, edges = model.problem.unknowns.items, np.array([model.theta, model.theta])
    for name in dict.fromkeys(item.parameter for item, one in zip(items, idle, strict=True) if one):
        own = idle & np.array([item.parameter == name for item in items])
        edges[:, own] = _reach(model, name, own)[:, own]
    return edges


def _reach(model: Model, name: str, own: np.ndarray) -> np.ndarray:
    """Between what values the start of a memory matters, shape (2, n); ``own`` (n,) marks it in each experiment.

    As the model has it where it does not matter at all.
    """
    unknowns = model.problem.unknowns
    sizes = [
        max(abs(value), abs(begin))
        for item, value, begin in zip(unknowns.items, model.theta, unknowns.start, strict=True)
        if item.parameter == name
    ]
    far = REACH_FACTOR * (max(sizes) or 1.0)
    of = np.zeros(len(own), dtype=int)  # the experiment that each belongs to
    for e in range(len(model.problem.trials)):
        of[unknowns.columns(e)] = e

    def values(way: np.ndarray) -> np.ndarray:
        return far * LINEAR_REACH * np.sinh(way)

    def left(starts: np.ndarray) -> np.ndarray:
        theta = np.clip(np.where(own, starts[of], model.theta), unknowns.low, unknowns.high)
        return _by_experiment(model, model.problem.residuals(theta))

    ends = math.asinh(1 / LINEAR_REACH) * np.array([-1.0, 1.0])
    beyond = [np.full(len(model.problem.trials), end) for end in ends]
    same = [left(values(end)) for end in beyond]
    matters = np.abs(same[0] - same[1]) > COST_TOLERANCE**2 * same[0]
    edges: list[np.ndarray] = []
    for side in (0, 1):
        outer, inner = beyond[side], beyond[1 - side]
        for _ in range(BISECTIONS):
            middle = (outer + inner) / 2
            still = np.abs(left(values(middle)) - same[side]) <= COST_TOLERANCE**2 * same[side]
            outer, inner = np.where(still, middle, outer), np.where(still, inner, middle)
        edges.append(np.where(own & matters[of], values(outer)[of], model.theta))
    return np.clip(np.array(edges), unknowns.low, unknowns.high)


def _idle(model: Model) -> np.ndarray:
    """Which start values, shape (n,), change nothing where the search left them, or next to nothing after moving."""
    return model.is_local & (np.linalg.norm(model.J, axis=0) == 0) | _moved(model)


def _moved(model: Model) -> np.ndarray:
    """Which start values, shape (n,), the search moved to where they change next to nothing."""
    begin = model.problem.unknowns.start
    felt = np.linalg.norm(model.J, axis=0) * np.maximum(np.abs(model.theta), np.abs(begin))
    return model.is_local & (model.theta != begin) & (felt <= np.sqrt(COST_TOLERANCE) * np.linalg.norm(model.r))


def _by_experiment(model: Model, r: np.ndarray) -> np.ndarray:
    """Sum of the squares of ``r`` (N,) in each experiment, shape (experiments,)."""
    count, segments = len(model.setup.outputs), model.problem.segments
    return np.array(
        [
            sum(float(np.sum(r[part] ** 2)) for part in segments[e * count : (e + 1) * count])
            for e in range(len(model.problem.trials))
        ]
    )
