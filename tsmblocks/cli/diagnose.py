r"""Diagnose a model: name unmodelled effects, add them to the diagram, report how the residual shrinks.

Each FILE is one experiment; its columns are matched by name to the diagram's
inputs and outputs. Several with different amplitudes and frequencies are more
informative than one. With --out the report (report.html, one page that needs no
network), the numbers (diagnosis.json) and the diagram with the effects added
(augmented.toml) are written into a folder; without it only the text is printed.
Ctrl-C, SIGTERM and --time-limit end the search with the effects identified so far.
Terms of the result: the glossary of the reference (tsmblocks reference).

  tsmblocks diagnose tendon_sheath_symmetric --data bend*.csv --out found
  tsmblocks diagnose tendon_sheath_symmetric --data a.csv b.csv \
      --noise-floor 0.05deg --effects backlash 'dead_*'
  tsmblocks diagnose my_drive.toml --data run.csv --noise-floor v=5mV x=0.01deg
  tsmblocks diagnose my_drive.toml --data run.csv --time-limit 60 \
      --set lag.time_constant=0.02 --bounds motor.K=0.1:10 --local offset.bias
"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsmblocks.cli import common, console, parameters, recordings
from tsmblocks.common.errors import TsmError

if TYPE_CHECKING:
    from tsmblocks.diagnosis.result import Diagnosis

HELP = "name unmodelled effects of a diagram, add them, and report how the residual shrinks"
OPTION_NAMES = (
    *parameters.noise_names("noise_floor"),
    (r"start=\{'([^']+)': …\}", r"another number of \1 in the diagram"),
    (r"\bfree=\['([^']+)'\]", r"--free '\1'"),
    (r"^(free|effects|local|bounds)\b", r"--\1"),
    (r"\btime_limit\b", "--time-limit"),
)
"""Arguments of the function as messages name them, and the options of the command."""
SCREENING = "tried"
STAGES = {
    "conditioned": "preparing the recordings",
    "calibrated": "fitting the model as it is",
    SCREENING: "screening candidate",
    "fitted": "fitting candidate",
}
"""Stages of a diagnosis in words; the last two come back in every round."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.usage = "%(prog)s DIAGRAM --data FILE [FILE ...] [options]"
    common.add(parser, "diagram")
    recordings.data_arguments(parser.add_argument_group("measured data"), several=True, condition=False)
    add = partial(common.add, parser.add_argument_group("search"))
    noise = (
        "rms noise of the outputs, with its unit: 0.05deg, x_out=0.05deg (a number without a unit is accepted only "
        "where recordings, diagram and all outputs share one; default: estimated from the data)"
    )
    add(
        "--noise-floor", metavar="VALUE", type=parameters.noise("noise_floor"), default=[], help=noise, **common.SEVERAL
    )
    add("--free")
    parameters.local_and_bounds(add)
    add("--set", help="initial value of a parameter that is fitted, or value of one that is not")
    effects = "effects that are tried, as backlash 'dead_*', or '[!r]*' for all without an r in front (default: all)"
    add("--effects", metavar="PATTERN", help=effects, **common.SEVERAL)
    add("--outputs", "--window")
    unfiltered = "leave measured inputs as they are (default: their noise is filtered out, with zero phase)"
    add("--no-condition", dest="condition", action="store_false", help=unfiltered)
    add("--seed", "--step", "--hold")
    limit = "end the search after so many seconds, with the effects identified by then (default: no limit)"
    add("--time-limit", metavar="SECONDS", type=common.finite_float, help=limit)
    results = common.result_arguments(
        parser, "write report.html, diagnosis.json and augmented.toml into a folder", "DIR"
    )
    details = "print noise floors, candidates, parameters, detection limits and a script as well"
    common.add(results, "--details", action="store_true", help=details)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    with _folder(args.out) as folder:
        return _diagnosed(args, folder, common.figure_path(args.plot))


def _diagnosed(args: argparse.Namespace, folder: Path | None, plot: Path | None) -> int:
    """Run the command with a folder to write into; the exit status."""
    from tsmblocks.diagnosis.diagnose import diagnose
    from tsmblocks.files import load

    diagram = parameters.with_settings(load(args.diagram), args.settings)
    records = recordings.read_experiments(args, diagram, report=False)  # they are among the notes of the diagnosis
    names = ("free", "noise_floor", "effects", "outputs", "window", "condition", "seed", "step", "hold", "local")
    line = console.progress_line(_Progress(args.time_limit), quiet=args.json)
    try:
        with common.option_names(OPTION_NAMES), line as progress:
            given = dict(bounds=dict(args.bounds), time_limit=args.time_limit, progress=progress)
            result = diagnose(diagram, records, **given, **common.passed(args, *names))
    except TsmError as error:
        recordings.print_repairs(args, *records.values(), fault=str(error))
        raise
    facts = {"data": recordings.as_json(records)}
    return common.finish(result, facts, partial(_save, result, folder), plot, args)


@contextlib.contextmanager
def _folder(text: str | None) -> Iterator[Path | None]:
    """The folder to write into, made before the search and not after it; removed where an error leaves it empty."""
    if text is None:
        yield None
        return
    from tsmblocks.html.report_files import folder_for

    try:
        folder = folder_for(text)
    except TsmError as error:
        raise common.UsageError(f"--out: {error}") from None
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    finally:
        if made:
            with contextlib.suppress(OSError):  # it holds something
                folder.rmdir()


def _save(result: Diagnosis, folder: Path | None) -> list[str]:
    """Write the three files; their paths."""
    from tsmblocks.html.report_files import NAMES

    if folder is None:
        return []
    result.save(folder)
    return [str(folder / name) for name in NAMES]


class _Progress:
    """The text of progress of the search, with the time that is left of its step, and of the time limit [s]."""

    def __init__(self, limit: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._left, self._round = clock, console.TimeLeft(clock), 0
        self._end = None if limit is None else clock() + limit

    def __call__(self, stage: str, done: int, of: int) -> str:
        self._round += stage == SCREENING and done == 0
        text = STAGES.get(stage, stage)
        if of > 1:
            text = f"search {self._round}: {text} {min(done + 1, of)} of {of}"
            text += self._left(done / of, f"{stage} {self._round}")
        if self._end is None:
            return text
        return f"{text}; ends in {console.duration_text(max(self._end - self._clock(), 0.0))} at most"
