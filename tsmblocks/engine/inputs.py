"""Sampled inputs as the rows a kernel reads: each signal at every instant of every step.

Interpolation between samples (the hold) is done here, at the instants of the stages; kernels do not depend on it.
"""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, RunError, in_words
from tsmblocks.common.interpolation import AUTO, ORDERS, check_hold, found_hold
from tsmblocks.common.memory import refuse_too_large

LATE_SAMPLE = 1e-3
"""Share of a step by which a sample may be late and still counts at that step. Chosen: printed times are rounded."""


@attrs.frozen
class EvenInstants:
    """The instants of a run, ``count`` of them a ``step`` apart, which become an array where one is needed."""

    start: float
    step: float
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, k: int) -> float:
        return self.start + self.step * (k % self.count)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All instants. Raises RunError where they are more than the memory holds."""
        refuse_too_large(2 * 8 * self.count, f"the times of {self.count:,} steps", "Use a longer step.", RunError)
        return np.asarray(self.start + self.step * np.arange(self.count), dtype=dtype)


class Signal:
    """A signal as a function of time, with limits from the left and the right and its time derivatives.

    ``order`` is the highest derivative that is needed: a hold that is found from the samples has it.
    """

    def __init__(self, name: str, given: Any, grid: np.ndarray | EvenInstants, hold: str, order: int = 0) -> None:
        self.name = name
        self.function: Any = given if callable(given) else None
        if self.function is not None:
            self.hold, self.t = "exact", np.array([grid[0], grid[-1]])
            return
        self.t, self.y, self.hold = _samples(name, given, grid, hold)
        self._check()
        self.hold = found_hold(self.t, self.y, order) if self.hold == AUTO else self.hold
        self._grid = (math.nan, math.nan, False)
        self._steps: tuple[float, float] | None = None  # start and length of the steps that it is averaged over

    def _check(self) -> None:
        check_hold(self.name, self.hold)
        if self.t.ndim != 1 or self.t.shape != self.y.shape or not len(self.t):
            raise DataError(
                f"input '{self.name}': times and values must be two lists of one length, "
                f"got shapes {self.t.shape} and {self.y.shape}."
            )
        bad = np.flatnonzero(~np.isfinite(self.y) | ~np.isfinite(self.t))
        if len(bad):
            raise DataError(
                f"input '{self.name}': sample {bad[0]} is not finite "
                f"(t = {self.t[bad[0]]:g} s, value = {self.y[bad[0]]:g})."
            )
        back = np.flatnonzero(np.diff(self.t) <= 0)
        if len(back):
            k = back[0] + 1
            raise DataError(
                f"input '{self.name}': time does not increase at sample {k} "
                f"({self.t[k - 1]:g} s, then {self.t[k]:g} s)."
            )

    def covers(self, start: float, stop: float, step: float) -> None:
        """Raise DataError unless samples reach over the whole run."""
        if self.hold == "exact":
            return
        late, short = self.t[0] > start + 1e-6 * step, self.t[-1] < stop - 1e-6 * step and self.hold != "zero"
        if late or short:
            begin = f"Begin the run there (start={self.t[0]:g})" if late and not short else "Shorten the run"
            raise DataError(
                f"input '{self.name}' is known from {self.t[0]:g} to {self.t[-1]:g} s, but the run goes "
                f"from {start:g} to {stop:g} s. {begin}, or give more samples."
            )

    def at(self, t: np.ndarray, order: int = 0, shift: float = 0.0) -> np.ndarray:
        """Values (or derivatives of an order) at ``t``; jumps are read ``shift`` s later, as their limit from there."""
        if self.function is not None:
            return self._exact(t, order)
        if self.hold == "cubic":
            return np.asarray(self._spline(np.clip(t, self.t[0], self.t[-1]), nu=order))
        if order > ORDERS[self.hold]:
            zero = "held constant between samples, but its derivative is needed. Give it hold='linear' or hold='cubic'."
            line = f"linear between samples, but its derivative of order {order} is needed. Give it hold='cubic'."
            raise DataError(f"input '{self.name}' is {zero if self.hold == 'zero' else line}")
        if self.hold == "linear" and order == 0:
            return np.interp(t, self.t, self.y)
        if self._steps is not None:
            start, step = self._steps
            begin = start + step * np.floor((t + shift - start) / step)
            return np.asarray((self._integral(begin + step) - self._integral(begin)) / step)
        last = np.searchsorted(self.t, t + shift, side="right") - 1
        return (self._derivatives if order else self.y)[np.clip(last, 0, len(self.t) - 1)]

    @cached_property
    def _derivatives(self) -> np.ndarray:
        """The derivative from each sample to the next; at the last sample the one before it."""
        made = np.diff(self.y) / np.diff(self.t)
        return np.append(made, made[-1] if len(made) else 0.0)

    def is_on_steps(self, start: float, step: float) -> bool:
        """Whether the samples lie on the steps, so that values are found by position."""
        if self.hold not in ("linear", "cubic") or len(self.t) < 2:
            return False
        if abs(self.t[0] - start) + abs(self.t[1] - self.t[0] - step) > 1e-9 * step:
            return False
        if self._grid[:2] != (start, step):
            steps = start + step * np.arange(len(self.t))
            self._grid = start, step, bool(np.abs(self.t - steps).max() <= 1e-9 * step)
        return self._grid[2]

    def averaged(self, start: float, step: float) -> Signal:
        """A held signal that is constant within steps: its mean over each, where it changes between steps."""
        if self.is_constant_within_steps(start, step):
            return self
        made = copy.copy(self)
        made._steps = (start, step)
        return made

    @cached_property
    def _areas(self) -> np.ndarray:
        """The integral of a held signal up to each of its samples."""
        return np.append(0.0, np.cumsum(self.y[:-1] * np.diff(self.t)))

    def _integral(self, t: np.ndarray) -> np.ndarray:
        """The integral of a held signal up to ``t``; before its samples it has the first value, and then the last."""
        last = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        return np.asarray(self._areas[last] + self.y[last] * (t - self.t[last]))

    def is_constant_within_steps(self, start: float, step: float) -> bool:
        """Whether the signal is held, and changes at steps only."""
        if self.function is not None or self.hold != "zero":
            return False
        at = (self.t[1:][np.diff(self.y) != 0] - start) / step
        return bool((np.abs(at - np.rint(at)) <= LATE_SAMPLE).all())

    def is_found_by_position(self, order: int, offset: float) -> bool:
        """Whether ``on_steps`` gives a derivative at a fraction of the steps: a cubic's own samples only."""
        return order <= 1 if self.hold == "linear" else order == 0 and offset in (0, 1)

    def on_steps(self, first: int, count: int, offset: float, order: int) -> np.ndarray:
        """Values at a fraction of the steps ``first`` ... ``first + count``, or the derivatives over those steps."""
        if order:
            return self._derivatives[first : first + count + 1]
        here = self.y[first : first + count + 1]
        if offset == 0:
            return here
        ahead = self.y[first + 1 : first + count + 2]
        ahead = ahead if len(ahead) == len(here) else np.append(ahead, here[-1])
        return ahead if offset == 1 else here + offset * (ahead - here)

    def _exact(self, t: np.ndarray, order: int) -> np.ndarray:
        """Values of a function of time."""
        if order:
            raise DataError(
                f"input '{self.name}' is a Python function, but its derivative is needed. "
                "Give samples with hold='cubic', or make it a source block."
            )
        try:
            values = np.asarray(self.function(t), dtype=float)
        except Exception as error:
            raise DataError(
                f"input '{self.name}': the function fails on an array of times, which it must take (use "
                f"np.where instead of if). {type(error).__name__}: {error}"
            ) from error
        if values.shape not in ((), t.shape):
            raise DataError(
                f"input '{self.name}': the function must give one value for each time, got shape "
                f"{values.shape} for times of shape {t.shape}."
            )
        values = np.broadcast_to(values, t.shape)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise DataError(f"input '{self.name}': the function gives {values[bad[0]]:g} at t = {t[bad[0]]:g} s.")
        return values

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline

        if len(self.t) < 4:
            raise DataError(f"input '{self.name}': hold='cubic' needs at least 4 samples, got {len(self.t)}.")
        return CubicSpline(self.t, self.y)


def _samples(name: str, given: Any, grid: np.ndarray | EvenInstants, hold: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Times [s], values and hold of an argument: samples, a pair of lists, values on the steps, or a number."""
    if hasattr(given, "t"):
        return _numbers(name, given.t), _numbers(name, given.y), given.hold
    if isinstance(given, tuple) and len(given) == 2 and all(hasattr(v, "__len__") for v in given):
        return _numbers(name, given[0]), _numbers(name, given[1]), hold
    values = _numbers(name, given)
    if values.ndim == 0:
        if not np.isfinite(values):
            raise DataError(f"input '{name}' must be a finite number, got {values:g}.")
        return np.array([grid[0], grid[-1]]), np.full(2, values), "zero"
    if values.ndim != 1:
        raise DataError(_kinds(name, given) + ".")
    if len(values) not in (len(grid), len(grid) - 1):
        raise DataError(
            f"input '{name}' has {len(values)} values, but the run has {len(grid)} instants. "
            "Give (times, values) when they are not on the steps."
        )
    return np.asarray(grid), values if len(values) == len(grid) else np.append(values, values[-1]), hold


def _numbers(name: str, given: Any) -> np.ndarray:
    """Numbers as floats, those that are masked as NaN. Raises DataError for text, times of day, complex numbers."""
    try:
        array = np.ma.asanyarray(given)
        if array.dtype.kind in "cSUmM":
            raise TypeError
        return np.ma.filled(array.astype(float, copy=False), np.nan)
    except (TypeError, ValueError, OverflowError):
        kind = f" of {given.dtype}" if hasattr(given, "dtype") and np.ndim(given) else ""
        raise DataError(_kinds(name, given) + kind + ".") from None


def _kinds(name: str, given: Any) -> str:
    """The message for an argument that is no input."""
    return f"input '{name}' must be a number, samples or a function of time, got {in_words(given)}"


def input_rows(
    signals: list[tuple[Signal, int]],
    start: float,
    step: float,
    first: int,
    count: int,
    offsets: tuple[float, ...],
    late: float = LATE_SAMPLE,
) -> np.ndarray:
    """Inputs at each instant of steps ``first`` … ``first+count``, shape (count+1, instants, inputs).

    A sample counts at an instant that it misses by less than the share ``late`` of a step.
    """
    made = np.empty((count + 1, len(offsets), len(signals)))
    if not signals:
        return made
    k = np.arange(first, first + count + 1)
    for i, offset in enumerate(offsets):
        t, shift = start + (k + offset) * step, late * step * (-1 if offset == 1 else 1)
        for j, (signal, order) in enumerate(signals):
            if signal.is_found_by_position(order, offset) and signal.is_on_steps(start, step):
                made[:, i, j] = signal.on_steps(first, count, offset, order)
            else:
                made[:, i, j] = signal.at(t, order, shift)
    return made
