"""The asymmetric Bouc-Wen model without any tool: one run over Python floats, many sets in NumPy vectors; both RK4."""

from __future__ import annotations

import math

import numpy as np


class Model:
    """Residuals of the model on one recording, the input linear between samples and the first state zero."""

    def __init__(self, x: np.ndarray, y: np.ndarray, h: float) -> None:
        self.x, self.y, self.h = x, y, h
        slopes = np.diff(x) / h
        self.v = np.append(slopes, slopes[-1])
        self.pairs = list(zip(x.tolist(), self.v.tolist(), strict=True))
        self.runs = 0

    def counted(self) -> int:
        """Simulations since the last time this was asked."""
        runs, self.runs = self.runs, 0
        return runs

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """One simulation, step by step on floats."""
        a1, a2, A, grip, delta = (float(v) for v in theta)
        h, zeta, out = self.h, 0.0, []
        self.runs += 1

        def rate(zeta: float, v: float) -> float:
            return A * v - grip * abs(v) * zeta + delta * abs(v)

        for x, v in self.pairs:
            rise = math.tanh(v)
            out.append(((1 + rise) * a1 + (1 - rise) * a2) / 2 * x + zeta)
            k1 = rate(zeta, v)
            k2 = rate(zeta + h / 2 * k1, v)
            k3 = rate(zeta + h / 2 * k2, v)
            k4 = rate(zeta + h * k3, v)
            zeta += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return np.array(out) - self.y

    def side_by_side(self, thetas: np.ndarray) -> np.ndarray:
        """Residuals of many sets (parameters, sets), stepped together, shape (samples, sets)."""
        a1, a2, A, grip, delta = thetas
        h, zeta, states = self.h, np.zeros(thetas.shape[1]), np.empty((len(self.x), thetas.shape[1]))
        self.runs += thetas.shape[1]

        def rate(zeta: np.ndarray, v: float) -> np.ndarray:
            return A * v - grip * abs(v) * zeta + delta * abs(v)

        for k, (_, v) in enumerate(self.pairs):
            states[k] = zeta
            k1 = rate(zeta, v)
            k2 = rate(zeta + h / 2 * k1, v)
            k3 = rate(zeta + h / 2 * k2, v)
            k4 = rate(zeta + h * k3, v)
            zeta = zeta + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        rise = np.tanh(self.v)[:, None]
        return ((1 + rise) * a1 + (1 - rise) * a2) / 2 * self.x[:, None] + states - self.y[:, None]

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Differences to one side, all in one run."""
        size = 1.5e-8 * np.maximum(np.abs(theta), 1.0)
        r = self.side_by_side(np.column_stack([theta, theta[:, None] + np.diag(size)]))
        return (r[:, 1:] - r[:, :1]) / size
