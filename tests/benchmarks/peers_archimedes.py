"""Fig 9(b) in Archimedes: one function (it has no wires), its RK4, and its scan over the steps."""

from __future__ import annotations

from collections.abc import Callable

import archimedes as arc
import numpy as np
from peers_common import Formulas

TOLERANCE = 1e-8
METHOD = "RK4, fixed step"
COMPILES = True


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The right-hand side, discretised; each call scans it over the run."""
    f, n = Formulas(numbers), numbers
    steps = round(stop / step)

    def slope(v):
        return f.mean + f.half * np.tanh(v)

    def zeta_rate(v, zeta):
        return n["A"] * v - n["theta"] * abs(v) * zeta + n["delta"] * abs(v)

    def rates(t, x, u, p):
        integral, smooth, angle, speed, estimate, zeta = x
        v_ref = n["amplitude"] * f.w * np.cos(f.w * t)
        e = (n["amplitude"] * np.sin(f.w * t) - estimate) / slope(v_ref) - angle
        d = (e - smooth) / n["tau"]
        u = np.clip(n["kp"] * e + n["ki"] * integral + n["kd"] * d, n["low"], n["high"])
        return np.hstack(
            [
                e,
                d,
                speed,
                (n["K"] * u - speed) / n["motor_tau"],
                zeta_rate(v_ref, estimate),
                zeta_rate(speed, zeta),
            ]
        )

    advance = arc.discretize(rates, dt=step, method="rk4")

    @arc.compile
    def simulate(x):
        def one(x, k):
            return advance(k * step, x, 0.0, 0.0), n["amplitude"] * np.sin(f.w * k * step) - (slope(x[3]) * x[2] + x[5])

        return arc.scan(one, x, xs=np.arange(steps + 1.0))[1]

    def run() -> np.ndarray:
        return np.asarray(simulate(np.zeros(6)))

    return run
