"""What a measurement is once it has been read: signals with units on one increasing time axis."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType

import attrs
import numpy as np

from tsmblocks import units
from tsmblocks.block import Samples
from tsmblocks.errors import DataError, near

_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))?\s*")


def split_heading(text: str) -> tuple[str, str]:
    """Name and unit of ``"x_in [deg]"`` or ``"x_in (deg)"``; the unit is ``""`` when none is given."""
    match = _HEADING.fullmatch(text)
    assert match is not None  # every part is optional
    return match[1], (match[2] or match[3] or "").strip()


def heading(name: str, unit: str) -> str:
    """``name [unit]``, or the name alone when no unit is known."""
    return f"{name} [{unit}]" if unit else name


def _still(values: np.ndarray) -> np.ndarray:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def _all_still(signals: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    return MappingProxyType({name: _still(values) for name, values in signals.items()})


def _fixed(labels: Mapping[str, str]) -> Mapping[str, str]:
    return MappingProxyType(dict(labels))


@attrs.frozen(eq=False)
class Record:
    """A measurement: signals sampled at the increasing times ``t`` [s].

    ``signals`` holds them by name in the units of ``units`` (``""`` where the file says none),
    ``origin`` says where they come from, and ``notes`` what was repaired, one sentence each.
    """

    name: str
    t: np.ndarray = attrs.field(converter=_still, repr=False)
    signals: Mapping[str, np.ndarray] = attrs.field(converter=_all_still, repr=False)
    units: Mapping[str, str] = attrs.field(converter=_fixed)
    origin: str = ""
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals, in the order of the file; the time is not among them."""
        return tuple(self.signals)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a signal by name, in its own unit. Raises DataError with the near miss."""
        if name not in self.signals:
            raise DataError(f"{self.origin}: there is no signal '{name}'.{near(name, self.signals)}")
        return self.signals[name]

    def __contains__(self, name: object) -> bool:
        return name in self.signals

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __len__(self) -> int:
        return len(self.t)

    def unit(self, name: str) -> str:
        """Return unit label of a signal, ``""`` when the file gives none."""
        self[name]
        return self.units.get(name, "")

    def values(self, name: str, unit: str | None = None) -> np.ndarray:
        """Return a signal converted to ``unit``; a signal without a unit is taken to be in it already.

        Raises DataError when the units measure different things.
        """
        own, array = self.unit(name), self[name]
        if not unit or not own:
            return array
        try:
            return array * units.factor(own, unit)
        except units.UnitError as error:
            raise DataError(f"{self.origin}: signal '{heading(name, own)}' is wanted in {unit}. {error}") from None

    def samples(self, name: str, unit: str | None = None, hold: str = "linear") -> Samples:
        """Return a signal, converted to ``unit``, as an input of a run."""
        return Samples(self.t, self.values(name, unit), hold)
