"""A measurement: signals with units on one increasing time axis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import DataError, clip, in_words, near, nearest, without_controls
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.headings import heading
from tsmblocks.common.interpolation import AUTO
from tsmblocks.common.tables import few
from tsmblocks.common.views import SignalViews
from tsmblocks.data import conditioning, filters, grid, parts, resampling
from tsmblocks.data import signals as signal_methods
from tsmblocks.data.writing import written
from tsmblocks.model.block import Samples


def _read_only(values: np.ndarray) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"a recording holds times and signals as numbers, got {in_words(values)}.") from None
    array.flags.writeable = False
    return array


def _mapping(what: str, given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise DataError(f"{what} of a recording are a mapping by signal, got {in_words(given)}.")
    return given


def _read_only_labels(labels: Mapping[str, str]) -> Mapping[str, str]:
    return MappingProxyType(dict(_mapping("units", labels)))


def _read_only_signals(signals: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    return MappingProxyType({name: _read_only(values) for name, values in _mapping("signals", signals).items()})


def _read_only_masks(masks: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    made = {name: np.array(mask, dtype=bool) for name, mask in _mapping("filled", masks).items()}
    for mask in made.values():
        mask.flags.writeable = False
    return MappingProxyType(made)


FUNCTIONS = {
    "noise": "the noise of a signal is tsm.noise(record, 'NAME').floor",
    "noise_floor": "the noise of a signal is tsm.noise(record, 'NAME').floor",
    "fit": "a diagram is fitted by tsm.fit(diagram, record)",
    "diagnose": "a diagram is diagnosed by tsm.diagnose(diagram, record)",
    "simulate": "a diagram is simulated by tsm.simulate(diagram, inputs={'NAME': record})",
}
"""What is no attribute of a record -> the function that gives it."""


def _attribute_hint(record: Record, name: str) -> str:
    """Where to find what is no attribute of a record; empty for the names of Python's protocols."""
    if name.startswith("_"):
        return ""
    if name in object.__getattribute__(record, "signals"):
        return f" A signal is found by its name: record['{name}']."
    if known := FUNCTIONS.get(nearest(name, FUNCTIONS)):
        return f" {known[0].upper()}{known[1:]}."
    return near(name, [k for k in dir(type(record)) if not k.startswith("_")])


@attrs.frozen(eq=False)
class Record(SignalViews):
    """A measurement: signals sampled at increasing times.

    Every method returns a new record and leaves this one unchanged.

    Parameters
    ----------
    name : str
        Name of the experiment.
    t : array_like, shape (N,)
        Increasing times [s].
    signals : mapping of str to array_like, each of shape (N,)
        Signals by name, in the units of ``units``.
    units : mapping of str to str
        Unit labels by signal; a signal without a unit is left out.
    origin : str, default ""
        Where the record comes from, as messages call it: the path of a file, for example.
    notes : tuple of str, default ()
        Repairs and changes, one sentence each.
    filled : mapping of str to array_like of bool, each of shape (N,), default {}
        Samples that were not measured but interpolated, by signal. They have no weight in fits, scores and diagnoses.

    Raises
    ------
    DataError
        For signals of another length than the time, and for a unit of a misspelt signal.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> tsm.Record("sine", t, {"x_in": np.sin(t)}, {"x_in": "rad"})
    Record('sine', 0 to 1 s, 101 samples, x_in [rad])
    """

    name: str
    t: np.ndarray = attrs.field(converter=_read_only, repr=False)
    signals: Mapping[str, np.ndarray] = attrs.field(converter=_read_only_signals, repr=False)
    units: Mapping[str, str] = attrs.field(converter=_read_only_labels)
    origin: str = ""
    notes: tuple[str, ...] = ()
    filled: Mapping[str, np.ndarray] = attrs.field(factory=dict, converter=_read_only_masks, repr=False)

    def __attrs_post_init__(self) -> None:
        signal_methods.refuse_unsound(self)

    @property
    def called(self) -> str:
        """The record's name in messages: its origin, or its name where that is empty."""
        return self.origin or self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals, in the order of the file; the time is not among them."""
        return tuple(self.signals)

    if not TYPE_CHECKING:  # else every attribute would be there

        def __getattr__(self, name: str) -> Any:
            raise AttributeError(f"a record has no '{name}'.{_attribute_hint(self, name)}")

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
        """Return the unit label of a signal.

        Parameters
        ----------
        name : str
            The signal.

        Returns
        -------
        str
            Its unit, ``""`` where it is not known.

        Raises
        ------
        DataError
            For an unknown signal.
        """
        self[name]
        return self.units.get(name, "")

    def values(self, name: str, unit: str | None = None) -> np.ndarray:
        """Return a signal converted to a unit.

        Parameters
        ----------
        name : str
            The signal.
        unit : str or None, default None
            Unit of the result, by default that of the record. A signal without a unit is taken to be in it already.

        Returns
        -------
        ndarray, shape (N,)
            The samples.

        Raises
        ------
        DataError
            For an unknown signal, and when the units measure different things.
        """
        array = self[name]
        return array * self.factor(name, unit) if unit and self.unit(name) else array

    def factor(self, name: str, unit: str | None) -> float:
        """Return the factor that converts a signal to a unit.

        Parameters
        ----------
        name : str
            The signal.
        unit : str or None
            The unit wanted; None is that of the record.

        Returns
        -------
        float
            The factor; 1 where one of the units is not known.

        Raises
        ------
        DataError
            For an unknown signal, and when the units measure different things.
        """
        own = self.unit(name)
        try:
            return units.factor(own, unit) if own and unit else 1.0
        except units.UnitError as error:
            raise DataError(f"{self.called}: signal '{heading(name, own)}' is wanted in {unit}. {error}") from None

    def samples(self, name: str, unit: str | None = None, hold: str = AUTO) -> Samples:
        """Return a signal as an input of a run.

        Parameters
        ----------
        name : str
            The signal.
        unit : str or None, default None
            Unit of the input, by default that of the record.
        hold : {"auto", "zero", "linear", "cubic"}, default "auto"
            How the input is interpolated between samples; by default as it is found from them.

        Returns
        -------
        Samples
            Times [s], values and hold.

        Raises
        ------
        DataError
            As ``values`` does.
        """
        return Samples(self.t, self.values(name, unit), hold)

    def to_pandas(self) -> Any:
        """Return the signals as a pandas frame. Needs pandas.

        Returns
        -------
        pandas.DataFrame
            One column per signal, indexed by time [s]; ``attrs["units"]`` has the units.
        """
        return frame(self.signals, self.t, "t", {"t": "s", **self.units})

    def to_xarray(self) -> Any:
        """Return the signals as an xarray data set. Needs xarray.

        Returns
        -------
        xarray.Dataset
            One variable per signal over ``t`` [s]; ``attrs["units"]`` of each is its unit.
        """
        signals = {name: (("t",), values, self.unit(name)) for name, values in self.signals.items()}
        facts = {"name": self.name, "origin": self.origin, "notes": "\n".join(self.notes)}
        return dataset(signals, {"t": (("t",), self.t, "s")}, facts)

    def save(self, path: str | Path) -> Path:
        """Write all signals to a file that ``tsm.read`` reads again.

        Parameters
        ----------
        path : str or Path
            File ending in .csv, .npz or .mat. In .mat a dot of a name becomes an underscore, and units are lost.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        DataError
            For another ending, and for names that would not be read again as they are.
        """
        return written(path, self.t, self.signals, self.units, "Give it another name with renamed({…}).")

    def __reduce__(self) -> Any:  # mapping proxies do not pickle
        signals, filled = dict(self.signals), dict(self.filled)
        return Record, (self.name, self.t, signals, dict(self.units), self.origin, self.notes, filled)

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s, " if len(self) else ""
        names = without_controls(few(clip(heading(k, self.unit(k))) for k in self))
        return f"Record({self.name!r}, {span}{len(self)} samples, {names})"

    # ---- the time axis

    @property
    def step(self) -> float:
        """Median step between samples [s]."""
        return grid.step_of(self.t)

    @property
    def jitter(self) -> float:
        """Largest deviation of a step from the median step, as a share of it."""
        return grid.jitter_of(np.diff(self.t))

    @property
    def uniform(self) -> bool:
        """Whether the samples are evenly spaced (no step off by more than 1 %)."""
        return grid.is_even(self.t)

    # ---- methods that are written in separate modules, by subject

    part, split = parts.part, parts.split
    period, periods = parts.period, parts.periods
    resampled, decimated = resampling.resampled, resampling.decimated
    filtered, differentiated = filters.filtered, filters.differentiated
    conditioned = conditioning.conditioned
    unwrapped, with_signal = signal_methods.unwrapped, signal_methods.with_signal
    renamed, converted = signal_methods.renamed, signal_methods.converted

    def _changed(self, *notes: str, **changes: Any) -> Record:
        """The record with other fields, and notes on that."""
        return attrs.evolve(self, notes=(*self.notes, *notes), **changes)
