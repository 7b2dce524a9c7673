"""Build the reference as a folder of HTML that needs no network: blocks, diagrams, effects, concepts, Python, commands.

The page of a block is derived from its code. Needs Sphinx and its
theme: pip install "tsmblocks[reference]".

  tsmblocks reference --out reference
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tsmblocks.cli import common, console

HELP = "build the reference pages: blocks, diagrams, effects, concepts, Python, commands"
WIDTH = 80
"""Columns of the help of a command in its page."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--out", metavar="DIR", default="tsmblocks-reference", help="folder for the pages (tsmblocks-reference)"
    )
    common.json_argument(parser)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.reference.site import build, need_sphinx

    need_sphinx()
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    with console.progress_line(lambda what, done: f"{what}: {100 * done:3.0f} %", quiet=args.json) as progress:
        count = build(folder, _helps(args), progress)
    if args.json:
        console.print_json({"pages": count, "index": folder / "index.html"})
    else:
        print(f"{count} pages; begin at {folder / 'index.html'}")
    return 0


def _helps(args: argparse.Namespace) -> Mapping[str, tuple[str, str]]:
    """By command: one line on it, and its help."""
    with _wide(WIDTH):
        _, made = args.parsers()
        return {name: (args.helps[name], parser.format_help()) for name, parser in made.items()}


@contextmanager
def _wide(columns: int) -> Iterator[None]:
    """Set COLUMNS, so that the pages are the same everywhere."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(columns)
    try:
        yield
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
