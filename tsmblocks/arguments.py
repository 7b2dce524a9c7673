"""What a run is asked for: a diagram, times, inputs. Each is checked here, once, for every way to run."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.diagram import Diagram
from tsmblocks.errors import DataError, RunError, TsmError, in_words


def prepared(diagram: Diagram, parameters: Mapping[str, Any] | None = None) -> Diagram:
    """The diagram to run, with its parameters changed. Raises RunError when it is none."""
    if not isinstance(diagram, Diagram):
        hint = f" Load it first: tsmblocks.load({diagram!r})." if isinstance(diagram, str) else ""
        raise RunError(f"only a diagram can be run, got {in_words(diagram)}.{hint}")
    return diagram if parameters is None else diagram.with_parameters(parameters)


def given_inputs(inputs: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs by name. Raises DataError when they are anything else."""
    if inputs is not None and not isinstance(inputs, Mapping):
        raise DataError(f"inputs must map names to signals, such as {{'u': 1.0}}, got {in_words(inputs)}.")
    return dict(inputs or {})


def is_number(value: Any) -> bool:
    """Whether a value is a finite number; True and False are none."""
    plain = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
    return plain and abs(value) <= sys.float_info.max


def number(what: str, value: Any, error: type[TsmError] = RunError) -> float:
    """A number, NaN and infinity excluded. Raises ``error``, ``what`` being its name."""
    if not is_number(value):
        raise error(f"{what} must be a finite number, got {in_words(value)}.")
    return float(value)


def positive(what: str, value: Any) -> float:
    """A time longer than zero, in s. Raises RunError."""
    if not is_number(value) or value <= 0:
        raise RunError(f"{what} must be a positive number of seconds, got {in_words(value)}.")
    return float(value)


def whole(what: str, value: Any, least: int) -> int:
    """A whole number of at least ``least``. Raises RunError, ``what`` being its name."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
        raise RunError(f"{what} must be a whole number of at least {least}, got {in_words(value)}.")
    return int(value)


def whole_steps(start: float, stop: float, h: float) -> int:
    """Whole steps between ``start`` and ``stop`` [s]. Raises RunError when there is none."""
    if not start < stop:
        raise RunError(f"the run must end after it starts, got start={start:g} s and stop={stop:g} s.")
    steps = (stop - start) / h
    count = round(steps) if math.isclose(steps, round(steps), rel_tol=1e-9) else math.floor(steps)
    if count < 1:
        raise RunError(f"the step of {h:g} s is longer than the run of {stop - start:g} s.")
    return count


def ends_of(inputs: Mapping[str, Any], start: float, h: float) -> list[float]:
    """Where recorded inputs end [s]; those that go on for ever have no end."""
    ends = []
    for value in inputs.values():
        times = getattr(value, "t", value[0] if isinstance(value, tuple) and len(value) == 2 else None)
        if times is not None and np.ndim(times) == 1 and len(times):
            ends.append(float(np.asarray(times)[-1]))
        elif times is None and isinstance(value, (list, tuple, np.ndarray)) and len(value):
            ends.append(start + (len(value) - 1) * h)
    return ends


def resolve_stop(inputs: Mapping[str, Any], start: float, h: float) -> float:
    """The end of the shortest recorded input, on a step; 20 s when there is none."""
    ends = ends_of(inputs, start, h)
    return start + math.floor((min(ends) - start) / h + 1e-6) * h if ends else 20.0


@attrs.frozen
class Times:
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
        """How many instants are kept."""
        return self.steps // self.every + 1


def run_times(inputs: Mapping[str, Any], start: Any, stop: Any, step: Any, every: Any) -> Times:
    """The instants asked for; without ``stop``, to the end of the inputs. Raises RunError."""
    begin, h, spacing = number("start", start), positive("step", step), whole("every", every, 1)
    end = resolve_stop(inputs, begin, h) if stop is None else number("stop", stop)
    return Times(begin, h, whole_steps(begin, end, h), spacing)
