"""All experiments of a fit simulated one after the other, with the memory of their runs made at once.

A recording cut into pieces makes a hundred short experiments: preparing each of them alone takes longer than its run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.sensitivities import tangent_memories
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.simulation.lanes import batch_kernel, directions, lane_memories

LANES = 32
"""Parameter sets side by side in one run; a population is a multiple of it. Chosen, as ``MOST_DIRECTIONS``."""

FEW_LANES = 8
"""The same for a few runs of a model. Chosen: the code of fewer lanes is compiled faster, and is one for all counts."""
MANY_EXPERIMENTS = 40
"""Experiments from which a few runs take up to ``LANES`` as well. Chosen: each lane group is prepared in 0.1 ms for
each experiment, and the code of another width compiled in 10 ms."""


Prepared = tuple[Kernel, Memory]
"""A kernel, and the memory of one run with it before its first step."""


def outputs(experiments: Sequence[Experiment], p: np.ndarray) -> Iterator[np.ndarray]:
    """Simulated outputs (samples, outputs) of each experiment; ``p`` has shape (experiments, parameters)."""
    made = _prepared(experiments, p[:, :, None], lambda first: first.kernel)
    for experiment, (kernel, memory) in zip(experiments, made, strict=True):
        yield experiment.output_columns(kernel, experiment.run(kernel, memory))


def derivatives(
    experiments: Sequence[Experiment], p: np.ndarray, seeds: np.ndarray
) -> Iterator[tuple[np.ndarray, list[np.ndarray]]]:
    """Simulated outputs of each experiment, and their derivatives along ``seeds``.

    ``p`` has shape (experiments, parameters), ``seeds`` (experiments, parameters, directions). For each experiment the
    outputs have the shape (samples, outputs), and the derivatives (samples, directions) for each output.
    """
    width = seeds.shape[2]
    lanes = directions(width)
    starts = range(0, max(width, 1), lanes)
    groups = [_tangents(experiments, p, seeds[:, :, first : first + lanes], lanes) for first in starts]
    for experiment, *runs in zip(experiments, *groups, strict=True):
        parts = list[list[np.ndarray]]()
        for first, (kernel, memory) in zip(starts, runs, strict=True):
            y, part = experiment.split(kernel, experiment.run(kernel, memory), min(lanes, width - first))
            parts.append(part)
        yield y, [np.hstack(wide) if len(wide) > 1 else wide[0] for wide in zip(*parts, strict=True)]


def _tangents(experiments: Sequence[Experiment], p: np.ndarray, seeds: np.ndarray, lanes: int) -> list[Prepared]:
    """Runs with derivatives along ``seeds`` (experiments, parameters, directions), at most ``lanes`` directions."""
    padded = np.concatenate([seeds, np.zeros((*seeds.shape[:2], lanes - seeds.shape[2]))], axis=2)

    def made(some: Sequence[Experiment], at: list[int]) -> tuple[Kernel, list[Memory]]:
        kernel = some[0].kernel_with_derivatives(lanes)
        return kernel, tangent_memories(some[0].eq, kernel, p[at], padded[at], [one.times.h for one in some])

    return _by_equations(experiments, made)


def output_sets(experiments: Sequence[Experiment], p: np.ndarray, vary: frozenset[int]) -> Iterator[np.ndarray]:
    """Outputs (samples, outputs, sets) of each experiment, for ``p`` (experiments, parameters, sets) side by side.

    The sets differ in the places ``vary``. For a few runs of a model: its code is compiled quickly and runs slower.
    """
    width = FEW_LANES if len(experiments) <= MANY_EXPERIMENTS else LANES
    groups = [lane_runs(experiments, p[:, :, k : k + width], vary, quick=True) for k in range(0, p.shape[2], width)]
    for experiment, *runs in zip(experiments, *groups, strict=True):
        parts = [experiment.output_lanes(kernel, experiment.run(kernel, memory)) for kernel, memory in runs]
        yield np.concatenate(parts, axis=2)[:, :, : p.shape[2]]


def lane_runs(
    experiments: Sequence[Experiment], p: np.ndarray, vary: frozenset[int], *, quick: bool = False
) -> list[Prepared]:
    """The runs of each experiment with as many sets as ``p`` (experiments, parameters, sets) has, side by side.

    Lanes without a set repeat the last one; ``vary`` as above, ``quick`` as for ``kernel_for``.
    """
    lanes = lanes_for(p.shape[2])
    padded = p[:, :, np.minimum(np.arange(lanes), p.shape[2] - 1)]

    def kernel(first: Experiment) -> Kernel:
        return batch_kernel(first.eq, first.rule, first.columns, lanes, vary, first.backend, quick)

    return _prepared(experiments, padded, kernel)


def lanes_for(count: int) -> int:
    """Lanes for so many parameter sets; beyond ``LANES`` they take several runs."""
    return next((few for few in (FEW_LANES, 16) if count <= few), LANES)


def _prepared(
    experiments: Sequence[Experiment], p: np.ndarray, kernel_of: Callable[[Experiment], Kernel]
) -> list[Prepared]:
    """The runs of experiments with the parameters ``p`` (experiments, parameters, lanes)."""

    def made(some: Sequence[Experiment], at: list[int]) -> tuple[Kernel, list[Memory]]:
        kernel = kernel_of(some[0])
        return kernel, lane_memories(some[0].eq, kernel, p[at], [one.times.h for one in some])

    return _by_equations(experiments, made)


def _by_equations(
    experiments: Sequence[Experiment], made: Callable[[Sequence[Experiment], list[int]], tuple[Kernel, list[Memory]]]
) -> list[Prepared]:
    """Kernel and memory of each experiment; those with the same equations have one kernel.

    The equations differ where a delayed input is held in some experiments only. ``made`` takes some of them, and their
    places in the list.
    """
    places = dict[int, list[int]]()
    for k, one in enumerate(experiments):
        places.setdefault(id(one.eq), []).append(k)
    found = dict[int, Prepared]()
    for at in places.values():
        kernel, memories = made([experiments[k] for k in at], at)
        found |= {k: (kernel, memory) for k, memory in zip(at, memories, strict=True)}
    return [found[k] for k in range(len(experiments))]
