"""A study of 10,000 runs of Fig 16, killed at half and gone on with, beside the same study looped through a peer."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import ours
from measure import Report, three

import tsmblocks as tsm
from tsmblocks.studies import Plan, latin_hypercube, read_study

STOP, STEP = 20.0, 1e-3
VARIED = {
    "pid.kp": (0.3, 0.9),
    "pid.ki": (1.0, 3.0),
    "tsm.theta": (4.0, 4.8),
    "tsm.A": (-0.9, -0.75),
    "tsm.alpha1": (0.92, 0.96),
}
"""Where these are larger, the loop can be unstable for an instant at a reversal, and rounding shows in its errors."""
METRICS = {
    "peak_to_peak": "peak_to_peak(x_ref - x_out, after=10)",
    "rms": "rms(x_ref - x_out, after=10)",
    "largest": "largest(u)",
}
LOOPED = 40
"""Runs that are looped through the peer; the rest takes as long each."""
TOLERANCE = 1e-6


def studies(report: Report) -> None:
    """The whole study, the same killed half way, and what a loop through the fastest peer takes."""
    count = 1000 if report.quick else 10_000
    plan = latin_hypercube(VARIED, runs=count, seed=1)
    with tempfile.TemporaryDirectory() as folder:
        whole, killed = Path(folder, "whole.csv"), Path(folder, "killed.csv")
        cpu, began = time.process_time(), time.perf_counter()
        found = study(plan, whole)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        rows = half(plan, killed, count)
        study(plan, killed)
        same = whole.read_bytes() == killed.read_bytes()
    report.check(f"study killed at {rows} of {count} runs and gone on with", 0.0 if same else 1.0, 0.0)
    body = [("tsmblocks, study()", str(count), three(wall), three(cpu), three(1e3 * cpu / count), "1.00", "0e+00")]
    beside = looped(plan, found)
    if beside is not None:
        seconds, off = beside
        if report.check("metrics of Archimedes", off, TOLERANCE):
            every = three(seconds * count)
            body.append(
                (
                    f"Archimedes, looped ({LOOPED} of them run)",
                    str(count),
                    every,
                    every,
                    three(1e3 * seconds),
                    three(seconds * count / cpu),
                    f"{off:.0e}",
                )
            )
    report.table(
        f"Study of Fig 16: {count} runs of 20 s at 1 ms, five numbers varied, three metrics",
        ["what", "runs", "wall [s]", "CPU [s]", "CPU per run [ms]", "ratio", "difference"],
        body,
    )
    report.note("study", {"runs": count, "wall": wall, "cpu": cpu, "same": same, "peer": beside})


def study(plan: Plan, out: Path, progress: Any = None) -> Any:
    """The study, results kept in a file."""
    return tsm.study(tsm.load(ours.FIGURES["fig16"]), plan, METRICS, stop=STOP, step=STEP, out=out, progress=progress)


def half(plan: Plan, out: Path, count: int) -> int:
    """Run in a process that is killed without warning half way; how many results it left."""
    child = multiprocessing.get_context("spawn").Process(target=_until_half, args=(plan, out, count))
    child.start()
    child.join()
    return len(read_study(out))


def _until_half(plan: Plan, out: Path, count: int) -> None:
    def kill(done: int, _: int) -> None:
        if done >= count // 2:
            os.kill(os.getpid(), signal.SIGKILL)

    study(plan, out, kill)


def looped(plan: Plan, found: Any) -> tuple[float, float] | None:
    """Seconds of processor per run in Archimedes, one after another, and how far its metrics are off; or None."""
    try:
        from peers_archimedes import fig16
    except ImportError:
        return None
    fixed = tsm.load(ours.FIGURES["fig16"]).parameters
    run = fig16(dict(fixed), STOP, STEP)
    sets = [np.array([plan[name][k] for name in VARIED]) for k in range(LOOPED)]
    run(sets[0])  # compiles
    began, off = time.process_time(), 0.0
    for k, numbers in enumerate(sets):
        error, u = run(numbers)
        late = error[round(10 / STEP) :]
        made = (np.ptp(late), np.sqrt(np.mean(late**2)), np.abs(u).max())
        off = max(off, *(abs(a - found[name][k]) / abs(a) for a, name in zip(made, METRICS, strict=True)))
    return (time.process_time() - began) / LOOPED, float(off)
