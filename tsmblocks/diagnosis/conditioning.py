"""Recordings made ready: what a measured input's noise would do to a model with memory is taken out first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tsmblocks.data import Record
from tsmblocks.data.conditioning import conditioned


def all_conditioned(records: Mapping[str, Record], inputs: Iterable[str]) -> dict[str, Record]:
    """Every record conditioned."""
    names = tuple(inputs)
    return {name: conditioned(record, names) for name, record in records.items()}


__all__ = ["all_conditioned"]
