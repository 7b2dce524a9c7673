"""Signals without a unit: the unit they are taken to be in, when that is doubtful, and how a unit is given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tsmblocks.common import displayed_units, units
from tsmblocks.common.errors import DataError, nearest
from tsmblocks.common.tables import listed

if TYPE_CHECKING:
    from tsmblocks.data.record import Record

MAX_PLAUSIBLE_ANGLE = 4 * np.pi
"""Angle [rad] beyond which one without a unit was probably measured in degrees. Chosen: two turns, more than the
mechanisms of the paper make."""


def assumed_units(record: Record, wanted: Mapping[str, str]) -> list[str]:
    """Name signals without a unit and the unit assumed for them; ``wanted`` gives that by name, ``""`` for none.

    One sentence for each unit.
    """
    names: dict[str, list[str]] = {}
    for name, unit in _bare(record, wanted).items():
        names.setdefault(unit, []).append(name)
    return [
        f"{listed(those)} {'have no unit and are' if len(those) > 1 else 'has no unit and is'} taken to be in {unit}."
        for unit, those in names.items()
    ]


def likely_unit(unit: str) -> str:
    """A unit in which a signal that a model takes in ``unit`` may be recorded instead: ``deg`` for ``rad``, ``mm``."""
    return next(iter(other_units(unit)), unit)


def other_units(unit: str) -> list[str]:
    """Units of the same quantity in which a signal may be recorded instead, the likeliest first."""
    if not units.is_unit(unit):
        return []
    made = [unit.replace("rad", "deg")] if "rad" in unit else []
    made += [f"{prefix}{unit}" for prefix in "mkuM"]
    made += ["rpm"] if units.same(unit, "rad/s") else []
    known = (k for k in made if k != unit and units.is_unit(k))
    return [k for k in known if units.parse(k).dimension == units.parse(unit).dimension]


def as_argument(names: Sequence[str]) -> str:
    """How signals of these names are given a unit in Python."""
    entries = ", ".join(f"'{name}': 'deg'" for name in names)
    return f"units={{{entries}}}, or 'rad'"


def refuse_doubtful(
    where: str, record: Record, wanted: Mapping[str, str], usage: Callable[[Sequence[str]], str] = as_argument
) -> None:
    """Raise DataError where angles without a unit would be many turns: every result from them would be wrong.

    ``wanted`` is as for assumed_units, ``where`` what the message calls the record, ``usage`` says how units are given.
    """
    peaks = {
        k: float(np.abs(record[k]).max(initial=0.0))
        for k, unit in _bare(record, wanted).items()
        if units.same(unit, "rad")
    }
    peaks = {k: peak for k, peak in peaks.items() if peak > MAX_PLAUSIBLE_ANGLE}
    if not peaks:
        return
    names, sizes = [*peaks], listed([f"{peak:.4g}" for peak in peaks.values()])
    turns = listed([f"{peak / (2 * np.pi):.3g}" for peak in peaks.values()])
    have, reach, are, s = ("has", "reaches", "it is", "") if len(peaks) == 1 else ("have", "reach", "they are", "s")
    raise DataError(
        f"{where}: {listed(names)} {have} no unit and {reach} {sizes}, which in rad would be {turns} "
        f"turns: {are} probably in deg. Give the unit{s}: {usage(names)} where that is meant."
    )


def map_argument(title: str, column: str = "COLUMN") -> str:
    """How a column is mapped to a name, perhaps with a unit, in Python and by a command."""
    return f"map={{'{title}': '{column}'}}, or --map '{title}={column}'"


def how_to_map(name: str, *, bare: bool, known: Iterable[str] = (), unit: str = "") -> str:
    """How a column is mapped: that of the nearest name, if any, else one with a unit where they are ``bare``.

    ``unit`` is that of the diagram, where it is known.
    """
    close = nearest(name, known)
    shown = displayed_units.display_unit(unit)[1] or "deg"
    return map_argument(name, close) if close else map_argument(f"{name} [{shown}]" if bare else name)


def _bare(record: Record, wanted: Mapping[str, str]) -> dict[str, str]:
    """The units that signals without one are taken to be in."""
    return {k: unit for k, unit in wanted.items() if unit and k in record and not record.unit(k)}
