"""The form of kernel for large diagrams: states in memory, the right-hand side cut into functions.

A single function of many thousand operations takes a compiler time that grows faster than its
length; functions of some hundred operations that pass values through a work array do not.
"""

from __future__ import annotations

from collections.abc import Iterable

import attrs

from tsmblocks.engine.equations import DELAY_NUMBERS
from tsmblocks.engine.kernel_frame import CONSTANT, KernelFrame, grades_of
from tsmblocks.engine.llvm_ir import Writer, llvm_double
from tsmblocks.engine.plan import Layout, Plan
from tsmblocks.engine.program import Program

FUNCTION_OPERATIONS = 200
"""Operations in one function. Chosen: some hundred, for which compile time is linear."""
WIDTH = 8
"""Doubles that loops over states process at a time (a 512-bit vector); arrays in the work area are padded to it."""

_ARGUMENTS = ("x", "d", "p", "u", "q", "hit", "work", "fixed", "o0", "o1", "o2")
_SIGNATURE = "double %t, " + ", ".join(f"ptr noalias %{a}" for a in _ARGUMENTS)
Store = tuple[int | None, str, int, bool]
"""(node or None for zero, array, offset, wide): where the value of an output is stored."""


@attrs.define
class _Job:
    """One program to be cut: which nodes, where results go, which nodes are fixed beforehand."""

    name: str
    program: Program
    wide: list[bool]
    stores: list[Store]
    fixed: dict[int, int]  # node -> place in the array of fixed values


class LargeKernel:
    """Writes one kernel in the large form."""

    def __init__(self, plan: Plan, host: str) -> None:
        self.f = KernelFrame(plan, host)
        self.plan, self.w = plan, self.f.w
        self.layouts = {
            "x": self.f.x,
            "d": self.f.d,
            "p": self.f.p,
            "q": self.f.q,
            "u": Layout.of((False,) * plan.inputs, plan.lanes),
            "hit": Layout.of((False,) * plan.groups, plan.lanes),
        }
        self.parts: list[str] = []
        self.temporaries = 0
        self.fixed_size = 0

    # ---- cutting

    def _fix(self, program: Program, wide: list[bool]) -> tuple[dict[int, int], list[int]]:
        """Places for the nodes that depend on parameters only and that others read."""
        grade = grades_of(program)
        readers = {j for n, g in enumerate(grade) if g > CONSTANT for j in program.arguments(n)}
        chosen = [
            n
            for n in sorted(readers | set(program.outputs.values()))
            if grade[n] == CONSTANT and program.nodes[n][0] not in ("CONST", "INPUT")
        ]
        places = {}
        for node in chosen:
            places[node] = self.fixed_size
            self.fixed_size += self.plan.lanes if wide[node] else 1
        return places, chosen

    def _cut(self, job: _Job) -> None:
        """Write a program as functions of some hundred operations and one that calls them."""
        program = job.program
        nodes = sorted(program.needed(n for n, *_ in job.stores if n is not None))
        work = [n for n in nodes if program.nodes[n][0] not in ("CONST", "INPUT") and n not in job.fixed]
        work = self._without_fixed(program, work, job)
        piece = {n: k // FUNCTION_OPERATIONS for k, n in enumerate(work)}
        last_use: dict[int, int] = {}
        for node in work:
            for j in program.arguments(node):
                last_use[j] = piece[node]
        places: dict[int, int] = {}
        for node in work:
            if last_use.get(node, -1) > piece[node]:
                places[node] = self.temporaries
                self.temporaries += self.plan.lanes if job.wide[node] else 1
        count = len(work) // FUNCTION_OPERATIONS + 1
        ends: dict[int, list[Store]] = {}
        for store in job.stores:
            ends.setdefault(piece.get(store[0], count - 1) if store[0] is not None else count - 1, []).append(store)
        for k in range(count):
            self._piece(job, k, work[k * FUNCTION_OPERATIONS : (k + 1) * FUNCTION_OPERATIONS], places, ends.get(k, []))
        calls = "\n".join(
            f"  call void @{job.name}_{k}(double %t, {', '.join(f'ptr %{a}' for a in _ARGUMENTS)})"
            for k in range(count)
        )
        self.parts.append(f"define internal void @{job.name}({_SIGNATURE}) noinline {{\n{calls}\n  ret void\n}}")

    @staticmethod
    def _without_fixed(program: Program, work: list[int], job: _Job) -> list[int]:
        """Drop nodes that only fixed nodes need."""
        wanted = {n for n, *_ in job.stores if n is not None}
        for node in reversed(work):
            if node in wanted:
                wanted.update(j for j in program.arguments(node) if j not in job.fixed)
        return [n for n in work if n in wanted]

    def _piece(self, job: _Job, k: int, work: list[int], places: dict[int, int], stores: Iterable[Store]) -> None:
        w, program = Writer(self.plan.lanes, self.plan.fused), job.program
        w.functions = self.w.functions  # shared elementary functions, each written once
        values: dict[int, str] = {}

        def get(node: int, wide: bool) -> str:
            if node not in values:
                values[node] = self._fetch(w, job, node, places)
            return w.widen(values[node]) if wide and not job.wide[node] else values[node]

        def put(goal: int | None, array: str, offset: int, wide: bool) -> None:
            value = w.constant(0.0, wide) if goal is None else get(goal, wide)
            w.store(value, w.at(f"%{array}", offset), wide)

        due: dict[int | None, list[Store]] = {}
        for store in stores:
            due.setdefault(store[0], []).append(store)
        for node in work:
            name, args = program.nodes[node]
            values[node] = w.operation(name, [get(j, job.wide[node]) for j in args], job.wide[node])
            if node in places:
                w.store(values[node], w.at("%work", places[node]), job.wide[node])
            for store in due.pop(node, ()):  # stored at once, so that it need not stay on the stack
                put(*store)
        for left in due.values():
            for store in left:
                put(*store)
        self.w.declared.update(w.declared)
        body = "\n".join(w.lines)
        self.parts.append(f"define internal void @{job.name}_{k}({_SIGNATURE}) noinline {{\n{body}\n  ret void\n}}")

    def _fetch(self, w: Writer, job: _Job, node: int, places: dict[int, int]) -> str:
        """Load a value made before this piece: an input, a fixed value, or one from the work array."""
        name, args = job.program.nodes[node]
        if name == "CONST":
            return llvm_double(args[0])
        if name == "INPUT":
            slot = job.program.inputs[args[0]]
            return "%t" if slot == "t" else w.load(w.at(f"%{slot}", self.layouts[slot].offset[args[1]]), job.wide[node])
        if node in job.fixed:
            return w.load(w.at("%fixed", job.fixed[node]), job.wide[node])
        return w.load(w.at("%work", places[node]), job.wide[node])

    # ---- the whole

    def text(self) -> str:
        """The whole kernel as LLVM IR."""
        f, plan = self.f, self.plan
        out = f.rhs.outputs
        places, chosen = self._fix(f.rhs, f.wide)
        rates: list[Store] = [(out.get((0, k)), "o0", f.x.offset[k], v) for k, v in enumerate(f.x.wide)]
        logged: list[Store] = [(out.get((1, j)), "o1", f.y.offset[i], f.y.wide[i]) for i, j in enumerate(plan.y)]
        kept: list[Store] = [(out.get((2, k)), "o2", f.s.offset[k], v) for k, v in enumerate(f.s.wide)]
        self._cut(_Job("before", f.rhs, f.wide, [(n, "fixed", places[n], f.wide[n]) for n in chosen], {}))
        self._cut(_Job("rates", f.rhs, f.wide, rates, places))
        self._cut(_Job("first", f.rhs, f.wide, [*rates, *logged, *kept], places))
        if f.update is not None:
            self._cut_update()
        if f.lag is not None:
            wide = f.widths(f.lag)
            taus: list[Store] = [
                (f.lag.outputs.get((0, k)), "o0", place, f.s.wide[k]) for k, place in enumerate(f.s.offset)
            ]
            self._cut(_Job("delays", f.lag, wide, taus, {}))
        self._place()
        self._main()
        return "\n".join([*self.parts, *self.w.lines]) + "\n" + _COMBINE + self.w.module()

    def _cut_update(self) -> None:
        f = self.f
        assert f.update is not None
        wide = f.widths(f.update)
        places, chosen = self._fix(f.update, wide)
        new: list[Store] = [
            (f.update.outputs.get((slot, k)), f"o{slot}", layout.offset[k], flag)
            for slot, layout in ((0, f.d), (1, f.x))
            for k, flag in enumerate(layout.wide)
        ]
        self._cut(_Job("before_update", f.update, wide, [(n, "fixed", places[n], wide[n]) for n in chosen], {}))
        self._cut(_Job("update", f.update, wide, new, places))

    def _place(self) -> None:
        """Offset of each array in the work area."""
        stages = len(self.plan.method.weights)
        sizes = {
            "temporaries": self.temporaries,
            "fixed": self.fixed_size,
            "xs": self.f.x.size,
            "ds": self.f.d.size,
            "ahead": self.f.x.size,
            "next": self.f.x.size,
            "q": self.f.q.size,
            "s": self.f.s.size,
            "spare": self.f.y.size,
            "dn": self.f.d.size,
            "tau": self.f.s.size,
            "hits": self.plan.groups,
        }
        sizes |= {f"slope{s}": self.f.x.size for s in range(stages)}
        self.at, place = {}, 0
        for name, size in sizes.items():
            self.at[name] = place
            place += (size + 2 * WIDTH - 1) // WIDTH * WIDTH
        self.work = place

    def _call(self, name: str, t: str, x: str, o: tuple[str, str, str], u: str = "%u") -> None:
        given = {
            "x": x,
            "d": "%ds",
            "p": "%p",
            "u": u,
            "q": "%q",
            "hit": "%hits",
            "work": "%temporaries",
            "fixed": "%fixed",
            "o0": o[0],
            "o1": o[1],
            "o2": o[2],
        }
        self.w.do(f"call void @{name}(double {t}, {', '.join(f'ptr {given[a]}' for a in _ARGUMENTS)})")

    def _combine(self, out: str, start: str, slope: str, weight: float) -> None:
        """out = start + h * weight * slope, over all states."""
        w = self.w
        part = w.emit(f"fmul double %h, {llvm_double(weight)}")
        count = (self.f.x.size + WIDTH - 1) // WIDTH
        w.do(f"call void @tsm_combine(ptr {out}, ptr {start}, ptr {slope}, double {part}, i64 {count})")

    def _copy(self, to: str, source: str, size: int) -> None:
        self.w.declared["memcpy"] = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)"
        if size:
            self.w.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {source}, i64 {8 * size}, i1 false)")

    def _main(self) -> None:
        f, w = self.f, self.w
        f.open()
        f.counters()
        for name, place in self.at.items():
            w.do(f"%{name} = getelementptr double, ptr %work, i64 {place}")
        self._copy("%xs", "%x", f.x.size)
        self._copy("%ds", "%d", f.d.size)
        nothing = ("%spare", "%spare", "%spare")
        self._call("before", "%t0", "%xs", nothing)
        if f.update is not None:
            self._call("before_update", "%t0", "%xs", nothing)
        if f.lag is not None:
            self._call("delays", "%t0", "%xs", ("%tau", "%spare", "%spare"))
        f.top()
        if f.update is not None:
            hits = f.hits()
            for g, hit in enumerate(hits):
                w.store(hit, w.at("%hits", g), False)
            self._past(0.0)
            self._call("update", "%tn", "%xs", ("%dn", "%next", "%spare"), self._inputs(0))
            self._copy("%ds", "%dn", f.d.size)
            self._copy("%xs", "%next", f.x.size)
        w.do("br label %stages")
        w.label("stages")
        self._stages()
        f.bottom()
        self._copy("%x", "%xs", f.x.size)
        self._copy("%d", "%ds", f.d.size)
        f.close()

    def _inputs(self, instant: int) -> str:
        count = self.plan.inputs
        row = self.w.emit(f"mul i64 %k, {count * len(self.plan.method.instants)}")
        return self.w.at(self.w.emit(f"getelementptr double, ptr %u, i64 {row}"), instant * count)

    def _past(self, offset: float) -> None:
        w, f = self.w, self.f
        for k, wide in enumerate(f.s.wide):
            tau = w.load(w.at("%tau", f.s.offset[k]), wide)
            delay = w.emit(f"fdiv {w.type(wide)} {tau}, {w.widen('%h') if wide else '%h'}")
            for i, value in enumerate(f.recall(k, delay, wide, offset)):
                place = DELAY_NUMBERS * k + i
                w.store(value, w.at("%q", f.q.offset[place]), f.q.wide[place])

    def _stages(self) -> None:
        f, w, method = self.f, self.w, self.plan.method
        left = w.emit("load i64, ptr %left_at")
        due = w.emit(f"icmp eq i64 {left}, 0")
        row = w.emit("load ptr, ptr %row_at")
        target = w.emit(f"select i1 {due}, ptr {row}, ptr %spare")
        self._past(0.0)
        self._call("first", "%tn", "%xs", ("%slope0", target, "%s"), self._inputs(0))
        after = w.emit(f"select i1 {due}, ptr {w.at(row, f.y.size)}, ptr {row}")
        w.do(f"store ptr {after}, ptr %row_at")
        start = w.emit(f"select i1 {due}, i64 %every, i64 {left}")
        w.do(f"store i64 {w.emit(f'sub i64 {start}, 1')}, ptr %left_at")
        w.do(f"br i1 {w.emit('icmp eq i64 %k, %n')}, label %done, label %step")
        w.label("step")
        for k, wide in enumerate(f.s.wide):
            f.remember(k, w.load(w.at("%s", f.s.offset[k]), wide))
        self._combine("%next", "%xs", "%slope0", method.weights[0])
        for stage, (weights, offset) in enumerate(zip(method.rows[1:], method.offsets[1:], strict=True), 1):
            base = "%xs"
            for j, weight in enumerate(weights):
                if weight:
                    self._combine("%ahead", base, f"%slope{j}", weight)
                    base = "%ahead"
            self._past(offset)
            inputs = self._inputs(method.instants.index(offset))
            self._call("rates", f.time_at(offset), "%ahead", (f"%slope{stage}", "%spare", "%spare"), inputs)
            self._combine("%next", "%next", f"%slope{stage}", method.weights[stage])
        self._copy("%xs", "%next", f.x.size)


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
