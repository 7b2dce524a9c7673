r"""Find what a model misses: name the effect, add it to the diagram, show how the gap to recordings shrinks.

Each FILE is one experiment; its columns are matched by name to the diagram's
inputs and outputs. Several with different amplitudes and frequencies tell more
than one. With --out a folder gets the report (report.html, one page that needs
no network), the numbers (diagnosis.json) and the diagram with what was found in
place (augmented.toml); without it only the text is printed. Ctrl-C ends the
search with what was found so far.

  tsmblocks diagnose tendon_sheath_symmetric --data bend*.csv --out found
  tsmblocks diagnose tendon_sheath_symmetric --data a.csv b.csv \
      --noise-floor 0.05deg --effects 'backlash' 'dead_*'
  tsmblocks diagnose my_drive.toml --data run.csv --noise-floor u=20mV x=0.01deg
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from tsmblocks.cli import common, console, recordings

if TYPE_CHECKING:
    from tsmblocks.diagnosis.result import Diagnosis

HELP = "find what a model misses, name it, add it, and show how the gap shrinks"
TYPED = (
    (r"\bnoise_floor=", "--noise-floor "),
    (r"^noise_floor\b", "--noise-floor"),
    (r"start=\{'([^']+)': …\}", r"another number of \1 in the diagram"),
    (r"\bfree=\['([^']+)'\]", r"--free '\1'"),
    (r"^(free|effects)\b", r"--\1"),
)
"""Arguments as messages name them, and as they are typed."""


def floor(text: str) -> str:
    """A noise floor: a number, perhaps with its unit, perhaps for one output."""
    from tsmblocks.common.errors import TsmError
    from tsmblocks.fitting.noise import parsed

    try:
        parsed(text)
    except TsmError as error:
        raise common.as_typed(error, TYPED) from None
    return text


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s DIAGRAM --data FILE [FILE ...] [options]"
    parser.add_argument("diagram", metavar="DIAGRAM", help="a diagram file, or the name of a ready-made one")
    recordings.data_arguments(parser.add_argument_group("measured data"), several=True)
    search = parser.add_argument_group("search")
    add = search.add_argument
    add(
        "--noise-floor",
        metavar="VALUE",
        type=floor,
        nargs="+",
        action="extend",
        default=[],
        help="rms noise of the outputs, with its unit: 0.05deg, x_out=0.05deg (a number alone is in the unit of the "
        "recordings and of the diagram, and refused where they differ; default: looked for in the data)",
    )
    add(
        "--free",
        metavar="PATTERN",
        nargs="+",
        action="extend",
        help="parameters of the diagram that may change, such as 'tsm.*' (default: all)",
    )
    add(
        "--effects",
        metavar="PATTERN",
        nargs="+",
        action="extend",
        help="effects that are tried, such as backlash 'dead_*' (default: the whole catalogue)",
    )
    add(
        "--outputs",
        metavar="NAME",
        nargs="+",
        action="extend",
        help="outputs that are compared (default: all that were measured)",
    )
    add("--window", metavar="START:STOP", type=common.times, default=None, help="times in s that count (default: all)")
    add(
        "--no-condition",
        dest="condition",
        action="store_false",
        help="leave measured inputs as they are (default: their noise is filtered out, with zero phase)",
    )
    add("--seed", metavar="N", type=common.count, default=0, help="of the random parts (default 0)")
    add(
        "--step",
        metavar="H",
        type=common.finite_float,
        help="step of the simulation in s (default: found from the data)",
    )
    common.hold_argument(search, default="cubic")
    group = parser.add_argument_group("results")
    results = group.add_argument
    results("--out", metavar="DIR", help="write report.html, diagnosis.json and augmented.toml into a folder")
    results("--plot", metavar="FILE", help="write a figure to a .png, .svg or .pdf file")
    common.json_argument(group)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.common.errors import TsmError
    from tsmblocks.diagnosis.diagnose import diagnose
    from tsmblocks.files import load

    folder, plot = _folder(args.out), common.figure_path(args.plot)
    diagram = load(args.diagram)
    records = recordings.read_experiments(args, diagram, tell=False)  # the notes of the diagnosis say it
    try:
        with console.progress(_far, quiet=args.json) as tell:
            found = diagnose(
                diagram,
                records,
                free=args.free,
                noise_floor=args.noise_floor,
                effects=args.effects,
                outputs=args.outputs,
                window=args.window,
                condition=args.condition,
                seed=args.seed,
                step=args.step,
                hold=args.hold,
                progress=tell,
            )
    except TsmError as error:
        for record in () if args.json else records.values():
            recordings.repairs(record)
        raise common.as_typed(error, TYPED) from None
    if not args.json:
        print(found)
    written = _saved(found, folder)
    return common.finished(found, {"data": recordings.as_json(records)}, written, plot, args)


def _folder(text: str | None) -> Path | None:
    """The folder to write into, made before the long work and not after it."""
    if text is None:
        return None
    from tsmblocks.common.errors import TsmError
    from tsmblocks.html.report_files import folder_for

    try:
        folder = folder_for(text)
    except TsmError as error:
        raise common.UsageError(f"--out: {error}") from None
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _saved(found: Diagnosis, folder: Path | None) -> list[str]:
    """Write the three files; their paths."""
    from tsmblocks.html.report_files import NAMES

    if folder is None:
        return []
    found.save(folder)
    return [str(folder / name) for name in NAMES]


def _far(stage: str, done: int, of: int) -> str:
    """How far the search has come."""
    return f"diagnosing: {stage}" + (f", {done} of {of}" if of > 1 else "")
