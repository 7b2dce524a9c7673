"""Frequency response of a nonlinear diagram by simulation: gain, phase and harmonics for sines of different size."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.analysis.operating_point import HELD_SUFFIX
from tsmblocks.blocks import Sine
from tsmblocks.common.arguments import as_integer, as_number, as_positive
from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import RunError, in_words, near
from tsmblocks.common.frames import dataset, frame, optional_library
from tsmblocks.common.tables import few, listed
from tsmblocks.common.views import view
from tsmblocks.engine.equations import Equations
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions, as_diagram, as_inputs
from tsmblocks.simulation.batch import batch_of
from tsmblocks.simulation.compiled import equations

PERIODICITY_TOLERANCE = 1e-4
"""Change of a signal from one period to the next, as a share of its size, that counts as periodic. Chosen."""
MOST_SETTLING_PERIODS = 1024
"""Periods that are left out, at most. Chosen."""
MOST_STEPS = 20_000_000
"""Steps of one run, at most. Chosen: some seconds."""
SOURCE_NAME = "tone"
"""Name of the Sine block that replaces an input."""
NO_MOTION = 1e-12
"""Motion of the output, as a share of that of the input and of its own size, that is rounding. Chosen."""


class SettlingWarning(UserWarning):
    """The responses to some sines never become periodic."""


@attrs.frozen(eq=False)
class FrequencyResponse:
    """The response to sines of several frequencies and amplitudes.

    It is NaN where a response never becomes periodic, or a run diverges, and 0, without phase and harmonics (NaN),
    where the output does not move.

    Parameters
    ----------
    title : str
        Title of the diagram.
    driven, output : str
        The input, or the Sine block; the output.
    frequencies, amplitudes : ndarray, shapes (F,) and (A,)
        Frequencies in Hz; amplitudes in ``unit``.
    response : ndarray of complex, shape (A, F)
        Output over input at the frequency of the sine.
    harmonics : ndarray, shape (A, F, harmonics - 1)
        Sizes at 2, 3, … times the frequency as shares of that at the frequency itself.
    unit, output_unit : str, optional
        Units of the input and the output, ``""`` where they are not known.
    """

    title: str
    driven: str
    output: str
    frequencies: np.ndarray
    amplitudes: np.ndarray
    response: np.ndarray = attrs.field(repr=False)
    harmonics: np.ndarray = attrs.field(repr=False)
    unit: str = ""
    output_unit: str = ""

    @property
    def gain(self) -> np.ndarray:
        """Size of the output over that of the input, shape (amplitudes, frequencies)."""
        return np.abs(self.response)

    @property
    def phase(self) -> np.ndarray:
        """Phase of the output in degrees, shape (amplitudes, frequencies), unwrapped along frequency."""
        phase = np.full(self.response.shape, np.nan)
        for row, values in zip(phase, self.response, strict=True):
            known = np.isfinite(values) & (values != 0)
            row[known] = np.degrees(np.unwrap(np.angle(values[known])))
        return phase

    @property
    def distortion(self) -> np.ndarray:
        """Root of the sum of squares of the harmonics, shape (amplitudes, frequencies)."""
        return np.sqrt((self.harmonics**2).sum(axis=2))

    @property
    def _columns(self) -> dict[str, np.ndarray]:
        return {"gain": self.gain, "phase": self.phase, "distortion": self.distortion}

    def to_pandas(self) -> Any:
        """A table with a row for each amplitude and frequency.

        Returns
        -------
        pandas.DataFrame
            Gain, phase [deg] and distortion. Needs pandas.
        """
        axes = {"amplitude": self.amplitudes, "frequency": self.frequencies}
        index = optional_library("pandas").MultiIndex.from_product(axes.values(), names=axes)
        return frame({name: v.ravel() for name, v in self._columns.items()}, index, units={"phase": "deg"})

    def to_xarray(self) -> Any:
        """Gain, phase [deg] and distortion over ``amplitude`` and ``frequency`` [Hz].

        Returns
        -------
        xarray.Dataset
            The response. Needs xarray.
        """
        dims = ("amplitude", "frequency")
        variables = {k: (dims, v, "deg" if k == "phase" else "") for k, v in self._columns.items()}
        coords = {"amplitude": (dims[:1], self.amplitudes, ""), "frequency": (dims[1:], self.frequencies, "Hz")}
        return dataset(variables, coords, {"title": self.title, "driven": self.driven, "output": self.output})

    def __repr__(self) -> str:
        sizes = few(f"{a:.3g}" for a in self.amplitudes)
        points = f"{len(self.frequencies)} frequencies, sizes {sizes}"
        return f"FrequencyResponse({self.title!r}, {self.output} over {self.driven}, {points})"

    def _repr_html_(self) -> str:
        return view("html", self)

    def plot(self, ax: Any = None, *, width: float | None = None) -> Any:
        """Plot gain in dB, phase and distortion over frequency, a line for each amplitude.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes, optional
            Where to draw. By default in a new figure.
        width : float, optional
            Width of a new figure [in]. By default 7, both columns of a paper; 3.4 is one.

        Returns
        -------
        matplotlib.figure.Figure
            The figure. Needs matplotlib.
        """
        return view("plot", self, ax=ax, width=width)


def frequency_response(
    diagram: Diagram,
    frequencies: Sequence[float] | np.ndarray,
    amplitudes: Sequence[float] | float = 1.0,
    *,
    driven: str | None = None,
    output: str | None = None,
    bias: float | None = None,
    inputs: Mapping[str, Any] | None = None,
    settle: int = 4,
    periods: int = 2,
    samples: int = 200,
    harmonics: int = 5,
    step: float = 1e-3,
    method: str = "rk4",
    threads: int | None = None,
    backend: str = "",
) -> FrequencyResponse:
    """The periodic response of a nonlinear diagram to sines, by simulation.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    frequencies : list of float
        Frequencies in Hz.
    amplitudes : list of float or float, default 1.0
        Amplitudes in the unit of the input.
    driven : str, optional
        An input of the diagram, or a Sine block in it. By default the only one.
    output : str, optional
        A signal. By default the only output of the diagram.
    bias : float, optional
        Mean of the sine. By default zero for an input, and the offset of a Sine block.
    inputs : dict of str to float, optional
        The other inputs, constant.
    settle : int, default 4
        Periods that are left out; more, up to 1024, where the response still changes from period to period.
    periods : int, default 2
        Periods of which the harmonics are taken.
    samples, harmonics : int, defaults 200 and 5
        Steps of a period, at least; the highest harmonic.
    step : float, default 1e-3
        Longest step in s.
    method : {"rk4", "euler", "heun", "sdirk2", "sdirk3", "sdirk4"}
        Runge-Kutta method.
    threads : int, optional
        Number of threads. By default one for each processor.
    backend : {"", "llvm", "casadi"}
        As for ``simulate``.

    Returns
    -------
    FrequencyResponse
        Gain, phase and harmonics. Outputs of sampled blocks count as held; where such jumps are delayed or added to a
        continuous signal, the phase is known to half a step.

    Raises
    ------
    RunError
        For an unknown input or output, and where the period of a sampled block is no multiple of the step.

    Warns
    -----
    SettlingWarning
        Where a response does not become periodic; it is NaN there.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> from tsmblocks.analysis import frequency_response
    >>> from tsmblocks.blocks import FirstOrderLag
    >>> lag = tsm.Diagram(
    ...     blocks={"lag": FirstOrderLag(time_constant=0.1)}, wires=[], inputs={"u": "lag.u"}, outputs={"y": "lag.y"}
    ... )
    >>> response = frequency_response(lag, [1.0])
    >>> print(f"{response.gain[0, 0]:.3f}, {response.phase[0, 0]:.1f} deg")
    0.847, -32.1 deg
    """
    diagram = as_diagram(diagram)
    tuned, source = _driven(diagram, driven, None if bias is None else as_number("bias", bias))
    shown = _output(tuned, output)
    held = _is_held(equations(tuned), shown)
    f, a = _positive("frequencies", frequencies), _positive("amplitudes", amplitudes)
    count, settling = as_integer("periods", periods, 1), as_integer("settle", settle, 0)
    most = as_integer("harmonics", harmonics, 1)
    longest, least = as_positive("step", step), as_integer("samples", samples, 4 * most)
    constant, kept = as_inputs(inputs), list(dict.fromkeys([f"{source}.y", shown]))
    response = np.full((len(a), len(f)), np.nan, dtype=complex)
    overtones = np.full((len(a), len(f), most - 1), np.nan)
    for k, frequency in enumerate(f):
        n, left_out = max(least, math.ceil(1.0 / (frequency * longest))), settling
        if n * (left_out + count) > MOST_STEPS:
            raise RunError(
                f"a run at {frequency:g} Hz would take {n * (left_out + count):,} steps. Take a longer step, or leave "
                "such frequencies out."
            )
        harmonics_of = _Harmonics(f"{source}.y", shown, n, count, most, held)
        waiting = np.arange(len(a))
        while len(waiting):
            sets = {f"{source}.amplitude": a[waiting], f"{source}.frequency": np.full(len(waiting), frequency)}
            stop = (left_out + count) / frequency
            options = RunOptions(stop, 1.0 / (frequency * n), 0.0, method, constant, "zero", backend=backend)
            batch = batch_of(tuned, sets, options, kept)
            values = batch.results(0, batch.count, harmonics_of, threads)
            settled = ~(values["change"] > PERIODICITY_TOLERANCE)
            done = waiting[settled]
            response[done, k] = values["response"][settled]
            for m in range(2, most + 1):
                overtones[done, k, m - 2] = values[f"harmonic {m}"][settled]
            waiting, left_out = waiting[~settled], 4 * max(left_out, 1)
            if left_out > MOST_SETTLING_PERIODS or n * (left_out + count) > MOST_STEPS:
                break
    name, unit = driven or (next(iter(diagram.inputs)) if source == SOURCE_NAME else source), tuned.unit(f"{source}.y")
    _warn_of_unsettled(shown, f, a, np.isnan(response), unit)
    return FrequencyResponse(diagram.title, name, shown, f, a, response, overtones, unit, tuned.unit(shown))


def _warn_of_unsettled(shown: str, f: np.ndarray, a: np.ndarray, where: np.ndarray, unit: str) -> None:
    if not where.any():
        return
    factor, label = display_unit(unit)
    points = [f"{factor * a[i]:.3g} {label}".rstrip() + f" at {f[k]:.3g} Hz" for i, k in np.argwhere(where)]
    warnings.warn(
        f"the response of '{shown}' to {len(points)} of {where.size} sines never becomes periodic: {listed(points, 3)}"
        ". It is NaN there. Causes are a limit cycle or a drifting signal; tsm.simulate shows which.",
        SettlingWarning,
        stacklevel=3,
    )


@attrs.frozen
class _Harmonics:
    """The harmonics of the last ``count`` periods of runs, ``n`` steps each, up to the ``most``-th."""

    driven: str
    shown: str
    n: int
    count: int
    most: int
    held: bool
    """Whether the output is that of sampled blocks, constant over a step."""

    def __call__(self, t: np.ndarray, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        x, y = (signals[name][-self.n * self.count - 1 : -1] for name in (self.driven, self.shown))
        last, before = (signals[self.shown][len(t) - 1 - k * self.n : len(t) - 1 - (k - 1) * self.n] for k in (1, 2))
        turns = np.exp(-2j * np.pi * np.outer(np.arange(1, self.most + 1), np.arange(len(x))) / self.n)
        with np.errstate(all="ignore"):
            into, out = turns[:1] @ x, turns @ y
            if self.held:
                angles = 2j * np.pi * np.arange(1, self.most + 1) / self.n
                out = out * ((1.0 - np.exp(-angles)) / angles)[:, None]  # the integral over a step, not its first value
            size = np.maximum(np.abs(last - last.mean(axis=0)).max(axis=0), NO_MOTION * np.abs(x).max(axis=0))
            change = np.abs(last - before).max(axis=0) / size if len(before) == len(last) else np.inf * size
            reach = np.maximum(np.abs(x).max(axis=0), np.abs(y).max(axis=0))
            still = np.abs(y - y.mean(axis=0)).max(axis=0) <= NO_MOTION * reach
            shares = np.where(still, np.nan, np.abs(out / out[0]))
            harmonics = {f"harmonic {m}": shares[m - 1] for m in range(2, self.most + 1)}
            response = np.where(still, 0.0, out[0] / into[0])
        return {"response": response, "change": np.where(still, 0.0, change), **harmonics}


def _driven(diagram: Diagram, name: str | None, bias: float | None) -> tuple[Diagram, str]:
    """The diagram with a Sine block of variable amplitude and frequency, and the name of that block."""
    sines = [k for k, b in diagram.blocks.items() if isinstance(b, Sine)]
    known = [*diagram.inputs, *sines]
    if name is None:
        if len(diagram.inputs) != 1 and (diagram.inputs or len(sines) != 1):
            raise RunError(f"choose which input of '{diagram.title}' is driven: driven='…'.{near('', known)}")
        name = known[0]
    if name in sines:
        return diagram if bias is None else diagram.with_parameters({f"{name}.offset": bias}), name
    if name not in diagram.inputs:
        raise RunError(f"'{diagram.title}' has no input and no Sine block '{name}'.{near(name, known)}")
    if SOURCE_NAME in diagram.blocks:
        raise RunError(f"'{diagram.title}' has a block '{SOURCE_NAME}', which is the name of the source added here.")
    tone = Sine(unit=diagram.inports[name].unit, offset=bias or 0.0)
    driven = diagram.rewire(
        blocks={**diagram.blocks, SOURCE_NAME: tone},
        inputs={k: v for k, v in diagram.inputs.items() if k != name},
        add=[f"{SOURCE_NAME} -> {', '.join(diagram.inputs[name].ports)}"],
    )
    return driven, SOURCE_NAME


def _is_held(eq: Equations, name: str) -> bool:
    """Whether a signal is made of held outputs of sampled blocks alone."""
    signal = eq.aliases.get(name, name)
    if signal not in eq.y:
        return False
    t, x, d, u, q, p = eq.rhs.sx_in()
    value = eq.rhs.call([t, x, d, u, q, p])[1][eq.y.index(signal)]
    moving = ca.vertcat(t, x, u, q, *(d[k] for k, name in enumerate(eq.d) if not name.endswith(HELD_SUFFIX)))
    return bool(ca.depends_on(value, d) and not ca.depends_on(value, moving))


def _output(diagram: Diagram, name: str | None) -> str:
    if name is not None:
        return name
    if len(diagram.outputs) != 1:
        known = near("", diagram.outputs)
        raise RunError(f"choose which signal of '{diagram.title}' is the output: output='…'.{known}")
    return next(iter(diagram.outputs))


def _positive(what: str, values: Any) -> np.ndarray:
    try:
        array = np.atleast_1d(np.asarray(values, dtype=float)) if not isinstance(values, str) else np.empty(0)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != 1 or not len(array) or not (np.isfinite(array) & (array > 0)).all():
        raise RunError(f"{what} must be positive numbers, got {in_words(values)}.")
    return array
