"""Explicit fixed-step methods as tables. A new method is one table."""

from __future__ import annotations

import attrs

from tsmblocks.common.errors import RunError, near


@attrs.frozen
class Method:
    """A Runge-Kutta method: ``rows[i]`` are the weights of earlier stages in stage i, ``weights`` the final ones.

    ``order`` is its convergence order on smooth problems, ``real_limit`` the end of its interval of absolute
    stability: how far h * pole may reach along the negative real axis.
    """

    name: str
    order: int
    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    real_limit: float
    source: str

    @property
    def offsets(self) -> tuple[float, ...]:
        """Instant of each stage, as a fraction of the step."""
        return tuple(sum(row) for row in self.rows)

    @property
    def instants(self) -> tuple[float, ...]:
        """The different offsets, in order: the instants at which sampled inputs are supplied."""
        return tuple(sorted(set(self.offsets)))

    def grows(self, z: complex) -> bool:
        """Whether a decaying mode with h * pole = z grows under the method: |R(z)| > 1 for its stability function R."""
        stages: list[complex] = []
        for row in self.rows:
            stages.append(1 + z * sum(a * k for a, k in zip(row, stages, strict=True)))
        return abs(1 + z * sum(b * k for b, k in zip(self.weights, stages, strict=True))) > 1 + 1e-9


METHODS = {
    m.name: m
    for m in (
        # real_limit: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), IV.2
        Method("euler", 1, ((),), (1.0,), 2.0, "Euler 1768"),
        Method("heun", 2, ((), (1.0,)), (0.5, 0.5), 2.0, "Heun 1900"),
        Method("rk4", 4, ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6), 2.785, "Kutta 1901"),
    )
}


def method_named(name: str) -> Method:
    """The method of that name. Raises RunError with the near miss."""
    if name not in METHODS:
        raise RunError(f"there is no method '{name}'.{near(name, METHODS)}")
    return METHODS[name]
