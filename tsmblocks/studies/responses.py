"""Signals of many runs: the range of a response when its parameters are uncertain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError, near
from tsmblocks.common.frames import dataset
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions, as_diagram
from tsmblocks.simulation.batch import warn_of_sets
from tsmblocks.studies.plans import Plan
from tsmblocks.studies.runner import grouped, run_starts, set_labels
from tsmblocks.studies.study import filled_plan, signal_units


@attrs.frozen(eq=False)
class Responses:
    """Signals of the runs of a plan.

    Parameters
    ----------
    title : str
        Title of the diagram.
    t : ndarray, shape (N,)
        Instants [s].
    signals : mapping of str to ndarray, each of shape (runs, N)
        Signals by name.
    units : mapping of str to str
        Unit labels by signal.
    """

    title: str
    t: np.ndarray = attrs.field(repr=False)
    signals: Mapping[str, np.ndarray] = attrs.field(repr=False)
    units: Mapping[str, str]

    def __getitem__(self, name: str) -> np.ndarray:
        """A signal by name, shape (runs, N). Raises RunError with the near miss."""
        if name not in self.signals:
            raise RunError(f"the responses have no signal '{name}'.{near(name, self.signals)}")
        return self.signals[name]

    @property
    def _count(self) -> int:
        """Number of runs."""
        return len(next(iter(self.signals.values()), ()))

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
        """
        return self.units.get(name, "")

    def to_xarray(self) -> Any:
        """Return the signals as an xarray data set. Needs xarray.

        Returns
        -------
        xarray.Dataset
            One variable per signal over ``run`` and ``t`` [s]; ``attrs["units"]`` of each is its unit.
        """
        coords = {"run": (("run",), np.arange(self._count), ""), "t": (("t",), self.t, "s")}
        return dataset(
            {k: (("run", "t"), v, self.unit(k)) for k, v in self.signals.items()}, coords, {"title": self.title}
        )

    def __repr__(self) -> str:
        return f"Responses({self.title!r}, {self._count} runs, {len(self.t)} instants, {few(self.signals)})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def plot(self, signal: str, ax: Any = None, *, reference: str | None = None, width: float | None = None) -> Any:
        """Plot the median and bands of a signal over the runs. Needs matplotlib; raises RunError for an unknown signal.

        Parameters
        ----------
        signal : str
            The signal.
        ax : matplotlib.axes.Axes or None, default None
            Axes to draw into, by default those of a new figure.
        reference : str or None, default None
            Signal drawn beside it.
        width : float or None, default None
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        return view("plot", self, signal=signal, ax=ax, reference=reference, width=width)


def responses(
    diagram: Diagram,
    plan: Plan | Mapping[str, Any],
    signals: Sequence[str] | None = None,
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: Hold = AUTO,
    every: int = 10,
    threads: int | None = None,
    backend: str = "",
) -> Responses:
    """Return signals of every run of a plan, all in memory; some hundred runs are enough for an envelope.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    plan : Plan or mapping of str to sequence
        As for ``study``.
    signals : sequence of str or None, default None
        Signals to keep, by default the diagram's outputs.
    stop, step, start, method, inputs, hold : optional
        As for ``study``.
    every : int, default 10
        Number of steps between instants that are kept.
    threads, backend : optional
        As for ``study``.

    Returns
    -------
    Responses
        The signals.

    Raises
    ------
    ParameterError, DataError, RunError
        As ``simulate_batch`` does.
    """
    diagram = as_diagram(diagram)
    plan = filled_plan(diagram, plan)
    names = list(diagram.outputs if signals is None else signals)
    options = RunOptions(stop, step, start, method, inputs, hold, every, backend)
    groups = grouped(diagram, plan.columns, options)
    batches = [group.batch(names) for group in groups]
    warn_of_sets(run_starts(groups, batches, plan.columns), batches, set_labels(groups, plan.columns))
    t = batches[0].t
    made = {name: np.empty((len(plan), len(t))) for name in names}
    for group, batch in zip(groups, batches, strict=True):
        for name, values in batch.results(0, batch.count, None, threads).items():
            made[name][group.runs] = values
    units = signal_units(diagram)
    return Responses(diagram.title, t, made, {name: units.get(name, "") for name in names})
