"""Linear models of diagrams with sampled blocks: from one instant at which all of them act to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.operating_point import Still, settled
from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations

HELD = " (held)"
"""What ends the name of an output that is held between samples."""
MATRIX_TOLERANCE = 1e-9
"""Difference of two matrices, as a share of the largest number, that is rounding."""
MOST_TICKS = 10_000
"""Instants at which some block acts, from one at which all do to the next, at most."""


@attrs.frozen(eq=False)
class Sampled:
    """A discrete state space, its period ``dt`` [s] and the names of its states: all there are, held outputs too."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    states: list[str]

    def without_idle(self) -> Sampled:
        """The same without held outputs on which nothing that comes depends."""
        kept = [
            k
            for k, name in enumerate(self.states)
            if not name.endswith(HELD) or self.A[:, k].any() or self.C[:, k].any()
        ]
        names = [self.states[k].replace(HELD, "_held") for k in kept]
        return Sampled(self.A[np.ix_(kept, kept)], self.B[kept], self.C[:, kept], self.D, self.dt, names)

    def closes_to(self, other: Sampled) -> bool:
        """Whether the loop, closed from the only output to the only input, moves as ``other`` does."""
        closed = self.A + self.B @ self.C / (1.0 - self.D.item())
        return bool(
            np.abs(closed - other.A).max(initial=0.0) <= MATRIX_TOLERANCE * max(1.0, np.abs(other.A).max(initial=0.0))
        )


def model(here: Still, x: np.ndarray, names: Sequence[str], shown: Sequence[str]) -> Sampled:
    r"""The linear model around states ``x`` and the memory at the start, inputs ``names`` held over a period.

    Between two samples the continuous part moves by its matrix exponential; at a sample memory and held outputs move
    on by their slopes. Both are multiplied up over the period after which all samples fall together again. The states
    are those just before a sample, the outputs what holds from it on. Raises RunError.
    """
    _check(here, names)
    every, tick = _ticks(here.eq)
    d, own, n = settled(here.eq, here.t, x, here.d, here.u, here.p), _own(here, names), len(x)
    rates, signals, update = _slopes(here.eq, tuple(here.eq.aliases.get(name, name) for name in shown))
    given = (x, d, here.u, here.t, here.p)
    flow, still = _flow(_parts(rates, given), own, tick, n), _parts(signals, given)
    size = n + len(d)
    A, B, C, D = np.eye(size), np.zeros((size, len(own))), None, None
    for k in range(math.lcm(*every)):
        hit = [float(k % each == 0) for each in every]
        z, u = _split(_parts(update, (*given, hit)), own)
        if C is None:
            direct = np.hstack(still[:2])
            C, D = direct @ z, direct @ u + still[2][:, own]
        step, push = flow[:, :size] @ z, flow[:, :size] @ u + flow[:, size:]
        A, B = step @ A, step @ B + push
    assert C is not None
    assert D is not None
    return Sampled(A, B, C, D, tick * math.lcm(*every), [*here.eq.x, *here.eq.d])


def _check(here: Still, names: Sequence[str]) -> None:
    eq = here.eq
    if eq.q:
        raise RunError(
            f"'{eq.title}' has dead times beside samples, of which there is no linear model: "
            f"{', '.join(eq.q)}. Put a UnitDelay in the place."
        )
    sloped = [name for name in names if any(f.order and f.name == "d/dt " * f.order + name for f in eq.u)]
    if sloped:
        raise RunError(
            f"'{eq.title}' follows the slope of its input '{sloped[0]}', which a linear model of samples "
            "holds in between. Put a lag on the input."
        )


def _ticks(eq: Equations) -> tuple[tuple[int, ...], float]:
    """Each period in ticks, and the longest tick [s] of which all are multiples."""
    ratios = [Fraction(period / eq.periods[0]).limit_denominator(100_000) for period in eq.periods]
    common = math.lcm(*(r.denominator for r in ratios))
    every = [int(r * common) for r in ratios]
    shared = math.gcd(*every)
    if math.lcm(*every) // shared > MOST_TICKS:
        said = ", ".join(f"{period:g} s" for period in eq.periods)
        raise RunError(f"the samples of '{eq.title}' fall together too seldom for a linear model (periods {said}).")
    return tuple(n // shared for n in every), eq.periods[0] / common * shared


def _own(here: Still, names: Sequence[str]) -> list[int]:
    return [here.places[here.inputs.index(name)] for name in names]


@lru_cache(maxsize=64)
def _slopes(eq: Equations, signals: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """Slopes of rates, of signals, and of what states and memory become at a sample, by states, memory and inputs."""
    x, d, u = ca.SX.sym("x", len(eq.x)), ca.SX.sym("d", len(eq.d)), ca.SX.sym("u", len(eq.u))
    t, p, hit, none = ca.SX.sym("t"), ca.SX.sym("p", len(eq.p)), ca.SX.sym("hit", len(eq.periods)), ca.SX(0, 1)
    dx, y, _ = eq.rhs.call([t, x, d, u, none, p])
    shown = ca.vertcat(ca.SX(0, 1), *(y[eq.y.index(name)] for name in signals))
    d_next, x_next = eq.update.call([t, x, d, u, none, p, hit])
    given = [x, d, u, t, p]

    def made(rows: Any, more: tuple[Any, ...] = ()) -> Any:
        return ca.Function("slopes", [*given, *more], [ca.densify(ca.jacobian(rows, by)) for by in (x, d, u)])

    return made(dx), made(shown), made(ca.vertcat(x_next, d_next), (hit,))


def _parts(function: Any, given: tuple[Any, ...]) -> list[np.ndarray]:
    made = [np.asarray(J, dtype=float) for J in function(*given)]
    if not all(np.isfinite(J).all() for J in made):
        raise RunError("the slopes are not finite at this point. Begin at another one.")
    return made


def _split(parts: list[np.ndarray], own: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Slopes by states and memory together, and by the inputs that are looked at."""
    return np.hstack(parts[:2]), parts[2][:, own]


def _flow(parts: list[np.ndarray], own: list[int], tick: float, n: int) -> np.ndarray:
    """How states and memory go through a tick: by themselves, and by the inputs held over it."""
    from scipy.linalg import expm

    by, push = _split(parts, own)
    size = by.shape[1] + len(own)
    whole = np.zeros((size, size))
    whole[:n] = np.hstack([by, push])
    return np.asarray(expm(whole * tick))[: by.shape[1]]
