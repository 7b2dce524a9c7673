"""The noise of a measured output, as all recordings together show it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsmblocks.data import Record, fast_noise, noise
from tsmblocks.diagram import Diagram

WEAK = "high frequencies"
"""The way of finding a floor that misses slow noise: no model may be called wrong by it alone."""


def noise_of(records: Mapping[str, Record], diagram: Diagram, name: str) -> tuple[float, str]:
    """The noise of an output [unit of the diagram] and how it was found.

    It is the middle of what the experiments say, those before others that show more than fast noise.
    """
    inputs = [k for k in diagram.inports if all(k in r for r in records.values())]
    found = [(noise(r, name, inputs=inputs or None), r) for r in records.values()]
    sound = [one for one in found if one[0].method != WEAK] or found
    values = [n.floor * r.factor(name, diagram.unit(name)) for n, r in sound]
    methods = [n.method for n, _ in sound]
    return float(np.median(values)), max(sorted(set(methods)), key=methods.count)


def fast_noise_of(records: Mapping[str, Record], diagram: Diagram, name: str) -> float:
    """What changes from sample to sample in an output [unit of the diagram]: the middle of what the experiments say."""
    return float(np.median([fast_noise(r, name) * r.factor(name, diagram.unit(name)) for r in records.values()]))
