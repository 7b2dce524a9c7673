"""Draw a diagram to an SVG or PNG picture, or as Mermaid text (.mmd)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tsmblocks.cli import common, console

HELP = "draw a diagram to .svg, .png or .mmd"
ENDINGS = (".svg", ".png", ".mmd")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("diagram", metavar="DIAGRAM", help="a diagram file, or the name of a ready-made one")
    parser.add_argument("--out", metavar="FILE", help=".svg, .png or .mmd (default: NAME.svg in this folder)")
    common.json_argument(parser)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load

    path = common.result_path(args.out or f"{Path(args.diagram).stem}.svg", ENDINGS)
    assert path is not None
    diagram = load(args.diagram)
    write(diagram, path)
    if args.json:
        console.give({"diagram": args.diagram, "title": diagram.title, "written": [path]})
    else:
        print(f"wrote {path}")
    return 0


def write(diagram: Any, path: Path) -> None:
    """Draw a diagram into a file of the kind its name asks for."""
    from tsmblocks import draw

    if path.suffix.lower() == ".png":
        draw.to_png(diagram, path)
        return
    text = draw.to_svg(diagram) if path.suffix.lower() == ".svg" else draw.to_mermaid(diagram)
    path.write_text(text, encoding="utf-8", newline="\n")
