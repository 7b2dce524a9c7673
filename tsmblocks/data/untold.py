"""Units that nobody told: what a signal without one is taken for, when that is doubtful, and how to tell it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks import units
from tsmblocks.tables import listed

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

MOST = 4 * np.pi
"""Angle [rad] beyond which one without a unit was probably measured in degrees."""


class UnitWarning(UserWarning):
    """A signal without a unit that is probably not in the unit it is taken to be in."""


def untold(record: Record, wanted: Mapping[str, str]) -> list[str]:
    """Say which signals have no unit and what they are taken to be in; ``wanted`` gives that by name, ``""`` for none.

    One sentence for each unit, then one for each angle that would be many turns.
    """
    bare = {k: unit for k, unit in wanted.items() if unit and k in record and not record.unit(k)}
    made = []
    for unit in dict.fromkeys(bare.values()):
        names = [k for k, own in bare.items() if own == unit]
        have, are = ("have", "are") if len(names) > 1 else ("has", "is")
        made.append(f"{listed(names)} {have} no unit and {are} taken to be in {unit}.")
    return [*made, *doubtful(record, bare)]


def doubtful(record: Record, wanted: Mapping[str, str]) -> list[str]:
    """Say which angles without a unit would be many turns, a sentence for each."""
    made = []
    for name, unit in wanted.items():
        if name not in record or record.unit(name) or not unit or not _is_radian(unit):
            continue
        peak = float(np.abs(record[name]).max(initial=0.0))
        if peak > MOST:
            turns = f"{peak / (2 * np.pi):.3g} turns"
            made.append(f"{name} goes up to {peak:.4g}, which would be {turns}: it is probably in deg.")
    return made


def how_to_map(name: str, *, bare: bool) -> str:
    """Say how a column of another name is mapped: with its unit, where columns are ``bare`` of theirs."""
    heading = f"{name} [deg]" if bare else name
    return f"map={{'{heading}': 'COLUMN'}}, or --map '{heading}=COLUMN'"


def _is_radian(label: str) -> bool:
    try:
        return units.same(label, "rad")
    except units.UnitError:
        return False
