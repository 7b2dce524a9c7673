"""Steps of a run taken again in another length, by the run's own kernel."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cached_property

import attrs
import numpy as np

from tsmblocks.engine.events import Located, locating
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.session import Session, single_kernel

TINY_SIGNAL = 1e-12
"""Share of the largest signal below which a signal is rounding. Chosen: some thousand roundings."""
MOST_SAMPLED = 1024
"""Instants of which the largest values of a run are taken, about. Chosen: for speed."""
SHORT_STEPS = 4096
"""Steps up to which a kernel takes all at once, with no look at Ctrl-C. Chosen: below a tenth of a second."""
MOST_TURNS = 40
"""Steps with a switch that is located, at most, when steps are taken again. Chosen: for speed, a tenth of a second."""


class Interrupted(Exception):
    """Ctrl-C while steps were taken again."""


def scale_of(x: np.ndarray) -> np.ndarray:
    """The largest value of each signal that is finite, above rounding."""
    x = np.abs(x)
    if not math.isfinite(x.sum()):
        x[~np.isfinite(x)] = 0.0
    largest = np.ascontiguousarray(x.T).max(axis=1)  # several times as fast as over the first axis
    return np.asarray(np.maximum(largest, max(TINY_SIGNAL * float(largest.max(initial=0.0)), 1e-300)))


def largest_over_last(x: np.ndarray) -> np.ndarray:
    """The largest number along the last axis, which is short: several times as fast as ``max`` along it."""
    return np.asarray(np.ascontiguousarray(np.moveaxis(x, -1, 0)).max(axis=0))


@attrs.frozen(eq=False)
class Part:
    """``n`` steps of a run from step ``k``, and the memory before them."""

    memory: Memory
    k: int
    n: int


@attrs.frozen(eq=False)
class Again:
    """Parts of one length taken again: signals, shape (parts, rows, signals), infinite after divergence; and the states
    of each at the run's marks and in the end, up to divergence, where not all that is compared is among the signals.
    """

    rows: np.ndarray
    at_marks: list[np.ndarray]


@attrs.frozen(eq=False, slots=False)
class Taken:
    """A run as it was taken: ``session`` at its end, ``begin`` the memory before step ``k``, ``steps`` of them.

    ``kept_signals`` are the positions in ``eq.y`` of the signals in ``rows``, the rows logged; ``aligned`` is whether
    these are each ``every``-th instant from ``k`` on. ``watched`` are the positions of the signals that are compared,
    and ``weights`` how much of their largest values counts as one.
    """

    session: Session
    begin: Memory
    k: int
    steps: int
    rows: np.ndarray
    kept_signals: tuple[int, ...]
    aligned: bool
    watched: tuple[int, ...]
    weights: np.ndarray
    backend: str = ""

    @cached_property
    def columns(self) -> dict[int, int]:
        """The columns of the rows that hold watched signals, by their position among these; none unless aligned."""
        places = {signal: column for column, signal in enumerate(self.kept_signals)} if self.aligned else {}
        return {i: places[one] for i, one in enumerate(self.watched) if one in places}

    @property
    def every(self) -> int:
        """Steps between two rows."""
        return self.session.every

    @property
    def located(self) -> bool:
        """Whether switching instants are located."""
        return isinstance(self.session, Located)

    @property
    def complete(self) -> bool:
        """Whether all that is watched is among the rows."""
        return len(self.columns) == len(self.watched)

    @cached_property
    def logged(self) -> list[int]:
        """The columns of what is watched."""
        return list(self.columns.values())

    @cached_property
    def sample(self) -> np.ndarray:
        """Some of the rows."""
        return self.rows[:: self.sampled_every]

    @property
    def sampled_every(self) -> int:
        """Rows from one of ``sample`` to the next."""
        return max(1, len(self.rows) // MOST_SAMPLED)

    @cached_property
    def scale(self) -> np.ndarray:
        """What counts as one of each signal that is watched and logged."""
        return scale_of(self.sample[:, self.logged]) * self.weights[list(self.columns)]

    def stride(self, finer: float) -> int:
        """Steps between two instants at which the run can be compared with itself in steps ``finer`` times as short."""
        return self.every if finer >= 1 or self.every % 2 == 0 else 2 * self.every

    def kept(self, part: Part, stride: int) -> np.ndarray:
        """Signals of the run at each ``stride``-th instant of a part, those that are logged."""
        first = (part.k - self.k) // self.every
        return self.rows[first : first + part.n // self.every + 1 : stride // self.every][:, self.logged]

    def again(self, parts: Sequence[Part], finer: float) -> Again:
        """Parts of one length in steps ``finer`` times as short, with the signals of ``kept``."""
        return self._again(self.session, self.logged, parts, finer)

    def all_again(self, part: Part, finer: float, located: bool | None = None) -> np.ndarray:
        """All that is watched over one part, shape (rows, signals), as ``again``; ``located`` as in the run unless
        given.
        """
        session = self.session
        if self.complete and located is None:
            return self.again([part], finer).rows[0]
        kernel, columns = session.kernel, self.logged
        if not self.complete:
            columns = list(range(len(self.watched)))
            kernel = single_kernel(session.eq, kernel.plan.method, self.watched, self.backend)
        one = self._of(kernel)
        one = locating(one, self.backend) if (self.located if located is None else located) else one
        return self._again(one, columns, [part], finer).rows[0]

    def by(self, kernel: Kernel, n: int, finer: float) -> np.ndarray:
        """The first ``n`` steps by a kernel of another method, which logs what is watched alone; as ``all_again``."""
        memory = attrs.evolve(self.begin.copy(), loops=np.zeros(kernel.layout_loops.size))
        part = Part(memory, self.k, n)
        return self._again(self._of(kernel), list(range(len(self.watched))), [part], finer).rows[0]

    def _of(self, kernel: Kernel) -> Session:
        """A session of the run with another kernel."""
        s = self.session
        return Session(s.eq, kernel, s.memory, s.signals, s.start, s.h, s.every, self.k, s.hits)

    def _again(self, session: Session, columns: list[int], parts: Sequence[Part], finer: float) -> Again:
        stride, steps = self.stride(finer), round(parts[0].n * finer)
        every = round(stride * finer)
        made = np.empty(0)
        at_marks = list[np.ndarray]()
        for i, part in enumerate(parts):
            one = _shifted(session, part, finer)
            one.every = every
            if not i:
                made = np.full((len(parts), *one.rows_for(steps, True).shape), np.inf)
            if self.complete and steps <= SHORT_STEPS:
                one.advance(steps, True, made[i])
                continue
            one.mark_every = round(self.session.mark_every * finer)
            rows, stopped = one.run(steps, None)
            made[i, : len(rows)] = rows
            if stopped is not None and stopped.interrupted:
                raise Interrupted
            at_marks.append(
                np.array([*(mark.x for _, mark in one.marks), *([one.memory.x] if stopped is None else [])])
            )
        return Again(_infinite_after_divergence(made[:, :, columns]), at_marks)


def _infinite_after_divergence(rows: np.ndarray) -> np.ndarray:
    """Rows of shape (parts, rows, signals), infinite from the first of a part on in which a number is not finite."""
    if not math.isfinite(rows.sum()):
        lost = np.logical_or.accumulate(~np.isfinite(rows).all(axis=2), axis=1)
        rows[lost] = np.inf
    return rows


def _shifted(session: Session, part: Part, finer: float) -> Session:
    """The session before the part, in steps ``finer`` times as short."""
    memory, k = part.memory.copy(), part.k
    if len(memory.ring):
        for _ in range(round(math.log2(finer))):
            memory = _refined(memory, k, len(session.eq.q))
            k *= 2
        if finer < 1:
            memory = _thinned(memory, k, len(session.eq.q))
            k //= 2
    else:
        k = round(k * finer)
    one = copy.copy(session)
    one.memory, one.k, one.h = memory, k, session.h / finer
    one.hits, one.events, one.marks, one.mark_every = tuple(round(n * finer) for n in session.hits), [], [], 0
    one.cut = None
    if isinstance(one, Located):
        one.modes, one.last, one.warned, one.turns, one.most_turns = None, None, True, 0, MOST_TURNS
    return one


def _past(memory: Memory, k: int, signals: int) -> np.ndarray:
    """The stored past of delayed signals before step ``k``, newest first, shape (signals, instants)."""
    size = memory.mask + 1
    return memory.ring.reshape(signals, size)[:, (k - 1 - np.arange(size)) & memory.mask]


def _with_past(memory: Memory, past: np.ndarray, k: int) -> Memory:
    """The memory before step ``k`` with another past; its length is a power of two."""
    size = past.shape[1]
    ring = np.empty_like(past)
    ring[:, (k - 1 - np.arange(size)) & (size - 1)] = past
    return attrs.evolve(memory, ring=ring.ravel(), mask=size - 1)


def _refined(memory: Memory, k: int, signals: int) -> Memory:
    """Memory before step ``k`` as it is before step ``2 k`` of half the length: instants between are interpolated."""
    old = _past(memory, k, signals)
    new = np.repeat(old, 2, axis=1)  # new[2 i + 1] is old[i]; new[2 i] lies between old[i - 1] and old[i]
    new[:, 4:-2:2] = (9 * (old[:, 1:-2] + old[:, 2:-1]) - old[:, :-3] - old[:, 3:]) / 16
    new[:, 2] = (3 * old[:, 0] + 6 * old[:, 1] - old[:, 2]) / 8
    new[:, 0] = (15 * old[:, 0] - 10 * old[:, 1] + 3 * old[:, 2]) / 8
    return _with_past(memory, new, 2 * k)


def _thinned(memory: Memory, k: int, signals: int) -> Memory:
    """Memory before the even step ``k`` as it is before step ``k / 2`` of twice the length."""
    old = _past(memory, k, signals)
    new = np.repeat(old[:, -1:], old.shape[1], axis=1)
    every_other = old[:, 1::2]
    new[:, : every_other.shape[1]] = every_other
    return _with_past(memory, new, k // 2)
