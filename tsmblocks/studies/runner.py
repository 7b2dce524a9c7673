"""Runs of a study: in lanes and threads of this process, or in pieces on any executor. Results come as runs end."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from functools import partial
from pickle import PicklingError
from time import monotonic
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import is_number
from tsmblocks.common.errors import ParameterError, RunError, TsmError, in_words
from tsmblocks.metrics.metrics import Metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import RunOptions
from tsmblocks.simulation.batch import PreparedBatch, batch_of
from tsmblocks.simulation.compiled import equations
from tsmblocks.simulation.lanes import lanes_for
from tsmblocks.simulation.stability import MOST_CHECKED, RunStart, extreme_sets, set_text
from tsmblocks.studies.plans import plain

BATCHES_PER_THREAD = 4
"""Groups of lanes that every thread runs in one piece of work of this process. Chosen: threads end nearly together, and
results are written often enough."""
LANE_GROUPS_PER_PIECE = 8
"""Groups of lanes in one piece of work of an executor. Chosen: it takes far longer than its transfer to a worker."""
MAX_SUBMITTED = 256
"""Pieces that an executor is given ahead. Chosen: workers never wait, and memory stays bounded."""
UNPICKLED = ("pickle", "local object")
"""Texts of an AttributeError or a TypeError for a value that cannot be pickled. Source: Python 3.11 to 3.13."""
MAX_ATTEMPTS = 3
"""Times that a piece is run before its error counts. Chosen: a cluster may lose one with the machine that had it."""
OVERDUE_RATIO = 4.0
"""Time after which a piece is submitted again, as a multiple of that of the slowest piece so far. Chosen."""
MIN_OVERDUE_TIME = 10.0
"""The same, at least [s]. Chosen: short pieces may wait longer than they run."""

PieceResult = tuple[np.ndarray, dict[str, np.ndarray]]
"""Numbers of runs, and their metrics, each of that shape."""


@attrs.frozen(eq=False)
class Runs:
    """Runs that differ in parameters alone: a diagram, the numbers of the ``runs``, and their ``sets`` of parameters.

    ``lanes`` of them go side by side, however the work is divided: so their results agree to the last digit.
    """

    diagram: Diagram
    runs: np.ndarray
    sets: Mapping[str, np.ndarray]
    options: RunOptions
    lanes: int

    def part(self, chosen: np.ndarray | slice) -> Runs:
        """Some of them, by position or by a mask."""
        return attrs.evolve(self, runs=self.runs[chosen], sets={k: v[chosen] for k, v in self.sets.items()})

    def batch(self, signals: Sequence[str]) -> PreparedBatch:
        """The batch of these runs, with some of their signals."""
        return batch_of(self.diagram, self.sets, self.options, signals, self.lanes)

    def prepared(self, metrics: Sequence[Metric]) -> PreparedBatch:
        """The batch of these runs, with the signals that the metrics need."""
        return self.batch(list(dict.fromkeys(name for one in metrics for name in one.signals)))


Piece = tuple[Runs, tuple[Metric, ...]]
"""Work of an executor at a time: runs, and the metrics of them."""


def grouped(diagram: Diagram, columns: Mapping[str, np.ndarray], options: RunOptions) -> list[Runs]:
    """Groups of runs whose equations are the same; they differ in options, which shape the equations.

    Raises ParameterError for an unknown name or a value that its block refuses.
    """
    side_by_side = _lane_parameters(diagram, columns)
    shaping = [name for name in columns if name not in side_by_side]
    members: dict[tuple[Any, ...], list[int]] = {}
    for run in range(len(next(iter(columns.values())))):
        members.setdefault(tuple(plain(columns[name][run]) for name in shaping), []).append(run)
    made = []
    for values, runs in members.items():
        own = diagram.with_parameters(dict(zip(shaping, values, strict=True))) if shaping else diagram
        at = np.array(runs)
        sets = {k: columns[k][at] for k in side_by_side} or _unchanged_parameter(own, len(at))
        lanes = lanes_for(len(at), len(equations(own.untied(sets)).x))
        made.append(Runs(own, at, sets, options, lanes))
    return made


def _lane_parameters(diagram: Diagram, columns: Mapping[str, np.ndarray]) -> list[str]:
    """Names of parameters that are symbols of the equations."""
    loose = diagram.untied(columns)  # a parameter that follows a shared value may be varied alone
    known = [name for name in columns if name in loose.parameters]
    for name in known:
        if columns[name].dtype.kind != "f":
            other = next(value for value in columns[name] if not is_number(value))
            raise ParameterError(f"'{name}' is a number, and the plan gives it {in_words(other)}.")
    free = equations(loose).p
    return [name for name in known if name in free]


def _unchanged_parameter(diagram: Diagram, count: int) -> dict[str, np.ndarray]:
    """A parameter at its own value, for runs that differ in options alone: a batch needs one that varies."""
    free = [name for name in diagram.parameters if name in equations(diagram).p]
    if not free:
        raise ParameterError(f"'{diagram.title}' has no parameter, so its runs cannot be studied side by side.")
    return {free[0]: np.full(count, diagram.parameters[free[0]])}


def run_in_process(
    groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray, threads: int | None
) -> Generator[PieceResult, None, None]:
    """Run the missing runs in this process, in as many threads as there are processors unless given."""
    busy = threads or os.cpu_count() or 1
    for group in _missing(groups, missing):
        batch, size = group.prepared(metrics), group.lanes * busy * BATCHES_PER_THREAD
        for first in range(0, batch.count, size):
            last = min(first + size, batch.count)
            yield group.runs[first:last], batch.results(first, last, partial(_values, metrics), busy)


def run_on_executor(
    groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray, executor: Executor
) -> Generator[PieceResult, None, None]:
    """Run the missing runs on an executor, piece by piece, in the order in which they end."""
    out = _Submitted(executor)
    try:
        for number, piece in enumerate(_pieces(groups, metrics, missing)):
            out.submit(number, piece, 1)
            while len(out.waiting) >= MAX_SUBMITTED:
                yield from out.finished()
        while out.waiting:
            yield from out.finished()
    finally:
        for one in out.waiting:
            one.cancel()


def _pieces(groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray) -> Iterator[Piece]:
    for group in _missing(groups, missing):
        size = LANE_GROUPS_PER_PIECE * group.lanes
        for first in range(0, len(group.runs), size):
            yield group.part(slice(first, first + size)), tuple(metrics)


def _missing(groups: Sequence[Runs], missing: np.ndarray) -> list[Runs]:
    """Those runs of each group that have no results yet."""
    parts = (group.part(missing[group.runs]) for group in groups)
    return [part for part in parts if len(part.runs)]


@attrs.frozen
class _Attempt:
    """A piece that an executor has: its number, how often it was submitted so far, and when [s]."""

    number: int
    piece: Piece
    attempt: int
    since: float


@attrs.define
class _Submitted:
    """Pieces that were submitted to an executor and have not ended yet.

    An executor may lose a piece without an error: Dask's does when a machine dies with a result that was not fetched.
    So a piece that takes far longer than any other has is submitted again, up to the largest number of attempts;
    whichever copy ends first counts.
    """

    executor: Executor
    waiting: dict[Future[PieceResult], _Attempt] = attrs.field(factory=dict)
    longest: float = 0.0

    def submit(self, number: int, piece: Piece, attempt: int) -> None:
        """Submit a piece, for the first time or again."""
        self.waiting[self.executor.submit(run_piece, *piece, attempt)] = _Attempt(number, piece, attempt, monotonic())

    def finished(self) -> Iterator[PieceResult]:
        """Results of the pieces that have ended; those that were lost or are overdue are submitted again."""
        patience = max(MIN_OVERDUE_TIME, OVERDUE_RATIO * self.longest)
        done, _ = wait(self.waiting, timeout=patience if self.longest else None, return_when=FIRST_COMPLETED)
        for one in done:
            if one not in self.waiting:
                continue  # another copy has ended since
            copy = self.waiting.pop(one)
            try:
                found = one.result()
            except (TsmError, BrokenExecutor):
                raise
            except Exception as error:
                self._retry(copy, error)
                continue
            self.longest = max(self.longest, monotonic() - copy.since)
            for other in self._copies(copy.number):
                other.cancel()
                del self.waiting[other]
            yield found
        latest = {copy.number: copy for copy in self.waiting.values()}  # the last copy of each, in the order given
        for copy in latest.values():
            if self.longest and copy.attempt < MAX_ATTEMPTS and monotonic() - copy.since > patience:
                self.submit(copy.number, copy.piece, copy.attempt + 1)

    def _copies(self, number: int) -> list[Future[PieceResult]]:
        """What the executor still has of a piece."""
        return [future for future, copy in self.waiting.items() if copy.number == number]

    def _retry(self, copy: _Attempt, error: Exception) -> None:
        if isinstance(error, PicklingError) or (
            isinstance(error, (AttributeError, TypeError)) and any(sign in str(error) for sign in UNPICKLED)
        ):
            raise RunError(
                f"work for another process must be pickled, and this cannot be: {error}. Give inputs as "
                "samples, and define blocks of your own in a module."
            ) from None
        if self._copies(copy.number):
            return
        if copy.attempt >= MAX_ATTEMPTS:
            raise error
        self.submit(copy.number, copy.piece, copy.attempt + 1)


def run_piece(runs: Runs, metrics: tuple[Metric, ...], _attempt: int) -> PieceResult:
    """One piece of work, in whichever process: run, and reduce to metrics.

    The number of the attempt makes copies differ: an executor that identifies work by its arguments would return the
    one that it lost.
    """
    batch = runs.prepared(metrics)
    return runs.runs, batch.results(0, batch.count, partial(_values, metrics), 1)


def _values(metrics: Sequence[Metric], t: np.ndarray, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of the metrics, by name, for runs side by side."""
    return {one.name: one(t, signals) for one in metrics}


def checked_batches(groups: Sequence[Runs], metrics: Sequence[Metric]) -> list[PreparedBatch]:
    """The groups' batches. Raises the errors of a run: sets that a block refuses, metrics without an instant."""
    batches = [group.prepared(metrics) for group in groups]
    for batch in batches:
        for one in metrics:
            one(batch.t, {name: np.zeros(len(batch.t)) for name in one.signals})
    return batches


def run_starts(
    groups: Sequence[Runs], batches: Sequence[PreparedBatch], columns: Mapping[str, np.ndarray]
) -> list[RunStart]:
    """Initial points of a few runs: those at the ends of what varies, and the first of each group."""
    chosen = dict.fromkeys([*extreme_sets(columns), *(int(group.runs[0]) for group in groups)])
    made = []
    for run in list(chosen)[:MOST_CHECKED]:
        k, at = next((k, at[0]) for k, one in enumerate(groups) if len(at := np.flatnonzero(one.runs == run)))
        made.append(attrs.evolve(batches[k].run_start(int(at)), label=_label(columns, run)))
    return made


def set_labels(groups: Sequence[Runs], columns: Mapping[str, np.ndarray]) -> Callable[[int, int], str]:
    """A function that names a set by the positions of its group and of the set in it."""
    return lambda group, k: _label(columns, int(groups[group].runs[k]))


def _label(columns: Mapping[str, np.ndarray], run: int) -> str:
    return set_text({name: plain(values[run]) for name, values in columns.items()})
