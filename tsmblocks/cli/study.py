r"""Run a diagram many times as a study file describes, and print its metrics.

STUDY is a TOML file that names the diagram, what varies and what is measured;
or a .csv file of results, to be printed again. With --out every result is
written at once, and the same command continues where an earlier one was
stopped. Runs are parallel in this process, in --workers processes, or on the
machines of a Dask scheduler.

  tsmblocks study gains.toml --out gains.csv --plot gains.png
  tsmblocks study gains.toml --out gains.csv --dask tcp://scheduler:8786
  tsmblocks study gains.csv --plot again.png
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tsmblocks.cli import common, console, recordings
from tsmblocks.common.interrupt import children_ignore_interrupts, end_with_parent

HELP = "run a diagram many times with other parameters, print and save its metrics"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("study", metavar="STUDY", help="a study file (.toml), or results to print again (.csv)")
    where = parser.add_argument_group("parallel runs").add_mutually_exclusive_group()
    workers = "processes (default: threads of this one)"
    where.add_argument("--workers", metavar="N", type=common.integer_from(1), help=workers)
    where.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster")
    recordings.data_arguments(parser.add_argument_group("measured data, for diagrams with inputs"))
    common.result_arguments(parser, "keep results in a .csv file; runs that are in it already are not repeated")


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    out, plot = common.result_path(args.out, (".csv",)), common.figure_path(args.plot)
    if args.study.endswith(".csv"):
        from tsmblocks.studies import read_study

        if out:
            raise common.UsageError("results are printed again as they are; --out is for a study file.")
        result = read_study(args.study)
    else:
        result = _run(args, out)
    return common.finish(result, {}, lambda: [str(out)] if out else [], plot, args)


def _run(args: argparse.Namespace, out: Path | None) -> Any:
    from tsmblocks.studies import study
    from tsmblocks.studies.files import load_study

    given = load_study(args.study)
    args.hold = given.get("hold", "auto")
    record, given["inputs"] = recordings.read_inputs(args, given["diagram"], given["diagram"].title)
    if record is not None:
        given["start"] = float(record.t[0])
    with console.progress_line(study_progress(), quiet=args.json) as progress, _executor(args) as executor:
        return study(**given, out=out, executor=executor, progress=progress)


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """Worker processes. They inherit that Ctrl-C does not reach them: this process ends them, and says so once."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    with ExitStack() as opened:
        try:
            spawn = multiprocessing.get_context("spawn")
            pool = opened.enter_context(ProcessPoolExecutor(count, spawn, initializer=end_with_parent))
            with children_ignore_interrupts():
                for _ in range(count):
                    pool.submit(abs, 0)  # starts one
        except OSError as error:
            why = f"no more processes can be started: {str(error.strerror).lower()}"
            raise common.UsageError(f"--workers {count}: {why}.") from None
        yield pool


@contextmanager
def _executor(args: argparse.Namespace) -> Iterator[Executor | None]:
    """The executor of the runs; None for this process."""
    if args.workers:
        with _processes(args.workers) as pool:
            yield pool
    elif args.dask:
        try:
            from distributed import Client
        except ImportError:
            raise common.UsageError('--dask needs Dask: pip install "tsmblocks[dask]"') from None
        try:
            client = Client(args.dask, timeout="10s")
        except (OSError, ValueError) as error:
            raise common.UsageError(f"no Dask scheduler answers at '{args.dask}': {error}.") from None
        with client:
            for path in args.extensions:
                client.upload_file(path)
            yield client.get_executor()
    else:
        yield None


def study_progress() -> Callable[[int, int], str]:
    """The text of progress: runs done, their rate and the remaining time."""
    began: list[tuple[float, int]] = []

    def text(done: int, count: int) -> str:
        now = time.monotonic()
        began.append((now, done))
        rate = (done - began[0][1]) / max(now - began[0][0], 1e-9)
        left = f", {rate:.3g} runs/s, about {console.duration_text((count - done) / rate)} left" if rate > 0 else ""
        return f"{done} of {count} runs done{left}"

    return text
