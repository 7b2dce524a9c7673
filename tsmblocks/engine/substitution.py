"""Substitution of symbols in expressions, in which common subexpressions stay common."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

Column = Any
"""A column of expressions."""


def parts(column: Column) -> list[Any]:
    """The elements of a column."""
    made: list[Any] = ca.vertsplit(column) if column.shape[0] else []
    return made


def other_symbols(expressions: Column, symbols: Column) -> Column:
    """All other symbols of expressions."""
    own = {symbol.element_hash() for symbol in parts(symbols)}
    return ca.vertcat(ca.SX(0, 1), *(s for s in ca.symvar(expressions) if s.element_hash() not in own))


class Values:
    """Values of symbols. What does not depend on them stays the same, not a copy, in expressions formed with them."""

    def __init__(self) -> None:
        self._known: dict[int, Any] = {}

    def add(self, symbols: Column, values: Column) -> None:
        """Keep the values of some symbols."""
        pairs = zip(parts(symbols), parts(values), strict=True)
        self._known |= {symbol.element_hash(): value for symbol, value in pairs}

    def of(self, expressions: Column) -> Column:
        """Expressions with the values substituted for the symbols."""
        symbols = [one for one in ca.symvar(expressions) if one.element_hash() in self._known]
        if not symbols:
            return expressions
        return _walk(expressions, ca.vertcat(*symbols), [self._known[one.element_hash()] for one in symbols], None)


def cut(expressions: Column, symbols: Column) -> tuple[Column, Column, Column]:
    """Expressions in terms of ``symbols`` and of new symbols for all that does not depend on them.

    Returns the expressions, what the new symbols denote, and the new symbols.
    """
    reads: dict[Any, tuple[Any, Any]] = {}
    made = _walk(expressions, symbols, parts(symbols), reads)
    outside, new = zip(*reads.values(), strict=True) if reads else ((), ())
    return made, ca.vertcat(ca.SX(0, 1), *outside), ca.vertcat(ca.SX(0, 1), *new)


def _walk(expressions: Column, symbols: Column, values: Sequence[Any], reads: dict[Any, tuple[Any, Any]] | None) -> Any:
    """Rebuild expressions that depend on the symbols; with ``reads`` other operands are replaced and collected."""
    others: Any = parts(other_symbols(expressions, symbols))
    f = ca.Function("f", [symbols, ca.vertcat(ca.SX(0, 1), *others)], [ca.densify(expressions)])
    nodes, made = f.instructions_sx(), [ca.SX(0)] * expressions.shape[0]
    work: dict[int, tuple[Any, bool]] = {}  # expression, and whether it depends on the symbols

    def operand(slot: int) -> Any:
        value, depends = work[slot]
        if depends or reads is None or value.is_constant():
            return value
        key = value.element_hash()
        return reads.setdefault(key, (value, ca.SX.sym(f"w{len(reads)}")))[1]

    for k in range(f.n_instructions()):
        code, ins, outs = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if code == ca.OP_INPUT:
            work[outs[0]] = (values[ins[1]], True) if ins[0] == 0 else (others[ins[1]], False)
        elif code == ca.OP_CONST:
            work[outs[0]] = ca.SX(f.instruction_constant(k)), False
        elif code == ca.OP_OUTPUT:
            made[outs[1]] = operand(ins[0])
        elif not any(work[j][1] for j in ins):
            if code == ca.OP_CALL:
                results = _called(nodes[k], [work[j][0] for j in ins])
                work |= {slot: (value, False) for slot, value in zip(outs, results, strict=True) if slot >= 0}
            else:
                work[outs[0]] = nodes[k], False
        elif code == ca.OP_CALL:
            results = _called(nodes[k], [operand(j) for j in ins])
            work |= {slot: (value, True) for slot, value in zip(outs, results, strict=True) if slot >= 0}
        else:
            form = ca.SX.unary if len(ins) == 1 else ca.SX.binary
            work[outs[0]] = form(code, *(operand(j) for j in ins)), True
    return ca.vertcat(*made)


def _called(node: Any, operands: list[Any]) -> list[Any]:
    """The results of a call with other operands."""
    function = node.which_function()
    ends = np.cumsum([0, *(function.numel_in(k) for k in range(function.n_in()))])
    arguments = [ca.vertcat(ca.SX(0, 1), *operands[a:b]) for a, b in itertools.pairwise(ends)]
    return [part for result in function.call(arguments) for part in parts(result)]
