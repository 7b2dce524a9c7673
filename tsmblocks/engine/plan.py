"""The specification of a kernel: equations, a method, and which numbers differ between lanes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES, Equations
from tsmblocks.engine.implicit import step_of
from tsmblocks.engine.loops import Loop, solved_loops
from tsmblocks.engine.methods import Method

Elements = Sequence[Any] | np.ndarray
"""For each element of a vector a number, or one number per lane where it is wide."""


@attrs.frozen(eq=False)
class Plan:
    """Everything that is needed to generate one kernel.

    ``rhs(t, x, d, u, q, p) -> (dx, y, s)``, ``update(t, x, d, u, q, p, hit) -> (d, x)`` or None,
    ``lag(p) -> tau``. ``wide_x``, ``wide_d``, ``wide_p`` and ``wide_s`` say for each element whether
    it has one value per lane (``lanes`` of them) or one for all. ``every_step``: memory is updated
    at each step, not at hits only. ``y`` picks and orders the outputs of ``rhs`` that are logged.
    ``jumps``: signals jump with time alone (None: read from ``rhs``). ``watched``: a signal that is not
    logged and not finite is a fault too. ``fused``: a product is not rounded before it is added. ``loops``: the loops
    that the functions solve; they then have the last solutions as one more argument, and the new as a result.
    ``advance``: one step of an implicit method (``implicit``).
    """

    rhs: Any
    update: Any
    lag: Any
    method: Method
    y: tuple[int, ...]
    every_step: bool
    lanes: int
    wide_x: tuple[bool, ...]
    wide_d: tuple[bool, ...]
    wide_p: tuple[bool, ...]
    wide_s: tuple[bool, ...]
    fused: bool = True
    jumps: bool | None = None
    watched: bool = True
    loops: tuple[Loop, ...] = ()
    advance: Any = None

    @property
    def groups(self) -> int:
        """Number of rate groups that are sampled."""
        return 0 if self.update is None else int(self.update.size1_in("hit"))

    @property
    def inputs(self) -> int:
        """Number of sampled inputs."""
        return int(self.rhs.size1_in("u"))

    @property
    def wide_q(self) -> tuple[bool, ...]:
        """For each delay its values, an instant, steps per second (one for all lanes) and a count."""
        return tuple(w and k != DELAY_SAMPLES + 1 for w in self.wide_s for k in range(DELAY_NUMBERS))


def plan_for(
    eq: Equations, method: Method, y: tuple[int, ...], *, lanes: int = 1, vary: frozenset[int] = frozenset()
) -> Plan:
    """A plan; with lanes, every state and the parameters in ``vary`` have one value per lane."""
    wide_x, wide_d, wide_s = ((lanes > 1,) * len(names) for names in (eq.x, eq.d, eq.q))
    wide_p = tuple(k in vary for k in range(len(eq.p)))
    loops, advance = tuple(solved_loops(eq.loops)), None
    if method.implicit:
        step = step_of(eq, method)
        loops, advance = (*loops, *step.loops), step.plain
    wide = wide_x, wide_d, wide_p, wide_s
    return Plan(*eq.plain, eq.lag, method, y, eq.every_step, lanes, *wide, loops=loops, advance=advance)


@attrs.frozen
class Layout:
    """Where each element of a vector lies, in doubles; wide elements take ``lanes`` of them."""

    offset: tuple[int, ...]
    wide: tuple[bool, ...]
    lanes: int
    size: int

    @classmethod
    def of(cls, wide: tuple[bool, ...], lanes: int) -> Layout:
        """Lay elements out one after another, wide ones taking a place per lane."""
        *offsets, size = itertools.accumulate((lanes if flag else 1 for flag in wide), initial=0)
        return cls(tuple(offsets), wide, lanes, size)

    def span(self, k: int) -> slice:
        """The doubles of element k."""
        return slice(self.offset[k], self.offset[k] + (self.lanes if self.wide[k] else 1))

    def spread_all(self, values: np.ndarray) -> np.ndarray:
        """The elements of many vectors (runs, elements, lanes) in this layout, shape (runs, size)."""
        wide = np.array(self.wide, dtype=bool)
        stored = wide[:, None] | (np.arange(self.lanes) == 0)
        return np.ascontiguousarray(values[:, stored], dtype=float)

    def spread(self, values: Elements) -> np.ndarray:
        """The elements as an array in this layout."""
        if self.size == len(values):
            return np.array(values, dtype=float).ravel()
        flat = np.empty(self.size)
        for k in range(len(self.wide)):
            flat[self.span(k)] = values[k]
        return flat
