"""Equations whose switches are decided by modes, so that they are smooth within a step.

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

from tsmblocks.engine.backends import kernel_for
from tsmblocks.engine.equations import RHS, UPDATE, Equations
from tsmblocks.engine.implicit import step_map
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.loops import solved_loops
from tsmblocks.engine.methods import Method
from tsmblocks.engine.plan import Plan, plan_for
from tsmblocks.engine.program import Program

SWITCHES = {"FABS": "abs", "SIGN": "sign", "FMIN": "min", "FMAX": "max", "LT": "<", "LE": "<="}
MODE_AT_ZERO = {"LE": 1.0, "LT": -1.0, "SIGN": 0.0}
"""Mode at g = 0; for the other switches either mode is right there."""
ROUNDING = 4e-15
"""Size of g, as a share of its terms, that counts as zero. Chosen: some 20 roundings."""
MOST_CHAINED = 8
"""Further updates of memory that depends on other memory, at most. Chosen."""
ALWAYS = True
"""Instead of a condition: a node that has an effect whatever the modes."""


@attrs.frozen(eq=False)
class Frozen:
    """Kernels of the frozen equations: ``whole`` for steps on the grid, ``part`` for parts of one.

    A row of ``whole`` holds the logged signals, then x, d and g, and where there are updates g before
    the update at its instant; a row of ``part``, which updates nothing, holds g. ``remember(t, x, d, u, q,
    p) -> (d, x)`` updates memory at an event (None where nothing is updated between samples). ``names``
    gives the block and the word of each switch, ``edge`` its mode at g = 0 (NaN where either will do),
    ``fresh`` the initial modes; ``spare`` fills the memory up; ``upstream[i, j]`` means that i depends on j.
    """

    whole: Kernel
    part: Kernel
    remember: Any
    names: tuple[tuple[str, str], ...]
    edge: np.ndarray
    fresh: np.ndarray
    spare: np.ndarray
    upstream: np.ndarray

    def wrong(self, g: np.ndarray, m: np.ndarray) -> np.ndarray:
        """Which switches contradict their modes."""
        on_edge = (g == 0) & ~np.isnan(self.edge) & (m != self.edge)
        return on_edge | ((g != 0) & ((m == 0) | ((g > 0) != (m > 0))))

    def turned(self, g: np.ndarray, m: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Modes with some switches set by g."""
        on_edge = np.where(np.isnan(self.edge), -m, self.edge)
        return np.where(which, np.where(g == 0, on_edge, np.sign(g)), m)

    def first(self, wrong: np.ndarray) -> np.ndarray:
        """Those that depend on none of the others: the ones downstream may agree once these have changed."""
        return wrong & ~self.upstream[:, wrong].any(axis=1)

    def memory(self, x: np.ndarray, d: np.ndarray, m: np.ndarray, like: Memory) -> Memory:
        """Arrays that a kernel may work on; loops of a step are others than those of the run's own kernel."""
        loops = like.loops if self.whole.plan.advance is None else np.zeros(self.whole.layout_loops.size)
        return Memory(x.copy(), np.concatenate([d, m, self.spare]), like.p, like.ring, like.mask, loops)


def margin(g: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Distance of each switch from its change; negative after it. Mode 0 is right at g = 0 only."""
    return np.where(m == 0, -np.abs(g), np.where(m > 0, g, -g))


@functools.lru_cache(maxsize=64)
def freeze(eq: Equations, method: Method, y: tuple[int, ...], backend: str) -> Frozen | None:
    """Kernels of the equations with frozen switches (kept); None when there is no switch.

    Updates on the grid are unchanged, and run at every step, since g is needed before them. Memory that depends on
    other memory is updated again, so that a chain of relays switches at once.
    """
    program, switches, moving = _switches(eq)
    if not switches:
        return None
    count, first = len(switches), len(eq.y) + len(eq.x) + len(eq.d)
    rhs, update, remember = _functions(eq, program, switches, moving)
    logged = [*y, *range(len(eq.y), first + count * (1 if update is None else 2))]
    kinds = [program.nodes[n][0] for n in switches]
    reach = _reach(program, switches)
    return Frozen(
        whole=kernel_for(_plan(eq, method, rhs, update, logged), backend),
        part=kernel_for(_plan(eq, method, rhs, None, range(first, first + count)), backend),
        remember=remember,
        names=tuple(zip(_owners(eq, program, reach), (SWITCHES[k] for k in kinds), strict=True)),
        edge=np.array([MODE_AT_ZERO.get(k, np.nan) for k in kinds]),
        fresh=np.array([MODE_AT_ZERO.get(k, 1.0) for k in kinds]),
        spare=np.zeros(0 if update is None else count),
        upstream=reach[switches] & ~np.eye(count, dtype=bool),
    )


def _functions(eq: Equations, program: Program, switches: list[int], moving: list[int]) -> tuple[Any, Any, Any]:
    """The frozen right-hand side, the update on the grid and that at events, all with longer memory."""
    count, held = len(switches), len(eq.d)
    t, x, u, q, p = (ca.SX.sym(k, eq.rhs.size1_in(eq.rhs.index_in(k))) for k in "txuqp")
    d = ca.SX.sym("d", held + count * (1 if eq.update is None else 2))
    parts = ca.vertsplit(d)
    old, modes, before = ca.vertcat(*parts[:held]), parts[held : held + count], parts[held + count :]
    values, g = _rewritten(program, [t, x, old, u, q, p], dict(zip(switches, modes, strict=True)), moving)

    def output(slot: int, size: int) -> Any:
        nodes = [program.outputs.get((slot, k)) for k in range(size)]
        return ca.vertcat(*(0 if n is None else values[n] for n in nodes))

    inputs, seen = [t, x, d, u, q, p], [output(1, len(eq.y)), x, old, g, *before]
    rhs = ca.Function("rhs", inputs, [output(0, len(eq.x)), ca.vertcat(*seen), ca.SX(0, 1)], *RHS)
    if eq.update is None:
        return rhs, None, None
    hit = ca.SX.sym("hit", len(eq.periods))
    fresh, moved = eq.update.call([t, x, old, u, q, p, hit])
    for late in _chained(eq, program) if eq.every_step else ():
        again = eq.update.call([t, moved, fresh, u, q, p, ca.SX.zeros(len(eq.periods))])[0]
        fresh = ca.vertcat(*((again if k in late else fresh)[k] for k in range(held)))
    update = ca.Function("update", [*inputs, hit], [ca.vertcat(fresh, *modes, g), moved], *UPDATE)
    if not eq.every_step:
        return rhs, update, None
    return rhs, update, ca.Function("remember", inputs, [output(2, held), output(3, len(eq.x))])


def _chained(eq: Equations, program: Program) -> list[set[int]]:
    """Memory that depends on memory of other blocks (a relay fed by a relay): what to update once more."""
    inputs = {args[1]: n for n, (name, args) in enumerate(program.nodes) if name == "INPUT" and args[0] == 2}
    reach = _reach(program, list(inputs.values()))
    fresh = {k: n for (slot, k), n in program.outputs.items() if slot == 2 and n != inputs.get(k)}
    owner = [name.rpartition(".")[0] for name in eq.d]
    reads = {
        k: {j for j, read in zip(inputs, reach[n], strict=True) if read and owner[j] != owner[k]}
        for k, n in fresh.items()
    }
    made: list[set[int]] = []
    late = {k for k, given in reads.items() if given & fresh.keys()}
    while late and len(made) < MOST_CHAINED:
        made.append(late)
        late = {k for k in late if reads[k] & late}
    return made


def _switches(eq: Equations) -> tuple[Program, list[int], list[int]]:
    """Rates, signals and updates between samples as one program; its switches; and how each node moves.

    Switches are those that rates, signals, memory and resets depend on; those of samples are not.
    Nodes are constant within a step (0), change with time alone (1) or with states and inputs (2).
    """
    symbols = eq.rhs.sx_in()
    values, names = eq.rhs.call(symbols)[:2], RHS[1][:2]
    if eq.every_step:
        values = [*values, *eq.update.call([*symbols, ca.SX.zeros(len(eq.periods))])]
        names = [*names, *UPDATE[1]]
    program = Program(ca.Function("all", symbols, values, RHS[0], names))
    moving = program.grade({0: 1, 1: 2, 2: 0, 3: 2, 4: 2, 5: 0})
    needed = program.needed(program.outputs.values())
    switches = [n for n in sorted(needed) if program.nodes[n][0] in SWITCHES and moving[n]]
    return program, switches, moving


def _plan(eq: Equations, method: Method, rhs: Any, update: Any, y: Sequence[int]) -> Plan:
    # Not fused: a memory and the signal it was taken from must differ by exactly nothing.
    # Not watched: a branch that is not taken may have any value.
    plan, loops, advance = plan_for(eq, method, tuple(y)), tuple(solved_loops(eq.loops)), None
    if method.implicit:
        step = step_map(rhs, method, eq.x, len(loops))
        loops, advance = (*loops, *step.loops), step.plain
    return attrs.evolve(
        plan,
        rhs=rhs,
        loops=loops,
        advance=advance,
        update=update,
        every_step=update is not None,
        wide_d=(False,) * rhs.size1_in("d"),
        fused=False,
        watched=False,
    )


def _rewritten(program: Program, symbols: list[Any], modes: dict[int, Any], moving: list[int]) -> tuple[list[Any], Any]:
    """The value of every node with its switches decided by modes, and the switching functions.

    Where a switch has no effect for now, its switching function is its mode, which agrees with it.
    """
    values: list[Any] = []
    plain: dict[int, Any] = {}  # of what moves with time alone
    gaps: dict[int, Any] = {}
    for node, (name, args) in enumerate(program.nodes):
        leaf = name in ("CONST", "INPUT")
        if leaf:
            values.append(ca.SX(args[0]) if name == "CONST" else symbols[args[0]][args[1]])
        elif node in modes:
            given = [values[j] for j in args]
            values.append(_decided(name, modes[node], *given))
            gap = given[0] if len(args) == 1 else given[1] - given[0] if name in ("LT", "LE") else given[0] - given[1]
            size = sum(_size(program, values, j) for j in args)
            gaps[node] = gap if moving[node] == 1 else ca.if_else(ca.fabs(gap) < ROUNDING * size, 0, gap)
        else:
            values.append(program.evaluated(node, [values[j] for j in args]))
        if moving[node] < 2:
            plain[node] = values[node] if leaf else program.evaluated(node, [plain[j] for j in args])
            if _rounds(name, moving[node]):
                values[node] = plain[node]
    when = _when_used(program, values, moving)
    g = [
        gap if when[n] is ALWAYS else modes[n] if when[n] is None else ca.if_else(when[n], gap, modes[n])
        for n, gap in gaps.items()
    ]
    return values, ca.vertcat(*g)


def _rounds(name: str, moving: int) -> bool:
    """Whether a node jumps with time alone and is no switch: it must stay an expression of time for the kernels."""
    return moving == 1 and name in ("FLOOR", "CEIL", "EQ", "NE")


def _when_used(program: Program, values: list[Any], moving: list[int]) -> list[Any]:
    """When each node has an effect: ALWAYS, or a condition where only branches read it; None for never."""
    when: list[Any] = [None] * len(values)
    for node in program.outputs.values():
        when[node] = ALWAYS
    for node in reversed(range(len(values))):
        name, given = program.nodes[node][0], program.arguments(node)
        if when[node] is None or _rounds(name, moving[node]):
            continue
        if name == "IF_ELSE_ZERO":
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
    """The value of a switch in a mode."""
    if name == "FABS":
        return mode * a
    if name == "SIGN":
        return mode
    if name in ("LT", "LE"):
        return mode > 0
    return ca.if_else(mode > 0, b, a) if name == "FMIN" else ca.if_else(mode > 0, a, b)


def _size(program: Program, values: list[Any], node: int) -> Any:
    """Size of a node for its rounding: that of its terms, if it is a sum."""
    name, args = program.nodes[node]
    return sum(ca.fabs(values[j]) for j in (args if name in ("ADD", "SUB") else [node]))


def _reach(program: Program, sources: Sequence[int]) -> np.ndarray:
    """Whether each node depends on each of some nodes, shape (nodes, sources); a node depends on itself."""
    reach = np.zeros((len(program.nodes), len(sources)), dtype=bool)
    reach[sources, range(len(sources))] = True
    for node, row in enumerate(reach):
        for j in program.arguments(node):
            row |= reach[j]
    return reach


def _owners(eq: Equations, program: Program, reach: np.ndarray) -> list[str]:
    """The block of each switch: its rates, outputs, memory or resets depend on it, its inputs do not."""
    results = {
        (slot, name): reach[program.outputs[slot, k]]
        for slot, names in enumerate((eq.x, eq.y, eq.d, eq.x))
        for k, name in enumerate(names)
        if (slot, k) in program.outputs
    }
    owners = [""] * reach.shape[1]
    for (_, name), switches in results.items():
        block = name.rpartition(".")[0]
        if switches.any() and block in eq.reads:
            inputs = [results[1, k] for k in eq.reads[block][1].values() if (1, k) in results]
            for k in np.flatnonzero(switches & ~np.any(inputs, axis=0)):
                owners[k] = owners[k] or block
    return owners
