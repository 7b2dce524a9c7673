"""Signals and their exact derivatives with respect to five parameters, against single runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ours
from measure import Report, difference, ms, race, three

import tsmblocks as tsm
from tsmblocks.engine.kernel import Steps
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.sensitivities import tangent_memory
from tsmblocks.simulation.compiled import equations, parameter_vector
from tsmblocks.simulation.lanes import tangent_kernel

TOLERANCE = 1e-9
SLOPES = 1e-6
"""Allowed difference to central differences at any instant, over the largest derivative."""


def gradients(report: Report) -> None:
    """The open plant on a recorded two-tone input of 10 s, and Fig 9(b), 20 s."""
    t = np.arange(10_001) * 1e-3
    tones = {"x_in": 0.6 * np.sin(2 * np.pi * 0.2 * t) + 0.3 * np.sin(2 * np.pi * 0.53 * t + 1)}
    plant = [f"tsm.{k}" for k in ("alpha1", "alpha2", "A", "theta", "delta")]
    one(report, "open plant", tsm.load(ours.FIGURES["plant"]), plant, ["x_out"], tones, 10.0)
    shared = ["alpha1", "alpha2", "A", "theta", "delta"]
    one(
        report,
        "Fig 9(b)",
        tsm.load(ours.FIGURES["fig09b"]),
        shared,
        ["x_ref", "x_out"],
        {},
        4.0 if report.quick else 20.0,
    )


def one(
    report: Report, title: str, diagram: Any, names: list[str], outputs: list[str], inputs: dict[str, Any], stop: float
) -> None:
    """Check and time one diagram."""
    found = tsm.sensitivities(diagram, names, outputs=outputs, stop=stop, inputs=inputs)
    run = tsm.simulate(diagram, stop=stop, inputs=inputs)
    off = difference({k: run[k] for k in outputs}, {k: found.y[:, j] for j, k in enumerate(outputs)})
    good = report.check(f"gradients, {title}: the run itself", off, TOLERANCE)
    off = compare(diagram, found, names, stop, inputs)
    good &= report.check(f"gradients, {title}: against central differences", off, SLOPES)
    if not good:
        return
    options: dict[str, Any] = {"stop": stop, "inputs": inputs}
    entries = {
        "simulate()": lambda: tsm.simulate(diagram, log="outputs", **options),
        "sensitivities()": lambda: tsm.sensitivities(diagram, names, outputs=outputs, **options),
        "kernel of one run": ours.KernelRun(diagram, stop, inputs=inputs, outputs=True),
        "kernel of sensitivities": tangents(diagram, names, outputs, stop, inputs),
    }
    best, rows = race(entries, 3 if report.quick else 7), []
    for name, b in best.items():
        base = best["simulate()" if name.endswith("()") else "kernel of one run"].cpu
        rows.append([name, ms(b.wall), ms(b.cpu), three(b.cpu / base)])
        report.note(f"gradients, {title}, {name}", {"wall_s": b.wall, "cpu_s": b.cpu, "runs": b.count})
    report.table(
        f"Derivatives, {title}: {len(names)} parameters, {len(run.t) - 1} steps "
        f"(off central differences by {off:.0e}, allowed {SLOPES:g})",
        ["what", "wall [ms]", "CPU [ms]", "single runs"],
        rows,
    )
    whole = best["sensitivities()"].cpu / best["simulate()"].cpu
    inner = best["kernel of sensitivities"].cpu / best["kernel of one run"].cpu
    report.bar(f"residual and Jacobian, {title}: sensitivities() over simulate()", whole, 4.0)
    report.bar(f"residual and Jacobian, {title}: kernel over kernel", inner, 4.0)


def compare(diagram: Any, found: Any, names: list[str], stop: float, inputs: dict[str, Any]) -> float:
    """Largest difference to central differences, over the largest derivative by that parameter."""
    known, most = {**diagram.values, **diagram.parameters}, 0.0
    for j, name in enumerate(names):
        size = 1e-5 * max(abs(known[name]), 0.1)  # larger ones reach across kinks, which move with the parameter
        runs = [
            tsm.simulate(diagram, stop=stop, inputs=inputs, parameters={name: known[name] + s * size}) for s in (1, -1)
        ]
        expected = np.column_stack([(runs[0][k] - runs[1][k]) / (2 * size) for k in found.signals])
        most = max(most, float(np.abs(found.jacobian[:, :, j] - expected).max() / np.abs(expected).max()))
    return most


def tangents(
    diagram: Any, names: list[str], outputs: list[str], stop: float, inputs: dict[str, Any]
) -> Callable[[], None]:
    """The compiled loop with derivatives alone, into memory that is there already."""
    eq, plain = equations(diagram), ours.KernelRun(diagram, stop, inputs=inputs)
    shown, lanes = tuple(eq.y.index(eq.aliases[k]) for k in outputs), 1 << (len(names) - 1).bit_length()
    kernel = tangent_kernel(eq, method_named("rk4"), shown, lanes, "")
    seeds = np.zeros((len(eq.p), lanes))
    seeds[[eq.p.index(k) for k in names], range(len(names))] = 1.0
    memory = tangent_memory(eq, kernel, parameter_vector(eq, diagram), seeds, plain.step)
    y = np.zeros((plain.steps + 1, kernel.layout_y.size))

    def run() -> None:
        kernel.advance(memory.copy(), plain.u, y, Steps(0.0, plain.step, 0, plain.steps, True, plain.hits))

    return run
