"""Optimal control sample by sample, with a short look ahead: what a controller can do that runs beside the plant."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_callback, as_integer, as_names, as_number, as_positive
from tsmblocks.common.errors import DataError, RunError, in_words, near
from tsmblocks.common.interrupt import kept
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.control import OPTIONS, ROUNDED
from tsmblocks.optimal.result import OptimalControl, outcome
from tsmblocks.optimal.setup import Tell, asked, begins, count_of, ending, given_of, goal_of, pieces_of
from tsmblocks.optimal.transcription import (
    PRICE,
    Given,
    Interval,
    Known,
    Programme,
    Solution,
    Task,
    Units,
    given_rows,
    units_of,
)
from tsmblocks.simulation.arguments import as_diagram, step_count

FEW = 60
"""Iterations of the solver for one sample at most: the last plan is near, and the next sample comes soon."""
SHARP = 0.003
"""Size over which kinks are rounded off, as a share of what lies in them."""
STUCK = 10.0
"""Times the usual error of a plan from which another begin is tried: searches can end at standing still."""
LITTLE = 1e-3
"""Share of the references' size below which an error is never much."""
USUAL = 0.25
"""Share of all plans before that leave no more than the usual error."""


class RecedingHorizon:
    """A controller that plans ``preview`` samples ahead, gives the first command of the plan, and plans anew.

    It runs on a model of the plant, whose state it carries along; give it the state where one is measured. Arguments
    as for ``optimal_control``; the first plan may take ten times as many ``iterations``. ``smallest="peak"`` makes the
    peak over the preview small together with the mean square: with the peak alone most of a plan would be arbitrary.
    ``seconds`` lists how long each plan took. ``missed`` counts plans in which no way was found to keep all limits (the
    command then stays), ``short`` those that were not searched to their end.
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
        iterations: int = FEW,
    ) -> None:
        self.diagram, goal = as_diagram(diagram, parameters), goal_of(smallest)
        task = asked(self.diagram, commands, error, limits, rates, tuple(as_names("references", references, "x_ref")))
        h, ahead = as_positive("step", step), as_integer("preview", preview, 2)
        few = as_integer("iterations", iterations, 1)
        self.interval = Interval(task, h, pieces_of(task, pieces, h))
        self._first, self._later = (
            Programme(
                self.interval, ahead, "both" if goal == "peak" else goal, False, {**OPTIONS, "ipopt.max_iter": most}
            )
            for most in (10 * few, few)
        )
        self.t = as_number("start", start)
        self.state = np.asarray(task.eq.start(task.p)[0]).ravel()
        self.command = np.clip(np.zeros(len(task.commands)), *task.ranges)
        self.seconds: list[float] = []
        self.missed = self.short = 0
        self._plan: Solution | None = None
        self._units: Units | None = None
        self._largest = 0.0
        self._size = np.zeros(task.rounded.count)
        self._left: list[float] = []

    @property
    def task(self) -> Task:
        """What is asked of it."""
        return self.interval.task

    @property
    def preview(self) -> int:
        """Samples that it looks ahead."""
        return self._first.count

    def next(
        self,
        references: Mapping[str, Any],
        inputs: Mapping[str, Any] | None = None,
        state: Mapping[str, float] | None = None,
    ) -> dict[str, float]:
        """The commands at the next sample, towards which to go in a straight line from those of now.

        ``references`` and other ``inputs`` of the diagram are numbers, or ``preview`` + 1 samples from now on;
        ``state`` gives states by name that are known better than by the model. Raises DataError.
        """
        task, grid = self.task, self.interval.grid(self.t, self.preview)
        given = given_of(task.eq.title, task.commands, inputs, references, "linear")
        ahead = grid[:: self.interval.pieces]
        for name, value in {**given.references, **given.inputs}.items():
            if np.ndim(value) and np.shape(value) != (self.preview + 1,):
                raise DataError(
                    f"'{name}' must be a number or {self.preview + 1} samples, one for now and one for "
                    f"each sample of the preview; got shape {np.shape(value)}."
                )
        table = given_rows(task, given.on(ahead), grid)
        self._known_better(state)
        return self.planned(table)

    def _known_better(self, state: Mapping[str, float] | None) -> None:
        if state is not None and not isinstance(state, Mapping):
            raise DataError(f"state must map names of states to numbers, got {in_words(state)}.")
        better = self.state.copy()
        for name, value in (state or {}).items():
            if name not in self.task.eq.x:
                raise DataError(f"'{self.task.eq.title}' has no state '{name}'.{near(str(name), self.task.eq.x)}")
            better[self.task.eq.x.index(name)] = as_number(f"the state '{name}'", value, DataError)
        self.state = better

    def planned(self, table: np.ndarray) -> dict[str, float]:
        """The same, where everything given is laid out as ``given_rows`` does."""
        began = time.perf_counter()
        plan = self._planned(self._known(table))
        self.missed += not plan.feasible
        self.short += plan.feasible and not plan.found
        self.seconds.append(time.perf_counter() - began)
        path, _, _ = self.interval.followed(plan.commands[:, :2], self.state, self.t, table[: self.interval.pieces])
        self.state, self.command, self._plan = path[:, 1], plan.commands[:, 1], plan
        self.t += self.interval.step
        return dict(zip(self.task.commands, self.command.tolist(), strict=True))

    def _known(self, table: np.ndarray) -> Known:
        """What a plan starts from; errors are counted in the size of the references, the largest seen so far."""
        if self._units is None:
            still = np.tile(self.command[:, None], self.preview + 1)
            self._units = units_of(self.interval, still, self.state, self.t, table)
        self._largest = max(self._largest, float(np.abs(table[:, :, len(self.task.eq.u) :]).max(initial=0.0)))
        self._units = attrs.evolve(self._units, error=self._largest or self._units.error)
        return Known(self.state, self.command, self.t, table, self._units)

    def _planned(self, known: Known) -> Solution:
        """A plan that goes on from the last one, or a better one from another begin where that leaves much."""
        plan = self._begun(known) if self._plan is None else self._from(_shifted(self._plan.commands), known)
        usual = max(float(np.quantile(self._left, USUAL)), LITTLE * known.units.error) if self._left else np.inf
        left = self._cost(plan, known)
        if left > STUCK * usual or not plan.feasible:
            t = known.start + self.interval.step * np.arange(self.preview + 1)
            for commands in begins(self.task, None, t, self.interval, known.table)[1:]:
                moved = known.before[:, None] + commands - commands[:, :1]
                other = self._from(self.task.within(moved), known)
                plan = min(plan, other, key=lambda one: (not one.feasible, self._cost(one, known)))
            left = self._cost(plan, known)
        self._left.append(left)
        return plan

    def _from(self, commands: np.ndarray, known: Known) -> Solution:
        """The plan that a search from commands (c, N + 1) ends at."""
        guess = self._followed(commands, known)
        size = self.interval.sizes(guess.states, guess.commands, known.start, known.table)
        self._size = np.maximum(self._size, size)
        plan = self._later.solve(guess, known, SHARP * self._size)
        return plan if plan.feasible else self._begun(known)

    def _followed(self, commands: np.ndarray, known: Known) -> Solution:
        commands = np.column_stack([known.before, commands[:, 1:]])
        path, error, _ = self.interval.followed(commands, known.begin, known.start, known.table)
        if not (np.isfinite(path).all() and np.isfinite(error).all()):
            path, error = np.tile(known.begin[:, None], commands.shape[1]), np.full(1, known.units.error)
        return Solution(commands, path, float(np.abs(error).max()), feasible=False)

    def _begun(self, known: Known) -> Solution:
        """A plan from standing still, while kinks are sharpened."""
        programme = self._first if self._plan is None else self._later
        plan = self._followed(np.tile(known.before[:, None], self.preview + 1), known)
        for share in ROUNDED:
            size = self.interval.sizes(plan.states, plan.commands, known.start, known.table)
            self._size = np.maximum(self._size, size) if plan.feasible else size
            made = programme.solve(plan, known, max(share, SHARP) * size)
            plan = made if made.feasible else plan
        return plan

    def _cost(self, plan: Solution, known: Known) -> float:
        """What a plan leaves of what is to be small, in the equations as they are and in the unit of the error."""
        _, error, _ = self.interval.followed(plan.commands, known.begin, known.start, known.table)
        peak = PRICE * np.max(error**2) if self._later.goal == "both" else 0.0
        left = float(np.sqrt(np.mean(error**2) + peak))
        return left if np.isfinite(left) else np.inf


def _shifted(rows: np.ndarray) -> np.ndarray:
    """Samples one later; the last stays."""
    return np.column_stack([rows[:, 1:], rows[:, -1]])


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
    iterations: int = FEW,
    progress: Tell | None = None,
) -> OptimalControl:
    """The commands of a ``RecedingHorizon`` along references that are known ``preview`` samples ahead.

    Arguments as for ``optimal_control``; references and inputs must reach ``preview`` samples beyond ``stop``, and
    without it the run ends so long before them. ``seconds`` of the result tells how long each sample's plan took. After
    Ctrl-C the run ends where it is.
    """
    title, tell = as_diagram(diagram).title, as_callback(progress, "stage, done and of")
    given = given_of(title, commands, inputs, references, hold)
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
    interval, h, begin = control.interval, control.interval.step, control.t
    count = _count(given, begin, stop, h, preview)
    given = given.on(begin + h * np.arange(count + preview + 1))
    table, x = given_rows(control.task, given, interval.grid(begin, count + preview)), control.state
    made, states = [control.command], [control.state]
    with kept() as stopped:
        for k in range(count):
            tell("planned", k, count)
            control.planned(table[k * interval.pieces : (k + preview) * interval.pieces])
            made.append(control.command)
            states.append(control.state)
            if stopped.stop:
                break
    tell("planned", len(made) - 1, count)
    word = _word(control, len(made) - 1, stopped.stop)
    ended = Solution(np.column_stack(made), np.column_stack(states), 0.0, word or "Solve_Succeeded")
    found = outcome(control.diagram, interval, smallest, False, ended, x, begin, given)
    return attrs.evolve(found, seconds=np.array(control.seconds))


def _count(given: Given, begin: float, stop: float | None, h: float, preview: int) -> int:
    """Samples to plan. Raises RunError."""
    if stop is not None:
        return count_of(begin, as_number("stop", stop), h)
    last = ending(given, begin, h)
    if last - preview * h < begin + h * (1 - 1e-6):
        raise RunError(
            f"what is given ends at {last:g} s, before one preview of {preview} samples of {h:g} s and one "
            "sample are over. Give more, or a shorter preview."
        )
    return step_count(begin, last - preview * h, h)


def _word(control: RecedingHorizon, count: int, stopped: bool) -> str:
    """What went wrong with plans, if anything did."""
    if stopped:
        return f"interrupted after {count} samples"
    if control.missed:
        return f"{control.missed} of {count} plans kept no limits"
    return f"{control.short} of {count} plans were cut short" if control.short > count // 20 else ""
