"""Optimal control of any diagram: the commands that keep an error smallest, within limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.arguments import given_inputs, number, positive, prepared, whole, whole_steps
from tsmblocks.diagram import Diagram
from tsmblocks.errors import ParameterError, RunError, TsmError, in_words, near
from tsmblocks.expressions import Expression, expression
from tsmblocks.fitting.constraints import constraints
from tsmblocks.measures import peak_to_peak, rms
from tsmblocks.optimal.transcription import Interval, Known, Programme, Solution, Task, check, given_rows, units_of
from tsmblocks.poles import poles
from tsmblocks.run import Run
from tsmblocks.simulate import equations, parameter_vector, simulate

ROUNDED = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Sizes over which kinks are rounded off in one search after another, as shares of what lies in them."""
ROOM = 1.01
"""How far, over the smallest peak, errors may be where of all such commands those of least mean square are taken."""
REACH = 2.0
"""Step times fastest pole, at most, of one Runge-Kutta step."""
LEAST = 2
"""Runge-Kutta steps of an interval at least, so that the error is looked at between samples too."""
GOALS = ("peak", "rms")
OPTIONS = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "show_eval_warnings": False,
           "calc_lam_p": False, "ipopt.tol": 1e-8, "ipopt.mu_strategy": "adaptive", "error_on_fail": False}  # fmt: skip
"""For the solver."""

Tell = Callable[[str, int, int], Any]


@attrs.frozen(eq=False)
class OptimalControl:
    """Commands found, and the run with them.

    ``t`` (N,) [s] are the samples and ``commands`` maps inputs to their values there, linear in between. ``states`` are
    those at the start. ``run`` is the simulation of the diagram as it is with them; ``error`` (M,) is the error on the
    way, at samples from either side: where a command's rate jumps, so may an output. ``found`` says whether the solver
    ended where nothing nearby is better, and ``word`` is its own for why it ended.
    """

    goal: str
    t: np.ndarray
    commands: Mapping[str, np.ndarray]
    states: Mapping[str, float]
    periodic: bool
    run: Run = attrs.field(repr=False)
    error: np.ndarray = attrs.field(repr=False)
    unit: str
    found: bool
    word: str
    seconds: np.ndarray = attrs.field(factory=lambda: np.empty(0), repr=False)
    """How long each sample took to plan, where it was planned sample by sample [s]."""

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

    def inputs(self, stop: float | None = None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """The commands as ``simulate`` takes them, up to ``stop`` [s]: periodic ones go on, others hold their last.

        Raises RunError where ``stop`` lies before the start.
        """
        end = self.t[-1] if stop is None else number("stop", stop)
        if end <= self.t[0]:
            raise RunError(f"the commands begin at {self.t[0]:g} s, so they cannot stop at {end:g} s.")
        if end <= self.t[-1] * (1 + 1e-12):
            return {k: (self.t, v) for k, v in self.commands.items()}
        if not self.periodic:
            t = np.append(self.t, end)
            return {k: (t, np.append(v, v[-1])) for k, v in self.commands.items()}
        period = self.t[-1] - self.t[0]
        times = math.ceil((end - self.t[0]) / period - 1e-9)
        t = np.concatenate([[self.t[0]], *(self.t[1:] + k * period for k in range(times))])
        return {k: (t, np.concatenate([v[:1], *[v[1:]] * times])) for k, v in self.commands.items()}

    def __str__(self) -> str:
        degrees = self.unit == "rad"
        scale, unit = (180 / math.pi, "deg") if degrees else (1.0, self.unit)
        numbers = (self.peak_to_peak, self.peak, self.rms)
        said = ", ".join(f"{what} {scale * v:.3g}{' ' * bool(unit)}{unit}"
                         for what, v in zip(("peak to peak", "peak", "rms"), numbers, strict=True))  # fmt: skip
        ended = "" if self.found else f" (the search ended early: {self.word})"
        return f"{self.run.title}: error with smallest {self.goal}: {said}{ended}"


def optimal_control(
    diagram: Diagram, commands: Mapping[str, Any], error: str, *, smallest: str = "peak",
    rates: Mapping[str, Any] | None = None, limits: Sequence[str] | str = (),
    references: Mapping[str, Any] | None = None, stop: float | None = None, start: float = 0.0, step: float = 0.01,
    pieces: int | None = None, periodic: bool = False, inputs: Mapping[str, Any] | None = None, hold: str = "linear",
    parameters: Mapping[str, Any] | None = None, guess: Mapping[str, Any] | None = None, iterations: int = 1000,
    progress: Tell | None = None,
) -> OptimalControl:  # fmt: skip
    """The commands that keep an error smallest: what the best controller with full foresight could do.

    ``commands`` maps inputs of the diagram to their limits ``(low, high)``, None for no limit; ``rates`` does so for
    how fast they may change, per s. ``error`` is an expression of signals, such as ``"x_ref - x_out"``, and
    ``references`` gives those of them that are no signals of the diagram, as ``inputs`` gives its other inputs (both as
    for ``simulate``). Of the error the ``smallest`` "peak" or "rms" is looked for; of all commands with (nearly) the
    smallest peak those of smallest rms are taken. ``limits`` are comparisons such as ``"abs(motor.i) <= 1.5"`` that are
    to hold at every sample.

    Commands are linear between samples ``step`` s apart, from ``start`` to ``stop``; each interval is integrated in
    ``pieces`` Runge-Kutta steps (as many as the fastest pole asks for). The run begins at the diagram's start values
    and the guess's first commands, or, where it is ``periodic``, ends as it begins. ``guess`` maps commands to samples
    to begin the search from (zeros without it); a plain copy of the reference often is a good one, since searches end
    in the nearest best. Kinks of the equations are rounded off, less and less; the result is run without any rounding.

    Raises ParameterError, RunError, DataError. Source: Betts, Practical Methods for Optimal Control (2010), 4.
    """
    diagram = prepared(diagram, parameters)
    task = asked(diagram, commands, error, limits, rates, references)
    if smallest not in GOALS:
        raise ParameterError(f"smallest is 'peak' or 'rms', got {in_words(smallest)}.{near(str(smallest), GOALS)}")
    h, begin = positive("step", step), number("start", start)
    end = number("stop", stop) if stop is not None else ending(references, inputs)
    count = whole_steps(begin, end, h)
    if abs(begin + count * h - end) > 1e-6 * h:
        raise RunError(f"stop={end:g} s is no whole number of steps of {h:g} s after start={begin:g} s.")
    interval = Interval(task, h, pieces_of(task, pieces, h))
    grid = begin + h / interval.pieces * np.arange(count * interval.pieces + 1)
    table = given_rows(task, given_inputs(inputs), dict(references or {}), hold, grid)
    options = {**OPTIONS, "ipopt.max_iter": whole("iterations", iterations, 1)}
    x = np.asarray(task.eq.start(task.p)[0]).ravel()
    first = _guessed(task, guess, begin + h * np.arange(count + 1), x, interval, table)
    units = units_of(interval, first.commands, x, begin, table)
    known = Known(x, first.commands[:, 0], begin, table, units)
    ended = _searched(interval, count, smallest, periodic, options, first, known, progress or (lambda *_: None))
    return result(diagram, interval, smallest, periodic, ended, known, given_inputs(inputs), hold)


def asked(
    diagram: Diagram, commands: Mapping[str, Any], error: str, limits: Sequence[str] | str,
    rates: Mapping[str, Any] | None, references: Mapping[str, Any] | None,
) -> Task:  # fmt: skip
    """What is asked, read and checked. Raises ParameterError and RunError."""
    eq = equations(diagram)
    inputs = [f.name for f in eq.u if not f.block and not f.order]
    low_high = _ranges("commands", commands, inputs, eq.title)
    check(eq, tuple(low_high))
    slow_fast = _ranges("rates", rates or {}, tuple(low_high), eq.title)
    extra = tuple(references or {})
    names = {**{name: name for name in eq.y}, **eq.aliases}
    taken = next((name for name in extra if name in names), "")
    if taken:
        raise ParameterError(f"references give '{taken}', which is a signal of '{eq.title}' already.")
    known = [*names, *extra]
    needed = expression(error, known, what="error", kind="signal")
    held = tuple(one.expression for one in constraints(limits, known)) if limits else ()
    paces = [slow_fast.get(name, (-np.inf, np.inf)) for name in low_high]
    used = {name for one in (needed, *held) for name in one.names}
    return Task(eq, parameter_vector(eq, diagram), tuple(low_high), np.array(list(low_high.values())).T,
                np.array(paces).T, needed, held, {k: v for k, v in names.items() if k in used}, extra)  # fmt: skip


def _ranges(what: str, given: Any, known: Sequence[str], title: str) -> dict[str, tuple[float, float]]:
    """Limits by name; None is none."""
    if not isinstance(given, Mapping):
        raise ParameterError(f"{what} must map inputs to (low, high), got {in_words(given)}.")
    made = {}
    for name, pair in given.items():
        if name not in known:
            kind = "input" if what == "commands" else "command"
            raise ParameterError(f"{what}: '{title}' has no {kind} '{name}'.{near(str(name), known)}")
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise ParameterError(f"{what} of '{name}' must be a pair (low, high), None for no limit, "
                                 f"got {in_words(pair)}.")  # fmt: skip
        low, high = (end if one is None else number(f"{what} of '{name}'", one, ParameterError)
                     for one, end in zip(pair, (-np.inf, np.inf), strict=True))  # fmt: skip
        if not low < high:
            raise ParameterError(f"{what} of '{name}': the lower limit must be below the upper one, "
                                 f"got ({low:g}, {high:g}).")  # fmt: skip
        made[str(name)] = (low, high)
    return made


def ending(references: Mapping[str, Any] | None, inputs: Mapping[str, Any] | None) -> float:
    """The end of what is given, where no stop is."""
    ends = [float(np.asarray(v[0])[-1]) for v in {**(references or {}), **(inputs or {})}.values()
            if isinstance(v, tuple) and len(v) == 2 and np.ndim(v[0]) == 1 and len(v[0])]  # fmt: skip
    if not ends:
        raise RunError("say when it ends: stop=… [s], or references as (times, values).")
    return min(ends)


def pieces_of(task: Task, given: int | None, h: float) -> int:
    """Runge-Kutta steps of an interval: as many as the fastest pole at the start asks for."""
    if given is not None:
        return whole("pieces", given, 1)
    fastest = max((abs(p) for p in poles(task.eq, task.p)), default=0.0)
    return max(LEAST, math.ceil(h * fastest / REACH))


def _guessed(
    task: Task, guess: Mapping[str, Any] | None, t: np.ndarray, x: np.ndarray, interval: Interval, table: np.ndarray
) -> Solution:
    """Commands to begin from, and the states that follow from them; where those run away, the start values."""
    commands = np.zeros((len(task.commands), len(t)))
    for name, given in (guess or {}).items():
        if name not in task.commands:
            raise ParameterError(f"guess: there is no command '{name}'.{near(str(name), task.commands)}")
        values = given[1] if isinstance(given, tuple) else given
        times = given[0] if isinstance(given, tuple) else t
        if np.shape(values) != np.shape(times) or not np.isfinite(np.asarray(values, dtype=float)).all():
            raise ParameterError(f"guess of '{name}' must be {len(t)} finite numbers, one for each sample, or a pair "
                                 "(times, values).")  # fmt: skip
        commands[task.commands.index(name)] = np.interp(t, times, np.asarray(values, dtype=float))
    commands = np.clip(commands, task.ranges[0][:, None], task.ranges[1][:, None])
    path, _, _ = interval.followed(commands, x, float(t[0]), table)
    return Solution(commands, path if np.isfinite(path).all() else np.tile(x[:, None], len(t)), 1.0)


def _searched(
    interval: Interval, count: int, smallest: str, periodic: bool, options: Mapping[str, Any], first: Solution,
    known: Known, tell: Tell,
) -> Solution:  # fmt: skip
    """One search after another: the mean square while kinks are sharpened, then the peak, then the rest of it."""
    square = Programme(interval, count, "rms", periodic, options)
    size = interval.sizes(first.states, first.commands, known.start, known.table)
    total, ended = len(ROUNDED) + 2 * (smallest == "peak"), first
    for k, share in enumerate(ROUNDED):
        tell("searched", k, total)
        made = square.solve(ended, known, share * size)
        ended = made if made.found or k == 0 else ended
        size = interval.sizes(ended.states, ended.commands, known.start, known.table)
    if smallest == "peak":
        tell("searched", len(ROUNDED), total)
        rounded = ROUNDED[-1] * size
        peak = Programme(interval, count, "peak", periodic, options).solve(
            attrs.evolve(ended, peak=_largest(interval, ended, known), forces=None), known, rounded
        )
        tell("searched", total - 1, total)
        within = Programme(interval, count, "within", periodic, options)
        calm = within.solve(attrs.evolve(peak, forces=None), known, rounded, ROOM * peak.peak)
        ended = calm if calm.found and peak.found else peak
    tell("searched", total, total)
    return ended


def result(
    diagram: Diagram, interval: Interval, goal: str, periodic: bool, ended: Solution, known: Known,
    inputs: Mapping[str, Any], hold: str,
) -> OptimalControl:  # fmt: skip
    """The commands as they are in truth: run through the equations without rounding."""
    task, count = interval.task, ended.commands.shape[1] - 1
    t = known.start + interval.step * np.arange(count + 1)
    commands = {name: ended.commands[k] for k, name in enumerate(task.commands)}
    states = dict(zip(task.eq.x, ended.states[:, 0].tolist(), strict=True))
    try:
        run = simulate(diagram, start=known.start, stop=float(t[-1]), step=interval.step / interval.pieces, hold=hold,
                       inputs={**inputs, **{k: (t, v) for k, v in commands.items()}}, initial=states)  # fmt: skip
    except TsmError as failed:
        raise RunError(f"the search ended early ({ended.word}), and its commands cannot be run: {failed}") from failed
    _, error, _ = interval.followed(ended.commands, ended.states[:, 0], known.start, known.table)
    return OptimalControl(goal, t, commands, states, periodic, run, error.ravel(), _unit(task.error, run), ended.found,
                          ended.word)  # fmt: skip


def _largest(interval: Interval, ended: Solution, known: Known) -> float:
    _, error, _ = interval.followed(ended.commands, ended.states[:, 0], known.start, known.table)
    return float(np.abs(error).max())


def _unit(error: Expression, run: Run) -> str:
    """The unit of an error that is a sum or difference of signals, as far as one is known."""
    return next((run.unit(name) for name in error.names if name in run and run.unit(name)), "")
