"""Several runs side by side in SIMD lanes: kernels, memory, and the columns of each lane."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.engine.backends import kernel_for
from tsmblocks.engine.equations import Equations, function_values
from tsmblocks.engine.inputs import Signal, input_rows
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import plan_for
from tsmblocks.engine.sensitivities import tangent_plan
from tsmblocks.engine.session import check_delays, delay_capacity, steps_per_period
from tsmblocks.simulation.arguments import TimeGrid

MOST_KERNELS = 48
"""Kernels of a kind that are kept, each of which takes 0.8 MB. Chosen: a fit uses a few, a round of a diagnosis some
fifty."""
MOST_DIRECTIONS = 32
"""Directions of derivatives side by side in one run. Chosen: registers hold the states of usual diagrams."""


@functools.lru_cache(maxsize=MOST_KERNELS)
def batch_kernel(
    eq: Equations,
    method: Method,
    y: tuple[int, ...],
    lanes: int,
    vary: frozenset[int],
    backend: str,
    quick: bool = False,
) -> Kernel:
    """A kernel with one parameter set per lane (cached); ``quick`` as for ``kernel_for``."""
    return kernel_for(plan_for(eq, method, y, lanes=lanes, vary=vary), backend, quick)


@functools.lru_cache(maxsize=MOST_KERNELS)
def tangent_kernel(
    eq: Equations, method: Method, y: tuple[int, ...], lanes: int, backend: str, quick: bool = False
) -> Kernel:
    """A kernel with one seed direction per lane (cached); ``quick`` as for ``kernel_for``."""
    return kernel_for(tangent_plan(eq, method, y, lanes), backend, quick)


@functools.lru_cache(maxsize=64)
def _start_function(eq: Equations, sets: int) -> Any:
    """Initial states of many sets at once (cached: making the function takes longer than a call)."""
    return eq.start.map(sets)


def lane_memory(eq: Equations, kernel: Kernel, p: np.ndarray, h: float) -> Memory:
    """Memory before the first step, one parameter set per lane; ``p`` has shape (parameters, lanes)."""
    return lane_memories(eq, kernel, p[None], [h])[0]


def lane_memories(eq: Equations, kernel: Kernel, p: np.ndarray, h: Sequence[float]) -> list[Memory]:
    """As ``lane_memory`` for many runs: ``p`` has shape (runs, parameters, lanes)."""
    runs, _, lanes = p.shape
    sets = p.transpose(0, 2, 1)
    starts = function_values(_start_function(eq, runs * lanes), sets)
    x, d, s = (v.reshape(runs, lanes, -1).transpose(0, 2, 1) for v in starts)
    capacities = [
        delay_capacity(np.concatenate([check_delays(eq, one, step) for one in run]))
        for run, step in zip(sets, h, strict=True)
    ]
    return kernel.memories(x, d, p, s, capacities)


def whole_run(
    eq: Equations, kernel: Kernel, signals: list[tuple[Signal, int]], times: TimeGrid
) -> Callable[[Memory], np.ndarray]:
    """A function that runs from given memory to the end and returns the rows that are kept."""
    instants = len(kernel.plan.method.instants)
    size = 8.0 * (times.steps * instants * len(signals) + times.kept * kernel.layout_y.size)
    refuse_too_large(size, f"the run of {times.steps:,} steps", "Take a longer step, or every.", RunError)
    rows = input_rows(signals, times.start, times.h, 0, times.steps, kernel.plan.method.instants)
    steps = Steps(times.start, times.h, 0, times.steps, True, steps_per_period(eq, times.h), times.every)

    def run(memory: Memory) -> np.ndarray:
        y = np.empty((times.kept, kernel.layout_y.size))
        kernel.advance(memory, rows, y, steps)
        return y

    return run


def lane_columns(y: np.ndarray, kernel: Kernel, k: int, lanes: int) -> np.ndarray:
    """One logged signal as (N, lanes), whether or not it differs between lanes."""
    part = y[:, kernel.layout_y.span(k)]
    return part if part.shape[1] == lanes else np.broadcast_to(part, (len(part), lanes))


def directions(count: int) -> int:
    """Lanes for ``count`` directions of derivatives; above ``MOST_DIRECTIONS`` they take several runs."""
    return min(MOST_DIRECTIONS, _power_of_two(count))


def _power_of_two(n: int) -> int:
    """The smallest power of two that holds n, at least 2 (a lone lane is an ordinary run)."""
    return max(2, 1 << (n - 1).bit_length())


def lanes_for(count: int, states: int) -> int:
    """Sets side by side: 32 lanes while the states fit into the registers, 16 above; fewer for a small batch."""
    return min(_power_of_two(count), 32 if states <= 10 else 16)
