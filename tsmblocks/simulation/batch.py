"""Many runs of one diagram at once, and exact derivatives of a run: the engine's lanes and threads."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.errors import ParameterError, RunError, in_words, near
from tsmblocks.engine import inputs as feeds
from tsmblocks.engine.backends import kernel_for
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.kernel_interface import Kernel, Memory
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.sensitivities import Sensitivities, tangent_memory, tangent_plan
from tsmblocks.engine.session import check_delays, gather_signals, plan_for, spread, steps_per_period
from tsmblocks.model.block import Block, is_reference, leaves, map_leaves
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.edits import near_path
from tsmblocks.simulation.arguments import Times, given_inputs, prepared, run_times, whole
from tsmblocks.simulation.batch_result import Batch
from tsmblocks.simulation.simulate import equations, parameter_vector
from tsmblocks.simulation.stability import Beginning, extremes, set_in_words, warn_of_fast_poles

MOST_DIRECTIONS = 32
"""Derivative directions side by side in one run."""

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
    hold: str = "linear",
    outputs: Sequence[str] | None = None,
    reduce: Reduce | None = None,
    every: int = 1,
    threads: int | None = None,
    backend: str = "",
) -> Batch:
    """Run a diagram once for each set of parameters, sets side by side in SIMD lanes and threads.

    ``parameters`` maps names to arrays of one length (sets,); ``outputs`` names the signals kept
    (by default the diagram's outputs). ``reduce(t, signals)`` receives arrays of shape (N, lanes) and
    returns results of shape (lanes,), so that long batches need not be kept whole. Other arguments as
    for ``simulate``. Raises ParameterError for an unknown name or arrays of different lengths.
    """
    made = batch_of(
        diagram,
        parameters,
        stop=stop,
        step=step,
        start=start,
        method=method,
        inputs=inputs,
        hold=hold,
        outputs=outputs,
        every=every,
        backend=backend,
    )
    warn_of_fast_poles([made.beginning(k) for k in extremes(made.sets)], method_named(method), step)
    return Batch(made.sets, made.results(0, made.count, reduce, threads), made.t, {} if reduce else made.units)


@attrs.frozen(eq=False)
class PreparedBatch:
    """A batch that can be run part by part; a set's results do not depend on the part it is run in.

    ``sets`` maps names of parameters to one number per set, ``t`` (N,) [s] are the instants kept.
    """

    sets: Mapping[str, np.ndarray]
    t: np.ndarray
    _eq: Equations
    _kernel: Kernel
    _whole: Callable[[Memory], np.ndarray]
    _base: np.ndarray
    _columns: Mapping[str, int]
    _h: float
    _start: float
    _signals: list[tuple[feeds.Signal, int]]

    @property
    def count(self) -> int:
        """How many sets there are."""
        return len(next(iter(self.sets.values())))

    @property
    def units(self) -> dict[str, str]:
        """Units of the signals that are kept, ``""`` where none is known."""
        return {name: self._eq.units.get(self._eq.aliases.get(name, name), "") for name in self._columns}

    @property
    def lanes(self) -> int:
        """How many sets are run side by side."""
        return self._kernel.plan.lanes

    def results(
        self, first: int, last: int, reduce: Reduce | None = None, threads: int | None = None
    ) -> dict[str, np.ndarray]:
        """Results of the sets from ``first`` up to ``last``, not included; ``reduce`` as for ``simulate_batch``.

        Not to be called from several threads at once: it has threads of its own.
        """
        lanes = self.lanes
        begins = range(first, last, lanes)
        # Symbolic functions are not for several threads, so all memory is made before.
        memories = [lane_memory(self._eq, self._kernel, self._parameters(k), self._h) for k in begins]

        def group(begin: int, memory: Memory) -> dict[str, np.ndarray]:
            y = self._whole(memory)
            found = {name: _lane_columns(y, self._kernel, k, lanes) for name, k in self._columns.items()}
            made = dict(reduce(self.t, found)) if reduce is not None else {k: v.T for k, v in found.items()}
            return {k: np.asarray(v)[: last - begin].copy() for k, v in made.items()}

        workers = whole("threads", threads, 1) if threads is not None else os.cpu_count() or 1
        with ThreadPoolExecutor(workers) as pool:
            parts = list(pool.map(group, begins, memories))
        return {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}

    def beginning(self, k: int) -> Beginning:
        """Where the run of a set begins, by its position."""
        numbers = {name: float(values[k]) for name, values in self.sets.items()}
        p = self._base.copy()
        p[[self._eq.p.index(name) for name in numbers]] = list(numbers.values())
        return Beginning(self._eq, p, self._start, self._signals, words=set_in_words(numbers))

    def _parameters(self, first: int) -> np.ndarray:
        """Parameters of the sets from ``first`` on, one set per lane; lanes left over repeat the last set."""
        p = np.repeat(self._base[:, None], self.lanes, axis=1)
        for name, values in self.sets.items():
            p[self._eq.p.index(name)] = values[np.minimum(np.arange(first, first + self.lanes), len(values) - 1)]
        return p


def batch_of(
    diagram: Diagram,
    parameters: Mapping[str, Any],
    *,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    outputs: Sequence[str] | None = None,
    every: int = 1,
    backend: str = "",
    lanes: int | None = None,
) -> PreparedBatch:
    """Check and compile a batch without running it; arguments and errors as for ``simulate_batch``.

    ``lanes`` is how many sets are run side by side, a power of two (by default what suits the diagram): parts of one
    study give it, so that their results agree to the last digit however the work is cut.
    """
    given = given_inputs(inputs)
    if not isinstance(parameters, Mapping):
        raise ParameterError(f"parameters must map names to one number per set each, got {in_words(parameters)}.")
    diagram = prepared(diagram).untied(parameters)
    times = run_times(given, start, stop, step, every)
    eq = equations(diagram)
    sets, count = _sets(eq, diagram, parameters)
    names = _named(outputs) if outputs is not None else list(eq.aliases)
    chosen, lanes = _columns(eq, names), lanes or lanes_for(count, len(eq.x))
    vary = frozenset(eq.p.index(k) for k in sets)
    kernel = batch_kernel(eq, method_named(method), chosen, lanes, vary, backend)
    signals = gather_signals(eq, given, times.grid, hold)
    whole = _whole_run(eq, kernel, signals, times)
    columns = {name: chosen.index(k) for name, k in zip(names, _positions(eq, names), strict=True)}
    return PreparedBatch(
        sets,
        times.grid[:: times.every],
        eq,
        kernel,
        whole,
        parameter_vector(eq, diagram),
        columns,
        times.h,
        times.start,
        signals,
    )


def _whole_run(
    eq: Equations, kernel: Kernel, signals: list[tuple[feeds.Signal, int]], times: Times
) -> Callable[[Memory], np.ndarray]:
    """A function that runs from the memory it is given to the end and returns the rows kept."""
    rows = feeds.rows(signals, times.start, times.h, 0, times.steps, kernel.plan.method.instants)
    hits = steps_per_period(eq, times.h)
    fixed: dict[str, Any] = dict(
        t0=times.start, h=times.h, k0=0, n=times.steps, final=True, every=times.every, skip=0, hits=hits
    )

    def run(memory: Memory) -> np.ndarray:
        y = np.empty((times.kept, kernel.layout_y.size))
        kernel.advance(memory, rows, **fixed, y=y)
        return y

    return run


def sensitivities(
    diagram: Diagram,
    names: Sequence[str],
    *,
    outputs: Sequence[str] | None = None,
    stop: float | None = None,
    step: float = 1e-3,
    start: float = 0.0,
    method: str = "rk4",
    inputs: Mapping[str, Any] | None = None,
    hold: str = "linear",
    every: int = 1,
    backend: str = "",
) -> Sensitivities:
    """Signals of a run and their exact derivatives with respect to named parameters (start values too).

    ``outputs`` names the signals (by default the diagram's outputs). Arguments as for ``simulate``.
    At a kink (a sign, an absolute value, a limit) the derivative is one-sided. Raises ParameterError
    for an unknown name.
    """
    given, names = given_inputs(inputs), _named(names)
    if not names:
        raise ParameterError(f"sensitivities of '{prepared(diagram).title}' need the name of a parameter at least.")
    diagram = prepared(diagram).untied(names)
    times = run_times(given, start, stop, step, every)
    eq = equations(diagram)
    base, known = parameter_vector(eq, diagram), [_index(eq, name, diagram) for name in names]
    shown = _named(outputs) if outputs is not None else list(eq.aliases)
    chosen, lanes = _columns(eq, shown), directions(len(known))
    kernel = tangent_kernel(eq, method_named(method), chosen, lanes, backend)
    whole = _whole_run(eq, kernel, gather_signals(eq, given, times.grid, hold), times)
    columns = [chosen.index(k) for k in _positions(eq, shown)]
    jacobian = np.empty((times.kept, len(shown), len(known)))
    for first in range(0, len(known), lanes):
        part = known[first : first + lanes]
        seeds = np.zeros((len(eq.p), lanes))
        seeds[part, range(len(part))] = 1.0
        y = whole(tangent_memory(eq, kernel, base, seeds, times.h))
        for i, column in enumerate(columns):
            wide = _lane_columns(y, kernel, len(chosen) + column, lanes)
            jacobian[:, i, first : first + len(part)] = wide[:, : len(part)]
    values = np.column_stack([y[:, kernel.layout_y.offset[c]] for c in columns])
    return Sensitivities(times.grid[:: times.every], values, jacobian, tuple(shown), tuple(names))


@functools.lru_cache(maxsize=256)
def batch_kernel(
    eq: Equations,
    method: Method,
    y: tuple[int, ...],
    lanes: int,
    vary: frozenset[int],
    backend: str,
    quick: bool = False,
) -> Kernel:
    """A kernel with one parameter set per lane (kept); ``quick`` as for ``kernel_for``."""
    return kernel_for(plan_for(eq, method, y, lanes=lanes, vary=vary), backend, quick)


@functools.lru_cache(maxsize=256)
def tangent_kernel(eq: Equations, method: Method, y: tuple[int, ...], lanes: int, backend: str) -> Kernel:
    """A kernel with one seed direction per lane (kept)."""
    return kernel_for(tangent_plan(eq, method, y, lanes), backend)


@functools.lru_cache(maxsize=64)
def _starts(eq: Equations, lanes: int) -> Any:
    """Start values of many sets at once (kept, since making such a function takes longer than calling it)."""
    return eq.start.map(lanes)


def lane_memory(eq: Equations, kernel: Kernel, p: np.ndarray, h: float) -> Memory:
    """Memory before the first step, one parameter set per lane; ``p`` has shape (parameters, lanes)."""
    lanes = kernel.plan.lanes
    x, d, s = (np.asarray(v) for v in _starts(eq, lanes)(p))
    tau = max((check_delays(eq, p[:, k], h).max() for k in range(lanes)), default=0.0) if eq.q else 0.0
    capacity = 1 << int(tau + 8).bit_length()
    ring = np.concatenate([np.tile(v, capacity) for v in s]) if len(s) else np.empty(0)
    flat: Any = [row if wide else row[0] for row, wide in zip(p, kernel.layout_p.wide, strict=True)]
    return Memory(
        spread(x, kernel.layout_x), spread(d, kernel.layout_d), spread(flat, kernel.layout_p), ring, capacity - 1
    )  # type: ignore[arg-type]


def _sets(eq: Equations, diagram: Diagram, parameters: Mapping[str, Any]) -> tuple[dict[str, np.ndarray], int]:
    for name in parameters:
        _index(eq, name, diagram)
    sets = {name: _column(name, values) for name, values in parameters.items()}
    lengths = {name: len(v) for name, v in sets.items()}
    if not sets or min(lengths.values()) == 0:
        raise ParameterError(f"a batch of '{diagram.title}' needs at least one parameter with at least one value.")
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{k} has {n}" for k, n in lengths.items())
        raise ParameterError(f"the parameters of a batch need one value per set each; {said}.")
    _check_sets(diagram, sets)
    return sets, next(iter(lengths.values()))


def _column(name: str, values: Any) -> np.ndarray:
    try:
        column = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise ParameterError(f"'{name}' must have one number per set of the batch, got {in_words(values)}.") from None
    if column.ndim != 1:
        raise ParameterError(
            f"'{name}' must have one number per set of the batch, got an array of shape {column.shape}."
        )
    return column


def _check_sets(diagram: Diagram, sets: Mapping[str, np.ndarray]) -> None:
    """Raise ParameterError for a set that a block refuses, in the block's own words.

    Bounds are intervals, so the sets with the extremes stand for all; where two numbers must go
    together (a lower and an upper limit), every set is looked at.
    """
    extremes = sorted({int(f(v)) for v in sets.values() for f in (np.argmin, np.argmax)})
    for k in extremes:
        try:
            diagram.with_parameters({name: float(v[k]) for name, v in sets.items()})
        except ParameterError as error:
            raise ParameterError(f"set {k} of the batch: {error}") from None
    for path, block, varied in _go_together(diagram, sets):
        for k in range(len(next(iter(sets.values())))):
            try:
                block.replace(**varied(k))
            except ParameterError as error:
                raise ParameterError(f"set {k} of the batch: {path}: {error}") from None


def _go_together(
    diagram: Diagram, sets: Mapping[str, np.ndarray], prefix: str = ""
) -> Iterator[tuple[str, Block, Callable[[int], dict[str, Any]]]]:
    """Blocks that check several of the varied numbers against each other, with their numbers in set k."""
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            yield from _go_together(block, sets, f"{prefix}{name}.")
            continue
        full = {
            leaf: prefix + v[1:] if is_reference(v) else f"{prefix}{name}.{leaf}"
            for key, value in block.parameters.items()
            for leaf, v in leaves(value, key)
        }
        if type(block).check is Block.check or sum(v in sets for v in full.values()) < 2:
            continue

        def number(k: int, leaf: str, value: Any, full: dict[str, str] = full) -> float:
            if full[leaf] in sets:
                return float(sets[full[leaf]][k])
            return diagram.values[value[1:]] if is_reference(value) else value

        def varied(k: int, block: Block = block, number: Callable[..., float] = number) -> dict[str, Any]:
            return {key: map_leaves(functools.partial(number, k), v, key) for key, v in block.parameters.items()}

        yield prefix + name, block, varied


def _named(names: Sequence[str] | str) -> list[str]:
    """Names asked for, of which one alone need not be a list."""
    return [names] if isinstance(names, str) else list(names)


def _index(eq: Equations, name: str, diagram: Diagram) -> int:
    if name not in eq.p and name in diagram.parameter_names():
        raise ParameterError(
            f"'{name}' shapes the equations of '{eq.title}' (it is an option, or a whole list), so it "
            "cannot vary between runs side by side. Simulate once for each value."
        )
    if name not in eq.p:
        raise ParameterError(
            f"diagram '{eq.title}' has no parameter '{name}' that can vary between runs.{near_path(str(name), eq.p)}"
        )
    return eq.p.index(name)


def _positions(eq: Equations, names: Sequence[str]) -> list[int]:
    made = []
    for name in names:
        signal = eq.aliases.get(name, name)
        if signal not in eq.y:
            raise RunError(f"diagram '{eq.title}' has no signal '{name}'.{near(name, [*eq.aliases, *eq.y])}")
        made.append(eq.y.index(signal))
    return made


def _columns(eq: Equations, names: Sequence[str]) -> tuple[int, ...]:
    if not names:
        raise RunError(f"diagram '{eq.title}' has no outputs, so say which signals to keep: outputs=['block.port'].")
    return tuple(dict.fromkeys(_positions(eq, names)))


def _lane_columns(y: np.ndarray, kernel: Kernel, k: int, lanes: int) -> np.ndarray:
    """One logged signal as (N, lanes), whether or not it differs between lanes."""
    part = y[:, kernel.layout_y.span(k)]
    return part if part.shape[1] == lanes else np.broadcast_to(part, (len(part), lanes))


def directions(count: int) -> int:
    """Lanes for so many derivative directions; beyond ``MOST_DIRECTIONS`` they take several runs."""
    return min(MOST_DIRECTIONS, _power_of_two(count))


def _power_of_two(n: int) -> int:
    """The smallest power of two that holds n, at least 2 (a lone lane is an ordinary run)."""
    return max(2, 1 << (n - 1).bit_length())


def lanes_for(count: int, states: int) -> int:
    """Sets run side by side: 32 lanes while the states fit the registers, 16 above; fewer for a small batch."""
    return min(_power_of_two(count), 32 if states <= 10 else 16)
