"""One run of a diagram: compile, run by the engine, and report where it diverges."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_bool, as_callback
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.engine.events import listed, locating
from tsmblocks.engine.loops import reports
from tsmblocks.engine.session import Session, single_kernel, start_memory, steps_per_period
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions, as_diagram, driven, logged_signals
from tsmblocks.simulation.compiled import SOLVE, equations, for_run, parameter_vector
from tsmblocks.simulation.divergence import divergence_error
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.saved_state import SavedState, memory_names, restored_memory, start_and_step
from tsmblocks.simulation.singular_loops import with_determinants, without_determinants
from tsmblocks.simulation.stability import RunStart, fast_poles
from tsmblocks.simulation.step_check import prepared, taken, warn_of_step
from tsmblocks.simulation.stop_condition import Ended, condition_of, run_until, stop_condition, watched


def simulate(
    diagram: Diagram,
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    data: Any = None,
    hold: Hold = AUTO,
    parameters: Mapping[str, Any] | None = None,
    initial: Mapping[str, float] | SavedState | None = None,
    log: str | Iterable[str] = "all",
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    locate: bool = False,
    stop_when: str | None = None,
    backend: str = "",
    loops: str = SOLVE,
    check_step: bool = True,
) -> Run:
    """Run a diagram at a fixed step and return its signals.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    stop : float, optional
        End in s; the last instant is the last whole step up to it. By default the end of the shortest recorded input,
        or 20 s without one.
    step : float, default 1e-3
        Step in s.
    start : float, default 0.0
        Time of the first instant in s.
    method : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method. The last three (of order 2, 3 and 4) are implicit and L-stable: for stiff diagrams, whose
        fastest poles are beyond the step.
    inputs : dict of str to signal, optional
        For each input of the diagram a number, values on the steps, a pair (times in s, values), Samples, a Record or a
        Run (of which the signal of that name is taken, in the unit of the input), a pandas column indexed by time in s,
        or a function of an array of times. Values are in the unit of the input.
    data : Record or Run, optional
        A recording, or a run, from which all inputs are taken that ``inputs`` does not have, by their names.
    hold : {"auto", "zero", "linear", "cubic"} or dict of str to these
        Interpolation between samples of the inputs, one for all or by input. By default it is found from the samples:
        zero-order hold where an input is piecewise constant, else linear or a cubic spline.
    parameters : dict of str to float, optional
        Values by name that replace those of the diagram.
    initial : dict of str to float or SavedState, optional
        Initial states by name that replace those of the diagram, or ``run.state`` to continue where a run ended.
    log : str or list of str, default "all"
        Signals to keep besides the outputs of the diagram: ``"all"``, ``"outputs"`` (none), or patterns such as
        ``"tsm.*"``.
    every : int, default 1
        Keep every ``every``-th instant.
    progress : callable, optional
        Called on long runs with the fraction that is done.
    locate : bool, default False
        Locate the instants at which limits, signs and comparisons switch, and end a part of a step at each, so that the
        method keeps its order across kinks and jumps; ``run.events`` lists them. It is of use where errors below about
        1e-5 matter. Rounding is not located. In a sliding mode steps are taken as without it, with a SlidingWarning.
    stop_when : str, optional
        Comparison of signals, such as ``"x > 1"`` or ``"abs(u) > 23.9 or y < 0"``: the run ends where it becomes true,
        ``run.ended_by`` is then the text. Its last instant lies within the step, with the accuracy of the method; with
        sampled blocks or transport delays it is the first step at which the condition holds. By default that of the
        diagram's file; ``""`` for none.
    backend : {"", "llvm", "casadi"}
        Machine code or CasADi's evaluator; by default machine code where llvmlite is installed.
    loops : {"solve", "refuse"}
        Solve algebraic loops (``run.loops`` says where, and in how many iterations), or raise AlgebraicLoop for one.
    check_step : bool, default True
        Take the run, or of a long one a sample, again in other steps, and warn where outputs of the diagram differ by
        more than 0.05 % of their largest values, or other states by more than 0.5 %. A run that is repeated unchanged
        is checked once.

    Returns
    -------
    Run
        Signals over time. After Ctrl-C the run up to there, with ``complete`` False.

    Raises
    ------
    NotFinite
        For a signal that becomes NaN or infinite, and for an algebraic loop without a solution; ``error.run`` is the
        run up to there.
    RunError
        For times, a method, an initial state or a pattern that is not possible, and for ``locate`` with a
        transport delay. Also where ``stop_when`` holds at the start.
    DataError
        For missing, unknown or unsuitable inputs.
    ParameterError
        For an unknown parameter or a value out of its bounds, and for a ``stop_when`` that is no comparison of signals.
    DiagramError
        For a diagram that cannot be compiled.

    Warns
    -----
    StepWarning
        Where the step is too long: for the fastest pole of the diagram, or for the run as it went. The warning says
        which signal is wrong, when and by how much, and a step that suffices.
    LoopWarning
        Where the gain of a linear algebraic loop passes 1 between two steps, with no jump: its signals pass through
        infinity there.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> run = tsm.simulate(tsm.load("motor_linear"), stop=1.0, inputs={"u": 12.0})
    >>> print(f"{run['x'][-1]:.3f} {run.unit('x')}")
    23.520 rad
    """
    diagram = as_diagram(diagram, parameters)
    begin, h = start_and_step(start, step, initial)
    times = (options := RunOptions(stop, h, begin, method, driven(diagram, inputs, data), hold, every, backend)).times
    as_callback(progress, "the fraction done")
    locate, check_step = as_bool("locate", locate), as_bool("check_step", check_step)
    eq = equations(diagram, loops=loops)
    condition = stop_condition(eq, text) if (text := condition_of(diagram, stop_when)) else None
    chosen, names = logged_signals(eq, log, times, condition.signals if condition else ())
    rule, p, h = options.rule, parameter_vector(eq, diagram), times.h
    eq, signals = for_run(eq, diagram, options)
    eq, chosen = with_determinants(eq, chosen)
    kernel = single_kernel(eq, rule, chosen, backend)
    if isinstance(initial, SavedState):  # instants are counted from the start of the run that is continued
        memory = restored_memory(initial, eq, start_memory(eq, kernel, p, h, None), h)
        origin, k = initial.start, initial.k
        for counts in kernel.loop_statistics(memory):
            counts[:] = 0.0
    else:
        memory = start_memory(eq, kernel, p, h, initial)
        origin, k = times.start, 0
    session = Session(eq, kernel, memory, signals, origin, h, times.every, k, steps_per_period(eq, h))
    poles = fast_poles([RunStart(eq, p, times.start, signals, memory)], rule, h)
    if locate:
        session = locating(session, backend)
    whole = locate or condition is not None
    check = prepared(session, times.steps, chosen, whole) if check_step else None
    if condition is None:
        rows, stopped = session.run(times.steps, progress)
        ended = Ended(rows, session, stopped)
    else:
        ended = run_until(session, times.steps, watched(eq, condition, chosen), progress)
    stopped, run = ended.stopped, _result(ended, names, p, k, origin, h, text)
    finding = check.finding(taken(check, ended, k, origin, h, chosen, backend)) if check and not stopped else ""
    warn_of_step(eq.title, h, poles, finding, 3)
    if stopped is None or stopped.interrupted:
        return run
    last = Session(eq, kernel, stopped.memory, signals, origin, h, 1, stopped.k, session.hits)
    error = divergence_error(last, backend, stopped.steps, bool(poles))
    error.run = attrs.evolve(run, state=attrs.evolve(run.state, diverged_at=error.time))
    raise error


def _result(
    ended: Ended, names: tuple[str, ...], p: np.ndarray, k: int, origin: float, h: float, condition: str
) -> Run:
    """The run so far, from step ``k`` on; instants are counted from ``origin`` [s]."""
    session, eq = ended.session, ended.session.eq
    first = -(-k // session.every) * session.every  # the first logged instant: a multiple of ``every``, not before k
    t = origin + h * (first + session.every * np.arange(len(ended.rows)))
    state = SavedState(session.memory, session.k, origin, h, memory_names(eq))
    if ended.at is not None:
        t[-1] = ended.at
        state = state if session.h == h else attrs.evolve(state, k=0, start=ended.at)
    return Run(
        title=eq.title,
        t=t,
        rows=without_determinants(eq, ended.rows, t),
        names=names,
        aliases=eq.aliases,
        units=eq.units,
        parameters=dict(zip(eq.p, p, strict=True)),
        step=h,
        method=session.kernel.plan.method.name,
        state=state,
        complete=ended.stopped is None,
        events=listed((e for e in session.events if e.t <= state.t), session.h),
        ended_by=condition if ended.at is not None else "",
        loops=reports(eq.loops, session.kernel.loop_statistics(session.memory)),
    )
