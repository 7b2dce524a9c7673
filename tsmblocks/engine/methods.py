"""Fixed-step methods as tables. A new method is one table."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError, near


@attrs.frozen
class Method:
    """A Runge-Kutta method: ``rows[i]`` are the weights of earlier stages in stage i, ``weights`` the final ones.

    In an implicit method a row has the weight of its own stage, too. ``order`` is its convergence order on smooth
    problems.
    """

    name: str
    order: int
    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    source: str

    @cached_property
    def offsets(self) -> tuple[float, ...]:
        """Instant of each stage, as a fraction of the step."""
        ends = map(sum, self.rows)
        return tuple(1.0 if math.isclose(end, 1.0, rel_tol=1e-12) else float(end) for end in ends)

    @cached_property
    def instants(self) -> tuple[float, ...]:
        """The start of the step and the different offsets, in order: instants at which sampled inputs are supplied."""
        return tuple(sorted({0.0, *self.offsets}))

    @property
    def implicit(self) -> bool:
        """Whether a stage depends on its own slope, so that it is an equation to be solved."""
        return len(self.rows[0]) > 0

    def grows(self, z: Any) -> Any:
        """Whether decaying modes with h * pole = z grow under the method: |R(z)| > 1 for its stability function R.

        ``z`` is a number or an array of them.
        """
        if np.all(abs(z) < self._safe_radius):
            return np.zeros(np.shape(z), dtype=bool)
        return self._amplifies(z)

    @cached_property
    def _safe_radius(self) -> float:
        """Size of z up to which no decaying mode grows; R is analytic, so |R| is largest on the border."""
        angles = np.linspace(np.pi / 2, np.pi, 91)
        radii = np.arange(1, 60) * 0.05
        grows = self._amplifies(radii[:, None] * np.exp(1j * angles)).any(axis=1)
        return float(radii[np.argmin(~grows) - 1 if grows.any() else -1]) if not grows[0] else 0.0

    def _amplifies(self, z: Any) -> Any:
        """Whether |R(z)| > 1."""
        stages: list[Any] = []
        for row in self.rows:
            explicit = 1 + z * sum(a * k for a, k in zip(row, stages, strict=False))
            stages.append(explicit / (1 - z * row[len(stages)]) if self.implicit else explicit)
        return abs(1 + z * sum(b * k for b, k in zip(self.weights, stages, strict=True))) > 1 + 1e-9


def _sdirk2() -> Method:
    """L-stable method of order 2 with two equal diagonal weights."""
    g = 1.0 - math.sqrt(0.5)
    rows = ((g,), (1.0 - g, g))
    return Method("sdirk2", 2, rows, rows[-1], "Alexander 1977")


def _sdirk3() -> Method:
    """L-stable method of order 3; its diagonal weight is the middle root of g^3 - 3 g^2 + 3/2 g - 1/6."""
    g = 0.43586652150845899942
    b1, b2 = -1.5 * g * g + 4.0 * g - 0.25, 1.5 * g * g - 5.0 * g + 1.25
    rows = ((g,), ((1.0 - g) / 2.0, g), (b1, b2, g))
    return Method("sdirk3", 3, rows, rows[-1], "Alexander 1977")


def _sdirk4() -> Method:
    """L-stable method of order 4 in five stages."""
    rows = (
        (1 / 4,),
        (1 / 2, 1 / 4),
        (17 / 50, -1 / 25, 1 / 4),
        (371 / 1360, -137 / 2720, 15 / 544, 1 / 4),
        (25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4),
    )
    return Method("sdirk4", 4, rows, rows[-1], "Hairer and Wanner, Solving ODE II (1996), Table IV.6.5")


METHODS = {
    m.name: m
    for m in (
        Method("euler", 1, ((),), (1.0,), "Euler 1768"),
        Method("heun", 2, ((), (1.0,)), (0.5, 0.5), "Heun 1900"),
        Method("rk4", 4, ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), "Kutta 1901"),
        _sdirk2(),
        _sdirk3(),
        _sdirk4(),
    )
}


def method_named(name: str) -> Method:
    """The method of that name. Raises RunError with the near miss."""
    if not isinstance(name, str) or name not in METHODS:
        raise RunError(f"there is no method '{name}'.{near(str(name), METHODS)}")
    return METHODS[name]
