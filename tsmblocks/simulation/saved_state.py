"""Saved states, and whether a run can continue from one."""

from __future__ import annotations

import math
from typing import Any

import attrs

from tsmblocks.common.arguments import as_number, as_positive
from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.kernel import Memory

STEP_TOLERANCE = 1e-9
"""Relative difference of two steps, and difference of two times in steps, that is rounding. Chosen."""


@attrs.frozen(eq=False)
class SavedState:
    """A state to continue from: all memory, the step counter and the step. It can be pickled."""

    memory: Memory = attrs.field(repr=False)
    k: int
    start: float
    step: float
    names: tuple[str, ...] = attrs.field(repr=False, default=())
    """Names of states, memory and delays, by which the diagram is recognised."""
    diverged_at: float | None = None
    """Time [s] at which the run diverged, if it did: no run can continue from such a state."""

    @property
    def t(self) -> float:
        """The time that was reached, in s."""
        return self.start + self.k * self.step


def memory_names(eq: Equations) -> tuple[str, ...]:
    """Names of all states, memory and delays."""
    return (*eq.x, *eq.d, *eq.q)


def restored_memory(saved: SavedState, eq: Equations, own: Memory, h: float) -> Memory:
    """The memory of a saved state, with the parameters of ``own``. Raises RunError for another diagram or step."""
    if saved.diverged_at is not None:
        raise RunError(
            f"the run of '{eq.title}' diverged at t = {saved.diverged_at:g} s, so there is no state to "
            "continue from. Take one from a run that ended before."
        )
    if not _same(saved.step, h):
        raise RunError(f"the saved state belongs to a step of {saved.step:g} s, and this one is {h:g} s.")
    if saved.names != memory_names(eq):
        raise RunError(f"the saved state belongs to a diagram other than '{eq.title}'.")
    if saved.memory.mask != own.mask:
        raise RunError(
            f"the saved state keeps the past of '{eq.title}' for delays of another length. Take one from a "
            "run with these delays."
        )
    loops = getattr(saved.memory, "loops", own.loops)  # absent in states saved before there were loops
    loops = loops if loops.shape == own.loops.shape else own.loops  # another method has others
    made = attrs.evolve(saved.memory, loops=loops).copy()
    made.p = own.p
    return made


def start_and_step(start: Any, step: Any, initial: Any) -> tuple[Any, Any]:
    """Start and step [s] of a run: those of the saved state, if any. Raises RunError for another start."""
    if not isinstance(initial, SavedState):
        return start, step
    if start != 0.0 and not math.isclose(
        as_number("start", start), initial.t, rel_tol=1e-12, abs_tol=STEP_TOLERANCE * initial.step
    ):
        raise RunError(f"a run that continues from a saved state starts at its time, {initial.t:g} s. Leave out start.")
    return initial.t, initial.step if _same(initial.step, as_positive("step", step)) else step


def _same(step: float, other: float) -> bool:
    """Whether two steps [s] differ by rounding at most."""
    return math.isclose(step, other, rel_tol=STEP_TOLERANCE)
