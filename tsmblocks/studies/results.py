"""Results of a study: a number per run and metric, with quantiles, optima and influences."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import RunError, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.headings import heading
from tsmblocks.common.tables import columns as in_columns
from tsmblocks.common.tables import few, line_width
from tsmblocks.common.views import view
from tsmblocks.metrics.metrics import named
from tsmblocks.model.diagram import Diagram
from tsmblocks.studies.influence import influence
from tsmblocks.studies.plans import plain

QUANTILES = {"lowest": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "highest": 1.0}
"""Quantiles of a metric that a summary has."""


@attrs.frozen(eq=False)
class Results:
    """Metrics of the runs of a study.

    ``results[name]`` is a parameter or a metric, shape (n,). Metrics of a run that is not finite are NaN.

    Parameters
    ----------
    title, kind : str
        Title of the study, and how its plan was made.
    count : int
        Number of runs of the plan.
    runs : ndarray of int, shape (n,)
        Numbers of the runs that are done.
    parameters, metrics : mapping of str to ndarray, each of shape (n,)
        Values by parameter, and by metric.
    units, texts : mapping of str to str
        Units by metric (``""`` where one is not known), and expressions by metric.
    own : mapping of str to value
        The diagram's own values of the parameters; None for an option.
    status : {"complete", "interrupted"}, default "complete"
        How the study ended.
    path : Path or None, default None
        The .csv file with the results.
    diagram : Diagram or None, default None
        The diagram; None where results were read from a file.
    asked : mapping of str to str, default {}
        Names by metric as they were given, such as ``"error [deg]"`` of ``"error"``; results are found by both.
    """

    title: str
    kind: str
    count: int
    runs: np.ndarray = attrs.field(repr=False)
    parameters: Mapping[str, np.ndarray] = attrs.field(repr=False)
    metrics: Mapping[str, np.ndarray] = attrs.field(repr=False)
    units: Mapping[str, str] = attrs.field(repr=False)
    texts: Mapping[str, str] = attrs.field(repr=False)
    own: Mapping[str, Any] = attrs.field(repr=False)
    status: str = "complete"
    path: Path | None = None
    diagram: Diagram | None = attrs.field(repr=False, default=None)
    asked: Mapping[str, str] = attrs.field(repr=False, factory=dict)

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[str]:
        return iter([*self.parameters, *self.metrics])

    def __getitem__(self, name: str) -> np.ndarray:
        """A parameter or a metric by name, shape (n,). Raises RunError with the near miss."""
        plain = next((k for k, v in self.asked.items() if v == name), name)
        known = {**self.parameters, **self.metrics}
        if plain not in known:
            raise RunError(f"the study has no '{name}'.{near(name, known)}")
        return known[plain]

    def _numbers(self, name: str) -> np.ndarray:
        if self[name].dtype.kind != "f":
            raise RunError(f"'{name}' is an option and has no numbers.")
        return self[name]

    def _best(self, metric: str) -> dict[str, Any]:
        """As ``best``; empty where no run has a finite one."""
        return self.best(metric) if np.isfinite(self[metric]).any() else {}

    @property
    def failed(self) -> np.ndarray:
        """Which runs have a metric that is no number, shape (n,)."""
        return np.any([np.isnan(v) for v in self.metrics.values()], axis=0)

    def row(self, at: int) -> dict[str, Any]:
        """Return parameters and metrics of a run.

        Parameters
        ----------
        at : int
            Its position in ``runs``.

        Returns
        -------
        dict of str to value
            Values by name.
        """
        return {name: plain(self[name][at]) for name in self}

    def best(self, metric: str, *, largest: bool = False) -> dict[str, Any]:
        """Return parameters and metrics of the run where a metric is smallest. Raises RunError where none is finite.

        Parameters
        ----------
        metric : str
            The metric.
        largest : bool, default False
            Whether the largest value is the best.

        Returns
        -------
        dict of str to value
            Values by name, with the number of the ``run``.
        """
        values = self._numbers(metric)
        if not np.isfinite(values).any():
            raise RunError(f"no run of the study has a finite '{metric}'.")
        at = int(np.argmin(np.where(np.isfinite(values), -values if largest else values, np.inf)))
        return {"run": int(self.runs[at]), **self.row(at)}

    def at(self, run: int) -> Diagram:
        """Return the diagram with the parameters of a run.

        Raises RunError where there is no such run, or the results are from a file, which has no diagram.

        Parameters
        ----------
        run : int
            Number of the run.

        Returns
        -------
        Diagram
            The diagram.
        """
        where = np.flatnonzero(self.runs == run)
        if self.diagram is None or not len(where):
            why = "the diagram is not in the file" if self.diagram is None else f"there are {self.count} runs"
            raise RunError(f"no diagram of run {run}: {why}.")
        return self.diagram.with_parameters({k: plain(v[where[0]]) for k, v in self.parameters.items()})

    def pareto(self, *metrics: str) -> np.ndarray:
        """Return the Pareto front: the runs that no other one beats in all of these metrics, smaller being better.

        Parameters
        ----------
        *metrics : str
            The metrics; RunError is raised for fewer than two.

        Returns
        -------
        ndarray of int
            Positions in ``runs``, ordered by the first metric.
        """
        if len(metrics) < 2:
            raise RunError("a Pareto front takes two metrics at least.")
        values = np.column_stack([self._numbers(name) for name in metrics])
        order = [k for k in np.lexsort(values.T[::-1]) if np.isfinite(values[k]).all()]
        kept = list[int]()
        for k in order:
            if not (values[kept] <= values[k]).all(axis=1).any():
                kept.append(k)
        return np.array(kept, dtype=int)

    def influence(self, metric: str) -> dict[str, tuple[float, float]]:
        """Return how a metric changes with each parameter, the most influential first.

        For a sweep it is the metric at the smallest and the largest value of a parameter. For other plans it is the
        prediction of a linear regression at the 5 % and 95 % quantiles of a parameter, the others being at their means.
        Raises RunError where fewer runs are finite than the regression needs.

        Parameters
        ----------
        metric : str
            The metric.

        Returns
        -------
        dict of str to tuple of float
            The metric at the low and at the high end, by parameter, in its unit.
        """
        return influence(self, metric)

    def quantiles(self, metric: str) -> dict[str, float]:
        """Return lowest value, 5 %, median, 95 % and highest value of a metric, over the runs that have one.

        Between two runs a quantile is interpolated linearly; next to an infinite one it is infinite.

        Parameters
        ----------
        metric : str
            The metric.

        Returns
        -------
        dict of str to float
            Quantiles by name, in the unit of the metric; NaN where no run has one.
        """
        found = self._numbers(metric)
        values = np.sort(found[~np.isnan(found)])
        if not len(values):
            return dict.fromkeys(QUANTILES, float("nan"))
        return {name: _quantile(values, q) for name, q in QUANTILES.items()}

    def to_pandas(self) -> Any:
        """Return the results as a pandas frame. Needs pandas.

        Returns
        -------
        pandas.DataFrame
            A row per run, by its number: parameters, then metrics by the names given. ``attrs["units"]`` has the units
            of the metrics by column.
        """
        titles = {name: self.asked.get(name, name) for name in self}
        units = {titles[name]: unit for name, unit in self.units.items()}
        return frame({title: self[name] for name, title in titles.items()}, self.runs, "run", units)

    def to_xarray(self) -> Any:
        """Return the metrics as an xarray data set. Needs xarray.

        Returns
        -------
        xarray.Dataset
            Of a complete grid the parameters are its dimensions; else ``run`` is, with the parameters over it.
            ``attrs["units"]`` of each variable is its unit.
        """
        facts = {"title": self.title, "kind": self.kind, "status": self.status}
        axes = {k: list(dict.fromkeys(v.tolist())) for k, v in self.parameters.items()}
        shape = tuple(map(len, axes.values()))
        if self.kind == "grid" and np.prod(shape) == len(self) == self.count:
            dims, coords = list(axes), {k: ([k], np.array(v), "") for k, v in axes.items()}
        else:
            dims, shape = ["run"], (len(self),)
            coords = {k: (dims, v, "") for k, v in {"run": self.runs, **self.parameters}.items()}
        return dataset({k: (dims, v.reshape(shape), self.units[k]) for k, v in self.metrics.items()}, coords, facts)

    def to_dict(self) -> dict[str, Any]:
        """Return the summary as plain values.

        Returns
        -------
        dict
            Title, kind, numbers of runs, and quantiles and best run of each metric.
        """
        return {
            "title": self.title,
            "kind": self.kind,
            "runs": self.count,
            "done": len(self),
            "status": self.status,
            "failed": int(self.failed.sum()),
            "parameters": list(self.parameters),
            "metrics": {
                name: {
                    "unit": self.units[name],
                    "text": self.texts[name],
                    **self.quantiles(name),
                    "best": self._best(name) or None,
                }
                for name in self.metrics
            },
        }

    def plot(self, *metrics: str, ax: Any = None, width: float | None = None) -> Any:
        """Plot the results by plan: a heat map of a grid of two, a tornado of a sweep, distributions of random runs.

        Parameters
        ----------
        *metrics : str
            The metrics, by default all.
        ax : matplotlib.axes.Axes or None, default None
            Axes to draw into, by default those of a new figure.
        width : float or None, default None
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. Needs matplotlib.
        """
        return view("plot", self, metrics=metrics, ax=ax, width=width)

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        done = f"{len(self)} of " if len(self) < self.count else ""
        done += f"{self.count} run{'s' if self.count > 1 else ''}"
        lines = textwrap.wrap(f"{self.title}: {self.kind}, {done} over {', '.join(self.parameters)}", line_width())
        count = int(self.failed.sum())
        if count:
            have = "runs have" if count > 1 else "run has"
            lines.append(f"{count} {have} a metric that is no number (an unstable loop, for example)")
        table = [("", *QUANTILES, "lowest at")]
        for name in self.metrics:
            best = {k: v for k, v in self._best(name).items() if k in self.parameters}
            where = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in best.items())
            k, unit = display_unit(self.units[name])  # as in the plots
            table.append((heading(name, unit), *(f"{k * v:.4g}" for v in self.quantiles(name).values()), where))
        return "\n".join([*lines, "", in_columns(table, left=(0, len(QUANTILES) + 1))])

    def __repr__(self) -> str:
        return f"Results({self.title!r}, {len(self)} of {self.count} runs, metrics {few(self.metrics)})"


def described_results(
    facts: Mapping[str, Any],
    runs: np.ndarray,
    columns: Mapping[str, np.ndarray],
    path: Path | None,
    diagram: Diagram | None = None,
) -> Results:
    """Results of these runs, from the facts of the study and the columns of its table."""
    asked, units = {named(name)[0]: name for name in facts["metrics"]}, facts["units"]
    return Results(
        facts["title"],
        facts["kind"],
        facts["runs"],
        runs,
        parameters={k: columns[k] for k in facts["parameters"]},
        metrics={k: columns[k] for k in units},
        units=units,
        texts={name: facts["metrics"][given] for name, given in asked.items()},
        own=facts["parameters"],
        status="complete" if len(runs) == facts["runs"] else "interrupted",
        path=path,
        diagram=diagram,
        asked=asked,
    )


def _quantile(ordered: np.ndarray, q: float) -> float:
    """As NumPy's, where values may be infinite: between opposite infinities it is the nearer one."""
    place = round(q * (len(ordered) - 1), 9)  # a place that is off by rounding would mix in a neighbour's infinity
    share = place % 1.0
    low, high = float(ordered[math.floor(place)]), float(ordered[math.ceil(place)])
    if low == high or np.isinf([low, high]).all():
        return low if share < 0.5 else high
    return min(max((1.0 - share) * low + share * high, low), high) if share else low
