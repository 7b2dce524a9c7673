"""``python -m tests.faults [SCENARIO …] [--most N] [--kill N] [--seed N]``: let every call fail once in turn."""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from tests.faults.inject import build, can_run, inject, kill
from tests.faults.scenarios import SCENARIOS, TORN
from tests.faults.trials import KINDS

PRELOADED = "TSMBLOCKS_FAULTS"
"""Variable of the environment that says that the library is loaded."""
HEAD = ("scenario", "calls", "trials", "refused", "survived", "killed", "aborted", "faults")


def main() -> int:
    """Run scenarios; exit status 1 when a fault was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    names = ", ".join(SCENARIOS)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"one of: {names} (default: all)")
    parser.add_argument("--most", type=int, help="trials of each, drawn with the seed (default: all)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="calls that fail (default: all)")
    parser.add_argument("--kill", type=int, metavar="N", help="instead, kill each at N instants, and run it again")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print one object a line")
    args = parser.parse_args()
    if not can_run():
        parser.exit(2, "faults are injected on Linux, where there is a C compiler.\n")
    if PRELOADED not in os.environ:
        return _again_preloaded()
    found = 0
    for name in args.scenarios or [name for name in SCENARIOS if name != TORN]:
        began = time.monotonic()
        result = (
            kill(name, args.kill, args.seed)
            if args.kill
            else inject(name, most=args.most, seed=args.seed, kinds=args.kinds)
        )
        found += bool(result.faults)
        numbers = (result.calls, result.trials, result.refused, result.survived, result.killed, result.aborted)
        if args.json:
            print(json.dumps(dict(zip(HEAD, (name, *numbers, result.faults), strict=True))), flush=True)
            continue
        took = f"{time.monotonic() - began:.1f} s"
        print(
            f"{name}: " + ", ".join(f"{v} {k}" for k, v in zip(HEAD[1:], numbers, strict=False)) + f"; {took}",
            flush=True,
        )
        for fault, first in result.faults.items():
            print(f"  {result.counts[fault]} x {fault}: {first}", flush=True)
    return 1 if found else 0


def _again_preloaded() -> int:
    """This command in a process into which the library is loaded first."""
    with tempfile.TemporaryDirectory() as folder:
        library = build(Path(folder))
        env = os.environ | {"LD_PRELOAD": str(library), PRELOADED: "1", "OPENBLAS_NUM_THREADS": "1"}
        return os.spawnve(os.P_WAIT, sys.executable, [sys.executable, "-m", "tests.faults", *sys.argv[1:]], env)


if __name__ == "__main__":
    sys.exit(main())
