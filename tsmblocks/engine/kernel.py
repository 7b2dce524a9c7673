"""One way to call a kernel, whichever back end made it; and the memory of a run that it works on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import attrs
import numpy as np

from tsmblocks.engine.kernel_frame import KernelFrame
from tsmblocks.engine.loops import STATISTICS, region
from tsmblocks.engine.plan import Elements


@attrs.define(eq=False)
class Memory:
    """The arrays of one run (or one group of lanes); a kernel works on them in place.

    ``x`` continuous states, ``d`` memory states and held outputs, ``p`` parameters, each as its ``Layout`` has it;
    ``ring`` the past of each delayed signal, in a ring buffer of ``mask`` + 1 instants (a power of two); ``loops`` the
    last solution of each algebraic loop that the kernel solves, and its statistics.
    """

    x: np.ndarray
    d: np.ndarray
    p: np.ndarray
    ring: np.ndarray
    mask: int
    loops: np.ndarray

    def copy(self) -> Memory:
        """The same state in separate arrays (parameters are shared, they do not change)."""
        return Memory(self.x.copy(), self.d.copy(), self.p, self.ring.copy(), self.mask, self.loops.copy())


class Steps(NamedTuple):
    """Which steps a kernel takes: ``n`` steps of ``h`` s from instant ``k0``; instant k is at ``t0 + k h``.

    A row is logged at each ``every``-th instant, the first after ``skip`` instants; with ``final`` at the last instant
    too. ``hits`` are the steps between samples of each rate group.
    """

    t0: float
    h: float
    k0: int
    n: int
    final: bool
    hits: tuple[int, ...] = ()
    every: int = 1
    skip: int = 0


class Kernel:
    """A compiled plan. ``advance`` takes steps; layouts give the position of each number."""

    def __init__(self, frame: KernelFrame) -> None:
        self.plan = frame.plan
        self.layout_x, self.layout_d, self.layout_p = frame.x, frame.d, frame.p
        self.layout_s, self.layout_y, self.layout_loops = frame.s, frame.y, frame.loops

    def memory(self, x: Elements, d: Elements, p: Elements, s: Elements, capacity: int) -> Memory:
        """Memory before the first step; each element is a number, or one number per lane where it is wide.

        Of the delayed signals ``s`` so many instants are stored, of equal value before the run.
        """
        past = [np.tile(v, capacity) for v in s]
        ring = np.concatenate(past) if past else np.empty(0)
        parts = self.layout_x.spread(x), self.layout_d.spread(d), self.layout_p.spread(p)
        return Memory(*parts, ring, capacity - 1, np.zeros(self.layout_loops.size))

    def memories(
        self, x: np.ndarray, d: np.ndarray, p: np.ndarray, s: np.ndarray, capacities: Sequence[int]
    ) -> list[Memory]:
        """As ``memory``, for many runs at once: all arrays have the shape (runs, elements, lanes)."""
        flat_x, flat_d, flat_p = self.layout_x.spread_all(x), self.layout_d.spread_all(d), self.layout_p.spread_all(p)
        made = []
        for run, capacity in enumerate(capacities):
            past = [np.tile(v if w else v[0], capacity) for v, w in zip(s[run], self.layout_s.wide, strict=True)]
            ring = np.concatenate(past) if past else np.empty(0)
            loops = np.zeros(self.layout_loops.size)
            made.append(Memory(flat_x[run], flat_d[run], flat_p[run], ring, capacity - 1, loops))
        return made

    def loop_statistics(self, memory: Memory) -> list[np.ndarray]:
        """``STATISTICS`` of each loop that the kernel solves, as views of its memory."""
        made, place = [], 0
        for loop in self.plan.loops:
            first = self.layout_loops.offset[place + loop.size]
            made.append(memory.loops[first : first + len(STATISTICS)])
            place += region(loop)
        return made

    def one_step(
        self, memory: Memory, u: np.ndarray, y: np.ndarray, t0: float, h: float, hits: tuple[int, ...]
    ) -> Callable[[int], None]:
        """A function of the step counter that logs a row into ``y`` (1, row) and takes one step of ``h`` s.

        The arrays are those of ``advance`` and stay in use, so that no call allocates any.
        """

        def step(k: int) -> None:
            self.advance(memory, u, y, Steps(t0, h, k, 1, False, hits))

        return step

    def advance(self, memory: Memory, u: np.ndarray, y: np.ndarray, steps: Steps) -> None:
        """Take steps, with ``memory`` changed in place and the logged rows written to ``y``.

        ``u`` (steps, instants of the method, inputs) are the sampled inputs.
        """
        raise NotImplementedError
