"""Optimal control as a nonlinear programme: states at the samples are variables, joined by Runge-Kutta steps.

Direct transcription by multiple shooting (Bock and Plitt, 1984; Betts, Practical Methods for Optimal Control, 2010).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import Signal, input_rows
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.session import gather_signals
from tsmblocks.fitting.constraints import Constraint
from tsmblocks.metrics.expressions import Expression
from tsmblocks.model.fields import Samples
from tsmblocks.optimal.smoothing import Smooth, smooth

_RULE = method_named("rk4")
JUMP_MARGIN = 1e-9
"""Share of an interval by which its end comes before the start of the next: a jump belongs to the next. Chosen."""
CONSTRAINT_TOLERANCE = 1e-6
"""Violation of a constraint, in scaled units, that is accepted. Chosen: above IPOPT's own tolerance."""
PEAK_WEIGHT = 0.1
"""Weight of the squared peak beside the mean square in the goal "both". Chosen."""
NEGLIGIBLE_ERROR = 1e-9
"""Errors below this share of the references count as zero, and no smaller ones are searched. Chosen."""


@attrs.frozen(eq=False)
class Task:
    """The problem apart from times: the equations, which inputs are commands, the error and the limits.

    ``ranges`` (2, commands) are the lowest and highest commands, ``rate_ranges`` (2, commands) their rates [1/s];
    ``limits`` hold at every instant. ``names`` maps the names in expressions to signals of the equations;
    ``references`` are the names of known signals.
    """

    eq: Equations
    p: np.ndarray
    commands: tuple[str, ...]
    ranges: np.ndarray
    rate_ranges: np.ndarray
    error: Expression
    limits: tuple[Constraint, ...]
    names: Mapping[str, str]
    references: tuple[str, ...]

    def within(self, commands: np.ndarray) -> np.ndarray:
        """Commands (c, N), clipped to their ranges."""
        return np.clip(commands, self.ranges[0][:, None], self.ranges[1][:, None])

    @cached_property
    def rhs(self) -> ca.Function:
        """The equations with their parameters: rates and outputs from time, states and inputs."""
        t, x = ca.SX.sym("t"), ca.SX.sym("x", len(self.eq.x))
        u, none = ca.SX.sym("u", len(self.eq.u)), ca.SX(0, 1)
        dx, y, _ = self.eq.rhs(t, x, none, u, none, ca.SX(self.p))
        return ca.Function("rhs", [t, x, u], [dx, y], ["t", "x", "u"], ["dx", "y"])

    @cached_property
    def smoothed(self) -> Smooth:
        """The same with smoothed kinks."""
        return smooth(self.rhs)

    @cached_property
    def command_inputs(self) -> list[tuple[int, int, int]]:
        """Where commands enter the equations: (input of the equations, command, order of the derivative)."""
        names = [feed.name.removeprefix("d/dt " * feed.order) for feed in self.eq.u]
        return [
            (k, self.commands.index(name), feed.order)
            for k, (name, feed) in enumerate(zip(names, self.eq.u, strict=True))
            if not feed.block and name in self.commands
        ]


@attrs.frozen(eq=False)
class KnownSignals:
    """Known signals by name: other inputs of the diagram, and references; as for ``simulate``."""

    inputs: Mapping[str, Any]
    references: Mapping[str, Any]
    hold: str = "linear"

    def on(self, t: np.ndarray) -> KnownSignals:
        """The same, plain values being those at the samples ``t`` [s]."""

        def paired(value: Any) -> Any:
            timed = hasattr(value, "t") or callable(value) or isinstance(value, tuple)
            return value if timed or np.shape(value) != np.shape(t) else (t, value)

        inputs, references = ({k: paired(v) for k, v in one.items()} for one in (self.inputs, self.references))
        return KnownSignals(inputs, references, self.hold)


def linear_samples(t: np.ndarray, y: np.ndarray) -> Samples:
    """Samples of a command: linear in between, whatever the hold of other inputs."""
    return Samples(t, y, "linear")


def known_rows(task: Task, given: KnownSignals, grid: np.ndarray) -> np.ndarray:
    """The known signals at the instants of each step, shape (steps, 3, inputs + references).

    Commands are zero there. Raises DataError.
    """
    step = float(grid[1] - grid[0])
    flat = {name: linear_samples(grid[[0, -1]], np.zeros(2)) for name in task.commands}
    signals = gather_signals(task.eq, {**given.inputs, **flat}, grid, given.hold)
    for name in task.references:
        if name not in given.references:
            raise DataError(f"the references are {', '.join(task.references)}, and {name} is not given.")
        signal = Signal(name, given.references[name], grid, given.hold)
        signal.covers(float(grid[0]), float(grid[-1]), step)
        signals.append((signal, 0))
    return input_rows(signals, float(grid[0]), step, 0, len(grid) - 1, (0.0, 0.5, 1.0))[:-1]


@attrs.frozen(eq=False)
class Interval:
    """One interval between samples of the commands, as a function: ``step`` s long, in ``pieces`` Runge-Kutta steps.

    Both functions of (x, c0, c1, t, w, size) give the states at the end, the errors (pieces + 1,) and the limits
    (limits, pieces + 1) on the way; ``w`` are the known signals of its pieces, ``size`` the widths of the smoothing.
    """

    task: Task
    step: float
    pieces: int

    @cached_property
    def smoothed(self) -> ca.Function:
        """The interval with smoothed kinks."""
        return self._function(smoothed=True)

    @cached_property
    def exact(self) -> ca.Function:
        """The interval with the exact equations; ``size`` has no effect."""
        return self._function(smoothed=False)

    def _function(self, smoothed: bool) -> ca.Function:
        task, h = self.task, self.step / self.pieces
        x = ca.SX.sym("x", len(task.eq.x))
        c0, c1 = ca.SX.sym("c0", len(task.commands)), ca.SX.sym("c1", len(task.commands))
        t, size = ca.SX.sym("t"), ca.SX.sym("size", task.smoothed.count)
        w = ca.SX.sym("w", len(task.eq.u) + len(task.references), 3 * self.pieces)

        def rhs(state: Any, piece: int, share: float) -> tuple[Any, Any]:
            column, at = 3 * piece + round(2 * share), (piece + share) / self.pieces
            u = w[: len(task.eq.u), column]
            for k, command, order in task.command_inputs:
                rise = c1[command] - c0[command]
                u[k] = rise / self.step if order else c0[command] + at * rise
            before = JUMP_MARGIN * self.step if share == 1.0 else 0.0  # sources that jump at a sample do so after it
            given = (t + at * self.step - before, state, u)
            dx, y = task.smoothed.function(*given, size) if smoothed else task.rhs(*given)
            return dx, self._measured(y, w[len(task.eq.u) :, column])

        errors, limits, state = [], [], x
        for piece in range(self.pieces):
            stages: list[Any] = []
            for row, share in zip(_RULE.rows, _RULE.offsets, strict=True):
                moved = state + h * sum((a * k for a, k in zip(row, stages, strict=True)), ca.SX(0.0))
                rate, measured = rhs(moved, piece, share)
                stages.append(rate)
                if not row:
                    errors.append(measured[0])
                    limits.append(measured[1])
            state = state + h * sum(b * k for b, k in zip(_RULE.weights, stages, strict=True))
        _, last = rhs(state, self.pieces - 1, 1.0)
        outs = [state, ca.vertcat(*errors, last[0]), ca.horzcat(*limits, last[1])]
        return ca.Function("interval", [x, c0, c1, t, w, size], outs)

    def _measured(self, y: Any, references: Any) -> tuple[Any, Any]:
        """The error, and the limits (limits,), of outputs of the equations."""
        task = self.task
        values = {name: y[task.eq.y.index(signal)] for name, signal in task.names.items()}
        values |= {name: references[k] for k, name in enumerate(task.references)}
        limits = [one.expression.symbolic(values) for one in task.limits]
        return task.error.symbolic(values), ca.vertcat(ca.SX(0, 1), *limits)

    def grid(self, start: float, count: int) -> np.ndarray:
        """The ends of all Runge-Kutta steps of ``count`` intervals [s]."""
        return start + self.step / self.pieces * np.arange(count * self.pieces + 1)


@attrs.frozen(eq=False)
class Window:
    """Consecutive intervals from ``start`` [s] on, with the known signals on them, as ``known_rows`` lays them out."""

    interval: Interval
    start: float
    table: np.ndarray

    @cached_property
    def signals(self) -> np.ndarray:
        """The known signals as the intervals take them, shape (inputs + references, 3 * pieces * intervals)."""
        return self.table.reshape(-1, self.table.shape[2]).T

    @property
    def largest_reference(self) -> float:
        """The largest absolute value of a reference, 0 where there is none."""
        return float(np.abs(self.table[:, :, len(self.interval.task.eq.u) :]).max(initial=0.0))

    def simulated(self, commands: np.ndarray, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The exact equations simulated from one state, with commands (c, N + 1).

        States at the samples (n, N + 1); errors (N, pieces + 1) and limits (N, limits, pieces + 1), both from either
        side of each sample, where a command's rate jumps.
        """
        interval, wide = self.interval, 3 * self.interval.pieces
        x, states, errors, limits = begin, [begin], [], []
        none = np.zeros(interval.task.smoothed.count)
        for k in range(commands.shape[1] - 1):
            t, inside = self.start + k * interval.step, self.signals[:, k * wide : (k + 1) * wide]
            made = [np.asarray(one) for one in interval.exact(x, commands[:, k], commands[:, k + 1], t, inside, none)]
            x = made[0].ravel()
            states.append(x)
            errors.append(made[1].ravel())
            limits.append(made[2])
        return np.column_stack(states), np.array(errors), np.array(limits)

    def cost(self, goal: str, commands: np.ndarray, begin: np.ndarray) -> float:
        """The objective with the exact equations, in the unit of the error; infinite where they diverge."""
        _, error, _ = self.simulated(commands, begin)
        square, peak = np.mean(error**2), np.abs(error).max()
        cost = {"peak": peak, "both": np.sqrt(square + PEAK_WEIGHT * peak**2)}.get(goal, np.sqrt(square))
        return float(cost) if np.isfinite(cost) else np.inf

    def sizes(self, solution: Solution) -> np.ndarray:
        """The rms size of the arguments of kinks along a solution."""
        task, step, count = self.interval.task, self.interval.step, solution.commands.shape[1] - 1
        if not task.smoothed.count:
            return np.zeros(0)
        u = self.signals[: len(task.eq.u), :: 3 * self.interval.pieces].copy()
        for k, command, order in task.command_inputs:
            c = solution.commands[command]
            u[k] = np.diff(c) / step if order else c[:-1]
        t = self.start + step * np.arange(count)
        inside = np.asarray(task.smoothed.kinks.map(count)(t, solution.states[:, :-1], u))
        inside = np.where(np.isfinite(inside), inside, 0.0)
        size = np.sqrt(np.mean(inside**2, axis=1))
        return np.where(size > 0, size, 1.0)

    def scales(self, commands: np.ndarray, begin: np.ndarray) -> Scales:
        """Sizes along initial commands (c, N + 1), and along commands of that size that rise and stay."""
        given = self.largest_reference or 1.0
        ranges = np.abs(self.interval.task.ranges)
        finite = np.where(np.isfinite(ranges), ranges, 0.0).max(axis=0)
        sizes = np.abs(commands).max(axis=1)
        sizes = np.where(sizes > 0, sizes, np.where(finite > 0, finite, given))
        states, errors = np.abs(begin), 0.0
        for tried in (commands, np.minimum(np.arange(commands.shape[1]) / 5, 1.0) * sizes[:, None]):
            path, error, _ = self.simulated(tried, begin)
            if np.isfinite(path).all() and np.isfinite(error).all():
                states = np.maximum(states, np.abs(path).max(axis=1))
                errors = errors or float(np.abs(error).max())
            if errors <= NEGLIGIBLE_ERROR * given:  # only rounding, where the initial commands are the optimum
                errors = 0.0
        return Scales(sizes, np.where(states > 0, states, 1.0), errors or given)


@attrs.frozen(eq=False)
class Scales:
    """Sizes of commands (c,), states (n,) and the error: the units in which the solver works."""

    commands: np.ndarray
    states: np.ndarray
    error: float


@attrs.frozen(eq=False)
class Problem:
    """The start of one search: a window, states and commands at its start, and the scales."""

    window: Window
    begin: np.ndarray
    before: np.ndarray
    scales: Scales


@attrs.frozen(eq=False)
class Solution:
    """Commands (c, N + 1) and states (n, N + 1) at the samples, the largest error, and the status of the solver.

    ``feasible`` is whether all limits are kept and the intervals join, at an optimum or not.
    """

    commands: np.ndarray
    states: np.ndarray
    peak: float
    word: str = ""
    feasible: bool = True

    @property
    def found(self) -> bool:
        """Whether it is a local optimum within all limits."""
        return self.word in ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@attrs.frozen(eq=False)
class Programme:
    """The nonlinear programme over ``count`` intervals.

    Its ``goal`` is the least "peak" of the error, the least "rms", the least rms of those "within" a peak, or the least
    of "both" together. Variables are commands (c, count + 1), states (n, count + 1) and the largest error; parameters
    are states and commands at the start, the known signals, the start time, the sizes of the kinks, the most that
    errors may be, and the scales.
    """

    interval: Interval
    count: int
    goal: str
    periodic: bool
    options: Mapping[str, Any]

    @cached_property
    def solver(self) -> Any:
        """The solver, made once."""
        task, count = self.interval.task, self.count
        c, x = ca.MX.sym("c", len(task.commands), count + 1), ca.MX.sym("x", len(task.eq.x), count + 1)
        peak = ca.MX.sym("peak")
        begin, before = ca.MX.sym("begin", len(task.eq.x)), ca.MX.sym("before", len(task.commands))
        w = ca.MX.sym("w", len(task.eq.u) + len(task.references), 3 * self.interval.pieces * count)
        t0, size, most = ca.MX.sym("t0"), ca.MX.sym("size", task.smoothed.count), ca.MX.sym("most")
        unit_c, unit_x, unit_e = (ca.MX.sym(f"unit{k}", n) for k, n in enumerate((c.shape[0], x.shape[0], 1)))
        z = ca.vertcat(ca.vec(c), ca.vec(x), peak)
        c, x = c * ca.repmat(unit_c, 1, count + 1), x * ca.repmat(unit_x, 1, count + 1)
        t = t0 + self.interval.step * ca.DM(np.arange(count)).T
        ends, errors, limits = self.interval.smoothed.map(count)(
            x[:, :-1], c[:, :-1], c[:, 1:], t, w, ca.repmat(size, 1, count)
        )
        e = ca.vec(errors) / unit_e
        first, before_it = (x[:, -1], c[:, -1]) if self.periodic else (begin, before)
        gaps = ca.vec((x[:, 1:] - ends) / ca.repmat(unit_x, 1, count))
        joints = [gaps, (x[:, 0] - first) / unit_x, (c[:, 0] - before_it) / unit_c]
        rates = ca.vec((c[:, 1:] - c[:, :-1]) / self.interval.step)
        below = [peak - e, peak + e]
        bounded = {"peak": below, "both": below, "within": [most - e, most + e], "rms": []}[self.goal]
        square = ca.sumsqr(e) / e.numel()
        made = {
            "x": z,
            "f": 100.0 * {"peak": peak, "both": square + PEAK_WEIGHT * peak**2}.get(self.goal, square),
            "g": ca.vertcat(*joints, rates, *bounded, ca.vec(limits)),
            "p": ca.vertcat(begin, before, ca.vec(w), t0, size, most, unit_c, unit_x, unit_e),
        }
        return ca.nlpsol("programme", "ipopt", made, dict(self.options))

    def bounds(self, scales: Scales) -> dict[str, np.ndarray]:
        """Bounds of the variables, in their units, and of what is constrained."""
        task, count = self.interval.task, self.count
        n, c = len(task.eq.x), len(task.commands)
        free = np.full(n * (count + 1) + 1, np.inf)
        joints = n * count + n + c
        after = (2 * (self.goal != "rms") + len(task.limits)) * count * (self.interval.pieces + 1)
        return {
            "lbx": np.concatenate([np.tile(task.ranges[0] / scales.commands, count + 1), -free]),
            "ubx": np.concatenate([np.tile(task.ranges[1] / scales.commands, count + 1), free]),
            "lbg": np.concatenate([np.zeros(joints), np.tile(task.rate_ranges[0], count), np.zeros(after)]),
            "ubg": np.concatenate([np.zeros(joints), np.tile(task.rate_ranges[1], count), np.full(after, np.inf)]),
        }

    def solve(self, guess: Solution, problem: Problem, size: np.ndarray, most: float = 0.0) -> Solution:
        """Search from a guess. ``most`` is the peak that errors are to stay within, where that is the goal."""
        scales, window = problem.scales, problem.window
        c0, x0 = guess.commands / scales.commands[:, None], guess.states / scales.states[:, None]
        given = [problem.begin, problem.before, window.signals.ravel(order="F"), [window.start], size]
        answer = self.solver(
            x0=np.concatenate([c0.ravel(order="F"), x0.ravel(order="F"), [guess.peak / scales.error]]),
            p=np.concatenate([*given, [most / scales.error], scales.commands, scales.states, [scales.error]]),
            **self.bounds(scales),
        )
        z, stats = np.asarray(answer["x"]).ravel(), self.solver.stats()
        course = (stats.get("iterations") or {}).get("inf_pr") or [np.inf]  # violations of constraints
        return Solution(
            scales.commands[:, None] * z[: c0.size].reshape(c0.shape, order="F"),
            scales.states[:, None] * z[c0.size : -1].reshape(x0.shape, order="F"),
            scales.error * float(z[-1]),
            str(stats["return_status"]),
            float(course[-1]) <= CONSTRAINT_TOLERANCE,
        )
