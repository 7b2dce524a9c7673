"""Switching instants located within the step, so that a method keeps its order across kinks and jumps.

With the modes of all switches frozen (see ``switches``) each step is smooth. Stretches of such steps are run; the
first step at whose end some switching function contradicts its mode is repeated in parts (see ``zero_crossing``).

A signal that crosses zero and returns within one step is not detected. Rounding (floor, ceil) is not a switch:
the jumps of a quantiser are not located. Memory is updated at events as at instants of the grid, so a relay switches
where its input reaches a level, and a state is reset where its condition becomes true. Play and rate limits detect a
turning point of their input on the grid only; samples are on the grid only.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.session import Session, Stopped
from tsmblocks.engine.switches import Frozen, freeze
from tsmblocks.engine.zero_crossing import INSTANT_TOLERANCE, Crossing, Event, Passed, Point

SHORTEST_STRETCH, LONGEST_STRETCH = 32, 8192
"""Steps in a stretch, at least and at most, before its switching functions are checked. Chosen."""
STRETCH_NUMBERS = 4_000_000
"""Numbers stored for a stretch, at most (32 MB): stretches of large diagrams are shorter. Chosen."""
MOST_PLAIN_STEPS = 16
"""Steps taken without location at a time during a sliding mode, at most. Chosen."""


class SlidingWarning(UserWarning):
    """A switch changes again and again at one instant (a sliding mode, or resets without end): it is not located."""


class TooManySwitches(Exception):
    """A run of bounded cost has located as many switches as it may."""


@attrs.define(eq=False)
class Located(Session):
    """A run in progress whose switching instants are located; ``events`` are those so far.

    ``turns`` counts the steps in which a switch was looked for; from ``most_turns`` on the run raises TooManySwitches.
    """

    frozen: Frozen | None = None
    modes: np.ndarray | None = None
    warned: bool = False
    last: tuple[int, Memory, int] | None = None
    turns: int = 0
    most_turns: int | None = None

    def advance(self, n: int, final: bool, y: np.ndarray) -> None:
        """Take n steps, writing the rows logged. All of it or, when interrupted, nothing."""
        if self.frozen is None:
            Session.advance(self, n, final, y)
            return
        walk = _Walk(self, self.frozen, n, final)
        walk.go()
        self.k, self.memory, self.modes, self.last = self.k + n, walk.memory(), walk.m, walk.last
        self.events += walk.events
        if walk.slid is not None and not self.warned:
            self.warned = True
            _warn(self.eq.title, walk.slid)
        y[:] = walk.y

    def _early_end(self, y: np.ndarray, before: Memory, k: int, n: int) -> Stopped | None:
        """As for any run, from the last steps that were taken without location, which can be repeated."""
        found = Session._early_end(self, y, before, k, n)
        if found is None or self.last is None:
            return found
        return attrs.evolve(found, k=self.last[0], memory=self.last[1], steps=self.last[2])


def locating(s: Session, backend: str) -> Located:
    """The same session with switching instants located. Raises RunError for transport delays."""
    if s.eq.q:
        raise RunError(
            f"diagram '{s.eq.title}': locate=True does not support a transport delay ({s.eq.q[0]}), which would repeat "
            "kinks at instants off the step. Remove locate, or the delay."
        )
    frozen = freeze(s.eq, s.kernel.plan.method, s.kernel.plan.y, backend)
    return Located(s.eq, s.kernel, s.memory, s.signals, s.start, s.h, s.every, s.k, s.hits, frozen=frozen)


def listed(events: Iterable[Event], h: float) -> tuple[Event, ...]:
    """The events of a run in steps of ``h`` [s], each once: alike comparisons of a block may change at one instant."""
    made = list[Event]()
    now = -math.inf
    for event in events:
        if event.t - now > INSTANT_TOLERANCE * h:
            now, seen = event.t, set[tuple[str, str, bool]]()
        what = (event.block, event.switch, event.rising)
        if what not in seen:
            seen.add(what)
            made.append(event)
    return tuple(made)


def _warn(title: str, slid: Event) -> None:
    place = f"the {slid.switch} in {slid.block}" if slid.block else f"a {slid.switch}"
    warnings.warn(
        f"diagram '{title}': from t = {round(slid.t, 9):g} s on, {place} changes again and again at one "
        "instant (a sliding mode, or resets that follow each other ever faster). Such steps are taken as without "
        "locate, with errors of the step's order.",
        SlidingWarning,
        stacklevel=6,
    )


class _Walk:
    """Some steps of a run, on separate arrays: all of them reach the session, or none."""

    def __init__(self, session: Located, frozen: Frozen, n: int, final: bool) -> None:
        self.s, self.f = session, frozen
        self.first, self.k, self.stop, self.final = session.k, session.k, session.k + n, final
        self.x, self.d, self.m = session.memory.x, session.memory.d, session.modes
        self.y = np.full((session.rows_in(n, final), session.kernel.layout_y.size), np.nan)
        self.events: list[Event] = []
        self.slid: Event | None = None
        self.failed = False
        self.last = (self.k, self.memory(), n)
        self.length, self.since, self.plain = 2 * SHORTEST_STRETCH, 0, 1
        self.longest = max(SHORTEST_STRETCH, min(LONGEST_STRETCH, STRETCH_NUMBERS // frozen.whole.layout_y.size))
        self.crossing = Crossing(frozen, session)
        a, b, c = np.cumsum([self.y.shape[1], len(self.x), len(self.d)])
        self.logged, self.states, self.memories = slice(a), slice(a, b), slice(b, c)
        self.now = slice(c, c + len(frozen.names))

    def memory(self) -> Memory:
        """The present state, in separate arrays."""
        old = self.s.memory
        return Memory(self.x.copy(), self.d.copy(), old.p, old.ring, old.mask, old.loops)

    def time(self, k: int) -> float:
        return self.s.start + k * self.s.h

    def go(self) -> None:
        """Take all steps, and log the last instant. After divergence rows stay NaN."""
        while self.k < self.stop and not self.failed:
            self._stretch(self._settled())
        if self.final and not self.failed:
            m, self.last = self._settled(), (self.k, self.memory(), 0)
            rows, memory = self._frozen(m, 0)
            self._keep(rows)
            self.x, self.d = memory.x, memory.d[: len(self.d)]

    def _stretch(self, m: np.ndarray) -> None:
        """Steps up to the first event and past it; where that fails, some steps without location."""
        n = min(self.length, self.stop - self.k)
        rows, _ = self._frozen(m, n)
        lost, turns = self._checked(rows, m)
        found = np.flatnonzero(lost[1:] | turns[1:])
        aim = 1 if lost[0] else int(found[0]) + 1 if len(found) else n
        count, passed = (0, None) if lost[0] else self._passed(rows, m, aim)
        self._keep(rows[:count])
        self.k += count
        if passed is not None:
            self.x, self.d, self.m = passed.end.x, passed.end.d, passed.end.m
            self.events += passed.events
            self.since += count
            turned_over = bool((self.m != m).any())
            self.length = min(self.longest, max(SHORTEST_STRETCH, self.since) if turned_over else 2 * self.length)
            self.since = 0 if turned_over else self.since
        if count == aim:
            self.plain = 1
        else:
            self._plainly()

    def _checked(self, rows: np.ndarray, m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows with non-finite values, and rows that contradict the modes."""
        g = rows[:, self.now.start :].reshape(len(rows), -1, len(m))
        lost = np.asarray(~np.isfinite(rows[:, : self.states.stop]).all(axis=1) | np.isnan(g).any(axis=(1, 2)))
        return lost, np.asarray(self.f.wrong(g, m).any(axis=(1, 2)))

    def _passed(self, rows: np.ndarray, m: np.ndarray, count: int) -> tuple[int, Passed | None]:
        """Pass the last of ``count`` steps, or of fewer where that fails; the number of steps, and the end."""
        while count:
            self.s.turns += 1
            if self.s.most_turns is not None and self.s.turns > self.s.most_turns:
                raise TooManySwitches
            row = rows[count - 1]
            here = Point(self.time(self.k + count - 1), row[self.states], row[self.memories], m, row[self.now])
            made = self.crossing.step(here, self.time(self.k + count))
            if isinstance(made, Passed):
                return count, made
            self.slid = self.slid or made
            count -= 1
        return 0, None

    def _settled(self) -> np.ndarray:
        """Modes that agree with the signals at this instant, after its updates."""
        m = self.f.fresh if self.m is None else self.m
        for _ in range(len(m) + 1):  # one change may lead to others downstream
            g = self._frozen(m, 0)[0][0, self.now]
            wrong = self.f.first(self.f.wrong(g, m))
            if not wrong.any():
                break
            m = self.f.turned(g, m, wrong)
            if self.m is not None:
                self.events += self.crossing.events(self.time(self.k), wrong, m)
        self.m = m
        return m

    def _frozen(self, m: np.ndarray, n: int) -> tuple[np.ndarray, Memory]:
        """Rows of n steps with frozen switches, both ends included, and the memory afterwards."""
        memory, kernel = self.f.memory(self.x, self.d, m, self.s.memory), self.f.whole
        rows = np.empty((n + 1, kernel.layout_y.size))
        self._advance(kernel, memory, n, True, rows)
        return rows, memory

    def _plainly(self) -> None:
        """Take a few steps with the ordinary kernel, which decides switches at each stage."""
        n, memory = min(self.plain, self.stop - self.k), self.memory()
        self.last = (self.k, self.memory(), n)
        rows = np.empty((n, self.y.shape[1]))
        self._advance(self.s.kernel, memory, n, False, rows)
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        self._keep(rows[: bad[0]] if len(bad) else rows)
        self.failed = len(bad) > 0 or not np.isfinite(memory.x).all()
        if self.failed:
            self.y[-1:], memory.x[:] = np.nan, np.nan
        self.k, self.x, self.d, self.m = self.k + n, memory.x, memory.d, None
        self.plain, self.length, self.since = min(2 * self.plain, MOST_PLAIN_STEPS), SHORTEST_STRETCH, 0

    def _advance(self, kernel: Kernel, memory: Memory, n: int, final: bool, rows: np.ndarray) -> None:
        s = self.s
        kernel.advance(memory, s.inputs(self.k, n), rows, Steps(s.start, s.h, self.k, n, final, s.hits))

    def _keep(self, rows: np.ndarray) -> None:
        """Log the rows, which begin at the present instant, that are due."""
        every = self.s.every
        due = np.arange(-self.k % every, len(rows), every)
        self.y[(self.k + due) // every - (self.first + every - 1) // every] = rows[due, self.logged]
