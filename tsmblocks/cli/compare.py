"""Fit several models to the same recordings and rank them on held-out data.

Without DIAGRAM every ready-made tendon-sheath model is fitted; the short names
of the table (play, asymmetric) may be used too. Each FILE is one experiment.
A model has one set of parameters for all files; with --each it is fitted to every
file separately, and a table of models and files is printed.

  tsmblocks compare --data sheath.csv --out best.toml --plot models.png
  tsmblocks compare play my_model.toml --data bend*.csv --each
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsmblocks.cli import common, console, recordings
from tsmblocks.common.atomic_write import replace_figure
from tsmblocks.common.errors import near
from tsmblocks.common.tables import line_width

if TYPE_CHECKING:
    from tsmblocks.fitting.comparison import Comparison
    from tsmblocks.model.diagram import Diagram

HELP = "fit several models to the same recordings and rank them on held-out data"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s [DIAGRAM ...] --data FILE [FILE ...] [options]"
    models = "diagram files, or names of ready-made ones, short as in the table or in full"
    parser.add_argument("models", metavar="DIAGRAM", nargs="*", help=models)
    recordings.data_arguments(parser.add_argument_group("measured data"), several=True)
    add = partial(common.add, parser.add_argument_group("fits"))
    train = (
        "share of each recording that is fitted, from its start (default 0.5, or 1 with --held-out), or its times "
        "START:STOP in s"
    )
    add("--train", metavar="PART", type=common.share_or_time_range, help=train)
    add("--held-out", metavar="EXPERIMENT", default=[], help="experiments that are not fitted at all", **common.SEVERAL)
    add("--free", metavar="PATTERN", help="free parameters of the models (default: as for fit)", **common.SEVERAL)
    add("--each", action="store_true", help="fit every file separately")
    add("--starts", default=8)
    add("--seed", "--step", "--hold")
    common.result_arguments(parser, "write the best model, fitted (with --each one per file), to a .toml file")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load
    from tsmblocks.fitting.above_noise import FAR
    from tsmblocks.fitting.compare import in_full, ready_made
    from tsmblocks.fitting.text import by_file, for_diagnosis

    if args.each and args.held_out:
        raise common.UsageError("--each fits every file, so none can be held out; leave out --held-out.")
    out, plot = common.result_path(args.out, (".toml",)), common.figure_path(args.plot)
    given = [in_full(name) for name in args.models]
    models = {_label(name, given): load(name) for name in given or ready_made()}
    records = recordings.read_experiments(args, *models.values())
    groups = {name: {name: record} for name, record in records.items()} if args.each else {"": records}
    results = _compare(args, models, groups)
    if not args.json:
        console.print_text(f"{_heading(args)}\n\n{by_file(results) if args.each else results['']}")
        if not args.each and results[""].above_noise >= FAR:
            best, chosen = results[""].best.name, for_diagnosis(results[""])
            if chosen != best:
                why = f"The data do not determine all of {best}; {chosen} is the simplest model that they determine."
                console.print_text(f"\n{textwrap.fill(why, line_width())}")
            source = next(name for name in given or ready_made() if _label(name, given) == chosen)
            print(f"\n  {recordings.command_line('diagnose', source, args)}")
    written = _save(results, out)
    if plot:
        from tsmblocks.plots import plot_comparison, plot_each

        figure = plot_each(results) if args.each else plot_comparison(results[""])
        replace_figure(plot, figure, dpi=150)
        written.append(str(plot))
    facts = {"format": 1, "each": {name: one.to_dict() for name, one in results.items()}} if args.each else None
    common.report_results({**(facts or results[""].to_dict()), "data": recordings.as_json(records)}, written, args)
    missing = [name for name in models if any(name not in [row.name for row in one] for one in results.values())]
    missing += [name for name in groups if name not in results]
    return common.exit_status(any(one.interrupted for one in results.values()), written, missing)


def _label(name: str, given: Sequence[str]) -> str:
    """The name of a model: that of its file, or the whole path where two files share it."""
    from tsmblocks.fitting.compare import SHIPPED

    stem = Path(name).stem
    return name if sum(Path(other).stem == stem for other in given) > 1 else stem.removeprefix(SHIPPED)


def _compare(args: argparse.Namespace, models: Any, groups: Mapping[str, Any]) -> dict[str, Comparison]:
    """One comparison for each group of recordings, until Ctrl-C."""
    from tsmblocks.fitting.compare import compare

    results: dict[str, Comparison] = {}
    free = _free(args.free, models) if args.free else None
    with console.progress_line(_progress(list(models), len(groups)), quiet=args.json) as progress:
        for name, records in groups.items():
            given = common.passed(args, "train", "held_out", "starts", "seed", "step", "hold")
            made = compare(models, records, progress=progress, free=free, **given)
            results[name] = recordings.with_option_notes(made, args)
            if results[name].interrupted:
                break
    return results


def _free(patterns: Sequence[str], models: Mapping[str, Diagram]) -> dict[str, list[str]]:
    """Of the patterns those that name something, by model. Raises UsageError for one that names nothing in any."""
    from tsmblocks.fitting.parameters import named_by

    found = {name: [p for p in patterns if named_by(p, one.parameters)] for name, one in models.items()}
    for pattern in patterns:
        if not any(pattern in those for those in found.values()):
            known = [k for one in models.values() for k in one.parameters]
            raise common.UsageError(f"--free: no model has a parameter '{pattern}'.{near(pattern, known)}")
    return found


def _progress(models: Sequence[str], groups: int) -> Callable[[str, int, float], str]:
    """The text of progress: which of all fits it is, and the time that those after it take."""
    left, count, reached = console.TimeLeft(), console.StartCount(), [0, 0]
    of = len(models) * groups

    def text(model: str, runs: int, rms: float) -> str:
        place = models.index(model)
        reached[0] += place < reached[1]  # the next group begins
        reached[1] = place
        done = reached[0] * len(models) + place
        start = count(f"{model} {done}", runs)
        return f"fitting {model}, {done + 1} of {of}, start {start}: {runs} runs, rms {rms:.4g}{left(done / of)}"

    return text


def _heading(args: argparse.Namespace) -> str:
    """One sentence on the fitted data and the held-out data."""
    from tsmblocks.fitting.compare import default_train

    train = default_train(args.held_out) if args.train is None else args.train
    if isinstance(train, tuple):
        low, high = ("" if value is None else f"{value:g}" for value in train)
        where = f"{low}:{high} s of each recording"
    else:
        where = "all samples" if train == 1 else f"the first {100 * train:g} % of each recording"
    ranked = "" if train == 1 else ", ranked on the rest"
    apart = f"; not fitted at all: {', '.join(args.held_out)}" if args.held_out else ""
    return textwrap.fill(f"fitted to {where}{ranked}{apart}", line_width())


def _save(results: Mapping[str, Comparison], out: Path | None) -> list[str]:
    """Write the model that is best overall, with the parameters of each group; the paths."""
    from tsmblocks.fitting.comparison import overall

    best, written = overall(results)[0][0], list[str]()
    if out is None:
        return written
    paths = common.paths_by_name(out, results) if len(results) > 1 or "" not in results else {"": out}
    for name, one in results.items():
        fitted = next((row.fit for row in one if row.name == best), None)
        if fitted is not None:
            written.append(str(fitted.save(paths[name])))
    return written
