"""Fig 9(b) in every tool that is installed, each run in a process of its own with a time limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from importlib import metadata, util
from pathlib import Path
from typing import Any

import numpy as np
import ours
from measure import Best, Report, difference, spread_of_tail, three

import tsmblocks as tsm

HERE = Path(__file__).resolve().parent
TOOLS = {  # name in the table: module here, package that must be importable, distribution
    "tsmblocks": ("ours", "tsmblocks", ""),
    "Jaxonomy": ("peers_jaxonomy", "jaxonomy", "jaxonomy"),
    "Archimedes": ("peers_archimedes", "archimedes", "archimedes"),
    "Drake": ("peers_drake", "pydrake", "drake"),
    "PathSim": ("peers_pathsim", "pathsim", "pathsim"),
    "bdsim": ("peers_bdsim", "bdsim", "bdsim"),
    "SimuPy": ("peers_simupy", "simupy", "simupy"),
    "python-control": ("peers_control", "control", "control"),
}
TIME_LIMIT = 300.0


@dataclass
class Measured:
    """What processes of one tool reported; times in s, the shortest of all."""

    tolerance: float = 0.0
    method: str = ""
    run: Best = field(default_factory=Best)
    times: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))  # import, build, first run
    first_result: float = float("inf")
    off: float = 0.0


def run_worker(
    module: str, settings: dict[str, Any], environment: dict[str, str] | None = None, limit: float = TIME_LIMIT
) -> dict[str, Any]:
    """Run one tool in a fresh process; what it measured. Raises RuntimeError with its last words."""
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder, "settings.json"), Path(folder, "result.npz")
        given.write_text(json.dumps(settings), encoding="utf-8")
        path = os.pathsep.join([str(HERE.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
        env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": path, **(environment or {})}
        command = [sys.executable, str(HERE / "peer_worker.py"), module, str(given), str(made)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, env=env, cwd=folder, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"not done after {limit:g} s") from None
        if done.returncode or not made.exists():
            raise RuntimeError((done.stderr.strip() or done.stdout.strip() or "no output").splitlines()[-1])
        with np.load(made) as found:
            return {name: found[name] for name in found.files}


def race_peers(report: Report) -> None:
    """All tools that are installed, in turns."""
    diagram, stop = tsm.load(ours.FIGURES["fig09b"]), 2.0 if report.quick else 20.0
    reference = ours.tracking(tsm.simulate(diagram, stop=stop))
    settings = {"numbers": ours.peer_numbers(diagram), "stop": stop, "step": 1e-3, "seconds": 2.0, "most": 20}
    found, missing = {}, []
    for name, (_, package, _dist) in TOOLS.items():
        if util.find_spec(package) is None:
            missing.append(name)
        else:
            found[name] = Measured()
    for _ in range(1 if report.quick else 3):
        for name in list(found):
            try:
                take(report, found[name], name, run_worker(TOOLS[name][0], settings), reference)
            except RuntimeError as problem:
                report.say(f"{name}: left out, {problem}")
                del found[name]
    if missing:
        report.say(f"Not installed, so left out: {', '.join(missing)} (requirements-peers.txt).")
    show(report, found, round(stop / 1e-3), stop)


def take(report: Report, measured: Measured, name: str, result: dict[str, Any], reference: np.ndarray) -> None:
    """Check one process's result and take its times into account."""
    tolerance = float(result["tolerance"])
    tail = abs(spread_of_tail(result["error"]) - spread_of_tail(reference))
    off = max(difference({"e": reference}, {"e": result["error"]}), tail)
    measured.off, measured.tolerance, measured.method = (max(measured.off, off), tolerance, str(result["method"]))
    if not report.check(f"peers: {name}", off, tolerance):
        raise RuntimeError(f"its result differs by {off:.3g}")
    for wall, cpu in result["runs"]:
        measured.run.add(float(wall), float(cpu))
    measured.times = np.minimum(measured.times, result["times"])
    measured.first_result = min(measured.first_result, float(result["times"].sum()))


def show(report: Report, found: dict[str, Measured], steps: int, stop: float) -> None:
    """Print the table of tools, fastest first."""
    base, rows = found["tsmblocks"].run.cpu if "tsmblocks" in found else float("nan"), []
    for name, m in sorted(found.items(), key=lambda item: item[1].run.cpu):
        dist = TOOLS[name][2]
        version = metadata.version(dist) if dist else tsm.__version__
        first = m.times[1] + m.times[2]
        figures = (m.run.wall, m.run.cpu, 1e6 * m.run.cpu / steps, m.run.cpu / base, m.times[0], first)
        off = f"{m.off:.0e} ({m.tolerance:g})"
        rows.append([f"{name} {version}", m.method, *(three(x) for x in figures), three(m.first_result), off])
        kept = {"wall_s": m.run.wall, "cpu_s": m.run.cpu, "runs": m.run.count, "import_s": m.times[0]}
        report.note(f"peer, {name}", {**kept, "after_import_s": first, "first_result_s": m.first_result})
    head = ["tool", "method", "wall [s]", "CPU [s]", "us per step", "ratio"]
    head += ["import [s]", "then first result [s]", "together [s]", "difference (allowed)"]
    report.table(f"Fig 9(b) in each tool: {stop:g} s at 1 ms", head, rows)
