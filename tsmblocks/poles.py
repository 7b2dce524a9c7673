"""Fastest poles of the equations at the start of a run, to judge the step by."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.engine.methods import Method
from tsmblocks.engine.session import Session
from tsmblocks.equation_set import KEPT, PER_DELAY, Equations

DENSE = 120
"""Up to so many states all eigenvalues are found; above, the diagonal of the Jacobian is looked at."""

_JACOBIANS: dict[int, tuple[Equations, Any]] = {}


def fastest_unstable(
    eq: Equations, rule: Method, session: Session, p: np.ndarray, h: float
) -> tuple[complex, str] | None:
    """The fastest decaying pole that grows under the method, with the state it belongs to; None if all is well."""
    if not eq.x:
        return None
    q = np.tile([*np.zeros(KEPT), session.start, 1 / h, 0.0], len(eq.q))  # nothing is kept yet
    u = np.array([s.at(np.array([session.start]), order, "right", 1e-6 * h)[0] for s, order in session.signals])
    jacobian = _jacobian(eq)(session.start, session.memory.x, session.memory.d, u, q, p)
    if len(eq.x) <= DENSE:
        a = np.asarray(jacobian)
        if not np.isfinite(a).all():
            return None  # the run itself will say what is not finite, and where
        values, vectors = np.linalg.eig(a)
        owners = [int(np.argmax(np.abs(v))) for v in vectors.T]
    else:
        values = np.asarray(ca.diag(jacobian)).ravel().astype(complex)
        owners = list(range(len(values)))
    grown = [k for k, z in enumerate(values) if z.real < 0 and np.isfinite(z) and rule.grows(h * complex(z))]
    if not grown:
        return None
    worst = max(grown, key=lambda k: abs(values[k]))
    return complex(values[worst]), eq.x[owners[worst]]


def poles(eq: Equations, p: np.ndarray) -> np.ndarray:
    """Poles of the equations around their start values, with inputs of zero; none where they are not finite."""
    x, d, _ = (np.asarray(v).ravel() for v in eq.start(p))
    a = np.asarray(_jacobian(eq)(0.0, x, d, np.zeros(len(eq.u)), np.zeros(PER_DELAY * len(eq.q)), p))
    return np.linalg.eigvals(a) if a.size and np.isfinite(a).all() else np.empty(0)


def _jacobian(eq: Equations) -> Any:
    """d(dx)/dx as a function, made once for each set of equations."""
    known = _JACOBIANS.get(id(eq))
    if known is None or known[0] is not eq:
        symbols = eq.rhs.sx_in()
        dx = eq.rhs.call(symbols)[0]
        known = (eq, ca.Function("slopes", symbols, [ca.jacobian(dx, symbols[1])]))
        if len(_JACOBIANS) > 64:
            _JACOBIANS.clear()
        _JACOBIANS[id(eq)] = known
    return known[1]
