"""Optimal control of any diagram: the commands with the smallest error within limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_bool, as_callback, as_integer, as_number, as_positive
from tsmblocks.common.errors import RunError
from tsmblocks.common.interrupt import InterruptFlag, defer_interrupt
from tsmblocks.engine.equations import function_values
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.result import OptimalControl, simulated_result
from tsmblocks.optimal.setup import (
    ProgressCallback,
    end_of_signals,
    goal_named,
    initial_commands,
    interval_count,
    known_signals,
    pieces_per_interval,
    task_of,
)
from tsmblocks.optimal.transcription import NEGLIGIBLE_ERROR, Interval, Problem, Programme, Solution, Window, known_rows
from tsmblocks.simulation.arguments import as_diagram

SMOOTHING_SIZES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Widths over which kinks are smoothed in successive searches, as shares of the size of their arguments. Chosen."""
PEAK_ALLOWANCE = 1.01
"""Factor over the smallest peak within which the mean square is then made smallest. Chosen."""
SOLVER_OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "ipopt.tol": 1e-8,
    "ipopt.mu_strategy": "adaptive",
    "error_on_fail": False,
}
"""Options of IPOPT. Its tolerance is chosen well below what matters for commands."""


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
    progress: ProgressCallback | None = None,
) -> OptimalControl:
    """The commands with the smallest error within limits: what a controller with full foresight can reach.

    Commands are linear between samples. The problem is solved by direct transcription (multiple shooting) and IPOPT,
    with the kinks of the equations smoothed less and less; signals and sources that jump should do so at samples. A
    result is a local optimum: another ``guess`` may lead to a better one.

    Parameters
    ----------
    diagram : Diagram
        The plant, without sampled blocks, memory and transport delays.
    commands : dict of str to (float, float)
        Inputs of the diagram that are commands, and their limits (low, high) in the unit of the input; None for no
        limit.
    error : str
        An expression of signals, such as ``"x_ref - x_out"``.
    smallest : {"peak", "rms"}
        The measure of the error that is minimised. For "peak" the rms error is then made smallest within (nearly) that
        peak.
    rates : dict of str to (float, float), optional
        Limits of the rates of commands, in their unit per s.
    limits : list of str, optional
        Comparisons of signals that hold at every instant, such as ``"abs(motor.i) <= 1.5"``.
    references : dict of str to signal, optional
        Names in ``error`` and ``limits`` that are not signals of the diagram, as for ``inputs`` of ``simulate``; plain
        values are those at the samples.
    stop : float, optional
        End in s. By default the end of the shortest known signal.
    start, step : float, defaults 0.0 and 0.01
        Time of the first sample, and interval between samples of the commands, in s.
    pieces : int, optional
        Runge-Kutta steps of each interval. By default as many as the fastest initial pole needs, at least 2.
    periodic : bool, default False
        Whether the run ends at its initial state. Otherwise it starts at the initial state of the diagram.
    inputs : dict of str to signal, optional
        The other inputs of the diagram, as for ``simulate``.
    hold : {"linear", "zero", "cubic"}
        Interpolation between samples of inputs and references.
    parameters : dict of str to float, optional
        Values by name that replace those of the diagram.
    guess : dict of str to array, optional
        Initial commands, samples or pairs (times, values). By default zero and, for a single command, a copy of the
        first reference; the better result counts.
    iterations : int, default 1000
        Iterations of the solver, at most.
    progress : callable, optional
        Called with a stage, how much of it is done, and of how much.

    Returns
    -------
    OptimalControl
        The commands, simulated with the exact equations in finer steps. After Ctrl-C the best so far.

    Raises
    ------
    ParameterError
        For an unknown name, and for limits that are not possible.
    RunError
        For a diagram that is not suitable, and where no commands keep all limits.
    DataError
        For missing or unsuitable signals.

    References
    ----------
    J. T. Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear Programming, 2010, chapter 4.
    H. G. Bock and K. J. Plitt, A multiple shooting algorithm for direct solution of optimal control problems, 1984.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.linspace(0.0, 1.0, 51)
    >>> made = tsm.optimal_control(
    ...     tsm.load("motor_linear"), {"u": (-24, 24)}, "x_ref - x", references={"x_ref": (t, np.sin(t))}, step=0.02
    ... )
    >>> bool(made.peak < 0.01)
    True
    """
    diagram, goal = as_diagram(diagram, parameters), goal_named(smallest)
    progress = as_callback(progress, "stage, done and of")
    given = known_signals(diagram.title, commands, inputs, references, hold)
    task = task_of(diagram, commands, error, limits, rates, tuple(given.references))
    periodic = as_bool("periodic", periodic)
    h, begin = as_positive("step", step), as_number("start", start)
    end = as_number("stop", stop) if stop is not None else end_of_signals(given, begin, h)
    count = interval_count(begin, end, h)
    interval, t = Interval(task, h, pieces_per_interval(task, pieces, h)), begin + h * np.arange(count + 1)
    given = given.on(t)
    window = Window(interval, begin, known_rows(task, given, interval.grid(begin, count)))
    options = {**SOLVER_OPTIONS, "ipopt.max_iter": as_integer("iterations", iterations, 1)}
    programmes = {one: Programme(interval, count, one, periodic, options) for one in ("rms", "peak", "within")}
    x = function_values(task.eq.start, task.p)[0]
    with defer_interrupt() as stopped:
        search = _Search(window, goal, programmes, stopped)
        ended = search.best(initial_commands(window, guess, t), x, progress)
    if not ended.feasible:
        raise RunError(
            f"no commands were found that keep all limits ({ended.word}). Loosen limits, ranges or rates, "
            "allow more iterations, or give a guess that keeps them."
        )
    return simulated_result(diagram, interval, goal, periodic, ended, x, begin, given)


@attrs.frozen(eq=False)
class _Search:
    """The searches for one optimal control problem; ``programmes`` by their goals."""

    window: Window
    goal: str
    programmes: Mapping[str, Programme]
    stopped: InterruptFlag

    def best(self, guesses: Sequence[np.ndarray], x: np.ndarray, progress: ProgressCallback) -> Solution:
        """The best result of searches from several initial commands."""
        ends = []
        for k, commands in enumerate(guesses):
            progress("searched", k, len(guesses))
            path, _, _ = self.window.simulated(commands, x)
            path = path if np.isfinite(path).all() else np.tile(x[:, None], commands.shape[1])
            problem = Problem(self.window, x, commands[:, 0], self.window.scales(commands, x))
            end = self._least_square(Solution(commands, path, 1.0, feasible=False), problem)
            if self.goal == "peak" and end.feasible and not self.stopped.stop:
                end = self._least_peak(end, problem)
            ends.append(end)
            if self.stopped.stop:
                break
        progress("searched", len(guesses), len(guesses))
        end = min(ends, key=lambda one: (not one.feasible, self._cost(one)))
        if self.stopped.stop and not end.feasible:
            raise KeyboardInterrupt
        return attrs.evolve(end, word="interrupted") if self.stopped.stop else end

    def _cost(self, end: Solution) -> float:
        """The objective with the exact equations."""
        return self.window.cost(self.goal, end.commands, end.states[:, 0])

    def _least_square(self, end: Solution, problem: Problem) -> Solution:
        """The least mean square, with less and less smoothing."""
        for share in SMOOTHING_SIZES:
            made = self.programmes["rms"].solve(end, problem, share * self.window.sizes(end))
            end = made if made.feasible else attrs.evolve(end, word=made.word)
            if self.stopped.stop:
                break
        return end

    def _least_peak(self, end: Solution, problem: Problem) -> Solution:
        """The least peak, then the least mean square within about that peak."""
        size = SMOOTHING_SIZES[-1] * self.window.sizes(end)
        peak = self._cost(end)
        if peak <= NEGLIGIBLE_ERROR * problem.scales.error:
            return end
        made = self.programmes["peak"].solve(attrs.evolve(end, peak=peak), problem, size)
        if not made.feasible:
            return attrs.evolve(end, word=made.word)
        within = self.programmes["within"].solve(made, problem, size, PEAK_ALLOWANCE * made.peak)
        return attrs.evolve(within, word=made.word) if within.feasible else made
