r"""Fit a diagram's parameters to recordings, with their confidence intervals.

Each FILE is one experiment; its columns are matched by name to the diagram's
inputs and outputs. By default all parameters are free but initial states and
those that a block declares as known, within the limits of their blocks.
Ctrl-C ends the search with the best parameters so far. Without --out and
--plot nothing is written.
Terms of the result: the glossary of the reference (tsmblocks reference).

  tsmblocks fit tendon_sheath_play --data sheath.csv --out fitted.toml
  tsmblocks fit tendon_sheath_play --data a.txt b.txt \
      --columns 't, x_in [deg], , x_out [deg]' --local offset.bias
  tsmblocks fit tendon_sheath_asymmetric --data sheath.csv \
      --bounds tsm.theta=1:50 --constraint 'alpha2 + A - abs(delta) > 0'
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsmblocks.cli import common, console, parameters, recordings

if TYPE_CHECKING:
    from tsmblocks.fitting.result import Fit

HELP = "fit parameters to recordings, print them with their confidence intervals"
OPTION_NAMES = (
    (r"start=\{'([^']+)': …\}", r"--set \1=…"),
    (r"free=\['([^']+)'\]", r"--free '\1'"),
    (r"\b(segments)=(\d+)", r"--\1 \2"),
    (r"method='(\w+)'", r"--method \1"),
    *parameters.noise_names("sigma"),
)
"""Arguments of the function as messages name them, and the options of the command."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s DIAGRAM --data FILE [FILE ...] [options]"
    common.add(parser, "diagram")
    recordings.data_arguments(parser.add_argument_group("measured data"), several=True)
    _parameter_arguments(partial(common.add, parser.add_argument_group("parameters")))
    add = partial(common.add, parser.add_argument_group("search"))
    add("--outputs", "--window")
    noise = (
        "rms noise of the outputs that weights them, with its unit: 0.05deg, x_out=0.05deg (default: one output counts "
        "as it is, several by their spread)"
    )
    add("--sigma", metavar="VALUE", type=parameters.noise("sigma"), default=[], help=noise, **common.SEVERAL)
    method = "gauss-newton (default), ipopt or ga"
    add("--method", default="gauss-newton", help=method, suggests=common.FITS)
    segments = "pieces of multiple shooting, with --method ipopt (default 1)"
    add("--segments", metavar="N", type=common.integer_from(1), default=1, help=segments)
    add("--starts", default=4)
    add("--seed", "--step", "--hold")
    common.result_arguments(parser, "write the fitted diagram (with --local one per experiment) to a .toml file")


def _parameter_arguments(add: Callable[..., None]) -> None:
    several = partial(add, default=[], **common.SEVERAL)
    add("--free")
    parameters.local_and_bounds(add)
    add("--start-states", action="store_true", help="estimate the initial state too, in each experiment")
    add("--set", help="the value from which a parameter starts, or which it keeps")
    several("--constraint", metavar="TEXT", help="a condition, such as 'alpha2 + A - abs(delta) > 0'")
    function = "a parameter that is a function of others, such as 'alpha2=alpha1'"
    several("--tie", metavar="NAME=EXPRESSION", type=tie, help=function)
    several("--prior", metavar="NAME=MEAN:DEVIATION", type=prior, help="a parameter's prior, of a normal distribution")


def prior(text: str) -> tuple[str, tuple[float, float]]:
    """``NAME=MEAN:DEVIATION``."""
    form = "NAME=MEAN:DEVIATION, such as tsm.theta=5:0.5"
    name, value = common.name_and_value(text, form)
    mean, colon, deviation = value.partition(":")
    if not colon:
        raise argparse.ArgumentTypeError(f"'{text}' is not {form}")
    return name, (common.finite_float(mean), common.finite_float(deviation))


def tie(text: str) -> tuple[str, str]:
    """``NAME=EXPRESSION``."""
    return common.name_and_value(text, "NAME=EXPRESSION, such as alpha2=alpha1")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load
    from tsmblocks.fitting.fit import fit

    out, plot = common.result_path(args.out, (".toml",)), common.figure_path(args.plot)
    diagram = parameters.with_settings(load(args.diagram), args.settings)
    records = recordings.read_experiments(args, diagram)
    with (
        common.option_names(OPTION_NAMES),
        console.progress_line(console.search_progress("fitting", args.starts), quiet=args.json) as progress,
    ):
        result = fit(
            diagram,
            records,
            bounds=dict(args.bounds),
            constraints=args.constraint,
            ties=dict(args.tie),
            priors=dict(args.prior),
            sigma=args.sigma or None,
            progress=progress,
            **common.passed(args, "free", "local", "start_states", "outputs", "window", "method", "segments"),
            **common.passed(args, "starts", "seed", "step", "hold"),
        )
    result = recordings.with_option_notes(result, args)
    save = partial(_save, result, out, each=bool(args.local))
    return common.finish(result, {"data": recordings.as_json(records)}, save, plot, args)


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
