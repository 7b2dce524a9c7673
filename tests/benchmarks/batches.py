"""Many parameter sets side by side, against one run at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ours
from measure import Report, race, three

import tsmblocks as tsm

TOLERANCE = 1e-9
STOP, STEPS = 10.0, 10_000


def batches(report: Report) -> None:
    """10,000 sets of 10 s at 1 kHz, reduced to a peak-to-peak value each: Fig 16 and the open plant."""
    count = 640 if report.quick else 10_000
    t = np.arange(STEPS + 1) * 1e-3
    tones = {"x_in": 0.6 * np.sin(2 * np.pi * 0.2 * t) + 0.3 * np.sin(2 * np.pi * 0.53 * t + 1)}
    one(report, "Fig 16", tsm.load(ours.FIGURES["fig16"]), ("alpha1", "A", "theta", "pid.kp", "pid.ki"), {}, count)
    plant = ("tsm.alpha1", "tsm.alpha2", "tsm.A", "tsm.theta", "tsm.delta")
    one(report, "open plant", tsm.load(ours.FIGURES["plant"]), plant, tones, count)


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
        return lambda: tsm.simulate_batch(diagram, sets, stop=STOP, inputs=inputs, outputs=outputs, reduce=reduce, threads=threads)

    found, off = batch(1)(), 0.0
    for k in np.linspace(0, count - 1, 7).astype(int):
        run = tsm.simulate(diagram, stop=STOP, inputs=inputs, parameters={name: v[k] for name, v in sets.items()})
        single = reduce(run.t, {name: run[name][:, None] for name in outputs})["peak_to_peak"][0]
        off = max(off, abs(single - found["peak_to_peak"][k]))
    if not report.check(f"batch, {title}", off, TOLERANCE):
        return
    single = lambda: tsm.simulate(diagram, stop=STOP, inputs=inputs, log="outputs")  # noqa: E731
    few = race({"run": single, "kernel": ours.KernelRun(diagram, STOP, inputs=inputs, outputs=True)}, 5)
    many = race({"1 thread": batch(1), "2 threads": batch(2)}, 2 if report.quick else 4)
    rows, slowest = [], few["kernel"].cpu
    for name, seconds, cpu, runs in [
        ("simulate(), one after another", few["run"].wall, few["run"].cpu, 1), ("kernel alone, one after another", few["kernel"].wall, slowest, 1),
        ("simulate_batch, 1 thread", many["1 thread"].wall, many["1 thread"].cpu, count),
        ("simulate_batch, 2 threads", many["2 threads"].wall, many["2 threads"].cpu, count),
    ]:  # fmt: skip
        rows.append([name, three(seconds / runs * 10_000), three(runs / seconds), three(runs / cpu), three(cpu / runs / STEPS * 1e9),
                     three(slowest * runs / cpu)])  # fmt: skip
        report.note(f"batch, {title}, {name}", {"wall_s": seconds, "cpu_s": cpu, "runs": runs})
    head = ["what", "wall for 10,000 [s]", "runs per s", "runs per CPU s", "ns per step and set", "rate over one kernel"]
    report.table(f"Batch, {title}: {count} sets of {STOP:g} s at 1 kHz, 5 parameters vary (difference {off:.0e}, allowed {TOLERANCE:g})", head, rows)
    report.bar(f"batch, {title}: rate per core over one simulate()", few["run"].cpu * count / many["1 thread"].cpu, 5.0, at_least=True)
    report.bar(f"batch, {title}: rate per core over one kernel", slowest * count / many["1 thread"].cpu, 5.0, at_least=True)
