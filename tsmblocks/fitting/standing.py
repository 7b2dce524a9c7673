"""Inputs that stand still and jump: between the samples before and after a jump they are not what was recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from tsmblocks.data import Record

STILL = 0.5
"""Share of the steps between samples that leave the input where it is."""
JUMP = 0.05
"""Size of its largest step, as a share of all that it moves: less is a quantised motion."""


def standing(record: Record, inputs: Iterable[str], hold: str) -> Iterator[str]:
    """What to mind of inputs that stand still and jump, unless they are taken as held from sample to sample."""
    for name in (k for k in inputs if k in record and hold != "zero"):
        steps = np.abs(np.diff(record[name]))
        size = float(np.ptp(record[name]))
        if size > 0 and np.mean(steps == 0) >= STILL and steps.max() >= JUMP * size:
            yield (f"the input {name} stands still and jumps, and between two samples a jump is drawn out "
                   f"(hold='{hold}'). If it was held from sample to sample, as a controller holds its command, say "
                   "hold='zero', or --hold zero.")  # fmt: skip
