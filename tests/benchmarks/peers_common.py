"""What the other tools need of Fig 9(b): its numbers, its formulas in plain Python, a fixed-step solver.

Each ``peers_*`` module has ``build(numbers, stop, step)``, which makes the diagram with that tool and
returns a function that runs it and gives the tracking error x_ref - x_out at every step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np


class Formulas:
    """The paper's equations on plain numbers: slope (13), rate of the internal state (8), reference."""

    def __init__(self, numbers: dict[str, float]) -> None:
        self.__dict__.update(numbers)
        self.n = numbers
        self.w = 2 * math.pi * numbers["frequency"]
        self.mean = (numbers["alpha1"] + numbers["alpha2"]) / 2
        self.half = (numbers["alpha1"] - numbers["alpha2"]) / 2

    def slope(self, v: float) -> float:
        return self.mean + self.half * math.tanh(v)

    def zeta_rate(self, v: float, zeta: float) -> float:
        n, speed = self.n, abs(v)
        return n["A"] * v - n["theta"] * speed * zeta + n["delta"] * speed

    def x_ref(self, t: float) -> float:
        return self.n["amplitude"] * math.sin(self.w * t)

    def v_ref(self, t: float) -> float:
        return self.n["amplitude"] * self.w * math.cos(self.w * t)

    def pid_polynomials(self) -> tuple[list[float], list[float]]:
        """Numerator and denominator of kp + ki / s + kd s / (tau s + 1)."""
        n = self.n
        corner = 1 / n["tau"]
        return [n["kp"] + n["kd"] * corner, n["kp"] * corner + n["ki"], n["ki"] * corner], [1.0, corner, 0.0]


def fixed_step_rk4(step: float) -> Any:
    """Classic RK4 as a scipy solver class, for tools that only know ``solve_ivp``; ``step`` is its step."""
    from scipy.integrate import DenseOutput, OdeSolver

    class Straight(DenseOutput):
        """Linear between two steps: results are read at the steps only."""

        def __init__(self, t_old: float, t: float, y_old: np.ndarray, y: np.ndarray) -> None:
            super().__init__(t_old, t)
            self.y_old, self.y = y_old, y

        def _call_impl(self, t: Any) -> Any:
            part = (np.asarray(t) - self.t_old) / (self.t - self.t_old)
            return (self.y_old + np.multiply.outer(part, self.y - self.y_old)).T

    class FixedRK4(OdeSolver):
        """Steps that land on multiples of ``step`` from the start, and on the end."""

        def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, vectorized: bool = False, **_: Any) -> None:
            super().__init__(fun, t0, y0, t_bound, vectorized)
            self.start, self.count = t0, 0

        def _step_impl(self) -> tuple[bool, None]:
            self.count += 1
            t, y, f = self.t, self.y, self.fun
            goal = self.start + self.count * step
            if goal > self.t_bound - 1e-6 * step:
                goal = self.t_bound
            h = goal - t
            k1 = f(t, y)
            k2 = f(t + h / 2, y + h / 2 * k1)
            k3 = f(t + h / 2, y + h / 2 * k2)
            k4 = f(goal, y + h * k3)
            self.y_before = y
            self.y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self.t = goal
            return True, None

        def _dense_output_impl(self) -> Any:
            return Straight(self.t_old, self.t, self.y_before, self.y)

    return FixedRK4
