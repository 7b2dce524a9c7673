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
            [e, d, speed, (n["K"] * u - speed) / n["motor_tau"], zeta_rate(v_ref, estimate), zeta_rate(speed, zeta)]
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


def fig16(n: dict[str, float], stop: float, step: float) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Fig 16 as a function of (pid.kp, pid.ki, plant's theta, A, alpha1): tracking error and voltage at every step."""
    w, steps = 2 * np.pi * n["ref.frequency"], round(stop / step)

    def parts(t, x, p):
        tip_integral, integral, smooth, angle, speed, estimate, zeta = x
        kp, ki, _, _, alpha1 = p
        ref, rate = n["ref.amplitude"] * np.sin(w * t), n["ref.amplitude"] * w * np.cos(w * t)
        slope = (n["alpha1"] + n["alpha2"]) / 2 + (n["alpha1"] - n["alpha2"]) / 2 * np.tanh(rate)
        out = ((alpha1 + n["alpha2"]) / 2 + (alpha1 - n["alpha2"]) / 2 * np.tanh(speed)) * angle + zeta
        miss = ref - out
        error = (ref - estimate) / slope + kp * miss + ki * tip_integral - angle
        d = (error - smooth) / n["controller.tau"]
        wanted = n["controller.kp"] * error + n["controller.ki"] * integral + n["controller.kd"] * d
        return miss, rate, error, d, np.clip(wanted, n["drive.low"], n["drive.high"])

    def rates(t, x, _, p):
        _, _, _, _, speed, estimate, zeta = x
        miss, rate, error, d, u = parts(t, x, p)
        forced = n["A"] * rate - n["theta"] * abs(rate) * estimate + n["delta"] * abs(rate)
        moved = p[3] * speed - p[2] * abs(speed) * zeta + n["delta"] * abs(speed)
        return np.hstack([miss, error, d, speed, (n["motor.K"] * u - speed) / n["motor.tau"], forced, moved])

    advance = arc.discretize(rates, dt=step, method="rk4")

    @arc.compile
    def simulate(carried):
        def one(carried, k):  # its scan takes nothing from outside, so the numbers are carried along
            x, p = carried[:7], carried[7:]
            miss, _, _, _, u = parts(k * step, x, p)
            return np.hstack([advance(k * step, x, 0.0, p), p]), np.hstack([miss, u])

        return arc.scan(one, carried, xs=np.arange(steps + 1.0))[1]

    def run(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        made = np.asarray(simulate(np.concatenate([np.zeros(7), p])))
        return made[:, 0], made[:, 1]

    return run
