r"""Fit a diagram's parameters to recordings, with their confidence intervals.

Each FILE is one experiment; its columns are matched by name to the diagram's
inputs and outputs. By default every parameter may change, within what its
block declares, while initial states are fixed. Ctrl-C ends the search with
the best parameters so far. Without --out and --plot nothing is written.

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

HELP = "fit parameters to recordings, print them with their confidence intervals"
OPTION_NAMES = (
    (r"start=\{'([^']+)': …\}", r"--set \1=…"),
    (r"free=\['([^']+)'\]", r"--free '\1'"),
    (r"\b(segments)=(\d+)", r"--\1 \2"),
    (r"method='(\w+)'", r"--method \1"),
)
"""Arguments of the function as messages name them, and the options of the command."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s DIAGRAM --data FILE [FILE ...] [options]"
    common.diagram_argument(parser)
    measured = parser.add_argument_group("measured data")
    recordings.data_arguments(measured, several=True)
    recordings.condition_argument(measured)
    _unknowns(parser.add_argument_group("parameters"))
    _search(parser.add_argument_group("search"))
    written = "write the fitted diagram (with --local one per experiment) to a .toml file"
    common.result_arguments(parser.add_argument_group("results"), written)


def _unknowns(options: argparse._ActionsContainer) -> None:
    several = partial(options.add_argument, default=[], **common.SEVERAL)
    common.free_argument(options)
    several("--local", metavar="PATTERN", help="parameters with a value of their own in each experiment")
    options.add_argument(
        "--start-states", action="store_true", help="estimate the initial state too, in each experiment"
    )
    common.settings_argument(options, "the value from which a parameter starts, or which it keeps")
    bounds = "bounds of a parameter; either side may be left out"
    several("--bounds", metavar="NAME=LOW:HIGH", type=common.bounds, help=bounds)
    several("--constraint", metavar="TEXT", help="a condition, such as 'alpha2 + A - abs(delta) > 0'")
    tie = "a parameter that is a function of others, such as 'alpha2=alpha1'"
    several("--tie", metavar="NAME=EXPRESSION", type=common.tie, help=tie)
    prior = "a parameter's prior, of a normal distribution"
    several("--prior", metavar="NAME=MEAN:DEVIATION", type=common.prior, help=prior)


def _search(options: argparse._ActionsContainer) -> None:
    add = options.add_argument
    common.compared_arguments(options)
    method = add("--method", metavar="M", default="gauss-newton", help="gauss-newton (default), ipopt or ga")
    common.suggest_values(method, common.FITS)
    segments = "pieces of multiple shooting, with --method ipopt (default 1)"
    add("--segments", metavar="N", type=common.positive_integer, default=1, help=segments)
    common.search_arguments(options, starts=4)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load
    from tsmblocks.fitting.fit import fit

    out, plot = common.result_path(args.out, (".toml",)), common.figure_path(args.plot)
    diagram = load(args.diagram).with_parameters(dict(args.settings))
    records = recordings.read_experiments(args, diagram)
    try:
        with console.progress_line(console.search_progress("fitting"), quiet=args.json) as progress:
            result = fit(
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
                progress=progress,
            )
    except TsmError as error:
        raise common.with_option_names(error, OPTION_NAMES) from None
    result = attrs.evolve(result, notes=tuple(recordings.with_condition_option(text, args) for text in result.notes))
    if not args.json:
        print(result)
    written = _save(result, out, each=bool(args.local))
    return common.finish(result, {"data": recordings.as_json(records)}, written, plot, args)


def _save(result: Fit, out: Path | None, *, each: bool) -> list[str]:
    """Write the fitted diagram, or one for each experiment where parameters are local; the paths."""
    from tsmblocks.files import save

    if out is None:
        return []
    if not each or len(result.diagrams) == 1:
        return [str(result.save(out))]
    paths = common.paths_by_name(out, result.diagrams)
    for name, path in paths.items():
        save(result.diagrams[name], path)
    return [str(path) for path in paths.values()]
