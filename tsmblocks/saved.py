"""A state to go on from, and whether it belongs to a run that is to do so."""

from __future__ import annotations

from typing import Any

import attrs

from tsmblocks.engine.kernels import Memory
from tsmblocks.equation_set import Equations
from tsmblocks.errors import RunError


@attrs.frozen(eq=False)
class Saved:
    """A state to go on from: all memory, the step counter and the step. It pickles."""

    memory: Memory = attrs.field(repr=False)
    k: int
    start: float
    step: float
    names: tuple[str, ...] = attrs.field(repr=False, default=())
    """Of states, memory and delays: what tells one diagram's memory from another's."""

    @property
    def t(self) -> float:
        """The time that was reached, in s."""
        return self.start + self.k * self.step


def remembered(eq: Equations) -> tuple[str, ...]:
    """Names of all that a saved state holds."""
    return (*eq.x, *eq.d, *eq.q)


def taken_up(saved: Saved, eq: Equations, own: Memory, h: float) -> Memory:
    """The memory of a saved state, with the numbers of ``own``. Raises RunError where it does not belong here."""
    if saved.step != h:
        raise RunError(f"the saved state belongs to a step of {saved.step:g} s, and this one is {h:g} s.")
    if saved.names != remembered(eq):
        raise RunError(f"the saved state belongs to a diagram other than '{eq.title}'.")
    if saved.memory.mask != own.mask:
        raise RunError(f"the saved state keeps the past of '{eq.title}' for delays of another length. Take one from a "
                       "run with these delays.")  # fmt: skip
    made = saved.memory.copy()
    made.p = own.p
    return made


def begins(start: Any, initial: Any) -> Any:
    """When a run starts: where it goes on from a saved state, then. Raises RunError for another time."""
    if not isinstance(initial, Saved):
        return start
    if start not in (0.0, initial.t):
        raise RunError(f"a run that goes on from a saved state starts when that ended, at {initial.t:g} s. Leave out "
                       "start.")  # fmt: skip
    return initial.t
