"""The result of a simulation: signals over time, by name, with units."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_list
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.headings import heading
from tsmblocks.common.tables import few
from tsmblocks.common.views import SignalViews
from tsmblocks.data import Record
from tsmblocks.data.writing import written


@attrs.frozen(eq=False)
class Run(SignalViews):
    """Signals of one simulation.

    ``run["tsm.y"]`` is a signal of shape (N,), by the name of an output of the diagram, of a block's port
    (``"motor.y"``), of a state (``"tsm.zeta"``) or of an input. Methods that take names raise RunError for an unknown
    one.

    Parameters
    ----------
    title : str
        Title of the diagram.
    t : ndarray
        Instants in s, shape (N,).
    rows : ndarray
        All signals, shape (N, signals).
    names : tuple of str
        Names of the columns of ``rows``.
    aliases : dict of str to str
        Outputs of the diagram, and the signals that they show.
    units : dict of str to str
        Unit labels of signals.
    parameters : dict of str to float
        Parameters of the run.
    step : float
        Step in s.
    method : str
        Integration method.
    state : SavedState, optional
        All that is needed to continue from the last instant: ``simulate(diagram, initial=run.state)``.
    complete : bool, default True
        Whether the run reached its end.
    events : tuple of Event, optional
        Switching instants of a run with ``locate=True``, in order: each has ``t`` [s], ``block``, ``switch`` (abs,
        sign, min, max, <, <=) and ``rising``.
    loops : tuple of LoopReport, optional
        Algebraic loops: the ``path`` of each, whether it is ``linear`` (then it was eliminated), and else how often it
        was ``solved``, in how many iterations (``mean_iterations``, ``most_iterations``).
    ended_by : str, default ""
        The condition at which the run ended, ``stop_when``; empty where it ran to its end.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> tsm.simulate(tsm.load("motor_linear"), stop=1.0, inputs={"u": 12.0}, log="outputs")
    Run('Motor as a linear transfer function', 0 to 1 s, 1001 instants, x, motor.y)
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
    loops: tuple[Any, ...] = attrs.field(repr=False, default=())
    ended_by: str = ""

    def __getitem__(self, name: str) -> np.ndarray:
        """A signal by name. Raises RunError with the near miss."""
        if not isinstance(name, str):
            raise RunError(f"signals of a run are chosen by name, one at a time, got {in_words(name)}.")
        target = self.aliases.get(name, name)
        if target not in self.names:
            hint = near(name, [*self.aliases, *self.names])
            raise RunError(f"the run of '{self.title}' has no signal '{name}'.{hint}")
        return np.ascontiguousarray(self.rows[:, self.names.index(target)])

    def __contains__(self, name: object) -> bool:
        return name in self.aliases or name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> list[str]:
        """Names of all signals.

        Returns
        -------
        list of str
            The names, outputs of the diagram first.
        """
        return [*self.aliases, *(n for n in self.names if n not in self.aliases)]

    def _picked(self, names: Iterable[str]) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Signals and their units."""
        chosen = list(names)
        return {n: self[n] for n in chosen}, {n: self.unit(n) for n in chosen}

    def record(self, *names: str, name: str = "") -> Record:
        """Signals as a recording, as fits and scores take it.

        Parameters
        ----------
        *names : str
            The signals; all outputs of the diagram unless given.
        name : str, optional
            Name of the experiment. By default the title of the run.

        Returns
        -------
        Record
            The recording.
        """
        return Record(name or self.title, self.t, *self._picked(names or self.aliases), "simulation")

    def unit(self, name: str) -> str:
        """The unit label of a signal.

        Parameters
        ----------
        name : str
            The signal.

        Returns
        -------
        str
            Its unit, ``""`` where none is known.
        """
        return self.units.get(self.aliases.get(name, name), self.units.get(name, ""))

    def heading(self, name: str) -> str:
        """A signal with its unit, as tables and files show it.

        Parameters
        ----------
        name : str
            The signal.

        Returns
        -------
        str
            ``name [unit]``.
        """
        return heading(name, self.unit(name))

    def to_pandas(self, names: Sequence[str] | None = None) -> Any:
        """A table indexed by time [s], one column for each signal.

        Parameters
        ----------
        names : list of str, optional
            The signals; all unless given.

        Returns
        -------
        pandas.DataFrame
            The table; ``attrs["units"]`` has the units, which ``from_pandas`` reads. Needs pandas.
        """
        signals, units = self._picked(as_list(names) or self)
        return frame(signals, self.t, "t", {"t": "s", **units})

    def to_xarray(self, names: Sequence[str] | None = None) -> Any:
        """Signals over ``t`` [s].

        Parameters
        ----------
        names : list of str, optional
            The signals; all unless given.

        Returns
        -------
        xarray.Dataset
            One variable for each signal, with ``attrs["units"]``. Needs xarray.
        """
        facts = {"title": self.title, "step": self.step, "method": self.method, "complete": self.complete}
        signals = {n: (("t",), self[n], self.unit(n)) for n in as_list(names) or self.keys()}
        return dataset(signals, {"t": (("t",), self.t, "s")}, facts)

    def __repr__(self) -> str:
        span = f"{self.t[0]:g} to {self.t[-1]:g} s, " if len(self.t) else ""
        part = "" if self.complete else ", stopped before its end"
        return f"Run({self.title!r}, {span}{len(self.t)} instants, {few(self.keys())}{part})"

    def save(self, path: str | Path, names: Sequence[str] | None = None) -> Path:
        """Write signals to a file.

        In .mat a dot in a name becomes an underscore.

        Parameters
        ----------
        path : str or Path
            A file that ends in .csv, .npz or .mat.
        names : list of str, optional
            The signals; the outputs of the diagram unless given.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        DataError
            For another ending, two signals with one name in .mat, and names that cannot be written.
        """
        signals, units = self._picked(as_list(names) or self.aliases or self)
        return written(path, self.t, signals, units, "Give the output another name, or leave it out with names=[...].")
