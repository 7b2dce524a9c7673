"""Equations whose switches are decided from outside, so that they are smooth within a step.

Every abs, sign, min, max and comparison on a moving signal is a switch. Rewritten, it takes its branch
from a mode, an extra element of memory, and its switching function g is logged: a for abs(a) and
sign(a), a - b for min(a, b) and max(a, b), b - a for a < b and a <= b. A mode is 1 where g is positive,
-1 where it is negative, and 0 for the sign of a signal that rests at zero.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.engine.kernels import Kernel, Memory, kernel_for
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import Plan
from tsmblocks.engine.program import Program
from tsmblocks.equation_set import Equations

WORDS = {"FABS": "abs", "SIGN": "sign", "FMIN": "min", "FMAX": "max", "LT": "<", "LE": "<="}
EDGE = {"LE": 1.0, "LT": -1.0}
"""What a comparison is at g = 0; the others may be either."""
FRESH = {"SIGN": 0.0, "LT": -1.0}
"""Modes to begin with, where g = 0; 1 for the others."""
BAND = 4e-15
"""A difference this small against its terms is rounding, and counts as zero."""
ALWAYS = True
LABELS = ["t", "x", "d", "u", "q", "p"]


@attrs.frozen(eq=False)
class Frozen:
    """Kernels of the frozen equations: ``whole`` for steps on the grid, ``part`` for parts of one, without updates.

    A row of ``whole`` holds the logged signals, then x, d and g, and where there are updates g before
    the update at its instant; one of ``part`` holds g. ``remember(t, x, d, u, q, p) -> (d, x)`` updates
    memory at an event (None where nothing is updated between samples). ``names`` gives the block and the
    word of each switch.
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
        """Arrays that a kernel may work on."""
        return Memory(x.copy(), np.concatenate([d, m, self.spare]), like.p, like.ring, like.mask)


def margin(g: np.ndarray, m: np.ndarray) -> np.ndarray:
    """How far each switch is from turning over; negative once it should have. Mode 0 holds at g = 0 only."""
    return np.where(m == 0, -np.abs(g), np.where(m > 0, g, -g))


def turned(g: np.ndarray, m: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Modes with some switches turned over."""
    return np.where(which, np.where(m == 0, np.sign(g), -m), m)


@functools.lru_cache(maxsize=64)
def freeze(eq: Equations, method: Method, y: tuple[int, ...], backend: str) -> Frozen | None:
    """Kernels of the equations with frozen switches (kept); None when there is no switch.

    Updates on the grid stay plain, and run at every step, since g is wanted before them.
    """
    program, switches, timed = _switches(eq)
    if not switches:
        return None
    count, held = len(switches), len(eq.d)
    t, x, u, q, p = (ca.SX.sym(k, eq.rhs.size1_in(eq.rhs.index_in(k))) for k in "txuqp")
    d = ca.SX.sym("d", held + count * (1 if eq.update is None else 2))
    parts = ca.vertsplit(d)
    old, modes, before = _column(parts[:held]), parts[held : held + count], parts[held + count :]
    values, g = _rewritten(program, [t, x, old, u, q, p], dict(zip(switches, modes, strict=True)), timed)
    dx, shown, fresh, moved = (
        _column(
            [0 if n is None else values[n] for n in (program.outputs.get((slot, k)) for k in range(size))]
        )
        for slot, size in enumerate((len(eq.x), len(eq.y), held, len(eq.x)))
    )
    inputs, seen = [t, x, d, u, q, p], ca.vertcat(shown, x, old, g, _column(before))
    rhs = ca.Function("rhs", inputs, [dx, seen, ca.SX(0, 1)], LABELS, ["dx", "y", "s"])
    update = None
    if eq.update is not None:
        hit = ca.SX.sym("hit", len(eq.periods))
        plain = eq.update.call([t, x, old, u, q, p, hit])
        update = ca.Function("update", [*inputs, hit], [ca.vertcat(plain[0], *modes, g), plain[1]],
                             [*LABELS, "hit"], ["d_next", "x_next"])  # fmt: skip
    first = len(eq.y) + len(eq.x) + held
    kinds = [program.nodes[n][0] for n in switches]
    return Frozen(
        whole=kernel_for(_plan(eq, method, rhs, update, [*y, *range(len(eq.y), seen.shape[0])]), backend),
        part=kernel_for(_plan(eq, method, rhs, None, range(first, first + count)), backend),
        remember=ca.Function("remember", inputs, [fresh, moved]) if eq.every_step else None,
        names=tuple(zip(_owners(eq, program, switches), (WORDS[k] for k in kinds), strict=True)),
        edge=np.array([EDGE.get(k, np.nan) for k in kinds]),
        fresh=np.array([FRESH.get(k, 1.0) for k in kinds]),
        spare=np.zeros(len(before)),
    )


def _switches(eq: Equations) -> tuple[Program, list[int], set[int]]:
    """Rates, signals and updates between samples as one program; its switches, and those on time alone."""
    symbols = eq.rhs.sx_in()
    values, names = eq.rhs.call(symbols)[:2], ["dx", "y"]
    if eq.every_step:
        values = [*values, *eq.update.call([*symbols, ca.SX.zeros(len(eq.periods))])]
        names = [*names, "d_next", "x_next"]
    program = Program(ca.Function("all", symbols, values, LABELS, names))
    moving = program.grade({0: 1, 1: 2, 2: 0, 3: 2, 4: 2, 5: 0})
    needed = program.needed(n for (slot, _), n in program.outputs.items() if slot < 2)
    switches = [n for n in sorted(needed) if program.nodes[n][0] in WORDS and moving[n]]
    return program, switches, {n for n in switches if moving[n] == 1}


def _plan(eq: Equations, method: Method, rhs: Any, update: Any, y: Sequence[int]) -> Plan:
    # Not fused: a memory and the signal it was taken from must differ by exactly nothing.
    memory = rhs.size1_in(rhs.index_in("d"))
    return Plan(
        rhs=rhs, update=update, lag=eq.lag, method=method, y=tuple(y),
        groups=0 if update is None else len(eq.periods), every_step=update is not None, lanes=1,
        wide_x=(False,) * len(eq.x), wide_d=(False,) * memory, wide_p=(False,) * len(eq.p), wide_s=(),
        inputs=len(eq.u), fused=False,
    )  # fmt: skip


def _rewritten(
    program: Program, symbols: list[Any], modes: dict[int, Any], timed: set[int]
) -> tuple[list[Any], Any]:
    """The value of every node with its switches decided by modes, and the switching functions.

    Where a switch has no effect for now, its switching function is its mode, which agrees with it.
    """
    values: list[Any] = []
    gaps: dict[int, Any] = {}
    for node, (name, args) in enumerate(program.nodes):
        if name == "CONST":
            values.append(ca.SX(args[0]))
        elif name == "INPUT":
            values.append(symbols[args[0]][args[1]])
        elif node in modes:
            given = [values[j] for j in args]
            values.append(_decided(name, modes[node], *given))
            gap = given[0] if len(args) == 1 else given[1] - given[0] if name in EDGE else given[0] - given[1]
            size = sum(_size(program, values, j) for j in args)
            gaps[node] = gap if node in timed else ca.if_else(ca.fabs(gap) < BAND * size, 0, gap)
        else:
            make = ca.SX.unary if len(args) == 1 else ca.SX.binary
            values.append(make(getattr(ca, f"OP_{name}"), *(values[j] for j in args)))
    when = _when_used(program, values)
    g = [gap if when[n] is ALWAYS else ca.if_else(when[n], gap, modes[n]) for n, gap in gaps.items()]
    return values, ca.vertcat(*g)


def _when_used(program: Program, values: list[Any]) -> list[Any]:
    """When each node has an effect: ALWAYS, or a condition where only branches read it; None for never."""
    when: list[Any] = [None] * len(values)
    for node in program.outputs.values():
        when[node] = ALWAYS
    for node in reversed(range(len(values))):
        if when[node] is None:
            continue
        given = program.arguments(node)
        if program.nodes[node][0] == "IF_ELSE_ZERO":
            taken = values[given[0]]
            condition = taken if when[node] is ALWAYS else ca.logic_and(when[node], taken)
            when[given[1]] = _either(when[given[1]], condition)
            given = given[:1]
        for j in given:
            when[j] = _either(when[j], when[node])
    return when


def _either(a: Any, b: Any) -> Any:
    if a is ALWAYS or b is ALWAYS:
        return ALWAYS
    return b if a is None else ca.logic_or(a, b)


def _decided(name: str, mode: Any, a: Any, b: Any = None) -> Any:
    """A switch's value in a mode."""
    if name == "FABS":
        return mode * a
    if name == "SIGN":
        return mode
    if name in EDGE:
        return mode > 0
    return ca.if_else(mode > 0, b, a) if name == "FMIN" else ca.if_else(mode > 0, a, b)


def _size(program: Program, values: list[Any], node: int) -> Any:
    """Size that rounding in a node goes by: its terms, if it is a sum."""
    name, args = program.nodes[node]
    return sum(ca.fabs(values[j]) for j in (args if name in ("ADD", "SUB") else [node]))


def _column(elements: list[Any]) -> Any:
    return ca.vertcat(*elements) if elements else ca.SX(0, 1)


def _owners(eq: Equations, program: Program, switches: list[int]) -> list[str]:
    """The block of each switch: its rates or outputs depend on the switch, while nothing it reads does."""
    bit = {n: 1 << k for k, n in enumerate(switches)}
    reach: list[int] = []  # which switches each node depends on, a bit for each
    for node in range(len(program.nodes)):
        reach.append(_union([bit.get(node, 0), *(reach[j] for j in program.arguments(node))]))
    signals = {name: reach[program.outputs[1, k]] for k, name in enumerate(eq.y) if (1, k) in program.outputs}
    rates = {name: reach[program.outputs[0, k]] for k, name in enumerate(eq.x) if (0, k) in program.outputs}
    owners = [""] * len(switches)
    for name, found in (*rates.items(), *signals.items()):
        block = name.rpartition(".")[0]
        if found and block in eq.reads:
            own = found & ~_union(signals.get(k, 0) for k in eq.reads[block][1].values())
            for k in range(own.bit_length()):
                if own >> k & 1 and not owners[k]:
                    owners[k] = block
    return owners


def _union(sets: Any) -> int:
    return functools.reduce(int.__or__, sets, 0)
