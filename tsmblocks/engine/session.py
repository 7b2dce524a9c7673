"""One run of one set of equations: memory, inputs piece by piece, progress, detection of divergence."""

from __future__ import annotations

import functools
import math
import time as clock
from collections.abc import Callable, Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import DataError, RunError, in_words, near
from tsmblocks.common.interpolation import AUTO, Hold, hold_of_each
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.engine.backends import kernel_for
from tsmblocks.engine.equations import Equations, function_values
from tsmblocks.engine.inputs import EvenInstants, Signal, input_rows
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import plan_for

MOST_DELAY_STEPS = 1e8
"""Steps that a delay may be long. Chosen: its past takes 1 GB."""
SPARE_INSTANTS = 8
"""Instants stored of a delayed signal beyond its delay. Derived: more than ``DELAY_SAMPLES`` and one stage ahead."""
PIECE_SECONDS = 0.2
"""Time [s] that a kernel runs before Ctrl-C and the progress callback are served. Chosen: short for a person."""


@functools.lru_cache(maxsize=48)
def single_kernel(eq: Equations, method: Method, y: tuple[int, ...], backend: str, quick: bool = False) -> Kernel:
    """A kernel for one run at a time (kept, since equations are compared by identity); ``quick`` as for
    ``kernel_for``.
    """
    return kernel_for(plan_for(eq, method, y), backend, quick)


def steps_per_period(eq: Equations, h: float) -> tuple[int, ...]:
    """Steps between samples of each rate group. Raises RunError when a period is no multiple of the step."""
    made = []
    for period in eq.periods:
        n = round(period / h)
        if n < 1 or not math.isclose(n * h, period, rel_tol=1e-9):
            owner = next(k for k, v in eq.sampled.items() if v == period)
            raise RunError(
                f"the sample period {period:g} s of {owner} is not a multiple of the step {h:g} s."
                f"{_shorter_step(eq.periods, period, h)}"
            )
        made.append(n)
    return tuple(made)


def _shorter_step(periods: tuple[float, ...], period: float, h: float) -> str:
    """A hint with a step of few digits, no longer than ``h``, of which every period is a multiple."""
    least = math.ceil(period / h)
    for n in range(least, 100 * least):
        step = float(f"{period / n:.4g}")
        if all(math.isclose(round(p / step) * step, p, rel_tol=1e-9) for p in periods):
            return f" A step of {step:g} s would do."
    return ""


def check_delays(eq: Equations, p: np.ndarray, h: float) -> np.ndarray:
    """Delays in steps. Raises RunError for one longer than ``MOST_DELAY_STEPS``, or below its least length."""
    if not eq.q:
        return np.empty(0)
    tau = function_values(eq.lag, p)[0] / h
    for name, steps, least in zip(eq.q, tau, eq.min_delay_steps, strict=True):
        if steps > MOST_DELAY_STEPS:
            raise RunError(
                f"the delay of {name} is {steps * h:g} s, which is {steps:.1g} steps; at most "
                f"{MOST_DELAY_STEPS:.0g} are possible. Use a longer step."
            )
        if not steps >= least - 1e-9:
            raise RunError(
                f"the delay of {name} is {steps * h:g} s, shorter than the step of {h:g} s. "
                "Use a smaller step, or a DeadTime instead."
            )
    size = 8.0 * len(tau) * delay_capacity(tau)
    refuse_too_large(size, f"the past of {len(tau)} delayed signals", "Use a longer step.", RunError)
    return tau


def delay_capacity(tau: np.ndarray) -> int:
    """Instants stored of each delayed signal: a power of two above the longest delay [steps] and those read at once."""
    return 1 << int(max(tau, default=0) + SPARE_INSTANTS).bit_length()


def start_memory(
    eq: Equations, kernel: Kernel, p: np.ndarray, h: float, start: Mapping[str, float] | None = None
) -> Memory:
    """Memory before the first step, for one run."""
    x, d, s = function_values(eq.start, p)
    if start is not None and not isinstance(start, Mapping):
        raise RunError(
            f"initial must map states to their initial values, or be the state of a run, got {in_words(start)}."
        )
    for name, value in (start or {}).items():
        value = as_number(f"the initial state '{name}'", value)
        if name in eq.x:
            x[eq.x.index(name)] = value
        elif name in eq.d:
            d[eq.d.index(name)] = value
        else:
            raise RunError(f"diagram '{eq.title}' has no state '{name}'.{near(name, [*eq.x, *eq.d])}")
    return kernel.memory(x, d, p, s, delay_capacity(check_delays(eq, p, h)))


def gather_signals(
    eq: Equations, inputs: Mapping[str, Any], grid: np.ndarray | EvenInstants, hold: Hold
) -> list[tuple[Signal, int]]:
    """Signal and order of derivative of each sampled input. Raises DataError for missing or unknown inputs."""
    wanted = [f.name for f in eq.u if not f.block and not f.order]
    for name in inputs:
        if name not in wanted:
            raise DataError(f"diagram '{eq.title}' has no input '{name}'.{near(name, wanted)}")
    missing = [name for name in wanted if name not in inputs]
    if missing:
        units = ", ".join(f"{f.name}{f' [{f.unit}]' if f.unit else ''}" for f in eq.u if f.name in missing)
        noun = "inputs" if len(missing) > 1 else "input"
        raise DataError(f"diagram '{eq.title}' needs its {noun} {units}: give inputs={{'{missing[0]}': samples}}.")
    span = (float(grid[0]), float(grid[-1]))
    taped = {block: source(*span) for block, source in eq.tapes.items()}
    step = float(grid[1] - grid[0]) if len(grid) > 1 else 1.0
    holds, orders = hold_of_each(hold, wanted), eq.orders
    known: dict[str, Signal] = {}
    made = []
    for feed in eq.u:
        name = feed.name.removeprefix("d/dt " * feed.order)
        if name not in known:
            how = holds.get(name, AUTO)
            given = taped[feed.block][feed.tape] if feed.block else _sampled(inputs[name], name, feed.unit, how)
            known[name] = Signal(name, given, grid, how, orders[name])
            known[name].covers(*span, step)
        made.append((known[name], feed.order))
    return made


def _sampled(given: Any, name: str, unit: str, hold: str) -> Any:
    """The samples of an input: of a recording or a run its signal of that name, in the input's unit."""
    given = given.record(name) if hasattr(given, "record") else given
    return given.samples(name, unit or None, hold) if hasattr(given, "samples") else given


@attrs.define(eq=False)
class Session:
    """A run in progress. ``advance`` takes steps and returns the logged rows; ``memory`` is the state.

    ``events`` is used by sessions that locate switching instants only. ``cut`` is an
    instant that lies within a step of the grid, where a sample counts once it has come, not a little before. ``marks``
    are the step counter and the memory at each ``mark_every``-th step of a call of ``run``, the first after its start;
    none with ``mark_every`` 0.
    """

    eq: Equations
    kernel: Kernel
    memory: Memory
    signals: list[tuple[Signal, int]]
    start: float
    h: float
    every: int = 1
    k: int = 0
    hits: tuple[int, ...] = ()
    events: list[Any] = attrs.field(factory=list)
    cut: int | None = None
    mark_every: int = 0
    marks: list[tuple[int, Memory]] = attrs.field(factory=list)

    def rows_in(self, n: int, final: bool) -> int:
        """Number of logged instants within the next n steps."""
        stop = self.k + n + (1 if final else 0)
        return (stop + self.every - 1) // self.every - (self.k + self.every - 1) // self.every

    def rows_for(self, n: int, final: bool) -> np.ndarray:
        """Space for the rows that the next n steps log."""
        return np.empty((self.rows_in(n, final), self.kernel.layout_y.size))

    def advance(self, n: int, final: bool, y: np.ndarray) -> None:
        """Take n steps, writing the rows logged into ``y``, shape (rows, size of a row)."""
        kernel = self.kernel
        u = self.inputs(self.k, n)
        steps = Steps(self.start, self.h, self.k, n, final, self.hits, self.every, -self.k % self.every)
        kernel.advance(self.memory, u, y, steps)
        self.k += n

    def inputs(self, k: int, n: int) -> np.ndarray:
        """Sampled inputs of n steps from the k-th on, and at the instant after them."""
        grid, instants = (self.start, self.h), self.kernel.plan.method.instants
        u = input_rows(self.signals, *grid, k, n, instants)
        if k + n == self.cut:
            u[-1] = input_rows(self.signals, *grid, k + n, 0, instants, late=0.0)[0]
        return u

    def run(self, steps: int, progress: Callable[[float], None] | None) -> tuple[np.ndarray, Stopped | None]:
        """Run ``steps`` steps, or up to where the run diverges or is interrupted."""
        rows, count, first, steps = self.rows_for(steps, True), 0, self.k, self.k + steps
        piece, safe = 4096, (count, self.k, self.memory.copy())
        try:
            while True:
                began = clock.perf_counter()
                n = min(piece, steps - self.k)
                if self.mark_every:
                    n = min(n, self.mark_every - (self.k - first) % self.mark_every)
                final = self.k + n == steps
                y = rows[count : count + self.rows_in(n, final)]
                self._logged_steps(n, final, y)
                with np.errstate(over="ignore", invalid="ignore"):  # of finite numbers as well
                    total = y.sum() + self.memory.x.sum()
                if not math.isfinite(total):
                    stopped = self._early_end(y, safe[2], safe[1], n)
                    if stopped is not None:
                        return rows[: count + stopped.rows], stopped
                count += len(y)
                if final:
                    return rows, None
                safe = (count, self.k, self.memory.copy())
                if self.mark_every and (self.k - first) % self.mark_every == 0:
                    self.marks.append(safe[1:])
                if progress is not None:
                    progress((self.k - first) / (steps - first))
                took = max(clock.perf_counter() - began, 1e-6)
                piece = int(np.clip(piece * PIECE_SECONDS / took, 1024, 1 << 20))
        except KeyboardInterrupt:
            count, self.k, self.memory = safe  # Ctrl-C comes anywhere; up to here all rows are complete
            return rows[:count], Stopped(self.k, 0, self.memory, interrupted=True)

    def _logged_steps(self, n: int, final: bool, y: np.ndarray) -> None:
        """Take n steps. The last instant is logged on a copy: a run continued from there samples it once."""
        count = self.rows_in(n, False)
        self.advance(n, False, y[:count])
        y[count:] = np.nan
        if final and np.isfinite(self.memory.x).all():
            rest = self.memory.copy()
            self.advance(0, True, y[count:])
            self.memory = rest

    def _early_end(self, y: np.ndarray, before: Memory, k: int, n: int) -> Stopped | None:
        bad = np.flatnonzero(~np.isfinite(y).all(axis=1))
        if not len(bad) and np.isfinite(self.memory.x).all():
            return None  # the sum overflowed, no number did
        return Stopped(k, int(bad[0]) if len(bad) else len(y), before, interrupted=False, steps=n)


@attrs.frozen(eq=False)
class Stopped:
    """Where a run ended early: the last step known to be finite, finite rows after it, and the memory there."""

    k: int
    rows: int
    memory: Memory
    interrupted: bool
    steps: int = 0
