"""Which back end runs a plan: machine code by llvmlite, or CasADi's own evaluator."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine import jit
from tsmblocks.engine.casadi_kernel import CasadiKernel
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.large_kernel import LargeKernel
from tsmblocks.engine.plan import Plan
from tsmblocks.engine.register_kernel import RegisterKernel

LARGE_OPERATIONS = 1500
"""Operations above which a kernel is cut into functions. Chosen: LLVM's compile time grows faster than a function."""


class CompiledKernel(Kernel):
    """Machine code through llvmlite. Re-entrant; runs without the interpreter's lock."""

    def __init__(self, plan: Plan, quick: bool = False) -> None:
        host = jit.host()
        size = plan.rhs.n_instructions() + (plan.update.n_instructions() if plan.update else 0)
        if size > LARGE_OPERATIONS:
            large = LargeKernel(plan, host)
            super().__init__(large.f)
            self.text, self.work = large.text(), large.work
            self.function = jit.compile_text(self.text, promote=False)
        else:
            kernel = RegisterKernel(plan, host)
            super().__init__(kernel.f)
            self.text, self.work = kernel.text(), 0
            self.function = jit.compile_text(self.text, promote=True, quick=quick)

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
        settings = np.empty(2 + 6 + len(hits))
        settings[:2] = h, t0
        settings[2:].view(np.int64)[:] = (k0, n, int(final), every, skip, memory.mask, *hits)
        work = np.empty(self.work)
        arrays = (settings, memory.x, memory.d, memory.p, u, memory.ring, y, work)
        table = np.array([a.ctypes.data for a in arrays], dtype=np.uintp)
        self.function(table.ctypes.data)


def kernel_for(plan: Plan, backend: str = "", quick: bool = False) -> Kernel:
    """A kernel for the plan: machine code where llvmlite is installed, else CasADi's own evaluator.

    ``backend`` forces ``"llvm"`` or ``"casadi"``; ``quick`` is for kernels that run a few times only. Raises RunError
    when a forced one is not available.
    """
    if backend not in ("", "llvm", "casadi"):
        raise RunError(f"there is no back end '{backend}'. Known here: casadi, llvm.")
    if backend == "llvm" and not jit.available():
        raise RunError("the back end 'llvm' needs llvmlite, which is not installed here: pip install llvmlite.")
    if backend == "casadi" or not jit.available():
        return CasadiKernel(plan)
    return CompiledKernel(plan, quick)
