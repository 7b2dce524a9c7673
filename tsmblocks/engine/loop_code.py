"""The solution of an algebraic loop as LLVM IR: the method of ``loops``, for one number or one number per SIMD lane."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tsmblocks.engine.llvm_ir import Writer
from tsmblocks.engine.loops import (
    DECREASE,
    FINITE,
    FLOOR,
    LEAST_SHARE,
    MOST_ITERATIONS,
    STALLED,
    STARTS,
    STATISTICS,
    TOLERANCE,
    Loop,
    start_value,
)
from tsmblocks.engine.program import Program

ZERO, ONE = "0.0", "1.0"
"""Numbers as LLVM writes them."""


class LoopWriter:
    """Writes one function ``void name(ptr region, w...)`` that solves a loop from the solution kept in its region.

    ``wide`` says of each number that it reads whether it differs between lanes. ``text`` is the function.
    """

    def __init__(self, name: str, loop: Loop, wide: Sequence[bool], lanes: int, fused: bool) -> None:
        self.w = Writer(lanes, fused)
        self.wide, self.lanes, self.size = any(wide), lanes, loop.size
        self.of_step = loop.of_step
        self.type, self.bit = self.w.type(self.wide), f"<{lanes} x i1>" if self.wide else "i1"
        self.program = Program(loop.correction)
        self.node_wide = [bool(g) for g in self.program.grade({0: self.wide, 1: list(wide)})]
        self.moving = self.program.grade({0: 1, 1: 0})
        self.reads = [(f"%w{k}", self.w.type(flag)) for k, flag in enumerate(wide)]
        self.functions, self.declared = self.w.functions, self.w.declared
        self.text = self._text(name)

    # ---- short forms

    def _number(self, x: float) -> str:
        return self.w.constant(x, self.wide)

    def _compare(self, how: str, a: str, b: str) -> str:
        return self.w.emit(f"fcmp {how} {self.type} {a}, {b}")

    def _pick(self, flag: str, a: str, b: str) -> str:
        return self.w.emit(f"select {self.bit} {flag}, {self.type} {a}, {self.type} {b}")

    def _logic(self, how: str, a: str, b: str) -> str:
        return self.w.emit(f"{how} {self.bit} {a}, {b}")

    def _not(self, flag: str) -> str:
        ones = f"<{', '.join(['i1 true'] * self.lanes)}>" if self.wide else "true"
        return self._logic("xor", flag, ones)

    def _every(self, flag: str) -> str:
        """Whether a flag is set in every lane."""
        if not self.wide:
            return flag
        bits = self.w.emit(f"bitcast {self.bit} {flag} to i{self.lanes}")
        return self.w.emit(f"icmp eq i{self.lanes} {bits}, -1")

    def _size_of(self, x: str) -> str:
        return self.w.intrinsic("fabs", [x], self.wide)

    # ---- the function

    def _evaluate(self, values: dict[int, str], z: list[str], *, moving: bool) -> None:
        """Write the nodes that depend on z, or those that do not."""
        program, w = self.program, self.w
        for node in sorted(program.needed(program.outputs.values())):
            if bool(self.moving[node]) != moving or node in values:
                continue
            name, args = program.nodes[node]
            wide = self.node_wide[node]
            if name == "CONST":
                values[node] = w.constant(args[0], False)
            elif name == "INPUT":
                values[node] = z[args[1]] if args[0] == 0 else f"%w{args[1]}"
            else:
                given = [values[j] if self.node_wide[j] or not wide else w.widen(values[j]) for j in args]
                values[node] = w.operation(name, given, wide)

    def _result(self, values: dict[int, str], slot: int, index: int) -> str:
        node = self.program.outputs.get((slot, index))
        if node is None:
            return self._number(0.0)
        return values[node] if self.node_wide[node] or not self.wide else self.w.widen(values[node])

    def _text(self, name: str) -> str:
        w = self.w
        guess, undefined, values = self._entry()
        entry, w.lines = w.lines, []
        w.label("loop")
        after, ended = self._iteration(guess, values)
        body, w.lines = w.lines[1:], []
        types = {"count": "double", "done": self.bit}
        first = self._first(guess, undefined)
        phis = [
            f"  %{k} = phi {types.get(k, self.type)} [ {first[k]}, %entry ], [ {value}, %next ]"
            for k, value in after.items()
        ]
        w.do(f"br i1 {ended}, label %end, label %loop")
        w.label("end")
        self._keep([after[f"root{k}"] for k in range(self.size)], after["count"], undefined)
        reads = "".join(f", {kind} {value}" for value, kind in self.reads)
        head = f"define internal void @{name}(ptr noalias %region{reads}) noinline {{"
        return "\n".join([head, "entry:", *entry, "  br label %loop", "loop:", *phis, *body, *w.lines, "}"])

    def _entry(self) -> tuple[list[str], str, dict[int, str]]:
        """The last solution (0 where there is none), whether a number that is read is NaN, and what does not move."""
        w, guess = self.w, []
        for k in range(self.size):
            last = w.load(w.at("%region", k * (self.lanes if self.wide else 1)), self.wide)
            finite = self._compare("olt", self._size_of(last), self._number(math.inf))
            guess.append(self._pick(finite, last, self._number(0.0)))
        undefined = self._compare("une", self._number(0.0), self._number(0.0))
        for value, kind in self.reads:
            one = w.widen(value) if self.wide and kind == "double" else value
            undefined = self._logic("or", undefined, self._compare("uno", one, one))
        values: dict[int, str] = {}
        self._evaluate(values, [], moving=False)
        w.end_of_entry()
        return guess, undefined, values

    def _first(self, guess: list[str], undefined: str) -> dict[str, str]:
        """State of the method before its first iteration."""
        zero = self._number(0.0)
        first = {"merit": self._number(math.inf), "share": self._number(1.0), "tries": zero, "start": zero}
        first |= {"count": ZERO, "done": undefined}
        for k, value in enumerate(guess):
            first |= {f"root{k}": self._number(math.nan), f"c{k}": value, f"z{k}": value, f"dz{k}": zero}
        return first

    def _iteration(self, guess: list[str], values: dict[int, str]) -> tuple[dict[str, str], str]:
        """One evaluation and what follows from it (see ``loops``): the state after it, and whether all is done."""
        w, n, values = self.w, range(self.size), dict(values)
        zero, one = self._number(0.0), self._number(1.0)
        self._evaluate(values, [f"%c{k}" for k in n], moving=True)
        step, size = [self._result(values, 0, k) for k in n], self._result(values, 1, 0)
        near = self._compare("one", self._result(values, 2, 0), zero)
        small, accepted = self._logic("and", near, self._small(step, guess, size)), self._accepted(size)
        points = [(self._pick(accepted, f"%c{k}", f"%z{k}"), self._pick(accepted, step[k], f"%dz{k}")) for k in n]
        merit, share = self._pick(accepted, size, "%merit"), self._share(accepted)
        tries = w.emit(f"fadd {self.type} %tries, {one}")
        spent = self._compare("oge", tries, self._number(MOST_ITERATIONS))
        stuck = self._logic("or", self._compare("olt", share, self._number(LEAST_SHARE)), spent)
        failed = self._logic("and", stuck, self._not(small))
        start = self._pick(failed, w.emit(f"fadd {self.type} %start, {one}"), "%start")
        over = self._logic("or", small, self._compare("ogt", start, self._number(STARTS)))
        solved = self._logic("and", small, self._not("%done"))
        after = {
            "merit": self._pick(failed, self._number(math.inf), merit),
            "share": self._pick(failed, one, share),
            "tries": self._pick(failed, zero, tries),
            "start": start,
            "count": w.emit(f"fadd double %count, {ONE}"),
            "done": self._logic("or", "%done", over),
        }
        for k, (z, dz) in enumerate(points):
            found = w.emit(f"fadd {self.type} %c{k}, {step[k]}")
            after[f"root{k}"] = self._pick(solved, found, f"%root{k}")
            after[f"c{k}"] = w.emit(f"fadd {self.type} {z}, {w.emit(f'fmul {self.type} {share}, {dz}')}")
            after[f"z{k}"] = z
            after[f"dz{k}"] = self._pick(failed, zero, dz)
        ended = self._every(after["done"])
        self._begin_again(after, failed, start)
        return after, ended

    def _accepted(self, size: str) -> str:
        """Whether a candidate reduces the sum of squares enough."""
        lower = self.w.emit(f"fmul {self.type} %share, {self._number(-DECREASE)}")
        factor = self.w.emit(f"fadd {self.type} {lower}, {self._number(1.0)}")
        below = self._compare("ole", size, self.w.emit(f"fmul {self.type} %merit, {factor}"))
        return self._logic("and", below, self._compare("olt", size, self._number(FINITE)))

    def _share(self, accepted: str) -> str:
        """The share of the next correction that is taken."""
        one = self._number(1.0)
        more = self.w.emit(f"fmul {self.type} %share, {self._number(4.0)}")
        more = self._pick(self._compare("olt", more, one), more, one)
        return self._pick(accepted, more, self.w.emit(f"fmul {self.type} %share, {self._number(0.5)}"))

    def _begin_again(self, after: dict[str, str], failed: str, start: str) -> None:
        """Candidates where the method restarts, in a separate block since that is rare."""
        w, n = self.w, range(self.size)
        none = self._every(self._not(failed))
        w.do(f"br i1 {none}, label %next, label %again")
        w.label("again")
        others = [self._pick(failed, self._start(k, start), after[f"c{k}"]) for k in n]
        points = [self._pick(failed, others[k], after[f"z{k}"]) for k in n]
        w.do("br label %next")
        w.label("next")
        for name, values in (("c", others), ("z", points)):
            for k in n:
                before = after[f"{name}{k}"]
                after[f"{name}{k}"] = w.emit(f"phi {self.type} [ {before}, %loop ], [ {values[k]}, %again ]")

    def _start(self, k: int, number: str) -> str:
        """The k-th signal at a start."""
        value = self._number(0.0)
        for n in range(1, STARTS + 1):
            value = self._pick(self._compare("oeq", number, self._number(n)), self._number(start_value(n, k)), value)
        return value

    def _small(self, step: list[str], guess: list[str], size: str) -> str:
        """Whether a correction is so small that the method ends."""
        w, small = self.w, ""
        floor = self._number(FLOOR)
        if not self.of_step:
            enough = w.emit(f"fmul {self.type} %merit, {self._number(STALLED)}")
            floor = self._pick(self._compare("ogt", size, enough), floor, self._number(0.0))
        for k, value in enumerate(step):
            sizes = w.emit(f"fadd {self.type} {self._size_of(f'%c{k}')}, {self._size_of(guess[k])}")
            most = w.emit(f"fmul {self.type} {sizes}, {self._number(TOLERANCE)}")
            most = w.emit(f"fadd {self.type} {most}, {floor}")
            one = self._compare("ole", self._size_of(value), most)
            small = self._logic("and", small, one) if small else one
        return small

    def _keep(self, root: list[str], count: str, undefined: str) -> None:
        """Store the solution and the statistics."""
        w, stride = self.w, self.lanes if self.wide else 1
        for k, value in enumerate(root):
            w.store(value, w.at("%region", k * stride), self.wide)
        failed = self._logic("and", self._compare("uno", root[0], root[0]), self._not(undefined))
        some = self._every(self._not(failed))
        failures = w.emit(f"select i1 {some}, double {ZERO}, double {ONE}")
        place = {name: w.at("%region", self.size * stride + k) for k, name in enumerate(STATISTICS)}
        for name, value in (("solved", ONE), ("iterations", count), ("failed", failures)):
            w.store(w.emit(f"fadd double {w.load(place[name], False)}, {value}"), place[name], False)
        before = w.load(place["most"], False)
        more = w.emit(f"fcmp ogt double {count}, {before}")
        w.store(w.emit(f"select i1 {more}, double {count}, double {before}"), place["most"], False)
        w.do("ret void")
