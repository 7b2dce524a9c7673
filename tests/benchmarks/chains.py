"""Chains of lags and limits, from ten blocks to five thousand: time to compile and time per step."""

from __future__ import annotations

import os
from itertools import pairwise
from typing import Any

import numpy as np
import ours
from measure import Best, Report, ms, race, three, timed

import tsmblocks as tsm
from tsmblocks.compiler.compile import compile_diagram
from tsmblocks.engine import jit
from tsmblocks.engine.backends import kernel_for
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.plan import plan_for

TOLERANCE = 1e-9
LIMIT, T = 0.4, 0.02
STEPS, H = 2000, 1e-3


def chains(report: Report) -> None:
    """Chains of growing length; the cost per block should not grow with them."""
    rows, cost = [], {}
    for blocks in (10, 100, 1000) if report.quick else (10, 100, 1000, 5000):
        best = one(report, blocks)
        if best is None:
            continue
        compile_ = best["diagram"].cpu + best["flatten"].cpu + best["machine code"].cpu
        step = best["kernel"].cpu / STEPS
        cost[blocks] = compile_ / blocks, step / blocks
        rest = best["simulate()"].cpu - best["kernel"].cpu
        parts = [ms(best[k].cpu) for k in ("diagram", "flatten", "machine code")]
        figures = (1e3 * compile_ / blocks, 1e6 * step, 1e9 * step / blocks, 1e3 * rest)
        rows.append([f"{blocks} blocks", *parts, *(three(x) for x in figures)])
        report.note(f"chain of {blocks}", {k: b.cpu for k, b in best.items()})
    head = [
        "chain",
        "diagram [ms]",
        "flatten [ms]",
        "machine code [ms]",
        "all, per block [ms]",
        "us per step",
        "ns per step and block",
        "simulate() beyond it [ms]",
    ]
    report.table(
        f"Chains of FirstOrderLag and Saturation, 2 s at 1 ms (differences allowed: {TOLERANCE:g})", head, rows
    )
    for k, what in enumerate(("compile time", "kernel time per step")):
        grown = cost[5000][k] / cost[1000][k] if 5000 in cost and 1000 in cost else None
        report.bar(f"chains, {what} per block: 5000 blocks over 1000", grown, 1.5)


def chain(blocks: int) -> Any:
    """A sine through lags and limits in turn."""
    made: dict[str, Any] = {"ref": tsm.blocks.Sine(amplitude=1.0, frequency=0.5)}
    for k in range(blocks // 2):
        made[f"lag{k}"] = tsm.blocks.FirstOrderLag(time_constant=T)
        made[f"limit{k}"] = tsm.blocks.Saturation(low=-LIMIT, high=LIMIT)
    names = list(made)
    wires = [f"{a} -> {b}" for a, b in pairwise(names)]
    return tsm.Diagram(title=f"Chain of {blocks}", blocks=made, wires=wires, outputs={"y": names[-1]})


def by_hand(lags: int, steps: int, h: float) -> np.ndarray:
    """States of the lags at the end, by RK4 on NumPy vectors."""
    x, source = np.zeros(lags), np.empty(lags)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        source[0] = np.sin(2 * np.pi * 0.5 * t)
        source[1:] = np.clip(x[:-1], -LIMIT, LIMIT)
        return (source - x) / T

    for k in range(steps):
        t = k * h
        k1 = rates(t, x)
        k2 = rates(t + h / 2, x + h / 2 * k1)
        k3 = rates(t + h / 2, x + h / 2 * k2)
        k4 = rates((k + 1) * h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def one(report: Report, blocks: int) -> dict[str, Best] | None:
    """Times of one length: build, flatten, compile afresh, run."""
    best = {k: Best() for k in ("diagram", "flatten", "machine code")}
    for _ in range(2 if blocks > 1000 or report.quick else 4):
        timed(lambda: chain(blocks), best["diagram"])
        diagram = chain(blocks)
        timed(lambda: compile_diagram(diagram), best["flatten"])  # noqa: B023 - called at once
        eq = compile_diagram(diagram)
        plan = plan_for(eq, method_named("rk4"), (eq.y.index(eq.aliases["y"]),))
        with compiled_afresh():
            timed(lambda: kernel_for(plan), best["machine code"])  # noqa: B023

    def simulate() -> Any:
        return tsm.simulate(diagram, stop=STEPS * H, log="outputs")

    run = simulate()
    order = [eq.x.index(f"lag{k}.value") for k in range(blocks // 2)]
    off = float(np.abs(run.state.memory.x[order] - by_hand(blocks // 2, STEPS, H)).max())
    if not report.check(f"chain of {blocks}", off, TOLERANCE):
        return None
    return best | race(
        {"kernel": ours.KernelRun(diagram, STEPS * H, outputs=True), "simulate()": simulate},
        3 if report.quick else 6,
        0.2,
    )


class compiled_afresh:
    """Neither the store on disk nor what this process has compiled so far is used inside."""

    def __enter__(self) -> None:
        self.store, self.loaded = os.environ.get("TSMBLOCKS_CACHE"), dict(jit._LOADED)
        os.environ["TSMBLOCKS_CACHE"] = "off"
        jit._LOADED.clear()

    def __exit__(self, *_: object) -> None:
        jit._LOADED.update(self.loaded)  # kernels elsewhere still run this code
        if self.store is None:
            del os.environ["TSMBLOCKS_CACHE"]
        else:
            os.environ["TSMBLOCKS_CACHE"] = self.store
