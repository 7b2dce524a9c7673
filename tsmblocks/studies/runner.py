"""Runs of a study: in lanes and threads of this process, or in pieces on any executor. Results come as they end."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from pickle import PicklingError
from time import monotonic
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import is_number
from tsmblocks.common.errors import ParameterError, RunError, TsmError, in_words
from tsmblocks.metrics.metrics import Metric
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.batch import PreparedBatch, batch_of
from tsmblocks.simulation.compiled import equations
from tsmblocks.simulation.lanes import lanes_for
from tsmblocks.simulation.run_options import RunOptions
from tsmblocks.simulation.stability import MOST_CHECKED, RunStart, extreme_sets, set_text
from tsmblocks.studies.plans import plain

TURNS = 4
"""Times that every thread is busy, in one piece of work of this process."""
PIECE = 8
"""Groups of lanes in one piece of work of an executor."""
WAITING = 256
"""Pieces that an executor is given ahead."""

TRIES = 3
"""Times that a piece is run before its error counts: a cluster may lose one with the machine that had it."""
OVERDUE, PATIENCE = 4.0, 10.0
"""A piece waited for this many times as long as the slowest yet, and at least so many seconds, is given again."""

Found = tuple[np.ndarray, dict[str, np.ndarray]]
"""Numbers of runs, and their metrics, each of that shape."""


@attrs.frozen(eq=False)
class Runs:
    """Runs that differ in numbers alone: a diagram, which ``runs`` they are, and their ``sets`` of parameters.

    ``lanes`` of them go side by side, however the work is cut: so their results agree to the last digit.
    """

    diagram: Diagram
    runs: np.ndarray
    sets: Mapping[str, np.ndarray]
    options: RunOptions
    lanes: int

    def part(self, chosen: np.ndarray) -> Runs:
        """Some of them, by position."""
        return attrs.evolve(self, runs=self.runs[chosen], sets={k: v[chosen] for k, v in self.sets.items()})

    def batch(self, signals: Sequence[str]) -> PreparedBatch:
        """The batch of these runs, with some of their signals."""
        return batch_of(self.diagram, self.sets, self.options, signals, self.lanes)

    def prepared(self, metrics: Sequence[Metric]) -> PreparedBatch:
        """The batch of these runs, with the signals that the metrics need."""
        return self.batch(list(dict.fromkeys(name for one in metrics for name in one.signals)))


Piece = tuple[Runs, tuple[Metric, ...]]
"""What an executor is given at a time: runs, and what is measured."""


def grouped(diagram: Diagram, columns: Mapping[str, np.ndarray], options: RunOptions) -> list[Runs]:
    """Runs whose equations are the same, together. What shapes the equations (an option) tells groups apart.

    Raises ParameterError for an unknown name or a value that its block refuses.
    """
    side_by_side = _in_lanes(diagram, columns)
    shaping = [name for name in columns if name not in side_by_side]
    members: dict[tuple[Any, ...], list[int]] = {}
    for run in range(len(next(iter(columns.values())))):
        members.setdefault(tuple(plain(columns[name][run]) for name in shaping), []).append(run)
    made = []
    for values, runs in members.items():
        own = diagram.with_parameters(dict(zip(shaping, values, strict=True))) if shaping else diagram
        at = np.array(runs)
        sets = {k: columns[k][at] for k in side_by_side} or _something(own, len(at))
        lanes = lanes_for(len(at), len(equations(own.untied(sets)).x))
        made.append(Runs(own, at, sets, options, lanes))
    return made


def _in_lanes(diagram: Diagram, columns: Mapping[str, np.ndarray]) -> list[str]:
    """Names of numbers that stand in the equations as such."""
    loose = diagram.untied(columns)  # a number that follows a shared one may go its own way
    known = [name for name in columns if name in loose.parameters]
    for name in known:
        if columns[name].dtype.kind != "f":
            other = next(value for value in columns[name] if not is_number(value))
            raise ParameterError(f"'{name}' is a number, and the plan gives it {in_words(other)}.")
    free = equations(loose).p
    return [name for name in known if name in free]


def _something(diagram: Diagram, count: int) -> dict[str, np.ndarray]:
    """A number at its own value, for runs that differ in options alone: a batch varies something."""
    free = [name for name in diagram.parameters if name in equations(diagram).p]
    if not free:
        raise ParameterError(f"'{diagram.title}' has no number at all, so its runs cannot be studied side by side.")
    return {free[0]: np.full(count, diagram.parameters[free[0]])}


def here(
    groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray, threads: int | None
) -> Generator[Found, None, None]:
    """Run what is missing in this process, in as many threads as there are processors unless told."""
    busy = threads or os.cpu_count() or 1
    for group in groups:
        wanted = np.flatnonzero(missing[group.runs])
        if not len(wanted):
            continue
        batch = group.part(wanted).prepared(metrics)
        size = group.lanes * busy * TURNS
        for first in range(0, len(wanted), size):
            last = min(first + size, len(wanted))
            found = batch.results(first, last, _Reduce(tuple(metrics)), busy)
            yield group.runs[wanted[first:last]], found


def elsewhere(
    groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray, executor: Executor
) -> Generator[Found, None, None]:
    """Run what is missing on an executor, piece by piece, in whatever order they end."""
    out = _Given(executor)
    try:
        for number, piece in enumerate(_pieces(groups, metrics, missing)):
            out.give(number, piece, 1)
            while len(out.waiting) >= WAITING:
                yield from out.ended()
        while out.waiting:
            yield from out.ended()
    finally:
        for one in out.waiting:
            one.cancel()


def _pieces(groups: Sequence[Runs], metrics: Sequence[Metric], missing: np.ndarray) -> Iterator[Piece]:
    for group in groups:
        wanted, size = np.flatnonzero(missing[group.runs]), PIECE * group.lanes
        for first in range(0, len(wanted), size):
            yield group.part(wanted[first : first + size]), tuple(metrics)


@attrs.frozen
class _Copy:
    """A piece in the hands of an executor: which one, how often it was given by now, and when."""

    number: int
    piece: Piece
    tries: int
    since: float


@attrs.define
class _Given:
    """Pieces that an executor has been given and has not answered yet.

    An executor may lose a piece without a word: Dask's does when a machine dies with a result that nobody has fetched.
    So a piece that takes far longer than any other has is given once more; whichever copy ends first counts.
    """

    executor: Executor
    waiting: dict[Future[Found], _Copy] = attrs.field(factory=dict)
    longest: float = 0.0

    def give(self, number: int, piece: Piece, tries: int) -> None:
        """Hand a piece over, for the first time or again."""
        self.waiting[self.executor.submit(worked, *piece, tries)] = _Copy(number, piece, tries, monotonic())

    def ended(self) -> Iterator[Found]:
        """Results of those that have ended, which wait no longer; what was lost on the way is run again."""
        patience = max(PATIENCE, OVERDUE * self.longest)
        done, _ = wait(self.waiting, timeout=patience if self.longest else None, return_when=FIRST_COMPLETED)
        for one in done:
            if one not in self.waiting:
                continue  # another copy has ended in this very round
            copy = self.waiting.pop(one)
            try:
                found = one.result()
            except (TsmError, BrokenExecutor):
                raise
            except Exception as error:
                self._failed(copy, error)
            else:
                self.longest = max(self.longest, monotonic() - copy.since)
                self._forget(copy.number)
                yield found
        self._remind(patience)

    def _failed(self, copy: _Copy, error: Exception) -> None:
        if isinstance(error, (PicklingError, AttributeError, TypeError)) and "pickle" in str(error):
            raise RunError(
                f"work for another process must be pickled, and this cannot be: {error}. Give inputs as "
                "samples, and define blocks of your own in a module."
            ) from None
        if copy.number in {other.number for other in self.waiting.values()}:
            return  # a copy of it is under way
        if copy.tries >= TRIES:
            raise error
        self.give(copy.number, copy.piece, copy.tries + 1)

    def _forget(self, number: int) -> None:
        for other in [f for f, copy in self.waiting.items() if copy.number == number]:
            other.cancel()
            del self.waiting[other]

    def _remind(self, patience: float) -> None:
        """Give again what is overdue, as long as its tries last; then it is waited for, however long that takes."""
        latest = {copy.number: copy for copy in self.waiting.values()}  # the last copy of each, in the order given
        for copy in latest.values():
            if self.longest and copy.tries < TRIES and monotonic() - copy.since > patience:
                self.give(copy.number, copy.piece, copy.tries + 1)


def worked(runs: Runs, metrics: tuple[Metric, ...], _tries: int) -> Found:
    """One piece of work, in whichever process: run, and reduce to metrics.

    Which try it is makes copies differ: an executor that knows work by its arguments would give the one that it lost.
    """
    batch = runs.prepared(metrics)
    return runs.runs, batch.results(0, batch.count, _Reduce(metrics), 1)


@attrs.frozen
class _Reduce:
    """Metrics of runs side by side."""

    metrics: tuple[Metric, ...]

    def __call__(self, t: np.ndarray, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {one.name: one(t, signals) for one in self.metrics}


def checked(groups: Sequence[Runs], metrics: Sequence[Metric]) -> list[PreparedBatch]:
    """The groups' batches. Raises what running would raise: sets that a block refuses, metrics of no instant."""
    batches = [group.prepared(metrics) for group in groups]
    for batch in batches:
        for one in metrics:
            one(batch.t, {name: np.zeros(len(batch.t)) for name in one.signals})
    return batches


def run_starts(
    groups: Sequence[Runs], batches: Sequence[PreparedBatch], columns: Mapping[str, np.ndarray]
) -> list[RunStart]:
    """Where a few of the runs begin: those at the ends of what varies, and the first of each group."""
    chosen = dict.fromkeys([*extreme_sets(columns), *(int(group.runs[0]) for group in groups)])
    made = []
    for run in list(chosen)[:MOST_CHECKED]:
        k, at = next((k, at[0]) for k, one in enumerate(groups) if len(at := np.flatnonzero(one.runs == run)))
        words = set_text({name: plain(values[run]) for name, values in columns.items()})
        made.append(attrs.evolve(batches[k].run_start(int(at)), words=words))
    return made
