r"""Run a diagram many times, as a study file says, and print its metrics.

STUDY is a TOML file that names the diagram, what varies and what is measured;
or a .csv file of results, to be shown again. With --out every result is on the
disk as soon as it is there, and the same command goes on where an earlier one
was stopped. Runs go side by side in this process, in --workers processes, or
on the machines of a Dask scheduler.

  tsmblocks study gains.toml --out gains.csv --plot gains.png
  tsmblocks study gains.toml --out gains.csv --dask tcp://scheduler:8786
  tsmblocks study gains.csv --plot again.png
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tsmblocks.cli import common, console, recordings

HELP = "run a diagram many times with other parameters, print and keep its metrics"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("study", metavar="STUDY", help="a study file (.toml), or results to show again (.csv)")
    where = parser.add_argument_group("where the runs go").add_mutually_exclusive_group()
    where.add_argument("--workers", metavar="N", type=common.whole, help="processes (default: threads of this one)")
    where.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster")
    measured = parser.add_argument_group("measured data, for diagrams with inputs")
    recordings.data_arguments(measured)
    recordings.condition_argument(measured)
    options = parser.add_argument_group("results")
    options.add_argument("--out", metavar="FILE", help="keep results in a .csv file, and go on with what is in it")
    options.add_argument("--plot", metavar="FILE", help="write a figure to a .png, .svg or .pdf file")
    common.json_argument(options)


def execute(args: argparse.Namespace) -> int:
    """Run the command; the exit status."""
    out, plot = common.result_path(args.out, (".csv",)), common.figure_path(args.plot)
    if args.study.endswith(".csv"):
        from tsmblocks.studies import read_study

        if out:
            raise common.UsageError("results are shown again as they are; --out is for a study file.")
        found = read_study(args.study)
    else:
        found = _run(args, out)
    if not args.json:
        print(found)
    return common.finished(found, {}, [str(out)] if out else [], plot, args)


def _run(args: argparse.Namespace, out: Path | None) -> Any:
    from tsmblocks.studies import study
    from tsmblocks.studies.files import load_study

    asked = load_study(args.study)
    args.hold = asked.how.get("hold", "linear")
    record, inputs = recordings.read_inputs(args, asked.diagram, asked.diagram.title)
    how = {**asked.how, **({"start": float(record.t[0])} if record is not None else {})}
    with console.progress(counted(), quiet=args.json) as tell, _executor(args) as executor:
        return study(
            asked.diagram,
            asked.plan,
            asked.metrics,
            inputs=inputs,
            out=out,
            executor=executor,
            progress=tell,
            title=asked.title,
            **how,
        )


@contextmanager
def _executor(args: argparse.Namespace) -> Iterator[Executor | None]:
    """Where the runs go; None for this process."""
    if args.workers:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        with ProcessPoolExecutor(args.workers, multiprocessing.get_context("spawn")) as pool:
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
            for path in args.own:
                client.upload_file(path)
            yield client.get_executor()
    else:
        yield None


def counted() -> Callable[[int, int], str]:
    """Words for the runs that are done, their rate and the time left."""
    began: list[tuple[float, int]] = []

    def words(done: int, count: int) -> str:
        now = time.monotonic()
        began.append((now, done))
        rate = (done - began[0][1]) / max(now - began[0][0], 1e-9)
        rest = f", {rate:.3g} runs/s, {in_time((count - done) / rate)} left" if done > began[0][1] else ""
        return f"{done} of {count} runs{rest}"

    return words


def in_time(seconds: float) -> str:
    """A time as people read it: ``12 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
