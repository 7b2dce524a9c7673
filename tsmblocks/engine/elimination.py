"""Signals of algebraic loops that are eliminated one by one, and the solution of linear equations."""

from __future__ import annotations

from collections import Counter
from graphlib import TopologicalSorter
from typing import Any

import casadi as ca
import numpy as np

from tsmblocks.engine.substitution import Column, Values, other_symbols, parts

SINGULAR = 1e-13
"""Size of a determinant or pivot, as a share of its terms, that counts as zero. Chosen: some 500 roundings."""
SMALL = 3
"""Signals up to which a system is solved by its determinant; above, by a QR decomposition. Chosen: by operations."""
TINY = 1e-200
"""Replaces a pivot that is zero. Chosen: its square is still above the least number."""

_LINEAR = {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_MUL, ca.OP_DIV, ca.OP_TWICE, ca.OP_ASSIGN, ca.OP_IF_ELSE_ZERO}
"""Operations that are linear in an operand as long as their derivative does not depend on it."""


class Elimination:
    """Signals of a group, of which as many as possible are taken out one by one: ``gone``, in that order.

    What is taken out is kept as it is, not put into what reads it, so that expressions stay short; ``reads`` are the
    signals left that each depends on. Only where a signal depends on itself by way of others are these put in. With
    ``linear`` a signal that depends on itself is taken out too, where it is linear in itself.
    """

    def __init__(self, z: Column, g: Column, *, linear: bool) -> None:
        self.symbols, self.made, self.linear = parts(z), parts(g), linear
        self.place = {symbol.element_hash(): k for k, symbol in enumerate(self.symbols)}
        pattern = ca.Function("g", [z, other_symbols(g, z)], [g]).jac_sparsity(0, 0)
        self.reads: dict[int, set[int]] = {k: set() for k in range(len(self.symbols))}
        for row, column in zip(*pattern.get_triplet(), strict=True):
            self.reads[row].add(column)
        self.gone: dict[int, set[int]] = {}
        self._kept: dict[int, frozenset[int]] = {}  # not linear, with what they read
        for k, own in self.reads.items():
            if k in own and linear and _is_linear(self.made[k], self.symbols[k]):
                self._solve(k)
                own.discard(k)
        while len(self.reads) > (0 if linear else 1) and (chosen := self._next()) is not None:
            self._take_out(chosen)

    @property
    def passed(self) -> list[tuple[Any, Any]]:
        """The signals taken out, each after those that it reads."""
        order = TopologicalSorter({k: self._in(k) & self.gone.keys() for k in self.gone}).static_order()
        return [(self.symbols[k], self.made[k]) for k in order]

    @property
    def rest(self) -> tuple[Column, Column]:
        """The signals that are left, and their expressions in terms of each other."""
        known = Values()
        for symbol, made in self.passed:
            known.add(symbol, known.of(made))
        left = [ca.vertcat(ca.SX(0, 1), *(column[k] for k in self.reads)) for column in (self.symbols, self.made)]
        return left[0], known.of(left[1])

    def _in(self, k: int) -> set[int]:
        """Signals that occur in an expression."""
        return {self.place[s.element_hash()] for s in ca.symvar(self.made[k]) if s.element_hash() in self.place}

    def _take_out(self, k: int) -> None:
        own = self.reads.pop(k)
        if k in own:
            self._solve(k)
        own = own - {k}
        self.gone[k] = own
        for j, others in self.reads.items():
            if k in others:
                self.reads[j] = (others | own) - {k}

    def _solve(self, k: int) -> None:
        """Solve a signal, which is linear in itself, for itself."""
        made, symbol = self.made[k], self.symbols[k]
        self.made[k] = ca.substitute(made, symbol, 0) / (1 - ca.jacobian(made, symbol))

    def _next(self) -> int | None:
        """The signal to take out next: of all candidates the one with the fewest readers and operands (Markowitz)."""
        readers = Counter(j for others in self.reads.values() for j in others)
        for k in sorted(self.reads, key=lambda k: (k in self.reads[k], len(self.reads[k]) * readers[k])):
            if k not in self.reads[k]:
                return k
            if self.linear and self._kept.get(k) != self.reads[k]:
                self._put_in(k)
                if _is_linear(self.made[k], self.symbols[k]):
                    return k
                self._kept[k] = frozenset(self.reads[k])
        return None

    def _put_in(self, k: int) -> None:
        """Substitute signals that depend on a signal into its own expression."""
        through = {k}
        for m in reversed(self.gone):  # what each reads was there when it went, so it went later or is left
            if self.gone[m] & through:
                through.add(m)
        while present := (self._in(k) & through) - {k}:
            old, new = (ca.vertcat(*(column[m] for m in present)) for column in (self.symbols, self.made))
            self.made[k] = ca.substitute(self.made[k], old, new)


def _is_linear(expression: Any, symbol: Any) -> bool:
    """Whether an expression is linear in a symbol."""
    return not ca.depends_on(ca.jacobian(expression, symbol), symbol) and is_smooth(expression, symbol)


def is_smooth(f: Column, z: Column) -> bool:
    """Whether all operations on z are such that a constant Jacobian means linear: a sign has a derivative of 0, too."""
    function = ca.Function("f", [z, other_symbols(f, z)], [ca.densify(f)])
    moving: dict[int, bool] = {}
    for k in range(function.n_instructions()):
        code: int = function.instruction_id(k)
        ins, outs = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_INPUT:
            moving[outs[0]] = ins[0] == 0
        elif code != ca.OP_OUTPUT:
            depends = any(moving[j] for j in ins)
            if depends and (code not in _LINEAR or (code == ca.OP_IF_ELSE_ZERO and moving[ins[0]])):
                return False
            moving |= dict.fromkeys(outs, depends)
    return True


def quotient(jacobian: Any, f: Column) -> Column:
    """Solution of jacobian * x = f."""
    return f / jacobian if f.shape[0] == 1 else ca.solve(ca.densify(jacobian), f)


def determinant(jacobian: Any) -> Any:
    """Determinant of a Jacobian: for large ones the product of the pivots, whose sign is right without pivoting."""
    n = jacobian.shape[0]
    full, product = ca.densify(jacobian), ca.SX(1)
    if n <= SMALL:
        return ca.det(full)
    for k in range(n):
        pivot = ca.if_else(full[k, k] == 0, TINY, full[k, k])
        product = product * pivot
        for i in range(k + 1, n):
            full[i, k + 1 :] -= full[i, k] / pivot * full[k, k + 1 :]
    return product


def guarded(jacobian: Any, values: Column) -> Column:
    """NaN instead of a solution where the Jacobian is singular."""
    n = values.shape[0]
    if jacobian.is_constant():
        return values
    if n <= SMALL:
        size = ca.SX(1)
        for k in range(n):
            size = size * (1 + ca.sum2(ca.fabs(jacobian[k, :])))
        singular = ca.fabs(ca.det(ca.densify(jacobian))) < SINGULAR * size
    else:
        _, r = ca.qr(ca.densify(jacobian))
        pivots, sizes = ca.diag(r), ca.sum1(ca.fabs(jacobian)).T
        singular = ca.mmax(ca.fabs(pivots) < SINGULAR * (1 + sizes))
    return ca.vertcat(*(ca.if_else(singular, np.nan, value) for value in parts(values)))
