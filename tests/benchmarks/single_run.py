"""One run of Figs 9(b) and 16: tsmblocks against C and Python by hand."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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


@dataclass
class Contestant:
    """``run`` is timed; ``signals`` gives what it computed, by the diagram's names, for the check."""

    run: Callable[[], Any]
    signals: Callable[[], Mapping[str, np.ndarray]]


def of_engine(diagram: Any, stop: float, **options: Any) -> Contestant:
    """``simulate()`` as its user calls it."""

    def run() -> Any:
        return tsm.simulate(diagram, stop=stop, **options)

    return Contestant(run, lambda: ours.signals(run()))


def by_hand(function: Callable[..., Any], diagram: Any, steps: int) -> Contestant:
    """A function of ``hand_python``."""
    model = hand_python.Model({**diagram.values, **diagram.parameters})

    def run() -> Any:
        return function(model, steps, 1e-3)

    return Contestant(run, lambda: dict(zip(hand_c.LOG["fig09b"], np.array(run()).T, strict=True)))


def in_c(library: Any, figure: str, diagram: Any, steps: int, fresh: bool) -> Contestant:
    """A C program, into memory that is there already or (``fresh``) into a new array each time."""
    call = hand_c.caller(library, figure, {**diagram.values, **diagram.parameters}, steps, 1e-3)
    log = hand_c.log_for(figure, steps)
    kept = [log]

    def run() -> None:
        kept[0] = np.empty_like(log) if fresh else log
        call(kept[0])

    return Contestant(run, lambda: hand_c.signals(figure, kept[0]))


def fig09b(report: Report) -> None:
    """Fig 9(b), 20 s at 1 ms, the contestants that live in this process."""
    diagram, stop = tsm.load(ours.FIGURES["fig09b"]), 4.0 if report.quick else 20.0
    kernel, own = ours.KernelRun(diagram, stop), "tsmblocks, simulate()"
    entries = {
        own: of_engine(diagram, stop),
        "tsmblocks, kernel alone": Contestant(kernel, kernel.signals),
        "tsmblocks without llvmlite": of_engine(diagram, stop, backend="casadi"),
        "Python floats by hand": by_hand(hand_python.plain, diagram, kernel.steps),
        "NumPy vectors by hand": by_hand(hand_python.vectors, diagram, kernel.steps),
        **c_entries(report, "fig09b", diagram, kernel.steps),
    }
    best = checked_race(report, "Fig 9(b)", entries, own, 3 if report.quick else 7)
    title = f"Fig 9(b): {stop:g} s at 1 ms, all {len(kernel.names)} signals logged, ratio to simulate()"
    show(report, title, best, kernel.steps, own)


def fig16(report: Report) -> None:
    """Fig 16, 100 s at 1 ms, against C."""
    diagram, stop = tsm.load(ours.FIGURES["fig16"]), 10.0 if report.quick else 100.0
    kernel, own = ours.KernelRun(diagram, stop), "tsmblocks, simulate()"
    entries = {
        "tsmblocks, kernel alone": Contestant(kernel, kernel.signals),
        own: of_engine(diagram, stop),
        "tsmblocks, simulate(), outputs only": of_engine(diagram, stop, log="outputs"),
        **c_entries(report, "fig16", diagram, kernel.steps),
    }
    best = checked_race(report, "Fig 16", entries, own, 5 if report.quick else 15)
    programs = [name for name in best if name.startswith("C, ") and name != NEW]
    fastest = min(programs, key=lambda name: best[name].cpu, default="tsmblocks, kernel alone")
    title = f"Fig 16: {stop:g} s at 1 ms, all {len(kernel.names)} signals logged, ratio to the best C"
    show(report, title, best, kernel.steps, fastest)
    c = best[fastest].cpu if programs else None
    report.bar("Fig 16, kernel over best C", c and best["tsmblocks, kernel alone"].cpu / c, 1.3)
    report.bar("Fig 16, simulate() over best C", c and best[own].cpu / c, 1.3)


NEW = "C, new array"


def c_entries(report: Report, figure: str, diagram: Any, steps: int) -> dict[str, Contestant]:
    """The C programs as contestants."""
    with tempfile.TemporaryDirectory() as folder:  # a library stays loaded when its file is gone
        libraries = hand_c.build(Path(folder))
    if not libraries:
        report.say("No C compiler was found (CC, gcc, cc, clang): the rows of hand-written C are left out.")
        return {}
    made = {f"C, {name}": in_c(library, figure, diagram, steps, False) for name, library in libraries.items()}
    return {**made, NEW: in_c(next(iter(libraries.values())), figure, diagram, steps, True)}


def checked_race(
    report: Report, title: str, entries: Mapping[str, Contestant], own: str, rounds: int
) -> dict[str, Best]:
    """Check each contestant's signals against ``own``, then race those that agree."""
    reference, good = entries[own].signals(), {}
    for name, entry in entries.items():
        entry.run()
        signals = entry.signals()
        off = max(difference(reference, signals), _tail_difference(reference, signals))
        if report.check(f"{title}: {name}", off, TOLERANCE):
            good[name] = entry.run
    return race(good, rounds)


def _tail_difference(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> float:
    """Difference in the peak-to-peak tracking error over the last half of the run."""
    pair = [spread_of_tail(s["ref.y"] - s["tsm.y"]) for s in (a, b)]
    return abs(pair[0] - pair[1])


def show(report: Report, title: str, best: Mapping[str, Best], steps: int, unit: str) -> None:
    """Print the table of one race; ratios are to ``unit``."""
    base, rows, figure = best[unit].cpu, [], title.partition(":")[0]
    for name, b in best.items():
        off = report.found["checks"][f"{figure}: {name}"]["difference"]
        us = three(1e6 * b.cpu / steps)
        rows.append([name, ms(b.wall), ms(b.cpu), us, three(b.cpu / base), f"{off:.0e}"])
        report.note(f"{figure}, {name}", {"wall_s": b.wall, "cpu_s": b.cpu, "runs": b.count})
    report.table(f"{title} (differences allowed: {TOLERANCE:g})", HEAD, rows)
