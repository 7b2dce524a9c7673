"""The form of kernel for large diagrams: states in memory, the right-hand side cut into functions.

A single function of many thousand operations takes a compiler time that grows faster than its
length; functions of some hundred operations that pass values through a work array do not.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import attrs

from tsmblocks.engine.equations import DELAY_NUMBERS
from tsmblocks.engine.kernel_frame import CONSTANT, KernelFrame, LaneProgram
from tsmblocks.engine.llvm_ir import Writer, llvm_double
from tsmblocks.engine.plan import Layout, Plan

FUNCTION_OPERATIONS = 200
"""Operations in one function. Chosen: some hundred, for which compile time is linear."""
WIDTH = 8
"""Doubles that loops over states process at a time (a 512-bit vector); arrays in the work area are padded to it."""

_ARGUMENTS = ("x", "d", "p", "u", "q", "hit", "work", "fixed", "o0", "o1", "o2")
Store = tuple[int | None, str, int, bool]
"""(node or None for zero, array, offset, wide): where the value of an output is stored."""


@attrs.frozen
class _Cut:
    """A program in pieces, with the places of its fixed nodes and of values that pass from piece to piece."""

    program: LaneProgram
    fixed: dict[int, int]
    places: dict[int, int]


def _stores(program: LaneProgram, slot: int, layout: Layout, picked: Sequence[int] | None = None) -> list[Store]:
    """Where the results of a slot are stored, in order; ``picked`` are those in use."""
    wanted = range(len(layout.wide)) if picked is None else picked
    return [
        (program.outputs.get((slot, j)), f"o{slot}", layout.offset[k], layout.wide[k]) for k, j in enumerate(wanted)
    ]


class LargeKernel(KernelFrame):
    """Writes one kernel in the large form.

    A program is cut into pieces, each a function. ``fixed`` are the places of those of its nodes that depend on
    parameters only, which are computed before the loop; values that a later piece reads are stored in ``work``.
    """

    def __init__(self, plan: Plan, host: str) -> None:
        super().__init__(plan, host)
        single = {k: Layout.of((False,) * n, plan.lanes) for k, n in (("u", plan.inputs), ("hit", plan.groups))}
        self.layouts = {"x": self.x, "d": self.d, "p": self.p, "q": self.q, **single}
        more = ("loops",) * bool(plan.loops) + ("times",) * (plan.advance is not None)
        self.arguments = (*_ARGUMENTS, *more)
        self.signature = "double %t, " + ", ".join(f"ptr noalias %{a}" for a in self.arguments)
        self.parts: list[str] = []
        self.temporaries = 0
        self.fixed_size = 0

    # ---- cutting

    def _write_fixed(self, name: str, program: LaneProgram) -> dict[int, int]:
        """Write the code of nodes that depend on parameters only and that others read; their places."""
        readers = {j for n, grade in enumerate(program.grades) if grade > CONSTANT for j in program.arguments(n)}
        chosen = [
            n
            for n in sorted(readers | set(program.outputs.values()))
            if program.grades[n] == CONSTANT and not program.is_leaf(n)
        ]
        fixed = {}
        for node in chosen:
            fixed[node] = self.fixed_size
            self.fixed_size += self.plan.lanes if program.wide[node] else 1
        self._cut(name, program, [(n, "fixed", fixed[n], program.wide[n]) for n in chosen], {})
        return fixed

    def _cut(self, name: str, program: LaneProgram, stores: list[Store], fixed: dict[int, int]) -> None:
        """Write a program as functions of some hundred operations and one that calls them."""
        nodes = program.needed((n for n, *_ in stores if n is not None), fixed)
        work = sorted(n for n in nodes if n not in fixed and not program.is_leaf(n))
        piece = {n: k // FUNCTION_OPERATIONS for k, n in enumerate(work)}
        last_use = {j: piece[n] for n in work for j in program.arguments(n)}
        places: dict[int, int] = {}
        for node in work:
            if last_use.get(node, -1) > piece[node]:
                places[node] = self.temporaries
                self.temporaries += self.plan.lanes if program.wide[node] else 1
        count = len(work) // FUNCTION_OPERATIONS + 1
        ends: list[list[Store]] = [[] for _ in range(count)]
        for store in stores:
            ends[count - 1 if store[0] is None else piece.get(store[0], count - 1)].append(store)
        cut = _Cut(program, fixed, places)
        for k in range(count):
            part = work[k * FUNCTION_OPERATIONS : (k + 1) * FUNCTION_OPERATIONS]
            self._piece(f"{name}_{k}", cut, part, ends[k])
        arguments = ", ".join(f"ptr %{a}" for a in self.arguments)
        calls = (f"  call void @{name}_{k}(double %t, {arguments})" for k in range(count))
        self._define(name, calls)

    def _define(self, name: str, lines: Iterable[str]) -> None:
        body = "\n".join(lines)
        self.parts.append(f"define internal void @{name}({self.signature}) noinline {{\n{body}\n  ret void\n}}")

    def _piece(self, name: str, cut: _Cut, work: list[int], stores: list[Store]) -> None:
        """Write one function: the operations of ``work``, and what it stores."""
        w, program = Writer(self.plan.lanes, self.plan.fused), cut.program
        w.functions = self.w.functions  # shared elementary functions, each written once
        values: dict[int, str] = {}

        def get(node: int, wide: bool) -> str:
            if node not in values:
                values[node] = self._fetch(w, cut, node)
            return w.widen(values[node]) if wide and not program.wide[node] else values[node]

        def put(goal: int | None, array: str, offset: int, wide: bool) -> None:
            value = w.constant(0.0, wide) if goal is None else get(goal, wide)
            w.store(value, w.at(f"%{array}", offset), wide)

        due: dict[int | None, list[Store]] = {}
        for store in stores:
            due.setdefault(store[0], []).append(store)
        for node in work:
            values[node] = self.operation(w, program, node, [get(j, False) for j in program.arguments(node)])
            if node in cut.places:
                w.store(values[node], w.at("%work", cut.places[node]), program.wide[node])
            for store in due.pop(node, ()):  # stored at once, so that it need not stay on the stack
                put(*store)
        for store in itertools.chain(*due.values()):
            put(*store)
        self.w.declared.update(w.declared)
        self._define(name, w.lines)

    def _fetch(self, w: Writer, cut: _Cut, node: int) -> str:
        """Load a value made before this piece: an input, a fixed value, or one from the work array."""
        name, args = cut.program.nodes[node]
        if name == "CONST":
            return llvm_double(args[0])
        if name == "INPUT":
            slot, stepping = cut.program.inputs[args[0]], cut.program is self.advance
            if slot == "t" and not stepping:
                return "%t"
            if stepping and slot in ("t", "h"):
                place = w.at("%times", args[1] if slot == "t" else len(self.plan.method.instants))
            elif stepping and slot in ("u", "q"):
                layout = self.layouts[slot]
                instant, index = divmod(args[1], len(layout.wide))
                place = w.at(f"%{slot}", instant * layout.size + layout.offset[index])
            else:
                place = w.at(f"%{slot}", self.layouts[slot].offset[args[1]])
        else:
            place = w.at("%fixed", cut.fixed[node]) if node in cut.fixed else w.at("%work", cut.places[node])
        return w.load(place, cut.program.wide[node])

    # ---- the whole

    def text(self) -> str:
        """The whole kernel as LLVM IR."""
        fixed, rates = self._write_fixed("before", self.rhs), _stores(self.rhs, 0, self.x)
        if self.advance is not None:
            rates = []
            self._cut(
                "advance",
                self.advance,
                _stores(self.advance, 0, self.x),
                self._write_fixed("before_advance", self.advance),
            )
        else:
            self._cut("rates", self.rhs, rates, fixed)
        logged = _stores(self.rhs, 1, self.y, self.plan.y)
        self._cut("first", self.rhs, [*rates, *logged, *_stores(self.rhs, 2, self.s)], fixed)
        if self.update is not None:
            fixed = self._write_fixed("before_update", self.update)
            new = [*_stores(self.update, 0, self.d), *_stores(self.update, 1, self.x)]
            self._cut("update", self.update, new, fixed)
        if self.lag is not None:
            self._cut("delays", self.lag, _stores(self.lag, 0, self.s), {})
        self._place()
        self.write_run()
        return "\n".join([*self.parts, *self.w.lines]) + "\n" + _COMBINE + self.w.module(self.parts)

    def _place(self) -> None:
        """Offset of each array in the work area."""
        sizes = {"temporaries": self.temporaries, "fixed": self.fixed_size, "xs": self.x.size, "ds": self.d.size}
        instants = len(self.plan.method.instants)
        q = self.q.size * (instants if self.advance is not None else 1)
        sizes |= {"ahead": self.x.size, "next": self.x.size, "q": q, "s": self.s.size, "spare": self.y.size}
        sizes |= {"dn": self.d.size, "tau": self.s.size, "hits": self.plan.groups}
        sizes |= {f"slope{s}": self.x.size for s in range(len(self.plan.method.weights))}
        sizes |= {"times": instants + 1} if self.advance is not None else {}
        padded = ((size + 2 * WIDTH - 1) // WIDTH * WIDTH for size in sizes.values())
        *places, self.work = itertools.accumulate(padded, initial=0)
        self.at = dict(zip(sizes, places, strict=True))

    def _call(self, name: str, t: str, x: str, o: tuple[str, str, str], u: str = "%u") -> None:
        given = {a: f"%{a}" for a in self.arguments} | {
            "x": x,
            "d": "%ds",
            "u": u,
            "hit": "%hits",
            "work": "%temporaries",
        }
        given |= zip(("o0", "o1", "o2"), o, strict=True)
        self.w.do(f"call void @{name}(double {t}, {', '.join(f'ptr {given[a]}' for a in self.arguments)})")

    def _combine(self, out: str, start: str, slope: str, weight: float) -> None:
        """out = start + h * weight * slope, over all states."""
        w = self.w
        part = w.emit(f"fmul double %h, {llvm_double(weight)}")
        count = (self.x.size + WIDTH - 1) // WIDTH
        w.do(f"call void @tsm_combine(ptr {out}, ptr {start}, ptr {slope}, double {part}, i64 {count})")

    def _copy(self, to: str, source: str, size: int) -> None:
        self.w.declared["memcpy"] = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)"
        if size:
            self.w.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {source}, i64 {8 * size}, i1 false)")

    def before_loop(self) -> None:
        for name, place in self.at.items():
            self.w.do(f"%{name} = getelementptr double, ptr %work, i64 {place}")
        self._copy("%xs", "%x", self.x.size)
        self._copy("%ds", "%d", self.d.size)
        nothing = ("%spare", "%spare", "%spare")
        self._call("before", "%t0", "%xs", nothing)
        if self.update is not None:
            self._call("before_update", "%t0", "%xs", nothing)
        if self.advance is not None:
            self.w.store("%h", self.w.at("%times", len(self.plan.method.instants)), False)
            self._call("before_advance", "%t0", "%xs", nothing)
        if self.lag is not None:
            self._call("delays", "%t0", "%xs", ("%tau", "%spare", "%spare"))

    def update_section(self, hits: list[str]) -> None:
        for g, hit in enumerate(hits):
            self.w.store(hit, self.w.at("%hits", g), False)
        self._past(0.0)
        self._call("update", "%tn", "%xs", ("%dn", "%next", "%spare"), self._inputs(0))
        self._copy("%ds", "%dn", self.d.size)
        self._copy("%xs", "%next", self.x.size)

    def after_loop(self) -> None:
        self._copy("%x", "%xs", self.x.size)
        self._copy("%d", "%ds", self.d.size)

    def _inputs(self, instant: int) -> str:
        count = self.plan.inputs
        row = self.w.emit(f"mul i64 %k, {count * len(self.plan.method.instants)}")
        return self.w.at(self.w.emit(f"getelementptr double, ptr %u, i64 {row}"), instant * count)

    def _past(self, offset: float, instant: int = 0) -> None:
        """Set ``q`` at one instant."""
        w, first = self.w, instant * self.q.size
        for k, wide in enumerate(self.s.wide):
            tau = w.load(w.at("%tau", self.s.offset[k]), wide)
            delay = w.emit(f"fdiv {w.type(wide)} {tau}, {w.widen('%h') if wide else '%h'}")
            for i, value in enumerate(self.recall(k, delay, wide, offset)):
                place = DELAY_NUMBERS * k + i
                w.store(value, w.at("%q", first + self.q.offset[place]), self.q.wide[place])

    def stage_section(self) -> None:
        w, method = self.w, self.plan.method
        left, due = self.due()
        row = w.emit("load ptr, ptr %row_at")
        target = w.emit(f"select i1 {due}, ptr {row}, ptr %spare")
        self._past(0.0)
        self._call("first", "%tn", "%xs", ("%slope0", target, "%s"), self._inputs(0))
        after = w.emit(f"select i1 {due}, ptr {w.at(row, self.y.size)}, ptr {row}")
        w.do(f"store ptr {after}, ptr %row_at")
        self.after_log(left, due)
        for k, wide in enumerate(self.s.wide):
            self.remember(k, w.load(w.at("%s", self.s.offset[k]), wide))
        if self.advance is not None:
            self._implicit_step()
            return
        self._combine("%next", "%xs", "%slope0", method.weights[0])
        for stage, (weights, offset) in enumerate(zip(method.rows[1:], method.offsets[1:], strict=True), 1):
            base = "%xs"
            for j, weight in enumerate(weights):
                if weight:
                    self._combine("%ahead", base, f"%slope{j}", weight)
                    base = "%ahead"
            self._past(offset)
            inputs = self._inputs(method.instants.index(offset))
            self._call("rates", self.time_at(offset), "%ahead", (f"%slope{stage}", "%spare", "%spare"), inputs)
            self._combine("%next", "%next", f"%slope{stage}", method.weights[stage])
        self._copy("%xs", "%next", self.x.size)

    def _implicit_step(self) -> None:
        """One step whose stages are solved."""
        for i, offset in enumerate(self.plan.method.instants):
            self._past(offset, i)
            self.w.store(self.time_at(offset), self.w.at("%times", i), False)
        self._call("advance", "%tn", "%xs", ("%next", "%spare", "%spare"), self._inputs(0))
        self._copy("%xs", "%next", self.x.size)


_COMBINE = """
define internal void @tsm_combine(ptr %out, ptr %start, ptr %slope, double %c, i64 %count) noinline {
entry:
  %one = insertelement <8 x double> poison, double %c, i32 0
  %all = shufflevector <8 x double> %one, <8 x double> poison, <8 x i32> zeroinitializer
  %none = icmp eq i64 %count, 0
  br i1 %none, label %done, label %loop
loop:
  %i = phi i64 [0, %entry], [%i1, %loop]
  %o = mul i64 %i, 8
  %pa = getelementptr double, ptr %start, i64 %o
  %pb = getelementptr double, ptr %slope, i64 %o
  %po = getelementptr double, ptr %out, i64 %o
  %a = load <8 x double>, ptr %pa, align 8
  %b = load <8 x double>, ptr %pb, align 8
  %m = fmul contract <8 x double> %b, %all
  %s = fadd contract <8 x double> %a, %m
  store <8 x double> %s, ptr %po, align 8
  %i1 = add i64 %i, 1
  %more = icmp ult i64 %i1, %count
  br i1 %more, label %loop, label %done
done:
  ret void
}
"""
