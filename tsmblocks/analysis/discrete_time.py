"""Linear discrete-time models of diagrams with sampled blocks, over the period after which all samples coincide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.operating_point import HELD_SUFFIX, LocalEquations, with_held_outputs
from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations

MATRIX_TOLERANCE = 1e-9
"""Difference of two matrices, as a share of the largest number, that is rounding."""
MOST_TICKS = 10_000
"""Ticks between instants at which all samples coincide, at most. Chosen: the model is a product of so many."""


@attrs.frozen(eq=False)
class SampledModel:
    """A discrete-time state space, its period ``dt`` [s] and the names of its states, held outputs included."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    states: list[str]

    def without_idle(self) -> SampledModel:
        """The same model without held outputs on which neither states nor outputs depend."""
        used = np.asarray(np.vstack([self.A, self.C]).any(axis=0))
        kept = [k for k, name in enumerate(self.states) if used[k] or not name.endswith(HELD_SUFFIX)]
        names = [self.states[k].replace(HELD_SUFFIX, "_held") for k in kept]
        return SampledModel(self.A[np.ix_(kept, kept)], self.B[kept], self.C[:, kept], self.D, self.dt, names)

    def closes_to(self, other: SampledModel) -> bool:
        """Whether the loop, closed from the only output to the only input, has the dynamics of ``other``."""
        difference = np.abs(self.A + self.B @ self.C / (1.0 - self.D.item()) - other.A).max(initial=0.0)
        return bool(difference <= MATRIX_TOLERANCE * max(1.0, np.abs(other.A).max(initial=0.0)))


def sampled_model(here: LocalEquations, x: np.ndarray, names: Sequence[str], shown: Sequence[str]) -> SampledModel:
    r"""The linear model around states ``x`` and the memory at the start, inputs ``names`` held over a period.

    Between samples the continuous part is its matrix exponential; at a sample memory and held outputs are updated by
    their Jacobians. Both are multiplied over the period after which all samples coincide. The states are those just
    before a sample, the outputs those after it. Raises RunError.
    """
    _check(here, names)
    every, tick = _ticks(here.eq)
    cycle = math.lcm(*every)
    d, n = with_held_outputs(here.eq, here.t, x, here.d, here.u, here.p), len(x)
    own = [here.places[here.inputs.index(name)] for name in names]
    rates, signals, update = _jacobian_functions(here.eq, tuple(here.eq.aliases.get(name, name) for name in shown))
    given = (x, d, here.u, here.t, here.p)
    size = n + len(d)
    transition, hold = np.split(_transition(_evaluated(rates, own, given), tick), [size], axis=1)

    def sample(k: int) -> tuple[np.ndarray, np.ndarray]:
        """Jacobians of the states after the samples at tick ``k``."""
        return _evaluated(update, own, (*given, [float(k % each == 0) for each in every]))

    direct, direct_u = _evaluated(signals, own, given)
    z, u = sample(0)
    C, D = direct @ z, direct @ u + direct_u
    A, B = np.eye(size), np.zeros((size, len(own)))
    for k in range(cycle):
        z, u = sample(k)
        step = transition @ z
        A, B = step @ A, step @ B + transition @ u + hold
    return SampledModel(A, B, C, D, tick * cycle, [*here.eq.x, *here.eq.d])


def _check(here: LocalEquations, names: Sequence[str]) -> None:
    eq = here.eq
    if eq.q:
        raise RunError(
            f"'{eq.title}' has dead times beside samples, of which there is no linear model: "
            f"{', '.join(eq.q)}. Use a UnitDelay instead."
        )
    differentiated = [name for name in names if any(f.order and f.name == "d/dt " * f.order + name for f in eq.u)]
    if differentiated:
        raise RunError(
            f"'{eq.title}' depends on the derivative of its input '{differentiated[0]}', which a discrete-time model "
            "holds between samples. Put a lag on the input."
        )


def _ticks(eq: Equations) -> tuple[tuple[int, ...], float]:
    """Each period in ticks, and the tick: the longest time [s] of which all periods are multiples."""
    ratios = [Fraction(period / eq.periods[0]).limit_denominator(100_000) for period in eq.periods]
    common = math.lcm(*(r.denominator for r in ratios))
    every = [int(r * common) for r in ratios]
    shared = math.gcd(*every)
    if math.lcm(*every) // shared > MOST_TICKS:
        listed = ", ".join(f"{period:g} s" for period in eq.periods)
        raise RunError(f"the samples of '{eq.title}' coincide too seldom for a linear model (periods {listed}).")
    return tuple(n // shared for n in every), eq.periods[0] / common * shared


@lru_cache(maxsize=64)
def _jacobian_functions(eq: Equations, signals: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """Jacobians of rates, of signals, and of the update at a sample, by states, memory and inputs."""
    x, d, u = ca.SX.sym("x", len(eq.x)), ca.SX.sym("d", len(eq.d)), ca.SX.sym("u", len(eq.u))
    t, p, due, none = ca.SX.sym("t"), ca.SX.sym("p", len(eq.p)), ca.SX.sym("due", len(eq.periods)), ca.SX(0, 1)
    dx, y, _ = eq.rhs.call([t, x, d, u, none, p])
    shown = ca.vertcat(ca.SX(0, 1), *(y[eq.y.index(name)] for name in signals))
    d_next, x_next = eq.update.call([t, x, d, u, none, p, due])
    given = [x, d, u, t, p]

    def jacobian(rows: Any, *more: Any) -> Any:
        return ca.Function("jacobian", [*given, *more], [ca.densify(ca.jacobian(rows, ca.vertcat(x, d, u)))])

    return jacobian(dx), jacobian(shown), jacobian(ca.vertcat(x_next, d_next), due)


def _evaluated(function: Any, own: list[int], given: tuple[Any, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians by states and memory together, and by the chosen inputs. Raises RunError."""
    J = np.asarray(function(*given), dtype=float)
    if not np.isfinite(J).all():
        raise RunError("the derivatives are not finite at this point. Choose another one.")
    by_states, by_inputs = np.split(J, [len(given[0]) + len(given[1])], axis=1)
    return by_states, by_inputs[:, own]


def _transition(jacobians: tuple[np.ndarray, np.ndarray], tick: float) -> np.ndarray:
    """The transition of states and memory over a tick, and the effect of inputs held over it, side by side."""
    from scipy.linalg import expm

    rates = np.hstack(jacobians)
    whole = np.zeros((rates.shape[1], rates.shape[1]))
    whole[: len(rates)] = rates
    return np.asarray(expm(whole * tick))[: jacobians[0].shape[1]]
