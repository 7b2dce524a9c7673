"""Multiple shooting: each experiment cut into segments whose initial states are free and must join.

A plant that diverges over a whole recording does not over a short segment of it, so the search sees useful residuals
from the first iteration on. Source: Bock, Springer Ser. Chem. Phys. 18 (1981) 102.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.common.interrupt import without_checkpoints
from tsmblocks.common.rounding import to_digits
from tsmblocks.engine.kernel import Memory
from tsmblocks.engine.plan import Layout
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.inner_products import products, square
from tsmblocks.fitting.ipopt import Point, Program, constraint_curvature, sizes, solve
from tsmblocks.fitting.optimizer import OptimizerResult, ProgressCallback, no_progress
from tsmblocks.fitting.residuals import Problem
from tsmblocks.simulation.lanes import MOST_DIRECTIONS, directions

FAR = 10.0
"""Multiples of the measured range beyond which a first guess has diverged. Chosen."""
JOINED = 1e-6
"""Largest jump of a state between segments, relative to its size, that counts as none. Chosen."""


@attrs.frozen(eq=False)
class Segment:
    """Steps ``first`` to ``last`` of an experiment; ``states`` are the places of its initial states in the variables.

    None for the first segment of an experiment, which starts where the diagram does.
    """

    experiment: int
    first: int
    last: int
    states: np.ndarray


@attrs.frozen(eq=False)
class SegmentRun:
    """A segment simulated: outputs and final states, and their derivatives."""

    outputs: np.ndarray  # (samples, outputs)
    derivatives: np.ndarray  # (samples, outputs, directions)
    end: np.ndarray  # (states,)
    end_derivatives: np.ndarray  # (states, directions)


def multiple_shooting(
    problem: Problem,
    start: np.ndarray,
    segments: int,
    *,
    iterations: int = 200,
    progress: ProgressCallback = no_progress,
) -> OptimizerResult:
    """Search with IPOPT, every experiment cut into ``segments`` pieces.

    Raises RunError for diagrams with transport delays, whose past does not fit into an initial state, and
    when the pieces cannot be joined.
    """
    pieces = _Segments(problem, cut(problem, segments), constraint_curvature(problem))
    begin = pieces.first_guess(start)
    first, states, n = pieces.point(begin), pieces.state_sizes(begin), len(start)
    free = np.full(len(states), np.inf)
    program = Program(
        pieces.point,
        pieces.curvature,
        np.concatenate([problem.unknowns.low, -free]),
        np.concatenate([problem.unknowns.high, free]),
        np.concatenate([problem.constraints.equal, np.ones(len(states), dtype=bool)]),
        np.concatenate([sizes(first.matrix[:n, :n], start), states]),
        problem.samples,
    )
    ended = solve(program, begin, first, iterations=iterations, progress=progress)
    theta, unfinished = ended.z[:n], ended.status in ("interrupted", "limit")
    with without_checkpoints():
        gap = float(np.abs(pieces.point(ended.z).values[len(problem.constraints.names) :] / states).max(initial=0.0))
        if unfinished:  # the pieces may not join yet; what counts is the whole
            theta = min((ended.last[:n], theta, start), key=problem.cost)
        cost = problem.cost(theta)
    if gap > JOINED and not unfinished:
        why = f"a state still jumps by {to_digits(gap)} of its size" if gap < 1e3 else "the states diverged"
        raise RunError(
            f"multiple shooting could not join its {segments} pieces ({ended.word}): {why}. Try more "
            "segments, another start, tighter bounds, or fewer free parameters: of two with the same effect, one must "
            "be fixed."
        )
    return OptimizerResult(theta, cost, ended.status, ended.iterations, ended.evaluations, ended.history)


def cut(problem: Problem, segments: int) -> list[Segment]:
    """Segments of about equal length of every experiment, cut at samples. Raises RunError for delays."""
    made, place = list[Segment](), len(problem.unknowns.items)
    for e, experiment in enumerate(problem.experiments):
        eq, times = experiment.eq, experiment.times
        if eq.q:
            raise RunError(
                f"multiple shooting does not support transport delays ({eq.q[0]}): the content of a delay cannot be an "
                "initial state. Use one segment."
            )
        samples = times.steps // times.every
        most = max(1, min(segments, samples))
        ends = [round(k * samples / most) * times.every for k in range(most)] + [times.steps]
        for k, (first, last) in enumerate(itertools.pairwise(ends)):
            states = place + np.arange(len(eq.x) + len(eq.d) if k else 0)
            made.append(Segment(e, first, last, states))
            place += len(states)
    return made


@attrs.frozen(eq=False)
class _Segments:
    """A problem in segments. Its variables: the unknowns, then the initial states of all segments but the first."""

    problem: Problem
    segments: list[Segment]
    constraint_curvature: Callable[[np.ndarray, np.ndarray], np.ndarray]

    def point(self, z: np.ndarray) -> Point:
        problem, n, total = self.problem, len(self.problem.unknowns.items), len(z)
        theta, squares = z[:n], 0.0
        gradient, matrix = np.zeros(total), np.zeros((total, total))
        values = [problem.constraints.values(theta)]
        jacobians = [np.pad(problem.constraints.jacobian(theta), ((0, 0), (0, total - n)))]
        for segment, after in itertools.zip_longest(self.segments, self.segments[1:]):
            columns, run = self._columns(segment), self.run(segment, z)
            r, J = self._residuals(segment, run)
            squares += square(r)
            part, whole = products(J, r)
            gradient[columns] += part
            matrix[np.ix_(columns, columns)] += whole
            if after is not None and len(after.states):
                joint = np.zeros((len(run.end), total))
                joint[:, columns] = run.end_derivatives
                joint[:, after.states] -= np.eye(len(run.end))
                values.append(run.end - z[after.states])
                jacobians.append(joint)
        slope, curvature = problem.prior_derivatives(theta)
        gradient[:n] += slope
        matrix[:n, :n] += np.diag(curvature)
        cost = 0.5 * squares + problem.prior_cost(theta)
        cost = cost if np.isfinite(cost) else np.inf
        return Point(cost, gradient, matrix, np.concatenate(values), np.vstack(jacobians))

    def curvature(self, z: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """That of the constraints on the unknowns; the joints are taken as straight (Gauss-Newton)."""
        n, m = len(self.problem.unknowns.items), len(self.problem.constraints.names)
        return np.pad(self.constraint_curvature(z[:n], multipliers[:m]), (0, len(z) - n))

    def _columns(self, segment: Segment) -> np.ndarray:
        """Variables a segment depends on: unknowns, then its own initial states."""
        return np.concatenate([self.problem.unknowns.columns(segment.experiment), segment.states])

    def _residuals(self, segment: Segment, run: SegmentRun) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residuals of a segment (samples x outputs,) and their Jacobian."""
        experiment, weights = self.problem.experiments[segment.experiment], self.problem.weights
        samples = experiment.samples_within(segment.first, segment.last)
        r, J = (run.outputs - experiment.measured[samples]) * weights, run.derivatives * weights[None, :, None]
        if experiment.counted is not None:
            r, J = r * experiment.counted[samples], J * experiment.counted[samples][:, :, None]
        return r.ravel(), J.reshape(-1, J.shape[2])

    def run(self, segment: Segment, z: np.ndarray) -> SegmentRun:
        """Simulate a segment with derivatives, the directions side by side in lanes."""
        unknowns, e, n = self.problem.unknowns, segment.experiment, len(segment.states)
        experiment, p = self.problem.experiments[e], unknowns.parameters(z[: len(unknowns.items)], e)
        seeds = np.pad(unknowns.jacobian(p, e), ((0, 0), (0, n)))
        width = seeds.shape[1]
        state_seeds = np.eye(n, width, width - n)
        parts = [
            _run_lanes(experiment, segment, p, seeds[:, part], z[segment.states], state_seeds[:, part])
            for part in (slice(k, k + MOST_DIRECTIONS) for k in range(0, max(width, 1), MOST_DIRECTIONS))
        ]
        return SegmentRun(
            parts[0].outputs,
            np.concatenate([q.derivatives for q in parts], axis=2),
            parts[0].end,
            np.concatenate([q.end_derivatives for q in parts], axis=1),
        )

    def first_guess(self, theta: np.ndarray) -> np.ndarray:
        """Initial states by simulation from segment to segment; where that diverges, the last finite state is kept."""
        z = np.concatenate([theta, np.zeros(sum(len(segment.states) for segment in self.segments))])
        for segment, after in itertools.pairwise(self.segments):
            if not len(after.states):
                continue
            run, measured = self.run(segment, z), self.problem.experiments[segment.experiment].measured
            middle, extent = measured.mean(axis=0), np.ptp(measured, axis=0)
            if (
                np.isfinite(run.end).all()
                and np.isfinite(run.outputs).all()
                and (np.abs(run.outputs - middle) <= FAR * extent + 1e-300).all()
            ):
                z[after.states] = run.end
            else:
                z[after.states] = z[segment.states] if len(segment.states) else self._initial_states(segment, theta)
        return z

    def _initial_states(self, segment: Segment, theta: np.ndarray) -> np.ndarray:
        """Initial states of the diagram."""
        eq = self.problem.experiments[segment.experiment].eq
        x, d, _ = eq.start(self.problem.unknowns.parameters(theta, segment.experiment))
        return np.concatenate([np.asarray(x).ravel(), np.asarray(d).ravel()])

    def state_sizes(self, z: np.ndarray) -> np.ndarray:
        """Scale of each initial state: its largest magnitude in the segments of an experiment."""
        made = [np.empty(0)]
        for e in range(len(self.problem.experiments)):
            starts = [z[s.states] for s in self.segments if s.experiment == e and len(s.states)]
            if starts:
                made += [np.maximum(np.abs(starts).max(axis=0), 1e-3)] * len(starts)
        return np.concatenate(made)


def _run_lanes(
    experiment: Experiment,
    segment: Segment,
    p: np.ndarray,
    seeds: np.ndarray,
    state: np.ndarray,
    state_seeds: np.ndarray,
) -> SegmentRun:
    """Simulate a segment with one direction per lane, from initial states unless it is the first."""
    width, n = seeds.shape[1], len(experiment.eq.x)
    lanes = directions(width)
    kernel, memory = experiment.tangents(p, seeds, lanes)
    if len(state):
        seed = np.pad(state_seeds, ((0, 0), (0, lanes - width)))
        x, d = kernel.layout_x.spread([*state[:n], *seed[:n]]), kernel.layout_d.spread([*state[n:], *seed[n:]])
        memory = Memory(x, d, memory.p, memory.ring, memory.mask, memory.loops)
    y = experiment.run(kernel, memory, segment.first, segment.last)
    outputs, derivatives = experiment.split(kernel, y, width)
    ends = _values(memory.x, kernel.layout_x, lanes), _values(memory.d, kernel.layout_d, lanes)
    end, end_derivatives = (np.concatenate(both) for both in zip(*ends, strict=True))
    return SegmentRun(outputs, np.stack(derivatives, axis=1), end, end_derivatives[:, :width])


def _values(flat: np.ndarray, layout: Layout, lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (states,) and derivatives (states, lanes) of a vector that holds first the ones, then the others."""
    n = len(layout.wide) // 2
    derivatives = [np.broadcast_to(flat[layout.span(n + k)], (lanes,)) for k in range(n)]
    return flat[list(layout.offset[:n])], np.array(derivatives).reshape(n, lanes)
