"""Which back end runs a plan: machine code by llvmlite, or CasADi's own evaluator."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine import jit
from tsmblocks.engine.casadi_kernel import CasadiKernel
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.kernel_frame import SETTINGS
from tsmblocks.engine.large_kernel import LargeKernel
from tsmblocks.engine.plan import Plan
from tsmblocks.engine.register_kernel import RegisterKernel

LARGE_OPERATIONS = 1500
"""Operations above which a kernel is cut into functions. Chosen: LLVM's compile time grows faster than a function."""


class CompiledKernel(Kernel):
    """Machine code through llvmlite. Re-entrant; runs without the interpreter's lock."""

    def __init__(self, plan: Plan, quick: bool = False) -> None:
        size = plan.rhs.n_instructions() + (plan.update.n_instructions() if plan.update else 0)
        large = size > LARGE_OPERATIONS
        writer = (LargeKernel if large else RegisterKernel)(plan, jit.host())
        super().__init__(writer)
        text = writer.text()  # not kept: it takes more memory than the code
        self.work = writer.work
        self.function = jit.compile_text(text, promote=not large, quick=quick and not large)

    def advance(self, memory: Memory, u: np.ndarray, y: np.ndarray, steps: Steps) -> None:
        settings = np.empty(2 + len(SETTINGS) + len(steps.hits))
        settings[:2] = steps.h, steps.t0
        counts = (steps.k0, steps.n, int(steps.final), steps.every, steps.skip, memory.mask)
        settings[2:].view(np.int64)[:] = (*counts, *steps.hits)
        arrays = (settings, memory.x, memory.d, memory.p, u, memory.ring, y, np.empty(self.work), memory.loops)
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
