"""One way to call a kernel, whichever back end made it."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.engine import jit
from tsmblocks.engine.kernel import Frame
from tsmblocks.engine.plan import Layout, Plan
from tsmblocks.engine.registers import RegisterKernel
from tsmblocks.errors import RunError

LARGE_OPERATIONS = 1500
"""Above this many operations a kernel is cut into functions."""


class Memory:
    """The arrays of one run (or one group of lanes); a kernel works on them in place."""

    def __init__(self, x: np.ndarray, d: np.ndarray, p: np.ndarray, ring: np.ndarray, mask: int) -> None:
        self.x, self.d, self.p, self.ring, self.mask = x, d, p, ring, mask

    def copy(self) -> Memory:
        """The same state in arrays of its own (parameters are shared, they do not change)."""
        return Memory(self.x.copy(), self.d.copy(), self.p, self.ring.copy(), self.mask)


class Kernel:
    """A compiled plan. ``advance`` takes steps; layouts say where each number lies."""

    layout_x: Layout
    layout_d: Layout
    layout_p: Layout
    layout_s: Layout
    layout_y: Layout

    def __init__(self, frame: Frame) -> None:
        self.plan = frame.plan
        self.layout_x, self.layout_d, self.layout_p = frame.x, frame.d, frame.p
        self.layout_s, self.layout_y = frame.s, frame.y

    def advance(
        self, memory: Memory, u: np.ndarray, *, t0: float, h: float, k0: int, n: int, final: bool, every: int,
        skip: int, hits: tuple[int, ...], y: np.ndarray,
    ) -> None:  # fmt: skip
        """Take ``n`` steps from instant ``k0``; write a row of ``y`` at each ``every``-th instant."""
        raise NotImplementedError


class CompiledKernel(Kernel):
    """Machine code through llvmlite. Re-entrant; runs without the interpreter's lock."""

    def __init__(self, plan: Plan, quick: bool = False) -> None:
        host = jit.host()
        size = plan.rhs.n_instructions() + (plan.update.n_instructions() if plan.update else 0)
        if size > LARGE_OPERATIONS:
            from tsmblocks.engine.chunks import ChunkKernel

            chunked = ChunkKernel(plan, host)
            super().__init__(chunked.f)
            self.text, self.work = chunked.text(), chunked.work
            self.function = jit.compile_text(self.text, promote=False)
        else:
            kernel = RegisterKernel(plan, host)
            super().__init__(kernel.f)
            self.text, self.work = kernel.text(), 0
            self.function = jit.compile_text(self.text, promote=True, quick=quick)

    def advance(
        self, memory: Memory, u: np.ndarray, *, t0: float, h: float, k0: int, n: int, final: bool, every: int,
        skip: int, hits: tuple[int, ...], y: np.ndarray,
    ) -> None:  # fmt: skip
        settings = np.empty(2 + 6 + len(hits))
        settings[:2] = h, t0
        settings[2:].view(np.int64)[:] = (k0, n, int(final), every, skip, memory.mask, *hits)
        work = np.empty(self.work)
        arrays = (settings, memory.x, memory.d, memory.p, u, memory.ring, y, work)
        table = np.array([a.ctypes.data for a in arrays], dtype=np.uintp)
        self.function(table.ctypes.data)


_KNOWN: dict[tuple[Any, ...], Kernel] = {}


def kernel_for(plan: Plan, backend: str = "", quick: bool = False) -> Kernel:
    """A kernel for the plan: compiled where llvmlite is there, else CasADi's own evaluator.

    ``backend`` forces ``"llvm"`` or ``"casadi"``; ``quick`` is for kernels that run a few times only. Raises RunError
    when a forced one cannot be had.
    """
    if backend not in ("", "llvm", "casadi"):
        raise RunError(f"there is no back end '{backend}'. Known here: casadi, llvm.")
    if backend == "llvm" and not jit.available():
        raise RunError("the back end 'llvm' needs llvmlite, which is not installed here: pip install llvmlite.")
    if backend == "casadi" or not jit.available():
        from tsmblocks.engine.interpret import InterpretedKernel

        return InterpretedKernel(plan)
    return CompiledKernel(plan, quick)
