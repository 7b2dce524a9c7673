"""One run of Figs 9(b) and 16: tsmblocks against C and Python by hand."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import hand_c
import hand_python
import numpy as np
import ours
from measure import Best, Report, difference, ms, race, spread_of_tail, three

import tsmblocks as tsm

TOLERANCE = 1e-9
"""Allowed difference of any signal at any step, in the signal's unit: results differ by rounding alone."""
HEAD = ["what", "wall [ms]", "CPU [ms]", "us per step", "ratio", "largest difference"]


def fig09b(report: Report) -> None:
    """Fig 9(b), 20 s at 1 ms, the contestants that live in this process."""
    diagram, stop = tsm.load(ours.FIGURES["fig09b"]), 4.0 if report.quick else 20.0
    run, kernel = tsm.simulate(diagram, stop=stop), ours.KernelRun(diagram, stop)
    reference, steps = ours.signals(run), kernel.steps
    model = hand_python.Model({**diagram.values, **diagram.parameters})
    columns = hand_c.LOG["fig09b"]

    def by_name(rows: Any) -> dict[str, np.ndarray]:
        return dict(zip(columns, np.array(rows).T, strict=True))

    entries: dict[str, tuple[Callable[[], Any], Callable[[], Mapping[str, np.ndarray]]]] = {
        "tsmblocks, simulate()": (lambda: tsm.simulate(diagram, stop=stop), lambda: reference),
        "tsmblocks, kernel alone": (kernel, kernel.signals),
        "tsmblocks without llvmlite": (
            lambda: tsm.simulate(diagram, stop=stop, backend="casadi"),
            lambda: ours.signals(tsm.simulate(diagram, stop=stop, backend="casadi")),
        ),
        "Python floats by hand": (
            lambda: hand_python.plain(model, steps, 1e-3),
            lambda: by_name(hand_python.plain(model, steps, 1e-3)),
        ),
        "NumPy vectors by hand": (
            lambda: hand_python.vectors(model, steps, 1e-3),
            lambda: by_name(hand_python.vectors(model, steps, 1e-3)),
        ),
    }
    with tempfile.TemporaryDirectory() as folder:
        entries |= c_entries(report, "fig09b", diagram, steps, Path(folder))
        best = checked_race(report, "Fig 9(b)", entries, reference, 3 if report.quick else 7)
    report.note("fig09b.peak_to_peak_rad", spread_of_tail(ours.tracking(run)))
    report.note("fig09b.simulate_cpu_s", best["tsmblocks, simulate()"].cpu)
    show(report, f"Fig 9(b): {stop:g} s at 1 ms, all 14 signals logged, ratio to simulate()", best, steps, "tsmblocks, simulate()")


def fig16(report: Report) -> None:
    """Fig 16, 100 s at 1 ms, against C."""
    diagram, stop = tsm.load(ours.FIGURES["fig16"]), 10.0 if report.quick else 100.0
    kernel, run = ours.KernelRun(diagram, stop), tsm.simulate(diagram, stop=stop)
    reference = ours.signals(run)
    entries: dict[str, tuple[Callable[[], Any], Callable[[], Mapping[str, np.ndarray]]]] = {
        "tsmblocks, kernel alone": (kernel, kernel.signals),
        "tsmblocks, simulate()": (lambda: tsm.simulate(diagram, stop=stop), lambda: reference),
        "tsmblocks, simulate(), outputs only": (
            lambda: tsm.simulate(diagram, stop=stop, log="outputs"),
            lambda: ours.signals(tsm.simulate(diagram, stop=stop, log="outputs")),
        ),
    }
    with tempfile.TemporaryDirectory() as folder:
        entries |= c_entries(report, "fig16", diagram, kernel.steps, Path(folder))
        best = checked_race(report, "Fig 16", entries, reference, 5 if report.quick else 15)
    fastest = min((n for n in best if n.startswith("C, ") and "new" not in n), key=lambda n: best[n].cpu, default=None)
    against = fastest or "tsmblocks, kernel alone"
    show(report, f"Fig 16: {stop:g} s at 1 ms, all 19 signals logged, ratio to the best C", best, kernel.steps, against)
    c = best[fastest].cpu if fastest else float("nan")
    report.bar("Fig 16, kernel over best C", best["tsmblocks, kernel alone"].cpu / c, 1.3)
    report.bar("Fig 16, simulate() over best C", best["tsmblocks, simulate()"].cpu / c, 1.3)


def c_entries(report: Report, figure: str, diagram: Any, steps: int, folder: Path) -> dict[str, Any]:
    """The C programs as contestants: into memory that is there, and (the native one) into a new array."""
    libraries = hand_c.build(folder)
    if not libraries:
        report.say("No C compiler was found (CC, gcc, cc, clang): the rows of hand-written C are left out.")
    values, made = {**diagram.values, **diagram.parameters}, {}
    for name, library in libraries.items():
        run, log = hand_c.caller(library, figure, values, steps, 1e-3), hand_c.log_for(figure, steps)
        made[f"C, {name}"] = (lambda run=run, log=log: run(log), lambda log=log: hand_c.signals(figure, log))
        if "C, new array" not in made:
            first = run
            made["C, new array"] = (lambda: first(np.empty_like(log)), lambda log=log: hand_c.signals(figure, log))
    return made


def checked_race(report: Report, title: str, entries: Mapping[str, Any], reference: Mapping[str, np.ndarray], rounds: int) -> dict[str, Best]:
    """Check each contestant's signals, then race those that agree; differences are kept for the table."""
    good = {}
    for name, (run, result) in entries.items():
        run()
        signals = result()
        off = max(difference(reference, signals), _tail_difference(reference, signals))
        if report.check(f"{title}: {name}", off, TOLERANCE):
            good[name] = run
    return race(good, rounds)


def _tail_difference(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> float:
    """Difference in the peak-to-peak tracking error over the last half of the run."""
    pair = [spread_of_tail(s["ref.y"] - s["tsm.y"]) for s in (a, b)]
    return abs(pair[0] - pair[1])


def show(report: Report, title: str, best: Mapping[str, Best], steps: int, unit: str) -> None:
    """Print the table of one race."""
    base, rows = best[unit].cpu if unit in best else float("nan"), []
    for name, b in best.items():
        off = report.found["checks"][f"{title.partition(':')[0]}: {name}"]["difference"]
        rows.append([name, ms(b.wall), ms(b.cpu), three(1e6 * b.cpu / steps), three(b.cpu / base), f"{off:.0e}"])
        report.note(f"{title.partition(':')[0]}, {name}", {"wall_s": b.wall, "cpu_s": b.cpu, "runs": b.count})
    report.table(f"{title} (differences allowed: {TOLERANCE:g})", HEAD, rows)
