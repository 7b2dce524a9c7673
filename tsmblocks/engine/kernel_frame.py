"""A whole fixed-step run as LLVM IR: one function with the loop, the stages and the log inside.

    void run(ptr table)     table: [settings, x, d, p, u, ring, y, work, loops]
    settings: [h, t0] as doubles, then [k0, n, final, every, skip, mask, n_1 … n_g] as 64-bit integers

``x`` and ``d`` are read at the start and hold the state at the end. Steps k0 … k0+n-1 are taken; with
``final`` the last instant is logged too. A row of ``y`` is written at every ``every``-th instant, the
first one after ``skip``. ``u`` has a row per step with the inputs at each instant of the method.
``ring`` keeps the past of delayed signals, ``mask``+1 instants each. Rate group g acts when k is a
multiple of n_g.

Up to some hundred operations everything lives in registers (``register_kernel``); above that (``large_kernel``) the
right-hand side is cut into functions and the states stay in memory, so that compile time grows linearly.
"""

from __future__ import annotations

import functools
from typing import Any

from tsmblocks.engine.equations import DELAY_NUMBERS, DELAY_SAMPLES
from tsmblocks.engine.llvm_ir import Writer, llvm_double
from tsmblocks.engine.loop_code import LoopWriter
from tsmblocks.engine.loops import NAME, STATISTICS
from tsmblocks.engine.plan import Layout, Plan
from tsmblocks.engine.program import Program

TABLE = ("settings", "x", "d", "p", "u", "ring", "y", "work")
"""Arrays that a kernel works on, in order; ``loops`` follow where there are some."""
SETTINGS = ("k0", "n", "final", "every", "skip", "mask")
"""64-bit integers after ``h`` and ``t0`` in the settings of a kernel, in order; the rate groups' n follow."""
CONSTANT, TIME, HELD, MOVING = range(4)
"""How often a value changes: never, with time, once a step, at each stage."""
JUMP_OFFSETS = (1e-9, 8e-12, 1 / 64)
"""Distance of the last stage before the end of a step, where a signal may jump with time: a share of the step plus a
share of the time, at most a share of the step. Chosen: above the rounding of a time, small beside a step."""

SLOTS = {
    "t": TIME,
    "x": MOVING,
    "d": HELD,
    "u": HELD,
    "q": MOVING,
    "p": CONSTANT,
    "hit": HELD,
    "guess": CONSTANT,
    "h": CONSTANT,
}
"""How often each input of a program changes."""


def grades_of(program: Program) -> list[int]:
    """How often each node's value changes: ``CONSTANT``, ``TIME``, ``HELD`` or ``MOVING``.

    The solution of a loop is not carried from step to step, so it changes at least once a step.
    """
    return program.grade({k: SLOTS[name] for k, name in enumerate(program.inputs)}, HELD)


def time_jumps(program: Program) -> bool:
    """Whether a comparison depends on time alone (a step, a staircase), or rounding on the past of a delay."""
    deciding = {"LT", "LE", "EQ", "NE", "SIGN", "FLOOR", "CEIL"}
    delays = max((args[1] for name, args in program.nodes if name == "INPUT"), default=0) // DELAY_NUMBERS + 1
    past = [MOVING if k < DELAY_SAMPLES else TIME for k in range(DELAY_NUMBERS)] * delays
    late = program.grade({k: past if name == "q" else SLOTS[name] for k, name in enumerate(program.inputs)})
    return any(
        (name in deciding and own == TIME) or (name == "FLOOR" and of_past == TIME)
        for (name, _), own, of_past in zip(program.nodes, grades_of(program), late, strict=True)
    )


class LaneProgram(Program):
    """A program of a plan; of each node how often it changes (``grades``), and whether it differs between lanes."""

    def __init__(self, plan: Plan, function: Any) -> None:
        super().__init__(function, reciprocals=plan.fused)
        past = plan.wide_q * (function.size1_in("q") // max(len(plan.wide_q), 1) if "q" in function.name_in() else 1)
        slots: dict[str, Any] = {"x": plan.wide_x, "d": plan.wide_d, "q": past, "p": plan.wide_p}
        self.grades = grades_of(self)
        self.wide = [bool(g) for g in self.grade({k: slots.get(name, False) for k, name in enumerate(self.inputs)})]


class KernelFrame:
    """Layouts, programs and the loop, which the two forms of kernel share; ``w`` writes the instructions."""

    def __init__(self, plan: Plan, host: str) -> None:
        self.plan = plan
        self.w = Writer(plan.lanes, plan.fused)
        self.host = host
        self.x, self.d, self.p, self.q, self.s = (
            Layout.of(wide, plan.lanes) for wide in (plan.wide_x, plan.wide_d, plan.wide_p, plan.wide_q, plan.wide_s)
        )
        self.rhs = LaneProgram(plan, plan.rhs)
        self.update = LaneProgram(plan, plan.update) if plan.update is not None else None
        self.lag = LaneProgram(plan, plan.lag) if plan.wide_s else None
        self.jumps = time_jumps(self.rhs) if plan.jumps is None else plan.jumps
        self.advance = LaneProgram(plan, plan.advance) if plan.advance is not None else None
        self.loops, self.regions = self._regions()
        nodes = (self.rhs.outputs.get((1, k)) for k in plan.y)
        self.y = Layout.of(tuple(node is not None and self.rhs.wide[node] for node in nodes), plan.lanes)

    # ---- the function, of which each form of kernel writes four sections

    def write_run(self) -> None:
        """Write the function ``run``, with the sections of the form of kernel inside."""
        w = self.w
        self._head()
        self.before_loop()
        w.do("br label %loop")
        w.label("loop")
        w.do("%k = load i64, ptr %k_at")
        at_end = w.emit("icmp eq i64 %k, %n")
        last = w.emit("icmp eq i64 %final, 0")  # the last instant is left out unless it is to be logged
        leave = w.emit(f"and i1 {at_end}, {last}")
        w.do(f"br i1 {leave}, label %done, label %begin")
        w.label("begin")
        w.do("%kg = add i64 %k, %k0")
        w.do("%tn = " + self.time_of(w.emit("sitofp i64 %kg to double")))
        if self.update is not None:
            self.update_section(self._hits())
        w.do("br label %stages")
        w.label("stages")
        self.stage_section()
        w.do(f"store i64 {w.emit('add i64 %k, 1')}, ptr %k_at")
        w.do("br label %loop")
        w.label("done")
        self.after_loop()
        if self.host.startswith("x86_64"):
            w.do("call void @llvm.x86.sse.ldmxcsr(ptr %mode)")
        w.do("ret void")
        w.lines.append("}")

    def before_loop(self) -> None:
        """Load the state, and form values that depend on parameters only."""
        raise NotImplementedError

    def update_section(self, hits: list[str]) -> None:
        """Memory, held outputs and resets, at the start of a step; ``hits`` is 1 or 0 for each rate group."""
        raise NotImplementedError

    def stage_section(self) -> None:
        """The log, and the stages of the method."""
        raise NotImplementedError

    def after_loop(self) -> None:
        """Store the state."""
        raise NotImplementedError

    def _head(self) -> None:
        """Load the table and the settings; set denormal numbers to zero, which cost a hundred cycles each."""
        w = self.w
        w.lines += ["define void @run(ptr noalias readonly %table) {", "entry:"]

        def read(name: str, kind: str, base: str, k: int) -> None:
            place = w.emit(f"getelementptr {kind}, ptr {base}, i64 {k}")
            w.do(f"%{name} = load {kind}, ptr {place}")

        for k, name in enumerate((*TABLE, *(("loops",) if self.plan.loops else ()))):
            read(name, "ptr", "%table", k)
        w.do("%h = load double, ptr %settings")
        read("t0", "double", "%settings", 1)
        for k, name in enumerate((*SETTINGS, *(f"every_{g}" for g in range(self.plan.groups))), 2):
            read(name, "i64", "%settings", k)
        if self.host.startswith("x86_64"):
            w.declared["mxcsr"] = "declare void @llvm.x86.sse.stmxcsr(ptr)\ndeclare void @llvm.x86.sse.ldmxcsr(ptr)"
            w.do("%mode = alloca i32")
            w.do("%quick = alloca i32")
            w.do("call void @llvm.x86.sse.stmxcsr(ptr %mode)")
            mode = w.emit("load i32, ptr %mode")
            w.do(f"store i32 {w.emit(f'or i32 {mode}, 32832')}, ptr %quick")
            w.do("call void @llvm.x86.sse.ldmxcsr(ptr %quick)")
        # Step counter, log countdown and row pointer: stack variables, which LLVM moves into registers.
        for name, kind, start in (("k", "i64", "0"), ("left", "i64", "%skip"), ("row", "ptr", "%y")):
            w.do(f"%{name}_at = alloca {kind}")
            w.do(f"store {kind} {start}, ptr %{name}_at")

    def time_of(self, steps: str) -> str:
        """The instruction that gives the time after so many steps."""
        return f"fadd contract double {self.w.emit(f'fmul contract double {steps}, %h')}, %t0"

    def time_at(self, offset: float) -> str:
        """The time at a fraction of the present step; at its end, exactly that of the next one.

        Where a signal jumps with time it is just before the end: a jump on the grid belongs to the step after it.
        """
        w = self.w
        if offset == 0:
            return "%tn"
        if offset != 1:
            return w.emit(f"fadd double %tn, {w.emit(f'fmul double %h, {llvm_double(offset)}')}")
        end = w.emit(self.time_of(w.emit(f"sitofp i64 {w.emit('add i64 %kg, 1')} to double")))
        if not self.jumps:
            return end
        of_step = w.emit(f"fmul double %h, {llvm_double(JUMP_OFFSETS[0])}")
        of_time = w.emit(f"fmul double {w.intrinsic('fabs', [end], False)}, {llvm_double(JUMP_OFFSETS[1])}")
        most = w.emit(f"fmul double %h, {llvm_double(JUMP_OFFSETS[2])}")
        before = w.operation("FMIN", [w.emit(f"fadd double {of_step}, {of_time}"), most], False)
        return w.emit(f"fsub double {end}, {before}")

    def _hits(self) -> list[str]:
        """1 or 0 for each rate group at this instant; branches over the update section when idle."""
        w = self.w
        rests = (w.emit(f"srem i64 %kg, %every_{g}") for g in range(self.plan.groups))
        flags = [w.emit(f"icmp eq i64 {rest}, 0") for rest in rests]
        numbers = [w.emit(f"uitofp i1 {flag} to double") for flag in flags]
        if self.plan.every_step or not flags:
            w.do("br label %update")
        else:
            any_hit = functools.reduce(lambda a, b: w.emit(f"or i1 {a}, {b}"), flags)
            w.do(f"br i1 {any_hit}, label %update, label %stages")
        w.label("update")
        return numbers

    def due(self) -> tuple[str, str]:
        """Instants up to the next row, and whether that is now."""
        left = self.w.emit("load i64, ptr %left_at")
        return left, self.w.emit(f"icmp eq i64 {left}, 0")

    def after_log(self, left: str, due: str) -> None:
        """Count down to the next row; leave if this was the last instant."""
        w = self.w
        start = w.emit(f"select i1 {due}, i64 %every, i64 {left}")
        w.do(f"store i64 {w.emit(f'sub i64 {start}, 1')}, ptr %left_at")
        w.do(f"br i1 {w.emit('icmp eq i64 %k, %n')}, label %done, label %step")
        w.label("step")

    # ---- algebraic loops

    def _regions(self) -> tuple[Layout, list[int]]:
        """Layout of the solutions and statistics of all loops, and where each loop begins."""
        programs = [one for one in (self.rhs, self.update, self.advance) if one is not None]
        solved = {name: one.wide[n] for one in programs for n, (name, _) in enumerate(one.nodes)}
        wide: list[bool] = []
        places = []
        for number, loop in enumerate(self.plan.loops):
            places.append(len(wide))
            wide += [solved.get(f"SOLVE {number}", False)] * loop.size + [False] * len(STATISTICS)
        layout = Layout.of(tuple(wide), self.plan.lanes)
        return layout, [layout.offset[k] for k in places]

    def operation(self, w: Writer, program: LaneProgram, node: int, given: list[str]) -> str:
        """Write one node; ``given`` are the nodes that it reads, each as wide as it is itself."""
        name, args = program.nodes[node]
        if name.startswith("SOLVE"):
            return self.solve(w, program, node, given)
        if name.startswith("ROOT"):
            return self.root(w, program, node)
        wide = program.wide[node]
        return w.operation(
            name, [v if program.wide[j] or not wide else w.widen(v) for j, v in zip(args, given, strict=True)], wide
        )

    def solve(self, w: Writer, program: LaneProgram, node: int, given: list[str]) -> str:
        """Write the call that solves a loop; its result, which nothing reads, is 0."""
        name, args = program.nodes[node]
        number, wide = int(name.partition(" ")[2]), [program.wide[j] for j in args]
        full = f"tsm_{NAME}{number}_{''.join(str(int(flag)) for flag in wide)}"
        if full not in self.w.functions:
            self.w.functions[full] = ""
            made = LoopWriter(full, self.plan.loops[number], wide, self.plan.lanes, self.plan.fused)
            self.w.functions |= made.functions | {full: made.text}
            self.w.declared |= made.declared
        reads = "".join(f", {w.type(flag)} {value}" for value, flag in zip(given, wide, strict=True))
        w.do(f"call void @{full}(ptr {w.at('%loops', self.regions[number])}{reads})")
        return w.constant(0.0, program.wide[node])

    def root(self, w: Writer, program: LaneProgram, node: int) -> str:
        """Read one signal of the solution of a loop."""
        name, (call,) = program.nodes[node]
        number, wide = int(program.nodes[call][0].partition(" ")[2]), program.wide[node]
        place = int(name.partition(" ")[2]) * (self.plan.lanes if wide else 1)
        return w.load(w.at("%loops", self.regions[number] + place), wide)

    # ---- the past of delayed signals

    def ring_of(self, k: int) -> str:
        """Pointer to the past of the k-th delayed signal."""
        w = self.w
        size = w.emit("add i64 %mask, 1")
        return w.emit(f"getelementptr double, ptr %ring, i64 {w.emit(f'mul i64 {size}, {self.s.offset[k]}')}")

    def remember(self, k: int, value: str) -> None:
        """Store the present value of the k-th delayed signal."""
        w, wide = self.w, self.s.wide[k]
        slot = w.emit("and i64 %kg, %mask")
        place = w.emit(f"mul i64 {slot}, {self.plan.lanes if wide else 1}")
        w.store(value, w.emit(f"getelementptr double, ptr {self.ring_of(k)}, i64 {place}"), wide)

    def recall(self, k: int, delay: str, wide_delay: bool, offset: float) -> list[str]:
        """The past of the k-th signal around the instant ``delay`` steps before a stage, as ``q`` holds it."""
        w, wide = self.w, self.s.wide[k]
        w.functions["tsm_past"] = _DELAY_READ
        w.declared["llvm.floor.f64"] = "declare double @llvm.floor.f64(double)"
        now = w.emit(f"fadd double {w.emit('sitofp i64 %kg to double')}, {llvm_double(offset)}")
        last = w.emit(f"add i64 %kg, {-1 if offset == 0 else 0}")
        ring, stride = self.ring_of(k), self.plan.lanes if wide else 1
        parts = DELAY_NUMBERS - 1  # all but the steps per second
        values = ["poison"] * parts
        for lane in range(self.plan.lanes if wide else 1):
            one = w.emit(f"extractelement {w.vector} {delay}, i32 {lane}") if wide_delay else delay
            place = w.emit(f"fsub double {now}, {one}")
            base = w.at(ring, lane)
            found = w.emit(
                f"call [6 x double] @tsm_past(ptr {base}, i64 %mask, i64 {stride}, double {place}, i64 {last})"
            )
            each = [w.emit(f"extractvalue [6 x double] {found}, {i}") for i in range(parts)]
            each[DELAY_SAMPLES] = w.emit(self.time_of(each[DELAY_SAMPLES]))
            if not wide:
                values = each
                break
            values = [
                w.emit(f"insertelement {w.vector} {v}, double {e}, i32 {lane}")
                for v, e in zip(values, each, strict=True)
            ]
        return [*values[: DELAY_SAMPLES + 1], w.emit(f"fdiv double {llvm_double(1.0)}, %h"), values[-1]]


_DELAY_READ = """
; what is kept around ``pos``: four values, the newest one's instant and how many instants there have been up to it
define internal [6 x double] @tsm_past(ptr %ring, i64 %mask, i64 %stride, double %pos, i64 %last) {
  %f = call double @llvm.floor.f64(double %pos)
  %m = fptosi double %f to i64
  %m2 = add i64 %m, 2
  %few = icmp slt i64 %m2, 3
  %n0 = select i1 %few, i64 3, i64 %m2
  %early = icmp slt i64 %m, 0
  %n1 = select i1 %early, i64 0, i64 %n0
  %over = icmp sgt i64 %n1, %last
  %n = select i1 %over, i64 %last, i64 %n1
  %none = icmp slt i64 %n, 0
  %i3 = select i1 %none, i64 0, i64 %n
  %i2 = sub i64 %i3, 1
  %i1 = sub i64 %i3, 2
  %i0 = sub i64 %i3, 3
  %s0 = and i64 %i0, %mask
  %s1 = and i64 %i1, %mask
  %s2 = and i64 %i2, %mask
  %s3 = and i64 %i3, %mask
  %o0 = mul i64 %s0, %stride
  %o1 = mul i64 %s1, %stride
  %o2 = mul i64 %s2, %stride
  %o3 = mul i64 %s3, %stride
  %p0 = getelementptr double, ptr %ring, i64 %o0
  %p1 = getelementptr double, ptr %ring, i64 %o1
  %p2 = getelementptr double, ptr %ring, i64 %o2
  %p3 = getelementptr double, ptr %ring, i64 %o3
  %y0 = load double, ptr %p0
  %y1 = load double, ptr %p1
  %y2 = load double, ptr %p2
  %y3 = load double, ptr %p3
  %at = sitofp i64 %i3 to double
  %c = add i64 %n, 1
  %count = sitofp i64 %c to double
  %z0 = insertvalue [6 x double] poison, double %y0, 0
  %z1 = insertvalue [6 x double] %z0, double %y1, 1
  %z2 = insertvalue [6 x double] %z1, double %y2, 2
  %z3 = insertvalue [6 x double] %z2, double %y3, 3
  %z4 = insertvalue [6 x double] %z3, double %at, 4
  %z5 = insertvalue [6 x double] %z4, double %count, 5
  ret [6 x double] %z5
}"""
