"""Optimal control of any diagram: the commands that keep an error smallest, within limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_bool, as_callback, as_integer, as_number, as_positive
from tsmblocks.common.errors import RunError
from tsmblocks.common.interrupt import Asked, kept
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.result import OptimalControl, outcome
from tsmblocks.optimal.setup import Tell, asked, begins, count_of, ending, given_of, goal_of, pieces_of
from tsmblocks.optimal.transcription import NOTHING, Interval, Known, Programme, Solution, given_rows, units_of
from tsmblocks.simulation.arguments import as_diagram

ROUNDED = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Sizes over which kinks are rounded off in one search after another, as shares of what lies in them."""
ROOM = 1.01
"""How far, over the smallest peak, errors may be where of all such commands those of least mean square are taken."""
OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "ipopt.tol": 1e-8,
    "ipopt.mu_strategy": "adaptive",
    "error_on_fail": False,
}
"""For the solver."""


def optimal_control(
    diagram: Diagram,
    commands: Mapping[str, Any],
    error: str,
    *,
    smallest: str = "peak",
    rates: Mapping[str, Any] | None = None,
    limits: Sequence[str] | str = (),
    references: Mapping[str, Any] | None = None,
    stop: float | None = None,
    start: float = 0.0,
    step: float = 0.01,
    pieces: int | None = None,
    periodic: bool = False,
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    parameters: Mapping[str, Any] | None = None,
    guess: Mapping[str, Any] | None = None,
    iterations: int = 1000,
    progress: Tell | None = None,
) -> OptimalControl:
    """The commands that keep an error smallest: what a controller with full foresight could do.

    ``commands`` maps inputs of the diagram to their limits ``(low, high)``, None for no limit; ``rates`` does so for
    how fast they may change, per s. ``error`` is an expression of signals, such as ``"x_ref - x_out"``, and
    ``references`` gives those of them that are no signals of the diagram, as ``inputs`` gives its other inputs (both as
    for ``simulate``; plain values are those at the samples). Of the error the ``smallest`` "peak" or "rms" is looked
    for; of all commands with (nearly) the smallest peak those of smallest rms are taken. ``limits`` are comparisons
    such as ``"abs(motor.i) <= 1.5"`` that are to hold on the way.

    Commands are linear between samples ``step`` s apart, from ``start`` to ``stop``; each interval is integrated in
    ``pieces`` Runge-Kutta steps (as many as the fastest pole at the start asks for). The run begins at the diagram's
    start values and the guess's first commands, or, where it is ``periodic``, ends as it begins.

    A search ends where nothing nearby is better; another ``guess`` (commands mapped to samples to begin from) may lead
    to a better place. Without one, searches begin at commands of zero and, where there is one command, at a copy of the
    first reference; the better end counts. Kinks of the equations are rounded off, less and less; signals and sources
    that jump should do so at samples. The result is run without any rounding, and in finer steps. After Ctrl-C the best
    so far is returned. ``progress(stage, done, all)`` is told how far it is.

    Raises ParameterError, RunError, DataError. Source: Betts, Practical Methods for Optimal Control (2010), 4.
    """
    diagram, goal, tell = (
        as_diagram(diagram, parameters),
        goal_of(smallest),
        as_callback(progress, "stage, done and of"),
    )
    given = given_of(diagram.title, commands, inputs, references, hold)
    task = asked(diagram, commands, error, limits, rates, tuple(given.references))
    periodic = as_bool("periodic", periodic)
    h, begin = as_positive("step", step), as_number("start", start)
    end = as_number("stop", stop) if stop is not None else ending(given, begin, h)
    count = count_of(begin, end, h)
    interval, t = Interval(task, h, pieces_of(task, pieces, h)), begin + h * np.arange(count + 1)
    given = given.on(t)
    table = given_rows(task, given, interval.grid(begin, count))
    options = {**OPTIONS, "ipopt.max_iter": as_integer("iterations", iterations, 1)}
    x = np.asarray(task.eq.start(task.p)[0]).ravel()
    with kept() as stopped:
        search = _Search(interval, count, goal, periodic, options, table, tell, stopped)
        ended = search.best(begins(task, guess, t, interval, table), x, begin)
    if not ended.feasible:
        raise RunError(
            f"no commands were found that keep all limits ({ended.word}). Loosen limits, ranges or rates, "
            "allow more iterations, or begin at a guess that keeps them."
        )
    return outcome(diagram, interval, goal, periodic, ended, x, begin, given)


@attrs.frozen(eq=False)
class _Search:
    """The searches for one control."""

    interval: Interval
    count: int
    goal: str
    periodic: bool
    options: Mapping[str, Any]
    table: np.ndarray
    tell: Tell
    stopped: Asked

    def best(self, begins: Sequence[np.ndarray], x: np.ndarray, start: float) -> Solution:
        """The best end of searches from several commands."""
        square, peak, within = (
            Programme(self.interval, self.count, goal, self.periodic, self.options)
            for goal in ("rms", "peak", "within")
        )
        ends = []
        for k, commands in enumerate(begins):
            self.tell("searched", k, len(begins))
            path, _, _ = self.interval.followed(commands, x, start, self.table)
            path = path if np.isfinite(path).all() else np.tile(x[:, None], self.count + 1)
            known = Known(x, commands[:, 0], start, self.table, units_of(self.interval, commands, x, start, self.table))
            end = self._sharpened(square, Solution(commands, path, 1.0, feasible=False), known)
            if self.goal == "peak" and end.feasible and not self.stopped.stop:
                end = self._peaked(peak, within, end, known)
            ends.append((not end.feasible, self._cost(end, known), k, end))
            if self.stopped.stop:
                break
        self.tell("searched", len(begins), len(begins))
        end = min(ends, key=lambda one: one[:3])[3]
        if self.stopped.stop and not end.feasible:
            raise KeyboardInterrupt
        return attrs.evolve(end, word="interrupted") if self.stopped.stop else end

    def _sharpened(self, square: Programme, end: Solution, known: Known) -> Solution:
        """The least mean square, while kinks are sharpened."""
        for share in ROUNDED:
            size = self.interval.sizes(end.states, end.commands, known.start, known.table)
            made = square.solve(end, known, share * size)
            end = made if made.feasible else attrs.evolve(end, word=made.word)
            if self.stopped.stop:
                break
        return end

    def _peaked(self, peak: Programme, within: Programme, end: Solution, known: Known) -> Solution:
        """The least peak, then the least mean square of those that have about that."""
        rounded = ROUNDED[-1] * self.interval.sizes(end.states, end.commands, known.start, known.table)
        _, error, _ = self.interval.followed(end.commands, end.states[:, 0], known.start, known.table)
        highest = float(np.abs(error).max())
        if highest <= NOTHING * known.units.error:
            return end
        made = peak.solve(attrs.evolve(end, peak=highest), known, rounded)
        if not made.feasible:
            return attrs.evolve(end, word=made.word)
        calm = within.solve(made, known, rounded, ROOM * made.peak)
        return attrs.evolve(calm, word=made.word) if calm.feasible else made

    def _cost(self, end: Solution, known: Known) -> float:
        """What is to be small, in the equations as they are."""
        _, error, _ = self.interval.followed(end.commands, end.states[:, 0], known.start, known.table)
        cost = float(np.abs(error).max() if self.goal == "peak" else np.sqrt(np.mean(error**2)))
        return cost if np.isfinite(cost) else np.inf
