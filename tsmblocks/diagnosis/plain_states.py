"""Initial states as they are written: plain values where the data do not determine them, else rounded."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tsmblocks.common.rounding import decimals
from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.jacobian import Block, Jacobian
from tsmblocks.fitting.parameters import is_start, numbers
from tsmblocks.fitting.statistics import intervals, uncertainty

MAX_CHANGE = 1.0
"""Sum of squares by which the outputs of an experiment may change for plain values [noise variances]. Derived: one
standard error of the state."""
MORE_DECIMALS = 1
"""Decimals beyond those of a state's uncertainty that are kept. Chosen: a hundredth of it changes nothing."""
OPEN_DIGITS = 4
"""Digits of a state that is not determined, but of which the outputs depend. Chosen."""
MIN_SINGULAR_VALUE = 1e-6
"""Relative singular value below which other states do not make up for one. Chosen: beyond rounding."""


def with_plain_states(model: Model) -> Model:
    """The model with the diagram's own initial states where those of an experiment are not determined.

    The other states of the experiment make up for a change; where the outputs change by more than noise, a state stays.
    What is determined is rounded to a hundredth of its uncertainty.
    """
    state = _initial_states(model)
    if not state.any() or len(model.r) <= len(model.theta):
        return model
    held = np.eye(len(model.theta))[model.at_bound & ~state]
    known = uncertainty(model.J, model.r, model.problem.segments, held=held if len(held) else None)
    half = intervals(np.zeros(len(model.theta)), known.covariance, known.freedom)[1]
    half = np.where(np.isfinite(half) & (half > 0), half, np.inf)
    plain = np.array([model.diagram.parameters.get(i.parameter, 0.0) for i in model.problem.unknowns.items])
    theta, done = _plain(model, plain, state & (np.abs(model.theta - plain) <= half))
    rounded = np.where(state & ~done, [*map(_rounded, theta, half)], theta)
    rounded = np.clip(rounded, model.problem.unknowns.low, model.problem.unknowns.high)
    change = model.problem.residuals(rounded) - model.problem.residuals(theta)
    for block in Jacobian.of(model.J).blocks():
        if not np.sum(change[block.rows] ** 2) <= MAX_CHANGE:  # a state to which the outputs are very sensitive
            rounded[block.columns] = theta[block.columns]
    r, J = model.problem.jacobian(rounded)
    return Model(model.diagram, model.problem, model.setup, rounded, r, J.with_finite_values())


def _rounded(value: float, half: float) -> float:
    """An initial state with half its interval, rounded to a part of it; to a few digits where it has none."""
    if np.isfinite(half):
        return round(float(value), decimals(0.0, half) + MORE_DECIMALS)
    return float(f"{value:.{OPEN_DIGITS}g}")


def _initial_states(model: Model) -> np.ndarray:
    """Which unknowns are initial states of one experiment, shape (n,)."""
    fields = numbers(model.diagram)
    items = model.problem.unknowns.items
    return np.array([bool(i.experiment) and is_start(fields.get(i.parameter, [])) for i in items], dtype=bool)


def _plain(model: Model, plain: np.ndarray, open_: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The unknowns with as many of the ``open_`` states at their ``plain`` values as leave the outputs, and which."""
    theta, done = model.theta.copy(), np.zeros(len(plain), dtype=bool)
    blocks, items = list(Jacobian.of(model.J).blocks()), model.problem.unknowns.items
    for name in dict.fromkeys(item.parameter for item, one in zip(items, open_, strict=True) if one):
        own = open_ & np.array([item.parameter == name for item in items])
        trial = theta.copy()
        for block in blocks:
            for k, step in _steps(block, own, open_ & ~done & ~own, plain - theta):
                trial[k] += step
        trial = np.where(own, plain, np.clip(trial, model.problem.unknowns.low, model.problem.unknowns.high))
        change = (model.problem.residuals(trial) - model.r) ** 2
        for block in blocks:
            here = block.columns[(own | open_)[block.columns]]
            if np.nansum(change[block.rows]) <= MAX_CHANGE and np.isfinite(change[block.rows]).all():
                theta[here] = np.where(done[here], theta[here], trial[here])
                done[here] |= own[here]
    return theta, done


def _steps(block: Block, own: np.ndarray, others: np.ndarray, change: np.ndarray) -> Iterator[tuple[int, float]]:
    """Steps of other states that make up for the ``change`` (n,) of those of ``own`` in the rows of an experiment."""
    mine, rest = block.columns[own[block.columns]], block.columns[others[block.columns]]
    if not len(mine) or not len(rest):
        return
    effect = block.values[:, own[block.columns]] @ change[mine]
    made = np.linalg.lstsq(block.values[:, others[block.columns]], -effect, rcond=MIN_SINGULAR_VALUE)[0]
    yield from zip(rest.tolist(), made.tolist(), strict=True)
