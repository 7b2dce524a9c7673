"""The result of a fit: the fitted diagram, estimates with their intervals, and parameters that are not identifiable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, ParameterError, near
from tsmblocks.common.frames import frame
from tsmblocks.common.interpolation import Hold
from tsmblocks.common.views import view
from tsmblocks.data import Record
from tsmblocks.fitting.identifiability import Undetermined
from tsmblocks.fitting.optimizer import OptimizerResult
from tsmblocks.fitting.score import Differences
from tsmblocks.fitting.statistics import correlation
from tsmblocks.model.diagram import Diagram

if TYPE_CHECKING:
    from tsmblocks.simulation.run import Run

STATUS = {
    "converged": "converged",
    "limit": "stopped at the limit of iterations; it may not have converged",
    "stalled": "ended where no step reduced the cost any more (a kink, or rounding)",
    "interrupted": "interrupted; these are the best parameters so far",
}


@attrs.frozen
class Estimate:
    """One estimated parameter with its confidence interval (95 % by default).

    ``low`` and ``high`` are NaN where it is not identifiable; ``verdict`` then says why
    (``"no influence"``, ``"not determined"``), and ``"at its lower bound"`` where a bound holds it.
    ``is_start`` marks the initial value of a state.
    """

    name: str
    value: float
    error: float
    low: float
    high: float
    unit: str = ""
    about: str = ""
    start: float = float("nan")
    verdict: str = ""
    is_start: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain values."""
        return attrs.asdict(self)


@attrs.frozen(eq=False)
class Fit:
    """A diagram fitted to recordings.

    Parameters
    ----------
    diagram : Diagram
        The fitted diagram; parameters that differ between experiments as in the first.
    diagrams : dict of str to Diagram
        The fitted diagram of each experiment.
    estimates : tuple of Estimate
        Parameters with their confidence intervals.
    differences : Differences
        Residuals by experiment and output.
    covariance : numpy.ndarray, shape (unknowns, unknowns)
        Covariance of the estimates, which accounts for the autocorrelation of the residuals.
    undetermined : tuple of Undetermined
        Parameters that are not identifiable from these data.
    active : tuple of str
        Active bounds and constraints.
    method : str
        As given to ``fit``.
    searches : tuple of OptimizerResult
        Outcome from every starting point, best first.
    agreeing : int
        How many of these reached the same optimum.
    step : float
        Step of the simulation in s; the finest one, where that of each experiment is another (``diagram.simulation``).
    integrator : str
        As given to ``fit``.
    hold : str or dict of str to str
        Interpolation of all inputs between samples, or by input; ``"auto"`` where experiments differ.
    records : dict of str to Record
        The recordings by experiment.
    notes : tuple of str
        Remarks on data, step and result.
    fixed_in_doubt : dict of str to tuple of str
        By output with a residual far above the noise, fixed parameters whose change would remove much of it.
    """

    diagram: Diagram
    diagrams: Mapping[str, Diagram] = attrs.field(repr=False)
    estimates: tuple[Estimate, ...]
    differences: Differences = attrs.field(repr=False)
    covariance: np.ndarray = attrs.field(repr=False)
    undetermined: tuple[Undetermined, ...]
    active: tuple[str, ...]
    method: str
    searches: tuple[OptimizerResult, ...] = attrs.field(repr=False)
    agreeing: int
    step: float
    integrator: str
    hold: Hold
    records: Mapping[str, Record] = attrs.field(repr=False)
    notes: tuple[str, ...] = ()
    fixed_in_doubt: Mapping[str, tuple[str, ...]] = attrs.field(factory=dict, repr=False)

    @property
    def status(self) -> str:
        """How the best search ended: converged, limit, stalled; interrupted when Ctrl-C ended any."""
        ends = [s.status for s in self.searches]
        return "interrupted" if "interrupted" in ends else ends[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimates, in the order of ``covariance``."""
        return tuple(e.name for e in self.estimates)

    @property
    def values(self) -> dict[str, float]:
        """Estimated values by name."""
        return {e.name: e.value for e in self.estimates}

    @property
    def rms(self) -> float:
        """Root mean square of the residual, in the unit of ``differences``."""
        return self.differences.rms

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the estimates, shape (unknowns, unknowns); NaN for those at a bound or not identifiable."""
        return correlation(self.covariance)

    @property
    def runs(self) -> dict[str, Run]:
        """A run of each experiment with the estimates, all signals logged."""
        from tsmblocks.fitting.experiments import inputs
        from tsmblocks.simulation.simulate import simulate

        made = {}
        for name, diagram in self.diagrams.items():
            record = self.records[name]
            made[name] = simulate(
                diagram,
                start=float(record.t[0]),
                step=diagram.simulation.step_of(name) or self.step,
                method=self.integrator,
                inputs=inputs(record, diagram, self.hold),
            )
        return made

    def __getitem__(self, name: str) -> Estimate:
        """Return an estimate by name, or by its last part where that is clear. Raises ParameterError."""
        hits = [e for e in self.estimates if e.name == name]
        hits = hits or [e for e in self.estimates if e.name.rpartition(".")[2] == name]
        if len(hits) != 1:
            if hits:
                raise ParameterError(
                    f"'{name}' may be {' or '.join(e.name for e in hits)} in this fit. Give the full name."
                )
            raise ParameterError(f"the fit has no estimate '{name}'.{near(name, self.names)}")
        return hits[0]

    def __iter__(self) -> Iterator[Estimate]:
        return iter(self.estimates)

    def save(self, path: str | Path) -> Path:
        """Write the fitted diagram as TOML.

        Parameters
        ----------
        path : str or Path
            File ending in ``.toml``.

        Returns
        -------
        Path
            The path.

        Raises
        ------
        DataError
            For another ending.
        """
        from tsmblocks.files import save

        if (ending := Path(path).suffix).lower() != ".toml":
            raise DataError(
                f"'{path}' ends in '{ending}'; a fitted diagram is written to .toml. Estimates and intervals are in "
                "to_dict() and to_pandas()."
            )
        save(self.diagram, path)
        return Path(path)

    def plot(self, ax: Any = None, *, width: float | None = None) -> Any:
        """Plot time histories, loops, residuals and their autocorrelation.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw into; by default a new figure.
        width : float, optional
            Width of a new figure [in]; 7 by default, which is both columns of a paper. One column is 3.4.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. Needs matplotlib.
        """
        return view("plot", self, ax=ax, width=width)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the signals as plain values.

        Returns
        -------
        dict
            As ``tsmblocks fit --json`` prints it.
        """
        from tsmblocks.fitting.above_noise import beyond_noise
        from tsmblocks.fitting.recorded_range import beyond_range

        return {
            "format": 1,
            "diagram": self.diagram.title,
            "method": self.method,
            "status": self.status,
            "step": self.step,
            "estimates": [e.to_dict() for e in self.estimates],
            "correlation": self.correlation.tolist(),
            "undetermined": [{"names": list(u.names), "words": u.words} for u in self.undetermined],
            "active": list(self.active),
            "differences": self.differences.to_dict(),
            "starts": {
                "tried": len(self.searches),
                "agreeing": self.agreeing,
                "rms": [float(np.sqrt(2 * s.cost / max(self._samples, 1))) for s in self.searches],
            },
            "evaluations": sum(s.evaluations for s in self.searches),
            "notes": [*self.notes, *beyond_range(self), *beyond_noise(self)],
        }

    @property
    def _samples(self) -> int:
        return sum(len(d.t) for d in self.differences)

    def to_pandas(self) -> Any:
        """Return a table of the estimates.

        Returns
        -------
        pandas.DataFrame
            A row per parameter, by its name: value, error, low, high, unit, verdict, … Needs pandas.
        """
        rows = [e.to_dict() for e in self.estimates]
        return frame(
            {k: [row[k] for row in rows] for k in (rows[0] if rows else {}) if k != "name"}, self.names, "name"
        )

    def __repr__(self) -> str:
        one = self.differences.as_displayed()
        error = f"rms {one.rms:.4g} {one.unit}".rstrip()
        return f"Fit({self.diagram.title!r}, {self.status}, {len(self.estimates)} numbers, {error})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        return view("text", self)
