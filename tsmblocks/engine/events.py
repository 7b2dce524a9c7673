"""Switching instants located within the step, so that a method keeps its order across kinks and jumps.

With the modes of all switches frozen (see ``switches``) each step is smooth. A walk runs stretches of
such steps, goes back to the first one at whose end some switching function contradicts its mode, and
crosses that step in parts: up to the crossing, there the mode turns over, and on to the end.

A signal that crosses an edge and comes back within one step is not seen. Rounding (floor, ceil) is
left as it is: the jumps of a quantiser are not located. Memory is updated at events as at instants of
the grid; samples are taken on the grid only.
"""

from __future__ import annotations

import warnings

import attrs
import numpy as np

from tsmblocks.engine import feeds
from tsmblocks.engine.kernels import Memory
from tsmblocks.engine.methods import Method
from tsmblocks.engine.session import Session, Stopped
from tsmblocks.engine.switches import Frozen, freeze, margin, turned
from tsmblocks.errors import RunError

MOST = 8
"""Times a switch may turn over within a step, before that step is taken plainly."""
SHORTEST, LONGEST = 32, 8192
"""Steps run at a stretch before their ends are looked at."""
MOST_PLAIN = 16
"""Steps taken plainly at a time while a sliding mode lasts."""


class SlidingWarning(UserWarning):
    """A switch turns over again and again at one instant, so that its instants cannot be located."""


@attrs.frozen
class Event:
    """An instant ``t`` [s] at which a switch turned over.

    ``block`` is the block whose equation holds the switch (``""`` when it cannot be told), ``switch`` one
    of abs, sign, min, max, <, <=. ``rising`` says which way: the argument a of abs and sign, a - b of
    min(a, b) and max(a, b), b - a of a < b and a <= b became positive.
    """

    t: float
    block: str
    switch: str
    rising: bool


@attrs.frozen(eq=False)
class _Point:
    """A state within a step, with its modes and switching functions."""

    t: float
    x: np.ndarray
    d: np.ndarray
    m: np.ndarray
    g: np.ndarray


@attrs.define(eq=False)
class Located(Session):
    """A run in progress whose switching instants are located. ``events`` are those found so far."""

    frozen: Frozen | None = None
    modes: np.ndarray | None = None
    events: list[Event] = attrs.field(factory=list)
    warned: bool = False
    last: tuple[int, Memory, int] | None = None

    def advance(self, n: int, final: bool) -> np.ndarray:
        """Take n steps; the rows logged. All of it or, when interrupted, nothing."""
        if self.frozen is None:
            return Session.advance(self, n, final)
        walk = _Walk(self, self.frozen, n, final)
        walk.go()
        self.k, self.memory, self.modes, self.last = self.k + n, walk.memory(), walk.m, walk.last
        self.events += walk.events
        if walk.slid is not None and not self.warned:
            self.warned = True
            _warn(self.eq.title, walk.slid)
        return walk.y

    def _failed(self, y: np.ndarray, before: Memory, k: int, n: int) -> Stopped | None:
        """As for any run, but from the start of the last stretch, which holds no event before the failure."""
        found = Session._failed(self, y, before, k, n)
        if found is None or self.last is None:
            return found
        return Stopped(self.last[0], found.rows, self.last[1], interrupted=False, steps=self.last[2])


def locating(session: Session, method: Method, y: tuple[int, ...], backend: str) -> Located:
    """The session with switching instants located. Raises RunError where the equations have delays."""
    eq, s = session.eq, session
    if eq.q:
        raise RunError(f"locate=True does not go with a transport delay ({eq.q[0]}): a switch would come back through "
                       "it later, at instants off the step. Leave out locate, or the delay.")  # fmt: skip
    return Located(eq, s.kernel, s.memory, s.signals, s.start, s.h, s.every, s.k, s.hits, freeze(eq, method, y, backend))


def _warn(title: str, slid: Event) -> None:
    place = f"the {slid.switch} in {slid.block}" if slid.block else f"a {slid.switch}"
    warnings.warn(
        f"diagram '{title}': from t = {slid.t:.6g} s on, {place} turns over again and again at one instant (a sliding "
        "mode). Such steps are taken as without locate, with errors of the order of the step.",
        SlidingWarning, stacklevel=5,
    )  # fmt: skip


class _Walk:
    """Some steps of a run, on arrays of their own, from one return to the session to the next."""

    def __init__(self, session: Located, frozen: Frozen, n: int, final: bool) -> None:
        self.s, self.f, self.h = session, frozen, session.h
        self.first, self.k, self.stop, self.final = session.k, session.k, session.k + n, final
        self.x, self.d, self.m = session.memory.x.copy(), session.memory.d.copy(), session.modes
        self.y = np.full((session.rows_in(n, final), session.kernel.layout_y.size), np.nan)
        self.events: list[Event] = []
        self.slid: Event | None = None
        self.failed = False
        self.last = (self.k, self.memory(), n)
        self.length, self.quiet_for, self.plain = 2 * SHORTEST, 0, 1
        ends = np.cumsum([self.y.shape[1], len(self.x), len(self.d)])
        self.signals, self.states, self.memories = (slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    def memory(self) -> Memory:
        """The state now, in arrays of its own."""
        old = self.s.memory
        return Memory(self.x.copy(), self.d.copy(), old.p, old.ring, old.mask)

    def time(self, k: int) -> float:
        return self.s.start + k * self.h

    # ---- along the grid

    def go(self) -> None:
        """All steps, and the last row. After a failure rows stay NaN."""
        while self.k < self.stop and not self.failed:
            self._stretch()
        if self.final and not self.failed:
            self._settle()
            self.last = (self.k, self.memory(), 0)
            rows, memory = self._frozen(0)
            self._keep(rows)
            self.x, self.d = memory.x, memory.d[: len(self.d)]

    def _stretch(self) -> None:
        """Steps up to the first event and across it; plain ones where that cannot be done."""
        self._settle()
        assert self.m is not None
        n = min(self.length, self.stop - self.k)
        rows, _ = self._frozen(n)
        with np.errstate(invalid="ignore"):
            g = rows[:, self.memories.stop :].reshape(n + 1, -1, len(self.m))
            lost = ~np.isfinite(rows[:, : self.states.stop]).all(axis=1) | np.isnan(g).any(axis=(1, 2))
            found = np.flatnonzero(lost[1:] | self.f.wrong(g[1:], self.m).any(axis=(1, 2)))
        aim = count = 1 if lost[0] else int(found[0]) + 1 if len(found) else n
        there = None
        while count and (there := None if lost[count - 1] else self._step(self.k + count - 1, rows[count - 1])) is None:
            count -= 1
        self._keep(rows[:count])
        self.k += count
        if there is not None:
            self.x, self.d = there.x, there.d
            self._plan_ahead(count, bool((there.m != self.m).any()))
            self.m = there.m
        if count < aim:
            self._plainly()
        else:
            self.plain = 1

    def _plan_ahead(self, count: int, event: bool) -> None:
        """As many steps next as the last events were apart."""
        self.quiet_for += count
        self.length = min(LONGEST, max(SHORTEST, self.quiet_for) if event else 2 * self.length)
        self.quiet_for = 0 if event else self.quiet_for

    def _settle(self) -> None:
        """Modes that agree with the signals at this instant, after its updates."""
        silent = self.m is None
        m = self.f.fresh if self.m is None else self.m
        for _ in range(len(m) + 1):  # one turn may lead to another, never back
            self.m = m
            g = self._frozen(0)[0][0, self.memories.stop : self.memories.stop + len(m)]
            wrong = self.f.wrong(g, m)
            if not wrong.any():
                return
            m = turned(g, m, wrong)
            if not silent:
                self.events += self._events(self.time(self.k), wrong, m)

    def _frozen(self, n: int) -> tuple[np.ndarray, Memory]:
        """Rows of n steps with frozen switches, ends included, and the memory afterwards."""
        assert self.m is not None
        s, kernel = self.s, self.f.whole
        memory = self.f.memory(self.x, self.d, self.m, s.memory)
        rows = np.empty((n + 1, kernel.layout_y.size))
        u = feeds.rows(s.signals, s.start, self.h, self.k, n, kernel.plan.method.instants)
        kernel.advance(memory, u, t0=s.start, h=self.h, k0=self.k, n=n, final=True, every=1, skip=0, hits=s.hits, y=rows)
        return rows, memory

    def _plainly(self) -> None:
        """A few steps with the ordinary kernel, which decides switches anew at each stage."""
        s, n, memory = self.s, min(self.plain, self.stop - self.k), self.memory()
        self.last = (self.k, memory.copy(), n)
        rows = np.empty((n, self.y.shape[1]))
        u = feeds.rows(s.signals, s.start, self.h, self.k, n, s.kernel.plan.method.instants)
        s.kernel.advance(memory, u, t0=s.start, h=self.h, k0=self.k, n=n, final=False, every=1, skip=0, hits=s.hits, y=rows)
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        if len(bad) or not np.isfinite(memory.x).all():
            self._keep(rows[: bad[0]] if len(bad) else rows)
            self.failed, self.y[-1:], self.x[:] = True, np.nan, np.nan
            return
        self._keep(rows)
        self.k, self.x, self.d, self.m = self.k + n, memory.x, memory.d, None
        self.plain, self.length = min(2 * self.plain, MOST_PLAIN), SHORTEST

    def _keep(self, rows: np.ndarray) -> None:
        """Put rows from the present instant on where they belong, if they are to be logged."""
        every = self.s.every
        due = np.arange(-self.k % every, len(rows), every)
        self.y[(self.k + due) // every - (self.first + every - 1) // every] = rows[due, self.signals]

    # ---- within a step

    def _step(self, k: int, row: np.ndarray) -> _Point | None:
        """The state at the end of a step, all its events passed; None when that cannot be done."""
        assert self.m is not None
        g = row[self.memories.stop : self.memories.stop + len(self.m)]
        here, end_time = _Point(self.time(k), row[self.states], row[self.memories], self.m, g), self.time(k + 1)
        count, near, before = (np.zeros(len(g)) for _ in range(3))
        events: list[Event] = []
        while True:
            end = self._part(here, end_time)
            if end is None:
                return None
            wrong = self.f.wrong(end.g, here.m)
            if not wrong.any():
                break
            past = self._cross(here, end, wrong)
            made = past and self._turn(past, wrong)
            if not made:
                return None
            here, which = made
            again = which & (count > 0) & (here.t - before <= 1e-9 * self.h)
            count, near, before = count + which, np.where(which, near * again + 1, near), np.where(which, here.t, before)
            if here.t > self.s.start + 1e-9 * self.h:
                events += self._events(here.t, which & ~again, here.m)
            chattering = (near > 2) | (count > MOST)
            if chattering.any():
                self.slid = self.slid or self._events(here.t, chattering, here.m)[0]
                return None
            if end_time - here.t <= self._finest(here.t):
                end = here
                break
        self.events += events
        return end

    def _finest(self, t: float) -> float:
        """To what an instant is located."""
        return 1e-13 * self.h + 4 * np.finfo(float).eps * abs(t)

    def _events(self, t: float, which: np.ndarray, m: np.ndarray) -> list[Event]:
        return [Event(t, *self.f.names[i], bool(m[i] > 0)) for i in np.flatnonzero(which)]

    def _inputs(self, t: float, length: float) -> np.ndarray:
        """Inputs of a part of a step; at its end those just before it."""
        instants = self.f.part.plan.method.instants
        made = feeds.rows(self.s.signals, t, length, 0, 1, (*instants, 1.0))
        u = np.ascontiguousarray(made[:, : len(instants)])
        u[1, 0] = made[0, -1]
        return u

    def _part(self, here: _Point, t: float) -> _Point | None:
        """One step of the method from a point to t, modes frozen; None if not finite."""
        n, length = int(t > here.t), t - here.t if t > here.t else self.h
        memory = self.f.memory(here.x, here.d, here.m, self.s.memory)
        g = np.empty((1, len(here.m)))
        self.f.part.advance(memory, self._inputs(here.t, length), t0=here.t, h=length, k0=0, n=n, final=True, every=1,
                            skip=n, hits=(), y=g)  # fmt: skip
        if not np.isfinite(memory.x).all() or np.isnan(g).any():
            return None
        return _Point(t, memory.x, here.d, here.m, g[0])

    def _cross(self, here: _Point, end: _Point, wrong: np.ndarray) -> _Point | None:
        """The point just past the first crossing between two points (Illinois, some bisection among it)."""
        m, starts, ends = here.m, margin(here.g, here.m), margin(end.g, here.m)
        watch = (wrong | (starts > 0)) & np.isfinite(starts) & np.isfinite(ends)
        if not watch.any():
            return end
        scale = np.maximum(np.maximum(np.abs(starts), np.abs(ends))[watch], np.finfo(float).tiny)

        def worst(point: _Point) -> float:
            return float(np.min(margin(point.g, m)[watch] / scale))

        low, above, high, below = here.t, max(worst(here), 0.0), end.t, worst(end)
        past: _Point | None = end
        finest, side, tries = self._finest(end.t), 0, 0
        while high - low > finest and below < 0:
            tries += 1
            if above == 0:  # at the edge from the start: is it left at once?
                t = low + (high - low) * (1e-6 if side >= 0 else 0.5)
            elif tries % 4 == 0:
                t = (low + high) / 2
            else:
                t = min(max(high - below * (high - low) / (below - above), low + finest / 2), high - finest / 2)
            point = self._part(here, t)
            value = worst(point) if point is not None else -1.0
            if value < 0 or (value == 0 and above > 0):
                high, below, past = t, value, point
                above, side = above / 2 if side > 0 else above, 1
            else:
                low, above = t, value
                below, side = below / 2 if side < 0 else below, -1
        return past

    def _turn(self, past: _Point, wrong: np.ndarray) -> tuple[_Point, np.ndarray] | None:
        """Turn over the switches that cross here and those that jump with them; the new point, and which."""
        which = self.f.wrong(past.g, past.m) | (wrong & (margin(past.g, past.m) <= 0))
        here: _Point | None = attrs.evolve(past, m=turned(past.g, past.m, which))
        assert here is not None
        if self.f.remember is not None:
            full = np.concatenate([here.d, here.m, self.f.spare])
            d, x = self.f.remember(here.t, here.x, full, self._inputs(here.t, self.h)[0, 0], [], self.s.memory.p)
            here = attrs.evolve(here, d=np.asarray(d).ravel(), x=np.asarray(x).ravel())
        for _ in range(len(which) + 1):
            here = self._part(here, here.t)
            if here is None:
                return None
            more = self.f.wrong(here.g, here.m) & ~which
            if not more.any():
                break
            here, which = attrs.evolve(here, m=turned(here.g, here.m, more)), which | more
        return here, which
