"""Five parameters from 10,000 samples: every method of ``tsm.fit``, SciPy over plain Python, CasADi alone.

python tests/benchmarks/fits.py [--quick] [--json FILE]
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the same fits with its own threads are measured beside

import fits_casadi  # noqa: E402
import fits_plain  # noqa: E402
import numpy as np  # noqa: E402
import ours  # noqa: E402
from measure import Best, Report, race, three, timed  # noqa: E402

import tsmblocks as tsm  # noqa: E402
from tsmblocks.fitting.gauss_newton import gauss_newton  # noqa: E402
from tsmblocks.fitting.setup import pose  # noqa: E402

NAMES = ("alpha1", "alpha2", "A", "theta", "delta")
START = {"tsm.alpha1": 1.0, "tsm.alpha2": 1.0, "tsm.A": -0.5, "tsm.theta": 2.0, "tsm.delta": 0.0}
RANGES = ((0.1, 3.0), (0.1, 3.0), (-5.0, 5.0), (0.01, 50.0), (-3.0, 3.0))
STOP, STEP, NOISE = 10.0, 1e-3, 0.005
SAME = 5e-4
"""Share by which the sum of squares of an optimum may lie above the least one."""
METHODS: dict[str, dict[str, Any]] = {
    "gauss-newton, starts=1": {"starts": 1},
    "gauss-newton, starts=4 (default)": {},
    "ipopt, starts=1": {"method": "ipopt", "starts": 1},
    "ipopt, 10 segments (multiple shooting)": {"method": "ipopt", "segments": 10},
    "ga (genetic algorithm, then Nelder-Mead)": {"method": "ga"},
}


class Case:
    """The recording, the same for every contestant."""

    def __init__(self) -> None:
        self.diagram = tsm.load(ours.FIGURES["plant"])
        self.t = STEP * np.arange(round(STOP / STEP) + 1)
        self.x = 0.6 * np.sin(2 * np.pi * 0.2 * self.t) + 0.3 * np.sin(2 * np.pi * 0.53 * self.t + 1)
        clean = tsm.simulate(self.diagram, stop=STOP, inputs={"x_in": self.x})["x_out"]
        self.y = clean + NOISE * np.random.default_rng(0).standard_normal(len(self.t))
        signals, units = {"x_in": self.x, "x_out": self.y}, {"x_in": "rad", "x_out": "rad"}
        self.record = tsm.Record("two tones", self.t, signals, units)
        self.begin = np.array(list(START.values()))

    def fit(self, **options: Any) -> Any:
        """A fit as a user calls it."""
        return tsm.fit(self.diagram, self.record, free=["tsm.*"], start=START, **options)

    def search(self) -> Callable[[], Any]:
        """The search alone, everything made ready."""
        problem = self.posed()
        return lambda: gauss_newton(problem, problem.unknowns.start)

    def posed(self) -> Any:
        """The problem as searches see it."""
        return pose(self.diagram, self.record, free=["tsm.*"], start=START, step=STEP)[0]

    def squares(self, theta: Any) -> float:
        """Half the sum of squares at an optimum found elsewhere, by one simulation of ours."""
        numbers = {f"tsm.{k}": float(v) for k, v in zip(NAMES, theta, strict=True)}
        run = tsm.simulate(self.diagram, stop=STOP, inputs={"x_in": self.x}, parameters=numbers, log="outputs")
        return 0.5 * float(np.sum((run["x_out"] - self.y) ** 2))


def fits(report: Report) -> None:
    """Every method of ours, then what else there is, each as a multiple of one simulation."""
    case = Case()
    simulate = lambda: tsm.simulate(case.diagram, stop=STOP, inputs={"x_in": case.x}, log="outputs")  # noqa: E731
    entries: dict[str, Callable[[], Any]] = {
        "one simulation, simulate()": simulate,
        "one simulation, kernel alone": ours.KernelRun(case.diagram, STOP, inputs={"x_in": case.x}, outputs=True),
        "gauss-newton, the search alone": case.search(),
        **{name: (lambda options=options: case.fit(**options)) for name, options in METHODS.items()},
    }
    found = {name: case.fit(**options) for name, options in METHODS.items()}  # compiles, too
    least = min(fit.searches[0].cost for fit in found.values())
    best = race(entries, 3 if report.quick else 9)
    rows = [[name, *figures(best, best[name])] for name in list(entries)[:3]]
    for name, fit in found.items():
        runs = str(sum(s.evaluations for s in fit.searches))
        if reached(report, name, fit.searches[0].cost, least):
            rows.append([name, *figures(best, best[name]), runs])
    rows += threaded(best)
    rows += scipy_rows(report, case, least, best)
    rows += casadi_rows(report, case, least, best)
    head = ["what", "wall [ms]", "CPU [ms]", "simulate()s", "kernels", "simulations asked for"]
    report.table(
        "Fits: 5 parameters of (8)-(9), 10 s at 1 kHz, two tones, noise 0.005 rad",
        head,
        [[*row, ""] if len(row) < len(head) else row for row in rows],
    )
    bars(report, best)


def reached(report: Report, name: str, cost: float, least: float) -> bool:
    """Whether a contestant found the optimum; a time is shown only then."""
    return report.check(f"fits, {name}: sum of squares above the least", cost / least - 1, SAME)


def figures(best: dict[str, Best], one: Best) -> list[str]:
    """Wall and processor time, the latter in simulations."""
    single, kernel = best["one simulation, simulate()"].cpu, best["one simulation, kernel alone"].cpu
    return [three(1e3 * one.wall), three(1e3 * one.cpu), three(one.cpu / single), three(one.cpu / kernel)]


def bars(report: Report, best: dict[str, Best]) -> None:
    """What the design asks for."""
    for name in list(METHODS)[:2]:
        report.bar(f"{name}, over simulate()", best[name].cpu / best["one simulation, simulate()"].cpu, 100)
        report.bar(f"{name}, over a kernel", best[name].cpu / best["one simulation, kernel alone"].cpu, 100)
    report.bar("ga, wall", best["ga (genetic algorithm, then Nelder-Mead)"].wall, 1.0, " s")
    for name, b in best.items():
        report.note(f"fits, {name}", {"wall_s": b.wall, "cpu_s": b.cpu, "runs": b.count})


# ---- threads of the matrix library ------------------------------------------------------------------


def threaded(best: dict[str, Best]) -> list[list[str]]:
    """The same fits in a process whose matrix library has threads of its own, as users have it."""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, __file__, "--worker"], env=environment, capture_output=True, text=True, check=True
    )
    return [
        [f"{name}, matrix library's threads left on", *figures(best, Best(*times))]
        for name, times in json.loads(done.stdout).items()
    ]


def worker() -> None:
    """Measure in this process and print the times."""
    case = Case()
    chosen = [name for name in METHODS if "ipopt" not in name]
    for name in chosen:
        case.fit(**METHODS[name])
    best = race({name: (lambda name=name: case.fit(**METHODS[name])) for name in chosen}, 7)
    print(json.dumps({name: (b.wall, b.cpu) for name, b in best.items()}))


# ---- SciPy over plain Python, CasADi alone ------------------------------------------------------------


def scipy_rows(report: Report, case: Case, least: float, best: dict[str, Best]) -> list[list[str]]:
    """least_squares, and what differential_evolution would take."""
    from scipy.optimize import differential_evolution, least_squares

    rows, model = [], fits_plain.Model(case.x, case.y, STEP)
    one, many = timed(lambda: model.residuals(case.begin)), timed(lambda: model.side_by_side(case.begin[:, None]))
    rows.append(["one simulation, a loop over Python floats", *figures(best, one)])
    rows.append(["one simulation, a loop over NumPy vectors", *figures(best, many)])
    for name, jacobian in (("differences one by one", "2-point"), ("differences in NumPy vectors", model.jacobian)):
        ends: list[Any] = []
        size = np.array([1.0, 1.0, 1.0, 5.0, 1.0])
        took = timed(lambda: ends.append(least_squares(model.residuals, case.begin, jacobian, x_scale=size)))  # noqa: B023
        title, runs = f"scipy least_squares, plain Python, {name}", model.counted()
        if reached(report, title, case.squares(ends[0].x), least):
            rows.append([title, *figures(best, took), str(runs)])
    problem = case.posed()
    asked = Best()
    ended: list[Any] = []
    box = [(math.log(a), math.log(b)) if a > 0 else (a, b) for a, b in RANGES]

    sets: list[int] = []

    def costs(z: np.ndarray) -> np.ndarray:
        sets.append(z.shape[1])
        return problem.costs(np.where(np.array(RANGES)[:, :1] > 0, np.exp(np.minimum(z, 10)), z).T)

    def evolve() -> None:
        ended.append(
            differential_evolution(
                costs, box, rng=0, vectorized=True, updating="deferred", polish=False, tol=1e-4, atol=0
            )
        )

    timed(evolve, asked)
    title = "scipy differential_evolution, the costs from our lanes"
    if reached(report, title, float(ended[0].fun), least):
        rows.append([title, *figures(best, asked), str(sum(sets))])
        long = Best(one.wall * sum(sets), one.cpu * sum(sets))
        title = "the same over plain Python (not run: so many times one simulation)"
        rows.append([title, *figures(best, long), str(sum(sets))])
    return rows


def casadi_rows(report: Report, case: Case, least: float, best: dict[str, Best]) -> list[list[str]]:
    """Single and multiple shooting with nothing but CasADi's own graphs, as its manual has it."""
    rows = []
    for title, build in fits_casadi.FORMULATIONS.items():
        began = time.perf_counter(), time.process_time()
        solve = build(case.x, case.y, STEP, case.begin)
        built = Best(time.perf_counter() - began[0], time.process_time() - began[1])
        ends: list[np.ndarray] = []
        took = timed(lambda: ends.append(solve()))  # noqa: B023
        if reached(report, title, case.squares(ends[0]), least):
            rows.append([f"{title}: building it", *figures(best, built)])
            rows.append([f"{title}: solving it", *figures(best, took)])
    return rows


if __name__ == "__main__":
    if sys.argv[1:] == ["--worker"]:
        worker()
    else:
        import bench

        sys.exit(bench.main(["--only", "fits", *sys.argv[1:]]))
