"""A CasADi function as a list of scalar operations, each once: the form that code is generated from."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable
from typing import Any

import casadi as ca

from tsmblocks.engine.loops import NAME

Op = tuple[str, tuple[Any, ...]]
"""``("CONST", (value,))``, ``("INPUT", (slot, index))``, or an operation on earlier nodes."""

_NAMES: dict[int, str] = {}
for _name in dir(ca):
    if _name.startswith("OP_"):
        _NAMES.setdefault(getattr(ca, _name), _name[3:])
_COMMUTE = {"ADD", "MUL", "EQ", "NE", "AND", "OR", "HYPOT"}


class Program:
    """Operations in order (``nodes``) and which of them each output is (``outputs[slot, index]``).

    Structurally zero outputs are absent from ``outputs``. Equal operations are merged. A call that solves an algebraic
    loop is ``("SOLVE n", nodes that it reads)``, n being the number of the loop, and each signal of its solution
    ``("ROOT k", (the call,))``; ``solving`` holds the functions that are called, by number. With
    ``reciprocals`` a division by something that depends on parameters only becomes a multiplication by its reciprocal,
    which is then computed once instead of at every stage.
    """

    def __init__(self, function: ca.Function, reciprocals: bool = False) -> None:
        self._fixed: list[bool] = []
        self._reciprocals = reciprocals
        self.nodes: list[Op] = []
        self.outputs: dict[tuple[int, int], int] = {}
        self.inputs = [function.name_in(k) for k in range(function.n_in())]
        self.solving: dict[int, Any] = {}
        self._read(function)

    def _read(self, f: ca.Function) -> None:
        known: dict[Op, int] = {}
        work: dict[int, int] = {}

        def push(name: str, args: tuple[Any, ...]) -> int:
            if self._reciprocals and name == "DIV" and self._inverts(*args):
                return push("MUL", (args[0], push("INV", args[1:])))
            key = (name, tuple(sorted(args)) if name in _COMMUTE else args)
            if key not in known:
                known[key] = len(self.nodes)
                self.nodes.append((name, args))
                self._fixed.append(self._is_fixed(name, args))
            return known[key]

        # Positions of the stored elements in the dense columns.
        rows_in = [list(f.sparsity_in(k).row()) for k in range(f.n_in())]
        rows_out = [list(f.sparsity_out(k).row()) for k in range(f.n_out())]
        calls = functools.cache(f.instructions_sx)
        op_of, ins, outs = f.instruction_id, f.instruction_input, f.instruction_output
        for k in range(f.n_instructions()):
            name = _NAMES[op_of(k)]
            if name == "CONST":
                work[outs(k)[0]] = push(name, (float(f.instruction_constant(k)),))
            elif name == "INPUT":
                slot, index = ins(k)
                work[outs(k)[0]] = push(name, (slot, rows_in[slot][index]))
            elif name == "OUTPUT":
                slot, index = outs(k)
                if f.name_out(slot) != "roots":  # kernels have solutions of loops in their memory
                    self.outputs[slot, rows_out[slot][index]] = work[ins(k)[0]]
            elif name == "CALL":
                made = self._solution(calls()[k].which_function(), [work[j] for j in ins(k)], push)
                work |= {slot: node for slot, node in zip(outs(k), made, strict=False) if slot >= 0}
            else:
                work[outs(k)[0]] = push(name, tuple(work[j] for j in ins(k)))

    def _solution(self, solver: Any, args: list[int], push: Callable[[str, tuple[Any, ...]], int]) -> list[int]:
        """The nodes of a call that solves a loop; derivatives of such a call count as 0 (see ``LoopForms``)."""
        if not solver.name().startswith(NAME):
            return [push("CONST", (0.0,))] * solver.nnz_out()
        number, size = int(solver.name().removeprefix(NAME)), solver.numel_in(0)
        self.solving[number] = solver
        call = push(f"SOLVE {number}", tuple(args[size:]))
        return [push(f"ROOT {i}", (call,)) for i in range(size)]

    def _is_fixed(self, name: str, args: tuple[Any, ...]) -> bool:
        """Whether a node depends on parameters only."""
        if name == "INPUT":
            return self.inputs[args[0]] == "p"
        return name == "CONST" or all(self._fixed[j] for j in args)

    def _inverts(self, over: int, under: int) -> bool:
        return self._fixed[under] and not self._fixed[over] and self.nodes[under][0] != "CONST"

    def is_leaf(self, node: int) -> bool:
        """Whether a node is a constant or an input."""
        return self.nodes[node][0] in ("CONST", "INPUT")

    def needed(self, goals: Iterable[int], known: Collection[int] = ()) -> set[int]:
        """Nodes that the goals depend on, themselves included, other than through ``known`` nodes."""
        found: set[int] = set()
        stack = list(goals)
        while stack:
            node = stack.pop()
            if node not in found:
                found.add(node)
                stack.extend(() if node in known else self.arguments(node))
        return found

    def arguments(self, node: int) -> tuple[int, ...]:
        """Nodes an operation reads."""
        return () if self.is_leaf(node) else self.nodes[node][1]

    def grade(self, slots: dict[int, Any], solved: int = 0) -> list[Any]:
        """For each node the largest grade among the inputs it depends on; ``slots`` maps (slot, index) or slot.

        The solution of a loop that depends on any has at least the grade ``solved``.
        """
        grades: list[Any] = []
        for name, args in self.nodes:
            if name == "CONST":
                grades.append(0)
            elif name == "INPUT":
                grade = slots[args[0]]
                grades.append(grade[args[1]] if isinstance(grade, (tuple, list)) else grade)
            else:
                grade = max((grades[j] for j in args), default=0)
                grades.append(max(grade, solved) if grade and name.startswith("SOLVE") else grade)
        return grades

    def evaluated(self, node: int, args: list[Any]) -> Any:
        """An operation on expressions; a solution of a loop has the signals of its tear in a column."""
        name = self.nodes[node][0]
        kind, _, number = name.partition(" ")
        if kind == "SOLVE":
            solver = self.solving[int(number)]
            return solver(ca.SX.zeros(solver.numel_in(0)), ca.vertcat(ca.SX(0, 1), *args))[0]
        if kind == "ROOT":
            return args[0][int(number)]
        if name == "INV":
            return 1 / args[0]
        code = getattr(ca, f"OP_{name}")
        return ca.SX.unary(code, *args) if len(args) == 1 else ca.SX.binary(code, *args)
