"""A diagram run sample by sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number, as_positive
from tsmblocks.common.errors import DataError, NotFinite, RunError, in_words, near
from tsmblocks.common.tables import listed
from tsmblocks.engine.equations import SampledInput
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Memory, Steps
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.session import Session, single_kernel, start_memory, steps_per_period
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram, as_inputs
from tsmblocks.simulation.compiled import SOLVE, equations, parameter_vector, with_held
from tsmblocks.simulation.divergence import divergence_error
from tsmblocks.simulation.saved_state import SavedState, memory_names, restored_memory
from tsmblocks.simulation.stability import RunStart, no_step_warnings, warn_of_fast_poles


class Stepper:
    """A diagram run sample by sample, for loops outside of it: hardware, games, other simulators.

    A copy is independent of the original.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    step : float, default 1e-3
        Step in s.
    method : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    parameters : dict of str to float, optional
        Values by name that replace those of the diagram.
    initial : dict of str to float or SavedState, optional
        Initial states by name that replace those of the diagram, or ``run.state`` to continue where a run ended.
    backend : {"", "llvm", "casadi"}
        As for ``simulate``.
    loops : {"solve", "refuse"}
        As for ``simulate``.

    Raises
    ------
    RunError
        As for ``simulate``, and for a diagram whose inputs must be known for the whole run: a recorded signal of
        a block, or the derivative of an input.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> stepper = tsm.Stepper(tsm.load("motor_linear"), step=0.01)
    >>> for _ in range(100):
    ...     outputs = stepper.step({"u": 12.0})
    >>> print(f"{stepper.t:.2f} s, {outputs['x']:.3f} rad")
    1.00 s, 23.520 rad
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
        loops: str = SOLVE,
    ) -> None:
        diagram = self.diagram = as_diagram(diagram, parameters)
        self.h, self.start = as_positive("step", step), 0.0
        eq = equations(diagram, loops=loops)
        for feed in eq.u:
            _need_single(diagram.title, feed)
        eq = self.eq = with_held(eq, diagram, diagram.inports)
        self.names = tuple(dict.fromkeys(eq.aliases.values()))
        self.backend = backend
        rule, p = method_named(method), parameter_vector(eq, diagram)
        self.kernel = single_kernel(eq, rule, tuple(map(eq.y.index, self.names)), backend)
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
        """Present time in s."""
        return self.start + self.k * self.h

    def step(self, inputs: Mapping[str, float] | None = None) -> dict[str, float]:
        """Take one step with the inputs held constant.

        Parameters
        ----------
        inputs : dict of str to float, optional
            A value for each input of the diagram.

        Returns
        -------
        dict of str to float
            The outputs at the end of the step, with those inputs.

        Raises
        ------
        DataError
            For a missing, unknown or non-finite input.
        NotFinite
            For a signal that becomes NaN or infinite; the state is then that before the step.
        """
        values = self._values(as_inputs(inputs))
        u = np.tile(values, (2, len(self.kernel.plan.method.instants), 1)) if values else np.empty((2, 1, 0))
        y = np.empty((1, self.kernel.layout_y.size))
        before = self.memory.copy()
        self.kernel.advance(self.memory, u, y, Steps(self.start, self.h, self.k, 1, False, self.hits, skip=1))
        self.k += 1
        # Outputs at the end are read on a copy: sampled blocks act once.
        self.kernel.advance(self.memory.copy(), u, y, Steps(self.start, self.h, self.k, 0, True, self.hits))
        if not (np.isfinite(y).all() and np.isfinite(self.memory.x).all()):
            self.memory, self.k = before, self.k - 1
            raise self._not_finite(before, values)
        row = dict(zip(self.names, y[0], strict=True))
        return {name: float(row[signal]) for name, signal in self.eq.aliases.items()}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of ``Cycle.u``."""
        return tuple(f.name for f in self.eq.u)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs, in the order of ``Cycle.y``."""
        return tuple(self.eq.aliases)

    def cycle(self) -> Cycle:
        """One cycle of a loop with hardware, on arrays that are made once.

        Returns
        -------
        Cycle
            Its arrays ``u`` and ``y``, and ``cycle()``, which takes a step in a few microseconds.

        Examples
        --------
        >>> import tsmblocks as tsm
        >>> cycle = tsm.Stepper(tsm.load("motor_linear"), step=0.01).cycle()
        >>> for k in range(101):
        ...     cycle.u[0] = 12.0  # what is measured at this instant
        ...     cycle()
        >>> print(f"{cycle.t:.2f} s: {cycle.y[0]:.3f} rad")  # the outputs of the instant before the step
        1.01 s: 23.520 rad
        """
        return Cycle(self)

    def _not_finite(self, before: Memory, values: list[float]) -> NotFinite:
        """The error of a step that diverged."""
        ends = np.array([0.0, self.h])  # inputs are held from one to the other
        held = [(Signal(f.name, v, ends, "zero"), 0) for f, v in zip(self.eq.u, values, strict=True)]
        last = Session(self.eq, self.kernel, before, held, self.start, self.h, 1, self.k, self.hits)
        return divergence_error(last, self.backend, 1)

    def _values(self, inputs: Mapping[str, Any]) -> list[float]:
        """The inputs in order. Raises DataError for one that is missing, unknown or no number."""
        wanted = [f.name for f in self.eq.u]
        for name in inputs:
            if name not in wanted:
                raise DataError(f"diagram '{self.eq.title}' has no input '{name}'.{near(name, wanted)}")
        for name in wanted:
            if name not in inputs:
                raise DataError(f"diagram '{self.eq.title}' needs a value of its input '{name}' at each step.")
        return [as_number(f"input '{name}'", inputs[name], DataError) for name in wanted]

    def __reduce__(self) -> Any:  # machine code cannot be pickled; it is compiled again, or loaded
        return _revived, (self.diagram, self.h, self.kernel.plan.method.name, self.backend, self.save())

    def save(self) -> SavedState:
        """The present state, to return to it with ``restore``.

        Returns
        -------
        SavedState
            All memory and the step counter; it can be pickled.
        """
        return SavedState(self.memory.copy(), self.k, self.start, self.h, memory_names(self.eq))

    def restore(self, saved: SavedState) -> None:
        """Continue from a saved state.

        Parameters
        ----------
        saved : SavedState
            What ``save`` returned, or the ``state`` of a run of the same diagram and step.

        Raises
        ------
        RunError
            For a state of another diagram or step, and for one of a run that diverged.
        """
        if not isinstance(saved, SavedState):
            raise RunError(f"restore takes what save returned, or the state of a run, got {in_words(saved)}.")
        self.memory = restored_memory(saved, self.eq, self.memory, self.h)
        self.k, self.start = saved.k, saved.start
        self.h = saved.step  # to the last digit, as times are multiples of it


class Cycle:
    """One cycle of a loop with hardware: inputs in, outputs of the same instant out, then a step.

    ``cycle()`` computes the outputs ``y`` for the inputs ``u`` of this instant, and takes one step with the inputs
    held, as the C code of ``tsm.export.to_c`` does. It allocates nothing: write into ``u``, read from ``y``.

    Parameters
    ----------
    stepper : Stepper
        The stepper, whose state it advances.

    Attributes
    ----------
    u, y : ndarray
        Inputs and outputs in the order of ``stepper.inputs`` and ``stepper.outputs``, in their units.
    """

    __slots__ = ("_held", "_last", "_memory", "_places", "_row", "_step", "_stepper", "u", "y")

    def __init__(self, stepper: Stepper) -> None:
        self._stepper = stepper
        self.u = np.zeros(len(stepper.inputs))
        self._held = np.zeros((2, len(stepper.kernel.plan.method.instants), len(self.u)))
        row = np.zeros((1, stepper.kernel.layout_y.size))
        places = [stepper.names.index(signal) for signal in stepper.eq.aliases.values()]
        plain = places == list(range(row.size))
        self._row, self._places = row[0], None if plain else np.array(places, dtype=np.intp)
        self.y = row[0] if plain else np.zeros(len(places))
        self._last = memoryview(self._row)
        self._bind(row)

    def _bind(self, row: np.ndarray) -> None:
        """Take the arrays of the stepper's present memory."""
        stepper = self._stepper
        self._memory = stepper.memory
        self._step = stepper.kernel.one_step(stepper.memory, self._held, row, stepper.start, stepper.h, stepper.hits)

    @property
    def t(self) -> float:
        """Present time in s."""
        return self._stepper.t

    def __call__(self) -> None:
        """Compute the outputs of this instant, and take one step.

        Raises
        ------
        NotFinite
            For an output that becomes NaN or infinite.
        """
        stepper = self._stepper
        if self._memory is not stepper.memory:  # restored
            self._bind(self._row[None])
        if len(self.u):
            self._held[...] = self.u
        self._step(stepper.k)
        if self._places is not None:
            self._row.take(self._places, out=self.y)
        stepper.k += 1
        if not math.isfinite(sum(self._last)):
            self._refuse()

    def _refuse(self) -> None:
        """Raise NotFinite where an output is not finite (and not only their sum)."""
        bad = [name for name, v in zip(self._stepper.names, self._row, strict=True) if not math.isfinite(v)]
        if bad:
            self._stepper.k -= 1
            t = self._stepper.t
            raise NotFinite(f"{listed(bad, 3)} of '{self._stepper.eq.title}' is not finite at t = {t:g} s.")


def _revived(diagram: Diagram, step: float, method: str, backend: str, saved: SavedState) -> Stepper:
    """A stepper in the state of another."""
    with no_step_warnings():
        stepper = Stepper(diagram, step=step, method=method, backend=backend)
    stepper.restore(saved)
    return stepper


def _need_single(title: str, feed: SampledInput) -> None:
    """Raise RunError for an input that must be known for the whole run."""
    if feed.block:
        raise RunError(
            f"diagram '{title}' cannot be run sample by sample: {feed.block} generates its signal for a whole run at "
            "once. Give this signal as an input instead."
        )
    if feed.order:
        name = feed.name.removeprefix("d/dt " * feed.order)
        raise RunError(
            f"diagram '{title}' cannot be run sample by sample: it needs the derivative of its input '{name}', "
            "which cannot be formed from single values. Use a FilteredDerivative, or an input for the rate."
        )
