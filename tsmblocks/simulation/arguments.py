"""Arguments of a run: the diagram, its inputs and times, checked once for every way to run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_integer, as_number, as_positive
from tsmblocks.common.errors import DataError, RunError, in_words
from tsmblocks.model.diagram import Diagram, required_diagram

MOST_STEPS = 1e15
"""Steps of a run, at most. Derived: times of a double then still differ from step to step."""


def as_diagram(diagram: Diagram, parameters: Mapping[str, Any] | None = None) -> Diagram:
    """The diagram to run, with its parameters changed. Raises RunError when it is none."""
    diagram = required_diagram(diagram, "run", RunError)
    return diagram if parameters is None else diagram.with_parameters(parameters)


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
        return self.start + self.h * np.arange(self.steps + 1)

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
