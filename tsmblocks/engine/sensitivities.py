"""Exact derivatives of a run with respect to parameters (forward mode): one direction of parameters per SIMD lane.

CasADi differentiates the equations, the kernel carries the directions side by side. Since a
Runge-Kutta step commutes with linearisation, the result is the exact derivative of the discrete
solution, not an approximation of the continuous one.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.frames import dataset
from tsmblocks.common.tables import few
from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES, LAG, Equations, function_values
from tsmblocks.engine.implicit import step_of, tangent_step
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.kernel_frame import time_jumps
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import Plan, plan_for
from tsmblocks.engine.program import Program
from tsmblocks.engine.session import check_delays, delay_capacity


def tangent_plan(eq: Equations, method: Method, y: tuple[int, ...], lanes: int) -> Plan:
    """A plan that carries each state and each logged signal together with its derivatives."""
    rhs, update, lag = _tangent_functions(eq)
    advance = tangent_step(step_of(eq, method), _past_seed) if method.implicit else None

    def both(names: tuple[str, ...]) -> tuple[bool, ...]:
        """Which are wide: values are equal in all lanes, their derivatives are not."""
        return (False,) * len(names) + (True,) * len(names)

    return attrs.evolve(
        plan_for(eq, method, (*y, *(len(eq.y) + k for k in y)), lanes=lanes),
        rhs=rhs,
        update=update,
        lag=lag,
        advance=advance,
        wide_x=both(eq.x),
        wide_d=both(eq.d),
        wide_p=both(eq.p),
        wide_s=both(eq.q),
        jumps=time_jumps(Program(eq.rhs)),
    )


def _past_seed(qs: Any) -> Any:
    """Derivatives of the past of delayed signals, of which only the values have some, not the instants."""
    return ca.vertcat(ca.SX(0, 1), *(qs[i] if i % DELAY_NUMBERS < DELAY_SAMPLES else 0 for i in range(qs.shape[0])))


def _tangent_functions(eq: Equations) -> tuple[Any, Any, Any]:
    """``rhs``, ``update`` (None where there is none) and ``lag``, each value followed by its directional derivative."""
    f, renewed = eq.exact
    t, x, d, u, q, p, *guess = f.sx_in()
    xs, ds, qs, ps = (ca.SX.sym(f"d{k}", v.shape[0]) for k, v in zip("xdqp", (x, d, q, p), strict=True))
    made = f.call([t, x, d, u, q, p, *guess])
    values, roots = made[:3], made[3:]
    moving, along = ca.vertcat(x, d, q, p), ca.vertcat(xs, ds, _past_seed(qs), ps)
    tangents = [ca.jtimes(v, moving, along) for v in values]
    inputs = [t, ca.vertcat(x, xs), ca.vertcat(d, ds), u, ca.vertcat(q, qs), ca.vertcat(p, ps)]
    pairs = [ca.vertcat(a, b) for a, b in zip(values, tangents, strict=True)]
    rhs = ca.Function("rhs", [*inputs, *guess], [*pairs, *roots], f.name_in(), f.name_out())
    update = None
    if eq.update is not None:
        hit = ca.SX.sym("hit", len(eq.periods))
        guess = renewed.sx_in()[7:]
        made = renewed.call([t, x, d, u, q, p, hit, *guess])
        new, roots = made[:2], made[2:]
        pairs = [ca.vertcat(v, ca.jtimes(v, moving, along)) for v in new]
        names = renewed.name_in(), renewed.name_out()
        update = ca.Function("update", [*inputs, hit, *guess], [*pairs, *roots], *names)
    tau = eq.lag.call([p])[0]
    return rhs, update, ca.Function("lag", [ca.vertcat(p, ps)], [ca.vertcat(tau, tau)], *LAG)


@functools.lru_cache(maxsize=64)
def _start_and_derivatives(eq: Equations, runs: int) -> Any:
    """Initial states of many runs, and their derivatives by parameters (cached: building it takes long)."""
    p = eq.start.sx_in()[0]
    values = ca.vertcat(*eq.start.call([p]))
    one = ca.Function("start", [p], [ca.densify(values), ca.densify(ca.jacobian(values, p))])
    return one.map(runs)


def tangent_memory(eq: Equations, kernel: Kernel, p: np.ndarray, seeds: np.ndarray, h: float) -> Memory:
    """Memory before the first step; ``seeds`` has shape (parameters, lanes)."""
    return tangent_memories(eq, kernel, p[None], seeds[None], [h])[0]


def tangent_memories(
    eq: Equations, kernel: Kernel, p: np.ndarray, seeds: np.ndarray, h: Sequence[float]
) -> list[Memory]:
    """As ``tangent_memory`` for many runs: ``p`` (runs, parameters), ``seeds`` (runs, parameters, lanes)."""
    runs, lanes = len(p), kernel.plan.lanes
    values, derivatives = function_values(_start_and_derivatives(eq, runs), p)
    along = derivatives.reshape(runs, p.shape[1], -1).transpose(0, 2, 1) @ seeds
    ends = np.cumsum([len(eq.x), len(eq.d)])

    def both(part: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        return np.concatenate([np.broadcast_to(part[:, :, None], (*part.shape, lanes)), tangent], axis=1)

    parts = zip(np.split(values.reshape(runs, -1), ends, axis=1), np.split(along, ends, axis=1), strict=True)
    x, d, s = (both(*pair) for pair in parts)
    capacities = [delay_capacity(check_delays(eq, one, step)) for one, step in zip(p, h, strict=True)]
    return kernel.memories(x, d, both(p, seeds), s, capacities)


@attrs.frozen(eq=False)
class Sensitivities:
    """Signals and their derivatives: ``y`` of shape (N, signals), ``jacobian`` of shape (N, signals, parameters)."""

    t: np.ndarray
    y: np.ndarray
    jacobian: np.ndarray
    signals: tuple[str, ...]
    parameters: tuple[str, ...]

    def to_xarray(self) -> Any:
        """A data set over ``t`` [s], ``signal`` and ``parameter``: signals ``y`` and their ``jacobian``.

        Needs xarray.
        """
        coords = {
            "t": (("t",), self.t, "s"),
            "signal": (("signal",), list(self.signals), ""),
            "parameter": (("parameter",), list(self.parameters), ""),
        }
        found = {"y": (("t", "signal"), self.y, ""), "jacobian": (("t", "signal", "parameter"), self.jacobian, "")}
        return dataset(found, coords, {})

    def __repr__(self) -> str:
        return f"Sensitivities({few(self.signals)} by {few(self.parameters)}, {len(self.t)} instants)"
