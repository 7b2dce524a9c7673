"""Optimal control sample by sample, with a short look ahead: what a controller can do that runs beside the plant."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.arguments import given_inputs, number, positive, prepared, whole, whole_steps
from tsmblocks.diagram import Diagram
from tsmblocks.errors import DataError, ParameterError, in_words, near
from tsmblocks.optimal.control import OPTIONS, ROUNDED, OptimalControl, Tell, asked, ending, pieces_of, result
from tsmblocks.optimal.transcription import Interval, Known, Programme, Solution, Task, Units, given_rows, units_of

FEW = 60
"""Iterations of the solver for one sample at most: the last plan is near, and the next sample comes soon."""
SHARP = 0.003
"""Size over which kinks are rounded off, as a share of what lies in them."""


class RecedingHorizon:
    """A controller that plans ``preview`` samples ahead, gives the first command of the plan, and plans anew.

    It runs on a model of the plant, whose state it carries along; give it the state where one is measured. Arguments
    as for ``optimal_control``. ``seconds`` lists how long each plan took, ``missed`` how many plans did not come out,
    so that the one before went on.
    """

    def __init__(
        self, diagram: Diagram, commands: Mapping[str, Any], error: str, *, references: Sequence[str],
        preview: int = 25, smallest: str = "rms", rates: Mapping[str, Any] | None = None,
        limits: Sequence[str] | str = (), start: float = 0.0, step: float = 0.02, pieces: int | None = None,
        parameters: Mapping[str, Any] | None = None, iterations: int = FEW,
    ) -> None:  # fmt: skip
        self.diagram = prepared(diagram, parameters)
        task = asked(self.diagram, commands, error, limits, rates, dict.fromkeys(references))
        if smallest not in ("peak", "rms"):
            raise ParameterError(f"smallest is 'peak' or 'rms', got {in_words(smallest)}."
                                 f"{near(str(smallest), ('peak', 'rms'))}")  # fmt: skip
        h, ahead = positive("step", step), whole("preview", preview, 2)
        self.interval = Interval(task, h, pieces_of(task, pieces, h))
        goal = "both" if smallest == "peak" else smallest
        options = {**OPTIONS, "ipopt.max_iter": whole("iterations", iterations, 1)}
        self._first = Programme(self.interval, ahead, goal, False, {**options, "ipopt.max_iter": 10 * FEW})
        self._later = Programme(self.interval, ahead, goal, False, options)
        self.t = number("start", start)
        self.state = np.asarray(task.eq.start(task.p)[0]).ravel()
        self.command = np.clip(np.zeros(len(task.commands)), *task.ranges)
        self.seconds: list[float] = []
        self.missed = 0
        self._plan: Solution | None = None
        self._units: Units | None = None
        self._largest = 0.0
        self._size = np.zeros(task.rounded.count)

    @property
    def task(self) -> Task:
        """What is asked of it."""
        return self.interval.task

    @property
    def preview(self) -> int:
        """Samples that it looks ahead."""
        return self._first.count

    def next(
        self, references: Mapping[str, Any], inputs: Mapping[str, Any] | None = None,
        state: Mapping[str, float] | None = None,
    ) -> dict[str, float]:  # fmt: skip
        """The commands at the next sample, towards which to go in a straight line from those of now.

        ``references`` and other ``inputs`` of the diagram are numbers, or ``preview`` + 1 samples from now on;
        ``state`` gives states by name that are known better than by the model. Raises DataError.
        """
        task, grid = self.task, self._grid()
        for name, value in (state or {}).items():
            if name not in task.eq.x:
                raise DataError(f"'{task.eq.title}' has no state '{name}'.{near(name, task.eq.x)}")
            self.state[task.eq.x.index(name)] = number(f"the state '{name}'", value, DataError)
        missing = [name for name in task.references if name not in references]
        if missing:
            raise DataError(f"the references are {', '.join(task.references)}, and {missing[0]} is not given.")
        ahead = {k: self._ahead(k, v, grid) for k, v in {**references, **(inputs or {})}.items()}
        table = given_rows(task, {k: v for k, v in ahead.items() if k not in task.references},
                           {k: ahead[k] for k in task.references}, "linear", grid)  # fmt: skip
        return self.planned(table)

    def planned(self, table: np.ndarray) -> dict[str, float]:
        """The same, where everything given is laid out as ``given_rows`` does."""
        began = time.perf_counter()
        if self._units is None:
            still = np.tile(self.command[:, None], self.preview + 1)
            self._units = units_of(self.interval, still, self.state, self.t, table)
        given = float(np.abs(table[:, :, len(self.task.eq.u) :]).max(initial=0.0))  # the size of errors that matter
        self._units = attrs.evolve(self._units, error=max(self._largest, given) or self._units.error)
        self._largest = max(self._largest, given)
        plan = self._planned(Known(self.state, self.command, self.t, table, self._units))
        self.seconds.append(time.perf_counter() - began)
        one = table[: self.interval.pieces]
        path, _, _ = self.interval.followed(plan.commands[:, :2], self.state, self.t, one)
        self.state, self.command, self._plan = path[:, 1], plan.commands[:, 1], plan
        self.t += self.interval.step
        return dict(zip(self.task.commands, self.command.tolist(), strict=True))

    def _grid(self) -> np.ndarray:
        h = self.interval.step / self.interval.pieces
        return self.t + h * np.arange(self.preview * self.interval.pieces + 1)

    def _ahead(self, name: str, given: Any, grid: np.ndarray) -> Any:
        if np.ndim(given) == 0:
            return given
        if np.shape(given) != (self.preview + 1,):
            raise DataError(f"'{name}' must be a number or {self.preview + 1} samples, one for now and one for each "
                            f"sample of the preview; got shape {np.shape(given)}.")  # fmt: skip
        return grid[:: self.interval.pieces], np.asarray(given, dtype=float)

    def _planned(self, known: Known) -> Solution:
        if self._plan is None:
            return self._begun(known)
        last = self._plan
        shifted = Solution(_shifted(last.commands), _shifted(last.states), last.peak)
        shifted.commands[:, 0], shifted.states[:, 0] = known.before, known.begin
        size = self.interval.sizes(shifted.states, shifted.commands, known.start, known.table)
        self._size = np.maximum(self._size, size)
        plan = self._later.solve(shifted, known, SHARP * self._size)
        if not plan.feasible:  # what led here leads nowhere: plan from standing still
            plan = self._begun(known)
        self.missed += not plan.feasible
        return plan

    def _begun(self, known: Known) -> Solution:
        """The first plan, from standing still, while kinks are sharpened."""
        count = self.preview + 1
        commands, states = (np.tile(part[:, None], count) for part in (known.before, known.begin))
        plan = Solution(commands, states, 1.0, feasible=False)
        for share in ROUNDED:
            self._size = self.interval.sizes(plan.states, plan.commands, known.start, known.table)
            made = self._first.solve(plan, known, max(share, SHARP) * self._size)
            plan = attrs.evolve(made, forces=None) if made.feasible else plan
        return plan


def _shifted(rows: np.ndarray) -> np.ndarray:
    """Samples one later; the last stays."""
    return np.column_stack([rows[:, 1:], rows[:, -1]])


def receding_horizon(
    diagram: Diagram, commands: Mapping[str, Any], error: str, *, references: Mapping[str, Any], preview: int = 25,
    smallest: str = "rms", rates: Mapping[str, Any] | None = None, limits: Sequence[str] | str = (),
    stop: float | None = None, start: float = 0.0, step: float = 0.02, pieces: int | None = None,
    inputs: Mapping[str, Any] | None = None, hold: str = "linear", parameters: Mapping[str, Any] | None = None,
    iterations: int = FEW, progress: Tell | None = None,
) -> OptimalControl:  # fmt: skip
    """The commands of a ``RecedingHorizon`` along references that are known ``preview`` samples ahead.

    Arguments as for ``optimal_control``; references and inputs must reach ``preview`` samples beyond ``stop``, and
    without it end there. ``seconds`` of the result tells how long each sample's plan took.
    """
    control = RecedingHorizon(diagram, commands, error, references=tuple(references), preview=preview,
                              smallest=smallest, rates=rates, limits=limits, start=start, step=step, pieces=pieces,
                              parameters=parameters, iterations=iterations)  # fmt: skip
    interval, h = control.interval, control.interval.step
    end = number("stop", stop) if stop is not None else ending(references, inputs) - preview * h
    count = whole_steps(control.t, end, h)
    grid = control.t + h / interval.pieces * np.arange((count + preview) * interval.pieces + 1)
    table = given_rows(control.task, given_inputs(inputs), dict(references), hold, grid)
    begun = (control.state, control.command, control.t, table[: count * interval.pieces])
    made, states = [control.command], [control.state]
    for k in range(count):
        if progress is not None:
            progress("planned", k, count)
        control.planned(table[k * interval.pieces : (k + preview) * interval.pieces])
        made.append(control.command)
        states.append(control.state)
    word = f"{control.missed} of {count} plans did not come out" if control.missed else "Solve_Succeeded"
    whole_run = Solution(np.column_stack(made), np.column_stack(states), 0.0, word)
    units = Units(np.ones(len(control.command)), np.ones(len(control.state)), 1.0)
    known = Known(*begun, units)
    ended = result(control.diagram, interval, smallest, False, whole_run, known, given_inputs(inputs), hold)
    return attrs.evolve(ended, seconds=np.array(control.seconds))
