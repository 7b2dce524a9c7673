"""A state to go on from, and whether it belongs to a run that is to do so."""

from __future__ import annotations

import math
from typing import Any

import attrs

from tsmblocks.common.arguments import as_number, as_positive
from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.kernel import Memory

STEP_TOLERANCE = 1e-9
"""Difference of two steps, as a share of them, that is rounding; of two times, as a share of a step."""


@attrs.frozen(eq=False)
class SavedState:
    """A state to go on from: all memory, the step counter and the step. It pickles."""

    memory: Memory = attrs.field(repr=False)
    k: int
    start: float
    step: float
    names: tuple[str, ...] = attrs.field(repr=False, default=())
    """Of states, memory and delays: what tells one diagram's memory from another's."""
    lost: float | None = None
    """When the run stopped being finite, in s, if it did: no run goes on from such a state."""

    @property
    def t(self) -> float:
        """The time that was reached, in s."""
        return self.start + self.k * self.step


def memory_names(eq: Equations) -> tuple[str, ...]:
    """Names of all that a saved state holds."""
    return (*eq.x, *eq.d, *eq.q)


def restored_memory(saved: SavedState, eq: Equations, own: Memory, h: float) -> Memory:
    """The memory of a saved state, with the numbers of ``own``. Raises RunError where it does not belong here."""
    if saved.lost is not None:
        raise RunError(
            f"the run of '{eq.title}' stopped being finite at t = {saved.lost:g} s, so there is no state to "
            "go on from. Take one from a run that ended before."
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
    made = saved.memory.copy()
    made.p = own.p
    return made


def start_and_step(start: Any, step: Any, initial: Any) -> tuple[Any, Any]:
    """When a run starts and its step: those of a saved state that it goes on from. Raises RunError for another time."""
    if not isinstance(initial, SavedState):
        return start, step
    if start != 0.0 and not math.isclose(
        as_number("start", start), initial.t, rel_tol=1e-12, abs_tol=STEP_TOLERANCE * initial.step
    ):
        raise RunError(
            f"a run that goes on from a saved state starts when that ended, at {initial.t:g} s. Leave out start."
        )
    return initial.t, initial.step if _same(initial.step, as_positive("step", step)) else step


def _same(step: float, other: float) -> bool:
    """Whether two steps [s] differ by rounding at most."""
    return math.isclose(step, other, rel_tol=STEP_TOLERANCE)
