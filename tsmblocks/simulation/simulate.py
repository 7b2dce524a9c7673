"""Running a diagram: the place where diagrams, compile and engine meet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_callback
from tsmblocks.common.errors import NotFinite
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.events import locating
from tsmblocks.engine.methods import Method
from tsmblocks.engine.session import Session, Stopped, single_kernel, start_memory, steps_per_period
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.divergence import explain_divergence
from tsmblocks.simulation.logged_signals import logged_signals
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.run_options import RunOptions
from tsmblocks.simulation.saved_state import SavedState, memory_names, restored_memory, start_and_step
from tsmblocks.simulation.stability import RunStart, warn_of_fast_poles


def simulate(
    diagram: Diagram,
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    parameters: Mapping[str, Any] | None = None,
    initial: Mapping[str, float] | SavedState | None = None,
    log: str | Iterable[str] = "all",
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    locate: bool = False,
    backend: str = "",
) -> Run:
    """Run a diagram at a fixed step and return its signals.

    ``stop`` and ``start`` in s (by default to the end of the shortest recorded input, else 20 s); the last
    instant is the last whole step up to ``stop``. ``step`` in s; ``method`` one of euler, heun, rk4.
    ``inputs`` maps each input of the diagram to a number, values on the steps, a pair (times, values), Samples,
    a Record (of which its signal of that name is taken, in the input's unit), a column of pandas (its index
    being time in s), or a function of time that takes an array; ``hold`` says what values are between the
    samples (zero, linear, cubic). ``parameters`` overrides numbers by name, ``initial`` start values of states;
    ``initial=run.state`` goes on where a run ended.
    ``log`` is ``"all"``, ``"outputs"`` or patterns such as ``"tsm.*"``; every ``every``-th instant is kept.
    ``progress`` is called with the fraction done, on long runs. ``backend`` forces ``"llvm"`` or ``"casadi"``.

    ``locate`` finds the instants at which limits, signs and comparisons switch and ends a part of a step
    at each, so that the method keeps its order across kinks and jumps; ``run.events`` lists them. It
    pays where errors below about 1e-5 matter. It does not go with transport delays; rounding is not
    located; where a switch would turn over without end (a sliding mode), steps are taken as without
    it, with a SlidingWarning.

    Raises NotFinite when a signal becomes NaN or infinite, RunError, DataError, ParameterError and
    what compile raises. After Ctrl-C the run so far is returned with ``complete`` False.
    """
    diagram = as_diagram(diagram, parameters)
    begin, h = start_and_step(start, step, initial)
    options = RunOptions(stop, h, begin, method, inputs, hold, every, backend)
    times = options.times
    as_callback(progress, "the fraction done")
    eq = equations(diagram)
    chosen, names = logged_signals(eq, log, times)
    rule, p = options.rule, parameter_vector(eq, diagram)
    kernel, h = single_kernel(eq, rule, chosen, backend), times.h
    saved = initial if isinstance(initial, SavedState) else None
    memory = start_memory(eq, kernel, p, h, None if saved else initial)  # type: ignore[arg-type]
    origin, k = (times.start, 0) if saved is None else (saved.start, saved.k)
    memory = memory if saved is None else restored_memory(saved, eq, memory, h)
    signals, hits = options.signals(eq), steps_per_period(eq, h)
    session = Session(eq, kernel, memory, signals, origin, h, times.every, k, hits)
    warn_of_fast_poles([RunStart(eq, p, times.start, signals, memory)], rule, h)
    if locate:
        session = locating(session, rule, chosen, backend)
    rows, stopped = session.run(times.steps, progress)
    run = _result(diagram.title, session, rule, names, rows, p, k, stopped is None)
    if stopped is not None and not stopped.interrupted:
        raise _failure(eq, rule, session, stopped, run, backend)
    return run


def _result(
    title: str,
    session: Session,
    rule: Method,
    names: tuple[str, ...],
    rows: np.ndarray,
    p: np.ndarray,
    k: int,
    complete: bool,
) -> Run:
    """What has been run so far, from step ``k`` on."""
    eq, start, h = session.eq, session.start, session.h
    return Run(
        title,
        start + h * (-(-k // session.every) * session.every + session.every * np.arange(len(rows))),
        rows,
        names,
        eq.aliases,
        eq.units,
        dict(zip(eq.p, p, strict=True)),
        h,
        rule.name,
        SavedState(session.memory, session.k, start, h, memory_names(eq)),
        complete,
        tuple(e for e in session.events if e.t <= start + session.k * h),
    )


def _failure(eq: Equations, rule: Method, session: Session, stopped: Stopped, run: Run, backend: str) -> NotFinite:
    """The error that says where a run stopped being finite, with the run up to there."""
    kernel = single_kernel(eq, rule, tuple(range(len(eq.y))), backend)
    again = Session(
        eq, kernel, stopped.memory.copy(), session.signals, session.start, session.h, 1, stopped.k, session.hits
    )
    text, block, time = explain_divergence(eq, again, stopped.steps)
    error = NotFinite(text)
    error.run, error.block, error.time = attrs.evolve(run, state=attrs.evolve(run.state, lost=time)), block, time
    return error
