"""Stability limits of a loop: gain and phase margins from its state space."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

STABILITY_TOLERANCE = 1e-6
"""Real part of a stable pole, as a share of the fastest pole, that is rounding. Chosen."""
UNIT_CIRCLE_ANGLES = np.pi * np.concatenate([np.geomspace(1e-7, 0.01, 400), np.linspace(0.01, 1 - 1e-9, 1000)[1:]])
"""Angles of the unit circle at which a discrete-time loop is evaluated. Chosen: dense at low frequencies."""
POLE_DISTANCES = np.geomspace(0.1, 30.0, 12)
"""Further angles to each side of a pole, in multiples of its distance from the circle. Chosen."""
LARGEST_GAIN = 1e9
"""Gain margin above which there is none: a crossing where the loop's gain is rounding. Chosen."""


def stability_margins(system: Any) -> tuple[float, float]:
    """Gain margin (a factor) and phase margin [deg] of a state space; infinite where there is none."""
    matrices = tuple((part.shape, part.tobytes()) for part in (system.A, system.B, system.C, system.D))
    return _margins(matrices, float(system.dt or 0.0))


@lru_cache(maxsize=4096)
def _margins(matrices: tuple[tuple[tuple[int, ...], bytes], ...], dt: float) -> tuple[float, float]:
    """Gain and phase margin of a state space, which is in discrete time where ``dt`` is not 0.

    Cached, by the bytes of the matrices: cases that differ in their signals only have the same loop.
    """
    parts = [np.frombuffer(data).reshape(shape) for shape, data in matrices]
    with np.errstate(all="ignore"):
        gains, phases = _sampled_crossings(*parts) if dt else _crossings(parts)
        factors = np.maximum(gains, 1.0 / gains)
    gain = factors.min(initial=math.inf) if _stable(parts, dt) else (1.0 / factors).max(initial=0.0)
    gain = math.inf if gain > LARGEST_GAIN else float(gain)
    return gain, min(map(float, phases), key=abs, default=math.inf)


def _crossings(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Factors that bring a loop to the edge of stability, and its phases [deg] where its gain is 1."""
    import control

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a loop without a crossover
        gains, phases, *_ = control.stability_margins(control.ss(*parts), returnall=True)
    return np.asarray(gains), np.asarray(phases)


def _sampled_crossings(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As ``_crossings``, in discrete time: searched along the unit circle, densely near poles.

    python-control solves for roots of polynomials, and misses some where poles are close together.
    """
    from scipy.optimize import brentq

    def loop(angles: Any) -> np.ndarray:
        z = np.exp(1j * np.atleast_1d(angles))[:, None, None]
        return np.asarray(C @ np.linalg.solve(z * np.eye(len(A)) - A, B[None].astype(complex)) + D)[:, 0, 0]

    def roots(of: Callable[[np.ndarray], np.ndarray]) -> list[float]:
        values = of(along)
        places = np.flatnonzero(values[:-1] * values[1:] < 0)
        return [brentq(lambda a: float(of(loop(a))[0]), angles[k], angles[k + 1], xtol=1e-15) for k in places]

    poles = np.linalg.eigvals(A)
    near = (np.abs(1 - np.abs(poles)) + 1e-9)[:, None] * np.concatenate([-POLE_DISTANCES, POLE_DISTANCES])
    angles = np.concatenate([UNIT_CIRCLE_ANGLES, (np.abs(np.angle(poles))[:, None] + near).ravel()])
    angles = np.unique(np.clip(angles, UNIT_CIRCLE_ANGLES[0], UNIT_CIRCLE_ANGLES[-1]))
    along = loop(angles)
    at_axis = np.concatenate([loop(roots(np.imag)), along[[0, -1]]])
    negative = at_axis.real[(at_axis.real < 0) & (np.abs(at_axis.imag) <= 1e-6 * np.abs(at_axis.real))]
    return -1.0 / negative, np.degrees(np.angle(-loop(roots(lambda values: np.abs(values) - 1.0))))


def _stable(parts: Sequence[np.ndarray], dt: float) -> bool:
    """Whether the closed loop is stable."""
    A, B, C, D = parts
    if not A.size or 1.0 + D.item() == 0.0:
        return 1.0 + D.item() > 0.0
    poles = np.linalg.eigvals(A - B @ C / (1.0 + D.item()))
    if dt:
        return bool(np.all(np.abs(poles) <= 1.0 + STABILITY_TOLERANCE))
    return bool(np.all(poles.real <= STABILITY_TOLERANCE * np.abs(poles).max()))
