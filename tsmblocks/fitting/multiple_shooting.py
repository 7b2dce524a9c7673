"""Multiple shooting: each experiment cut into segments whose start states are free and must join.

A plant that diverges over a whole recording does not over a short piece of it, so the search sees
useful residuals from the first iteration on. Source: Bock, Springer Ser. Chem. Phys. 18 (1981) 102.
"""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.plan import Layout
from tsmblocks.engine.sensitivities import tangent_memory
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.inner_products import products, square
from tsmblocks.fitting.ipopt import Box, Point, solve
from tsmblocks.fitting.optimizer import OptimizerResult, ProgressCallback
from tsmblocks.fitting.residuals import Problem
from tsmblocks.fitting.single_shooting import bending, sizes
from tsmblocks.simulation.lanes import MOST_DIRECTIONS, directions, tangent_kernel

FAR = 10.0
"""Multiples of the measured range beyond which a first guess has diverged. Chosen."""


@attrs.frozen(eq=False)
class Segment:
    """A piece of an experiment: steps ``first`` to ``last``; its start states are variables from ``place`` on.

    ``place`` is negative for the first piece, which starts where the diagram does.
    """

    experiment: int
    first: int
    last: int
    place: int


@attrs.frozen(eq=False)
class Ran:
    """A segment simulated: outputs, and what they and the end states feel of the directions."""

    outputs: np.ndarray  # (samples, outputs)
    slopes: np.ndarray  # (samples, outputs, directions)
    end: np.ndarray  # (states,)
    end_slopes: np.ndarray  # (states, directions)


def multiple_shooting(
    problem: Problem, start: np.ndarray, segments: int, *, iterations: int = 200, tell: ProgressCallback | None = None
) -> OptimizerResult:
    """Search with IPOPT, every experiment cut into ``segments`` pieces.

    Raises RunError for diagrams with transport delays, whose past does not fit into a start state, and
    when the pieces cannot be joined.
    """
    target = _Pieces(problem, cut(problem, segments), bending(problem))
    begin = target.first_guess(start)
    point = target.point(begin)
    states = target.state_sizes(begin)
    n = len(start)
    size = np.concatenate([sizes(point.matrix[:n, :n], start), states])
    free = np.full(len(begin) - n, np.inf)
    box = Box(
        np.concatenate([problem.unknowns.low, -free]),
        np.concatenate([problem.unknowns.high, free]),
        np.concatenate([problem.constraints.equal, np.ones(len(free), dtype=bool)]),
        size,
    )
    scale = max(problem.samples, 1) / max(2 * point.cost, 1e-300)
    ended = solve(target, begin, box, scale=scale, iterations=iterations, tell=tell)
    theta = ended.z[:n]
    gap = float(np.abs(target.point(ended.z).values[len(problem.constraints.names) :] / states).max(initial=0.0))
    if ended.status in ("interrupted", "limit"):  # the pieces may not join yet; what counts is the whole
        theta = min((ended.last[:n], theta, start), key=problem.cost)
    elif gap > 1e-6:
        why = f"a state still jumps by {gap:.2g} of its size" if gap < 1e3 else "the states ran away"
        raise RunError(
            f"multiple shooting could not join its {segments} pieces ({ended.word}): {why}. Try more "
            "segments, another start, tighter bounds, or fewer free parameters: of two that do the same, "
            "one must be held."
        )
    return OptimizerResult(theta, problem.cost(theta), ended.status, ended.iterations, ended.evaluations, ended.history)


def cut(problem: Problem, segments: int) -> list[Segment]:
    """Pieces of about equal length of every experiment, cut at samples. Raises RunError for delays."""
    made, place = list[Segment](), len(problem.unknowns.items)
    for e, trial in enumerate(problem.experiments):
        if trial.eq.q:
            raise RunError(
                f"multiple shooting does not go with transport delays ({trial.eq.q[0]}): what lies in a "
                "delay cannot be a start state. Use one segment."
            )
        every, states = trial.times.every, len(trial.eq.x) + len(trial.eq.d)
        most = max(1, min(segments, trial.times.steps // every))
        ends = [round(k * (trial.times.steps // every) / most) * every for k in range(most)] + [trial.times.steps]
        for k in range(most):
            made.append(Segment(e, ends[k], ends[k + 1], place if k else -1))
            place += states if k else 0
    return made


@attrs.frozen(eq=False)
class _Pieces:
    """A problem in pieces, as IPOPT sees it: the unknowns, then the start states of all later pieces."""

    problem: Problem
    pieces: list[Segment]
    bend: Any  # (unknowns, forces) -> second derivatives of the constraints

    def point(self, z: np.ndarray) -> Point:
        n, problem, total = len(self.problem.unknowns.items), self.problem, len(z)
        theta, squares = z[:n], 0.0
        gradient, matrix = np.zeros(total), np.zeros((total, total))
        joints, bends = (
            [problem.constraints.values(theta)],
            [np.pad(problem.constraints.slopes(theta), ((0, 0), (0, total - n)))],
        )
        for piece, after in zip(self.pieces, [*self.pieces[1:], None], strict=True):
            columns, ran = self._columns(piece), self.run(piece, z)
            off, slopes = self._differences(piece, ran)
            squares += square(off)
            part, whole = products(slopes, off)
            gradient[columns] += part
            matrix[np.ix_(columns, columns)] += whole
            if after is not None and after.place >= 0:
                begin = after.place + np.arange(len(ran.end))
                joint = np.zeros((len(ran.end), total))
                joint[:, columns] = ran.end_slopes
                joint[:, begin] -= np.eye(len(ran.end))
                joints.append(ran.end - z[begin])
                bends.append(joint)
        self._add_priors(theta, gradient, matrix)
        cost = 0.5 * squares + problem.prior_cost(theta)
        cost = cost if np.isfinite(cost) else np.inf
        return Point(cost, gradient, matrix, np.concatenate(joints), np.vstack(bends))

    def _add_priors(self, theta: np.ndarray, gradient: np.ndarray, matrix: np.ndarray) -> None:
        slope, curve = self.problem.prior_slopes(theta)
        n = len(theta)
        gradient[:n] += slope
        matrix[:n, :n] += np.diag(curve)

    def curve(self, z: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Only the constraints on the unknowns bend; the joints are taken as straight (Gauss-Newton)."""
        n, m = len(self.problem.unknowns.items), len(self.problem.constraints.names)
        made = np.zeros((len(z), len(z)))
        made[:n, :n] = np.asarray(self.bend(z[:n], forces[:m]))
        return made

    def _columns(self, piece: Segment) -> np.ndarray:
        """Variables a piece depends on: unknowns, then its own start states."""
        own = self.problem.unknowns.columns(piece.experiment)
        if piece.place < 0:
            return own
        eq = self.problem.experiments[piece.experiment].eq
        return np.concatenate([own, piece.place + np.arange(len(eq.x) + len(eq.d))])

    def _differences(self, piece: Segment, ran: Ran) -> tuple[np.ndarray, np.ndarray]:
        """Weighted differences of a piece (samples x outputs,) and their derivatives, in one column each."""
        trial, weights = self.problem.experiments[piece.experiment], self.problem.weights
        rows = samples_of(trial, piece)
        off = (ran.outputs - trial.measured[rows]) * weights
        slopes = ran.slopes * weights[None, :, None]
        return off.ravel(), slopes.reshape(-1, slopes.shape[2])

    def run(self, piece: Segment, z: np.ndarray) -> Ran:
        """Simulate a piece with derivatives, the directions side by side in lanes."""
        unknowns, e = self.problem.unknowns, piece.experiment
        trial, p = self.problem.experiments[e], unknowns.parameters(z[: len(unknowns.items)], e)
        slopes, states = unknowns.slopes(p, e), len(trial.eq.x) + len(trial.eq.d)
        own = slopes.shape[1]
        width = own + (states if piece.place >= 0 else 0)
        seed_p, seed_x = np.zeros((len(p), width)), np.zeros((states, width))
        seed_p[:, :own] = slopes
        seed_x[:, own:] = np.eye(states, width - own)
        state = z[piece.place : piece.place + states] if piece.place >= 0 else None
        parts = [
            _run_lanes(trial, piece, p, seed_p[:, k : k + MOST_DIRECTIONS], state, seed_x[:, k : k + MOST_DIRECTIONS])
            for k in range(0, max(width, 1), MOST_DIRECTIONS)
        ]
        return Ran(
            parts[0].outputs,
            np.concatenate([q.slopes for q in parts], axis=2),
            parts[0].end,
            np.concatenate([q.end_slopes for q in parts], axis=1),
        )

    def first_guess(self, theta: np.ndarray) -> np.ndarray:
        """Initial states by simulation from piece to piece; where that diverges, the last finite state is kept."""
        eqs = [self.problem.experiments[piece.experiment].eq for piece in self.pieces]
        total = sum(len(eq.x) + len(eq.d) for eq, piece in zip(eqs, self.pieces, strict=True) if piece.place >= 0)
        z = np.concatenate([theta, np.zeros(total)])
        for piece, after in zip(self.pieces, [*self.pieces[1:], None], strict=True):
            if after is None or after.place < 0:
                continue
            ran, trial = self.run(piece, z), self.problem.experiments[piece.experiment]
            middle, range_ = trial.measured.mean(axis=0), np.ptp(trial.measured, axis=0)
            near = np.isfinite(ran.end).all() and np.isfinite(ran.outputs).all()
            near = bool(near and (np.abs(ran.outputs - middle) <= FAR * range_ + 1e-300).all())
            kept = z[piece.place : piece.place + len(ran.end)] if piece.place >= 0 else self._at_rest(piece, theta)
            z[after.place : after.place + len(ran.end)] = ran.end if near else kept
        return z

    def _at_rest(self, piece: Segment, theta: np.ndarray) -> np.ndarray:
        """Initial states of the diagram."""
        trial = self.problem.experiments[piece.experiment]
        x, d, _ = trial.eq.start(self.problem.unknowns.parameters(theta, piece.experiment))
        return np.concatenate([np.asarray(x).ravel(), np.asarray(d).ravel()])

    def state_sizes(self, z: np.ndarray) -> np.ndarray:
        """A sensible change of each start state: how much that state differs between the pieces."""
        made: list[np.ndarray] = []
        for e in range(len(self.problem.experiments)):
            starts = [
                z[q.place : q.place + len(self._columns(q)) - len(self.problem.unknowns.columns(e))]
                for q in self.pieces
                if q.experiment == e and q.place >= 0
            ]
            if starts:
                size = np.maximum(np.abs(np.array(starts)).max(axis=0), 1e-3)
                made += [size] * len(starts)
        return np.concatenate(made) if made else np.empty(0)


def samples_of(trial: Experiment, piece: Segment) -> slice:
    """Which samples of the experiment lie in a piece; a sample at a joint belongs to the later piece."""
    instants = trial.place * (trial.times.every if trial.share is None else 1)
    last = len(instants) if piece.last == trial.times.steps else int(np.searchsorted(instants, piece.last))
    return slice(int(np.searchsorted(instants, piece.first)), last)


def _run_lanes(
    trial: Experiment, piece: Segment, p: np.ndarray, seed_p: np.ndarray, state: np.ndarray | None, seed_x: np.ndarray
) -> Ran:
    """Simulate a piece with one direction per lane."""
    width = seed_p.shape[1]
    lanes = directions(width)
    room = ((0, 0), (0, lanes - width))
    kernel = tangent_kernel(trial.eq, trial.rule, trial.columns, lanes, trial.backend)
    memory = tangent_memory(trial.eq, kernel, p, np.pad(seed_p, room), trial.times.h)
    if state is not None:
        n, seed = len(trial.eq.x), np.pad(seed_x, room)
        x, d = kernel.layout_x.spread([*state[:n], *seed[:n]]), kernel.layout_d.spread([*state[n:], *seed[n:]])
        memory = Memory(x, d, memory.p, memory.ring, memory.mask)
    y = _rows(trial, piece, kernel, memory)
    count = len(trial.columns)
    values = np.stack([y[:, kernel.layout_y.offset[k]] for k in range(count)], axis=1)
    spans = [y[:, kernel.layout_y.span(count + k)] for k in range(count)]
    slopes = np.stack([np.broadcast_to(v, (len(y), lanes)) for v in spans], axis=1)
    end, end_slopes = _ends(memory.x, kernel.layout_x, lanes), _ends(memory.d, kernel.layout_d, lanes)
    return Ran(
        values,
        slopes[:, :, :width],
        np.concatenate([end[0], end_slopes[0]]),
        np.concatenate([end[1], end_slopes[1]])[:, :width],
    )


def _ends(flat: np.ndarray, layout: Layout, lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (states,) and derivatives (states, lanes) of a vector that holds first the ones, then the others."""
    n = len(layout.wide) // 2
    slopes = [np.broadcast_to(flat[layout.span(n + k)], (lanes,)) for k in range(n)]
    return np.array([flat[layout.offset[k]] for k in range(n)]), np.array(slopes).reshape(n, lanes)


def _rows(trial: Experiment, piece: Segment, kernel: Kernel, memory: Memory) -> np.ndarray:
    """Rows at the samples of a piece; ``memory`` is at its end afterwards."""
    times, even = trial.times, trial.share is None
    steps, every = piece.last - piece.first, times.every if even else 1
    final = piece.last == times.steps or not even
    y = np.empty(((steps + every - 1) // every + (1 if final and steps % every == 0 else 0), kernel.layout_y.size))
    rows = trial.rows[piece.first : piece.last + 1]
    kernel.advance(memory, rows, y, Steps(times.start, times.h, piece.first, steps, final, trial.hits, every))
    part = samples_of(trial, piece)
    if trial.share is None:
        picked: np.ndarray = y[trial.place[part] - piece.first // every]
        return picked
    at, share = trial.place[part] - piece.first, trial.share[part][:, None]
    between: np.ndarray = (1 - share) * y[at] + share * y[at + 1]
    return between
