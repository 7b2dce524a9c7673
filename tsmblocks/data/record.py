"""What a measurement is once it has been read: signals with units on one increasing time axis."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.tables import few
from tsmblocks.common.units import heading
from tsmblocks.common.views import view
from tsmblocks.data import grid, resampling
from tsmblocks.data import signals as one_by_one
from tsmblocks.model.block import Samples


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
    ``origin`` says where they come from, and ``notes`` what was repaired or changed, one sentence each.
    Every method gives a new record and leaves this one as it is. Raises DataError for signals of another length than
    the time, and for a unit of a misspelt signal.
    """

    name: str
    t: np.ndarray = attrs.field(converter=_still, repr=False)
    signals: Mapping[str, np.ndarray] = attrs.field(converter=_all_still, repr=False)
    units: Mapping[str, str] = attrs.field(converter=_fixed)
    origin: str = ""
    notes: tuple[str, ...] = ()

    def __attrs_post_init__(self) -> None:
        one_by_one.checked(self)

    @property
    def called(self) -> str:
        """What messages call it: where it comes from, or its name where that is not known."""
        return self.origin or self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals, in the order of the file; the time is not among them."""
        return tuple(self.signals)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a signal by name, in its own unit. Raises DataError with the near miss."""
        if name not in self.signals:
            raise DataError(f"{self.called}: there is no signal '{name}'.{near(name, self.signals)}")
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
        array = self[name]
        return array * self.factor(name, unit) if unit and self.unit(name) else array

    def factor(self, name: str, unit: str | None) -> float:
        """The number by which a signal is multiplied to be in ``unit``; see values."""
        own = self.unit(name)
        try:
            return units.factor(own, unit) if own and unit else 1.0
        except units.UnitError as error:
            raise DataError(f"{self.called}: signal '{heading(name, own)}' is wanted in {unit}. {error}") from None

    def samples(self, name: str, unit: str | None = None, hold: str = "linear") -> Samples:
        """Return a signal, converted to ``unit``, as an input of a run."""
        return Samples(self.t, self.values(name, unit), hold)

    def to_pandas(self) -> Any:
        """A frame indexed by time [s], one column per signal; ``attrs["units"]`` has their units. Needs pandas."""
        return frame(self.signals, self.t, "t", {"t": "s", **self.units})

    def to_xarray(self) -> Any:
        """A data set over ``t`` [s], one variable per signal, with ``attrs["units"]``. Needs xarray."""
        signals = {name: (("t",), values, self.unit(name)) for name, values in self.signals.items()}
        facts = {"name": self.name, "origin": self.origin, "notes": "\n".join(self.notes)}
        return dataset(signals, {"t": (("t",), self.t, "s")}, facts)

    def plot(self, *names: str, ax: Any = None, after: float | None = None) -> Any:
        """Signals over time (all unless named), angles in degrees; ``"x_in - x_out"`` is one too. Needs matplotlib."""
        return view("plot", self, names=names, ax=ax, after=after)

    def save(self, path: str | Path) -> Path:
        """Write all signals to .csv, .npz or .mat, which ``tsm.read`` takes again; returns the path.

        In .mat a dot becomes an underscore, and units are lost. Raises DataError for another ending, and for names that
        would not be read again as they are.
        """
        from tsmblocks.data.writing import written

        return written(path, self.t, self.signals, self.units, "Give it another name with renamed({…}).")

    def __reduce__(self) -> Any:  # mapping proxies do not pickle
        return Record, (self.name, self.t, dict(self.signals), dict(self.units), self.origin, self.notes)

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s, " if len(self) else ""
        return f"Record({self.name!r}, {span}{len(self)} samples, {few(heading(k, self.unit(k)) for k in self)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    # ---- the time axis: grid.py, parts.py

    @property
    def step(self) -> float:
        """Median step between samples [s]."""
        return grid.step_of(self.t)

    @property
    def jitter(self) -> float:
        """Largest deviation of a step from the median step, as a share of it."""
        return grid.jitter_of(self.t)

    @property
    def uniform(self) -> bool:
        """Whether the samples are evenly spaced (no step off by more than 1 %)."""
        return grid.is_even(self.t)

    def resampled(self, step: float | None = None) -> Record:
        """Return the record on an even grid of ``step`` [s], by default its own median step.

        Signals are interpolated by a cubic spline or linearly, whichever foretells every second sample better
        from the others. When the new step is longer, what would come back as slow motion is first taken out by a
        zero-phase low-pass at 0.7 of the new Nyquist frequency. Raises DataError for a step that does not fit.
        """
        return resampling.resampled(self, step)

    def part(self, start: float | None = None, stop: float | None = None) -> Record:
        """Return the samples from ``start`` to ``stop`` [s], both included; None is the end of the record.

        Raises DataError when fewer than 4 are left.
        """
        from tsmblocks.data import parts

        return parts.part(self, start, stop)

    def split(self, fraction: float = 0.5, *, at: float | None = None) -> tuple[Record, Record]:
        """Return two records, such as train and test: before and from a border on.

        It lies at this ``fraction`` of the time, or ``at`` an instant [s]. Raises DataError when fewer than
        4 samples are left on a side.
        """
        from tsmblocks.data import parts

        return parts.split(self, fraction, at)

    def period(self, name: str | None = None) -> float | None:
        """Period [s] of a signal (by default of that which repeats itself best), None when there are not two alike."""
        from tsmblocks.data import parts

        return parts.period(self, name)

    def periods(self, name: str | None = None) -> tuple[Record, ...]:
        """Return the whole periods of a signal that repeats itself, one record each; see period.

        Raises DataError when nothing repeats itself.
        """
        from tsmblocks.data import parts

        return parts.periods(self, name)

    # ---- filters: filters.py

    def filtered(
        self, names: str | Iterable[str] | None = None, *, cutoff: float | None = None, order: int = 4
    ) -> Record:
        """Return the record with these signals (all by default) low-passed with zero phase.

        ``cutoff`` [Hz] is where the filter, a Butterworth of this ``order`` run forwards and backwards, has fallen
        by 3 dB. When it is not given it is chosen for each signal from its spectrum, so that the expected error
        (motion lost and noise kept) is least; a signal in which no noise stands out is left alone.
        Raises DataError when the samples are uneven or the cut-off does not fit.
        """
        from tsmblocks.data import filters

        return filters.filtered(self, names, cutoff, order)

    def conditioned(self, names: Iterable[str]) -> Record:
        """Return the record with these signals low-passed with zero phase, and held still where they rest.

        That is how a diagnosis takes the noise out of measured inputs, which a model with memory would follow. A signal
        in which no noise stands out is left alone; uneven samples are first put on an even grid.
        """
        from tsmblocks.data.conditioning import conditioned

        return conditioned(self, names)

    def differentiated(
        self, signal: str, order: int = 1, *, name: str | None = None, cutoff: float | None = None
    ) -> Record:
        """Return the record with the first or second derivative of a signal added, in unit/s or unit/s^2.

        It is called ``signal_dot`` or ``signal_ddot`` unless ``name`` is given. The signal is low-passed with zero
        phase at ``cutoff`` [Hz], by default one chosen for the derivative from the spectrum, and a quintic spline
        is differentiated. Raises DataError as filtered does.
        """
        from tsmblocks.data import filters

        return filters.differentiated(self, signal, order, name, cutoff)

    # ---- signals one by one: signals.py

    def unwrapped(self, name: str, *, turn: float | None = None) -> Record:
        """Return the record with an angle's turns joined: a step of more than half a turn is taken for a wrap.

        ``turn`` is one turn in the signal's unit; it need not be given for rad, deg and rev. Raises DataError
        when it is not known.
        """
        return one_by_one.unwrapped(self, name, turn)

    def with_signal(self, name: str, values: Any, unit: str = "") -> Record:
        """Return the record with one signal more (or replaced): one finite number for each sample, or DataError."""
        return one_by_one.with_signal(self, name, values, unit)

    def renamed(self, names: Mapping[str, str]) -> Record:
        """Return the record with signals under other names: ``{"motor angle": "x_in"}``.

        Raises DataError for a name that is not there or would stand twice.
        """
        return one_by_one.renamed(self, names)

    def converted(self, wanted: Mapping[str, str]) -> Record:
        """Return the record with signals in other units: ``{"x_in": "rad"}``.

        A signal without a unit is taken to be in the one given. Raises DataError when units measure different things.
        """
        return one_by_one.converted(self, wanted)
