r"""Fit a diagram's parameters to recordings and say how sure they are.

Each FILE is one experiment; its columns are matched by name to the diagram's
inputs and outputs. By default every parameter may change, within what its
block declares, while start values of states stay. Ctrl-C ends the search with
the best numbers so far. Without --out and --plot nothing is written.

  tsmblocks fit tendon_sheath_play --data sheath.csv --out fitted.toml
  tsmblocks fit tendon_sheath_play --data a.txt b.txt \
      --columns 't, x_in [deg], , x_out [deg]' --local offset.bias
  tsmblocks fit tendon_sheath_asymmetric --data sheath.csv \
      --bounds tsm.theta=1:50 --constraint 'alpha2 + A - abs(delta) > 0'
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import attrs

from tsmblocks.cli import common, console, recordings
from tsmblocks.common.errors import TsmError

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

HELP = "fit parameters to recordings, print them with their intervals"
TYPED = (
    (r"start=\{'([^']+)': …\}", r"--set \1=…"),
    (r"free=\['([^']+)'\]", r"--free '\1'"),
    (r"\b(segments)=(\d+)", r"--\1 \2"),
    (r"method='(\w+)'", r"--method \1"),
)
"""Arguments as messages name them, and as they are typed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s DIAGRAM --data FILE [FILE ...] [options]"
    parser.add_argument("diagram", metavar="DIAGRAM", help="a diagram file, or the name of a ready-made one")
    measured = parser.add_argument_group("measured data")
    recordings.data_arguments(measured, several=True)
    recordings.condition_argument(measured)
    _unknowns(parser.add_argument_group("what may change"))
    _search(parser.add_argument_group("search"))
    common.result_arguments(
        parser.add_argument_group("results"), "the fitted diagram (with --local one per experiment)"
    )


def _unknowns(options: argparse._ActionsContainer) -> None:
    add, several = options.add_argument, partial(options.add_argument, nargs="+", action="extend", default=[])
    add(
        "--free",
        metavar="PATTERN",
        nargs="+",
        action="extend",
        help="parameters that may change, such as 'tsm.*' (default: all)",
    )
    several("--local", metavar="PATTERN", help="parameters with a value of their own in each experiment")
    add("--start-states", action="store_true", help="find the start value of every state too, in each experiment")
    several(
        "--set",
        dest="settings",
        metavar="NAME=VALUE",
        type=common.setting,
        help="the number a parameter starts from, or keeps",
    )
    several(
        "--bounds",
        metavar="NAME=LOW:HIGH",
        type=common.bounds,
        help="bounds of a parameter; either side may be left out",
    )
    several("--constraint", metavar="TEXT", help="a condition, such as 'alpha2 + A - abs(delta) > 0'")
    several(
        "--tie",
        metavar="NAME=EXPRESSION",
        type=common.tie,
        help="a parameter that follows others, such as 'alpha2=alpha1'",
    )
    several("--prior", metavar="NAME=MEAN:DEVIATION", type=common.belief, help="what is known of a parameter already")


def _search(options: argparse._ActionsContainer) -> None:
    add = options.add_argument
    add(
        "--outputs",
        metavar="NAME",
        nargs="+",
        action="extend",
        help="outputs that are compared (default: all that were measured)",
    )
    add("--window", metavar="START:STOP", type=common.times, default=None, help="times in s that count (default: all)")
    method = add("--method", metavar="M", default="gauss-newton", help="gauss-newton (default), ipopt or ga")
    common.suggest(method, common.FITS)
    add(
        "--segments",
        metavar="N",
        type=common.whole,
        default=1,
        help="pieces of multiple shooting, with --method ipopt (default 1)",
    )
    add("--starts", metavar="N", type=common.whole, default=4, help="starts, random ones after the first (default 4)")
    add("--seed", metavar="N", type=common.count, default=0, help="of the random starts (default 0)")
    add(
        "--step",
        metavar="H",
        type=common.finite_float,
        help="step of the simulation in s (default: found from the data)",
    )
    common.hold_argument(options)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load
    from tsmblocks.fitting.fit import fit

    out, plot = common.result_path(args.out, (".toml",)), common.figure_path(args.plot)
    diagram = load(args.diagram).with_parameters(dict(args.settings))
    records = recordings.read_experiments(args, diagram)
    try:
        with console.progress(console.searched("fitting"), quiet=args.json) as tell:
            found = fit(
                diagram,
                records,
                free=args.free,
                local=args.local,
                start_states=args.start_states,
                bounds=dict(args.bounds),
                constraints=args.constraint,
                ties=dict(args.tie),
                priors=dict(args.prior),
                outputs=args.outputs,
                window=args.window,
                method=args.method,
                segments=args.segments,
                starts=args.starts,
                seed=args.seed,
                step=args.step,
                hold=args.hold,
                progress=tell,
            )
    except TsmError as error:
        raise common.as_typed(error, TYPED) from None
    found = attrs.evolve(found, notes=tuple(recordings.in_options(text, args) for text in found.notes))
    if not args.json:
        print(found)
    written = _saved(found, out, each=bool(args.local))
    return common.finished(found, {"data": recordings.as_json(records)}, written, plot, args)


def _saved(found: Fit, out: Path | None, *, each: bool) -> list[str]:
    """Write the fitted diagram, or one for each experiment where numbers differ between them; the paths."""
    from tsmblocks.files import save

    if out is None:
        return []
    if not each or len(found.diagrams) == 1:
        return [str(found.save(out))]
    paths = common.marked(out, found.diagrams)
    for name, path in paths.items():
        save(found.diagrams[name], path)
    return [str(path) for path in paths.values()]
