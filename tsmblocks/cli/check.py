"""Load and compile diagram files: one line on each valid file, every fault of each other file.

Nothing is run or written.

  tsmblocks check my_drive.toml motor_linear
  tsmblocks check my_drive.toml --refuse-loops --json
"""

from __future__ import annotations

import argparse
import sys
from itertools import starmap
from typing import Any

from tsmblocks.cli import common, console
from tsmblocks.common.errors import DiagramError, FileError, ParameterError, TsmError
from tsmblocks.common.headings import heading

HELP = "check diagram files and list their faults"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    files = "diagram files, or names of ready-made ones"
    common.add(parser, "files", metavar="FILE", nargs="+", help=files, suggests=common.DIAGRAMS)
    common.add(parser, "--refuse-loops")
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status is 2 when any file has a fault."""
    checked = []
    for name in args.files:
        try:
            checked.append({"file": name, "sound": True, **contents(name, refuse_loops=args.loops == "refuse")})
        except (TsmError, OSError) as error:
            checked.append({"file": name, "sound": False, "faults": _faults(error)})
            if not args.json:
                console.print_error(str(error))
        if checked[-1]["sound"] and not args.json:  # a fault of standard output is none of the file
            console.print_text(console.fold(f"{name}: {description(checked[-1])}", sys.stdout))
    faulty = sum(not one["sound"] for one in checked)
    if args.json:
        console.print_json({"faulty": faulty, "files": checked})
    elif faulty and len(checked) > 1:
        console.print_error(f"{faulty} of {len(checked)} files have faults.")
    return 2 if faulty else 0


def _faults(error: Exception) -> list[str]:
    return list(error.problems) if isinstance(error, (DiagramError, FileError)) else [str(error)]


def contents(name: str, *, refuse_loops: bool = False) -> dict[str, Any]:
    """Contents of a valid diagram: counts of its parts and loops; inputs and outputs with their units."""
    from tsmblocks.compiler.compile import compile_diagram
    from tsmblocks.files import load
    from tsmblocks.fitting.parameters import chosen
    from tsmblocks.simulation.stop_condition import stop_condition

    diagram = load(name)
    eq = compile_diagram(diagram, refuse_loops=refuse_loops)
    if diagram.simulation.stop_when:
        try:
            stop_condition(eq, diagram.simulation.stop_when)
        except ParameterError as error:
            raise ParameterError(f"{name}: {error}") from None
    return {
        "title": diagram.title,
        "blocks": len(eq.reads),
        "states": len(eq.x),
        "parameters": len(eq.p),
        "free": len(chosen(diagram, None)),
        "loops": len(eq.loops),
        "inputs": {k: p.unit for k, p in diagram.inports.items()},
        "outputs": {k: diagram.unit(k) for k in diagram.outputs},
    }


def description(made: dict[str, Any]) -> str:
    """Contents of a valid diagram in one line."""
    counts = ", ".join(_count(made[f"{word}s"], word) for word in ("block", "state", "parameter"))
    counts += f" ({made['free']} of them free in a fit)" if made["parameters"] else ""
    counts += f", {_count(made['loops'], 'algebraic loop')}" if made["loops"] else ""
    ends = (f"{what}: {', '.join(starmap(heading, made[what].items())) or 'none'}" for what in ("inputs", "outputs"))
    return f"ok; {counts}; {'; '.join(ends)}"


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"
