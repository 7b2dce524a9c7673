"""The error of a fit due to the noise of measured inputs: how far the parameters move when the inputs are filtered."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import TsmError
from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import listed
from tsmblocks.data import Record
from tsmblocks.data.fast_noise import sample_to_sample_noise
from tsmblocks.fitting.above_noise import NEGLIGIBLE
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.setup import Setup

WHITE = 1.5
"""What a filter takes from an input, relative to the noise from sample to sample, up to which it is noise. Chosen: at
corners of the motion it takes more."""


def filtered_problem(problem: Problem, setup: Setup) -> tuple[Problem, list[str]]:
    """The same problem with its inputs filtered, and the names of those that are noisy."""
    noisy = dict[str, None]()
    experiments = list(problem.experiments)
    for e, experiment in enumerate(setup.experiments):
        record, names = _filtered(experiment.record, tuple(setup.diagram.inports))
        if names:
            try:
                experiments[e] = setup.prepared(e, record=record)
            except TsmError:  # the filtered input is no longer valid for a block
                continue
            noisy |= dict.fromkeys(names)
    return attrs.evolve(problem, experiments=tuple(experiments)), [*noisy]


@functools.lru_cache(maxsize=32)  # one recording is fitted many times
def _filtered(record: Record, names: Sequence[str]) -> tuple[Record, list[str]]:
    """A recording with its noisy inputs filtered, and their names; none where its samples are uneven."""
    made = record.conditioned(names)
    if not np.array_equal(made.t, record.t):
        return record, []
    noisy = []
    for name in names:
        x = record[name]
        removed = float(np.sqrt(np.mean((made[name] - x) ** 2)))
        if NEGLIGIBLE * np.std(x) < removed <= WHITE * sample_to_sample_noise(record.t, x).floor:
            noisy.append(name)
    return (record.conditioned(noisy), noisy) if noisy else (record, [])


def input_noise_note(names: Sequence[str], changes: np.ndarray, inputs: list[str], covered: float) -> list[str]:
    """A warning where the intervals do not cover the noise of the inputs; ``changes`` as of ``shifts``."""
    if not len(changes) or not covered < changes.max() < np.inf:
        return []
    worst = int(np.argmax(changes))
    them, listing = ("them", "have") if len(inputs) > 1 else ("it", "has")
    return [
        f"{listed(inputs)} {listing} noise that moves {names[worst]} by {to_digits(changes[worst])} times the half "
        f"width of its interval, which does not cover it. Filter {them} first: conditioned({inputs})."
    ]
