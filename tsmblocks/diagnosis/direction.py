"""Whether a force moves a signal forwards or backwards."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.diagnosis.signal_paths import PROBE, probed
from tsmblocks.engine.equations import function_values
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import parameter_vector

NO_CHANGE = 1e-12
"""Change of a signal, as a share of the largest change of any, that is rounding. Chosen."""


def moves_backwards(diagram: Diagram, signal: str, port: str) -> bool:
    """Whether more drive at a port makes a signal smaller at first: the sign of the first Markov parameter.

    It is so of a deflection from which the signal that is driven is subtracted. False where the drive does not reach
    the signal without memory, such as a backlash, in between.
    """
    found = probed(diagram, signal, before=port)
    if found is None:
        return False
    edited, eq, place = found
    p = parameter_vector(eq, edited)
    x, d = function_values(eq.start, p)[:2]
    at = [0.0, x, d, np.zeros(len(eq.u)), np.zeros(eq.rhs.size1_in(4)), p]
    by = np.zeros(len(p))
    by[eq.p.index(PROBE)] = 1.0
    forward, values = eq.rhs.forward(1), eq.rhs.call(at)
    rate, changes = _changes(forward, at, values, {5: by})
    for _ in range(len(x) + 1):
        if abs(changes[place]) > NO_CHANGE * np.abs(changes).max():
            return bool(changes[place] < 0)
        rate, changes = _changes(forward, at, values, {1: rate})
    return False


def _changes(forward: Any, at: list[Any], values: list[Any], seeds: dict[int, np.ndarray]) -> list[np.ndarray]:
    """The changes of rates and signals with those of some arguments."""
    directions = [seeds.get(k, ca.DM.zeros(*ca.DM(one).shape)) for k, one in enumerate(at)]
    return [np.asarray(one, dtype=float).ravel() for one in forward.call([*at, *values, *directions])[:2]]
