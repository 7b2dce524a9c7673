"""The form of kernel for ordinary diagrams: states, stages and hoisted values all in registers."""

from __future__ import annotations

from tsmblocks.engine.kernel_frame import CONSTANT, HELD, TIME, KernelFrame, LaneProgram
from tsmblocks.engine.llvm_ir import llvm_double
from tsmblocks.engine.plan import Plan

Values = dict[int, str]


class RegisterKernel(KernelFrame):
    """Writes one kernel. Each node is computed as seldom as it changes: once, per instant, or per stage.

    ``goals`` are the nodes of the results of ``rhs`` (None for a result that is zero). A node, or an element of
    a vector, is wide where it has one value per lane.
    """

    work = 0
    """Doubles of working memory."""

    def __init__(self, plan: Plan, host: str) -> None:
        super().__init__(plan, host)
        rates = range(0 if plan.advance is not None else len(plan.wide_x))
        wanted = {"dx": rates, "y": plan.y, "s": range(len(plan.wide_s))}
        nodes = [[self.rhs.outputs.get((slot, k)) for k in picked] for slot, picked in enumerate(wanted.values())]
        self.goals = dict(zip(wanted, nodes, strict=True))
        self.results = {n for part in nodes for n in part if n is not None}
        self.all_nodes = self.rhs.needed(self.results)
        self.rate_nodes = self.rhs.needed(n for n in self.goals["dx"] if n is not None)
        # The last stage of a step and the first of the next then share an instant, so what depends on time is reused.
        self.carries = 1.0 in plan.method.offsets and not self.jumps and plan.advance is None

    # ---- nodes

    def write(self, program: LaneProgram, nodes: set[int], values: Values, read: dict[str, list[str]]) -> None:
        """Write the nodes not yet among ``values``; ``read`` holds the inputs by slot name."""
        for node in sorted(nodes):
            if node in values:
                continue
            name, args = program.nodes[node]
            if name == "CONST":
                values[node] = llvm_double(args[0])
            elif name == "INPUT":
                values[node] = read[program.inputs[args[0]]][args[1]]
            else:
                values[node] = self.operation(self.w, program, node, [values[j] for j in args])

    def result(self, program: LaneProgram, node: int | None, values: Values, wide: bool) -> str:
        """The value of an output, widened where it is stored for each lane."""
        if node is None:
            return self.w.constant(0.0, wide)
        return values[node] if program.wide[node] or not wide else self.w.widen(values[node])

    # ---- the whole

    def text(self) -> str:
        """The whole kernel as LLVM IR."""
        self.write_run()
        return "\n".join(self.w.lines) + "\n" + self.w.module()

    def after_loop(self) -> None:
        for name, layout in (("x", self.x), ("d", self.d)):
            for k, wide in enumerate(layout.wide):
                self.w.store(self.w.load(f"%{name}_{k}", wide), self.w.at(f"%{name}", layout.offset[k]), wide)

    def before_loop(self) -> None:
        w = self.w
        self.parameters = [w.load(w.at("%p", self.p.offset[k]), wide) for k, wide in enumerate(self.p.wide)]
        for name, layout in (("x", self.x), ("d", self.d)):
            for k, wide in enumerate(layout.wide):
                w.do(f"%{name}_{k} = alloca {w.type(wide)}, align 8")
                w.store(w.load(w.at(f"%{name}", layout.offset[k]), wide), f"%{name}_{k}", wide)
        self.carried = self._carried_nodes() if self.carries else []
        # Before all that may be inlined with branches: an alloca behind one takes the stack off the lanes' alignment.
        for node in self.carried:
            w.do(f"%c{node} = alloca {w.type(self.rhs.wide[node])}, align 8")
        self.fixed = self._constants(self.rhs, self.all_nodes)
        if self.update is not None:
            self.update_fixed = self._constants(self.update, self.update.needed(self.update.outputs.values()))
        if self.advance is not None:
            self.advance_fixed = self._constants(self.advance, self.advance.needed(self.advance.outputs.values()))
        self._delays()
        if self.carried:
            first = w.emit(self.time_of(w.emit("sitofp i64 %k0 to double")))
            values = self._time_only(first, dict(self.fixed))
            for node in self.carried:
                w.store(values[node], f"%c{node}", self.rhs.wide[node])
        self._widen_constants()
        w.end_of_entry()

    def _widen_constants(self) -> None:
        """Single numbers that lanes read at every step, and the fractions of the step, widened once."""
        rhs = self.rhs
        for node in self.all_nodes:
            for j in rhs.arguments(node) if rhs.wide[node] else ():
                if not rhs.wide[j] and rhs.grades[j] == CONSTANT:
                    self.w.widen(self.fixed[j])
        weights = {a for row in (*self.plan.method.rows, self.plan.method.weights) for a in row if a}
        self.fraction = {}
        for weight in weights:
            part = "%h" if weight == 1 else self.w.emit(f"fmul double %h, {llvm_double(weight)}")
            self.fraction[weight] = part
            if any(self.x.wide):
                self.w.widen(part)

    def _constants(self, program: LaneProgram, nodes: set[int]) -> Values:
        """The values of those nodes that depend on parameters only."""
        values: Values = {}
        self.write(
            program, {n for n in nodes if program.grades[n] == CONSTANT}, values, {"p": self.parameters, "h": ["%h"]}
        )
        return values

    def _delays(self) -> None:
        """Delays in steps."""
        w = self.w
        self.delay: list[tuple[str, bool]] = []
        if self.lag is None:
            return
        values = self._constants(self.lag, self.lag.needed(self.lag.outputs.values()))
        for k in range(len(self.s.wide)):
            node = self.lag.outputs.get((0, k))
            is_wide = node is not None and self.lag.wide[node]
            tau = self.result(self.lag, node, values, is_wide)
            h = w.widen("%h") if is_wide else "%h"
            self.delay.append((w.emit(f"fdiv {w.type(is_wide)} {tau}, {h}"), is_wide))

    def _carried_nodes(self) -> list[int]:
        """Time-only nodes read by others at the first stage: carried from one step's end to the next's start."""
        rhs = self.rhs
        readers = {j for n in self.all_nodes if rhs.grades[n] > TIME for j in rhs.arguments(n)}
        return sorted(n for n in readers | self.results if rhs.grades[n] == TIME and rhs.nodes[n][0] != "INPUT")

    def _time_only(self, t: str, values: Values) -> Values:
        """The carried nodes at time ``t``, added to ``values``."""
        self.write(self.rhs, self.rhs.needed(self.carried), values, {"t": [t], "p": self.parameters})
        return values

    def update_section(self, hits: list[str]) -> None:
        w = self.w
        assert self.update is not None
        read = {"t": ["%tn"], "p": self.parameters, "hit": hits, **self._states()}
        read |= {"u": self._inputs(0), "q": self._past(0.0)}
        values = dict(self.update_fixed)
        self.write(self.update, self.update.needed(self.update.outputs.values()), values, read)
        for slot, name, layout in ((0, "d", self.d), (1, "x", self.x)):
            for k, flag in enumerate(layout.wide):
                value = self.result(self.update, self.update.outputs.get((slot, k)), values, flag)
                if value != read[name][k]:
                    w.store(value, f"%{name}_{k}", flag)

    def _states(self) -> dict[str, list[str]]:
        """The present states and memory."""
        w = self.w
        return {
            name: [w.load(f"%{name}_{k}", wide) for k, wide in enumerate(layout.wide)]
            for name, layout in (("x", self.x), ("d", self.d))
        }

    def _inputs(self, instant: int) -> list[str]:
        """Sampled inputs of this step at one instant of the method."""
        w, count = self.w, self.plan.inputs
        if not count:
            return []
        row = w.emit(f"mul i64 %k, {count * len(self.plan.method.instants)}")
        base = w.emit(f"getelementptr double, ptr %u, i64 {row}")
        return [w.load(w.at(base, instant * count + k), False) for k in range(count)]

    def _past(self, offset: float) -> list[str]:
        """The past of delayed signals at a stage, in the order of ``q``."""
        return [v for k, (delay, wide) in enumerate(self.delay) for v in self.recall(k, delay, wide, offset)]

    def stage_section(self) -> None:
        if self.advance is not None:
            self._implicit_step(self.advance)
        else:
            self._stages()

    def _implicit_step(self, step: LaneProgram) -> None:
        """Log, and one step whose stages are solved."""
        w, now, instants = self.w, self._states(), self.plan.method.instants
        read = {"t": ["%tn"], **now, "u": self._inputs(0), "q": self._past(0.0), "p": self.parameters}
        values = dict(self.fixed)
        self.write(self.rhs, self.all_nodes, values, read)
        self._log(values)
        for k, node in enumerate(self.goals["s"]):
            self.remember(k, self.result(self.rhs, node, values, self.s.wide[k]))
        read |= {"h": ["%h"], "t": [self.time_at(offset) for offset in instants]}
        read["u"] = [value for i in range(len(instants)) for value in self._inputs(i)]
        read["q"] = [value for offset in instants for value in self._past(offset)]
        values = dict(self.advance_fixed)
        self.write(step, step.needed(step.outputs.values()), values, read)
        for k, wide in enumerate(self.x.wide):
            w.store(self.result(step, step.outputs.get((0, k)), values, wide), f"%x_{k}", wide)

    def _stages(self) -> None:
        w, method = self.w, self.plan.method
        now = self._states()
        start, x_wide = now["x"], self.x.wide
        instants: dict[float, tuple[Values, list[str], str]] = {}
        rates: list[list[str]] = []
        for stage, (row, offset) in enumerate(zip(method.rows, method.offsets, strict=True)):
            if offset not in instants:
                instants[offset] = self._instant(offset)
            shared, inputs, t = instants[offset]
            x = start if stage == 0 else self._weighted_step(start, rates, row)
            read = {"t": [t], "x": x, "d": now["d"], "u": inputs, "q": self._past(offset), "p": self.parameters}
            values = dict(shared)
            self.write(self.rhs, self.rate_nodes if stage else self.all_nodes, values, read)
            shared.update({n: v for n, v in values.items() if self.rhs.grades[n] <= HELD})
            slopes = zip(self.goals["dx"], x_wide, strict=True)
            rates.append([self.result(self.rhs, node, values, wide) for node, wide in slopes])
            if stage == 0:
                self._log(values)
                for k, node in enumerate(self.goals["s"]):
                    self.remember(k, self.result(self.rhs, node, values, self.s.wide[k]))
        for k, value in enumerate(self._weighted_step(start, rates, method.weights)):
            w.store(value, f"%x_{k}", x_wide[k])
        self._store_carried(instants)

    def _log(self, values: Values) -> None:
        """Write one row when it is due."""
        w, (left, due) = self.w, self.due()
        w.do(f"br i1 {due}, label %write, label %written")
        w.label("write")
        row = w.emit("load ptr, ptr %row_at")
        for k, (node, wide) in enumerate(zip(self.goals["y"], self.y.wide, strict=True)):
            w.store(self.result(self.rhs, node, values, wide), w.at(row, self.y.offset[k]), wide)
        w.do(f"store ptr {w.at(row, self.y.size)}, ptr %row_at")
        w.do("br label %written")
        w.label("written")
        self.after_log(left, due)

    def _instant(self, offset: float) -> tuple[Values, list[str], str]:
        """Values known before a stage at this offset: hoisted ones and, at the start of a step, carried ones."""
        values = dict(self.fixed)
        if offset == 0:
            values |= {n: self.w.load(f"%c{n}", self.rhs.wide[n]) for n in self.carried}
        return values, self._inputs(self.plan.method.instants.index(offset)), self.time_at(offset)

    def _store_carried(self, instants: dict[float, tuple[Values, list[str], str]]) -> None:
        """Time-only values at the end of this step, for the first stage of the next."""
        if not self.carried:
            return
        values, _, t = instants[1.0]
        self._time_only(t, values)
        for node in self.carried:
            self.w.store(values[node], f"%c{node}", self.rhs.wide[node])

    def _weighted_step(self, start: list[str], rates: list[list[str]], weights: tuple[float, ...]) -> list[str]:
        """x + h * sum of weighted rates; equal weights share one multiplication, and the last rate is added last."""
        w, made = self.w, []
        for k, (x, wide) in enumerate(zip(start, self.x.wide, strict=True)):
            by_weight: dict[float, str] = {}
            for weight, rate in zip(weights, rates, strict=True):
                if weight:
                    value = rate[k]
                    by_weight[weight] = w.add(by_weight[weight], value, wide) if weight in by_weight else value
            for weight, value in reversed(by_weight.items()):
                part = w.widen(self.fraction[weight]) if wide else self.fraction[weight]
                x = w.add(x, w.mul(part, value, wide), wide)
            made.append(x)
        return made
