"""CasADi's scalar operations as C99: the list of instructions that the engine compiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from tsmblocks.common.errors import TsmError
from tsmblocks.engine.llvm_ir import LIBM
from tsmblocks.engine.program import Program

_FORMS = {
    "ADD": "{0} + {1}",
    "SUB": "{0} - {1}",
    "MUL": "{0} * {1}",
    "DIV": "{0} / {1}",
    "NEG": "-{0}",
    "SQ": "{0} * {0}",
    "TWICE": "{0} + {0}",
    "INV": "1.0 / {0}",
    "ASSIGN": "{0}",
    "LT": "(double)({0} < {1})",
    "LE": "(double)({0} <= {1})",
    "EQ": "(double)({0} == {1})",
    "NE": "(double)({0} != {1})",
    "NOT": "(double)({0} == 0.0)",
    "AND": "(double)({0} != 0.0 && {1} != 0.0)",
    "OR": "(double)({0} != 0.0 || {1} != 0.0)",
    "IF_ELSE_ZERO": "({0} != 0.0) ? {1} : 0.0",
    "SIGN": "(double)({0} > 0.0) - (double)({0} < 0.0)",
    "SQRT": "sqrt({0})",
    "FABS": "fabs({0})",
    "FLOOR": "floor({0})",
    "CEIL": "ceil({0})",
    "COPYSIGN": "copysign({0}, {1})",
    "FMIN": "least({0}, {1})",
    "FMAX": "greatest({0}, {1})",
    **{name: f"{function}({{0}})" for name, function in LIBM.items()},
    **{name: f"{LIBM[name]}({{0}}, {{1}})" for name in ("POW", "CONSTPOW", "FMOD", "REMAINDER", "ATAN2", "HYPOT")},
}
LIMITS = {
    name: f"""\
static double {name}(double a, double b)
{{
    return (b {sign} a || b != b) ? b : a;
}}
"""
    for name, sign in (("least", "<"), ("greatest", ">"))
}
"""C functions for FMIN and FMAX that keep NaN, by name."""


def c_double(value: float) -> str:
    """A double as a literal of C that is read back as the same value."""
    if math.isnan(value):
        return "(0.0 / 0.0)"
    if value in (float("inf"), float("-inf")):
        return "HUGE_VAL" if value > 0 else "(-HUGE_VAL)"
    text = repr(float(value))
    text = text if any(mark in text for mark in ".en") else f"{text}.0"
    return f"({text})" if value < 0 else text


def statements(
    program: Program,
    goals: Mapping[str, int],
    place: Callable[[int, int], str],
    loops: Mapping[int, tuple[str, int]] = {},
) -> list[str]:
    """C statements that compute nodes and store them: ``goals`` maps targets of assignments to nodes.

    ``place(slot, index)`` is the expression of an input of the function; ``loops`` the function that solves each loop,
    and the place of its solution in ``loops``. Raises TsmError for an operation that C lacks.
    """
    texts: dict[int, str] = {}
    calls: dict[int, int] = {}
    lines = []
    for node in sorted(program.needed(goals.values())):
        name, args = program.nodes[node]
        if name == "CONST":
            texts[node] = c_double(args[0])
        elif name == "INPUT":
            texts[node] = place(*args)
        elif name.startswith("SOLVE"):
            solver, first = loops[int(name.partition(" ")[2])]
            reads = ", ".join(texts[j] for j in args) or "0.0"
            lines.append(f"    const double w{node}[{max(len(args), 1)}] = {{{reads}}};")
            calls[node] = first
            lines.append(f"    {solver}(w{node}, loops + {first});")
        elif name.startswith("ROOT"):
            lines.append(f"    const double a{node} = loops[{calls[args[0]] + int(name.partition(' ')[2])}];")
            texts[node] = f"a{node}"
        elif name in _FORMS:
            lines.append(f"    const double a{node} = {_FORMS[name].format(*(texts[j] for j in args))};")
            texts[node] = f"a{node}"
        else:
            raise TsmError(f"the operation {name} cannot be written in C.")
    return [*lines, *(f"    {target} = {texts[node]};" for target, node in goals.items())]
