"""Algebraic loops: eliminated where they are linear, else left to the engine with their exact Jacobian.

Each loop has been torn at some signals z, and of each there is its own expression g(z, …). Signals that depend on
one another are solved together, in order of dependence. Of these, what does not depend on itself is substituted. If
g - z is linear in the rest (its Jacobian does not depend on z), it is eliminated here; if not, it is a ``Loop`` that
the engine solves.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from graphlib import TopologicalSorter
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.engine.equations import RHS, SOLVING, UPDATE
from tsmblocks.engine.loops import Loop, newton_correction, solving_function

SINGULAR = 1e-13
"""Size of a determinant or pivot, as a share of its terms, that counts as zero. Chosen: some 500 roundings."""
SMALL = 3
"""Signals up to which a system is solved by its determinant; above, by a QR decomposition. Chosen: by operations."""

_LINEAR = {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_MUL, ca.OP_DIV, ca.OP_TWICE, ca.OP_ASSIGN, ca.OP_IF_ELSE_ZERO}
"""Operations that are linear in an operand as long as their derivative does not depend on it."""

Column = Any
"""A column of expressions."""


@attrs.define(eq=False)
class Tear:
    """A signal at which a loop is torn: its symbol, the signals around the loop, and its own ``expression``."""

    symbol: Any
    path: list[str]
    expression: Any = None


@attrs.frozen(eq=False)
class _Open:
    """A loop that the engine solves: the symbols ``z`` of its signals, and the expressions ``w`` that it reads."""

    z: Column
    w: Column
    solver: Any
    correction: Any  # the Newton correction, what is to be zero, and its Jacobian


class Closure:
    """Solved loops of a function. ``loops`` describes them; ``first`` is the number of the first one in the engine.

    ``singular`` are the paths of loops that are singular whatever the parameters. With ``eliminate`` signals that are
    linear in themselves are eliminated one by one, without pivoting: for steps of a method, where pivots are near 1.
    """

    def __init__(self, tears: Sequence[Tear], first: int, *, function: str = "rhs", eliminate: bool = False) -> None:
        self.loops: list[Loop] = []
        self.singular: list[tuple[str, ...]] = []
        self._first = first
        self._function, self._eliminate = function, eliminate
        self._order: list[_Open | tuple[Any, Any]] = []  # as solved; a pair is a symbol and what it equals
        for group in _groups(tears):
            self._solve([tears[k] for k in group])

    @property
    def _open(self) -> list[_Open]:
        return [one for one in self._order if isinstance(one, _Open)]

    @property
    def count(self) -> int:
        """How many loops the engine solves."""
        return len(self._open)

    @property
    def size(self) -> int:
        """Numbers that start the solutions of all loops that the engine solves."""
        return sum(one.z.shape[0] for one in self._open)

    def plain(self, columns: Sequence[Column], guess: Column) -> list[Column]:
        """Expressions with their loops solved as the engine leaves them.

        The last one has the solution of each loop, followed by the number of iterations.
        """
        return self._closed(columns, guess, exact=False)

    def exact(self, columns: Sequence[Column], guess: Column) -> list[Column]:
        """As ``plain``, with one more Newton correction, which gives the derivatives of the solution."""
        return self._closed(columns, guess, exact=True)

    def open(self, columns: Sequence[Column]) -> tuple[Column, list[Column]]:
        """The signals z of the loops that the engine solves, and expressions in terms of them.

        The last one has what these signals must equal.
        """
        known = _Values()
        goals = []
        for one in self._order:
            if isinstance(one, _Open):
                goals.append(one.z + one.correction.call([one.z, known.of(one.w)])[1])
            else:
                known.add(one[0], known.of(one[1]))
        z = ca.vertcat(ca.SX(0, 1), *(one.z for one in self._open))
        return z, [*(known.of(column) for column in columns), ca.vertcat(ca.SX(0, 1), *goals)]

    def _closed(self, columns: Sequence[Column], guess: Column, *, exact: bool) -> list[Column]:
        if not self.loops:
            return [*columns, ca.SX(0, 1)]
        known, roots, place = _Values(), ca.SX(0, 1), 0
        for one in self._order:
            if not isinstance(one, _Open):
                known.add(one[0], known.of(one[1]))
                continue
            w, size = known.of(one.w), one.z.shape[0]
            root, count = one.solver(guess[place : place + size], w)
            place += size
            known.add(one.z, root + one.correction.call([root, w])[0] if exact else root)
            roots = ca.vertcat(roots, root, count)
        everything = known.of(ca.vertcat(ca.SX(0, 1), *columns))
        ends = np.cumsum([0, *(column.shape[0] for column in columns)])
        return [*(everything[int(a) : int(b), 0] for a, b in itertools.pairwise(ends)), roots]

    def _solve(self, tears: list[Tear]) -> None:
        """Solve signals that depend on one another; what they read has been solved before."""
        z = ca.vertcat(*(tear.symbol for tear in tears))
        g, reads, w = _cut(ca.vertcat(*(tear.expression for tear in tears)), z)
        elimination = _Elimination(z, g, linear=self._eliminate)
        z, left = elimination.rest
        f, jacobian = left - z, ca.jacobian(left - z, z)
        path = tuple(tears[0].path)
        if not z.shape[0]:
            self.loops.append(Loop(path, 0, None, self._function))
        elif ca.depends_on(jacobian, z) or not _is_smooth(f, z):
            correction = ca.Function("correction", [z, w], [-_quotient(jacobian, f), f, jacobian])
            given = correction.call([z, w])[: 2 if self._eliminate else 3]
            solving = newton_correction(z, w, *given)
            solver = solving_function(self._first + len(self._open), solving)
            self._order.append(_Open(z, reads, solver, correction))
            self.loops.append(Loop(path, z.shape[0], solving, self._function))
        else:
            at_zero = ca.substitute(f, z, ca.SX.zeros(*z.shape))
            self._check(jacobian, path)
            values = _guarded(jacobian, -_quotient(jacobian, at_zero))
            self.loops.append(Loop(path, z.shape[0], None, self._function))
            self._order.append((z, ca.substitute(values, w, reads)))
        self._order += [(symbol, ca.substitute(one, w, reads)) for symbol, one in elimination.passed]

    def _check(self, jacobian: Any, path: tuple[str, ...]) -> None:
        """Note a loop that is singular whatever the parameters."""
        if jacobian.is_constant():
            numbers = np.asarray(ca.DM(jacobian), dtype=float)
            if np.linalg.matrix_rank(numbers) < len(numbers):
                self.singular.append(path)


def _parts(column: Column) -> list[Any]:
    """The elements of a column."""
    made: list[Any] = ca.vertsplit(column) if column.shape[0] else []
    return made


def _groups(tears: Sequence[Tear]) -> list[list[int]]:
    """Groups of signals that depend on one another, each after those that it depends on."""
    if not tears:
        return []
    z, g = (ca.vertcat(*column) for column in zip(*((t.symbol, t.expression) for t in tears), strict=True))
    depends = ca.Function("g", [z, _others(g, z)], [g]).jac_sparsity(0, 0) + ca.Sparsity.diag(len(tears))
    _, order, ends = depends.scc()
    groups = [sorted(order[a:b]) for a, b in itertools.pairwise(ends)]
    return _ordered(groups, depends)


def _ordered(groups: list[list[int]], depends: Any) -> list[list[int]]:
    """Groups in order of dependence."""
    owner = {k: i for i, group in enumerate(groups) for k in group}
    needs: dict[int, set[int]] = {i: set() for i in range(len(groups))}
    for row, column in zip(*depends.get_triplet(), strict=True):
        if owner[row] != owner[column]:
            needs[owner[row]].add(owner[column])
    return [groups[i] for i in TopologicalSorter(needs).static_order()]


class _Elimination:
    """Signals of a group, of which as many as possible are taken out one by one: ``gone``, in that order.

    What is taken out is kept as it is, not put into what reads it, so that expressions stay short; ``reads`` are the
    signals left that each depends on. Only where a signal depends on itself by way of others are these put in. With
    ``linear`` a signal that depends on itself is taken out too, where it is linear in itself.
    """

    def __init__(self, z: Column, g: Column, *, linear: bool) -> None:
        self.symbols, self.made, self.linear = _parts(z), _parts(g), linear
        self.place = {symbol.element_hash(): k for k, symbol in enumerate(self.symbols)}
        pattern = ca.Function("g", [z, _others(g, z)], [g]).jac_sparsity(0, 0)
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
        """What was taken out, each after those that it reads."""
        order = TopologicalSorter({k: self._in(k) & self.gone.keys() for k in self.gone}).static_order()
        return [(self.symbols[k], self.made[k]) for k in order]

    @property
    def rest(self) -> tuple[Column, Column]:
        """The signals that are left, and their expressions in terms of each other."""
        known = _Values()
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
        """What to take out next: of all candidates what the fewest read, and reads the fewest (Markowitz)."""
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
        """Put what depends on a signal into its own expression."""
        through = {k}
        for m in reversed(self.gone):  # what each reads was there when it went, so it went later or is left
            if self.gone[m] & through:
                through.add(m)
        while present := (self._in(k) & through) - {k}:
            old, new = (ca.vertcat(*(column[m] for m in present)) for column in (self.symbols, self.made))
            self.made[k] = ca.substitute(self.made[k], old, new)


def _is_linear(expression: Any, symbol: Any) -> bool:
    """Whether an expression is linear in a symbol."""
    return not ca.depends_on(ca.jacobian(expression, symbol), symbol) and _is_smooth(expression, symbol)


def _is_smooth(f: Column, z: Column) -> bool:
    """Whether all operations on z are such that a constant Jacobian means linear: a sign has a derivative of 0, too."""
    function = ca.Function("f", [z, _others(f, z)], [ca.densify(f)])
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


def _quotient(jacobian: Any, f: Column) -> Column:
    """Solution of jacobian * x = f."""
    return f / jacobian if f.shape[0] == 1 else ca.solve(ca.densify(jacobian), f)


def _guarded(jacobian: Any, values: Column) -> Column:
    """NaN in the place of a solution where the Jacobian is singular."""
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
    return ca.vertcat(*(ca.if_else(singular, np.nan, value) for value in _parts(values)))


def _others(expressions: Column, symbols: Column) -> Column:
    """All other symbols of expressions."""
    own = {symbol.element_hash() for symbol in _parts(symbols)}
    return ca.vertcat(ca.SX(0, 1), *(s for s in ca.symvar(expressions) if s.element_hash() not in own))


class _Values:
    """Values of symbols. What does not depend on them stays the same, not a copy, in expressions formed with them."""

    def __init__(self) -> None:
        self._known: dict[int, Any] = {}

    def add(self, symbols: Column, values: Column) -> None:
        """Keep the values of some symbols."""
        pairs = zip(_parts(symbols), _parts(values), strict=True)
        self._known |= {symbol.element_hash(): value for symbol, value in pairs}

    def of(self, expressions: Column) -> Column:
        """Expressions with the values in the place of the symbols."""
        symbols = [one for one in ca.symvar(expressions) if one.element_hash() in self._known]
        if not symbols:
            return expressions
        return _walk(expressions, ca.vertcat(*symbols), [self._known[one.element_hash()] for one in symbols], None)


def _cut(expressions: Column, symbols: Column) -> tuple[Column, Column, Column]:
    """Expressions in terms of ``symbols`` and of new symbols for all that does not depend on them.

    Returns the expressions, what the new symbols denote, and the new symbols.
    """
    reads: dict[Any, tuple[Any, Any]] = {}
    made = _walk(expressions, symbols, _parts(symbols), reads)
    outside, new = zip(*reads.values(), strict=True) if reads else ((), ())
    return made, ca.vertcat(ca.SX(0, 1), *outside), ca.vertcat(ca.SX(0, 1), *new)


def _walk(expressions: Column, symbols: Column, values: Sequence[Any], reads: dict[Any, tuple[Any, Any]] | None) -> Any:
    """Form anew what depends on the symbols; with ``reads`` other operands are replaced, and collected there."""
    others: Any = _parts(_others(expressions, symbols))
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
    return [part for result in function.call(arguments) for part in _parts(result)]


def functions(name: str, reads: list[Any], results: Sequence[Column], closure: Closure) -> tuple[Any, Any, Any]:
    """A function of the equations, and its forms for kernels: plain, and exact (see ``LoopForms``)."""
    names = {"rhs": RHS, "update": UPDATE}[name]
    if not closure.size:
        made = ca.Function(name, reads, closure.plain(results, ca.SX(0, 1))[:-1], *names)
        return made, made, made
    guess = ca.SX.sym("guess", closure.size)
    alone = ca.Function(name, reads, closure.exact(results, ca.SX.zeros(closure.size))[:-1], *names)
    forms = [form(results, guess) for form in (closure.plain, closure.exact)]
    plain, exact = (ca.Function(name, [*reads, guess], form, *SOLVING[name]) for form in forms)
    return alone, plain, exact


def open_function(reads: list[Any], results: Sequence[Column], closure: Closure) -> Any:
    """``rhs`` with the signals z of its loops as an argument, and what they must equal as a result (``LoopForms``)."""
    z, columns = closure.open(results)
    return ca.Function("rhs", [*reads, z], columns, [*RHS[0], "z"], [*RHS[1], "g"])
