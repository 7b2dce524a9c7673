"""Recordings made ready: what a measured input's noise would do to a model with memory is taken out first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.data.filters import FEWEST
from tsmblocks.data.rests import held_still
from tsmblocks.measures import rms


def conditioned(record: Record, inputs: Iterable[str]) -> Record:
    """The record with these signals low-passed with zero phase, and held still where they rest.

    A signal in which no noise stands out is left alone. Uneven samples are first put on an even grid.
    """
    if len(record) < FEWEST:
        return record
    even = record if record.uniform else record.resampled()
    names = [k for k in inputs if k in even and np.ptp(even[k]) > 0]
    if not names:
        return even
    made = even.filtered(names)
    signals, notes = dict(made.signals), []
    for name in names:
        noise = rms(made[name] - even[name])
        signals[name], share = held_still(made[name], made.step, noise)
        if share:
            notes.append(f"{name} was held still where it rests ({100 * share:.0f} % of the samples).")
    return attrs.evolve(made, signals=signals, notes=(*made.notes, *notes))


def all_conditioned(records: Mapping[str, Record], inputs: Iterable[str]) -> dict[str, Record]:
    """Every record conditioned."""
    names = tuple(inputs)
    return {name: conditioned(record, names) for name, record in records.items()}
