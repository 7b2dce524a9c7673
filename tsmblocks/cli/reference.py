"""Build the reference as a folder of HTML that needs no network: tutorials, how-to guides, gallery, blocks, Python.

The pages of blocks, diagrams and effects are derived from their code; quick
examples are run for theirs. Needs pip install "tsmblocks[reference]".

  tsmblocks reference --out reference
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from tsmblocks.cli import common, console

HELP = "build the reference pages: tutorials, guides, gallery, blocks, effects, Python, commands"
WIDTH = 78
"""Columns of the help of a command in its page."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    folder = "folder for the pages (tsmblocks-reference)"
    common.add(parser, "--out", metavar="DIR", default="tsmblocks-reference", help=folder)
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.reference.site import build, need_sphinx

    need_sphinx()
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    with console.progress_line(console.stage_progress(), quiet=args.json) as progress:
        count = build(folder, _helps(args), progress)
    page = folder / "index.html"
    common.print_result(args, {"pages": count, "index": page}, f"{count} pages; begin at {page}")
    return 0


def _helps(args: argparse.Namespace) -> Mapping[str, tuple[str, str]]:
    """By command: one line on it, and its help, the same whatever the terminal."""
    _, made = args.parsers()
    for parser in made.values():
        parser.formatter_class = partial(common.Formatter, width=WIDTH)
    return {name: (args.helps[name], parser.format_help()) for name, parser in made.items()}
