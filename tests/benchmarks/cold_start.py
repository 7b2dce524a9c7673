"""From a fresh process to the first result: read the file, flatten, compile, run 20 s at 1 ms."""

from __future__ import annotations

import tempfile

import numpy as np
import ours
from measure import Report, difference, ms
from peers import run_worker

import tsmblocks as tsm

TOLERANCE = 1e-12


def cold_start(report: Report) -> None:
    """Fresh processes with the store of machine code off, filled by the first, and filled before."""
    diagram = tsm.load(ours.FIGURES["fig09b"])
    reference = ours.tracking(tsm.simulate(diagram, stop=20.0))
    settings = {"numbers": {}, "stop": 20.0, "step": 1e-3, "seconds": 0.0, "most": 2}
    times: dict[str, list[np.ndarray]] = {"store off": [], "store filled": []}
    with tempfile.TemporaryDirectory() as folder:
        run_worker("ours", settings, {"TSMBLOCKS_CACHE": folder})  # also leaves byte code of all modules
        for _ in range(3 if report.quick else 10):
            for name, store in (("store off", "off"), ("store filled", folder)):
                result = run_worker("ours", settings, {"TSMBLOCKS_CACHE": store})
                off = difference({"e": reference}, {"e": result["error"]})
                if not report.check(f"cold start, {name}", off, TOLERANCE):
                    return
                times[name].append([*result["times"], result["runs"][-1][0]])
    rows = []
    for name, found in times.items():
        parts = np.min(found, axis=0)
        total = min(t[1] + t[2] for t in found)
        rows.append([name, ms(parts[0]), ms(parts[1]), ms(parts[2]), ms(total), ms(parts[3])])
        report.note(
            f"cold start, {name}", {"import_s": parts[0], "read_s": parts[1], "first_run_s": parts[2], "total_s": total}
        )
        if name == "store off":
            report.bar("cold start beyond imports, Fig 9(b), 20 s", total, 0.3, " s")
    head = [
        "machine code",
        "import [ms]",
        "read the file [ms]",
        "first run [ms]",
        "beyond import [ms]",
        "second run [ms]",
    ]
    report.table("Cold start, Fig 9(b), 20 s at 1 ms: fresh processes", head, rows)
