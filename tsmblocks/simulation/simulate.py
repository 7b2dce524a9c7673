"""Running a diagram: the place where diagrams, compile and engine meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, NotFinite, RunError, in_words, near
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.engine.equations import Equations, Feed
from tsmblocks.engine.events import locating
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel_interface import Memory
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.session import Session, Stopped, gather_signals, single_kernel, start_memory, steps_per_period
from tsmblocks.model.block import is_reference
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import Times, given_inputs, number, positive, prepared, run_times
from tsmblocks.simulation.divergence import explain
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.saved_state import Saved, begins, remembered, taken_up
from tsmblocks.simulation.stability import Beginning, StepWarning, no_more_of_steps, warn_of_fast_poles

MOST_NUMBERS = 250_000_000
"""Logged numbers (2 GB) above which a run asks to be told what to log."""


_COMPILED: dict[Any, Equations] = {}
_KEPT = 256


def signature(diagram: Diagram) -> Any:
    """Everything about a diagram except its numbers; equal signatures have the same equations."""
    parts: list[Any] = []
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            parts.append((name, signature(block)))
        else:
            shape = tuple((k, _shape(v)) for k, v in block.parameters.items())
            parts.append((name, type(block), shape, tuple(block.options.items())))
    inlets = tuple((k, v.unit, diagram.inlets[k]) for k, v in diagram.inputs.items())
    return (tuple(parts), frozenset(diagram.links), inlets, tuple(diagram.outputs.items()), tuple(diagram.values))


def _shape(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(_shape(v) for v in value)
    return value if is_reference(value) else None


def equations(diagram: Diagram) -> Equations:
    """The equations of a diagram, kept so that other numbers do not compile it again.

    Raises RunError for what is no diagram, and what compile raises.
    """
    diagram = prepared(diagram)
    key = (diagram.title, signature(diagram))
    found = _COMPILED.pop(key, None)
    if found is None:
        found = compile_diagram(diagram)
        while len(_COMPILED) >= _KEPT:
            _COMPILED.pop(next(iter(_COMPILED)))
    _COMPILED[key] = found
    return found


def parameter_vector(eq: Equations, diagram: Diagram) -> np.ndarray:
    """The diagram's numbers in the order of the equations."""
    values = diagram.parameters
    return np.array([values[name] for name in eq.p], dtype=float)


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
    initial: Mapping[str, float] | Saved | None = None,
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
    diagram, given = prepared(diagram, parameters), given_inputs(inputs)
    begin, h = begins(start, step, initial)
    times = run_times(given, begin, stop, h, every)
    if progress is not None and not callable(progress):
        raise RunError(f"progress must be a function of the fraction done, got {in_words(progress)}.")
    eq = equations(diagram)
    chosen, names = _logged(eq, log, times)
    rule, p = method_named(method), parameter_vector(eq, diagram)
    kernel, h = single_kernel(eq, rule, chosen, backend), times.h
    saved = initial if isinstance(initial, Saved) else None
    memory = start_memory(eq, kernel, p, h, None if saved else initial)  # type: ignore[arg-type]
    origin, k = (times.start, 0) if saved is None else (saved.start, saved.k)
    memory = memory if saved is None else taken_up(saved, eq, memory, h)
    signals, hits = gather_signals(eq, given, times.grid, hold), steps_per_period(eq, h)
    session = Session(eq, kernel, memory, signals, origin, h, times.every, k, hits)
    warn_of_fast_poles([Beginning(eq, p, times.start, signals, memory)], rule, h)
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
        Saved(session.memory, session.k, start, h, remembered(eq)),
        complete,
        tuple(e for e in session.events if e.t <= start + session.k * h),
    )


def _failure(eq: Equations, rule: Method, session: Session, stopped: Stopped, run: Run, backend: str) -> NotFinite:
    """The error that says where a run stopped being finite, with the run up to there."""
    kernel = single_kernel(eq, rule, tuple(range(len(eq.y))), backend)
    again = Session(
        eq, kernel, stopped.memory.copy(), session.signals, session.start, session.h, 1, stopped.k, session.hits
    )
    text, block, time = explain(eq, again, stopped.steps)
    error = NotFinite(text)
    error.run, error.block, error.time = attrs.evolve(run, state=attrs.evolve(run.state, lost=time)), block, time
    return error


def _logged(eq: Equations, log: str | Iterable[str], times: Times) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Which signals are kept: columns and names. Raises RunError when they would not fit."""
    chosen = _chosen(eq, log)
    if times.kept * len(chosen) > MOST_NUMBERS:
        fewer = times.every * 10 ** math.ceil(math.log10(times.kept * len(chosen) / MOST_NUMBERS))
        raise RunError(
            f"{times.kept} instants of {len(chosen)} signals would take "
            f"{times.kept * len(chosen) * 8 / 1e9:.0f} GB. Keep less: log='outputs', or every={fewer}."
        )
    return chosen, tuple(eq.y[k] for k in chosen)


def _chosen(eq: Equations, log: str | Iterable[str]) -> tuple[int, ...]:
    if log == "all":
        return tuple(range(len(eq.y)))
    shown = set(eq.aliases.values())
    if not isinstance(log, Iterable):
        raise RunError(f"log takes names and patterns such as 'tsm.*', got {in_words(log)}.")
    patterns = [] if isinstance(log, str) and log == "outputs" else [log] if isinstance(log, str) else list(log)
    for pattern in patterns:
        if not isinstance(pattern, str):
            raise RunError(f"log takes names and patterns such as 'tsm.*', got {in_words(pattern)}.")
    chosen = [
        k
        for k, name in enumerate(eq.y)
        if name in shown or any(fnmatchcase(name, eq.aliases.get(p, p)) for p in patterns)
    ]
    for pattern in patterns:
        if not any(fnmatchcase(name, eq.aliases.get(pattern, pattern)) for name in eq.y):
            raise RunError(f"log '{pattern}' matches no signal.{near(pattern, eq.y)}")
    return tuple(chosen)


class Stepper:
    """A diagram run sample by sample, for loops that live outside: hardware, games, other simulators.

    ``stepper.step({"u": 1.0})`` applies inputs for one step (held constant) and returns the outputs at
    its end; ``save()`` and ``restore(saved)`` go back and forth in time, and ``initial=run.state`` begins where a run
    ended. A copy goes on by itself.
    """

    def __init__(
        self,
        diagram: Diagram,
        *,
        step: float = 1e-3,
        method: str = "rk4",
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, float] | Saved | None = None,
        backend: str = "",
    ) -> None:
        diagram = self.diagram = prepared(diagram, parameters)
        self.h, self.start = positive("step", step), 0.0
        eq = self.eq = equations(diagram)
        for feed in eq.u:
            _need_single(diagram.title, feed)
        shown = tuple(dict.fromkeys(eq.y.index(v) for v in eq.aliases.values()))
        self.names = tuple(eq.y[k] for k in shown)
        self.backend = backend
        rule, p = method_named(method), parameter_vector(eq, diagram)
        self.kernel = single_kernel(eq, rule, shown, backend)
        self.hits = steps_per_period(eq, self.h)
        saved = initial if isinstance(initial, Saved) else None
        self.memory = start_memory(eq, self.kernel, p, self.h, None if saved else initial)  # type: ignore[arg-type]
        self.k = 0
        if saved is not None:
            self.restore(saved)
        warn_of_fast_poles([Beginning(eq, p, memory=self.memory)], rule, self.h)

    def __repr__(self) -> str:
        return f"Stepper({self.eq.title!r}, t = {self.t:g} s in steps of {self.h:g} s)"

    @property
    def t(self) -> float:
        """Time now, in s."""
        return self.start + self.k * self.h

    def step(self, inputs: Mapping[str, float] | None = None) -> dict[str, float]:
        """Take one step with inputs held constant; the outputs at its end, with those inputs.

        Raises DataError for unsuitable inputs, and NotFinite with the state as it was before the step.
        """
        values = self._values(given_inputs(inputs))
        u = np.tile(values, (2, len(self.kernel.plan.method.instants), 1)) if values else np.empty((2, 1, 0))
        y = np.empty((1, self.kernel.layout_y.size))
        before = self.memory.copy()
        self._go(self.memory, u, 1, False, 1, y)
        work = self.memory.copy()  # the outputs at the end are read on a copy, so that samples act once
        self.k += 1
        self._go(work, u, 0, True, 0, y)
        if not (np.isfinite(y).all() and np.isfinite(self.memory.x).all()):
            self.memory, self.k = before, self.k - 1
            raise self._not_finite(before.copy(), values)
        row = dict(zip(self.names, y[0], strict=True))
        return {name: float(row[signal]) for name, signal in self.eq.aliases.items()}

    def _not_finite(self, before: Memory, values: list[float]) -> NotFinite:
        """The error that says where a step stopped being finite."""
        kernel = single_kernel(self.eq, self.kernel.plan.method, tuple(range(len(self.eq.y))), self.backend)
        ends = np.array([0.0, self.h])  # held before and after
        held = [(Signal(f.name, v, ends, "zero"), 0) for f, v in zip(self.eq.u, values, strict=True)]
        text, block, time = explain(
            self.eq, Session(self.eq, kernel, before, held, self.start, self.h, 1, self.k, self.hits), 1
        )
        error = NotFinite(text)
        error.block, error.time = block, time
        return error

    def _go(self, memory: Memory, u: np.ndarray, n: int, final: bool, skip: int, y: np.ndarray) -> None:
        self.kernel.advance(
            memory,
            u,
            t0=self.start,
            h=self.h,
            k0=self.k,
            n=n,
            final=final,
            every=1 << 40,
            skip=skip,
            hits=self.hits,
            y=y,
        )

    def _values(self, inputs: Mapping[str, Any]) -> list[float]:
        """The inputs in order. Raises DataError for one that is missing, unknown or no number."""
        wanted = [f.name for f in self.eq.u]
        for name in inputs:
            if name not in wanted:
                raise DataError(f"diagram '{self.eq.title}' has no input '{name}'.{near(name, wanted)}")
        return [self._value(name, inputs) for name in wanted]

    def _value(self, name: str, inputs: Mapping[str, Any]) -> float:
        if name not in inputs:
            raise DataError(f"diagram '{self.eq.title}' needs a value of its input '{name}' at each step.")
        return number(f"input '{name}'", inputs[name], DataError)

    def __reduce__(self) -> Any:  # machine code neither copies nor pickles; it is made, or found, again
        return _revived, (self.diagram, self.h, self.kernel.plan.method.name, self.backend, self.save())

    def save(self) -> Saved:
        """The state now, to come back to."""
        return Saved(self.memory.copy(), self.k, self.start, self.h, remembered(self.eq))

    def restore(self, saved: Saved) -> None:
        """Go on from a saved state of the same diagram and step, or from ``run.state``. Raises RunError otherwise."""
        if not isinstance(saved, Saved):
            raise RunError(f"restore takes what save gave, or the state of a run, got {in_words(saved)}.")
        self.memory = taken_up(saved, self.eq, self.memory, self.h)
        self.k, self.start, self.h = saved.k, saved.start, saved.step  # the step to the last digit, as time is counted


def _revived(diagram: Diagram, step: float, method: str, backend: str, saved: Saved) -> Stepper:
    """A stepper that goes on where another stood."""
    with no_more_of_steps():
        stepper = Stepper(diagram, step=step, method=method, backend=backend)
    stepper.restore(saved)
    return stepper


def _need_single(title: str, feed: Feed) -> None:
    """Raise RunError for an input that is known only where the whole run is."""
    if feed.block:
        raise RunError(
            f"diagram '{title}' cannot be stepped one by one: {feed.block} is made for a whole run at once. "
            "Give its signal as an input instead."
        )
    if feed.order:
        name = feed.name.removeprefix("d/dt " * feed.order)
        raise RunError(
            f"diagram '{title}' cannot be stepped one by one: it needs the derivative of its input '{name}', "
            "which single values do not give. Use a FilteredDerivative, or an input for the rate."
        )


__all__ = ["Run", "Saved", "StepWarning", "Stepper", "equations", "simulate"]
