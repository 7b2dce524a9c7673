"""List the ready-made diagrams, by the names that every command takes in place of a file.

Each may be given wherever a command takes a diagram.

  tsmblocks diagrams
"""

from __future__ import annotations

import argparse

from tsmblocks.cli import common, console
from tsmblocks.common.tables import columns

HELP = "list the ready-made diagrams"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load
    from tsmblocks.files.shipped import shipped_names

    listed = {name: load(name).title for name in shipped_names()}
    table = columns([*listed.items()], "", frozenset({0, 1}))
    more = "'tsmblocks check NAME' lists inputs and outputs, 'tsmblocks draw NAME' draws it."
    common.print_result(args, listed, f"{table}\n\n{console.wrap(more, console.width())}")
    return 0
