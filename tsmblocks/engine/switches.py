"""Equations whose switches are decided from outside, so that they are smooth within a step.

Every abs, sign, min, max and comparison on a moving signal is a switch. Rewritten, it takes its branch
from a mode, an extra element of memory, and its switching function g is logged: a for abs(a) and
sign(a), a - b for min(a, b) and max(a, b), b - a for a < b and a <= b. A mode is 1 where g is positive,
-1 where it is negative, and 0 for the sign of a signal that rests at zero.
"""

from __future__ import annotations

import functools
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.engine.kernels import Kernel, Memory, kernel_for
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import Plan
from tsmblocks.engine.program import Program
from tsmblocks.equations import Equations

WORDS = {"FABS": "abs", "SIGN": "sign", "FMIN": "min", "FMAX": "max", "LT": "<", "LE": "<="}
BAND = 4e-15
"""A difference this small against its terms is rounding, and counts as zero."""


@attrs.frozen(eq=False)
class Frozen:
    """Kernels of the frozen equations: ``whole`` for grid steps, with updates; ``part`` for parts of one.

    A row of ``whole`` holds the logged signals, then x, d, g, and g before the update of its instant.
    ``remember(t, x, d, u, q, p) -> (d, x)`` updates memory at an event (None: nothing to update).
    ``edge`` is the mode of each comparison at g = 0, NaN where zero fits either mode.
    """

    whole: Kernel
    part: Kernel
    remember: Any
    names: tuple[tuple[str, str], ...]
    edge: np.ndarray
    fresh: np.ndarray
    spare: np.ndarray

    def wrong(self, g: np.ndarray, m: np.ndarray) -> np.ndarray:
        """Which switches contradict their modes."""
        on_edge = (g == 0) & ~np.isnan(self.edge) & (m != self.edge)
        return on_edge | ((g != 0) & ((m == 0) | ((g > 0) != (m > 0))))

    def memory(self, x: np.ndarray, d: np.ndarray, m: np.ndarray, like: Memory) -> Memory:
        """Arrays a kernel may work on."""
        return Memory(x.copy(), np.concatenate([d, m, self.spare]), like.p, like.ring, like.mask)


def margin(g: np.ndarray, m: np.ndarray) -> np.ndarray:
    """How far each switch is from turning over; negative once it should have. Mode 0 holds at g = 0 only."""
    return np.where(m == 0, -np.abs(g), np.where(m > 0, g, -g))


def turned(g: np.ndarray, m: np.ndarray, which: np.ndarray) -> np.ndarray:
    """The modes with some switches turned over."""
    return np.where(which, np.where(m == 0, np.sign(g), -m), m)


@functools.lru_cache(maxsize=64)
def freeze(eq: Equations, method: Method, y: tuple[int, ...], backend: str) -> Frozen | None:
    """Kernels of the equations with frozen switches (kept); None when there is no switch."""
    t, x, d, u, q, p = symbols = eq.rhs.sx_in()
    calm = eq.update.call([*symbols, ca.SX.zeros(len(eq.periods))]) if eq.every_step else []
    program = Program(ca.Function("all", symbols, [*eq.rhs.call(symbols)[:2], *calm], ["t", "x", "d", "u", "q", "p"],
                                  ["dx", "y", "d_next", "x_next"][: 2 + len(calm)]))  # fmt: skip
    grade = program.grade({0: 1, 1: 2, 2: 0, 3: 2, 4: 2, 5: 0})
    used = program.needed(n for (slot, _), n in program.outputs.items() if slot < 2)
    switches = [n for n in sorted(used) if program.nodes[n][0] in WORDS and grade[n]]
    if not switches:
        return None
    n, spare = len(switches), len(switches) if eq.update is not None else 0
    memory = ca.SX.sym("d", len(eq.d) + n + spare)
    old, modes = memory[: len(eq.d)], memory[len(eq.d) : len(eq.d) + n]
    g, values = _rewritten(program, [t, x, old, u, q, p], dict(zip(switches, ca.vertsplit(modes), strict=True)), grade)
    out = [_column(program, values, slot, size) for slot, size in enumerate([len(eq.x), len(eq.y), len(eq.d), len(eq.x)])]
    inputs, labels = [t, x, memory, u, q, p], ["t", "x", "d", "u", "q", "p"]
    seen = ca.vertcat(out[1], x, old, g, memory[len(eq.d) + n :])
    rhs = ca.Function("rhs", inputs, [out[0], seen, ca.SX(0, 1)], labels, ["dx", "y", "s"])
    update = None
    if eq.update is not None:  # plain, and at each step, since g is wanted before it
        hit = ca.SX.sym("hit", len(eq.periods))
        fresh, moved = eq.update.call([t, x, old, u, q, p, hit])
        update = ca.Function("update", [*inputs, hit], [ca.vertcat(fresh, modes, g), moved], [*labels, "hit"],
                             ["d_next", "x_next"])  # fmt: skip
    kinds = [program.nodes[k][0] for k in switches]
    first_g = len(eq.y) + len(eq.x) + len(eq.d)
    whole = _plan(eq, method, rhs, update, (*y, *range(len(eq.y), seen.shape[0])), memory.shape[0])
    part = _plan(eq, method, rhs, None, tuple(range(first_g, first_g + n)), memory.shape[0])
    return Frozen(
        kernel_for(whole, backend), kernel_for(part, backend),
        ca.Function("remember", inputs, out[2:], labels, ["d", "x"]) if calm else None,
        tuple(zip(_owners(eq, program, switches), (WORDS[k] for k in kinds), strict=True)),
        np.array([{"LE": 1.0, "LT": -1.0}.get(k, np.nan) for k in kinds]),
        np.array([{"SIGN": 0.0, "LT": -1.0}.get(k, 1.0) for k in kinds]), np.zeros(spare),
    )  # fmt: skip


def _plan(eq: Equations, method: Method, rhs: Any, update: Any, y: tuple[int, ...], memory: int) -> Plan:
    # Not fused: a memory and the signal it was taken from must differ by exactly nothing.
    return Plan(rhs=rhs, update=update, lag=eq.lag, method=method, y=y, groups=len(eq.periods) if update else 0,
                every_step=update is not None, lanes=1, wide_x=(False,) * len(eq.x), wide_d=(False,) * memory,
                wide_p=(False,) * len(eq.p), wide_s=(), inputs=len(eq.u), fused=False)  # fmt: skip


def _rewritten(program: Program, symbols: list[Any], modes: dict[int, Any], grade: list[int]) -> tuple[Any, list[Any]]:
    """Switching functions, and the value of every node with the switches decided by modes."""
    g, values = [], []
    for node, (name, args) in enumerate(program.nodes):
        if name == "CONST":
            values.append(ca.SX(args[0]))
        elif name == "INPUT":
            values.append(symbols[args[0]][args[1]])
        elif node in modes:
            a, b = values[args[0]], values[args[-1]]
            on = modes[node] > 0
            values.append({"FABS": lambda: modes[node] * a, "SIGN": lambda: modes[node],
                           "FMIN": lambda: ca.if_else(on, b, a), "FMAX": lambda: ca.if_else(on, a, b)}
                          .get(name, lambda: on)())  # fmt: skip
            gap = a if len(args) == 1 else a - b if name in ("FMIN", "FMAX") else b - a
            size = sum(_size(program, values, k) for k in args)
            g.append(ca.if_else(ca.fabs(gap) < BAND * size, 0, gap) if grade[node] > 1 else gap)
        else:
            make = ca.SX.unary if len(args) == 1 else ca.SX.binary
            values.append(make(getattr(ca, f"OP_{name}"), *(values[j] for j in args)))
    return ca.vertcat(*g), values


def _size(program: Program, values: list[Any], node: int) -> Any:
    """What rounding in a node is in proportion to."""
    name, args = program.nodes[node]
    return sum(ca.fabs(values[j]) for j in args) if name in ("ADD", "SUB") else ca.fabs(values[node])


def _column(program: Program, values: list[Any], slot: int, size: int) -> Any:
    nodes = [program.outputs.get((slot, k)) for k in range(size)]
    return ca.vertcat(*(0 if n is None else values[n] for n in nodes)) if nodes else ca.SX(0, 1)


def _owners(eq: Equations, program: Program, switches: list[int]) -> list[str]:
    """The block of each switch: its rates or outputs depend on it, while nothing it reads does."""
    bit, reach = {n: 1 << k for k, n in enumerate(switches)}, [0] * len(program.nodes)
    for node in range(len(program.nodes)):
        reach[node] = functools.reduce(lambda r, j: r | reach[j], program.arguments(node), bit.get(node, 0))
    names = ([(0, k, name) for k, name in enumerate(eq.x)], [(1, k, name) for k, name in enumerate(eq.y)])
    signals = {name: reach[program.outputs[s, k]] for s, k, name in names[1] if (s, k) in program.outputs}
    owners = [""] * len(switches)
    for s, k, name in (*names[0], *names[1]):
        block = name.rpartition(".")[0]
        if block in eq.reads and (s, k) in program.outputs:
            given = functools.reduce(lambda r, j: r | signals.get(j, 0), eq.reads[block][1].values(), 0)
            own = reach[program.outputs[s, k]] & ~given
            owners = [o or (block if own >> i & 1 else "") for i, o in enumerate(owners)] if own else owners
    return owners
