"""A diagram run sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number, as_positive
from tsmblocks.common.errors import DataError, NotFinite, RunError, in_words, near
from tsmblocks.engine.equations import SampledInput
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Memory
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.session import Session, single_kernel, start_memory, steps_per_period
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram, as_inputs
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.divergence import explain_divergence
from tsmblocks.simulation.saved_state import SavedState, memory_names, restored_memory
from tsmblocks.simulation.stability import RunStart, no_step_warnings, warn_of_fast_poles


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
        initial: Mapping[str, float] | SavedState | None = None,
        backend: str = "",
    ) -> None:
        diagram = self.diagram = as_diagram(diagram, parameters)
        self.h, self.start = as_positive("step", step), 0.0
        eq = self.eq = equations(diagram)
        for feed in eq.u:
            _need_single(diagram.title, feed)
        shown = tuple(dict.fromkeys(eq.y.index(v) for v in eq.aliases.values()))
        self.names = tuple(eq.y[k] for k in shown)
        self.backend = backend
        rule, p = method_named(method), parameter_vector(eq, diagram)
        self.kernel = single_kernel(eq, rule, shown, backend)
        self.hits = steps_per_period(eq, self.h)
        saved = initial if isinstance(initial, SavedState) else None
        self.memory = start_memory(eq, self.kernel, p, self.h, None if saved else initial)  # type: ignore[arg-type]
        self.k = 0
        if saved is not None:
            self.restore(saved)
        warn_of_fast_poles([RunStart(eq, p, memory=self.memory)], rule, self.h)

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
        values = self._values(as_inputs(inputs))
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
        text, block, time = explain_divergence(
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
        return as_number(f"input '{name}'", inputs[name], DataError)

    def __reduce__(self) -> Any:  # machine code neither copies nor pickles; it is made, or found, again
        return _revived, (self.diagram, self.h, self.kernel.plan.method.name, self.backend, self.save())

    def save(self) -> SavedState:
        """The state now, to come back to."""
        return SavedState(self.memory.copy(), self.k, self.start, self.h, memory_names(self.eq))

    def restore(self, saved: SavedState) -> None:
        """Go on from a saved state of the same diagram and step, or from ``run.state``. Raises RunError otherwise."""
        if not isinstance(saved, SavedState):
            raise RunError(f"restore takes what save gave, or the state of a run, got {in_words(saved)}.")
        self.memory = restored_memory(saved, self.eq, self.memory, self.h)
        self.k, self.start, self.h = saved.k, saved.start, saved.step  # the step to the last digit, as time is counted


def _revived(diagram: Diagram, step: float, method: str, backend: str, saved: SavedState) -> Stepper:
    """A stepper that goes on where another stood."""
    with no_step_warnings():
        stepper = Stepper(diagram, step=step, method=method, backend=backend)
    stepper.restore(saved)
    return stepper


def _need_single(title: str, feed: SampledInput) -> None:
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
