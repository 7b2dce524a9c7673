"""Steps of a run taken again in another length, by the run's own kernel."""

from __future__ import annotations

import copy
import math
from functools import cached_property

import attrs
import numpy as np

from tsmblocks.engine.events import Located, locating
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.session import Session, single_kernel

TINY_SIGNAL = 1e-12
"""Share of the largest signal below which a signal is rounding. Chosen: some thousand roundings."""
MOST_SCALED = 2048
"""Instants of which the largest values of a run are taken, about. Chosen: for speed."""


MOST_TURNS = 40
"""Steps with a switch that is located, at most, when steps are taken again. Chosen: for speed, a tenth of a second."""


class Interrupted(Exception):
    """Ctrl-C while steps were taken again."""


def scale_of(x: np.ndarray) -> np.ndarray:
    """The largest value of each signal that is finite, above rounding."""
    largest = np.abs(np.where(np.isfinite(x), x, 0.0)).max(axis=0)
    return np.asarray(np.maximum(largest, max(TINY_SIGNAL * float(largest.max(initial=0.0)), 1e-300)))


@attrs.frozen(eq=False, slots=False)
class Taken:
    """A run as it was taken: ``session`` at its end, ``begin`` the memory before step ``k``, ``steps`` of them.

    ``watched`` are the positions in ``eq.y`` of the signals that are compared, states and outputs, and ``weights`` how
    much of their largest values counts as one; ``columns`` are those of ``rows``, the rows logged, that hold watched
    signals, in their order, and empty where not each ``every``-th instant from ``k`` on is there.
    """

    session: Session
    begin: Memory
    k: int
    steps: int
    rows: np.ndarray
    watched: tuple[int, ...]
    weights: np.ndarray
    columns: dict[int, int]
    backend: str = ""

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
    def scale(self) -> np.ndarray:
        """What counts as one of each signal that is watched and logged."""
        few = self.rows[:: max(1, len(self.rows) // MOST_SCALED)]
        return scale_of(few[:, self.logged]) * self.weights[list(self.columns)]

    def stride(self, finer: float) -> int:
        """Steps between two instants at which the run can be compared with itself in steps ``finer`` times as short."""
        return self.every if finer >= 1 or self.every % 2 == 0 else 2 * self.every

    def kept(self, k: int, n: int, stride: int) -> np.ndarray:
        """Signals of the run at each ``stride``-th of the instants ``k`` … ``k + n``, those that are logged."""
        first = (k - self.k) // self.every
        return self.rows[first : first + n // self.every + 1 : stride // self.every][:, self.logged]

    def again(self, memory: Memory, k: int, n: int, finer: float) -> np.ndarray:
        """The same signals over ``n`` steps from ``k`` in steps ``finer`` times as short; infinite after divergence."""
        return self._again(self.session, self.logged, memory, k, n, finer)

    def all_again(self, memory: Memory, k: int, n: int, finer: float, located: bool | None = None) -> np.ndarray:
        """As ``again``, all that is watched; ``located`` as in the run unless given."""
        session = self.session
        if self.complete and located is None:
            return self.again(memory, k, n, finer)
        kernel, columns = session.kernel, self.logged
        if not self.complete:
            columns = list(range(len(self.watched)))
            kernel = single_kernel(session.eq, kernel.plan.method, self.watched, self.backend)
        one = self._of(kernel)
        one = locating(one, self.backend) if (self.located if located is None else located) else one
        return self._again(one, columns, memory, k, n, finer)

    def by(self, kernel: Kernel, n: int, finer: float) -> np.ndarray:
        """The first ``n`` steps by a kernel of another method, which logs what is watched alone; as ``again``."""
        memory = attrs.evolve(self.begin.copy(), loops=np.zeros(kernel.layout_loops.size))
        return self._again(self._of(kernel), list(range(len(self.watched))), memory, self.k, n, finer)

    def marks_again(self, memory: Memory, k: int, n: int, finer: float) -> np.ndarray:
        """All states where the run has marks, in steps ``finer`` times as short; fewer after divergence."""
        one = _shifted(self.session, memory, k, finer)
        one.mark_every = round(self.session.mark_every * finer)
        _, stopped = one.run(round(n * finer), None)
        if stopped is not None and stopped.interrupted:
            raise Interrupted
        return np.array([mark.x for _, mark in one.marks]).reshape(-1, len(one.eq.x))

    def _of(self, kernel: Kernel) -> Session:
        """A session of the run with another kernel."""
        s = self.session
        return Session(s.eq, kernel, s.memory, s.signals, s.start, s.h, s.every, self.k, s.hits)

    def _again(self, session: Session, columns: list[int], memory: Memory, k: int, n: int, finer: float) -> np.ndarray:
        stride = self.stride(finer)
        one = _shifted(session, memory, k, finer)
        one.every = round(stride * finer)
        rows, stopped = one.run(round(n * finer), None)
        if stopped is not None and stopped.interrupted:
            raise Interrupted
        made = np.full((n // stride + 1, len(columns)), np.inf)
        made[: len(rows)] = rows[:, columns]
        return made


def _shifted(session: Session, memory: Memory, k: int, finer: float) -> Session:
    """The session from step ``k`` on, in steps ``finer`` times as short."""
    memory = memory.copy()
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
