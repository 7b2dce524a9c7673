"""One step in parts: up to the instant at which a switch changes its branch, then with the other branch."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.engine.inputs import input_rows
from tsmblocks.engine.kernel import Steps
from tsmblocks.engine.session import Session
from tsmblocks.engine.switches import Frozen, margin

EPS, TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)
"""Relative rounding of a double, and the smallest normal one."""
MOST_CHANGES = 8
"""Changes of a switch within a step, above which it counts as a sliding mode. Chosen."""
MOST_CHANGES_AT_ONCE = 3
"""Changes at one instant, above which it counts as one. Chosen: a relay takes two (see ``Crossing``)."""
INSTANT_TOLERANCE = 1e-9
"""Fraction of a step within which two instants are the same. Chosen: above their rounding."""


@attrs.frozen
class Event:
    """An instant ``t`` [s] at which a switch changed its branch.

    ``block`` is the block whose equation holds the switch (``""`` when it is not known), ``switch`` one
    of abs, sign, min, max, <, <=. ``rising`` is the direction: the argument of abs and sign, a - b of
    min(a, b) and max(a, b), b - a of a < b and a <= b became positive.
    """

    t: float
    block: str
    switch: str
    rising: bool


@attrs.frozen(eq=False)
class Point:
    """A state within a step, with its modes and switching functions."""

    t: float
    x: np.ndarray
    d: np.ndarray
    m: np.ndarray
    g: np.ndarray


@attrs.frozen(eq=False)
class Passed:
    """A completed step: its end, and the events within it."""

    end: Point
    events: list[Event]


class Crossing:
    """Takes single steps of a session with frozen switches."""

    def __init__(self, frozen: Frozen, session: Session) -> None:
        self.frozen, self.signals, self.like = frozen, session.signals, session.memory
        self.start, self.h = session.start, session.h
        self.instants = frozen.part.plan.method.instants
        self.no_inputs = np.empty((2, len(self.instants), 0))

    def step(self, here: Point, t: float) -> Passed | Event | None:
        """From a point on the grid to the next one at ``t``.

        An Event when a switch changes again and again (a sliding mode), None when values become non-finite.
        """
        frozen, events = self.frozen, list[Event]()
        count, near, last, reported = (np.full(len(here.m), v) for v in (0, 0, -np.inf, -np.inf))
        while t - here.t > self._finest(t):
            end = self._part(here, t)
            if end is None:
                return None
            wrong = frozen.wrong(end.g, here.m)
            if not wrong.any():
                return Passed(end, events)
            past = self._cross(here, end, wrong)
            made = None if past is None else self._turn(past, wrong)
            if made is None:
                return None
            old, (here, which) = here.m, made
            again = here.t - last <= INSTANT_TOLERANCE * self.h
            count, last = count + which, np.where(which, here.t, last)
            near = np.where(which, near * again + 1, near)
            chattering = (near > MOST_CHANGES_AT_ONCE) | (count > MOST_CHANGES)
            if chattering.any():
                return self.events(here.t, chattering, here.m)[0]
            over = (
                (here.m != old)
                & (here.t - reported > INSTANT_TOLERANCE * self.h)
                & (here.t > self.start + INSTANT_TOLERANCE * self.h)
            )
            events, reported = events + self.events(here.t, over, here.m), np.where(over, here.t, reported)
        return Passed(here, events)

    def events(self, t: float, which: np.ndarray, m: np.ndarray) -> list[Event]:
        """The events of switches that have changed."""
        return [Event(t, *self.frozen.names[i], bool(m[i] > 0)) for i in np.flatnonzero(which)]

    def _finest(self, t: float) -> float:
        """The resolution [s] to which an instant is located."""
        return 1e-13 * self.h + 4 * EPS * abs(t)

    def _inputs(self, t: float, length: float) -> np.ndarray:
        """Sampled inputs over a part of a step; at its end, where that is on the grid, the limits from the left."""
        if not self.signals:
            return self.no_inputs
        made = input_rows(self.signals, t, length, 0, 1, (*self.instants, 1.0))
        u = np.ascontiguousarray(made[:, : len(self.instants)])
        steps = (t + length - self.start) / self.h
        on_grid = abs(steps - round(steps)) <= INSTANT_TOLERANCE
        u[1, 0] = made[0, -1] if on_grid else input_rows(self.signals, t + length, length, 0, 0, (0.0,), late=0.0)[0]
        return u

    def _part(self, here: Point, t: float) -> Point | None:
        """One step of the method from a point to t, or no step and g evaluated again; None if not finite."""
        n, length = (1, t - here.t) if t > here.t else (0, self.h)
        memory, g = self.frozen.memory(here.x, here.d, here.m, self.like), np.empty((1, len(here.m)))
        steps = Steps(here.t, length, 0, n, True, skip=n)
        self.frozen.part.advance(memory, self._inputs(here.t, length), g, steps)
        finite = np.isfinite(memory.x).all() and not np.isnan(g).any()
        return Point(t, memory.x, here.d, here.m, g[0]) if finite else None

    def _cross(self, here: Point, end: Point, wrong: np.ndarray) -> Point | None:
        """Find the point just past the first crossing on the way (Illinois method, with some bisection)."""
        starts, ends = margin(here.g, here.m), margin(end.g, here.m)
        watch = (wrong | (starts > 0)) & np.isfinite(starts) & np.isfinite(ends)
        if not watch.any():
            return end
        scale = np.maximum(np.maximum(np.abs(starts), np.abs(ends))[watch], TINY)

        def worst(point: Point) -> float:
            return float(np.min(margin(point.g, here.m)[watch] / scale))

        low, above, high, below = here.t, max(worst(here), 0.0), end.t, worst(end)
        past: Point | None = end
        finest, side, tries = self._finest(end.t), 0, 0
        while high - low > finest and below < 0:
            tries += 1
            if above < INSTANT_TOLERANCE and side >= 0:  # at zero from the start: does it change at once?
                t = low + ((high - low) * 1e-6 if side == 0 else finest * 0.9)
            elif above == 0 or tries % 4 == 0:
                t = (low + high) / 2
            else:
                t = high - below * (high - low) / (below - above)
                t = min(max(t, low + finest / 2), high - finest / 2)
            point = self._part(here, t)
            value = worst(point) if point is not None else -1.0
            if value < 0 or (value == 0 and above > 0):
                high, below, past = t, value, point
                above, side = (above / 2 if side > 0 else above), 1
            else:
                low, above = t, value
                below, side = (below / 2 if side < 0 else below), -1
        return past

    def _turn(self, past: Point, wrong: np.ndarray) -> tuple[Point, np.ndarray] | None:
        """Change all switches that cross zero at a point or jump with those; the point, and which they are."""
        frozen = self.frozen
        which = frozen.first(frozen.wrong(past.g, past.m) | (wrong & (margin(past.g, past.m) <= 0)))
        here = self._settled(attrs.evolve(past, m=frozen.turned(past.g, past.m, which)), which)
        if here is not None and frozen.remember is not None:
            here = self._remembered(here, which)
        return None if here is None else (here, which | (here.m != past.m))

    def _remembered(self, here: Point, crossed: np.ndarray) -> Point | None:
        """Update memory at an event, and again as long as memory or modes follow from what was updated."""
        first: Point | None = None
        u = self._inputs(here.t, self.h)[0, 0]
        for _ in range(len(here.d) + 1):
            old, memory = here, self.frozen.memory(here.x, here.d, here.m, self.like)
            d, x = self.frozen.remember(old.t, memory.x, memory.d, u, [], memory.p)
            d, x = np.asarray(d).ravel(), np.asarray(x).ravel()
            made = self._settled(attrs.evolve(old, d=d, x=x), crossed)
            if made is None:
                return None
            here, first = made, first or made
            if all(np.array_equal(getattr(here, k), getattr(old, k)) for k in "dxm"):
                return here
        return first  # no fixed point: a relay that feeds itself, or memory that counts

    def _settled(self, here: Point, crossed: np.ndarray) -> Point | None:
        """Change the switches that jump with those that crossed, whose own g may be off by rounding."""
        for _ in range(2 * len(crossed) + 2):
            seen = self._part(here, here.t)
            if seen is None:
                return None
            wrong = self.frozen.wrong(seen.g, seen.m) & (~crossed | (seen.g == 0))
            if not wrong.any():
                return seen
            here = attrs.evolve(seen, m=self.frozen.turned(seen.g, seen.m, self.frozen.first(wrong)))
        return None
