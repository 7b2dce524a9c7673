"""Two time constants in series: which of them belongs to which block is not to be seen from input and output."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from tsmblocks.common.errors import TsmError
from tsmblocks.diagnosis.decision import INDISTINGUISHABLE_NOISE_SHARE
from tsmblocks.diagnosis.model import Model, optimized
from tsmblocks.fitting.parameter_vector import Unknown

MIN_RATIO = 1.2
"""Ratio of two time constants from which their exchange is another model. Chosen."""


def exchange_notes(model: Model, noise_variance: float) -> list[str]:
    """A note on each two time constants that may be exchanged, since linear blocks in series have no order.

    The model is fitted again from where it ended with the two exchanged. A nonlinear block between them shows their
    order, so that the error then is larger.
    """
    notes = []
    for i, j in _pairs(model):
        start = model.theta.copy()
        start[[i, j]] = start[[j, i]]
        try:
            other = optimized(model.problem, model.setup, start)
        except TsmError:  # exchanged, it cannot be simulated
            continue
        stayed = (other.theta[i] - other.theta[j]) * (model.theta[i] - model.theta[j]) < 0
        if stayed and other.mean_square - model.mean_square < INDISTINGUISHABLE_NOISE_SHARE * noise_variance:
            first, second = (_with_value(model.problem.unknowns.items[k], float(model.theta[k])) for k in (i, j))
            notes.append(
                f"{first} and {second} may be exchanged: the recordings are explained as well the other way round. "
                "A recording of a signal between them, or the value of one of them, separates them."
            )
    return notes


def _pairs(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of unknowns that are time constants of two blocks, under one name."""
    items = model.problem.unknowns.items
    known = [k for k, one in enumerate(items) if one.unit == "s" and not one.experiment and "." in one.parameter]
    for i, j in combinations(known, 2):
        first, second = (items[k].parameter.rpartition(".")[2] for k in (i, j))
        low, high = sorted((float(model.theta[i]), float(model.theta[j])))
        if first == second and low > 0 and high > MIN_RATIO * low:
            yield i, j


def _with_value(one: Unknown, value: float) -> str:
    return f"{one.parameter} ({value:.3g} {one.unit})"
