"""What a simulation returns: signals over time, by name, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.tables import few
from tsmblocks.common.units import heading
from tsmblocks.common.views import view
from tsmblocks.data import Record
from tsmblocks.data.writing import written


@attrs.frozen(eq=False)
class Run:
    """Signals of one simulation.

    ``run.t`` is time in s, shape (N,); ``run["tsm.y"]`` a signal of the same shape, by the name of an
    output of the diagram, of a block's port (``"motor.y"``), of a state (``"tsm.zeta"``) or of an input.
    ``aliases`` maps the diagram's outputs to the signals they show; ``units`` signals to labels.
    ``state`` holds all that is needed to go on from the last instant. ``events`` are the switching
    instants of a run with ``locate=True``, in order: each has ``t`` [s], ``block``, ``switch`` (abs, sign,
    min, max, <, <=) and ``rising``.
    """

    title: str
    t: np.ndarray
    rows: np.ndarray = attrs.field(repr=False)
    names: tuple[str, ...] = attrs.field(repr=False)
    aliases: Mapping[str, str]
    units: Mapping[str, str] = attrs.field(repr=False)
    parameters: Mapping[str, float] = attrs.field(repr=False)
    step: float
    method: str
    state: Any = attrs.field(repr=False, default=None)
    complete: bool = True
    events: tuple[Any, ...] = attrs.field(repr=False, default=())

    def __getitem__(self, name: str) -> np.ndarray:
        """A signal by name; raises RunError with the near miss."""
        if not isinstance(name, str):
            raise RunError(f"signals of a run go by name, one at a time, got {in_words(name)}.")
        target = self.aliases.get(name, name)
        try:
            column = self.names.index(target)
        except ValueError:
            hint = near(name, [*self.aliases, *self.names])
            raise RunError(f"the run of '{self.title}' has no signal '{name}'.{hint}") from None
        return np.ascontiguousarray(self.rows[:, column])

    def __contains__(self, name: object) -> bool:
        return name in self.aliases or name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> list[str]:
        """Names of all signals, outputs of the diagram first."""
        return [*self.aliases, *(n for n in self.names if n not in self.aliases)]

    def record(self, *names: str, name: str = "") -> Record:
        """Signals of the run as a recording that fits and scores take; all outputs unless named.

        ``name`` is that of the experiment, the title of the run by default.
        """
        chosen = names or tuple(self.aliases)
        signals, units = {k: self[k] for k in chosen}, {k: self.unit(k) for k in chosen}
        return Record(name or self.title, self.t, signals, units, "simulation")

    def unit(self, name: str) -> str:
        """Unit label of a signal, ``""`` when none is known."""
        return self.units.get(self.aliases.get(name, name), self.units.get(name, ""))

    def heading(self, name: str) -> str:
        """``name [unit]``, as tables and files show it."""
        return heading(name, self.unit(name))

    def to_pandas(self, names: Sequence[str] | None = None) -> Any:
        """A frame indexed by time [s], one column per signal (all unless named). Needs pandas.

        ``attrs["units"]`` has their units, which ``from_pandas`` reads.
        """
        chosen = _listed(names) or self.keys()
        return frame({n: self[n] for n in chosen}, self.t, "t", {"t": "s", **{n: self.unit(n) for n in chosen}})

    def to_xarray(self, names: Sequence[str] | None = None) -> Any:
        """A data set over ``t`` [s], one variable per signal, with ``attrs["units"]``. Needs xarray."""
        facts = {"title": self.title, "step": self.step, "method": self.method, "complete": self.complete}
        signals = {n: (("t",), self[n], self.unit(n)) for n in _listed(names) or self.keys()}
        return dataset(signals, {"t": (("t",), self.t, "s")}, facts)

    def plot(self, *names: str, ax: Any = None, after: float | None = None) -> Any:
        """Signals over time (the diagram's outputs unless named), angles in degrees. Needs matplotlib.

        ``run.plot("x_ref - x_out", after=5.0)`` shows the error from 5 s on.
        """
        return view("plot", self, names=names, ax=ax, after=after)

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s, " if len(self.t) else ""
        part = "" if self.complete else ", stopped before its end"
        return f"Run({self.title!r}, {span}{len(self.t)} instants, {few(self.keys())}{part})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def save(self, path: str | Path, names: Sequence[str] | None = None) -> Path:
        """Write signals (the diagram's outputs unless named) to .csv, .npz or .mat; returns the path.

        In .mat a dot becomes an underscore. Raises DataError for another ending, for two signals that would take one
        name there, and for names that cannot be written.
        """
        chosen = _listed(names) or list(self.aliases) or self.keys()
        return written(
            path,
            self.t,
            {n: self[n] for n in chosen},
            {n: self.unit(n) for n in chosen},
            "Give the output another name, or leave it out with names=[...].",
        )


def _listed(names: Sequence[str] | None) -> list[str]:
    """Names asked for, of which one alone need not be a list."""
    return [names] if isinstance(names, str) else list(names or ())
