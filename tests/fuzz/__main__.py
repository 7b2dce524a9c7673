"""``python -m tests.fuzz [TARGET …] [--seconds S] [--seed N] [--keep DIR]``: attack without end, or for so long."""

import argparse
import faulthandler
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from tests.fuzz.attack import attack
from tests.fuzz.differential.campaign import campaign
from tests.fuzz.targets import NEEDS, TARGETS

DIFFERENTIAL = "differential"
"""The target that compares random diagrams with an independent reference."""

ROUND = 10.0
"""Seconds for one target before the next has its turn."""


def _can_be_attacked(name: str) -> bool:
    """Whether the package that writes the good files of a target is installed."""
    return all(map(find_spec, NEEDS.get(name, ())))


def main() -> int:
    """Attack the targets in turn; exit status 1 when a fault was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument(
        "targets", nargs="*", metavar="TARGET", help=f"one of: {', '.join([*TARGETS, DIFFERENTIAL])} (default: all)"
    )
    parser.add_argument("--seconds", type=float, default=float("inf"), help="how long in all (default: without end)")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="of the first round (default: the clock)")
    parser.add_argument("--keep", type=Path, help="folder for the inputs that found faults")
    args = parser.parse_args()
    faulthandler.enable()
    until, seed, found = time.monotonic() + args.seconds, args.seed, dict[str, bytes]()
    while time.monotonic() < until:
        for name in args.targets or [*filter(_can_be_attacked, TARGETS), DIFFERENTIAL]:
            with tempfile.TemporaryDirectory() as folder:
                left = min(ROUND, max(until - time.monotonic(), 0.0))
                different = name == DIFFERENTIAL
                count = campaign(seed, seconds=left) if different else attack(name, Path(folder), seed, seconds=left)
            print(f"{name:12s} seed {seed}: {count.inputs} inputs, {count.refused} refused", flush=True)
            for place, given in count.faults.items():
                if f"{name} {place}" not in found:
                    found[f"{name} {place}"] = given if isinstance(given, bytes) else repr(given).encode()
                    print(f"  FAULT {place}\n  {repr(given)[:300]}", flush=True)
        seed += 1
    if args.keep:
        args.keep.mkdir(parents=True, exist_ok=True)
        for k, content in enumerate(found.values(), 1):
            (args.keep / f"fault_{k}").write_bytes(content)
    return 1 if found else 0


sys.exit(main())
