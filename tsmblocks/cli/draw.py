"""Draw a diagram to an SVG, PNG or PDF picture, or as Mermaid text (.mmd)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tsmblocks.cli import common
from tsmblocks.common.atomic_write import replace_file

HELP = "draw a diagram to .svg, .png, .pdf or .mmd"
ENDINGS = (".svg", ".png", ".pdf", ".mmd")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.add(parser, "diagram")
    parser.add_argument("--out", metavar="FILE", help=".svg, .png, .pdf or .mmd (default: NAME.svg in this folder)")
    common.add(parser, "--set")
    parser.add_argument("--highlight", metavar="BLOCK", nargs="+", default=[], help="blocks drawn in another colour")
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load

    path = common.result_path(args.out or f"{Path(args.diagram).stem}.svg", ENDINGS)
    assert path is not None
    diagram = load(args.diagram).with_parameters(dict(args.settings))
    write(diagram, path, args.highlight)
    facts = {"diagram": args.diagram, "title": diagram.title, "written": [path]}
    common.print_result(args, facts, common.wrote([path]))
    return 0


def write(diagram: Any, path: Path, highlight: Sequence[str] = ()) -> None:
    """Draw a diagram into a file; its ending says the format.

    Blocks in ``highlight``, and algebraic loops, have another colour.
    """
    from tsmblocks import draw
    from tsmblocks.common.errors import TsmError
    from tsmblocks.simulation.compiled import equations

    kind = path.suffix.lower()
    try:
        loops = equations(diagram).loops
    except TsmError:  # it has a picture, though no equations
        loops = ()
    if kind in (".png", ".pdf"):
        (draw.to_png if kind == ".png" else draw.to_pdf)(diagram, path, highlight=highlight, loops=loops)
        return
    if kind == ".mmd" and highlight:
        raise common.UsageError("--highlight is for pictures; Mermaid text (.mmd) has none of our colours.")
    text = draw.to_svg(diagram, highlight=highlight, loops=loops) if kind == ".svg" else draw.to_mermaid(diagram)
    replace_file(path, text)
