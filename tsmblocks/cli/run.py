"""Run a diagram and print its results.

With outputs x_ref and x_out, the peak-to-peak and rms tracking error are printed, over the second
half of the run (after the initial transient) and over all of it. Otherwise a table of outputs is printed.
Outputs that were measured too are compared: the residual, measurement less run, is printed, and the
measurement is plotted with the run.

  tsmblocks run fig16_feedforward_feedback --set pid.kp=2 --plot run.png
  tsmblocks run motor_linear --data drive.csv --map x=angle --out angle.csv
  tsmblocks run my_drive.toml --data run.csv --step 0.0005 --json
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from tsmblocks.cli import common, console, parameters, recordings
from tsmblocks.common.atomic_write import replace_figure
from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import RunError
from tsmblocks.common.rounding import significant
from tsmblocks.common.tables import columns

DEFAULT_STEP = 1e-3
"""Step [s] where neither the command nor the diagram's file gives one, as for ``simulate``."""
MOST_KEPT_NUMBERS = 10_000_000
"""Numbers of a run (80 MB) up to which all signals are kept. Chosen."""
OPTIONS = ("stop", "stop_when", "step", "method", "every", "backend", "loops", "locate", "check_step")
"""Options of the command that ``simulate`` takes by the same names."""
HELP = "run a diagram, print its tracking error or a table of outputs"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = partial(common.add, parser)
    add("diagram")
    add("--stop", type=common.finite_float, metavar="S", help="end of the run in s (default: end of the data, else 20)")
    add("--step", help="step in s (default: that of the diagram's file, else 0.001)")
    add("--stop-when", metavar="C", help="end the run where this becomes true, such as 'x > 1' (default: the file's)")
    add(
        "--locate", action="store_true", help="find the instants within a step at which relays, limits, friction switch"
    )
    known = "euler, heun, rk4, or for stiff diagrams sdirk2, sdirk3, sdirk4"
    add("--method", default="", help=f"{known} (default: that of the diagram's file, else rk4)")
    add("--set")
    recordings.data_arguments(parser)
    add("--hold")
    add("--out", metavar="FILE", help="write the outputs to a .csv, .npz or .mat file")
    add("--plot", "--json")
    every = "keep every N-th time step (default 1)"
    add("--every", type=common.integer_from(1), metavar="N", default=1, help=every)
    backend = "llvm or casadi (default: llvm where it is installed)"
    add("--backend", metavar="B", default="", help=backend, suggests=common.BACKENDS)
    add("--refuse-loops", "--no-step-check")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    from tsmblocks.files import load

    out, plot = common.result_path(args.out), common.figure_path(args.plot)
    diagram = parameters.with_settings(load(args.diagram), args.settings)
    recordings.take_hold(args, diagram)
    record, inputs = recordings.read_inputs(args, diagram, args.diagram)
    known, name = diagram.simulation, record.name if record is not None else ""
    diagram = recordings.with_units_of(diagram, record).with_parameters(known.start_of(name))
    args.step = (known.step_of(name) or DEFAULT_STEP) if args.step is None else args.step
    args.method = args.method or known.method or "rk4"
    run = _simulate(args, diagram, record, inputs, out)
    written = [str(run.save(out))] if out else []
    residuals = _residuals(diagram, run, record)
    if plot:
        written.append(str(_plot(run, plot, residuals)))
    summary = {**summarise(run, args.diagram, record, residuals), "every": args.every}
    summary |= {"switches": len(run.events)} if args.locate else {}
    text = "\n".join(filter(None, [summary_text(summary), common.wrote(written)]))
    common.print_result(args, {**summary, "written": written}, text)
    if not run.complete:
        console.print_error(
            f"stopped at t = {run.t[-1]:g} s; the result up to there is what you see"
            f"{' and what was written' if written else ''}."
        )
        return common.INTERRUPTED
    return 0


def _simulate(args: argparse.Namespace, diagram: Any, record: Any, inputs: dict[str, Any], out: Path | None) -> Any:
    """Run the diagram; a run that fails is written up to that time."""
    from tsmblocks.simulation.simulate import simulate

    start = float(record.t[0]) if record is not None else 0.0
    try:
        with console.progress_line(console.percent_progress("running"), quiet=args.json) as progress:
            return simulate(
                diagram,
                start=start,
                inputs=inputs,
                log=_kept(args, diagram, start, inputs),
                progress=progress,
                **common.passed(args, *OPTIONS),
            )
    except RunError as error:
        if out and error.run is not None and len(error.run.t):
            console.print_note(f"the run up to t = {error.run.t[-1]:g} s was written to {error.run.save(out)}.")
        raise


def _kept(args: argparse.Namespace, diagram: Any, start: float, inputs: dict[str, Any]) -> str:
    """Signals to keep: all, as from Python, since the look at the step sees more then; of a long run the outputs."""
    from tsmblocks.simulation.arguments import RunOptions
    from tsmblocks.simulation.compiled import equations

    times = RunOptions(start=start, inputs=inputs, **common.passed(args, "stop", "step", "every")).times
    few = times.kept * len(equations(diagram, loops=args.loops).y) <= MOST_KEPT_NUMBERS
    return "all" if few or not diagram.outputs else "outputs"


def _residuals(diagram: Any, run: Any, record: Any) -> Any:
    """Residuals of the measured outputs; None where none was measured."""
    names = [name for name in run.aliases if record is not None and name in record]
    if not names:
        return None
    from tsmblocks.fitting.score import of_run

    return of_run(diagram, run, record, names)


def _plot(run: Any, path: Path, residuals: Any) -> Path:
    from tsmblocks.plots import plot_run, plot_tracking

    if residuals is not None:
        figure = residuals.plot()
    else:
        figure = plot_tracking({"x_out": run}, title=run.title) if _tracks(run) else plot_run(run)
    replace_figure(path, figure, dpi=150)
    return path


def _tracks(run: Any) -> bool:
    return "x_ref" in run.aliases and "x_out" in run.aliases


# ---- text ---------------------------------------------------------------------------------------


def summarise(run: Any, diagram: str, record: Any = None, residuals: Any = None) -> dict[str, Any]:
    """All that the command reports of a run, as plain values."""
    from tsmblocks.common.displayed_units import displayed_in

    made: dict[str, Any] = {
        "diagram": diagram,
        "title": run.title,
        "start": float(run.t[0]),
        "stop": float(run.t[-1]),
        "step": run.step,
        "method": run.method,
        "instants": len(run.t),
        "complete": run.complete,
        "ended_by": run.ended_by,
        "outputs": {},
        "notes": list(record.notes) if record is not None else [],
    }
    for name in run.aliases or run.keys():
        y = run[name]
        extremes = {"min": float(y.min()), "max": float(y.max()), "last": float(y[-1])}
        recorded = [record.unit(name)] if record is not None and name in record else []
        made["outputs"][name] = {"unit": displayed_in(run.unit(name), recorded), **extremes}
    if residuals is not None:
        made["measured"] = [{**d.to_dict(), "peak_to_peak": d.peak_to_peak} for d in residuals]
    if _tracks(run):
        from tsmblocks.metrics.tracking import tracking_error

        parts = {"second_half": float(run.t[0] + run.t[-1]) / 2, "whole_run": None}
        made["tracking_error"] = {part: _error(tracking_error(run, after=begin)) for part, begin in parts.items()}
    return made


def _error(error: Any) -> dict[str, Any]:
    return {"from": error.after, **{k: getattr(error, k) for k in ("unit", "peak_to_peak", "rms", "largest")}}


def summary_text(summary: dict[str, Any]) -> str:
    """The summary as text, outputs in the units of the recording, angles in degrees."""
    title = summary["title"] or summary["diagram"]
    span = f"{summary['start']:g} to {summary['stop']:g} s in steps of {summary['step']:g} s"
    kept = f", every {summary['every']}th kept" if summary["every"] > 1 else ""
    ended = f"\nended where {summary['ended_by']}" if summary["ended_by"] else ""
    first = f"{title}\n{span} ({summary['method']}){kept}{ended}"
    last = f"\n\n{_measured_table(summary)}" if "measured" in summary else ""
    if "tracking_error" in summary:
        return f"{first}\n\n{_tracking_table(summary['tracking_error'])}{last}"
    rows: list[tuple[str, ...]] = [("output", "unit", "min", "max", "last")]
    for name, y in summary["outputs"].items():
        factor, unit = display_unit(y["unit"])
        rows.append((name, unit, *(f"{factor * y[k]:.4g}" for k in ("min", "max", "last"))))
    return f"{first}\n\n{columns(rows, left=frozenset({0, 1}))}{last}"


def _measured_table(summary: dict[str, Any]) -> str:
    """Table of the residuals."""
    rows: list[tuple[str, ...]] = [("measured less run", "peak to peak", "rms", "largest", "samples")]
    rows += [(d["output"], *_sizes(d), str(d["samples"])) for d in summary["measured"]]
    return columns(rows)


def _tracking_table(halves: dict[str, Any]) -> str:
    rows: list[tuple[str, ...]] = [("tracking error x_ref - x_out", "peak to peak", "rms", "largest")]
    titles = {"second_half": f"second half, from {halves['second_half']['from']:g} s", "whole_run": "whole run"}
    rows += [(title, *_sizes(halves[part])) for part, title in titles.items()]
    return columns(rows)


def _sizes(error: dict[str, Any]) -> list[str]:
    """Sizes of an error with their unit, angles in degrees."""
    factor, unit = display_unit(error["unit"])
    sizes = [factor * error[k] for k in ("peak_to_peak", "rms", "largest")]
    return [f"{significant(size)} {unit}".strip() for size in sizes]
