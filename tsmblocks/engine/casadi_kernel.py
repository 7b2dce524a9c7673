"""The same kernels without a compiler: CasADi evaluates one step at a time. Slower, same results."""

from __future__ import annotations

import threading
from math import isfinite
from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.kernel_frame import JUMP_OFFSETS, KernelFrame
from tsmblocks.engine.plan import Layout, Plan


class CasadiKernel(Kernel):
    """Steps through CasADi's virtual machine; lanes are columns of a mapped function."""

    def __init__(self, plan: Plan) -> None:
        frame = KernelFrame(plan, "")
        super().__init__(frame)
        self.jumps = frame.jumps
        self.lanes = plan.lanes
        simple = plan.lanes == 1 and plan.update is None and not plan.wide_s
        self.quick = _SimpleStep(plan, frame.jumps) if simple else None
        if not simple:
            self.step = _BufferedCall(_one_step(plan, frame.jumps), plan.lanes) if not plan.wide_s else None
            self.rhs = _BufferedCall(plan.rhs, plan.lanes)
            self.update = _BufferedCall(plan.update, plan.lanes) if plan.update is not None else None
        self.lock = threading.Lock()  # the buffers of a call are shared

    def advance(
        self,
        memory: Memory,
        u: np.ndarray,
        *,
        t0: float,
        h: float,
        k0: int,
        n: int,
        final: bool,
        every: int,
        skip: int,
        hits: tuple[int, ...],
        y: np.ndarray,
    ) -> None:
        with self.lock:
            if self.quick is not None:
                self.quick.advance(memory, u, t0, h, k0, n + (1 if final else 0), n, every, skip, y)
                return
            self._advance(memory, u, t0, h, k0, n + (1 if final else 0), n, every, skip, hits, y)

    def _advance(
        self,
        memory: Memory,
        u: np.ndarray,
        t0: float,
        h: float,
        k0: int,
        count: int,
        n: int,
        every: int,
        skip: int,
        hits: tuple[int, ...],
        y: np.ndarray,
    ) -> None:
        plan = self.plan
        x, d, p = (
            _open(a, lay)
            for a, lay in ((memory.x, self.layout_x), (memory.d, self.layout_d), (memory.p, self.layout_p))
        )
        past = _DelayLine(self, memory, p, t0, h) if plan.wide_s else None
        row, left = 0, skip
        for k in range(count):
            t, kg = t0 + (k0 + k) * h, k0 + k
            q = past.at(kg, 0.0) if past else np.empty((0, self.lanes))
            if self.update is not None:
                hit = np.array([[float(kg % each == 0)] for each in hits]).reshape(-1, 1)
                if plan.every_step or hit.any():
                    d, x = self.update(t, x, d, u[k, 0][:, None], q, p, hit)
            dx, out, s = self.rhs(t, x, d, u[k, 0][:, None], q, p)
            if plan.watched and len(plan.y) < len(out) and not (sound := np.isfinite(out).all(axis=0)).all():
                # CasADi's min and max drop a NaN, so the row is marked for the caller. Other lanes continue.
                x, out = np.where(sound, x, np.nan), np.where(sound, out, np.nan)
            if left == 0:
                _shut(y[row], self.layout_y, out[list(plan.y)])
                row, left = row + 1, every
            left -= 1
            if k == n:
                break
            if self.step is not None:
                (x,) = self.step(t, h, x, d, u[k].reshape(-1, 1), p)
            else:
                assert past is not None
                past.keep(kg, s)
                x = self._stages(past, kg, t, h, x, d, u[k], p, dx)
        _shut(memory.x, self.layout_x, x)
        _shut(memory.d, self.layout_d, d)

    def _stages(
        self, past: _DelayLine, k: int, t: float, h: float, x: Any, d: Any, u: Any, p: Any, first: Any
    ) -> np.ndarray:
        """One step with delays, which are read at each stage."""
        method, rates = self.plan.method, [first]
        for row, offset in zip(method.rows[1:], method.offsets[1:], strict=True):
            ahead = x
            for a, s in zip(row, rates, strict=True):
                ahead = ahead + h * a * s if a else ahead  # summed in the order of _one_step, to the same bits
            inputs = u[method.instants.index(offset)][:, None]
            rates.append(self.rhs(_at(t, h, offset, self.jumps), ahead, d, inputs, past.at(k, offset), p)[0])
        return np.asarray(x + sum(h * b * s for b, s in zip(method.weights, rates, strict=True)))


class _SimpleStep:
    """A step and its outputs as one function on fixed buffers: a single run without samples and delays."""

    def __init__(self, plan: Plan, jumps: bool) -> None:
        step = _one_step(plan, jumps)
        t, _, x, d, u, p = given = step.sx_in()
        q = ca.SX(plan.rhs.size1_in(plan.rhs.index_in("q")), 1)
        everything = plan.rhs(t, x, d, u[: plan.inputs], q, p)[1]
        unseen = ca.sum1(everything) if plan.watched and len(plan.y) < everything.shape[0] else ca.SX(0.0)
        made = ca.cse([step.call(given)[0], everything[list(plan.y)], unseen])
        f = ca.Function("quick", given, [ca.densify(v) for v in made])
        self.t, self.h, self.x, self.d, self.u, self.p = self.arrays = [np.zeros(v.shape[0]) for v in given]
        self.ahead, self.y, self.total = np.zeros(x.shape[0]), np.zeros(len(plan.y)), np.zeros(1)
        self.buffer, self.trigger = _bound(f, self.arrays, [self.ahead, self.y, self.total])

    def advance(
        self,
        memory: Memory,
        u: np.ndarray,
        t0: float,
        h: float,
        k0: int,
        count: int,
        n: int,
        every: int,
        skip: int,
        y: np.ndarray,
    ) -> None:
        """Take the steps, as ``Kernel.advance``."""
        t, x, ahead, out, total, trigger = self.t, self.x, self.ahead, self.y, self.total, self.trigger
        row, left = 0, skip
        x[:], self.d[:], self.p[:], self.h[0] = memory.x, memory.d, memory.p, h
        for k in range(count):
            t[0] = t0 + (k0 + k) * h
            if len(self.u):
                self.u[:] = u[k].ravel()
            trigger()
            if not isfinite(total[0]):
                ahead[:] = out[:] = np.nan  # CasADi's min and max drop a NaN, so the row is marked for the caller
            if left == 0:
                y[row] = out
                row, left = row + 1, every
            left -= 1
            if k < n:
                x[:] = ahead
        memory.x[:] = x


class _DelayLine:
    """The ring of delayed signals, read and written as the compiled kernels do."""

    def __init__(self, kernel: CasadiKernel, memory: Memory, p: np.ndarray, t0: float, h: float) -> None:
        self.layout, self.ring, self.mask, self.t0, self.h = kernel.layout_s, memory.ring, memory.mask, t0, h
        self.lanes = kernel.lanes
        (tau,) = _BufferedCall(kernel.plan.lag, kernel.lanes)(p)
        self.delay = tau / h
        size = memory.mask + 1
        self.parts = []
        for k, wide in enumerate(self.layout.wide):
            width = self.lanes if wide else 1
            begin = size * self.layout.offset[k]
            self.parts.append(self.ring[begin : begin + size * width].reshape(size, width))

    def keep(self, k: int, s: np.ndarray) -> None:
        for part, value in zip(self.parts, s, strict=True):
            part[k & self.mask] = value[: part.shape[1]]

    def at(self, k: int, offset: float) -> np.ndarray:
        last = k - 1 if offset == 0 else k
        made = np.empty((DELAY_NUMBERS * len(self.parts), self.lanes))
        for j, part in enumerate(self.parts):
            m = np.floor(k + offset - self.delay[j]).astype(int)
            n = np.minimum(np.where(m < 0, 0, np.maximum(m + 2, DELAY_SAMPLES - 1)), last)
            newest = np.maximum(n, 0)
            columns = np.arange(self.lanes) if part.shape[1] > 1 else np.zeros(self.lanes, dtype=int)
            kept = [part[(newest - back) & self.mask, columns] for back in reversed(range(DELAY_SAMPLES))]
            made[DELAY_NUMBERS * j : DELAY_NUMBERS * (j + 1)] = [
                *kept,
                self.t0 + newest * self.h,
                np.full(self.lanes, 1 / self.h),
                n + 1.0,
            ]
        return made


class _BufferedCall:
    """A CasADi function on columns of lanes, called through its buffers."""

    def __init__(self, function: Any, lanes: int) -> None:
        self.f = function if lanes == 1 else function.map(lanes)
        self.inputs = [np.zeros(function.size_in(k)[0] * lanes) for k in range(function.n_in())]
        self.outputs = [np.zeros((lanes, function.size_out(k)[0])) for k in range(function.n_out())]
        self.lanes = lanes
        self.f = _dense(self.f)
        self.buffer, self.trigger = _bound(self.f, self.inputs, [a.reshape(-1) for a in self.outputs])

    def __call__(self, *values: Any) -> list[np.ndarray]:
        for a, value in zip(self.inputs, values, strict=True):
            if len(a):
                a.reshape(self.lanes, -1)[:] = np.asarray(value).T if np.ndim(value) else value
        self.trigger()
        return [a.T.copy() for a in self.outputs]


def _bound(f: Any, inputs: list[Any], outputs: list[Any]) -> tuple[Any, Any]:
    """A function bound to arrays: a buffer that must be kept alive, and the call that fills the outputs."""
    buffer, trigger = f.buffer()
    for k, a in enumerate(inputs):
        buffer.set_arg(k, memoryview(a))
    for k, a in enumerate(outputs):
        buffer.set_res(k, memoryview(a))
    return buffer, trigger


def _dense(f: Any) -> Any:
    """The function with every output dense, so that buffers line up."""
    ins = [ca.MX.sym(f.name_in(k), *f.size_in(k)) for k in range(f.n_in())]
    return ca.Function("dense", ins, [ca.densify(v) for v in f.call(ins)])


def _one_step(plan: Plan, jumps: bool) -> Any:
    """One step of the method as one function of t, h, x, d, u (at all instants), p."""
    f, method, count = plan.rhs, plan.method, plan.inputs
    t, h = ca.SX.sym("t"), ca.SX.sym("h")
    x, d, p = (ca.SX.sym(k, f.size1_in(f.index_in(k))) for k in ("x", "d", "p"))
    u = ca.SX.sym("u", count * len(method.instants))
    q = ca.SX(f.size1_in(f.index_in("q")), 1)
    rates: list[Any] = []
    for row, offset in zip(method.rows, method.offsets, strict=True):
        ahead = x
        for a, s in zip(row, rates, strict=True):
            ahead = ahead + h * a * s if a else ahead
        i = method.instants.index(offset)
        rates.append(f(_at(t, h, offset, jumps), ahead, d, u[i * count : (i + 1) * count], q, p)[0])
    new = x + sum(h * b * s for b, s in zip(method.weights, rates, strict=True))
    return ca.Function("step", [t, h, x, d, u, p], ca.cse([new]))


def _at(t: Any, h: Any, offset: float, jumps: bool) -> Any:
    """The time of a stage; the end of a step is moved just before a jump with time (``JUMP_OFFSETS``)."""
    time = t + offset * h
    hair = ca.fmin(JUMP_OFFSETS[0] * h + JUMP_OFFSETS[1] * ca.fabs(time), JUMP_OFFSETS[2] * h)
    return time - hair if jumps and offset == 1 else time


def _open(flat: np.ndarray, layout: Layout) -> np.ndarray:
    """A kernel's array as rows of lanes."""
    made = np.empty((len(layout.wide), layout.lanes))
    for k in range(len(layout.wide)):
        made[k] = flat[layout.span(k)]
    return made


def _shut(flat: np.ndarray, layout: Layout, rows: np.ndarray) -> None:
    """Rows of lanes back into a kernel's array."""
    for k, wide in enumerate(layout.wide):
        flat[layout.span(k)] = rows[k] if wide else rows[k, 0]
