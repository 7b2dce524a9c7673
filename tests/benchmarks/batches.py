"""Many parameter sets side by side, against one run at a time."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import ours
from measure import Best, Report, race, three

import tsmblocks as tsm
from tsmblocks.engine.kernel import Steps
from tsmblocks.engine.methods import method_named
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.lanes import batch_kernel, lane_memory

TOLERANCE = 1e-9
STOP, STEPS = 10.0, 10_000
CHECKED = 2.0
"""Time [s] over which a lane is compared with a single run. In some sets the loop of Fig 16 is locally unstable at
later turning points, at any step: a difference of 1e-16 grows to 1e-2 there, so the motion before them is compared."""


def batches(report: Report) -> None:
    """10,000 sets of 10 s at 1 kHz, reduced to a peak-to-peak value each: Fig 16 and the open plant."""
    count = 640 if report.quick else 10_000
    t = np.arange(STEPS + 1) * 1e-3
    tones = {"x_in": 0.6 * np.sin(2 * np.pi * 0.2 * t) + 0.3 * np.sin(2 * np.pi * 0.53 * t + 1)}
    one(report, "Fig 16", tsm.load(ours.FIGURES["fig16"]), ("alpha1", "A", "theta", "pid.kp", "pid.ki"), {}, count)
    plant = ("tsm.alpha1", "tsm.alpha2", "tsm.A", "tsm.theta", "tsm.delta")
    one(report, "open plant", tsm.load(ours.FIGURES["plant"]), plant, tones, count)


class LanesRun:
    """The compiled loop for sets side by side alone, into memory that is there already."""

    def __init__(self, diagram: Any, names: tuple[str, ...], inputs: dict[str, Any], outputs: list[str]) -> None:
        eq, self.lanes = equations(diagram), 32
        single = ours.KernelRun(diagram, STOP, inputs=inputs)
        shown = tuple(dict.fromkeys(eq.y.index(eq.aliases[k]) for k in outputs))
        vary = frozenset(eq.p.index(k) for k in names)
        self.kernel = batch_kernel(eq, method_named("rk4"), shown, self.lanes, vary, "")
        p = np.repeat(parameter_vector(eq, diagram)[:, None], self.lanes, axis=1)
        self.memory, self.u, self.hits = lane_memory(eq, self.kernel, p, single.step), single.u, single.hits
        self.y = np.zeros((STEPS + 1, self.kernel.layout_y.size))

    def __call__(self) -> None:
        self.kernel.advance(self.memory.copy(), self.u, self.y, Steps(0.0, STOP / STEPS, 0, STEPS, True, self.hits))


def one(report: Report, title: str, diagram: Any, names: tuple[str, ...], inputs: dict[str, Any], count: int) -> None:
    """Check and time one diagram."""
    known = {**diagram.values, **diagram.parameters}
    factors = np.random.default_rng(1).uniform(0.95, 1.05, (len(names), count))
    sets = {name: known[name] * f for name, f in zip(names, factors, strict=True)}
    outputs = [k for k in ("x_ref", "x_out") if k in diagram.outputs]

    def reduce(t: np.ndarray, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        value = signals["x_ref"] - signals["x_out"] if "x_ref" in signals else signals["x_out"]
        return {"peak_to_peak": np.ptp(value[len(t) // 2 :], axis=0)}

    def batch(threads: int) -> Callable[[], Any]:
        return lambda: tsm.simulate_batch(
            diagram, sets, stop=STOP, inputs=inputs, outputs=outputs, reduce=reduce, threads=threads
        )

    off, some = 0.0, np.linspace(0, count - 1, 7).astype(int)
    early = {name: v[: round(CHECKED * STEPS / STOP) + 1] for name, v in inputs.items()}
    few_sets = {name: v[some] for name, v in sets.items()}
    lanes_run = tsm.simulate_batch(diagram, few_sets, stop=CHECKED, inputs=early, outputs=outputs, threads=1)
    compared = 0
    for lane, k in enumerate(some):
        own = {name: v[k] for name, v in sets.items()}
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            run = tsm.simulate(diagram, stop=CHECKED, inputs=early, parameters=own)
        if any("results do not settle" in str(one.message) for one in heard):
            continue  # rounding grows without bound in such a set
        compared += 1
        off = max(off, *(float(np.abs(run[name] - lanes_run[name][lane]).max()) for name in outputs))
    if compared < len(some) // 2:
        off = np.inf
    if not report.check(f"batch, {title}", off, TOLERANCE):
        return
    single = lambda: tsm.simulate(diagram, stop=STOP, inputs=inputs, log="outputs")  # noqa: E731
    few = race({"run": single, "kernel": ours.KernelRun(diagram, STOP, inputs=inputs, outputs=True)}, 5)
    lanes = LanesRun(diagram, names, inputs, outputs)
    many = race({"1 thread": batch(1), "2 threads": batch(2), "lanes": lanes}, 2 if report.quick else 4)
    entries = [
        ("simulate(), one after another", few["run"], 1),
        ("kernel alone, one after another", few["kernel"], 1),
        ("simulate_batch, 1 thread", many["1 thread"], count),
        ("simulate_batch, 2 threads", many["2 threads"], count),
        (f"its kernel alone, {lanes.lanes} sets side by side", many["lanes"], lanes.lanes),
    ]
    what = f"{count} sets of {STOP:g} s at 1 kHz, {len(names)} parameters vary"
    show(report, title, f"{what} (difference {off:.0e}, allowed {TOLERANCE:g})", entries)
    per_run = many["1 thread"].cpu / count
    for what, single in (("simulate()", few["run"].cpu), ("kernel", few["kernel"].cpu)):
        report.bar(f"batch, {title}: rate per core over one {what}", single / per_run, 5.0, at_least=True)


def show(report: Report, title: str, what: str, entries: list[tuple[str, Best, int]]) -> None:
    """Print the table; the last column compares with the second entry, one kernel run after run."""
    rows, kernel = [], entries[1][1].cpu
    for name, best, runs in entries:
        wall, cpu = best.wall / runs, best.cpu / runs
        figures = (1e4 * wall, 1 / wall, 1 / cpu, 1e9 * cpu / STEPS, kernel / cpu)
        rows.append([name, *(three(x) for x in figures)])
        report.note(f"batch, {title}, {name}", {"wall_s": wall, "cpu_s": cpu, "runs": runs * best.count})
    head = ["what", "10,000 runs [s]", "runs per s", "runs per CPU s", "ns per step and set", "kernels"]
    report.table(f"Batch, {title}: {what}", head, rows)
