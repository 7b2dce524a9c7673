"""What an optimal control is worth: its commands run through the equations as they are, and looked at closely."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.common.tables import few
from tsmblocks.common.units import for_people
from tsmblocks.common.views import view
from tsmblocks.metrics.expressions import Expression
from tsmblocks.metrics.tracking import peak_to_peak, rms
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.fields import Samples
from tsmblocks.optimal.transcription import Given, Interval, Solution, Task, given_rows, straight
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate

FINER = 4
"""How much finer than the search the result is run."""
OVER = 0.01
"""Share of what a limit compares by which it may be missed between the instants that the search looks at."""
APART = 0.01
"""Share of a state's size by which a periodic run may end apart from where it began."""


@attrs.frozen(eq=False)
class OptimalControl:
    """Commands found, and the run with them.

    ``t`` (N,) [s] are the samples and ``commands`` maps inputs to their values there, linear in between. ``states`` are
    those at the start. ``run`` is the simulation of the diagram as it is with them; ``error`` (M,) is the error on the
    way, at samples from either side: where a command's rate jumps, so may an output. ``missed`` is by how much a limit
    was missed at most, between samples too. ``found`` says whether the search ended where nothing nearby is better and
    the run keeps the limits (and closes, where it is periodic); ``word`` says why not, or is the solver's own.
    ``seconds`` tells how long each sample took, where it was planned sample by sample.
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
        """The largest error."""
        return float(np.abs(self.error).max())

    @property
    def peak_to_peak(self) -> float:
        """Highest less lowest error."""
        return float(peak_to_peak(self.error))

    @property
    def rms(self) -> float:
        """Root of the mean square of the error."""
        return float(rms(self.error))

    def inputs(self, stop: float | None = None) -> dict[str, Samples]:
        """The commands as ``simulate`` takes them, up to ``stop`` [s]: periodic ones go on, others hold their last.

        Raises RunError where ``stop`` lies before the start.
        """
        end, step = self.t[-1] if stop is None else as_number("stop", stop), self.t[1] - self.t[0]
        if end <= self.t[0]:
            raise RunError(f"the commands begin at {self.t[0]:g} s, so they cannot stop at {end:g} s.")
        if end <= self.t[-1] + 1e-6 * step:
            kept = int(np.searchsorted(self.t, end - 1e-6 * step)) + 1
            return {k: straight(self.t[:kept], v[:kept]) for k, v in self.commands.items()}
        if not self.periodic:
            t = np.append(self.t, end)
            return {k: straight(t, np.append(v, v[-1])) for k, v in self.commands.items()}
        period = self.t[-1] - self.t[0]
        times = math.ceil((end - self.t[0]) / period - 1e-9)
        t = np.concatenate([[self.t[0]], *(self.t[1:] + k * period for k in range(times))])
        return {k: straight(t, np.concatenate([v[:1], *[v[1:]] * times])) for k, v in self.commands.items()}

    def __repr__(self) -> str:
        return f"OptimalControl({self.run.title!r}, {few(self.commands)}, {len(self.t)} samples, {self._figures})"

    def _repr_html_(self) -> str:
        return view("html", self)

    @property
    def _figures(self) -> str:
        """Peak to peak, peak and rms of the error, angles in degrees."""
        scale, unit = for_people(self.unit)
        numbers = (self.peak_to_peak, self.peak, self.rms)
        return ", ".join(
            f"{what} {scale * v:.3g} {unit}".rstrip()
            for what, v in zip(("peak to peak", "peak", "rms"), numbers, strict=True)
        )

    def __str__(self) -> str:
        ended = "" if self.found else f" (not the end of the search: {self.word})"
        return f"{self.run.title}: smallest {self.goal} of the error found: {self._figures}{ended}"


def outcome(
    diagram: Diagram,
    interval: Interval,
    goal: str,
    periodic: bool,
    ended: Solution,
    begin: np.ndarray,
    start: float,
    given: Given,
) -> OptimalControl:
    """The commands as they are in truth: run through the equations without rounding, in finer steps.

    Raises RunError where they cannot be run.
    """
    task, count = interval.task, ended.commands.shape[1] - 1
    fine = Interval(task, interval.step, FINER * interval.pieces)
    t = start + interval.step * np.arange(count + 1)
    values = task.within(ended.commands)
    commands = {name: values[k] for k, name in enumerate(task.commands)}
    x = ended.states[:, 0] if periodic else begin
    states = dict(zip(task.eq.x, x.tolist(), strict=True))
    driven = {**given.inputs, **{k: straight(t, v) for k, v in commands.items()}}
    run = _simulated(diagram, fine, t, driven, given.hold, states)
    path, error, limits = fine.followed(values, x, start, given_rows(task, given, fine.grid(start, count)))
    missed, amiss = _missed(task, limits)
    if not ended.found:
        amiss = ended.word
    elif periodic and not amiss:
        amiss = _open(task, path)
    return OptimalControl(
        goal,
        t,
        commands,
        states,
        periodic,
        run,
        error.ravel(),
        _unit(task.error, run),
        missed,
        not amiss,
        amiss or ended.word,
    )


def _simulated(
    diagram: Diagram, fine: Interval, t: np.ndarray, inputs: Mapping[str, Any], hold: str, states: Mapping[str, float]
) -> Run:
    """The run of the diagram over the samples ``t`` [s]. Raises RunError where it diverges."""
    step = fine.step / fine.pieces
    try:
        return simulate(
            diagram, start=float(t[0]), stop=float(t[-1]), step=step, inputs=inputs, hold=hold, initial=states
        )
    except NotFinite as failed:
        raise RunError(
            f"the commands lead where the equations are not finite: {failed} Use more pieces for each "
            f"interval (pieces={2 * fine.pieces // FINER}), or narrower ranges."
        ) from failed


def _missed(task: Task, limits: np.ndarray) -> tuple[float, str]:
    """By how much a limit was missed at most, and a word for it where that is much."""
    worst, word = 0.0, ""
    for k, one in enumerate(task.limits):
        values = limits[:, k]
        amount = max(-float(values.min()), 0.0)
        worst = max(worst, amount)
        if amount > OVER * max(float(np.ptp(values)), 1e-12) and not word:
            word = f"'{one.text}' is missed by up to {amount:.3g}"
    return worst, word


def _open(task: Task, path: np.ndarray) -> str:
    """A word where a run that should be periodic does not end where it began."""
    gaps = np.abs(path[:, -1] - path[:, 0]) / np.maximum(np.ptp(path, axis=1), 1e-12)
    worst = int(np.argmax(gaps)) if len(gaps) else 0
    return f"{task.eq.x[worst]} does not end where it began" if len(gaps) and gaps[worst] > APART else ""


def _unit(error: Expression, run: Run) -> str:
    """The unit of an error that is a sum or difference of signals, as far as one is known."""
    kinds = (ast.BinOp, ast.Add, ast.Sub, ast.UnaryOp, ast.USub, ast.UAdd, ast.Name, ast.Attribute, ast.Load)
    if not all(isinstance(node, kinds) for node in ast.walk(error.tree)):
        return ""
    return next((run.unit(name) for name in error.names if name in run and run.unit(name)), "")
