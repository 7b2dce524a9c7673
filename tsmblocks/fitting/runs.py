"""All experiments of a fit simulated one after the other, with the memory of their runs made at once.

A recording cut into pieces makes a hundred short experiments: preparing each of them alone takes longer than its run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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


def outputs(experiments: Sequence[Experiment], p: np.ndarray) -> Iterator[np.ndarray]:
    """Simulated outputs (samples, outputs) of each experiment; ``p`` has shape (experiments, parameters)."""
    first = experiments[0]
    kernel = first.kernel
    for experiment, memory in zip(experiments, _memories(experiments, kernel, p[:, :, None]), strict=True):
        yield experiment.output_columns(kernel, experiment.run(kernel, memory))


def derivatives(
    experiments: Sequence[Experiment], p: np.ndarray, seeds: np.ndarray
) -> Iterator[tuple[np.ndarray, list[np.ndarray]]]:
    """Simulated outputs of each experiment, and their derivatives along ``seeds``.

    ``p`` has shape (experiments, parameters), ``seeds`` (experiments, parameters, directions). For each experiment the
    outputs have the shape (samples, outputs), and the derivatives (samples, directions) for each output.
    """
    one, width = experiments[0], seeds.shape[2]
    lanes = directions(width)
    kernel = one.kernel_with_derivatives(lanes)
    steps, groups = [experiment.times.h for experiment in experiments], list[list[Memory]]()
    for first in range(0, max(width, 1), lanes):
        part = seeds[:, :, first : first + lanes]
        part = np.concatenate([part, np.zeros((*part.shape[:2], lanes - part.shape[2]))], axis=2)
        groups.append(tangent_memories(one.eq, kernel, p, part, steps))
    for experiment, *memories in zip(experiments, *groups, strict=True):
        parts = list[list[np.ndarray]]()
        for first, memory in zip(range(0, max(width, 1), lanes), memories, strict=True):
            y, part = experiment.split(kernel, experiment.run(kernel, memory), min(lanes, width - first))
            parts.append(part)
        yield y, [np.hstack(wide) if len(wide) > 1 else wide[0] for wide in zip(*parts, strict=True)]


def output_sets(experiments: Sequence[Experiment], p: np.ndarray, vary: frozenset[int]) -> Iterator[np.ndarray]:
    """Outputs (samples, outputs, sets) of each experiment, for ``p`` (experiments, parameters, sets) side by side.

    The sets differ in the places ``vary``. For a few runs of a model: its code is compiled quickly and runs slower.
    """
    width = FEW_LANES if len(experiments) <= MANY_EXPERIMENTS else LANES
    groups = [lane_runs(experiments, p[:, :, k : k + width], vary, quick=True) for k in range(0, p.shape[2], width)]
    for e, experiment in enumerate(experiments):
        parts = [experiment.output_lanes(kernel, experiment.run(kernel, made[e])) for kernel, made in groups]
        yield np.concatenate(parts, axis=2)[:, :, : p.shape[2]]


def lane_runs(
    experiments: Sequence[Experiment], p: np.ndarray, vary: frozenset[int], *, quick: bool = False
) -> tuple[Kernel, list[Memory]]:
    """A kernel for as many sets as ``p`` (experiments, parameters, sets) has, and the memory of each experiment.

    Lanes without a set repeat the last one; ``vary`` as above, ``quick`` as for ``kernel_for``.
    """
    first, lanes = experiments[0], lanes_for(p.shape[2])
    kernel = batch_kernel(first.eq, first.rule, first.columns, lanes, vary, first.backend, quick)
    padded = p[:, :, np.minimum(np.arange(lanes), p.shape[2] - 1)]
    return kernel, _memories(experiments, kernel, padded)


def lanes_for(count: int) -> int:
    """Lanes for so many parameter sets; beyond ``LANES`` they take several runs."""
    return next((few for few in (FEW_LANES, 16) if count <= few), LANES)


def _memories(experiments: Sequence[Experiment], kernel: Kernel, p: np.ndarray) -> list[Memory]:
    return lane_memories(experiments[0].eq, kernel, p, [experiment.times.h for experiment in experiments])
