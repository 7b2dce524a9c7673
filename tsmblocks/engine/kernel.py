"""One way to call a kernel, whichever back end made it; and the memory of a run that it works on."""

from __future__ import annotations

import numpy as np

from tsmblocks.engine.kernel_frame import KernelFrame
from tsmblocks.engine.plan import Layout


class Memory:
    """The arrays of one run (or one group of lanes); a kernel works on them in place.

    ``x`` continuous states, ``d`` memory states and held outputs, ``p`` parameters, each as its ``Layout`` has it;
    ``ring`` the past of each delayed signal, in a ring buffer of ``mask`` + 1 instants (a power of two).
    """

    def __init__(self, x: np.ndarray, d: np.ndarray, p: np.ndarray, ring: np.ndarray, mask: int) -> None:
        self.x, self.d, self.p, self.ring, self.mask = x, d, p, ring, mask

    def copy(self) -> Memory:
        """The same state in arrays of its own (parameters are shared, they do not change)."""
        return Memory(self.x.copy(), self.d.copy(), self.p, self.ring.copy(), self.mask)


class Kernel:
    """A compiled plan. ``advance`` takes steps; layouts give the position of each number."""

    layout_x: Layout
    layout_d: Layout
    layout_p: Layout
    layout_s: Layout
    layout_y: Layout

    def __init__(self, frame: KernelFrame) -> None:
        self.plan = frame.plan
        self.layout_x, self.layout_d, self.layout_p = frame.x, frame.d, frame.p
        self.layout_s, self.layout_y = frame.s, frame.y

    def advance(
        self,
        memory: Memory,
        u: np.ndarray,
        *,
        t0: float,
        h: float,
        k0: int,
        n: int,
        final: bool,
        every: int,
        skip: int,
        hits: tuple[int, ...],
        y: np.ndarray,
    ) -> None:
        """Take ``n`` steps of ``h`` s from instant ``k0``; write a row of ``y`` at each ``every``-th instant.

        Instant k is at ``t0 + k h``; ``memory`` and ``y`` are written in place. With ``final`` the last instant is
        logged too; ``skip`` instants come before the first row. ``u`` (steps, instants of the method, inputs) are the
        sampled inputs, ``hits`` the steps between samples of each rate group.
        """
        raise NotImplementedError
