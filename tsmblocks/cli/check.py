"""Load and compile diagram files; one line on each that is sound, every fault of each that is not."""

from __future__ import annotations

import argparse
from typing import Any

from tsmblocks.cli import common
from tsmblocks.errors import TsmError

HELP = "check diagram files and list their faults"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("files", metavar="FILE", nargs="+", help="diagram files, or names of ready-made ones")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status is 2 when any file has a fault."""
    faulty = 0
    for name in args.files:
        try:
            print(f"{name}: {summary(name)}")
        except (TsmError, OSError) as error:
            common.complain(str(error))
            faulty += 1
    if faulty and len(args.files) > 1:
        common.complain(f"{faulty} of {len(args.files)} files have faults.")
    return 2 if faulty else 0


def summary(name: str) -> str:
    """Say what a sound diagram is made of, in one line."""
    from tsmblocks.compile import compile_diagram
    from tsmblocks.files import load

    diagram = load(name)
    eq = compile_diagram(diagram)
    counts = ", ".join(
        (_count(len(eq.reads), "block"), _count(len(eq.x), "state"), _count(len(eq.p), "parameter"))
    )  # fmt: skip
    inputs = {k: p.unit for k, p in diagram.inports.items()}
    outputs = {k: diagram.unit(k) for k in diagram.outputs}
    return f"ok; {counts}; inputs: {_named(inputs)}; outputs: {_named(outputs)}"


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _named(signals: dict[str, Any]) -> str:
    return ", ".join(f"{k} [{u}]" if u else k for k, u in signals.items()) or "none"
