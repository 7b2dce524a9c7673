"""Fig 9(b) by hand in Python: on plain floats, and on NumPy vectors, both RK4 with all signals logged."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from hand_c import LOG


class Model:
    """The right-hand side of Fig 9(b) on plain numbers."""

    def __init__(self, values: Mapping[str, float]) -> None:
        def number(name: str) -> float:
            return float(values[name] if name in values else values[name.partition(".")[2]])

        self.reference = [number(f"ref.{k}") for k in ("amplitude", "frequency", "phase", "offset")]
        self.model = [number(f"compensator.{k}") for k in ("alpha1", "alpha2", "A", "theta", "delta")]
        self.plant = [number(f"tsm.{k}") for k in ("alpha1", "alpha2", "A", "theta", "delta")]
        self.pid = [number(f"controller.{k}") for k in ("kp", "ki", "kd", "tau")]
        self.rest = [number(k) for k in ("drive.low", "drive.high", "motor.K", "motor.tau")]

    def __call__(self, t: float, x: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Rates of the states, and the signals."""
        amplitude, frequency, phase, offset = self.reference
        c1, c2, cA, ctheta, cdelta = self.model
        a1, a2, A, theta, delta = self.plant
        kp, ki, kd, tau = self.pid
        low, high, K, lag = self.rest
        integral, smooth, angle, speed, estimate, zeta = x
        w = 2 * math.pi * frequency
        x_ref = offset + amplitude * math.sin(w * t + phase)
        v_ref = amplitude * w * math.cos(w * t + phase)
        x_ff = (x_ref - estimate) / ((c1 + c2) / 2 + (c1 - c2) / 2 * math.tanh(v_ref))
        e = x_ff - angle
        d = (e - smooth) / tau
        wanted = kp * e + ki * integral + kd * d
        u = min(max(wanted, low), high)
        x_out = ((a1 + a2) / 2 + (a1 - a2) / 2 * math.tanh(speed)) * angle + zeta
        estimate_rate = cA * v_ref - ctheta * abs(v_ref) * estimate + cdelta * abs(v_ref)
        zeta_rate = A * speed - theta * abs(speed) * zeta + delta * abs(speed)
        rates = (e, d, speed, (K * u - speed) / lag, estimate_rate, zeta_rate)
        return rates, (x_ref, x_ff, e, wanted, u, angle, speed, x_out, *x)


def plain(model: Model, steps: int, h: float) -> list[tuple[float, ...]]:
    """The run on plain floats."""
    x, log = (0.0,) * 6, []
    for k in range(steps + 1):
        t = k * h
        k1, signals = model(t, x)
        log.append(signals)
        k2, _ = model(t + h / 2, tuple([a + h / 2 * b for a, b in zip(x, k1)]))  # noqa: B905 - strict costs time here
        k3, _ = model(t + h / 2, tuple([a + h / 2 * b for a, b in zip(x, k2)]))  # noqa: B905
        k4, _ = model(t + h, tuple([a + h * b for a, b in zip(x, k3)]))  # noqa: B905
        x = tuple([a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)])  # noqa: B905
    return log


def vectors(model: Model, steps: int, h: float) -> np.ndarray:
    """The run with states in NumPy vectors."""
    x, log = np.zeros(6), np.empty((steps + 1, len(LOG["fig09b"])))

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        return np.array(model(t, x)[0])

    for k in range(steps + 1):
        t = k * h
        first, log[k] = model(t, x)
        k1 = np.array(first)
        k2 = rates(t + h / 2, x + h / 2 * k1)
        k3 = rates(t + h / 2, x + h / 2 * k2)
        k4 = rates(t + h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return log
