"""Do fits find the truth, and do their intervals keep their word: the long form of tests/test_fit_recovery.py.

python tests/benchmarks/bench.py --only recovery [--quick]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from measure import Best, Report, timed

from tests import identification
from tests.identification import NOISES, SIGNALS, TRUTH, Bench, distance, hits, searches

COSTS = {"gauss-newton": 1e-6, "ipopt": 1e-6, "ga": 1e-5}
"""Share by which sums of squares of one method may differ between starts."""
CHI_SQUARE = 11.07
"""What 95 of 100 draws stay below, with five degrees of freedom."""


def recovery(report: Report) -> None:
    """Random starts by every method, then coverage for every noise and signal."""
    bench = Bench()
    starts(report, bench, 10 if report.quick else 100)
    coverage(report, bench, 40 if report.quick else 200)


def starts(report: Report, bench: Any, count: int) -> None:
    """From random starts in a wide box, the three signals fitted together."""
    rows = []
    for method in COSTS:
        fits: list[Any] = []
        took = timed(lambda: fits.extend(searches(bench, method, count)))  # noqa: B023
        costs = np.array([fit.searches[0].cost for fit in fits])
        values = np.array([[fit[name].value for name in TRUTH] for fit in fits])
        errors = np.array([fits[0][name].error for name in TRUTH])
        same = int((costs <= costs.min() * (1 + COSTS[method])).sum())
        inside = sum(fits[0][name].low <= v <= fits[0][name].high for name, v in TRUTH.items())
        rows.append(
            [
                method,
                f"{same} of {count}",
                f"{costs.max() / costs.min() - 1:.0e}",
                f"{np.max(np.ptp(values, axis=0) / errors):.0e}",
                f"{inside} of {len(TRUTH)}",
                f"{distance(fits[0]):.2f}",
                f"{1e3 * took.cpu / count:.0f}",
            ]
        )
        report.note(f"recovery, {method}", {"same": same, "of": count, **_seconds(took)})
        report.bar(f"recovery, {method}: starts that end at one optimum", same / count, 1.0, at_least=True)
    head = [
        "method",
        "same optimum",
        "costs differ by",
        "values, in standard errors",
        "truth in intervals",
        f"chi square ({CHI_SQUARE})",
        "CPU per fit [ms]",
    ]
    noise, size = np.rad2deg(identification.NOISE), np.rad2deg(identification.ENCODER)
    what = f"{count} random starts, three signals together, noise {noise:.1f} deg, encoders of {size:.2f} deg"
    report.table(f"Recovery: {what}", head, rows)


def coverage(report: Report, bench: Any, draws: int) -> None:
    """How often intervals at 95 % hold the truth."""
    rows, shares = [], []
    for title, noise in NOISES.items():
        for names in (*((name,) for name in SIGNALS), tuple(SIGNALS)):
            found = hits(bench, noise, draws, names)
            each = 100 * found.mean(axis=0)
            what = "all three" if len(names) > 1 else names[0]
            rows.append([f"{title}, {what}", *(f"{v:.1f}" for v in each), f"{each.mean():.1f}"])
            shares.append(each)
    head = ["noise, signal", *(name.partition(".")[2] for name in TRUTH), "mean"]
    report.table(f"Coverage of intervals at 95 %, in percent of {draws} draws", head, rows)
    report.note("coverage", np.array(shares).tolist())
    means = np.mean(shares, axis=1)
    report.bar("coverage, least mean of five parameters", float(means.min()), 90, " %", at_least=True)
    report.bar("coverage, greatest mean of five parameters", float(means.max()), 98, " %")
    report.bar("coverage, least of one parameter", float(np.min(shares)), 90, " %", at_least=True)
    report.bar("coverage, greatest of one parameter", float(np.max(shares)), 98, " %")


def _seconds(took: Best) -> dict[str, float]:
    return {"wall_s": took.wall, "cpu_s": took.cpu}
