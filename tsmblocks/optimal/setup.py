"""Arguments of optimal control, read and checked before the search."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_integer, as_number
from tsmblocks.common.errors import DataError, ParameterError, RunError, in_words, near
from tsmblocks.engine.equations import Equations
from tsmblocks.fitting.constraints import constraints
from tsmblocks.metrics.expressions import expression
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.transcription import KnownSignals, Task, Window
from tsmblocks.simulation.arguments import end_time, input_ends, step_count
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.stability import poles

STEP_TIMES_POLE = 2.0
"""Step times fastest pole, at most, of one Runge-Kutta step. Chosen: within the stability of RK4 (2.785)."""
LEAST_PIECES = 2
"""Runge-Kutta steps of an interval, at least. Chosen: the error counts between samples too."""
GOALS = ("peak", "rms")
"""What ``smallest`` may be."""

ProgressCallback = Callable[[str, int, int], Any]
"""Called with a stage, how much of it is done, and of how much."""


def task_of(
    diagram: Diagram,
    commands: Mapping[str, Any],
    error: str,
    limits: Sequence[str] | str,
    rates: Mapping[str, Any] | None,
    references: Sequence[str],
) -> Task:
    """The problem that the arguments describe. Raises ParameterError and RunError."""
    eq = equations(diagram)
    inputs = [f.name for f in eq.u if not f.block and not f.order]
    low_high = _ranges("commands", commands, inputs, eq.title)
    if not low_high:
        raise RunError(
            "name at least one input of the diagram as a command, with its limits: commands={'u': (-24, 24)}."
        )
    _refuse_memory(eq)
    rate_limits = _ranges("rates", {} if rates is None else rates, tuple(low_high), eq.title)
    names = {**{name: name for name in eq.y}, **eq.aliases}
    taken = next((name for name in references if name in names), "")
    if taken:
        raise ParameterError(f"references give '{taken}', which is a signal of '{eq.title}' already.")
    known = [*names, *references]
    needed = expression(error, known, what="error", kind="signal")
    held = constraints(limits, known, what="limit", kind="signal") if limits else ()
    equal = next((one.text for one in held if one.equality), "")
    if equal:
        raise ParameterError(
            f"limit '{equal}': an equality at every instant determines the commands. Make it the "
            "error, or write two limits."
        )
    used = {name for one in (needed, *(h.expression for h in held)) for name in one.names}
    task = Task(
        eq,
        parameter_vector(eq, diagram),
        tuple(low_high),
        np.array(list(low_high.values())).T,
        np.array([rate_limits.get(name, (-np.inf, np.inf)) for name in low_high]).T,
        needed,
        held,
        {k: v for k, v in names.items() if k in used},
        tuple(references),
    )
    _refuse_zero_gradients(task)
    return task


def _refuse_memory(eq: Equations) -> None:
    """Raise RunError for memory that jumps, and for delays."""
    if eq.d or eq.periods:
        owner = next(iter(eq.sampled), eq.d[0] if eq.d else "")
        raise RunError(
            f"'{eq.title}' has a part that changes in jumps ({owner}); optimal control needs states that change "
            "smoothly. Replace it by a continuous block."
        )
    if eq.q:
        raise RunError(
            f"'{eq.title}' delays {eq.q[0]}, which optimal control does not support. Remove the delay, and give the "
            "references earlier by the same time."
        )


def _refuse_zero_gradients(task: Task) -> None:
    """Raise RunError for rounding and for second derivatives of commands, which a gradient search cannot use."""
    if task.smoothed.rounds:
        raise RunError(
            f"'{task.eq.title}' rounds a signal to steps, and a gradient is zero between them. "
            "Remove the block that rounds from the model."
        )
    bent = [task.commands[command] for _, command, order in task.command_inputs if order > 1]
    if bent:
        raise RunError(
            f"'{task.eq.title}' needs the second derivative of '{bent[0]}', and a command that is linear "
            "between its samples has none. Put a lag or an integrator behind it."
        )


def _ranges(what: str, given: Any, known: Sequence[str], title: str) -> dict[str, tuple[float, float]]:
    """Limits by name; None or an infinity means no limit."""
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what} must map inputs to (low, high), got {in_words(given)}.")
    made = {}
    for name, pair in given.items():
        if name not in known:
            kind = "input" if what == "commands" else "command"
            raise ParameterError(f"{what}: '{title}' has no {kind} '{name}'.{near(str(name), known)}")
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise ParameterError(
                f"{what} of '{name}' must be a pair (low, high), None for no limit, got {in_words(pair)}."
            )
        low, high = (
            end
            if one is None or (isinstance(one, float) and one == end)
            else as_number(f"{what} of '{name}'", one, ParameterError)
            for one, end in zip(pair, (-np.inf, np.inf), strict=True)
        )
        if not low < high:
            raise ParameterError(
                f"{what} of '{name}': the lower limit must be below the upper one, got ({low:g}, {high:g})."
            )
        made[str(name)] = (low, high)
    return made


def goal_named(smallest: Any) -> str:
    """The objective, "peak" or "rms". Raises ParameterError."""
    if smallest not in GOALS:
        raise ParameterError(f"smallest is 'peak' or 'rms', got {in_words(smallest)}.{near(str(smallest), GOALS)}")
    return str(smallest)


def known_signals(title: str, commands: Any, inputs: Any, references: Any, hold: str) -> KnownSignals:
    """The known signals. Raises DataError for what is no mapping, and for a command among the inputs."""
    for what, given in (("inputs", inputs), ("references", references)):
        if given is not None and not (isinstance(given, Mapping) and all(isinstance(k, str) for k in given)):
            raise DataError(
                f"{what} must map names to signals, such as {{'x_ref': (t, values)}}, got {in_words(given)}."
            )
    named = commands if isinstance(commands, (Mapping, tuple)) else ()  # anything else is refused where it is read
    both = [name for name in inputs or () if name in named]
    if both:
        raise DataError(f"'{both[0]}' is a command of '{title}'; it cannot be given as an input too.")
    return KnownSignals(dict(inputs or {}), dict(references or {}), hold)


def end_of_signals(given: KnownSignals, start: float, step: float) -> float:
    """The end of the known signals [s], for a problem without ``stop``. Raises RunError."""
    signals = {**given.references, **given.inputs}
    if not input_ends(signals, start, step):
        raise RunError("the end is not known: give stop=… [s], or references as (times, values).")
    return end_time(signals, start, step)


def interval_count(begin: float, end: float, h: float) -> int:
    """Number of intervals of ``h`` s from ``begin`` to ``end`` [s]. Raises RunError where it is no integer."""
    count = step_count(begin, end, h)
    if abs(begin + count * h - end) > 1e-6 * h:
        raise RunError(f"stop={end:g} s is no whole number of steps of {h:g} s after start={begin:g} s.")
    return count


def pieces_per_interval(task: Task, given: int | None, h: float) -> int:
    """Runge-Kutta steps of an interval: by default as many as the fastest initial pole needs. Raises RunError."""
    if given is not None:
        return as_integer("pieces", given, 1)
    fastest = max((abs(p) for p in poles(task.eq, task.p)), default=0.0)
    return max(LEAST_PIECES, math.ceil(h * fastest / STEP_TIMES_POLE))


def _guessed_commands(task: Task, guess: Any, t: np.ndarray) -> np.ndarray:
    """Initial commands (c, N + 1) from a guess. Raises ParameterError."""
    if not isinstance(guess, Mapping):
        raise ParameterError(f"guess must map commands to samples, got {in_words(guess)}.")
    commands = np.zeros((len(task.commands), len(t)))
    for name, given in guess.items():
        if name not in task.commands:
            raise ParameterError(f"guess: there is no command '{name}'.{near(str(name), task.commands)}")
        pair = given if isinstance(given, tuple) and len(given) == 2 else (t, given)
        try:
            times, values = (np.asarray(part, dtype=float) for part in pair)
        except (TypeError, ValueError):
            times = values = np.full(1, np.nan)
        right = values.ndim == 1 and values.shape == times.shape and len(values) > 0
        if not right or not np.isfinite([times, values]).all() or np.any(np.diff(times) <= 0):
            raise ParameterError(
                f"guess of '{name}' must be {len(t)} finite numbers, one for each sample, or a pair "
                "(times, values) with times that increase."
            )
        commands[task.commands.index(name)] = np.interp(t, times, values)
    return task.within(commands)


def initial_commands(window: Window, guess: Any, t: np.ndarray) -> list[np.ndarray]:
    """Initial commands of the searches: the guess, or else zero commands and a copy of the first reference."""
    task, table = window.interval.task, window.table
    if guess is not None:
        return [_guessed_commands(task, guess, t)]
    still = task.within(np.zeros((len(task.commands), len(t))))
    if len(task.commands) > 1 or not task.references:
        return [still]
    first = table[:: window.interval.pieces, 0, len(task.eq.u)]
    copied = np.append(first, table[-1, -1, len(task.eq.u)])[None, :]
    return [still, task.within(copied)]
