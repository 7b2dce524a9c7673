"""Whether the step of many runs was short enough: a few of them, side by side, for a small share of all their steps."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.common.errors import RunError
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import Signal, input_rows
from tsmblocks.engine.kernel import Kernel, Steps
from tsmblocks.engine.session import Session, single_kernel, start_memory, steps_per_period
from tsmblocks.simulation.arguments import TimeGrid
from tsmblocks.simulation.lanes import lane_columns, lane_memory
from tsmblocks.simulation.repeated_steps import TINY_SIGNAL
from tsmblocks.simulation.step_check import prepared, taken
from tsmblocks.simulation.step_look import DECAY_STEPS, DOUBLED, HALVED, SHORTEST_LOOK, TOLERANCE, jump_in
from tsmblocks.simulation.stop_condition import Ended

SHARE = 0.08
"""Share of the steps of all runs that are taken to check some. Chosen: for speed."""
EACH = 3.5
"""Steps that are taken for each step checked: as it was, doubled and halved. Derived."""
MOST_NUMBERS = 4_000_000
"""Numbers that are compared, at most (32 MB). Chosen."""


@attrs.frozen(eq=False)
class SideBySide:
    """Runs with parameters ``p``, shape (parameters, lanes), by one kernel, and their inputs."""

    eq: Equations
    kernel: Kernel
    signals: list[tuple[Signal, int]]
    times: TimeGrid
    p: np.ndarray

    def wrong(self, runs: int) -> np.ndarray:
        """How far each run is off where its step is too long, else 0, shape (lanes,); ``runs`` are there in all."""
        lanes = self.p.shape[1]
        most = MOST_NUMBERS // max(self.kernel.layout_y.size, 1)
        n = min(self.times.steps, most, max(SHORTEST_LOOK, int(SHARE / EACH * self.times.steps * runs / lanes)))
        n -= n % 2
        if n < 2 or not self.kernel.plan.y:
            return np.zeros(lanes)
        given, doubled = self._rows(n, 1.0), self._doubled(n)
        if doubled is not None:
            over = np.flatnonzero((self._gaps(given[::2], doubled) > DOUBLED * TOLERANCE).any(axis=1))
            if not len(over):
                return np.zeros(lanes)
            n = min(n, 2 * (int(over[-1]) + DECAY_STEPS))
        gap = self._gaps(given[: n + 1], self._rows(n, 2.0)[::2]).max(axis=0)
        return np.where(gap > (HALVED if doubled is None else 1.0) * TOLERANCE, gap, 0.0)

    def _doubled(self, n: int) -> np.ndarray | None:
        """Signals in steps of twice the length; None where that is longer than a sample, a sample period or a delay."""
        if any(s.function is None and s.hold == "zero" and len(s.t) > 2 for s, _ in self.signals):
            return None
        try:
            return self._rows(n, 0.5)
        except RunError:
            return None

    def _rows(self, n: int, finer: float) -> np.ndarray:
        """Signals over ``n`` steps from the start, in steps ``finer`` times as short, shape (rows, signals, lanes)."""
        h, kernel, times = self.times.h / finer, self.kernel, self.times
        hits, memory = steps_per_period(self.eq, h), lane_memory(self.eq, kernel, self.p, h)
        steps = round(n * finer)
        y = np.empty((steps + 1, kernel.layout_y.size))
        u = input_rows(self.signals, times.start, h, 0, steps, kernel.plan.method.instants)
        kernel.advance(memory, u, y, Steps(times.start, h, 0, steps, True, hits))
        count = len(kernel.plan.y)
        return np.stack([lane_columns(y, kernel, k, self.p.shape[1]) for k in range(count)], axis=1)

    def _gaps(self, y: np.ndarray, other: np.ndarray) -> np.ndarray:
        """The largest difference of the signals that do not jump, as a share of their largest values, (rows, lanes)."""
        flat = y.reshape(len(y), -1)
        smooth = ~jump_in(flat[None], np.ptp(flat, axis=0)).reshape(y.shape[1:]).any(axis=1)
        scale = np.maximum(np.abs(y).max(axis=0), 1e-300)
        scale = np.maximum(scale, TINY_SIGNAL * scale.max(axis=0))
        gaps = np.abs(other - y)[:, smooth] / scale[smooth]
        gaps[~np.isfinite(y[:, smooth])] = 0.0  # a run that diverges ends there
        return np.asarray(np.where(np.isnan(gaps), np.inf, gaps).max(axis=1, initial=0.0))


def finding_of_run(side: SideBySide, lane: int, backend: str) -> str:
    """The finding of the check of one run's step: the run is made for it."""
    eq, times, p = side.eq, side.times, side.p[:, lane]
    logged = tuple(sorted({*(eq.y.index(name) for name in (*eq.x, *eq.aliases.values()))}))
    kernel = single_kernel(eq, side.kernel.plan.method, logged, backend)
    memory = start_memory(eq, kernel, p, times.h)
    session = Session(eq, kernel, memory, side.signals, times.start, times.h, 1, 0, steps_per_period(eq, times.h))
    check = prepared(session, times.steps, logged, False)
    if check is None:
        return ""
    rows, stopped = session.run(times.steps, None)
    if stopped is not None:
        return ""
    ended = Ended(rows, session, None)
    return check.finding(taken(check, ended, 0, times.start, times.h, logged, backend))
