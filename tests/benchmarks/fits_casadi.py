"""The same fit with nothing but CasADi: the simulation as a graph, differentiated by it, solved by IPOPT.

Gauss-Newton matrices, since exact second derivatives take several times longer.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

SEGMENTS = 100
OPTIONS = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
LOW = [1e-6, 1e-6, -np.inf, 1e-6, -np.inf]
Build = Callable[[np.ndarray, np.ndarray, float, np.ndarray], Callable[[], np.ndarray]]


def one_step(h: float) -> ca.Function:
    """State, angle and velocity, parameters in; next state and output out. Expanded to scalar operations."""
    zeta, u, p = ca.SX.sym("zeta"), ca.SX.sym("u", 2), ca.SX.sym("p", 5)
    x, v = u[0], u[1]

    def rate(z: ca.SX) -> ca.SX:
        return p[2] * v - p[3] * ca.fabs(v) * z + p[4] * ca.fabs(v)

    k1 = rate(zeta)
    k2 = rate(zeta + h / 2 * k1)
    k3 = rate(zeta + h / 2 * k2)
    k4 = rate(zeta + h * k3)
    out = ((1 + ca.tanh(v)) * p[0] + (1 - ca.tanh(v)) * p[1]) / 2 * x + zeta
    return ca.Function("step", [zeta, u, p], [zeta + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), out])


def _driven(x: np.ndarray, h: float) -> np.ndarray:
    slopes = np.diff(x) / h
    return np.vstack([x, np.append(slopes, slopes[-1])])


def _solver(z: ca.MX, r: ca.MX, g: ca.MX) -> ca.Function:
    J = ca.jacobian(r, z)
    weight, forces, none = ca.MX.sym("weight"), ca.MX.sym("forces", g.shape[0]), ca.MX.sym("none", 0, 0)
    matrix = ca.Function("matrix", [z, none, weight, forces], [weight * ca.triu(J.T @ J)])
    return ca.nlpsol("fit", "ipopt", {"x": z, "f": ca.sumsqr(r) / 2, "g": g}, {**OPTIONS, "hess_lag": matrix})


def single_shooting(x: np.ndarray, y: np.ndarray, h: float, begin: np.ndarray) -> Callable[[], np.ndarray]:
    """The whole run as one function of the parameters (mapaccum)."""
    p, u = ca.MX.sym("p", 5), ca.DM(_driven(x, h))
    _, out = one_step(h).mapaccum("run", len(x))(0, u, ca.repmat(p, 1, len(x)))
    solver = _solver(p, out.T - y, ca.MX(0, 1))
    return lambda: np.asarray(solver(x0=begin, lbx=LOW)["x"]).ravel()


def multiple_shooting(x: np.ndarray, y: np.ndarray, h: float, begin: np.ndarray) -> Callable[[], np.ndarray]:
    """Pieces side by side, the state at each joint a variable."""
    length = (len(x) - 1) // SEGMENTS
    u, last = _driven(x, h), len(x) - 1
    p, starts = ca.MX.sym("p", 5), ca.MX.sym("starts", 1, SEGMENTS - 1)
    begins = ca.horzcat(0, starts)
    piece = one_step(h).mapaccum("piece", length)
    zeta, v, q = ca.MX.sym("zeta"), ca.MX.sym("v", 2 * length), ca.MX.sym("q", 5)
    path, out = piece(zeta, ca.reshape(v, 2, length), ca.repmat(q, 1, length))
    shot = ca.Function("shot", [zeta, v, q], [path[-1], out.T])
    inputs = ca.DM(u[:, :last].T.reshape(SEGMENTS, -1).T)
    ends, outs = shot.map(SEGMENTS)(begins, inputs, ca.repmat(p, 1, SEGMENTS))
    final = one_step(h)(ends[-1], ca.DM(u[:, last]), p)[1]
    r = ca.vertcat(ca.vec(outs), final) - y
    solver = _solver(ca.vertcat(p, starts.T), r, (ends[:-1] - starts).T)
    z = np.concatenate([begin, np.zeros(SEGMENTS - 1)])
    low = [*LOW, *[-np.inf] * (SEGMENTS - 1)]
    return lambda: np.asarray(solver(x0=z, lbx=low, lbg=0, ubg=0)["x"]).ravel()[:5]


FORMULATIONS: dict[str, Build] = {
    "CasADi alone, single shooting": single_shooting,
    f"CasADi alone, multiple shooting, {SEGMENTS} segments": multiple_shooting,
}
