"""The interface between compiler and engine: functions, names and numbers. No block and no diagram."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.tables import few
from tsmblocks.engine.loops import Loop, LoopForms

DELAY_SAMPLES = 4
"""Instants of a delayed signal that are read at a time: those a cubic interpolation needs."""

DELAY_NUMBERS = DELAY_SAMPLES + 3
"""Numbers in ``q`` for one delay: its values at four instants a step apart, oldest first; the newest of these
instants [s]; steps per second; the number of instants up to that one. Values before the start are undefined."""

RHS = (["t", "x", "d", "u", "q", "p"], ["dx", "y", "s"])
UPDATE = ([*RHS[0], "hit"], ["d_next", "x_next"])
SOLVING = {k: ([*names[0], "guess"], [*names[1], "roots"]) for k, names in (("rhs", RHS), ("update", UPDATE))}
START, LAG = (["p"], ["x", "d", "s"]), (["p"], ["tau"])
"""Names of the arguments and results of the functions of ``Equations``, and of ``rhs`` and ``update`` for kernels where
there are loops to be solved: with the last solutions, and the new ones."""


@attrs.frozen
class SampledInput:
    """One sampled input of the equations: an input of the diagram, a block's tape, or a time derivative of either.

    ``block`` and ``tape`` name the tape's owner (``block`` is empty for an input of the diagram);
    ``order`` is 0 for the signal itself, 1 for its time derivative, and so on.
    """

    name: str
    block: str = ""
    tape: str = ""
    order: int = 0
    unit: str = ""


@attrs.frozen(eq=False)
class WatchedLoops:
    """Linear loops whose gain changes within a run: their ``paths``, and equations with one more signal for each.

    The signal is the determinant of the loop's equations, which is zero where the loop is singular.
    """

    paths: tuple[tuple[str, ...], ...]
    rhs: Any
    forms: LoopForms | None


@attrs.frozen(eq=False)
class Equations:
    """A diagram as x' = f(t, x, d, u, q, p) with outputs y, in the form that the engine takes.

    ``x``, ``d``, ``u``, ``p``, ``y`` and ``q`` are the names, in order: ``x`` of continuous states, ``d`` of memory and
    held outputs, ``u`` of sampled inputs, ``p`` of parameters, ``y`` of signals that can be logged, ``q`` of past
    values (``DELAY_NUMBERS`` numbers each). ``aliases`` maps outputs of the diagram to signals in ``y``, ``units``
    signals to labels, ``tapes`` blocks to what supplies their tapes. ``periods`` [s] are those of the rate groups;
    with ``every_step`` something is updated at each step.

    The functions: ``rhs(t, x, d, u, q, p)`` gives ``(dx, y, s)``, ``s`` being the
    signals that are delayed. ``update(t, x, d, u, q, p, hit)`` gives ``(d, x)`` after an instant at which the rate
    groups with ``hit`` = 1 are sampled (None when nothing is updated). ``start(p)`` gives ``(x, d, s)`` before the
    run, ``lag(p)`` the delays in s; ``min_delay_steps`` is the fewest steps that each may take (1, or 0).

    ``loops`` are the algebraic loops. Where some are nonlinear ``rhs`` and ``update`` solve them from ``STARTS``, and
    ``forms`` has the functions that kernels take. ``watched`` are linear loops that may become singular in a run.
    """

    title: str
    x: tuple[str, ...]
    d: tuple[str, ...]
    u: tuple[SampledInput, ...]
    p: tuple[str, ...]
    y: tuple[str, ...]
    q: tuple[str, ...]
    min_delay_steps: tuple[int, ...]
    delayed_inputs: frozenset[str]
    rhs: Any
    update: Any
    start: Any
    lag: Any
    periods: tuple[float, ...]
    aliases: dict[str, str]
    units: dict[str, str]
    every_step: bool
    tapes: dict[str, Callable[[float, float], dict[str, Any]]]
    reads: dict[str, tuple[str, dict[str, str]]]
    """For messages: block name -> (class name, {input port: signal it reads})."""
    sampled: dict[str, float]
    """For messages: sampled block name -> its period [s]."""
    loops: tuple[Loop, ...] = ()
    forms: LoopForms | None = None
    watched: WatchedLoops | None = None

    @property
    def plain(self) -> tuple[Any, Any]:
        """``rhs`` and ``update`` for a kernel."""
        return self.forms.plain if self.forms else (self.rhs, self.update)

    @property
    def exact(self) -> tuple[Any, Any]:
        """``rhs`` and ``update`` for a kernel, with the derivatives of solved loops."""
        return self.forms.exact if self.forms else (self.rhs, self.update)

    def __repr__(self) -> str:
        return f"Equations({self.title!r}, {len(self.x)} states, {len(self.p)} parameters, outputs {few(self.aliases)})"

    @property
    def orders(self) -> dict[str, int]:
        """The highest time derivative of each sampled input that enters the equations."""
        made: dict[str, int] = {}
        for feed in self.u:
            name = feed.name.removeprefix("d/dt " * feed.order)
            made[name] = max(made.get(name, 0), feed.order)
        return made

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the diagram's outputs."""
        return tuple(self.aliases)


def function_values(function: Any, *given: Any) -> list[np.ndarray]:
    """Dense outputs of a CasADi function, each flat by columns; by its buffers, as a call takes five times as long."""
    arrays = [np.ascontiguousarray(one, dtype=float) for one in given]
    buffer, evaluate = function.buffer()
    for k, one in enumerate(arrays):
        buffer.set_arg(k, one.data)
    made = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
    for k, values in enumerate(made):
        buffer.set_res(k, values.data)
    evaluate()
    return made
