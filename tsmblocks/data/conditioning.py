"""A recording made ready: what a measured input's noise would do to a model with memory is taken out first."""

from __future__ import annotations

from collections.abc import Iterable

import attrs
import numpy as np

from tsmblocks.data.filters import FEWEST
from tsmblocks.data.record import Record
from tsmblocks.data.rests import held_still


def conditioned(record: Record, inputs: Iterable[str]) -> Record:
    """See Record.conditioned."""
    if len(record) < FEWEST:
        return record
    even = record if record.uniform else record.resampled()
    names = [k for k in inputs if k in even and np.ptp(even[k]) > 0]
    if not names:
        return even
    made = even.filtered(names)
    signals, notes = dict(made.signals), []
    for name in names:
        noise = float(np.sqrt(np.mean((made[name] - even[name]) ** 2)))
        signals[name], share = held_still(made[name], made.step, noise)
        if share:
            notes.append(f"{name} was held still where it rests ({100 * share:.0f} % of the samples).")
    return attrs.evolve(made, signals=signals, notes=(*made.notes, *notes))
