"""Residuals of simulations against recordings: one row of figures per experiment and output."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common import displayed_units, units
from tsmblocks.common.errors import DataError, near
from tsmblocks.common.frames import frame
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.data import Record
from tsmblocks.fitting.divergence import raise_cause
from tsmblocks.fitting.experiments import signal_of, span
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.parameter_vector import Unknowns
from tsmblocks.fitting.recordings import as_recorded, recordings, with_adopted_units
from tsmblocks.fitting.setup import Setup, experiment_starts, set_up
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import parameter_vector
from tsmblocks.simulation.run import Run


@attrs.frozen(eq=False)
class Difference:
    """One output of one experiment, measured and simulated.

    Attributes
    ----------
    experiment, output : str
        Names of the recording and of the output.
    unit : str
        Unit of ``measured`` and ``simulated``.
    t : numpy.ndarray, shape (samples,)
        Times in s.
    measured, simulated : numpy.ndarray, shape (samples,)
        The signals in ``unit``.
    inputs : dict of str to (numpy.ndarray, str)
        Values at ``t`` and unit of each input.
    """

    experiment: str
    output: str
    unit: str
    t: np.ndarray = attrs.field(repr=False)
    measured: np.ndarray = attrs.field(repr=False)
    simulated: np.ndarray = attrs.field(repr=False)
    inputs: Mapping[str, tuple[np.ndarray, str]] = attrs.field(factory=dict, repr=False)

    @property
    def residual(self) -> np.ndarray:
        """Measured less simulated, in ``unit``."""
        return self.measured - self.simulated

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def peak_to_peak(self) -> float:
        """Greatest less least value of the residual."""
        return float(np.ptp(self.residual))

    @property
    def largest(self) -> float:
        """Greatest magnitude of the residual."""
        return float(np.abs(self.residual).max())

    @property
    def relative(self) -> float:
        """Norm of the residual over the norm of the measured signal."""
        return self.rms / float(np.sqrt(np.mean(self.measured**2)) or np.nan)

    @property
    def fit_percent(self) -> float:
        r"""Share of the measured variation that is explained, in percent.

        .. math:: 100\left(1 - \frac{\|y - \hat y\|}{\|y - \bar y\|}\right)
        """
        return 100 * (1 - self.rms / float(self.measured.std() or np.nan))

    def to(self, unit: str) -> Difference:
        """Return the same in another unit, such as ``"deg"``. Raises UnitError when it does not fit."""
        k = units.factor(self.unit, unit)
        return attrs.evolve(self, unit=unit, measured=k * self.measured, simulated=k * self.simulated)

    def as_displayed(self) -> Difference:
        """Return the same as people read it: in the unit of the recording, angles in degrees."""
        _, shown = displayed_units.display_unit(self.unit)
        return self.to(shown) if shown != self.unit else self

    def in_degrees(self) -> Difference:
        """Return an angle in degrees; anything else as it is."""
        angle = bool(self.unit) and units.parse(self.unit).dimension == units.parse("rad").dimension
        return self.to("deg") if angle else self

    def to_pandas(self) -> Any:
        """A frame indexed by time [s]: the inputs, ``measured``, ``simulated`` and ``residual``. Needs pandas.

        ``attrs["units"]`` has their units.
        """
        driving = {name: values for name, (values, _) in self.inputs.items()}
        own = {"measured": self.measured, "simulated": self.simulated, "residual": self.residual}
        labels = {"t": "s", **{name: unit for name, (_, unit) in self.inputs.items()}, **dict.fromkeys(own, self.unit)}
        return frame({**driving, **own}, self.t, "t", labels)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain values."""
        return {
            "experiment": self.experiment,
            "output": self.output,
            "unit": self.unit,
            "samples": len(self.t),
            "rms": self.rms,
            "largest": self.largest,
            "relative": self.relative,
            "fit_percent": self.fit_percent,
        }


@attrs.frozen(eq=False)
class Differences:
    """Residuals of one diagram on some recordings; by name, ``differences["bend 60"]``.

    Parameters
    ----------
    title : str
        Title of the diagram.
    items : tuple of Difference
        One for each experiment and output.
    """

    title: str
    items: tuple[Difference, ...]

    def __iter__(self) -> Any:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, name: str) -> Difference:
        """Return the difference of an experiment (``"bend 60"``) or of one output of it (``"bend 60.x_out"``)."""
        hits = [d for d in self.items if name in (d.experiment, f"{d.experiment}.{d.output}", d.output)]
        if len(hits) != 1:
            if hits:
                names = " or ".join(f"{d.experiment}.{d.output}" for d in hits)
                raise DataError(f"'{name}' may be the difference {names}. Give the full name.")
            known = {k for d in self.items for k in (d.experiment, f"{d.experiment}.{d.output}")}
            raise DataError(f"there is no difference '{name}'.{near(name, known)}")
        return hits[0]

    @property
    def rms(self) -> float:
        """Root mean square over all experiments, when all outputs have one unit; else of shares of their spread."""
        if self._alike:
            return _rms([d.residual for d in self.items])
        return _rms([d.residual / (d.measured.std() or 1.0) for d in self.items])

    @property
    def unit(self) -> str:
        """Unit of ``rms``; ``""`` when it is a share."""
        return self.items[0].unit if self._alike else ""

    @property
    def is_share(self) -> bool:
        """Whether ``rms`` is a share of the spread of the outputs, which have no unit in common."""
        return not self._alike

    @property
    def _alike(self) -> bool:
        """Whether all are of one output in one unit, so that their residuals may be pooled as they are."""
        return len({(d.unit, d.output) for d in self.items}) == 1

    def plot(self, ax: Any = None, *, width: float | None = None) -> Any:
        """Plot measured and simulated signals, the residual, its loop and its autocorrelation, for each item.

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

    def as_displayed(self) -> Differences:
        """Return the same as people read it.

        Returns
        -------
        Differences
            Items in the units of the recordings, angles in degrees.
        """
        return Differences(self.title, tuple(d.as_displayed() for d in self.items))

    def in_degrees(self) -> Differences:
        """Return the same with angles in degrees.

        Returns
        -------
        Differences
            Items of other dimensions as they are.
        """
        return Differences(self.title, tuple(d.in_degrees() for d in self.items))

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain values.

        Returns
        -------
        dict
            ``rms``, ``unit`` and ``items``.
        """
        return {"rms": self.rms, "unit": self.unit, "items": [d.to_dict() for d in self.items]}

    def to_pandas(self) -> Any:
        """Return a table of the figures.

        Returns
        -------
        pandas.DataFrame
            A row per experiment and output: unit, samples, rms, largest, relative, fit. Needs pandas.
        """
        rows = [d.to_dict() for d in self.items]
        return frame({k: [row[k] for row in rows] for k in rows[0]}).set_index(["experiment", "output"])

    def __repr__(self) -> str:
        names = few(f"{d.experiment}, {d.output}" for d in self.items)
        shown = self.as_displayed()
        return f"Differences({self.title!r}, {names}, {f'rms {shown.rms:.4g} {shown.unit}'.rstrip()})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def __str__(self) -> str:
        return view("text", self)


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(sum(square(p) for p in parts) / sum(len(p) for p in parts)))


def score(
    diagram: Diagram,
    data: Any,
    *,
    parameters: Mapping[str, Any] | None = None,
    outputs: Iterable[str] | None = None,
    window: Any = None,
    step: float | None = None,
    integrator: str = "rk4",
    hold: Hold = AUTO,
    backend: str = "",
) -> Differences:
    """Simulate a diagram on the inputs of recordings and return the residuals of its outputs.

    Each run starts where its recording does, whatever the ``window`` that counts.

    Parameters
    ----------
    diagram : Diagram
        The model.
    data : Record, path, DataFrame, list or dict of str to these
        One recording or several experiments, by name.
    parameters : dict of str to float, optional
        Values by name that replace those of the diagram.
    outputs : list of str, optional
        Outputs to compare; by default all that were measured.
    window : (float, float) or dict of str to these, optional
        Start and stop in s of the samples to compare, by experiment if they differ.
    step : float, optional
        Step of the simulation in s; by default that of the diagram's file, else one that resolves the diagram.
    integrator : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    hold : {"auto", "zero", "linear", "cubic"} or dict of str to these
        Interpolation between samples of the inputs, one for all or by input. By default it is found from the samples:
        zero-order hold where an input is piecewise constant, else linear or a cubic spline.
    backend : {"", "llvm", "casadi"}
        Machine code or CasADi's evaluator; by default machine code where llvmlite is installed.

    Returns
    -------
    Differences
        One item per experiment and output.

    Raises
    ------
    DataError
        For missing signals or unsuitable samples.
    NotFinite
        If a simulation diverges.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.arange(0, 5, 0.01)
    >>> signals = {"x_in": np.sin(2 * t), "x_out": 0.5 * np.sin(2 * t)}
    >>> data = tsm.Record("sweep", t, signals, {"x_in": "rad", "x_out": "rad"})
    >>> residuals = tsm.score(tsm.load("tendon_sheath_linear"), data, parameters={"gain.gain": 0.5, "offset.bias": 0.0})
    >>> residuals.rms < 1e-12
    True
    """
    diagram = as_diagram(diagram, parameters)
    records = recordings(data)
    diagram, _ = with_adopted_units(diagram, records)
    setup = set_up(
        diagram, records, outputs=outputs, window=window, step=step, integrator=integrator, hold=hold, backend=backend
    )
    unknowns = Unknowns((), setup.eq.p, parameter_vector(setup.eq, diagram), tuple(records), experiment_starts(setup))
    return simulated_differences(setup, list(unknowns.bases))


def simulated_differences(setup: Setup, parameters: Sequence[np.ndarray]) -> Differences:
    """Differences of a set-up under parameters of each experiment. Raises NotFinite where a simulation diverges."""
    made = list[Difference]()
    labels = {k: as_recorded(setup.diagram, k, (one.record for one in setup.experiments)) for k in setup.outputs}
    for experiment, p in zip(setup.experiments, parameters, strict=True):
        y, driven = experiment.outputs(p), _driven(setup.diagram, experiment.record, experiment.t)
        if not np.isfinite(y).all():
            raise_cause(setup.diagram, experiment, p)
        for i, name in enumerate(setup.outputs):
            unit, counted = labels[name], experiment.counted
            kept: Any = slice(None) if counted is None else counted[:, i] > 0
            inputs = {k: (values[kept], label) for k, (values, label) in driven.items()}
            t, measured, simulated = experiment.t[kept], experiment.measured[kept, i], y[kept, i]
            made.append(Difference(experiment.name, name, unit, t, measured, simulated, inputs))
    return Differences(setup.diagram.title, tuple(made))


def of_run(diagram: Diagram, run: Run, record: Record, outputs: Iterable[str]) -> Differences:
    """Differences between a run of a diagram and a recording of its outputs, at the instants that both have.

    The run is interpolated between its steps. Raises DataError for measured samples that cannot be used, and for a
    recording that has next to none within the run.
    """
    cut = span(record.name, record, (float(run.t[0]), float(run.t[-1])))
    t, made = record.t[cut], list[Difference]()
    driven = _driven(diagram, record, t)
    for name in outputs:
        unit = displayed_units.displayed_in(run.unit(name) or record.unit(name), [record.unit(name)])
        y = np.interp(t, run.t, run[name])
        measured = signal_of(record.name, record, name, run.unit(name))[cut]
        made.append(Difference(record.name, name, unit, t, measured, y, driven))
    return Differences(run.title, tuple(made))


def _driven(diagram: Diagram, record: Record, t: np.ndarray) -> dict[str, tuple[np.ndarray, str]]:
    """The inputs of an experiment at the instants ``t`` [s], in the units of the diagram's ports."""
    return {
        name: (
            np.interp(t, record.t, record.values(name, port.unit)),
            displayed_units.displayed_in(port.unit or record.unit(name), [record.unit(name)]),
        )
        for name, port in diagram.inports.items()
    }
