"""Run a demonstration in under a minute: the paper's experiments, then a mechanism with a hidden effect.

The paper's three diagrams are run on its three signals (and on a measured
reference, with --data). Then a tendon sheath with an effect that its model lacks
is measured, with noise; the model is identified, the unmodelled effect is
diagnosed and added, the compensators are rebuilt on it, and the tracking error
of the mechanism is reported before and after. The folder has all of it; begin
with index.html.

  tsmblocks demo --out story
  tsmblocks demo --hide none       # nothing is hidden: is anything reported?
"""

from __future__ import annotations

import argparse
import csv
import io
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tsmblocks.cli import common, console, recordings
from tsmblocks.common.atomic_write import replace_figure, replace_file
from tsmblocks.common.tables import columns, line_width

if TYPE_CHECKING:
    from tsmblocks.demo.compensators import Tracked
    from tsmblocks.demo.paper import Case
    from tsmblocks.demo.story import Story

HELP = "the paper's experiments, and a hidden effect diagnosed; one page with pictures"
NAMES = ("position_ripple", "backlash", "odd_nonlinearity", "none")
"""Effects that can be hidden, the default first."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = partial(common.add, parser)
    add("--out", metavar="DIR", default="tsmblocks-demo", help="folder for the results (tsmblocks-demo)")
    hide = f"the hidden effect: {', '.join(NAMES)} ({NAMES[0]})"
    add("--hide", metavar="EFFECT", default=NAMES[0], help=hide, suggests=NAMES)
    add("--seed", "--json")
    recordings.data_arguments(parser, condition=False)
    column = "column of --data with a measured reference; with its unit, if the file has none: 'x_ref [deg]'"
    add("--column", metavar="NAME", help=column)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.demo import paper
    from tsmblocks.demo.story import build_story

    hidden = common.known_name(args.hide, NAMES, "effect to hide")
    cases = _cases(args)
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    say: Callable[[str], None] = (lambda _: None) if args.json else console.print_text
    with console.progress_line(console.percent_progress("running"), quiet=args.json) as running:
        whole = paper.run(cases, running)
    say(_paper_text(cases))
    _write_paper(cases, folder)
    if not whole:
        console.print_error("stopped early; the table and the files have what was done until then.")
        return common.INTERRUPTED
    with console.progress_line(console.stage_progress(), quiet=args.json) as progress:
        story = build_story(hidden, args.seed, progress)
    for chapter in (_measurement_text, _fit_text, _diagnosis_text, _tracking_text, _hidden_text):
        say(f"\n{chapter(story)}")
    _write_story(cases, story, folder)
    say(f"\nAll of it with pictures: {folder / 'index.html'}")
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


# ---- text ---------------------------------------------------------------------------------------


def _paper_text(cases: Sequence[Case]) -> str:
    from tsmblocks.demo import paper

    head = ("", "none", "(11)", "(11) + PID", "paper measured")
    table = columns([head, *paper.compared(cases)])
    title = _wrapped(
        "1. The paper's diagrams: peak-to-peak tracking error in deg, over the second half of each run, "
        "without compensation, with feedforward, with feedback as well"
    )
    return f"{title}\n\n{table}\n\n{_wrapped(paper.WHY)}"


def _measurement_text(story: Story) -> str:
    from tsmblocks.demo.mechanism import DEG
    from tsmblocks.demo.story import FLOOR

    return _wrapped(
        f"2. A mechanism is measured: {', '.join(story.records)}, with an encoder at the motor and a "
        f"sensor of {FLOOR / DEG:.3f} deg rms at the tip. It may have an effect that its model lacks."
    )


def _fit_text(story: Story) -> str:
    from tsmblocks.demo.mechanism import DEG
    from tsmblocks.demo.story import FLOOR
    from tsmblocks.fitting.text import numbers

    residual = story.fit.differences.rms
    end = _wrapped(f"The residual is {residual / DEG:.3f} deg rms, {residual / FLOOR:.1f} times the sensor's noise.")
    return f"3. The paper's model is identified from all experiments at once\n\n{numbers(story.fit)}\n\n{end}"


def _diagnosis_text(story: Story) -> str:
    from tsmblocks.diagnosis.verdict_text import verdict_sentence

    segment = story.diagnosis.worst
    text = _wrapped(f"{segment.verdict.upper()}. {verdict_sentence(segment)}")
    return f"4. The unmodelled effect is diagnosed\n\n{text}"


def _tracking_text(story: Story) -> str:
    from tsmblocks.demo.story import IDENTIFIED

    names, first = story.models, story.tracked[0]
    rows: list[tuple[str, ...]] = [("model:", *names), (first.words, *([_error(first)] * len(names)))]
    rows += [(words, *(_error(story.on(name).get(words)) for name in names)) for words in story.on(IDENTIFIED)]
    which = "both models" if len(names) > 1 else "the model"
    title = _wrapped(
        f"5. The compensators are rebuilt on {which}, and the mechanism tracks 55 deg at 0.2 Hz: "
        "peak-to-peak error in deg, rms in brackets"
    )
    return f"{title}\n\n{columns(rows)}"


def _error(one: Tracked | None) -> str:
    return "-" if one is None else f"{one.error.peak_to_peak:.2f} ({one.error.rms:.3f})"


def _hidden_text(story: Story) -> str:
    rows: list[tuple[str, ...]] = [("", "in truth", *story.models)]
    rows += [(name, *(f"{v:.3g}" for v in values)) for name, *values in story.revealed]
    return f"{_wrapped(f'6. The hidden effect: {story.hidden.words}')}\n\n{columns(rows)}"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, line_width(), break_on_hyphens=False)


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
        "page": str(folder / "index.html"),
    }


# ---- files --------------------------------------------------------------------------------------


def _write_paper(cases: list[Case], folder: Path) -> None:
    """Write the table, drawings of each diagram, and, where matplotlib is installed, plots of each signal."""
    from tsmblocks.cli import draw
    from tsmblocks.demo import paper
    from tsmblocks.files import load

    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(paper.rows(cases))
    replace_file(folder / "results.csv", table.getvalue())
    for name in paper.DIAGRAMS:
        for ending in (".svg", ".png"):
            draw.write(load(name), folder / f"{name}{ending}")
    if find_spec("matplotlib"):
        _plot_paper(cases, folder)


def _plot_paper(cases: list[Case], folder: Path) -> None:
    from tsmblocks.demo import paper
    from tsmblocks.plots import plot_loop, plot_tracking
    from tsmblocks.plots.panels import entitle

    for case in (one for one in cases if one.runs):
        labelled = {paper.DIAGRAMS[name]: run for name, run in case.runs.items()}
        figure = plot_tracking(labelled, title=case.words, after=case.settled)
        replace_figure(folder / f"tracking_{case.key}.png", figure, dpi=150)
        panel = None
        for label, run in labelled.items():
            late = run.t >= case.settled
            figure = plot_loop(run["x_in"][late], run["x_out"][late], panel, label=label)
            panel = figure.axes[0]
        entitle(figure, case.words)
        replace_figure(folder / f"loop_{case.key}.png", figure, dpi=150)


def _write_story(cases: Sequence[Case], story: Story, folder: Path) -> None:
    """Write the page, the recordings, the models, and the report of the diagnosis."""
    from tsmblocks.demo.mechanism import model
    from tsmblocks.demo.page import page
    from tsmblocks.files import save

    (folder / "recordings").mkdir(exist_ok=True)
    for name, record in story.records.items():
        lines = [",".join(["t [s]", *(f"{k} [{record.unit(k)}]" for k in record.names)])]
        lines += [",".join(f"{v:.6g}" for v in row) for row in zip(record.t, *record.signals.values(), strict=True)]
        replace_file(folder / "recordings" / f"{name}.csv", "\n".join(lines) + "\n")
    save(model(), folder / "model.toml")
    save(story.fit.diagram, folder / "identified.toml")
    story.diagnosis.save(folder / "found")
    replace_file(folder / "index.html", page(cases, story))
