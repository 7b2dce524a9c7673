"""Run a demonstration in under a minute: a hidden effect is found, and the paper's experiments are repeated.

A tendon sheath with an effect that its model lacks is measured, with noise; the
model is identified, the unmodelled effect is diagnosed and compared with what
was hidden, the compensators are rebuilt, and the tracking error of the mechanism
is reported before and after. Then the source paper's three diagrams are run on
its three signals (and on a measured reference, with --data). The folder has all
of it; begin with index.html.

  tsmblocks demo --out story
  tsmblocks demo --hide none       # nothing is hidden: is anything reported?
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tsmblocks.cli import common, console, recordings
from tsmblocks.common.atomic_write import replace_figure, replace_file

if TYPE_CHECKING:
    from tsmblocks.demo.paper import Case
    from tsmblocks.demo.story import Story

HELP = "hide an effect, find it, and repeat the paper's experiments; one page with pictures"
NAMES = ("position_ripple", "backlash", "odd_nonlinearity", "none")
"""Effects that can be hidden, the default first."""
PAGE = "index.html"
"""The page of the demonstration, in its folder."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = partial(common.add, parser)
    add("--out", metavar="DIR", default="tsmblocks-demo", help="folder for the results (default: tsmblocks-demo)")
    hide = f"the hidden effect: {', '.join(NAMES)} (default: {NAMES[0]})"
    add("--hide", metavar="EFFECT", default=NAMES[0], help=hide, suggests=NAMES)
    add("--seed", "--json")
    recordings.data_arguments(parser, condition=False)
    column = "column of --data with a measured reference; with its unit, if the file has none: 'x_ref [deg]'"
    add("--column", metavar="NAME", help=column)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.demo import paper, text
    from tsmblocks.demo.page import page
    from tsmblocks.demo.story import build_story

    hidden = common.known_name(args.hide, NAMES, "effect to hide")
    cases = _cases(args)
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    say: Callable[[str], None] = (lambda _: None) if args.json else console.print_text
    with console.progress_line(console.stage_progress(), quiet=args.json) as progress:
        story = build_story(hidden, args.seed, progress)
    say(text.story_text(story))
    files = _write_story(story, folder)
    with console.progress_line(console.percent_progress("running"), quiet=args.json) as running:
        whole = paper.run(cases, running)
    say(f"\n{text.paper_text(cases)}")
    files |= _write_paper(cases, folder)
    if not whole:
        console.print_error("stopped early; the table and the files have what was done until then.")
        return common.INTERRUPTED
    replace_file(folder / PAGE, page(cases, story, files))
    say(f"\nAll of it with pictures: {folder / PAGE}")
    if args.json:
        console.print_json(_facts(cases, story, folder))
    return 0


def _cases(args: argparse.Namespace) -> list[Case]:
    """The paper's signals, and the reference that --data and --column name."""
    from tsmblocks.demo import paper

    if not args.data and not args.column:
        return paper.cases()
    if not args.data or not args.column:
        raise common.UsageError("a measured reference needs both --data FILE and --column NAME.")
    from tsmblocks.data import split_heading

    name, unit = split_heading(args.column)
    record = recordings.read_record(args, only=[name])
    if not (record.unit(name) or unit):
        raise common.UsageError(
            f"{record.origin}: '{name}' has no unit, and the models work in rad. "
            f"Say what it is: --column '{name} [deg]'."
        )
    return [*paper.cases(), paper.measured_case(record, name, unit)]


def _facts(cases: Sequence[Case], story: Story, folder: Path) -> dict:
    from tsmblocks.demo import paper

    head, *rows = paper.rows(cases)
    return {
        "paper": [dict(zip(head, row, strict=True)) for row in rows],
        "hidden": story.name,
        "verdict": story.diagnosis.verdict,
        "effects": [e.name for e in story.diagnosis.effects],
        "tracking": [
            {"compensator": one.words, "model": one.model, "peak_to_peak": e.peak_to_peak, "rms": e.rms, "unit": e.unit}
            for one, e in ((one, one.error) for one in story.tracked)
        ],
        "page": str(folder / PAGE),
    }


# ---- files --------------------------------------------------------------------------------------


Files = dict[str, list[str]]
"""Files that were written into the folder, by what they are."""


def _write_paper(cases: list[Case], folder: Path) -> Files:
    """Write the table, drawings of each diagram, and, where matplotlib is installed, plots of each signal."""
    from tsmblocks.cli import draw
    from tsmblocks.demo import paper
    from tsmblocks.files import load

    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(paper.rows(cases))
    replace_file(folder / "results.csv", table.getvalue())
    drawn = [f"{name}{ending}" for name in paper.DIAGRAMS for ending in (".svg", ".png")]
    for name in drawn:
        draw.write(load(Path(name).stem), folder / name)
    plots = _plot_paper(cases, folder) if find_spec("matplotlib") else []
    files = {"Tracking errors of the paper's diagrams": ["results.csv"], "Diagrams": drawn, "Plots": plots}
    return {words: names for words, names in files.items() if names}


def _plot_paper(cases: list[Case], folder: Path) -> list[str]:
    """Plot the tracking error and the loop of each signal; the names of the files."""
    from tsmblocks.demo import paper
    from tsmblocks.plots import plot_loop, plot_tracking
    from tsmblocks.plots.panels import entitle

    run = [one for one in cases if one.runs]
    for case in run:
        labelled = {paper.DIAGRAMS[name]: run for name, run in case.runs.items()}
        figure = plot_tracking(labelled, title=case.words, after=case.settled)
        replace_figure(folder / f"tracking_{case.key}.png", figure, dpi=150)
        panel = None
        for label, made in labelled.items():
            late = made.t >= case.settled
            figure = plot_loop(made["x_in"][late], made["x_out"][late], panel, label=label)
            panel = figure.axes[0]
        entitle(figure, case.words)
        replace_figure(folder / f"loop_{case.key}.png", figure, dpi=150)
    return [f"{kind}_{case.key}.png" for case in run for kind in ("tracking", "loop")]


def _write_story(story: Story, folder: Path) -> Files:
    """Write the recordings, the models, and the report of the diagnosis, with a way back to the page."""
    from tsmblocks.demo.mechanism import model
    from tsmblocks.files import save
    from tsmblocks.html.report_files import written

    (folder / "recordings").mkdir(exist_ok=True)
    for name, record in story.records.items():
        lines = [",".join(["t [s]", *(f"{k} [{record.unit(k)}]" for k in record.names)])]
        lines += [",".join(f"{v:.6g}" for v in row) for row in zip(record.t, *record.signals.values(), strict=True)]
        replace_file(folder / "recordings" / f"{name}.csv", "\n".join(lines) + "\n")
    save(model(), folder / "model.toml")
    save(story.fit.diagram, folder / "identified.toml")
    written(story.diagnosis, folder / "found", back=(f"../{PAGE}", "Demonstration"))
    return {
        "Recordings": [f"recordings/{name}.csv" for name in story.records],
        "Models: as given, as identified, with what was found": [
            "model.toml",
            "identified.toml",
            "found/augmented.toml",
        ],
        "Diagnosis": ["found/report.html", "found/diagnosis.json"],
    }
