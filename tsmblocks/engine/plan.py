"""What a kernel is generated from: equations, a method, and which numbers differ between lanes."""

from __future__ import annotations

from typing import Any

import attrs

from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES
from tsmblocks.engine.methods import Method


@attrs.frozen(eq=False)
class Plan:
    """Everything that is needed to generate one kernel.

    ``rhs(t, x, d, u, q, p) -> (dx, y, s)``, ``update(t, x, d, u, q, p, hit) -> (d, x)`` or None,
    ``lag(p) -> tau``. ``wide_x``, ``wide_d``, ``wide_p`` and ``wide_s`` say for each element whether
    it has one value per lane (``lanes`` of them) or one for all. ``every_step``: memory is updated
    at each step, not at hits only. ``y`` picks and orders the outputs of ``rhs`` that are logged.
    ``jumps``: signals jump with time alone (None: read from ``rhs``). ``watched``: a signal that is not
    logged and not finite is a fault too.
    """

    rhs: Any
    update: Any
    lag: Any
    method: Method
    y: tuple[int, ...]
    groups: int
    every_step: bool
    lanes: int
    wide_x: tuple[bool, ...]
    wide_d: tuple[bool, ...]
    wide_p: tuple[bool, ...]
    wide_s: tuple[bool, ...]
    inputs: int
    fused: bool = True
    jumps: bool | None = None
    watched: bool = True

    @property
    def wide_q(self) -> tuple[bool, ...]:
        """For each delay its values, an instant, steps per second (one for all lanes) and a count."""
        return tuple(w and k != DELAY_SAMPLES + 1 for w in self.wide_s for k in range(DELAY_NUMBERS))


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
        offsets, place = [], 0
        for flag in wide:
            offsets.append(place)
            place += lanes if flag else 1
        return cls(tuple(offsets), wide, lanes, place)

    def span(self, k: int) -> slice:
        """The doubles of element k."""
        return slice(self.offset[k], self.offset[k] + (self.lanes if self.wide[k] else 1))
