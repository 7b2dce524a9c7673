"""The same kernels without a compiler: CasADi evaluates one step at a time. Slower, same results."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan
from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.common.fork_locks import RenewedLock
from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.kernel_frame import JUMP_OFFSETS, KernelFrame
from tsmblocks.engine.loops import STATISTICS, Loop, region
from tsmblocks.engine.plan import Layout, Plan

COMMON = ("t", "h", "u", "hit")
"""Arguments that all lanes have in common."""


class CasadiKernel(Kernel):
    """Steps through CasADi's virtual machine; lanes are columns of a mapped function.

    The functions work on arrays that they share, with a row for each lane where lanes differ: ``signals`` forms the
    signals of an instant and, where no signal is delayed, takes the step as well; with delays ``step`` does, once the
    signals are stored.
    """

    def __init__(self, plan: Plan) -> None:
        frame = KernelFrame(plan, "")
        super().__init__(frame)
        symbols, expressions = _expressions(plan, frame.jumps)
        self.arrays: dict[str, Any] = {
            k: np.zeros(v.shape[0] if k in COMMON else (plan.lanes, v.shape[0]))
            for k, v in (symbols | expressions).items()
        }
        self.bound: list[Any] = []  # buffers, which must be kept alive

        def function(*results: str, loops: str) -> Any:
            """A call without arguments that sets the arrays of these results, and takes over the solutions of loops."""
            results = (*results, loops) if plan.loops else results
            made = ca.cse([ca.densify(expressions[k]) for k in results])
            f = ca.Function("f", list(symbols.values()), made)
            buffer: Any
            common = [k for k, name in enumerate(symbols) if name in COMMON]
            buffer, call = (f if plan.lanes == 1 else f.map("lanes", "serial", plan.lanes, common, [])).buffer()
            for bind, names in ((buffer.set_arg, symbols), (buffer.set_res, results)):
                for k, name in enumerate(names):
                    bind(k, memoryview(self.arrays[name].reshape(-1)))
            self.bound.append(buffer)

            def solve() -> None:
                call()
                self.arrays["loops"][:] = self.arrays[loops]

            return solve if plan.loops else call

        here = ("y", "s")
        alone = {"loops": "loops_here"} if plan.wide_s else {"loops": "loops_ahead"}
        self.signals = function(*here, *(() if plan.wide_s else ("ahead",)), **alone)
        self.step: Any = function("ahead", loops="loops_ahead") if plan.wide_s else None
        self.update: Any = function("new_d", "new_x", loops="new_loops") if plan.update is not None else None
        self.lag: Any = plan.lag.map(plan.lanes) if plan.wide_s else None
        layouts = (self.layout_x, self.layout_d, self.layout_p, self.layout_y)
        self.places = {name: _places(layout) for name, layout in zip("xdpy", layouts, strict=True)}
        self.places["loops"] = _places(self.layout_loops)
        self.lock = RenewedLock()  # the arrays are shared between runs

    def advance(self, memory: Memory, u: np.ndarray, y: np.ndarray, steps: Steps) -> None:
        with self.lock:
            self._advance(memory, u, y, steps)

    def _advance(self, memory: Memory, u: np.ndarray, y: np.ndarray, steps: Steps) -> None:
        a, first, last, t0, h = self.arrays, steps.k0, steps.k0 + steps.n, steps.t0, steps.h
        for name in ("x", "d", "p", "loops"):
            a[name][:] = getattr(memory, name)[self.places[name][0]]
        a["h"].fill(h)
        past = _DelayLine(self, memory, steps) if self.step is not None else None
        x, ahead, logged = (a[name].reshape(-1) for name in ("x", "ahead", "y"))
        t, inputs, rows, order = a["t"], a["u"], u.reshape(len(u), -1), self.places["y"][1]
        signals, update, row, left, every = self.signals, self.update, 0, steps.skip, steps.every
        driven, alone = rows.size > 0, self.plan.lanes == 1
        for k in range(first, last + (1 if steps.final else 0)):
            t[0] = t0 + k * h
            if driven:
                inputs[:] = rows[k - first]
            if past is not None:
                past.read(k, 0.0)
            if update is not None:
                self._update(k, steps.hits)
            signals()
            if left == 0:
                y[row] = logged if alone else logged[order]
                row, left = row + 1, every
            left -= 1
            if k < last:
                if past is not None:
                    past.store(k)
                    self.step()
                x[:] = ahead
        for name in ("x", "d", "loops"):
            getattr(memory, name)[:] = a[name].reshape(-1)[self.places[name][1]]

    def _update(self, k: int, hits: tuple[int, ...]) -> None:
        """Update memory and states where something is sampled at this instant."""
        a = self.arrays
        a["hit"][:] = [k % each == 0 for each in hits]
        if self.plan.every_step or a["hit"].any():
            self.update()
            a["d"][:], a["x"][:] = a["new_d"], a["new_x"]


class _DelayLine:
    """The ring of delayed signals, read and written as the compiled kernels do."""

    def __init__(self, kernel: CasadiKernel, memory: Memory, steps: Steps) -> None:
        self.arrays, self.mask, self.t0, self.h = kernel.arrays, memory.mask, steps.t0, steps.h
        self.delay = np.asarray(kernel.lag(self.arrays["p"].T)) / steps.h
        self.instants = kernel.plan.method.instants
        layout, size = kernel.layout_s, memory.mask + 1
        spans = map(layout.span, range(len(layout.wide)))
        self.rings = [memory.ring[size * span.start : size * span.stop].reshape(size, -1) for span in spans]

    def store(self, k: int) -> None:
        """Store the present signals; then read the past at the stages of the step."""
        for ring, value in zip(self.rings, self.arrays["s"].T, strict=True):
            ring[k & self.mask] = value[: ring.shape[1]]
        for offset in self.instants[1:]:
            self.read(k, offset)

    def read(self, k: int, offset: float) -> None:
        """Set ``q`` at a stage."""
        lanes, begin = len(self.arrays["q"]), self.instants.index(offset) * len(self.rings)
        for j, ring in enumerate(self.rings, begin):
            m = np.floor(k + offset - self.delay[j - begin]).astype(int)
            n = np.minimum(np.where(m < 0, 0, np.maximum(m + 2, DELAY_SAMPLES - 1)), k - 1 if offset == 0 else k)
            newest, columns = np.maximum(n, 0), np.arange(lanes) % ring.shape[1]
            kept = [ring[(newest - back) & self.mask, columns] for back in reversed(range(DELAY_SAMPLES))]
            per_second = np.full(lanes, 1 / self.h)
            made = np.array([*kept, self.t0 + newest * self.h, per_second, n + 1.0])
            self.arrays["q"][:, DELAY_NUMBERS * j : DELAY_NUMBERS * (j + 1)] = made.T


class Solving:
    """Calls of functions that solve loops, each from the last solutions; ``loops`` are these and their statistics."""

    def __init__(self, solved: Sequence[Loop], loops: Any) -> None:
        self.solved, self.loops = solved, loops

    def call(self, f: Any, arguments: list[Any]) -> list[Any]:
        """The results of a function, apart from the solutions."""
        if "guess" not in f.name_in():
            return list(f.call(arguments))
        parts, place = ca.vertsplit(self.loops), 0
        own, guess = [], []
        for loop in self.solved:
            if loop.function == f.name():
                own.append((place, loop.size))
                guess += parts[place : place + loop.size]
            place += region(loop)
        *results, roots = f.call([*arguments, ca.vertcat(*guess)])
        done = 0
        for place, n in own:
            *root, count = ca.vertsplit(roots[done : done + n + 1])
            done += n + 1
            times, iterations, most, failed = parts[place + n : place + n + len(STATISTICS)]
            failure = ca.if_else(root[0] <= inf, 0, 1)  # NaN is not
            statistics = [times + 1, iterations + count, ca.fmax(most, count), failed + failure]
            parts[place : place + n + len(STATISTICS)] = [*root, *statistics]
        self.loops = ca.vertcat(*parts)
        return results


def _expressions(plan: Plan, jumps: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Symbols and results of one step of the method; ``u`` and ``q`` hold values at each instant of the method.

    Results: ``ahead`` are the states after the step, ``y`` the signals to log, ``s`` those to delay; ``new_d`` and
    ``new_x`` are memory and states after an update.
    """
    method, count = plan.method, len(plan.method.instants)
    f = plan.rhs
    size = {k: f.size1_in(k) for k in "xduqp"}
    sizes = {"t": 1, "h": 1, **size, "u": count * size["u"], "q": count * size["q"], "hit": plan.groups}
    sizes["loops"] = sum(map(region, plan.loops))
    symbols = {k: ca.SX.sym(k, n) for k, n in sizes.items()}
    t, h, x, d, u, q, p, hit, loops = symbols.values()
    solving = Solving(plan.loops, loops)

    def arguments(offset: float, ahead: Any) -> list[Any]:
        """Arguments of the equations at a stage; the end of a step is moved just before a jump with time."""
        i, now = method.instants.index(offset), t + offset * h
        hair = ca.fmin(JUMP_OFFSETS[0] * h + JUMP_OFFSETS[1] * ca.fabs(now), JUMP_OFFSETS[2] * h)
        inputs, past = (v[i * size[k] : (i + 1) * size[k]] for k, v in (("u", u), ("q", q)))
        return [now - hair if jumps and offset == 1 else now, ahead, d, inputs, past, p]

    dx, y, s = solving.call(f, arguments(0.0, x))
    rates, here = [dx], solving.loops
    if plan.advance is not None:
        times = ca.vertcat(*(arguments(offset, x)[0] for offset in method.instants))
        ahead = solving.call(plan.advance, [times, h, x, d, u, q, p])[0]
    else:
        for row, offset in zip(method.rows[1:], method.offsets[1:], strict=True):
            ahead = x
            for a, rate in zip(row, rates, strict=True):
                ahead = ahead + h * a * rate if a else ahead
            rates.append(solving.call(f, arguments(offset, ahead))[0])
        ahead = x + sum(h * b * rate for b, rate in zip(method.weights, rates, strict=True))
    fault: Any = 0
    if plan.watched and len(plan.y) < y.shape[0]:
        # CasADi's min and max drop a NaN, so a fault of a signal that is not logged is passed on to those that are.
        fault = ca.if_else(ca.fabs(ca.sum1(y)) < inf, 0, nan)
    results = {"ahead": ahead + fault, "y": y[list(plan.y)] + fault, "s": s}
    results |= {"loops_here": here, "loops_ahead": solving.loops}
    if plan.update is not None:
        sampling = Solving(plan.loops, loops)
        results["new_d"], results["new_x"] = sampling.call(plan.update, [*arguments(0.0, x), hit])
        results["new_loops"] = sampling.loops
    return symbols, results


def _places(layout: Layout) -> tuple[np.ndarray, Any]:
    """Where rows of lanes have their numbers in a kernel's array, and where that array has its own in these rows."""
    each = [place + wide * np.arange(layout.lanes) for place, wide in zip(layout.offset, layout.wide, strict=True)]
    places = np.array(each, dtype=int).reshape(-1, layout.lanes).T
    return places, slice(None) if layout.lanes == 1 else np.unique(places, return_index=True)[1]
