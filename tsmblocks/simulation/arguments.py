"""Arguments of a run: diagram, inputs, times, options and the signals to keep, checked once for every way to run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_integer, as_list, as_names, as_number, as_positive, as_text
from tsmblocks.common.errors import DataError, RunError, in_words, near
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import EvenInstants, Signal
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.session import gather_signals
from tsmblocks.model.diagram import Diagram, required_diagram

MOST_STEPS = 1e15
"""Steps of a run, at most. Derived: times of a double then still differ from step to step."""
COPIES = 2
"""Times that logged numbers are in memory. Derived: as rows of all signals, and by signal."""
MOST_NUMBERS = 250_000_000
"""Logged numbers (2 GB) above which a run is refused. Chosen."""


def as_diagram(diagram: Diagram, parameters: Mapping[str, Any] | None = None) -> Diagram:
    """The diagram to run, with its parameters changed. Raises RunError when it is none."""
    diagram = required_diagram(diagram, "run", RunError)
    return diagram if parameters is None else diagram.with_parameters(parameters)


def driven(diagram: Diagram, inputs: Mapping[str, Any] | None, data: Any) -> Mapping[str, Any] | None:
    """Inputs by name, those that are not given from a recording or a run. Raises DataError for anything else."""
    if data is None:
        return inputs
    if not hasattr(data, "t"):
        raise DataError(f"data must be a recording or a run with the inputs of the diagram, got {in_words(data)}.")
    return {**dict.fromkeys(diagram.inputs, data), **as_inputs(inputs)}


def as_inputs(inputs: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs by name; a column of pandas becomes (times, values). Raises DataError when they are anything else."""
    if inputs is None:
        return {}
    if not isinstance(inputs, Mapping):
        hint = " For a recording write {'u': recording}." if hasattr(inputs, "t") else ""
        raise DataError(f"inputs must map names to signals, such as {{'u': 1.0}}, got {in_words(inputs)}.{hint}")
    return {name: _timed(name, v) if hasattr(v, "to_numpy") else v for name, v in inputs.items()}


def _timed(name: str, column: Any) -> Any:
    """A column of pandas as (times, values), or as values where its rows are only counted. Raises DataError."""
    times, values = np.asarray(getattr(column, "index", np.empty(0))), column.to_numpy()
    if np.ndim(values) != 1:
        raise DataError(f"input '{name}' must be one column, got {in_words(values)}.")
    if times.dtype.kind not in "iuf":
        raise DataError(f"input '{name}': the index of its samples must be time in s, got {times.dtype}.")
    counted = times.dtype.kind != "f" and np.array_equal(times, np.arange(len(values)))
    return values if counted else (times, values)


def step_count(start: float, stop: float, h: float) -> int:
    """Whole steps between ``start`` and ``stop`` [s]. Raises RunError when there is none."""
    if not start < stop:
        raise RunError(f"the run must end after it starts, got start={start:g} s and stop={stop:g} s.")
    steps = (stop - start) / h
    if steps > MOST_STEPS:
        raise RunError(f"the run of {stop - start:g} s would take {steps:.1g} steps of {h:g} s.")
    count = round(steps) if math.isclose(steps, round(steps), rel_tol=1e-9) else math.floor(steps)
    if count < 1:
        raise RunError(f"the step of {h:g} s is longer than the run of {stop - start:g} s.")
    return count


def input_ends(inputs: Mapping[str, Any], start: float, h: float) -> list[float]:
    """Ends of recorded inputs [s]; constants and functions have none."""
    ends = []
    for value in inputs.values():
        times = getattr(value, "t", value[0] if isinstance(value, tuple) and len(value) == 2 else None)
        if times is not None and np.ndim(times) == 1 and len(times):
            ends.append(float(np.asarray(times)[-1]))
        elif times is None and isinstance(value, (list, tuple, np.ndarray)) and len(value):
            ends.append(start + (len(value) - 1) * h)
    return ends


def end_time(inputs: Mapping[str, Any], start: float, h: float) -> float:
    """The end of the shortest recorded input, on a step; 20 s when there is none."""
    ends = input_ends(inputs, start, h)
    return start + math.floor((min(ends) - start) / h + 1e-6) * h if ends else 20.0


@attrs.frozen
class TimeGrid:
    """The instants of a run: ``start`` and step ``h`` in s, ``steps`` of them, every ``every``-th one kept."""

    start: float
    h: float
    steps: int
    every: int

    @property
    def grid(self) -> np.ndarray:
        """Every instant, in s."""
        return np.asarray(self.instants)

    @property
    def instants(self) -> EvenInstants:
        """The same, made where they are needed."""
        return EvenInstants(self.start, self.h, self.steps + 1)

    @property
    def kept_instants(self) -> np.ndarray:
        """The instants that are kept, in s."""
        return self.start + self.h * (self.every * np.arange(self.kept))

    @property
    def kept(self) -> int:
        """Number of instants that are kept."""
        return self.steps // self.every + 1


def run_times(inputs: Mapping[str, Any], start: Any, stop: Any, step: Any, every: Any) -> TimeGrid:
    """The instants of a run; without ``stop`` up to the end of the inputs. Raises RunError."""
    begin, h, spacing = as_number("start", start), as_positive("step", step), as_integer("every", every, 1)
    end = end_time(inputs, begin, h) if stop is None else as_number("stop", stop)
    steps = step_count(begin, end, h)
    return TimeGrid(begin, h, steps, min(spacing, int(MOST_STEPS) + 1))


@attrs.frozen(eq=False)
class RunOptions:
    """Arguments of ``simulate`` by the same names; inputs are checked here, the others where they are first used."""

    stop: float | None = None
    step: float = 1e-3
    start: float = 0.0
    method: str = "rk4"
    inputs: Mapping[str, Any] = attrs.field(default=None, converter=as_inputs)
    hold: Hold = AUTO
    every: int = 1
    backend: str = attrs.field(default="", validator=lambda _self, field, value: as_text(field.name, value))
    loops: str = "solve"

    @property
    def times(self) -> TimeGrid:
        """The instants of the run. Raises RunError."""
        return run_times(self.inputs, self.start, self.stop, self.step, self.every)

    @property
    def rule(self) -> Method:
        """The integration method. Raises RunError for an unknown name."""
        return method_named(self.method)

    @property
    def arguments(self) -> dict[str, Any]:
        """The options as keyword arguments of ``simulate`` and ``study``, which keep every instant and solve loops."""
        return {k: v for k, v in attrs.asdict(self, recurse=False).items() if k not in ("every", "loops")}

    def signals(self, eq: Equations) -> list[tuple[Signal, int]]:
        """The signal behind each sampled input of the equations, with the order of its derivative. Raises DataError."""
        return gather_signals(eq, self.inputs, self.times.instants, self.hold)


def logged_signals(
    eq: Equations, log: str | Iterable[str], times: TimeGrid, needed: Sequence[str] = ()
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Columns and names of the signals that are kept, those ``needed`` among them. Raises RunError for too many."""
    chosen = _chosen(eq, log)
    if needed:
        chosen = tuple(sorted({*chosen, *(eq.y.index(eq.aliases.get(name, name)) for name in needed)}))
    if times.kept * len(chosen) > MOST_NUMBERS:
        fewer = times.every * 10 ** math.ceil(math.log10(times.kept * len(chosen) / MOST_NUMBERS))
        raise RunError(
            f"{times.kept} instants of {len(chosen)} signals would take "
            f"{times.kept * len(chosen) * 8 / 1e9:.0f} GB. Keep fewer signals or instants: log='outputs', or "
            f"every={fewer}."
        )
    size = COPIES * 8.0 * times.kept * len(chosen)
    refuse_too_large(size, f"logging {times.kept:,} instants of {len(chosen)} signals", "Keep less.", RunError)
    return chosen, tuple(eq.y[k] for k in chosen)


def _chosen(eq: Equations, log: str | Iterable[str]) -> tuple[int, ...]:
    if isinstance(log, str) and log == "all":
        return tuple(range(len(eq.y)))
    patterns = [] if isinstance(log, str) and log == "outputs" else as_list(log) if log is not None else [None]
    for pattern in patterns:
        if not isinstance(pattern, str):
            raise RunError(f"log takes names and patterns such as 'tsm.*', got {in_words(pattern)}.")
    shown = set(eq.aliases.values())
    chosen = [
        k
        for k, name in enumerate(eq.y)
        if name in shown or any(fnmatchcase(name, eq.aliases.get(p, p)) for p in patterns)
    ]
    for pattern in patterns:
        if not any(fnmatchcase(name, eq.aliases.get(pattern, pattern)) for name in eq.y):
            raise RunError(f"log '{pattern}' matches no signal.{near(pattern, eq.y)}")
    return tuple(chosen)


def run_to_their_end(diagram: Diagram, what: str) -> None:
    """Refuse a diagram whose runs end at a condition, where ``what`` knows none."""
    if text := diagram.simulation.stop_when:
        raise RunError(
            f"'{diagram.title}' ends its runs with stop_when = {text!r}, but {what} always runs to the end. Remove it: "
            "diagram.with_simulation(attrs.evolve(diagram.simulation, stop_when=''))."
        )


def kept_columns(eq: Equations, outputs: Sequence[str] | None) -> tuple[list[str], tuple[int, ...], list[int]]:
    """Names of the signals to keep, their positions in ``eq.y``, each once, as a kernel logs them, and columns by name.

    Without ``outputs`` those of the diagram. Raises RunError for an unknown name, and where there is none.
    """
    names = as_names("outputs", outputs, "x_out") if outputs is not None else list(eq.aliases)
    if not names:
        raise RunError(f"diagram '{eq.title}' has no outputs, so name the signals to keep: outputs=['block.port'].")
    signals = [eq.aliases.get(name, name) for name in names]
    for name, signal in zip(names, signals, strict=True):
        if signal not in eq.y:
            raise RunError(f"diagram '{eq.title}' has no signal '{name}'.{near(name, [*eq.aliases, *eq.y])}")
    chosen = list(dict.fromkeys(signals))
    return names, tuple(map(eq.y.index, chosen)), [chosen.index(signal) for signal in signals]
