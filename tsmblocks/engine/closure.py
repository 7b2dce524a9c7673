"""Algebraic loops: eliminated where they are linear, else left to the engine with their exact Jacobian.

Each loop has been torn at some signals z, and of each there is its own expression g(z, …). Signals that depend on
one another are solved together, in order of dependence. Of these, what does not depend on itself is substituted. If
g - z is linear in the rest (its Jacobian does not depend on z), it is eliminated here; if not, it is a ``Loop`` that
the engine solves.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from graphlib import TopologicalSorter
from typing import Any

import attrs
import casadi as ca
import numpy as np

from tsmblocks.engine.elimination import Elimination, determinant, guarded, is_smooth, quotient
from tsmblocks.engine.equations import RHS, SOLVING, UPDATE
from tsmblocks.engine.loops import Loop, newton_correction, solving_function
from tsmblocks.engine.substitution import Column, Values, cut, other_symbols


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
    ``determinants`` has the path and the determinant of each eliminated loop whose gain is no constant.
    """

    def __init__(self, tears: Sequence[Tear], first: int, *, function: str = "rhs", eliminate: bool = False) -> None:
        self.loops: list[Loop] = []
        self.singular: list[tuple[str, ...]] = []
        self.determinants: list[tuple[tuple[str, ...], Any]] = []
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
        known = Values()
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
        known, roots, place = Values(), ca.SX(0, 1), 0
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
        g, reads, w = cut(ca.vertcat(*(tear.expression for tear in tears)), z)
        elimination = Elimination(z, g, linear=self._eliminate)
        z, left = elimination.rest
        f, jacobian = left - z, ca.jacobian(left - z, z)
        path = tuple(tears[0].path)
        if not z.shape[0]:
            self.loops.append(Loop(path, 0, None, self._function))
        elif ca.depends_on(jacobian, z) or not is_smooth(f, z):
            correction = ca.Function("correction", [z, w], [-quotient(jacobian, f), f, jacobian])
            given = correction.call([z, w])[: 2 if self._eliminate else 3]
            solving = newton_correction(z, w, *given)
            solver = solving_function(self._first + len(self._open), solving, of_step=self._eliminate)
            self._order.append(_Open(z, reads, solver, correction))
            self.loops.append(Loop(path, z.shape[0], solving, self._function))
        else:
            at_zero = ca.substitute(f, z, ca.SX.zeros(*z.shape))
            self._check(jacobian, path)
            if not jacobian.is_constant():
                self.determinants.append((path, ca.substitute(determinant(jacobian), w, reads)))
            values = guarded(jacobian, -quotient(jacobian, at_zero))
            self.loops.append(Loop(path, z.shape[0], None, self._function))
            self._order.append((z, ca.substitute(values, w, reads)))
        self._order += [(symbol, ca.substitute(one, w, reads)) for symbol, one in elimination.passed]

    def _check(self, jacobian: Any, path: tuple[str, ...]) -> None:
        """Note a loop that is singular whatever the parameters."""
        if jacobian.is_constant():
            numbers = np.asarray(ca.DM(jacobian), dtype=float)
            if np.linalg.matrix_rank(numbers) < len(numbers):
                self.singular.append(path)


def _groups(tears: Sequence[Tear]) -> list[list[int]]:
    """Groups of signals that depend on one another, each after those that it depends on."""
    if not tears:
        return []
    z, g = (ca.vertcat(*column) for column in zip(*((t.symbol, t.expression) for t in tears), strict=True))
    depends = ca.Function("g", [z, other_symbols(g, z)], [g]).jac_sparsity(0, 0) + ca.Sparsity.diag(len(tears))
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
