"""The form of kernel for ordinary diagrams: states, stages and hoisted values all in registers."""

from __future__ import annotations

from tsmblocks.engine.kernel_frame import CONSTANT, HELD, TIME, KernelFrame, LaneProgram
from tsmblocks.engine.llvm_ir import llvm_double
from tsmblocks.engine.plan import Plan

Values = dict[int, str]


class RegisterKernel:
    """Writes one kernel. Each node is computed as seldom as it changes: once, per instant, or per stage.

    ``f`` is the frame: layouts, programs and the parts that both kernels share; ``w`` writes the instructions and
    returns their names. ``goals`` are the nodes of the results of ``rhs`` (None for a result that is zero). A node, or
    an element of a vector, is wide where it has one value per lane.
    """

    work = 0
    """Doubles of working memory."""

    def __init__(self, plan: Plan, host: str) -> None:
        self.f = KernelFrame(plan, host)
        self.plan, self.w = plan, self.f.w
        wanted = {"dx": range(len(plan.wide_x)), "y": plan.y, "s": range(len(plan.wide_s))}
        self.goals = {
            name: [self.f.rhs.outputs.get((slot, k)) for k in picked]
            for slot, (name, picked) in enumerate(wanted.items())
        }
        # The last stage of a step and the first of the next then share an instant, so what depends on time is reused.
        self.carries = 1.0 in plan.method.offsets and not self.f.jumps

    # ---- nodes

    def need(self, *names: str) -> set[int]:
        """The nodes that the named groups of results need."""
        goals = [n for name in names for n in self.goals[name] if n is not None]
        return self.f.rhs.needed(goals)

    def write(self, program: LaneProgram, nodes: set[int], values: Values, read: dict[str, list[str]]) -> None:
        """Write the nodes not yet among ``values``; ``read`` holds the inputs by slot name."""
        w, wide = self.w, program.wide
        for node in sorted(nodes):
            if node in values:
                continue
            name, args = program.nodes[node]
            if name == "CONST":
                values[node] = llvm_double(args[0])
            elif name == "INPUT":
                values[node] = read[program.inputs[args[0]]][args[1]]
            else:
                given = [values[j] if wide[j] or not wide[node] else w.widen(values[j]) for j in args]
                values[node] = w.operation(name, given, wide[node])

    def result(self, node: int | None, values: Values, wide: bool) -> str:
        """The value of an output, widened where it is stored for each lane."""
        if node is None:
            return self.w.constant(0.0, wide)
        value = values[node]
        return value if self.f.rhs.wide[node] or not wide else self.w.widen(value)

    # ---- the whole

    def text(self) -> str:
        """The whole kernel as LLVM IR."""
        f, w = self.f, self.w
        f.open()
        f.counters()
        self._enter()
        f.top()
        if f.update is not None:
            self._update()
        w.do("br label %stages")
        w.label("stages")
        self._stages()
        f.bottom()
        for name, layout in (("x", f.x), ("d", f.d)):
            for k, wide in enumerate(layout.wide):
                w.store(w.load(f"%{name}_{k}", wide), w.at(f"%{name}", layout.offset[k]), wide)
        f.close()
        return "\n".join(w.lines) + "\n" + w.module()

    def _enter(self) -> None:
        """Before the loop: parameters, what depends on them only, and time-only values of the first instant."""
        f, w = self.f, self.w
        self.p = [w.load(w.at("%p", f.p.offset[k]), wide) for k, wide in enumerate(f.p.wide)]
        for name, layout in (("x", f.x), ("d", f.d)):
            for k, wide in enumerate(layout.wide):
                w.do(f"%{name}_{k} = alloca {w.type(wide)}, align 8")
                w.store(w.load(w.at(f"%{name}", layout.offset[k]), wide), f"%{name}_{k}", wide)
        self.fixed = self._constants(f.rhs, self.need("dx", "y", "s"))
        if f.update is not None:
            self.update_fixed = self._constants(f.update, f.update.needed(f.update.outputs.values()))
        self._delays()
        self.carried = self._carried_nodes() if self.carries else []
        if self.carried:
            first = w.emit(f.time_of(w.emit("sitofp i64 %k0 to double")))
            values = self._time_only(first, dict(self.fixed))
            for node in self.carried:
                w.do(f"%c{node} = alloca {w.type(f.rhs.wide[node])}, align 8")
                w.store(values[node], f"%c{node}", f.rhs.wide[node])
        self._widen_constants()
        w.end_of_entry()

    def _widen_constants(self) -> None:
        """Single numbers that lanes read at every step, and the fractions of the step, widened once."""
        f, rhs = self.f, self.f.rhs
        for node in self.need("dx", "y", "s"):
            for j in rhs.arguments(node) if rhs.wide[node] else ():
                if not rhs.wide[j] and rhs.grades[j] == CONSTANT:
                    self.w.widen(self.fixed[j])
        weights = {a for row in (*self.plan.method.rows, self.plan.method.weights) for a in row if a}
        self.fraction = {}
        for weight in weights:
            part = "%h" if weight == 1 else self.w.emit(f"fmul double %h, {llvm_double(weight)}")
            self.fraction[weight] = part
            if any(f.x.wide):
                self.w.widen(part)

    def _constants(self, program: LaneProgram, nodes: set[int]) -> Values:
        """The values of those nodes that depend on parameters only."""
        values: Values = {}
        self.write(program, {n for n in nodes if program.grades[n] == CONSTANT}, values, {"p": self.p})
        return values

    def _delays(self) -> None:
        """Delays in steps."""
        f, w = self.f, self.w
        self.delay: list[tuple[str, bool]] = []
        if f.lag is None:
            return
        values = self._constants(f.lag, f.lag.needed(f.lag.outputs.values()))
        for k in range(len(f.s.wide)):
            node = f.lag.outputs.get((0, k))
            is_wide = node is not None and f.lag.wide[node]
            tau = values[node] if node is not None else llvm_double(0.0)
            h = w.widen("%h") if is_wide else "%h"
            self.delay.append((w.emit(f"fdiv {w.type(is_wide)} {tau}, {h}"), is_wide))

    def _carried_nodes(self) -> list[int]:
        """Time-only nodes read by others at the first stage: carried from one step's end to the next's start."""
        need, rhs = self.need("dx", "y", "s"), self.f.rhs
        readers = {j for n in need if rhs.grades[n] > TIME for j in rhs.arguments(n)}
        readers |= {n for part in self.goals.values() for n in part if n is not None}
        return sorted(n for n in need & readers if rhs.grades[n] == TIME and rhs.nodes[n][0] != "INPUT")

    def _time_only(self, t: str, values: Values) -> Values:
        """The carried nodes at time ``t``, added to ``values``."""
        self.write(self.f.rhs, self.f.rhs.needed(self.carried), values, {"t": [t], "p": self.p})
        return values

    def _update(self) -> None:
        """Memory, held outputs and resets, at the start of a step."""
        f, w = self.f, self.w
        assert f.update is not None
        hits = f.hits()
        read = {"t": ["%tn"], "p": self.p, "hit": hits, **self._states(), "u": self._inputs(0), "q": self._past(0.0)}
        values = dict(self.update_fixed)
        self.write(f.update, f.update.needed(f.update.outputs.values()), values, read)
        for slot, name, layout in ((0, "d", f.d), (1, "x", f.x)):
            for k, flag in enumerate(layout.wide):
                node = f.update.outputs.get((slot, k))
                value = w.constant(0.0, flag) if node is None else values[node]
                if node is not None and flag and not f.update.wide[node]:
                    value = w.widen(value)
                if value != read[name][k]:
                    w.store(value, f"%{name}_{k}", flag)

    def _states(self) -> dict[str, list[str]]:
        """The present states and memory."""
        w, f = self.w, self.f
        return {
            name: [w.load(f"%{name}_{k}", wide) for k, wide in enumerate(layout.wide)]
            for name, layout in (("x", f.x), ("d", f.d))
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
        return [v for k, (delay, wide) in enumerate(self.delay) for v in self.f.recall(k, delay, wide, offset)]

    def _stages(self) -> None:
        """The stages of the method; log and delay buffers take the values of the first one."""
        f, w, method = self.f, self.w, self.plan.method
        now = self._states()
        start, x_wide = now["x"], f.x.wide
        instants: dict[float, tuple[Values, list[str], str]] = {}
        rates: list[list[str]] = []
        for stage, (row, offset) in enumerate(zip(method.rows, method.offsets, strict=True)):
            if offset not in instants:
                instants[offset] = self._instant(offset)
            shared, inputs, t = instants[offset]
            x = start if stage == 0 else self._weighted_step(start, rates, row)
            read = {"t": [t], "x": x, "d": now["d"], "u": inputs, "q": self._past(offset), "p": self.p}
            nodes = self.need("dx", "y", "s") if stage == 0 else self.need("dx")
            values = dict(shared)
            self.write(f.rhs, nodes, values, read)
            shared.update({n: v for n, v in values.items() if f.rhs.grades[n] <= HELD})
            rates.append([self.result(n, values, wide) for n, wide in zip(self.goals["dx"], x_wide, strict=True)])
            if stage == 0:
                f.log([(self.result(n, values, wide), wide) for n, wide in zip(self.goals["y"], f.y.wide, strict=True)])
                for k, node in enumerate(self.goals["s"]):
                    f.remember(k, self.result(node, values, f.s.wide[k]))
        for k, value in enumerate(self._weighted_step(start, rates, method.weights)):
            w.store(value, f"%x_{k}", x_wide[k])
        self._store_carried(instants)

    def _instant(self, offset: float) -> tuple[Values, list[str], str]:
        """Values known before a stage at this offset: hoisted ones and, at the start of a step, carried ones."""
        values = dict(self.fixed)
        if offset == 0:
            values |= {n: self.w.load(f"%c{n}", self.f.rhs.wide[n]) for n in self.carried}
        return values, self._inputs(self.plan.method.instants.index(offset)), self.f.time_at(offset)

    def _store_carried(self, instants: dict[float, tuple[Values, list[str], str]]) -> None:
        """Time-only values at the end of this step, for the first stage of the next."""
        if not self.carried:
            return
        values, _, t = instants[1.0]
        self._time_only(t, values)
        for node in self.carried:
            self.w.store(values[node], f"%c{node}", self.f.rhs.wide[node])

    def _weighted_step(self, start: list[str], rates: list[list[str]], weights: tuple[float, ...]) -> list[str]:
        """x + h * sum of weighted rates; equal weights share one multiplication."""
        w, made = self.w, []
        for k, (x, wide) in enumerate(zip(start, self.f.x.wide, strict=True)):
            by_weight: dict[float, str] = {}
            for weight, rate in zip(weights, rates, strict=True):
                if weight:
                    value = rate[k]
                    by_weight[weight] = w.add(by_weight[weight], value, wide) if weight in by_weight else value
            for weight, value in by_weight.items():
                x = w.add(x, w.mul(self._step_times(weight, wide), value, wide), wide)
            made.append(x)
        return made

    def _step_times(self, weight: float, wide: bool) -> str:
        return self.w.widen(self.fraction[weight]) if wide else self.fraction[weight]
