"""Speed of tsmblocks against hand-written C and other tools, each result checked before its time is shown.

    python tests/benchmarks/bench.py [--quick] [--peers] [--json FILE] [--only NAME]

See README.md beside this file. Exit code 1 when two results that should be equal are not, else 0.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin on problems of this size

import batches  # noqa: E402
import chains  # noqa: E402
import cold_start  # noqa: E402
import fits  # noqa: E402
import gradients  # noqa: E402
import hand_c  # noqa: E402
import numpy as np  # noqa: E402 - after the threads are set
import peers  # noqa: E402
import recovery  # noqa: E402
import single_run  # noqa: E402
import stiff  # noqa: E402
import studies  # noqa: E402
from measure import Report  # noqa: E402

SECTIONS = {
    "fig09b": single_run.fig09b,
    "peers": peers.race_peers,
    "fig16": single_run.fig16,
    "cold": cold_start.cold_start,
    "batch": batches.batches,
    "studies": studies.studies,
    "gradients": gradients.gradients,
    "fits": fits.fits,
    "recovery": recovery.recovery,
    "chains": chains.chains,
    "stiff": stiff.stiff,
    "loops": stiff.loops,
}


def main(arguments: list[str] | None = None) -> int:
    """Run the chosen sections and hold the figures against the bars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="shorter runs and fewer repetitions: under a minute")
    parser.add_argument("--peers", action="store_true", help="also the other tools that are installed: some minutes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number to FILE")
    parser.add_argument(
        "--only", action="append", choices=SECTIONS, metavar="NAME", help=f"one of {', '.join(SECTIONS)}; repeatable"
    )
    args = parser.parse_args(arguments)
    report = Report(args.quick)
    describe(report)
    chosen = args.only or [name for name in SECTIONS if name != "recovery" and (name != "peers" or args.peers)]
    for name in SECTIONS:
        if name in chosen:
            SECTIONS[name](report)
    return report.finish(args.json)


def describe(report: Report) -> None:
    """Say on what machine this is."""
    import casadi
    import llvmlite

    compiler = hand_c.compiler()
    facts = {
        "processor": f"{processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": f"numpy {np.__version__}, casadi {casadi.__version__}, llvmlite {llvmlite.__version__}",
        "compiler": hand_c.version(compiler) if compiler else "none",
        "load": ", ".join(f"{x:.2f}" for x in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown",
    }
    report.found["about"] = facts
    for key, value in facts.items():
        report.say(f"{key}: {value}")


def processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next(line.partition(":")[2].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


if __name__ == "__main__":
    sys.exit(main())
