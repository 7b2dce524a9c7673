"""Methods of the reference, from the literature: explicit tables, and diagonally implicit ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tests.fuzz.differential.evaluation import Instant, NoTest, Reference, Signal

_G2 = 1.0 - 1.0 / math.sqrt(2.0)
_G3 = 0.4358665215084589994
_B3 = -(6 * _G3**2 - 16 * _G3 + 1) / 4

EXPLICIT: dict[str, tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]] = {
    "euler": (((),), (1.0,)),
    "heun": (((), (1.0,)), (0.5, 0.5)),
    "rk4": (((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}
IMPLICIT: dict[str, tuple[tuple[float, ...], ...]] = {
    "sdirk2": ((_G2,), (1 - _G2, _G2)),
    "sdirk3": ((_G3,), ((1 - _G3) / 2, _G3), (_B3, 1 - _B3 - _G3, _G3)),
    "sdirk4": (
        (0.25,),
        (0.5, 0.25),
        (17 / 50, -1 / 25, 0.25),
        (371 / 1360, -137 / 2720, 15 / 544, 0.25),
        (25 / 24, -49 / 48, 125 / 16, -85 / 12, 0.25),
    ),
}
"""Rows of stages, of which the last are the weights: Alexander (1977); Hairer and Wanner (1996), Table IV.6.5."""
STAGE_ITERATIONS = 40


class ImplicitReference(Reference):
    """A run by an implicit method, whose stages are solved by Newton's method with differences."""

    def advance(self, t: float, k: int, here: Instant, rows: Any, weights: Any) -> None:
        """One step."""
        if not self.x:
            super().advance(t, k, here, ((),), (1.0,))
            return
        for name, past in self.past.items():
            past.append(here.signal(self.flat.driver[name, "u"]))
        keys, begin, slopes = list(self.x), np.array(list(self.x.values())), list[np.ndarray]()
        z = begin
        for row in rows:
            c = min(sum(row), 1.0) if sum(row) < 1 - 1e-12 else 1.0
            base = begin + self.h * sum((a * s for a, s in zip(row, slopes, strict=False)), np.zeros(len(begin)))
            z = self._stage(z, base, row[-1], (t + c * self.h, k, c), keys)
            slopes.append((z - base) / (self.h * row[-1]))
        self.x = dict(zip(keys, map(float, z), strict=True))

    def _stage(
        self, z: np.ndarray, base: np.ndarray, weight: float, when: tuple[float, int, float], keys: list[Signal]
    ) -> np.ndarray:
        """The states z = base + h weight f(z) of a stage."""

        def missed(states: np.ndarray) -> np.ndarray:
            rates = Instant(self, *when, dict(zip(keys, map(float, states), strict=True))).rates()
            return states - base - self.h * weight * np.array([rates[key] for key in keys])

        r = missed(z)
        for _ in range(STAGE_ITERATIONS):
            size = 1e-7 * (1 + np.abs(z))
            J = np.column_stack(
                [(missed(z + e * s) - missed(z - e * s)) / (2 * s) for e, s in zip(np.eye(len(z)), size, strict=True)]
            )
            change = np.linalg.solve(J, -r)
            z = z + change
            r = missed(z)
            if np.abs(change).max() <= 1e-13 * (1 + np.abs(z).max()):
                return z
        if np.abs(change).max() <= 1e-10 * (1 + np.abs(z).max()):
            return z
        raise NoTest("a stage that Newton's method does not solve")


def reference_run(
    flat: Any, h: float, steps: int, inputs: Any, method: str, noise: float = 0.0, seed: int = 0
) -> dict[Signal, np.ndarray]:
    """All outputs of all blocks by the reference."""
    if method in IMPLICIT:
        rows = IMPLICIT[method]
        return ImplicitReference(flat, h, inputs, noise, seed).run(steps, rows, rows[-1])
    return Reference(flat, h, inputs, noise, seed).run(steps, *EXPLICIT[method])


def smooth_run(flat: Any, h: float, steps: int, inputs: Any) -> dict[Signal, np.ndarray]:
    """All outputs where nothing but continuous states changes, with SciPy's integrator at a tight tolerance."""
    from scipy.integrate import solve_ivp

    model = Reference(flat, h, inputs)
    keys, begin = list(model.x), list(model.x.values())

    def rates(t: float, x: np.ndarray) -> list[float]:
        found = Instant(model, t, 0, 0.0, dict(zip(keys, map(float, x), strict=True))).rates()
        return [found[key] for key in keys]

    grid = h * np.arange(steps + 1)
    states = (
        solve_ivp(rates, (0.0, grid[-1]), begin, "DOP853", grid, rtol=1e-11, atol=1e-12).y
        if keys
        else np.empty((0, len(grid)))
    )
    logged: dict[Signal, list[float]] = {}
    for k, t in enumerate(grid):
        here = Instant(model, float(t), 0, 0.0, dict(zip(keys, map(float, states[:, k]), strict=True)))
        for name, block in flat.blocks.items():
            for port in block.outports:
                logged.setdefault((name, port), []).append(here.signal((name, port)))
    return {key: np.array(values) for key, values in logged.items()}
