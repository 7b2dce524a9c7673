"""Where a run diverged: the block, the time and its inputs."""

from __future__ import annotations

import math
from collections.abc import Iterable

import attrs
import numpy as np

from tsmblocks.common.errors import NotFinite
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.loops import STARTS, STATISTICS, Loop
from tsmblocks.engine.session import Session, single_kernel

ORDINARY_STATE = 1e20
"""States below this size did not grow without bound before they became non-finite. Chosen."""


def divergence_error(session: Session, backend: str, steps: int, fast: bool = False) -> NotFinite:
    """The error of a run that diverges within some steps, which are repeated with every signal logged.

    ``fast`` says that a pole which decays is too fast for the step, as it is not for an implicit method.
    """
    eq, first = session.eq, session.k
    kernel = single_kernel(eq, session.kernel.plan.method, tuple(range(len(eq.y))), backend)
    again = attrs.evolve(session, kernel=kernel, memory=session.memory.copy(), every=1)
    for counts in kernel.loop_statistics(again.memory):
        counts[:] = 0.0
    y = again.rows_for(steps, True)
    again.advance(steps, True, y)
    bad = np.flatnonzero(~np.isfinite(y).all(axis=1))
    row = int(bad[0]) if len(bad) else len(y) - 1
    time = session.start + (first + row) * session.h
    values = dict(zip(eq.y, y[row], strict=True))
    block = _first_non_finite(eq, values)
    before = dict(zip(eq.y, y[row - 1], strict=True)) if row else {}
    held = before or dict(zip((*eq.x, *eq.d), (*session.memory.x, *session.memory.d), strict=True))
    loop = _unsolved_loop(again, values, before)
    if loop is not None and (not block or _of(block, loop.path)):
        block, text = loop.path[0].rpartition(".")[0], _loop_message(loop, before, time)
        text = _step_message(session, loop, before, time) if loop.function == "advance" else text
    elif block:
        text = _output_message(eq, values, block, time)
    elif states := [k for k in (*eq.x, *eq.d) if not math.isfinite(values.get(k, 0.0))]:
        block = _first_diverging(eq, states, held)
        text = _state_message(eq, values, held, _of(block, states), block, time, fast)
    else:  # signals of an algebraic loop that overflow together
        block = next((k for k, v in values.items() if not math.isfinite(v)), eq.y[0]).rpartition(".")[0]
        text = _output_message(eq, values, block, time)
    error = NotFinite(text)
    error.block, error.time = block, time
    return error


def _unsolved_loop(session: Session, values: dict[str, float], before: dict[str, float]) -> Loop | None:
    """The first loop without a solution: at this instant, or at a stage of the step that leads to it."""
    eq, solved = session.eq, session.kernel.plan.loops
    counts = session.kernel.loop_statistics(session.memory)
    missed = [loop for loop, count in zip(solved, counts, strict=True) if count[STATISTICS.index("failed")] > 0]
    if all(math.isfinite(values.get(k, 0.0)) for k in eq.x):
        suspects = [loop for loop in eq.loops if loop.linear or loop in missed]
        lost = [loop for loop in suspects if any(not math.isfinite(values.get(k, 0.0)) for k in loop.path)]
    else:
        lost = missed
        if any(abs(before.get(k, 0.0)) > ORDINARY_STATE for k in eq.x):
            lost = []  # what diverged is the state
    return lost[0] if lost else None


def _loop_message(loop: Loop, before: dict[str, float], time: float) -> str:
    signals = list(dict.fromkeys(loop.path))
    last = f" One step before: {_pairs((k, before[k]) for k in signals[:4] if k in before)}." if before else ""
    if loop.linear:
        return (
            f"the algebraic loop {loop} is singular at t = {time:g} s: its loop gain is 1, so it has no solution, or "
            f"infinitely many.{last} Change a gain, or break it with a block that has a state (a lag, an integrator)."
        )
    return (
        f"the algebraic loop {loop} has no solution at t = {time:g} s that Newton's method finds, from the last "
        f"one and from {STARTS} other starts.{last} A discontinuity (a sign, a comparison) may leave a loop without a "
        "solution; break it with a block that has a state (a lag, an integrator)."
    )


def _step_message(session: Session, loop: Loop, before: dict[str, float], time: float) -> str:
    last = f" One step before: {_pairs((k, before[k]) for k in session.eq.x[:4] if k in before)}." if before else ""
    return (
        f"the equations of {session.kernel.plan.method.name} for the step to t = {time:g} s have no solution that "
        f"Newton's method finds, first in {loop.path[0]}.{last} A discontinuity (a sign, a comparison) may leave them "
        "without a solution: where a state passes a discontinuity, use locate=True; where a state rests at one, "
        "replace it by a continuous function. A state that grows without bound needs a shorter step."
    )


def _of(block: str, names: Iterable[str]) -> list[str]:
    """Those names that belong to a block."""
    return [name for name in names if name.rpartition(".")[0] == block]


def _first_non_finite(eq: Equations, values: dict[str, float]) -> str:
    """The first block with a non-finite output and finite inputs and states."""
    for name, value in values.items():
        block = name.rpartition(".")[0]
        if math.isfinite(value) or block not in eq.reads or name in eq.x:
            continue
        given = [*eq.reads[block][1].values(), *_of(block, (*eq.x, *eq.d))]
        if all(math.isfinite(values.get(s, 0.0)) for s in given):
            return block
    return ""


def _first_diverging(eq: Equations, states: list[str], before: dict[str, float]) -> str:
    """Of the blocks with a non-finite state one that no other feeds; of those that feed one another the largest."""
    blocks = dict.fromkeys(k.rpartition(".")[0] for k in states)
    above = {block: _upstream(eq, block) for block in blocks}
    first = [b for b in blocks if all(b in above[a] for a in blocks if a in above[b])]
    return max(first, key=lambda b: max(abs(before.get(k, 0.0)) for k in _of(b, states)))


def _upstream(eq: Equations, block: str) -> set[str]:
    """The blocks whose signals reach a block."""
    found: set[str] = set()
    stack = [block]
    while stack:
        _, reads = eq.reads.get(stack.pop(), ("", {}))
        fresh = {signal.rpartition(".")[0] for signal in reads.values()} - found
        found |= fresh
        stack += fresh
    return found


def _pairs(pairs: Iterable[tuple[str, float]]) -> str:
    return ", ".join(f"{k} = {v:.6g}" for k, v in pairs)


def _output_message(eq: Equations, values: dict[str, float], block: str, time: float) -> str:
    kind, reads = eq.reads[block]
    outputs = [(k, values[k]) for k in _of(block, values) if not math.isfinite(values[k])]
    inputs = [(f"{port} (from {signal})", values.get(signal, math.nan)) for port, signal in reads.items()]
    states = [(k.rpartition(".")[2], values[k]) for k in _of(block, (*eq.x, *eq.d)) if k in values]
    text = f"{_pairs(outputs)} at t = {time:g} s, first in {block} ({kind})."
    text += f" Its inputs: {_pairs(inputs)}." if inputs else ""
    return text + (f" Its states: {_pairs(states)}." if states else "")


def _state_message(
    eq: Equations,
    values: dict[str, float],
    before: dict[str, float],
    states: list[str],
    block: str,
    time: float,
    fast: bool,
) -> str:
    kind = eq.reads[block][0] if block in eq.reads else "?"
    now = [(k, values[k]) for k in states[:4]]
    text = f"{_pairs(now)} at t = {time:g} s: a state of {block} ({kind}) diverges."
    if before:
        text += f" One step before: {_pairs((k, before[k]) for k in states[:4])}."
    if before and all(abs(before[k]) < ORDINARY_STATE for k in states):
        return text + " Within the step its equations are undefined (a root, a logarithm, a division)."
    implicit = " or an implicit method (method='sdirk2')" if fast else ""
    return f"{text} The loop may be unstable, or the step too long for it; try a smaller step{implicit}."
