"""The paper's tracking experiments: without compensation, with feedforward, with feedforward and feedback.

Runs three diagrams on the paper's three signals (and on a measured reference, with --data), prints the
peak-to-peak tracking error beside what the paper measured, and writes plots, drawings and a table.
"""

from __future__ import annotations

import argparse
import csv
import math
import textwrap
from pathlib import Path
from typing import Any

import attrs

from tsmblocks import units
from tsmblocks.cli import common, recordings
from tsmblocks.tables import columns

HELP = "run the paper's diagrams on its signals; plots and a table in a folder"
DIAGRAMS = {
    "fig09a_without_feedforward": "without compensation",
    "fig09b_feedforward": "feedforward",
    "fig16_feedforward_feedback": "feedforward + PID",
}
STEP = 1e-3
STOP = 40.0
"""Seconds simulated: 8 periods of the slowest sine, the second half of them past the start."""
WHY = (
    "Even with a perfect model and an ideal motor (11) leaves 13 deg: by (14) it takes the state and "
    "the slope at the reference, but those of the plant follow the motor, which around a reversal moves much "
    "further than the reference, so that the plant's hysteresis switches sooner than the observer's."
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = parser.add_argument
    add("--out", metavar="DIR", default="tsmblocks-demo", help="folder for the results (tsmblocks-demo)")
    recordings.data_arguments(parser)
    add("--column", metavar="NAME", help="column of --data with a measured reference; with its unit, if the "
        "file has none: 'x_ref [deg]'")  # fmt: skip


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    cases = [*_paper_cases(), *_measured_case(args)]
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    tell = common.progress("running")
    try:
        finished = _simulate(cases, tell)
    finally:
        common.clear_progress(tell)
    print(_table(cases))
    print("\n" + textwrap.fill(WHY, 100))
    _write(cases, folder)
    print(f"\nPlots, drawings and results.csv are in {folder}")
    if not finished:
        common.complain("stopped early; the table and the files hold what was done until then.")
        return common.INTERRUPTED
    return 0


@attrs.define
class Case:
    """One reference signal: the source that makes it, the runs on it, and what the paper measured [deg]."""

    key: str
    words: str
    source: Any
    stop: float = STOP
    paper: tuple[float | None, ...] = (None, None, None)
    runs: dict[str, Any] = attrs.field(factory=dict)

    @property
    def settled(self) -> float:
        """From when on the start is over and the error counts [s]."""
        return self.stop / 2

    def error(self, diagram: str) -> Any:
        """Tracking error of one diagram in deg, None when it was not run."""
        from tsmblocks.measures import tracking_error

        run = self.runs.get(diagram)
        return tracking_error(run, after=self.settled).to("deg") if run is not None else None


def _paper_cases() -> list[Case]:
    from tsmblocks.blocks import MultiSine, Sine

    def pair(f1: float, f2: float) -> Any:
        tone = math.radians(28.0)
        return MultiSine(amplitudes=(tone, tone), frequencies=(f1, f2), phases=(0.0, 0.0), unit="rad")

    one = Sine(amplitude=math.radians(55.0), frequency=0.2, unit="rad")
    return [
        Case("sine", "55 deg at 0.2 Hz", one, paper=(27.0, 8.0, 5.8)),
        Case("two_sines", "28 deg at 0.2 Hz + 28 deg at 0.5 Hz", pair(0.2, 0.5), paper=(27.0, 8.5, None)),
        Case("no_period", "28 deg at 0.25 Hz + 28 deg at 0.25√3 Hz", pair(0.25, 0.25 * math.sqrt(3)),
             paper=(28.0, 9.2, None)),
    ]  # fmt: skip


def _measured_case(args: argparse.Namespace) -> list[Case]:
    """Return the reference that --data and --column name, as a recorded signal that begins at t = 0."""
    if not args.data and not args.column:
        return []
    if not args.data or not args.column:
        raise common.UsageError("a measured reference needs both --data FILE and --column NAME.")
    from tsmblocks.blocks import Recorded
    from tsmblocks.data import split_heading

    name, unit = split_heading(args.column)
    record = recordings.read_record(args, only=[name])
    unit = record.unit(name) or unit
    if not unit:
        raise common.UsageError(f"{record.origin}: '{name}' has no unit, and the models work in rad. "
                                f"Say what it is: --column '{name} [deg]'.")  # fmt: skip
    values = record.values(name, "rad") if record.unit(name) else record[name] * units.factor(unit, "rad")
    t = record.t - record.t[0]
    stop = math.floor(float(t[-1]) / STEP) * STEP
    source = Recorded(times=tuple(t), values=tuple(values), hold="cubic", unit="rad")
    return [Case("measured", f"{name} of {Path(args.data).name}, {stop:.4g} s", source, stop=stop)]


def _simulate(cases: list[Case], tell: Any) -> bool:
    """Run every diagram on every signal; False when Ctrl-C came in between."""
    from tsmblocks.files import load
    from tsmblocks.simulate import simulate

    plans = [(case, name) for case in cases for name in DIAGRAMS]
    diagrams = {name: load(name) for name in DIAGRAMS}
    for k, (case, name) in enumerate(plans):
        if tell:
            tell(k / len(plans))
        run = simulate(diagrams[name].replace("ref", case.source), stop=case.stop, step=STEP, log="outputs")
        if not run.complete:
            return False
        case.runs[name] = run
    return True


# ---- what is written ----------------------------------------------------------------------------


def _write(cases: list[Case], folder: Path) -> None:
    """Write plots of each signal, drawings of each diagram, and the table."""
    from tsmblocks.cli import draw
    from tsmblocks.files import load
    from tsmblocks.plots import plot_loop, plot_tracking

    with (folder / "results.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(_rows(cases))
    for case in cases:
        if not case.runs:
            continue
        labelled = {DIAGRAMS[name]: run for name, run in case.runs.items()}
        plot_tracking(labelled, title=case.words, after=case.settled).savefig(
            folder / f"tracking_{case.key}.png", dpi=150
        )
        panel: Any = None
        for label, run in labelled.items():
            late = run.t >= case.settled
            figure = plot_loop(run["x_in"][late], run["x_out"][late], panel, label=label)
            panel = figure.axes[0]
        panel.set_title(case.words, loc="left", fontsize=11)
        figure.savefig(folder / f"loop_{case.key}.png", dpi=150)
    for name in DIAGRAMS:
        diagram = load(name)
        for ending in (".svg", ".png"):
            draw.write(diagram, folder / f"{name}{ending}")


def _rows(cases: list[Case]) -> list[list[str]]:
    """Return the table as a file holds it: one row for each signal and diagram."""
    rows = [["signal", "diagram", "peak to peak [deg]", "rms [deg]", "largest [deg]", "paper, peak to peak [deg]"]]
    for case in cases:
        for name, paper in zip(DIAGRAMS, case.paper, strict=True):
            error = case.error(name)
            if error is not None:
                numbers = (error.peak_to_peak, error.rms, error.largest)
                rows.append([case.words, name, *(f"{x:.6g}" for x in numbers), "" if paper is None else f"{paper:g}"])
    return rows


def _table(cases: list[Case]) -> str:
    """Return the table as the terminal shows it."""
    rows = [("", *DIAGRAMS.values(), "the paper measured")]
    for case in cases:
        errors = [case.error(name) for name in DIAGRAMS]
        shown = ["-" if e is None else f"{e.peak_to_peak:.1f}" for e in errors]
        paper = " / ".join("-" if p is None else f"{p:g}" for p in case.paper)
        rows.append((case.words, *shown, paper if any(case.paper) else "-"))
    title = ("Peak-to-peak tracking error in deg, over the second half of each run\n"
             "(the paper's models and gains; with PID, its second set of numbers)")  # fmt: skip
    return f"{title}\n\n{columns(rows)}"
