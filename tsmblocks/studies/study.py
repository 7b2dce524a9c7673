"""One call that runs a plan: ``tsm.study(diagram, plan, metrics)``."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from pathlib import Path
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_callback, as_integer
from tsmblocks.common.errors import DataError, ParameterError, RunError, in_words
from tsmblocks.common.headings import heading
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.version import __version__
from tsmblocks.engine.inputs import Signal
from tsmblocks.metrics.metrics import Metric
from tsmblocks.metrics.metrics import metrics as read_metrics
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.parameters import near_path
from tsmblocks.simulation.arguments import RunOptions, as_diagram
from tsmblocks.simulation.batch import warn_of_sets
from tsmblocks.simulation.compiled import equations
from tsmblocks.studies.plans import Plan, grid
from tsmblocks.studies.results import Results, described_results
from tsmblocks.studies.runner import (
    PieceResult,
    checked_batches,
    grouped,
    run_in_process,
    run_on_executor,
    run_starts,
    set_labels,
)
from tsmblocks.studies.store import FORMAT, Store

Progress = Callable[[int, int], Any]
"""Callback with the number of runs done and the number of runs."""


def study(
    diagram: Diagram,
    plan: Plan | Mapping[str, Any],
    metrics: Any = None,
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: Hold = AUTO,
    out: str | Path | None = None,
    executor: Executor | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    backend: str = "",
    title: str = "",
) -> Results:
    """Run a diagram once for each set of a plan, and reduce each run to numbers.

    Runs go side by side in SIMD lanes and threads of this process, or on an executor. A run that is not finite has NaN
    for its metrics. Ctrl-C ends the study with the results so far.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    plan : Plan or mapping of str to sequence
        The sets; a mapping from parameters (options too) to values is a grid of all combinations.
    metrics : str, sequence of str, mapping of str to str or None, default None
        Texts such as ``"rms(x_ref - x_out, after=10)"``; the name in a mapping may state the unit
        (``{"error [deg]": "…"}``). By default the tracking errors.
    stop, step, start, method, inputs, hold : optional
        As for ``simulate``.
    out : str, Path or None, default None
        A .csv file to which results are written as they are computed; a ``.study.json`` beside it describes the study.
        The same call continues where an earlier one was stopped, and ends with the same bytes.
    executor : concurrent.futures.Executor or None, default None
        Where to run; Dask's ``Client.get_executor()`` is one. By default threads of this process.
    threads : int or None, default None
        Threads of this process, by default as many as there are processors.
    progress : callable or None, default None
        Called as ``progress(done, count)`` when runs end.
    backend : {"", "llvm", "casadi"}, default ""
        As for ``simulate``.
    title : str, default ""
        Title of the results, by default that of the diagram.

    Returns
    -------
    Results
        Parameters and metrics of each run.

    Raises
    ------
    ParameterError, DataError, RunError
        As ``simulate_batch`` and ``metric`` do, before anything is run; RunError where a worker process ends early.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> loop = tsm.load("fig16_feedforward_feedback")
    >>> found = tsm.study(loop, {"pid.kp": [0.5, 1.0, 2.0]}, {"error [deg]": "rms(x_ref - x_out)"}, stop=10.0)
    >>> found.best("error")["pid.kp"]
    2.0
    """
    if isinstance(diagram, Mapping):
        raise ParameterError(
            "study runs one diagram; for several, make one study each: "
            "{name: study(one, plan, metrics) for name, one in diagrams.items()}."
        )
    diagram = as_diagram(diagram)
    plan = filled_plan(diagram, plan)
    options = RunOptions(stop, step, start, method, inputs, hold, backend=backend)
    wanted = read_metrics(metrics, signal_units(diagram))
    for one in wanted:
        if one.name in plan.columns:
            raise ParameterError(f"'{one.name}' is a parameter of the plan, so no metric can have that name.")
    progress = as_callback(progress, "done and of")
    if executor is not None and not hasattr(executor, "submit"):
        raise RunError(f"executor is one of concurrent.futures, or Dask's get_executor(), got {in_words(executor)}.")
    if threads is not None:
        as_integer("threads", threads, 1)
    groups = grouped(diagram, plan.columns, options)
    batches = checked_batches(groups, wanted)
    warn_of_sets(run_starts(groups, batches, plan.columns), batches, set_labels(groups, plan.columns))
    facts = _facts(title or diagram.title, diagram, plan, wanted, options)
    titles = ("run", *plan.columns, *(heading(one.name, one.unit) for one in wanted))
    store = Store(_path(out), facts, titles, tuple(plan.columns.values()))
    store.begin()
    missing = np.array([k not in store.done for k in range(len(plan))])
    if executor is None:
        parts = run_in_process(groups, wanted, missing, threads)
    else:
        parts = run_on_executor(groups, wanted, missing, executor)
    _run(parts, plan, wanted, store, progress)
    runs = np.array(sorted(store.done), dtype=int)
    columns = {name: values[runs] for name, values in plan.columns.items()}
    for k, one in enumerate(wanted, start=len(columns)):
        columns[one.name] = np.array([float(store.done[run][k]) for run in runs])
    return described_results(facts, runs, columns, store.path, diagram)


def _run(
    parts: Generator[PieceResult, None, None], plan: Plan, metrics: Sequence[Metric], store: Store, progress: Progress
) -> None:
    """Store results as runs end, until all have or Ctrl-C is pressed."""
    try:
        progress(len(store.done), len(plan))
        for runs, values in parts:
            store.add(runs, [*(v[runs] for v in plan.columns.values()), *(values[one.name] for one in metrics)])
            progress(len(store.done), len(plan))
    except KeyboardInterrupt:
        parts.close()
    except BrokenExecutor as error:
        kept = f" {len(store.done)} of {len(plan)} runs are in {store.path}; the same call continues from there."
        guard = "" if store.done else ' A script that starts processes must do so under if __name__ == "__main__":.'
        raise RunError(
            f"a worker process ended before its runs did ({error}).{kept if store.path else ''}{guard}"
        ) from None
    store.finish()


def _facts(title: str, diagram: Diagram, plan: Plan, metrics: Sequence[Metric], options: RunOptions) -> dict[str, Any]:
    """All that the results depend on, so that those of another study are not continued."""
    times, own = options.times, diagram.untied(plan.columns).parameters
    values = (f"{k}={v.tolist()!r}" for k, v in plan.columns.items())
    inputs = (f"{k}={_input_text(k, v, times.grid, options.hold)}" for k, v in options.inputs.items())
    return {
        "format": FORMAT,
        "title": title,
        "runs": len(plan),
        "kind": plan.kind,
        "version": __version__,
        "diagram": _digest(_diagram_text(diagram)),
        "plan": _digest(*values),
        "inputs": _digest(*inputs),
        "metrics": {one.given_name: one.text for one in metrics},
        "units": {one.name: one.unit for one in metrics},
        "parameters": {name: own.get(name) for name in plan.columns},
        "start": times.start,
        "step": times.h,
        "steps": times.steps,
        "method": options.method,
    }


# ---- arguments -----------------------------------------------------------------------------------------


def filled_plan(diagram: Diagram, plan: Any) -> Plan:
    """The plan, or the grid of a mapping, with the diagram's own values in place of NaN. Raises ParameterError."""
    if isinstance(plan, Mapping):
        plan = grid(plan)
    if not isinstance(plan, Plan):
        raise ParameterError(
            f"a plan is made by grid, sweep, latin_hypercube, monte_carlo or table of tsmblocks.studies, "
            f"or is a mapping from parameters to values, got {in_words(plan)}."
        )
    columns = dict(plan.columns)
    for name, values in columns.items():
        if values.dtype.kind != "f" or not np.isnan(values).any():
            continue
        own = diagram.untied([name]).parameters
        if name not in own and name in diagram.parameter_names():
            raise ParameterError(f"'{name}' is an option, and a sweep changes numbers. Use grid for it.")
        if name not in own:
            raise ParameterError(f"diagram '{diagram.title}' has no parameter '{name}'.{near_path(name, own)}")
        columns[name] = np.where(np.isnan(values), own[name], values)
    return Plan(columns, plan.kind)


def signal_units(diagram: Diagram) -> dict[str, str]:
    """The signals that metrics may name, with their units; outputs of the diagram first."""
    eq = equations(diagram)
    return {
        **{name: eq.units.get(signal, "") for name, signal in eq.aliases.items()},
        **{name: eq.units.get(name, "") for name in eq.y},
    }


def _path(out: str | Path | None) -> Path | None:
    """The path of the table of results. Raises DataError where it cannot be written."""
    if out is None:
        return None
    if not isinstance(out, (str, os.PathLike)):
        raise DataError(f"out is the path of a .csv file, got {in_words(out)}.")
    path = Path(out)
    if path.suffix.lower() != ".csv":
        raise DataError(f"'{out}' must end in .csv: results are kept in a table.")
    if path.is_dir() or not path.resolve().parent.is_dir():
        why = "it is a folder" if path.is_dir() else "there is no such folder"
        raise DataError(f"'{out}' cannot be written: {why}.")
    return path


def _diagram_text(diagram: Diagram) -> str:
    """A text by which diagrams differ, in parameters and in equations: those of user-defined blocks too."""
    eq = equations(diagram)
    functions = [eq.rhs, eq.start, eq.lag, *([eq.update] if eq.update is not None else [])]
    numbers = sorted(diagram.parameters.items())
    return "\n".join([*(one.serialize() for one in functions), repr(numbers), repr(eq.periods), *eq.reads])


def _input_text(name: str, given: Any, grid: np.ndarray, hold: Hold) -> str:
    """A text by which inputs differ: their hold, and their values at the steps."""
    how = hold if isinstance(hold, str) else hold.get(name, AUTO)
    signal = Signal(name, given, grid, how)
    values = np.asarray(signal.at(grid), dtype=float)
    return f"{signal.hold} {hashlib.sha256(values.tobytes()).hexdigest()}"


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
