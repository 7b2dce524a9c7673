"""Running a diagram: the place where diagrams, compile and engine meet."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.block import is_reference
from tsmblocks.compile import compile_diagram
from tsmblocks.diagram import Diagram
from tsmblocks.engine.kernels import Memory
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.session import Session, Stopped, gather_signals, single_kernel, start_memory, steps_per_period
from tsmblocks.equation_set import Equations
from tsmblocks.errors import NotFinite, RunError, in_words, near
from tsmblocks.failure import explain
from tsmblocks.run import Run

MOST_NUMBERS = 250_000_000
"""Logged numbers (2 GB) above which a run asks to be told what to log."""


class StepWarning(UserWarning):
    """The step is too long for the fastest pole of the diagram."""


_COMPILED: dict[Any, Equations] = {}
_KEPT = 64


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
    return tuple(parts), frozenset(diagram.links), inlets, tuple(diagram.outputs.items()), tuple(diagram.values)


def _shape(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(_shape(v) for v in value)
    return value if is_reference(value) else None


def equations(diagram: Diagram) -> Equations:
    """The equations of a diagram, kept so that other numbers do not compile it again."""
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


@attrs.frozen(eq=False)
class Saved:
    """A state to go on from: all memory, the step counter and the step. It pickles."""

    memory: Memory = attrs.field(repr=False)
    k: int
    start: float
    step: float


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
    initial: Mapping[str, float] | None = None,
    log: str | Iterable[str] = "all",
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    backend: str = "",
) -> Run:
    """Run a diagram at a fixed step and return its signals.

    ``stop`` and ``start`` in s (by default to the end of the shortest recorded input, else 20 s);
    ``step`` in s; ``method`` one of euler, heun, rk4. ``inputs`` maps each input of the diagram to a
    number, values on the steps, a pair (times, values), Samples, or a function of time that takes an
    array; ``hold`` says what plain values are in between (zero, linear, cubic). ``parameters``
    overrides numbers by name, ``initial`` start values of states. ``log`` is ``"all"``, ``"outputs"``
    or patterns such as ``"tsm.*"``; every ``every``-th instant is kept. ``progress`` is called with
    the fraction done, on long runs. ``backend`` forces ``"llvm"`` or ``"casadi"``.

    Raises NotFinite when a signal becomes NaN or infinite, RunError, DataError, ParameterError and
    what compile raises. After Ctrl-C the run so far is returned with ``complete`` False.
    """
    diagram = diagram.with_parameters(parameters) if parameters else diagram
    eq = equations(diagram)
    h = _positive("step", step)
    chosen, names = _logged(eq, log)
    given = dict(inputs or {})
    stop = resolve_stop(given, start, h) if stop is None else float(stop)
    steps = whole_steps(start, stop, h)
    if (steps // every + 1) * len(chosen) > MOST_NUMBERS:
        raise RunError(f"{steps} steps of {len(chosen)} signals would take {steps * len(chosen) * 8 / 1e9:.0f} GB. "
                       "Use log='outputs', log=['tsm.*'] or every=10.")  # fmt: skip
    rule = method_named(method)
    p = parameter_vector(eq, diagram)
    kernel = single_kernel(eq, rule, chosen, backend)
    grid = start + h * np.arange(steps + 1)
    session = Session(eq, kernel, start_memory(eq, kernel, p, h, initial), gather_signals(eq, given, grid, hold),
                      start, h, _every(every), 0, steps_per_period(eq, h))  # fmt: skip
    _warn_of_fast_poles(eq, rule, session, p, h)
    rows, stopped = session.run(steps, progress)
    saved = Saved(session.memory, session.k, start, h)
    run = Run(diagram.title, grid[::every][: len(rows)], rows, names, eq.aliases, eq.units,
              dict(zip(eq.p, p, strict=True)), h, rule.name, saved, stopped is None)  # fmt: skip
    if stopped is not None and not stopped.interrupted:
        raise _failure(eq, rule, session, stopped, run, backend)
    return run


def _failure(eq: Equations, rule: Method, session: Session, stopped: Stopped, run: Run, backend: str) -> NotFinite:
    """The error that says where a run stopped being finite, with the run up to there."""
    kernel = single_kernel(eq, rule, tuple(range(len(eq.y))), backend)
    again = attrs.evolve(session, kernel=kernel, memory=stopped.memory.copy(), k=stopped.k, every=1)
    text, block, time = explain(eq, again, stopped.steps)
    error = NotFinite(text)
    error.run, error.block, error.time = run, block, time
    return error


def _positive(name: str, value: Any) -> float:
    number = float(value) if isinstance(value, (int, float, np.floating, np.integer)) else float("nan")
    if not 0 < number < float("inf"):
        raise RunError(f"{name} must be a positive number of seconds, got {in_words(value)}.")
    return number


def _every(value: int) -> int:
    if not isinstance(value, (int, np.integer)) or value < 1:
        raise RunError(f"every must be a whole number of at least 1, got {in_words(value)}.")
    return int(value)


def whole_steps(start: float, stop: float, h: float) -> int:
    if not start < stop < float("inf"):
        raise RunError(f"the run must end after it starts, got start={start:g} s and stop={stop:g} s.")
    steps = round((stop - start) / h)
    if steps < 1:
        raise RunError(f"the step of {h:g} s is longer than the run of {stop - start:g} s.")
    return steps


def resolve_stop(inputs: Mapping[str, Any], start: float, h: float) -> float:
    """The end of the shortest recorded input; 20 s when there is none."""
    ends = []
    for value in inputs.values():
        if hasattr(value, "t"):
            ends.append(float(np.asarray(value.t)[-1]))
        elif isinstance(value, tuple) and len(value) == 2 and np.ndim(value[0]) == 1:
            ends.append(float(np.asarray(value[0])[-1]))
        elif np.ndim(value) == 1:
            ends.append(start + (len(value) - 1) * h)
    return start + np.floor((min(ends) - start) / h + 1e-6) * h if ends else 20.0


def _logged(eq: Equations, log: str | Iterable[str]) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Which signals are kept."""
    if log == "all":
        return tuple(range(len(eq.y))), eq.y
    shown = set(eq.aliases.values())
    patterns = [] if log == "outputs" else [log] if isinstance(log, str) else list(log)
    chosen = [k for k, name in enumerate(eq.y)
              if name in shown or any(fnmatchcase(name, eq.aliases.get(p, p)) for p in patterns)]  # fmt: skip
    for pattern in patterns:
        if not any(fnmatchcase(name, eq.aliases.get(pattern, pattern)) for name in eq.y):
            raise RunError(f"log '{pattern}' matches no signal.{near(pattern, eq.y)}")
    return tuple(chosen), tuple(eq.y[k] for k in chosen)


def _warn_of_fast_poles(eq: Equations, rule: Method, session: Session, p: np.ndarray, h: float) -> None:
    """Warn when a mode that decays would grow under this method at this step."""
    from tsmblocks.poles import fastest_unstable

    found = fastest_unstable(eq, rule, session, p, h)
    if found is not None:
        pole, state = found
        warnings.warn(
            f"diagram '{eq.title}': the step of {h:g} s is too long for the fastest pole ({abs(pole):.3g} rad/s, at "
            f"{state}); {rule.name} needs a step below about {rule.real_limit / abs(pole):.2g} s there.",
            StepWarning, stacklevel=4,
        )  # fmt: skip


class Stepper:
    """A diagram run sample by sample, for loops that live outside: hardware, games, other simulators.

    ``stepper.step({"u": 1.0})`` applies inputs for one step (held constant) and returns the outputs at
    its end; ``save()`` and ``restore(saved)`` go back and forth in time.
    """

    def __init__(
        self, diagram: Diagram, *, step: float = 1e-3, method: str = "rk4",
        parameters: Mapping[str, Any] | None = None, initial: Mapping[str, float] | None = None, backend: str = "",
    ) -> None:  # fmt: skip
        diagram = diagram.with_parameters(parameters) if parameters else diagram
        eq = self.eq = equations(diagram)
        if any(f.block or f.order for f in eq.u):
            name = next(f.name for f in eq.u if f.block or f.order)
            raise RunError(f"'{name}' is known from samples only, so this diagram cannot be stepped one by one.")
        self.h = _positive("step", step)
        shown = tuple(dict.fromkeys(eq.y.index(v) for v in eq.aliases.values()))
        self.names = tuple(eq.y[k] for k in shown)
        self.kernel = single_kernel(eq, method_named(method), shown, backend)
        self.hits = steps_per_period(eq, self.h)
        self.memory = start_memory(eq, self.kernel, parameter_vector(eq, diagram), self.h, initial)
        self.k = 0

    @property
    def t(self) -> float:
        """Time now, in s."""
        return self.k * self.h

    def step(self, inputs: Mapping[str, float] | None = None) -> dict[str, float]:
        """Take one step with inputs held constant; the outputs at its end, with those inputs."""
        values = [self._input(f.name, inputs or {}) for f in self.eq.u]
        u = np.tile(values, (2, len(self.kernel.plan.method.instants), 1)) if values else np.empty((2, 1, 0))
        y = np.empty((1, self.kernel.layout_y.size))
        work = self.memory.copy()
        self._go(self.memory, u, 1, False, 1, y)
        work = self.memory.copy()  # the outputs at the end are read on a copy, so that samples act once
        self.k += 1
        self._go(work, u, 0, True, 0, y)
        if not np.isfinite(y).all():
            bad = self.names[int(np.flatnonzero(~np.isfinite(y[0]))[0])]
            raise NotFinite(f"{bad} is {y[0][self.names.index(bad)]} at t = {self.t:g} s.")
        row = dict(zip(self.names, y[0], strict=True))
        return {name: float(row[signal]) for name, signal in self.eq.aliases.items()}

    def _go(self, memory: Memory, u: np.ndarray, n: int, final: bool, skip: int, y: np.ndarray) -> None:
        self.kernel.advance(memory, u, t0=0.0, h=self.h, k0=self.k, n=n, final=final, every=1 << 40, skip=skip,
                            hits=self.hits, y=y)  # fmt: skip

    def _input(self, name: str, inputs: Mapping[str, float]) -> float:
        if name not in inputs:
            extra = next(iter(set(inputs) - {f.name for f in self.eq.u}), None)
            hint = f" '{extra}' was given.{near(extra, [f.name for f in self.eq.u])}" if extra else ""
            raise RunError(f"step needs a value for input '{name}'.{hint}")
        return float(inputs[name])

    def save(self) -> Saved:
        """The state now, to come back to."""
        return Saved(self.memory.copy(), self.k, 0.0, self.h)

    def restore(self, saved: Saved) -> None:
        """Go on from a saved state of the same diagram and step. Raises RunError otherwise."""
        if saved.step != self.h or saved.memory.x.shape != self.memory.x.shape:
            raise RunError("the saved state belongs to another diagram or step.")
        self.memory, self.k = saved.memory.copy(), saved.k


__all__ = ["Run", "Saved", "StepWarning", "Stepper", "equations", "resolve_stop", "simulate", "whole_steps"]
