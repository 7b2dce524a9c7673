"""What a study returns: a number per run and metric, and what can be read off them."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, RunError, near
from tsmblocks.common.frames import dataset, frame
from tsmblocks.common.tables import WIDTH, few
from tsmblocks.common.tables import columns as in_columns
from tsmblocks.common.views import view
from tsmblocks.data import heading
from tsmblocks.metrics.metrics import named
from tsmblocks.model.diagram import Diagram
from tsmblocks.studies.plans import plain
from tsmblocks.studies.store import Table, facts_of, read_table, value_of

QUANTILES = {"lowest": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "highest": 1.0}


@attrs.frozen(eq=False)
class Results:
    """Metrics of the runs of a study.

    ``runs`` (n,) are the numbers of the runs that are there, out of ``count``; ``parameters`` and ``metrics`` map
    names to arrays of that shape, ``units`` and ``texts`` metrics to their unit and how they were written. A metric
    that was asked for as ``"error [deg]"`` is found by that and by ``"error"``; ``asked`` has the former. ``own``
    are the diagram's own numbers, ``status`` is ``"complete"`` or ``"interrupted"``. A run whose signals are not
    finite has NaN for its metrics.
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
        for side in (self.metrics, self.parameters):
            if plain in side:
                return side[plain]
        raise RunError(f"the study has no '{name}'.{near(name, list(self))}")

    def _numbers(self, name: str) -> np.ndarray:
        if self[name].dtype.kind != "f":
            raise RunError(f"'{name}' is no number but an option.")
        return self[name]

    @property
    def failed(self) -> np.ndarray:
        """Which runs have a metric that is no number, shape (n,)."""
        return np.any([np.isnan(v) for v in self.metrics.values()], axis=0)

    def row(self, at: int) -> dict[str, Any]:
        """Parameters and metrics of the run at a position, by name."""
        return {name: plain(self[name][at]) for name in self}

    def best(self, metric: str, *, largest: bool = False) -> dict[str, Any]:
        """Parameters and metrics of the run where a metric is smallest, with its ``run`` number.

        Raises RunError where no run has a finite one.
        """
        found = self._numbers(metric)
        values = np.where(np.isfinite(found), found, np.nan)
        if np.isnan(values).all():
            raise RunError(f"no run of the study has a finite '{metric}'.")
        at = int(np.nanargmax(values) if largest else np.nanargmin(values))
        return {"run": int(self.runs[at]), **self.row(at)}

    def at(self, run: int) -> Diagram:
        """The diagram with the parameters of a run, by its number. Raises RunError where there is none."""
        where = np.flatnonzero(self.runs == run)
        if self.diagram is None or not len(where):
            why = "the diagram is not in the file" if self.diagram is None else f"there are {self.count} runs"
            raise RunError(f"no diagram of run {run}: {why}.")
        return self.diagram.with_parameters({k: plain(v[where[0]]) for k, v in self.parameters.items()})

    def pareto(self, *metrics: str) -> np.ndarray:
        """Positions of the runs that no other one beats in all of these metrics (smaller is better), by the first."""
        if len(metrics) < 2:
            raise RunError("a Pareto front takes two metrics at least.")
        values = np.column_stack([self._numbers(name) for name in metrics])
        order = [k for k in np.lexsort(values.T[::-1]) if np.isfinite(values[k]).all()]
        kept = list[int]()
        for k in order:
            if not any(np.all(values[j] <= values[k]) for j in kept):
                kept.append(int(k))
        return np.array(kept, dtype=int)

    def influence(self, metric: str) -> dict[str, tuple[float, float]]:
        """How a metric moves with each parameter, the most influential first: at its low and at its high end.

        Of a sweep, the metric itself with a parameter at its smallest and largest value. Of other plans, what a
        linear regression foretells with a parameter at its 5 % and 95 % quantiles and the others at their means: how
        much is due to each, as far as that is linear. Raises RunError where fewer runs are finite than that takes.
        """
        from tsmblocks.studies.influence import influence

        return influence(self, metric)

    def quantiles(self, metric: str) -> dict[str, float]:
        """Lowest, 5 %, median, 95 % and highest of a metric, over the runs that have one.

        Between two runs a quantile is interpolated linearly; next to an infinite one it is infinite.
        """
        found = self._numbers(metric)
        values = np.sort(found[~np.isnan(found)])
        if not len(values):
            return dict.fromkeys(QUANTILES, float("nan"))
        return {name: _quantile(values, q) for name, q in QUANTILES.items()}

    def to_pandas(self) -> Any:
        """A frame with a row per run, by its number: parameters, then metrics as they were asked for. Needs pandas.

        ``attrs["units"]`` has the units of the metrics by column.
        """
        names = {name: self.asked.get(name, name) for name in self}
        return frame(
            {title: self[name] for name, title in names.items()},
            self.runs,
            "run",
            {names[name]: unit for name, unit in self.units.items()},
        )

    def to_xarray(self) -> Any:
        """A data set of the metrics, with ``attrs["units"]``. Needs xarray.

        Of a whole grid the parameters are its dimensions; else there is one, ``run``, with the parameters over it.
        """
        facts = {"title": self.title, "kind": self.kind, "status": self.status}
        axes = {k: list(dict.fromkeys(v.tolist())) for k, v in self.parameters.items()}
        shape = tuple(map(len, axes.values()))
        if self.kind == "grid" and np.prod(shape) == len(self) == self.count:
            dims = tuple(axes)
            return dataset(
                {k: (dims, v.reshape(shape), self.units[k]) for k, v in self.metrics.items()},
                {k: ((k,), v, "") for k, v in axes.items()},
                facts,
            )
        coords = {"run": (("run",), self.runs, ""), **{k: (("run",), v, "") for k, v in self.parameters.items()}}
        return dataset({k: (("run",), v, self.units[k]) for k, v in self.metrics.items()}, coords, facts)

    def to_dict(self) -> dict[str, Any]:
        """The summary as plain values."""
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
                    "best": self.best(name) if np.isfinite(self[name]).any() else None,
                }
                for name in self.metrics
            },
        }

    def plot(self, *metrics: str, ax: Any = None) -> Any:
        """What suits the plan: a heat map of a grid of two, a tornado of a sweep, distributions of random runs."""
        return view("plot", self, metrics=metrics, ax=ax)

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        done = (
            f"{len(self)} of {self.count} runs"
            if len(self) < self.count
            else f"{self.count} run{'s' if self.count > 1 else ''}"
        )
        lines = textwrap.wrap(f"{self.title}: {self.kind}, {done} over {', '.join(self.parameters)}", WIDTH)
        if self.failed.any():
            count = int(self.failed.sum())
            have = "runs have" if count > 1 else "run has"
            lines.append(f"{count} {have} a metric that is no number (an unstable loop, say)")
        table = [("", *QUANTILES, "lowest at")]
        for name in self.metrics:
            numbers = self.quantiles(name)
            at = self.best(name) if np.isfinite(self[name]).any() else {}
            where = ", ".join(f"{k} {_short(at[k])}" for k in self.parameters if k in at)
            table.append((heading(name, self.units[name]), *(f"{v:.4g}" for v in numbers.values()), where))
        return "\n".join([*lines, "", in_columns(table, left=(0, len(QUANTILES) + 1))])

    def __repr__(self) -> str:
        return f"Results({self.title!r}, {len(self)} of {self.count} runs, metrics {few(self.metrics)})"


def read_study(path: str | Path) -> Results:
    """Results that ``study`` has written to a .csv file, complete or not; it needs the ``.study.json`` beside it.

    Raises DataError where it holds none.
    """
    path = Path(path)
    table = read_table(path)
    facts = table.facts
    try:
        count, parameters, units = int(facts["runs"]), list(facts["parameters"]), dict(facts["units"])
        wanted = {**dict.fromkeys(parameters, ""), **units}
        title, kind, texts, own = (facts[k] for k in ("title", "kind", "metrics", "parameters"))
        asked = {named(name)[0]: name for name in texts}
        texts = {name: texts[full] for name, full in asked.items()}
    except (KeyError, TypeError, ValueError):
        raise DataError(f"{facts_of(path)}: the facts of the study are not all there.") from None
    if [named(one) for one in table.heading[1:]] != list(wanted.items()):
        raise DataError(f"{path}:1: the heading does not have the parameters and metrics of {facts_of(path).name}.")
    runs = np.array(sorted(table.rows), dtype=int)
    if len(runs) and runs[-1] >= count:
        raise DataError(f"{path}: there are {count} runs, and a row of run {runs[-1]}.")
    columns = {name: _column(table, runs, k) for k, name in enumerate(wanted)}
    for name in units:
        if columns[name].dtype.kind != "f":
            raise DataError(f"{path}: the column '{name}' has a value that is no number.")
    status = "complete" if len(runs) == count else "interrupted"
    return Results(
        title,
        kind,
        count,
        runs,
        {k: columns[k] for k in parameters},
        {k: columns[k] for k in units},
        units,
        texts,
        own,
        status,
        path,
        asked=asked,
    )


def _column(table: Table, runs: np.ndarray, k: int) -> np.ndarray:
    values = [value_of(table.rows[run][k]) for run in runs]
    if all(isinstance(v, float) for v in values):
        return np.array(values, dtype=float)
    made = np.empty(len(values), dtype=object)
    made[:] = values
    return made


def _quantile(ordered: np.ndarray, q: float) -> float:
    """As NumPy's, where values may be infinite: between opposite infinities it is the nearer one."""
    place = round(q * (len(ordered) - 1), 9)  # a place that is off by rounding would mix in a neighbour's infinity
    share = place % 1.0
    low, high = float(ordered[math.floor(place)]), float(ordered[math.ceil(place)])
    if low == high or np.isinf([low, high]).all():
        return low if share < 0.5 else high
    return min(max((1.0 - share) * low + share * high, low), high) if share else low


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
