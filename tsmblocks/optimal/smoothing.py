"""Equations with smoothed kinks, for solvers that need derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import attrs
import casadi as ca

from tsmblocks.engine.program import Program


@attrs.frozen(eq=False)
class Smooth:
    """A function in which every kink is smoothed over its own width.

    ``function`` takes the arguments of the exact one and, last, the ``count`` widths: at 0 it is the exact one.
    ``kinks`` takes the same arguments and gives those of the operations with a kink, which is at zero, shape (count,).
    ``rounds`` says whether the exact function rounds to integers, so that its derivative is zero or undefined.
    """

    function: ca.Function
    kinks: ca.Function
    count: int
    rounds: bool


def smooth(function: ca.Function) -> Smooth:
    """Smooth the absolute values, signs, limits and comparisons of a CasADi function of scalar operations."""
    given = function.sx_in()
    program, kinks = Program(function), list[Any]()
    infinite = _infinite_nodes(program)
    kinked = {k for k, (name, args) in enumerate(program.nodes) if name in _SMOOTHED and infinite.isdisjoint(args)}
    size = ca.SX.sym("size", len(kinked))
    plain, smoothed = list[Any](), list[Any]()
    for k, (name, args) in enumerate(program.nodes):
        if name in ("CONST", "INPUT"):
            made = ca.SX(args[0]) if name == "CONST" else given[args[0]][args[1]]
            plain.append(made)
            smoothed.append(made)
            continue
        exact, operands = [plain[j] for j in args], [smoothed[j] for j in args]
        plain.append(program.evaluated(k, exact))
        if k in kinked:
            kink, form = _SMOOTHED[name]
            smoothed.append(form(*operands, size[len(kinks)]))
            kinks.append(kink(*exact))
        else:
            smoothed.append(_LOGICAL[name](*operands) if name in _LOGICAL else program.evaluated(k, operands))
    outs = [ca.SX(*function.size_out(k)) for k in range(function.n_out())]
    for (slot, index), node in program.outputs.items():
        outs[slot][index] = smoothed[node]
    before, after = function.name_in(), function.name_out()
    return Smooth(
        ca.Function("smoothed", [*given, size], outs, [*before, "size"], after),
        ca.Function("kinks", given, [ca.vertcat(*kinks)], before, ["kinks"]),
        len(kinks),
        any(name in ("FLOOR", "CEIL") for name, _ in program.nodes),
    )


def _infinite_nodes(program: Program) -> set[int]:
    """Nodes that are always infinite; a limit or comparison with one has no kink."""
    found = set[int]()
    for k, (name, args) in enumerate(program.nodes):
        known = math.isinf(args[0]) if name == "CONST" else name in _ADDITIVE and len(found.intersection(args)) == 1
        found |= {k} if known else set()
    return found


def _abs(z: Any, size: Any) -> Any:
    return ca.sqrt(z * z + size * size)


def _sign(z: Any, size: Any) -> Any:
    return z / (_abs(z, size) + 1e-300)


def _unit_step(z: Any, size: Any) -> Any:
    """The smoothed unit step."""
    return (1 + _sign(z, size)) / 2


_SMOOTHED: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "FABS": (lambda z: z, _abs),
    "SIGN": (lambda z: z, _sign),
    "FMAX": (lambda a, b: a - b, lambda a, b, size: (a + b + _abs(a - b, size)) / 2),
    "FMIN": (lambda a, b: a - b, lambda a, b, size: (a + b - _abs(a - b, size)) / 2),
    "LT": (lambda a, b: a - b, lambda a, b, size: _unit_step(b - a, size)),
    "LE": (lambda a, b: a - b, lambda a, b, size: _unit_step(b - a, size)),
}
"""Operations with a kink or a jump: its argument (zero there), and the smoothed form."""

_ADDITIVE = ("ADD", "SUB", "NEG")
"""Operations that are infinite where one operand is."""

_LOGICAL: dict[str, Callable[..., Any]] = {
    "IF_ELSE_ZERO": lambda share, value: share * value,
    "NOT": lambda share: 1 - share,
    "AND": lambda one, other: one * other,
    "OR": lambda one, other: one + other - one * other,
}
"""Logical operations on smoothed comparisons, which are between 0 and 1."""
