"""The result of optimal control: its commands simulated with the exact equations in finer steps."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping

import attrs
import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.common.tables import few
from tsmblocks.common.views import view
from tsmblocks.metrics.expressions import Expression
from tsmblocks.metrics.tracking import peak_to_peak, rms
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.fields import Samples
from tsmblocks.optimal.transcription import Interval, KnownSignals, Solution, Task, Window, known_rows, linear_samples
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate

REFINEMENT = 4
"""Factor by which the steps of the simulation are finer than those of the search. Chosen."""
LIMIT_TOLERANCE = 0.01
"""Violation of a limit between the instants of the search that is accepted, as a share of its range. Chosen."""
PERIODICITY_TOLERANCE = 0.01
"""Difference of the last and the first state of a periodic run, as a share of its range, accepted. Chosen."""


@attrs.frozen(eq=False)
class OptimalControl:
    """The commands that were found, and the run with them.

    Parameters
    ----------
    goal : str
        The measure of the error that was minimised, "peak" or "rms".
    t : ndarray
        Samples of the commands in s, shape (N,).
    commands : dict of str to ndarray
        Commands at the samples, shape (N,), linear in between, in the unit of the input.
    states : dict of str to float
        Initial states.
    periodic : bool
        Whether the run is periodic.
    run : Run
        The simulation of the diagram with the commands.
    error : ndarray
        The error, shape (M,), at samples from either side: where the rate of a command jumps, an output may jump.
    unit : str
        Unit of the error.
    missed : float
        The largest violation of a limit, between samples too.
    found : bool
        Whether the search ended at a local optimum and the run keeps the limits (and ends where it started, if
        periodic).
    word : str
        The reason where ``found`` is False, else the status of the solver.
    seconds : ndarray, optional
        Computing time of each sample in s, where it was planned sample by sample.
    """

    goal: str
    t: np.ndarray
    commands: Mapping[str, np.ndarray]
    states: Mapping[str, float]
    periodic: bool
    run: Run = attrs.field(repr=False)
    error: np.ndarray = attrs.field(repr=False)
    unit: str
    missed: float
    found: bool
    word: str
    seconds: np.ndarray = attrs.field(factory=lambda: np.empty(0), repr=False)

    @property
    def peak(self) -> float:
        """The largest absolute error."""
        return float(np.abs(self.error).max())

    @property
    def peak_to_peak(self) -> float:
        """Highest minus lowest error."""
        return peak_to_peak(self.error)

    @property
    def rms(self) -> float:
        """Root mean square of the error."""
        return rms(self.error)

    def inputs(self, stop: float | None = None) -> dict[str, Samples]:
        """The commands as ``simulate`` takes them.

        Parameters
        ----------
        stop : float, optional
            End in s; up to there periodic commands are repeated, others hold their last value. By default the last
            sample.

        Returns
        -------
        dict of str to Samples
            The commands.

        Raises
        ------
        RunError
            For a ``stop`` before the start.
        """
        end, step = self.t[-1] if stop is None else as_number("stop", stop), self.t[1] - self.t[0]
        if end <= self.t[0]:
            raise RunError(f"the commands start at {self.t[0]:g} s, so they cannot stop at {end:g} s.")
        if end <= self.t[-1] + 1e-6 * step:
            kept = int(np.searchsorted(self.t, end - 1e-6 * step)) + 1
            return {k: linear_samples(self.t[:kept], v[:kept]) for k, v in self.commands.items()}
        if not self.periodic:
            t = np.append(self.t, end)
            return {k: linear_samples(t, np.append(v, v[-1])) for k, v in self.commands.items()}
        period = self.t[-1] - self.t[0]
        times = math.ceil((end - self.t[0]) / period - 1e-9)
        t = np.concatenate([[self.t[0]], *(self.t[1:] + k * period for k in range(times))])
        return {k: linear_samples(t, np.concatenate([v[:1], *[v[1:]] * times])) for k, v in self.commands.items()}

    def __repr__(self) -> str:
        return f"OptimalControl({self.run.title!r}, {few(self.commands)}, {len(self.t)} samples, {self._figures})"

    def _repr_html_(self) -> str:
        return view("html", self)

    @property
    def _figures(self) -> str:
        """Peak to peak, peak and rms of the error, angles in degrees."""
        scale, unit = display_unit(self.unit)
        numbers = {"peak to peak": self.peak_to_peak, "peak": self.peak, "rms": self.rms}
        return ", ".join(f"{what} {scale * v:.3g} {unit}".rstrip() for what, v in numbers.items())

    def __str__(self) -> str:
        ended = "" if self.found else f" (not the end of the search: {self.word})"
        return f"{self.run.title}: smallest {self.goal} of the error found: {self._figures}{ended}"


def simulated_result(
    diagram: Diagram,
    interval: Interval,
    goal: str,
    periodic: bool,
    ended: Solution,
    begin: np.ndarray,
    start: float,
    given: KnownSignals,
) -> OptimalControl:
    """The commands simulated with the exact equations, without smoothing and in finer steps.

    Raises RunError where the simulation diverges.
    """
    task, count = interval.task, ended.commands.shape[1] - 1
    fine = Interval(task, interval.step, REFINEMENT * interval.pieces)
    t = start + interval.step * np.arange(count + 1)
    values = task.within(ended.commands)
    commands = dict(zip(task.commands, values, strict=True))
    x = ended.states[:, 0] if periodic else begin
    states = dict(zip(task.eq.x, x.tolist(), strict=True))
    try:
        run = simulate(
            diagram,
            start=float(t[0]),
            stop=float(t[-1]),
            step=fine.step / fine.pieces,
            inputs={**given.inputs, **{k: linear_samples(t, v) for k, v in commands.items()}},
            hold=given.hold,
            initial=states,
        )
    except NotFinite as failed:
        raise RunError(
            f"with these commands the equations are not finite: {failed} Use more pieces for each "
            f"interval (pieces={2 * interval.pieces}), or narrower ranges."
        ) from failed
    path, error, limits = Window(fine, start, known_rows(task, given, fine.grid(start, count))).simulated(values, x)
    missed, amiss = _missed(task, limits)
    amiss = ended.word if not ended.found else amiss or (_open(task, path) if periodic else "")
    unit, word = _unit(task.error, run), amiss or ended.word
    return OptimalControl(goal, t, commands, states, periodic, run, error.ravel(), unit, missed, not amiss, word)


def _missed(task: Task, limits: np.ndarray) -> tuple[float, str]:
    """The largest violation of a limit, and a text if it is above ``LIMIT_TOLERANCE``."""
    worst, word = 0.0, ""
    for k, one in enumerate(task.limits):
        values = limits[:, k]
        amount = max(-float(values.min()), 0.0)
        worst = max(worst, amount)
        if amount > LIMIT_TOLERANCE * max(float(np.ptp(values)), 1e-12) and not word:
            word = f"'{one.text}' is violated by up to {amount:.3g}"
    return worst, word


def _open(task: Task, path: np.ndarray) -> str:
    """A text where a periodic run does not end at its initial state."""
    gaps = np.abs(path[:, -1] - path[:, 0]) / np.maximum(np.ptp(path, axis=1), 1e-12)
    if not np.any(gaps > PERIODICITY_TOLERANCE):
        return ""
    return f"{task.eq.x[int(np.argmax(gaps))]} does not end at its initial value"


def _unit(error: Expression, run: Run) -> str:
    """The unit of an error that is a sum or difference of signals, ``""`` where none is known."""
    kinds = (ast.BinOp, ast.Add, ast.Sub, ast.UnaryOp, ast.USub, ast.UAdd, ast.Name, ast.Attribute, ast.Load)
    if not all(isinstance(node, kinds) for node in ast.walk(error.tree)):
        return ""
    return next((run.unit(name) for name in error.names if name in run and run.unit(name)), "")
