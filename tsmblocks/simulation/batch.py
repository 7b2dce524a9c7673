"""Many runs of one diagram at once, in SIMD lanes and threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.arguments import as_integer
from tsmblocks.common.errors import ParameterError, RunError, in_words
from tsmblocks.common.interpolation import AUTO, Hold
from tsmblocks.common.memory import refuse_too_large
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.kernel import Kernel, Memory
from tsmblocks.engine.methods import Method
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import COPIES, RunOptions, TimeGrid, as_diagram, kept_columns, run_to_their_end
from tsmblocks.simulation.batch_check import SideBySide, finding_of_run
from tsmblocks.simulation.batch_parameters import parameter_sets
from tsmblocks.simulation.batch_result import Batch
from tsmblocks.simulation.compiled import SOLVE, equations, for_run, parameter_vector
from tsmblocks.simulation.lanes import batch_kernel, lane_columns, lane_memory, lanes_for, whole_run
from tsmblocks.simulation.stability import (
    RunStart,
    concerned,
    extreme_sets,
    fast_poles,
    set_text,
    step_warnings_are_off,
)
from tsmblocks.simulation.step_check import warn_of_step

Reduce = Callable[[np.ndarray, dict[str, np.ndarray]], Mapping[str, np.ndarray]]


def simulate_batch(
    diagram: Diagram,
    parameters: Mapping[str, Any],
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: Hold = AUTO,
    outputs: Sequence[str] | None = None,
    reduce: Reduce | None = None,
    every: int = 1,
    threads: int | None = None,
    backend: str = "",
    loops: str = SOLVE,
) -> Batch:
    """Run a diagram once for each set of parameters, sets side by side in SIMD lanes and threads.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    parameters : dict of str to array
        Values of each varied parameter, shape (sets,), all of one length.
    stop, step, start, method, inputs, hold : optional
        As for ``simulate``.
    outputs : list of str, optional
        Signals to keep. By default the outputs of the diagram.
    reduce : callable, optional
        ``reduce(t, signals)`` gets arrays of shape (N, lanes) and returns results of shape (lanes,) by name; then only
        these are kept.
    every : optional
        As for ``simulate``.
    threads : int, optional
        Number of threads. By default one for each processor.
    backend, loops : optional
        As for ``simulate``.

    Returns
    -------
    Batch
        ``batch[name]`` has shape (sets, N), or (sets,) after a reduction.

    Raises
    ------
    ParameterError
        For an unknown parameter, one that cannot vary between lanes, arrays of different lengths, and a set that
        a block refuses.
    RunError, DataError
        As for ``simulate``.

    Warns
    -----
    StepWarning
        Where the step is too long for some of a few sets, the extremes of each parameter among them: for their fastest
        poles, or for their runs, of which about a tenth of all steps at most is taken to check. It names the worst set.

    Examples
    --------
    >>> import tsmblocks as tsm
    >>> motor = tsm.load("motor_linear")
    >>> batch = tsm.simulate_batch(motor, {"motor.K": [1.0, 2.0]}, stop=1.0, inputs={"u": 12.0})
    >>> batch["x"][:, -1].round(3).tolist()
    [11.76, 23.52]
    """
    options = RunOptions(stop, step, start, method, inputs, hold, every, backend, loops)
    made = batch_of(diagram, parameters, options, outputs)
    warn_of_sets([made.run_start(k) for k in extreme_sets(made.sets)], [made])
    return Batch(made.sets, made.results(0, made.count, reduce, threads), made.t, {} if reduce else made.units)


@attrs.frozen(eq=False)
class PreparedBatch:
    """A batch that can be run in parts; the results of a set do not depend on the part in which it is run.

    ``sets`` maps parameters to their values (sets,).
    """

    sets: Mapping[str, np.ndarray]
    _eq: Equations
    _kernel: Kernel
    _whole: Callable[[Memory], np.ndarray]
    _base: np.ndarray
    _columns: Mapping[str, int]
    _times: TimeGrid
    _signals: list[tuple[Signal, int]]
    _backend: str

    @property
    def t(self) -> np.ndarray:
        """The instants that are kept in s, shape (N,)."""
        return self._times.kept_instants

    @property
    def count(self) -> int:
        """Number of sets."""
        return len(next(iter(self.sets.values())))

    @property
    def units(self) -> dict[str, str]:
        """Units of the kept signals, ``""`` where none is known."""
        return {name: self._eq.units.get(self._eq.aliases.get(name, name), "") for name in self._columns}

    @property
    def lanes(self) -> int:
        """Number of sets that are run side by side."""
        return self._kernel.plan.lanes

    def results(
        self, first: int, last: int, reduce: Reduce | None = None, threads: int | None = None
    ) -> dict[str, np.ndarray]:
        """Results of the sets from ``first`` up to, not including, ``last``; ``reduce`` as for ``simulate_batch``.

        Call it from one thread at a time: it uses threads itself.
        """
        if reduce is not None and not callable(reduce):
            raise RunError(f"reduce must be a function of times and signals, got {in_words(reduce)}.")
        if reduce is None:
            size = COPIES * 8.0 * (last - first) * self._times.kept * len(self._columns)
            hint = "Keep fewer outputs, or every; or give reduce."
            refuse_too_large(size, f"the results of {last - first:,} runs", hint, RunError)
        lanes = self.lanes
        t, groups = self.t, range(first, last, lanes)
        # CasADi functions are not thread-safe, so all memory is made before.
        memories = [lane_memory(self._eq, self._kernel, self._parameters(k), self._times.h) for k in groups]

        def group(begin: int, memory: Memory) -> dict[str, np.ndarray]:
            y = self._whole(memory)
            found = {name: lane_columns(y, self._kernel, k, lanes) for name, k in self._columns.items()}
            made = dict(reduce(t, found)) if reduce is not None else {k: v.T for k, v in found.items()}
            return {k: np.asarray(v)[: last - begin].copy() for k, v in made.items()}

        workers = as_integer("threads", threads, 1) if threads is not None else os.cpu_count() or 1
        with ThreadPoolExecutor(workers) as pool:
            parts = list(pool.map(group, groups, memories))
        return {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}

    def run_start(self, k: int) -> RunStart:
        """The start of the run of set ``k``."""
        numbers = {name: float(values[k]) for name, values in self.sets.items()}
        p = self._base.copy()
        p[[self._eq.p.index(name) for name in numbers]] = list(numbers.values())
        return RunStart(self._eq, p, self._times.start, self._signals, label=set_text(numbers))

    def wrong_sets(self, runs: int | None = None) -> WrongSets | None:
        """Those of a few sets, the extremes among them, whose step is too long; ``runs`` are there in all."""
        some = [
            *extreme_sets(self.sets),
            self.count - 1,
            *np.linspace(0, self.count - 1, self.lanes).astype(int).tolist(),
        ]
        chosen = list(dict.fromkeys(some))[: self.lanes]
        p = self._of_sets(np.resize(chosen, self.lanes))
        side = SideBySide(self._eq, self._kernel, self._signals, self._times, p)
        gaps = side.wrong(runs or self.count)[: len(chosen)]
        worst = int(np.argmax(gaps))
        text = finding_of_run(side, worst, self._backend) if gaps[worst] else ""
        return WrongSets(chosen[worst], float(gaps[worst]), int((gaps > 0).sum()), len(chosen), text) if text else None

    @property
    def title(self) -> str:
        """The title of the diagram."""
        return self._eq.title

    @property
    def method(self) -> Method:
        """The integration method."""
        return self._kernel.plan.method

    @property
    def step(self) -> float:
        """The step in s."""
        return self._times.h

    def _parameters(self, first: int) -> np.ndarray:
        """Parameters of the sets from ``first`` on, one set per lane; unused lanes repeat the last set."""
        return self._of_sets(np.minimum(np.arange(first, first + self.lanes), self.count - 1))

    def _of_sets(self, chosen: np.ndarray) -> np.ndarray:
        """Parameters of these sets, one set per lane."""
        p = np.repeat(self._base[:, None], self.lanes, axis=1)
        for name, values in self.sets.items():
            p[self._eq.p.index(name)] = values[chosen]
        return p


@attrs.frozen
class WrongSets:
    """Sets whose step is too long: the worst, how far off it is, how many ``of`` those checked, and what was found."""

    worst: int
    gap: float
    count: int
    of: int
    finding: str


def warn_of_sets(
    starts: Sequence[RunStart],
    batches: Sequence[PreparedBatch],
    label: Callable[[int, int], str] | None = None,
    runs: int | None = None,
    stacklevel: int = 4,
) -> None:
    """Warn once of a step that is too long for the poles of the runs, or for the runs of a few sets as they go.

    By default the warning is given at the line that called the caller. ``label`` names a set of a batch, by their
    positions; ``runs`` are there in all, those of the batches unless given.
    """
    first = batches[0]
    poles = fast_poles(starts, first.method, first.step)
    if poles or step_warnings_are_off():
        warn_of_step(first.title, first.step, poles, "", stacklevel)
        return
    found = [(one, k) for k, batch in enumerate(batches) if (one := batch.wrong_sets(runs)) is not None]
    if found:
        worst, k = max(found, key=lambda one: one[0].gap)
        name = label(k, worst.worst) if label else batches[k].run_start(worst.worst).label
        which = concerned(sum(batch.of for batch, _ in found), sum(batch.count for batch, _ in found), name)
        warn_of_step(first.title, first.step, "", worst.finding, stacklevel, f" {which}")


def batch_of(
    diagram: Diagram,
    parameters: Mapping[str, Any],
    options: RunOptions,
    outputs: Sequence[str] | None = None,
    lanes: int | None = None,
) -> PreparedBatch:
    """Check and compile a batch without running it; arguments and errors as for ``simulate_batch``.

    ``lanes`` is the number of sets side by side, a power of two (by default chosen for the diagram). The parts of
    a study pass it on, so that results agree to the last digit however the work is divided.
    """
    if not isinstance(parameters, Mapping):
        raise ParameterError(f"parameters must map names to one number per set each, got {in_words(parameters)}.")
    diagram = as_diagram(diagram).untied(parameters)
    run_to_their_end(diagram, "a batch")
    times = options.times
    eq = equations(diagram, loops=options.loops)
    eq, signals = for_run(eq, diagram, options)
    sets, count = parameter_sets(eq, diagram, parameters)
    names, chosen, columns = kept_columns(eq, outputs)
    vary = frozenset(eq.p.index(k) for k in sets)
    kernel = batch_kernel(eq, options.rule, chosen, lanes or lanes_for(count, len(eq.x)), vary, options.backend)
    whole = whole_run(eq, kernel, signals, times)
    placed = dict(zip(names, columns, strict=True))
    base = parameter_vector(eq, diagram)
    return PreparedBatch(sets, eq, kernel, whole, base, placed, times, signals, options.backend)
