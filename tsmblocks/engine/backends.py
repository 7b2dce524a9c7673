"""Choice of the back end that runs a plan: machine code by llvmlite, or CasADi's evaluator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

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


def _settings(steps: Steps, mask: int) -> np.ndarray:
    """The steps to take as the numbers that machine code reads."""
    settings = np.empty(2 + len(SETTINGS) + len(steps.hits))
    settings[:2] = steps.h, steps.t0
    counts = (steps.k0, steps.n, int(steps.final), steps.every, steps.skip, mask)
    settings[2:].view(np.int64)[:] = (*counts, *steps.hits)
    return settings


def address(array: np.ndarray) -> int:
    """The address of an array's first number, in half the time of its attribute ``ctypes``."""
    return int(array.__array_interface__["data"][0])


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

    def one_step(
        self, memory: Memory, u: np.ndarray, y: np.ndarray, t0: float, h: float, hits: tuple[int, ...]
    ) -> Callable[[int], None]:
        settings = _settings(Steps(t0, h, 0, 1, False, hits), memory.mask)
        arrays = (settings, memory.x, memory.d, memory.p, u, memory.ring, y, np.empty(self.work), memory.loops)
        table = np.array([address(a) for a in arrays], dtype=np.uintp)
        counts: Any = memoryview(settings[2:].view(np.int64).data)
        run, place = self.function, address(table)

        def step(k: int, _alive: tuple[Any, ...] = (arrays, table)) -> None:
            counts[0] = k
            run(place)

        return step

    def advance(self, memory: Memory, u: np.ndarray, y: np.ndarray, steps: Steps) -> None:
        settings = _settings(steps, memory.mask)
        arrays = (settings, memory.x, memory.d, memory.p, u, memory.ring, y, np.empty(self.work), memory.loops)
        table = np.array([address(a) for a in arrays], dtype=np.uintp)
        self.function(address(table))


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
