"""One call that runs a plan: ``tsm.study(diagram, plan, metrics)``."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import BrokenExecutor, Executor
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_callback, as_integer
from tsmblocks.common.errors import DataError, ParameterError, RunError, in_words
from tsmblocks.common.version import __version__
from tsmblocks.data import heading
from tsmblocks.engine.inputs import Signal
from tsmblocks.metrics.metrics import Metric
from tsmblocks.metrics.metrics import metrics as read_metrics
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.edits import near_path
from tsmblocks.simulation.arguments import as_diagram
from tsmblocks.simulation.compiled import equations
from tsmblocks.simulation.run_options import RunOptions
from tsmblocks.simulation.stability import warn_of_fast_poles
from tsmblocks.studies.plans import Plan, grid
from tsmblocks.studies.results import Results
from tsmblocks.studies.runner import PieceResult, checked_batches, grouped, run_in_process, run_on_executor, run_starts
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
    hold: str = "linear",
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
            "study runs one diagram; of several, make a study each: "
            "{name: study(one, plan, metrics) for name, one in diagrams.items()}."
        )
    diagram, plan = as_diagram(diagram), as_plan(plan)
    options = RunOptions(stop, step, start, method, inputs, hold, backend=backend)
    wanted = read_metrics(metrics, signal_units(diagram))
    settings = _StudySettings(
        title or diagram.title, diagram, plan.kind, with_own_values(diagram, plan), wanted, options
    )
    progress = as_callback(progress, "done and of")
    if executor is not None and not hasattr(executor, "submit"):
        raise RunError(f"executor is one of concurrent.futures, or Dask's get_executor(), got {in_words(executor)}.")
    if threads is not None:
        as_integer("threads", threads, 1)
    groups = grouped(diagram, settings.columns, options)
    representative = run_starts(groups, checked_batches(groups, wanted), settings.columns)
    warn_of_fast_poles(representative, options.rule, step)
    store = Store(_path(out), settings.facts, settings.heading, tuple(settings.columns.values()), settings.count)
    store.begin()
    missing = np.array([k not in store.done for k in range(settings.count)])
    parts = (
        run_in_process(groups, wanted, missing, threads)
        if executor is None
        else run_on_executor(groups, wanted, missing, executor)
    )
    return settings.results(store, _run(parts, settings, store, progress))


def _run(parts: Generator[PieceResult, None, None], settings: _StudySettings, store: Store, progress: Progress) -> str:
    """Store results as runs end; returns the status."""
    try:
        progress(len(store.done), settings.count)
        for runs, values in parts:
            store.add(
                runs, [*(v[runs] for v in settings.columns.values()), *(values[one.name] for one in settings.metrics)]
            )
            progress(len(store.done), settings.count)
    except KeyboardInterrupt:
        parts.close()
        return "interrupted"
    except BrokenExecutor as error:
        kept = (
            f" {len(store.done)} of {settings.count} runs are in {store.path}; the same call continues from there."
            if store.path
            else ""
        )
        guard = "" if store.done else ' A script that starts processes works under if __name__ == "__main__": alone.'
        raise RunError(f"a worker process ended before its runs did ({error}).{kept}{guard}") from None
    store.finish()
    return "complete"


@attrs.frozen(eq=False)
class _StudySettings:
    """A study, all of it settled: ``columns`` have a value for every run, ``options`` are those of the runs."""

    title: str
    diagram: Diagram
    kind: str
    columns: Mapping[str, np.ndarray]
    metrics: tuple[Metric, ...]
    options: RunOptions

    def __attrs_post_init__(self) -> None:
        for one in self.metrics:
            if one.name in self.columns:
                raise ParameterError(f"'{one.name}' is a parameter of the plan, so no metric can have that name.")

    @property
    def count(self) -> int:
        """How many runs there are."""
        return len(next(iter(self.columns.values())))

    @property
    def own(self) -> dict[str, Any]:
        """The diagram's own values; None for an option."""
        numbers = self.diagram.untied(self.columns).parameters
        return {name: numbers.get(name) for name in self.columns}

    @property
    def heading(self) -> tuple[str, ...]:
        """Titles of the columns of a table."""
        return ("run", *self.columns, *(heading(one.name, one.unit) for one in self.metrics))

    @property
    def facts(self) -> dict[str, Any]:
        """All that the results depend on, so that those of another study are not gone on with."""
        options, times = self.options, self.options.times
        values = (f"{k}={v.tolist()!r}" for k, v in self.columns.items())
        driven = (f"{k}={_input_text(k, v, times.grid, options.hold)}" for k, v in options.inputs.items())
        return {
            "format": FORMAT,
            "title": self.title,
            "runs": self.count,
            "kind": self.kind,
            "version": __version__,
            "diagram": _digest(_diagram_text(self.diagram)),
            "plan": _digest(*values),
            "inputs": _digest(*driven),
            "metrics": {one.given_name: one.text for one in self.metrics},
            "units": {one.name: one.unit for one in self.metrics},
            "parameters": self.own,
            "start": times.start,
            "step": times.h,
            "steps": times.steps,
            "method": options.method,
        }

    def results(self, store: Store, status: str) -> Results:
        """The results in a store; runs that are missing are left out."""
        runs = np.array(sorted(store.done), dtype=int)
        first = len(self.columns)
        values = {
            one.name: np.array([float(store.done[k][m]) for k in runs]) for m, one in enumerate(self.metrics, first)
        }
        return Results(
            self.title,
            self.kind,
            self.count,
            runs,
            {k: v[runs] for k, v in self.columns.items()},
            values,
            {one.name: one.unit for one in self.metrics},
            {one.name: one.text for one in self.metrics},
            self.own,
            status,
            store.path,
            self.diagram,
            {one.name: one.given_name for one in self.metrics},
        )


# ---- arguments -----------------------------------------------------------------------------------------


def as_plan(plan: Any) -> Plan:
    """A plan, or the grid that a mapping describes. Raises ParameterError for anything else."""
    if isinstance(plan, Plan):
        return plan
    if isinstance(plan, Mapping):
        return grid(plan)
    raise ParameterError(
        f"a plan is made by grid, sweep, latin_hypercube, monte_carlo or table of tsmblocks.studies, "
        f"or is a mapping from parameters to values, got {in_words(plan)}."
    )


def with_own_values(diagram: Diagram, plan: Plan) -> dict[str, np.ndarray]:
    """The columns of a plan, NaN replaced by the diagram's own values. Raises ParameterError for an unknown name."""
    return {name: _filled_with_own(diagram, name, values) for name, values in plan.columns.items()}


def _filled_with_own(diagram: Diagram, name: str, values: np.ndarray) -> np.ndarray:
    """The values of a parameter, NaN replaced by the diagram's own."""
    if values.dtype.kind != "f" or not np.isnan(values).any():
        return values
    own = diagram.untied([name]).parameters
    if name not in own and name in diagram.parameter_names():
        raise ParameterError(f"'{name}' is an option, and a sweep changes numbers. Use grid for it.")
    if name not in own:
        raise ParameterError(f"diagram '{diagram.title}' has no parameter '{name}'.{near_path(name, own)}")
    return np.where(np.isnan(values), own[name], values)


def signal_units(diagram: Diagram) -> dict[str, str]:
    """The signals that metrics may name, with their units; outputs of the diagram first."""
    eq = equations(diagram)
    return {
        **{name: eq.units.get(signal, "") for name, signal in eq.aliases.items()},
        **{name: eq.units.get(name, "") for name in eq.y},
    }


def _path(out: str | Path | None) -> Path | None:
    if out is None:
        return None
    if not isinstance(out, (str, os.PathLike)):
        raise DataError(f"out is the path of a .csv file, got {in_words(out)}.")
    path = Path(out)
    if path.suffix.lower() != ".csv":
        raise DataError(f"'{out}' must end in .csv: results are kept in a table.")
    if path.is_dir() or not path.resolve().parent.is_dir():
        raise DataError(
            f"'{out}' cannot be written: {'it is a folder' if path.is_dir() else 'there is no such folder'}."
        )
    return path


def _diagram_text(diagram: Diagram) -> str:
    """A text by which diagrams differ, in parameters and in equations: those of user-defined blocks too."""
    eq = equations(diagram)
    functions = [eq.rhs, eq.start, eq.lag, *([eq.update] if eq.update is not None else [])]
    numbers = sorted(diagram.parameters.items())
    return "\n".join([*(one.serialize() for one in functions), repr(numbers), repr(eq.periods), *eq.reads])


def _input_text(name: str, given: Any, grid: np.ndarray, hold: str) -> str:
    """A text by which inputs differ: their hold, and their values at the steps."""
    signal = Signal(name, given, grid, hold)
    values = np.asarray(signal.at(grid), dtype=float)
    return f"{signal.hold} {hashlib.sha256(values.tobytes()).hexdigest()}"


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
