"""Draw a diagram to an SVG, PNG or PDF picture, or as Mermaid text (.mmd).

The layout is automatic; loops without a state are marked.

  tsmblocks draw fig16_feedforward_feedback --highlight compensator
  tsmblocks draw my_drive.toml --out my_drive.png --symbols
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tsmblocks.cli import common, parameters
from tsmblocks.common.atomic_write import replace_file

HELP = "draw a diagram to .svg, .png, .pdf or .mmd"
ENDINGS = (".svg", ".png", ".pdf", ".mmd")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    common.add(parser, "diagram")
    parser.add_argument("--out", metavar="FILE", help=".svg, .png, .pdf or .mmd (default: NAME.svg in this folder)")
    common.add(parser, "--set")
    parser.add_argument("--highlight", metavar="BLOCK", nargs="+", default=[], help="blocks drawn in another colour")
    parser.add_argument("--inside", metavar="BLOCK", default="", help="draw the inside of a block that is a diagram")
    parser.add_argument("--symbols", action="store_true", help="write symbols instead of the values of parameters")
    parser.add_argument(
        "--wrap",
        metavar="PIXELS",
        type=float,
        default=1800,
        help="continue in a new row beyond this width (default: 1800)",
    )
    theme = "colours of an .svg file: those of the reader's screen (default), or always light or dark"
    parser.add_argument("--theme", choices=("auto", "light", "dark"), default="auto", help=theme)
    common.add(parser, "--json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load

    path = common.result_path(args.out or f"{Path(args.diagram).stem}.svg", ENDINGS)
    assert path is not None
    diagram = parameters.with_settings(load(args.diagram), args.settings)
    picture = {"inside": args.inside, "parameters": not args.symbols, "wrap": args.wrap}
    write(diagram, path, args.highlight, picture, args.theme)
    facts = {"diagram": args.diagram, "title": diagram.title, "written": [path]}
    common.print_result(args, facts, common.wrote([path]))
    return 0


def write(
    diagram: Any,
    path: Path,
    highlight: Sequence[str] = (),
    picture: Mapping[str, Any] = MappingProxyType({}),
    theme: str = "auto",
) -> None:
    """Draw a diagram into a file; its ending says the format.

    Blocks in ``highlight``, and algebraic loops, have another colour. ``picture`` holds more options of ``to_svg``.
    """
    from tsmblocks import draw
    from tsmblocks.common.errors import TsmError
    from tsmblocks.simulation.compiled import equations

    kind = path.suffix.lower()
    try:
        loops = () if picture.get("inside") else equations(diagram).loops
    except TsmError:  # it has a picture, though no equations
        loops = ()
    if kind in (".png", ".pdf"):
        (draw.to_png if kind == ".png" else draw.to_pdf)(diagram, path, highlight=highlight, loops=loops, **picture)
    elif kind == ".svg":
        replace_file(path, draw.to_svg(diagram, highlight=highlight, loops=loops, theme=theme, **picture))
    elif highlight:
        raise common.UsageError("--highlight is for pictures; Mermaid text (.mmd) has none of our colours.")
    else:
        replace_file(path, draw.to_mermaid(draw.nested(diagram, picture.get("inside", ""))))
