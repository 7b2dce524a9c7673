"""Model predictive control: optimal control over a receding horizon, sample by sample."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_callback, as_integer, as_names, as_number, as_positive
from tsmblocks.common.errors import DataError, RunError, in_words, near
from tsmblocks.common.interrupt import defer_interrupt
from tsmblocks.engine.equations import function_values
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.control import SMOOTHING_SIZES, SOLVER_OPTIONS
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
from tsmblocks.optimal.transcription import (
    Interval,
    KnownSignals,
    Problem,
    Programme,
    Scales,
    Solution,
    Task,
    Window,
    known_rows,
)
from tsmblocks.simulation.arguments import as_diagram, step_count

ITERATIONS = 60
"""Iterations of the solver for one sample, at most. Chosen: the plan before is near, and time is short."""
SMOOTHING_SIZE = 0.003
"""Width over which kinks are smoothed, as a share of the size of their arguments. Chosen."""
RESTART_RATIO = 10.0
"""Ratio to the usual error of plans above which the search is restarted from other commands. Chosen."""
NEGLIGIBLE_SHARE = 1e-3
"""Share of the size of the references below which an error does not cause a restart. Chosen."""
USUAL_QUANTILE = 0.25
"""Quantile of the errors of earlier plans that is their usual error. Chosen."""


class RecedingHorizon:
    """A model predictive controller: it plans ``preview`` samples ahead, applies the first command, and plans again.

    It uses a model of the plant and carries the state of the model along; give it the state where one is measured.

    Parameters
    ----------
    diagram : Diagram
        The model, as for ``optimal_control``.
    commands, error : dict of str to (float, float), str
        As for ``optimal_control``.
    references : list of str
        Names in ``error`` and ``limits`` that are given at each sample.
    preview : int, default 25
        Samples of the horizon.
    smallest : {"rms", "peak"}
        The measure of the error that is minimised. "peak" adds the mean square with a small weight: the peak alone
        would leave most of a plan undetermined.
    rates, limits : optional
        As for ``optimal_control``.
    start, step : float, defaults 0.0 and 0.02
        Time of the first sample, and interval between samples, in s.
    pieces, parameters : optional
        As for ``optimal_control``.
    iterations : int, default 60
        Iterations of the solver for each plan, at most; the first plan may take ten times as many.

    Attributes
    ----------
    t : float
        Present time in s.
    seconds : list of float
        Computing time of each plan in s.
    missed, short : int
        Numbers of plans that violate limits (the command is then unchanged), and whose search was cut short.

    Raises
    ------
    ParameterError, RunError
        As ``optimal_control`` does.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> controller = tsm.RecedingHorizon(
    ...     tsm.load("motor_linear"), {"u": (-24, 24)}, "x_ref - x", references="x_ref", preview=10
    ... )
    >>> ahead = np.sin(controller.t + 0.02 * np.arange(11))
    >>> sorted(controller.next({"x_ref": ahead}))
    ['u']
    """

    def __init__(
        self,
        diagram: Diagram,
        commands: Mapping[str, Any],
        error: str,
        *,
        references: Sequence[str] | str,
        preview: int = 25,
        smallest: str = "rms",
        rates: Mapping[str, Any] | None = None,
        limits: Sequence[str] | str = (),
        start: float = 0.0,
        step: float = 0.02,
        pieces: int | None = None,
        parameters: Mapping[str, Any] | None = None,
        iterations: int = ITERATIONS,
    ) -> None:
        self.diagram, goal = as_diagram(diagram, parameters), goal_named(smallest)
        task = task_of(self.diagram, commands, error, limits, rates, tuple(as_names("references", references, "x_ref")))
        h, ahead = as_positive("step", step), as_integer("preview", preview, 2)
        few = as_integer("iterations", iterations, 1)
        self.interval = Interval(task, h, pieces_per_interval(task, pieces, h))
        goal = "both" if goal == "peak" else goal
        options = ({**SOLVER_OPTIONS, "ipopt.max_iter": most} for most in (10 * few, few))
        self._first, self._later = (Programme(self.interval, ahead, goal, False, one) for one in options)
        self.t = as_number("start", start)
        self.state = function_values(task.eq.start, task.p)[0]
        self.command = np.clip(np.zeros(len(task.commands)), *task.ranges)
        self.seconds: list[float] = []
        self.missed = self.short = 0
        self._plan: Solution | None = None
        self._scales: Scales | None = None
        self._largest = 0.0
        self._size = np.zeros(task.smoothed.count)
        self._errors: list[float] = []

    @property
    def task(self) -> Task:
        """The problem."""
        return self.interval.task

    @property
    def preview(self) -> int:
        """Samples of the horizon."""
        return self._first.count

    def next(
        self,
        references: Mapping[str, Any],
        inputs: Mapping[str, Any] | None = None,
        state: Mapping[str, float] | None = None,
    ) -> dict[str, float]:
        """Commands at the next sample; they change linearly from those of the present sample.

        Parameters
        ----------
        references : dict of str to float or array
            For each reference a number, or ``preview`` + 1 samples from the present one on.
        inputs : dict of str to float or array, optional
            The other inputs of the diagram, likewise.
        state : dict of str to float, optional
            Measured states by name; the others are those of the model.

        Returns
        -------
        dict of str to float
            The commands. DataError is raised for unknown names and for samples of another number.
        """
        task, grid = self.task, self.interval.grid(self.t, self.preview)
        given = known_signals(task.eq.title, task.commands, inputs, references, "linear")
        ahead = grid[:: self.interval.pieces]
        for name, value in {**given.references, **given.inputs}.items():
            if np.ndim(value) and np.shape(value) != (self.preview + 1,):
                raise DataError(
                    f"'{name}' must be a number or {self.preview + 1} samples, one for now and one for "
                    f"each sample of the preview; got shape {np.shape(value)}."
                )
        table = known_rows(task, given.on(ahead), grid)
        self.state = self._measured_state({} if state is None else state)
        return self.planned(table)

    def _measured_state(self, measured: Mapping[str, float]) -> np.ndarray:
        """The state of the model, with those that were measured. Raises DataError."""
        if not isinstance(measured, Mapping):
            raise DataError(f"state must map names of states to numbers, got {in_words(measured)}.")
        state, eq = self.state.copy(), self.task.eq
        for name, value in measured.items():
            if name not in eq.x:
                raise DataError(f"'{eq.title}' has no state '{name}'.{near(str(name), eq.x)}")
            state[eq.x.index(name)] = as_number(f"the state '{name}'", value, DataError)
        return state

    def planned(self, table: np.ndarray) -> dict[str, float]:
        """Commands at the next sample, from known signals in the layout of the solver.

        Parameters
        ----------
        table : ndarray
            References and inputs as ``known_rows`` lays them out, shape (steps, 3, inputs + references).

        Returns
        -------
        dict of str to float
            The commands.
        """
        began = time.perf_counter()
        window = Window(self.interval, self.t, table)
        plan = self._plan_on(self._problem(window))
        self.missed += not plan.feasible
        self.short += plan.feasible and not plan.found
        self.seconds.append(time.perf_counter() - began)
        path, _, _ = window.simulated(plan.commands[:, :2], self.state)
        self.state, self.command, self._plan = path[:, 1], plan.commands[:, 1], plan
        self.t += self.interval.step
        return dict(zip(self.task.commands, self.command.tolist(), strict=True))

    def _problem(self, window: Window) -> Problem:
        """The start of a plan; the error is scaled by the largest reference so far."""
        if self._scales is None:
            self._scales = window.scales(np.tile(self.command[:, None], self.preview + 1), self.state)
        self._largest = max(self._largest, window.largest_reference)
        self._scales = attrs.evolve(self._scales, error=self._largest or self._scales.error)
        return Problem(window, self.state, self.command, self._scales)

    def _plan_on(self, problem: Problem) -> Solution:
        """A plan that continues the last one, or a better one from other initial commands where its error is large."""
        if self._plan is None:
            plan = self._plan_afresh(problem)
        else:
            last = self._plan.commands
            plan = self._plan_from(np.column_stack([last[:, 1:], last[:, -1]]), problem)
        usual = np.inf
        if self._errors:
            usual = max(np.quantile(self._errors, USUAL_QUANTILE), NEGLIGIBLE_SHARE * problem.scales.error)
        if self._cost(plan, problem) > RESTART_RATIO * usual or not plan.feasible:
            t = self.t + self.interval.step * np.arange(self.preview + 1)
            for commands in initial_commands(problem.window, None, t)[1:]:
                moved = problem.before[:, None] + commands - commands[:, :1]
                other = self._plan_from(self.task.within(moved), problem)
                plan = min(plan, other, key=lambda one: (not one.feasible, self._cost(one, problem)))
        self._errors.append(self._cost(plan, problem))
        return plan

    def _cost(self, plan: Solution, problem: Problem) -> float:
        """The objective of a plan with the exact equations."""
        return problem.window.cost(self._later.goal, plan.commands, problem.begin)

    def _plan_from(self, commands: np.ndarray, problem: Problem) -> Solution:
        """The plan of a search from commands (c, N + 1)."""
        guess = self._guess(commands, problem)
        self._size = np.maximum(self._size, problem.window.sizes(guess))
        plan = self._later.solve(guess, problem, SMOOTHING_SIZE * self._size)
        return plan if plan.feasible else self._plan_afresh(problem)

    def _plan_afresh(self, problem: Problem) -> Solution:
        """A plan from constant commands, with less and less smoothing."""
        programme = self._first if self._plan is None else self._later
        plan = self._guess(np.tile(problem.before[:, None], self.preview + 1), problem)
        for share in SMOOTHING_SIZES:
            size = problem.window.sizes(plan)
            self._size = np.maximum(self._size, size) if plan.feasible else size
            made = programme.solve(plan, problem, max(share, SMOOTHING_SIZE) * size)
            plan = made if made.feasible else plan
        return plan

    def _guess(self, commands: np.ndarray, problem: Problem) -> Solution:
        """Commands that begin with the present ones, and their path; the present state where it diverges."""
        commands = np.column_stack([problem.before, commands[:, 1:]])
        path, error, _ = problem.window.simulated(commands, problem.begin)
        if not (np.isfinite(path).all() and np.isfinite(error).all()):
            path, error = np.tile(problem.begin[:, None], commands.shape[1]), np.full(1, problem.scales.error)
        return Solution(commands, path, float(np.abs(error).max()), feasible=False)


def receding_horizon(
    diagram: Diagram,
    commands: Mapping[str, Any],
    error: str,
    *,
    references: Mapping[str, Any],
    preview: int = 25,
    smallest: str = "rms",
    rates: Mapping[str, Any] | None = None,
    limits: Sequence[str] | str = (),
    stop: float | None = None,
    start: float = 0.0,
    step: float = 0.02,
    pieces: int | None = None,
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    parameters: Mapping[str, Any] | None = None,
    iterations: int = ITERATIONS,
    progress: ProgressCallback | None = None,
) -> OptimalControl:
    """The commands of a ``RecedingHorizon`` along references of which ``preview`` samples are known ahead.

    Parameters
    ----------
    diagram : Diagram
        The plant, as for ``optimal_control``.
    commands, error : dict of str to (float, float), str
        As for ``optimal_control``.
    references : dict of str to signal
        As for ``optimal_control``; they reach ``preview`` samples beyond ``stop``.
    preview, smallest, rates, limits : optional
        As for ``RecedingHorizon``.
    stop : float, optional
        End in s. By default ``preview`` samples before the end of the shortest known signal.
    start, step, pieces : optional
        As for ``RecedingHorizon``; ``step`` is 0.02 s by default.
    inputs, hold, parameters : optional
        As for ``optimal_control``.
    iterations, progress : optional
        As for ``RecedingHorizon`` and ``optimal_control``.

    Returns
    -------
    OptimalControl
        The commands, simulated; ``seconds`` has the computing time of each plan. After Ctrl-C the samples so far.

    Raises
    ------
    ParameterError, RunError, DataError
        As ``optimal_control`` does; RunError where signals are too short for one sample and the preview.

    Examples
    --------
    >>> import numpy as np
    >>> import tsmblocks as tsm
    >>> t = np.linspace(0.0, 1.0, 51)
    >>> made = tsm.receding_horizon(
    ...     tsm.load("motor_linear"), {"u": (-24, 24)}, "x_ref - x", references={"x_ref": (t, np.sin(t))}, preview=10
    ... )
    >>> len(made.t)
    41
    """
    progress = as_callback(progress, "stage, done and of")
    given = known_signals(as_diagram(diagram).title, commands, inputs, references, hold)
    control = RecedingHorizon(
        diagram,
        commands,
        error,
        references=tuple(given.references),
        preview=preview,
        smallest=smallest,
        rates=rates,
        limits=limits,
        start=start,
        step=step,
        pieces=pieces,
        parameters=parameters,
        iterations=iterations,
    )
    interval, h, begin, x = control.interval, control.interval.step, control.t, control.state
    count = _count(given, begin, stop, h, preview)
    given = given.on(begin + h * np.arange(count + preview + 1))
    table = known_rows(control.task, given, interval.grid(begin, count + preview))
    made, states = [control.command], [x]
    with defer_interrupt() as stopped:
        for k in range(count):
            progress("planned", k, count)
            control.planned(table[k * interval.pieces : (k + preview) * interval.pieces])
            made.append(control.command)
            states.append(control.state)
            if stopped.stop:
                break
    progress("planned", len(control.seconds), count)
    word = _word(control, len(control.seconds), stopped.stop) or "Solve_Succeeded"
    ended = Solution(np.column_stack(made), np.column_stack(states), 0.0, word)
    found = simulated_result(control.diagram, interval, smallest, False, ended, x, begin, given)
    return attrs.evolve(found, seconds=np.array(control.seconds))


def _count(given: KnownSignals, begin: float, stop: float | None, h: float, preview: int) -> int:
    """Number of samples to plan. Raises RunError."""
    if stop is not None:
        return interval_count(begin, as_number("stop", stop), h)
    last = end_of_signals(given, begin, h)
    if last - preview * h < begin + h * (1 - 1e-6):
        raise RunError(
            f"the known signals end at {last:g} s, which is less than one sample and a preview of {preview} samples "
            f"of {h:g} s. Give longer signals, or a shorter preview."
        )
    return step_count(begin, last - preview * h, h)


def _word(control: RecedingHorizon, count: int, stopped: bool) -> str:
    """A text on plans that failed, ``""`` where none did."""
    if stopped:
        return f"interrupted after {count} samples"
    if control.missed:
        return f"{control.missed} of {count} plans violated limits"
    return f"{control.short} of {count} plans were cut short" if control.short > count // 20 else ""
