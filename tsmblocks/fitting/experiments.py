"""One recording beside one diagram: simulated at the engine's steps, compared at the instants of measurement."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import attrs
import numpy as np

from tsmblocks.common.errors import DataError, RunError, clip, near, nearest
from tsmblocks.common.interpolation import Hold, hold_of_each
from tsmblocks.common.interrupt import checkpoint
from tsmblocks.data import Record
from tsmblocks.data.grid import MIN_RECORD_SAMPLES
from tsmblocks.data.missing_units import how_to_map
from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import input_rows
from tsmblocks.engine.kernel import Kernel, Memory, Steps
from tsmblocks.engine.methods import Method
from tsmblocks.engine.sensitivities import tangent_memory
from tsmblocks.engine.session import gather_signals, single_kernel, start_memory, steps_per_period
from tsmblocks.fitting.holds import resolved_holds
from tsmblocks.model.block import Samples
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.arguments import TimeGrid
from tsmblocks.simulation.compiled import for_inputs
from tsmblocks.simulation.lanes import tangent_kernel

MOST_STEPS = 10**8
"""Most steps of one run. Chosen: the inputs of more do not fit into memory."""
UNEVEN = 5e-3
"""Largest deviation of sample times from an even grid, in steps. Chosen: rounding of printed times explains it."""
PIECE = 2000
"""Samples that lanes run for at a time. Chosen: their rows stay in the cache of the processor."""

MOST_SHARED = 8
"""Arrays that are kept for a recording. Chosen: two steps, inputs with and without derivatives, and the outputs."""

Window = tuple[float | None, float | None]

_SHARED: WeakKeyDictionary[Record, dict[str, np.ndarray]] = WeakKeyDictionary()
"""Arrays made from recordings, by kind: a search prepares hundreds of diagrams for the same recordings."""


@attrs.frozen(eq=False)
class Experiment:
    """A recording prepared for a diagram: the inputs at every stage of every step, and the measured samples.

    ``measured`` has shape (samples, outputs), in the units of the diagram's ports. Sample k lies
    ``share[k]`` of a step after step ``place[k]``. ``counted`` (samples, outputs) is 0 for samples that were not
    measured but interpolated, and 1 for all others; None where all were measured. ``quick`` as for ``kernel_for``.
    """

    name: str
    record: Record = attrs.field(repr=False)
    eq: Equations = attrs.field(repr=False)
    rule: Method
    columns: tuple[int, ...]
    times: TimeGrid
    rows: np.ndarray = attrs.field(repr=False)
    hits: tuple[int, ...]
    t: np.ndarray = attrs.field(repr=False)
    measured: np.ndarray = attrs.field(repr=False)
    place: np.ndarray = attrs.field(repr=False)
    share: np.ndarray | None = attrs.field(repr=False)
    hold: Mapping[str, str] = attrs.field(factory=dict)
    backend: str = ""
    counted: np.ndarray | None = attrs.field(default=None, repr=False)
    quick: bool = False

    @property
    def kernel(self) -> Kernel:
        """The kernel for one run at a time."""
        return single_kernel(self.eq, self.rule, self.columns, self.backend, self.quick)

    def kernel_with_derivatives(self, lanes: int) -> Kernel:
        """The kernel for a run with derivatives in ``lanes`` directions."""
        return tangent_kernel(self.eq, self.rule, self.columns, lanes, self.backend, self.quick)

    def residuals(self, y: np.ndarray) -> np.ndarray:
        """Simulated less measured outputs, 0 where nothing was measured; ``y`` is (samples, outputs)."""
        r: np.ndarray = y - self.measured
        return r if self.counted is None else r * self.counted

    def outputs(self, p: np.ndarray) -> np.ndarray:
        """Simulated outputs at the instants of measurement, shape (samples, outputs)."""
        kernel = self.kernel
        return self.output_columns(kernel, self.run(kernel, start_memory(self.eq, kernel, p, self.times.h)))

    def output_columns(self, kernel: Kernel, y: np.ndarray) -> np.ndarray:
        """Outputs (samples, outputs) from the rows of a kernel for one run."""
        return np.stack([y[:, kernel.layout_y.offset[k]] for k in range(len(self.columns))], axis=1)

    def tangents(self, p: np.ndarray, seeds: np.ndarray, lanes: int) -> tuple[Kernel, Memory]:
        """Kernel and memory of a run with derivatives along ``seeds`` (parameters, up to ``lanes``)."""
        kernel = self.kernel_with_derivatives(lanes)
        padded = np.pad(seeds, ((0, 0), (0, lanes - seeds.shape[1])))
        return kernel, tangent_memory(self.eq, kernel, p, padded, self.times.h)

    def split(self, kernel: Kernel, y: np.ndarray, width: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Outputs, and ``width`` derivatives of each, from the rows of a kernel with derivatives."""
        count, begin, lanes = len(self.columns), kernel.layout_y.offset[0], kernel.plan.lanes
        spans = (kernel.layout_y.span(count + i) for i in range(count))  # outputs first, one number each
        derivatives = [np.broadcast_to(y[:, span], (len(y), lanes))[:, :width] for span in spans]
        return y[:, begin : begin + count], derivatives

    def output_lanes(self, kernel: Kernel, y: np.ndarray) -> np.ndarray:
        """Outputs (samples, outputs, lanes) from the rows of a kernel with lanes."""
        shape = (len(y), kernel.plan.lanes)
        wide = [np.broadcast_to(y[:, kernel.layout_y.span(i)], shape) for i in range(len(self.columns))]
        return np.stack(wide, axis=1)

    def squares(self, kernel: Kernel, memory: Memory, weights: np.ndarray) -> np.ndarray:
        """Sum of squared weighted residuals for each parameter set of ``lanes``, shape (lanes,).

        ``weights`` has shape (outputs,). Nothing symbolic is touched, so this may run in a thread.
        """
        total = np.zeros(kernel.plan.lanes)
        with np.errstate(over="ignore", invalid="ignore"):
            for y, measured, counted in self._pieces(kernel, memory):
                for i, weight in enumerate(weights):
                    r = y[:, kernel.layout_y.span(i)]
                    np.subtract(r, measured[:, i, None], out=r)
                    if counted is not None:
                        r *= counted[:, i, None]
                    total = total + weight**2 * np.einsum("kl,kl->l", r, r)
        return total

    def _pieces(self, kernel: Kernel, memory: Memory) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
        """Rows at the instants of measurement, what was measured and what counts, a few at a time, since many lanes
        fill the caches.
        """
        if self.share is not None:
            yield self.run(kernel, memory), self.measured, self.counted
            return
        every, kept, first = self.times.every, self.times.kept, int(self.place[0])
        pieces = max((kept - 1) // PIECE, 1)
        y = np.empty((kept - (pieces - 1) * PIECE, kernel.layout_y.size))
        for piece in range(pieces):
            a = piece * PIECE
            b = kept if piece == pieces - 1 else a + PIECE
            self._advance(kernel, memory, a * every, min(b, kept - 1) * every, y[: b - a])
            if b > first:
                lead = max(first - a, 0)
                these = slice(a + lead - first, b - first)
                yield y[lead : b - a], self.measured[these], None if self.counted is None else self.counted[these]

    def run(self, kernel: Kernel, memory: Memory, first: int = 0, last: int | None = None) -> np.ndarray:
        """Rows at the instants of measurement within the steps ``first`` to ``last``, which ``memory`` is then at."""
        times, samples = self.times, self.samples_within(first, last)
        last = times.steps if last is None else last
        ends_inside = last < times.steps and self.share is None  # a sample at the last step is in the next part
        rows = (last - first) // times.every + (0 if ends_inside else 1)
        y = np.empty((rows, kernel.layout_y.size))
        self._advance(kernel, memory, first, last, y)
        begin = int(self.place[0]) - first // times.every
        if self.share is None:
            return y[begin + samples.start : begin + samples.stop]
        at, share = self.place[samples] - first, self.share[samples, None]
        with np.errstate(over="ignore", invalid="ignore"):
            between: np.ndarray = (1 - share) * y[at] + share * y[at + 1]
        return between

    def samples_within(self, first: int, last: int | None) -> slice:
        """The samples within the steps ``first`` to ``last`` (None: the end); one at ``last`` belongs to the next."""
        every = self.times.every
        end = len(self.place) if last in (None, self.times.steps) else int(np.searchsorted(self.place * every, last))
        return slice(int(np.searchsorted(self.place * every, first)) if first else 0, end)

    def _advance(self, kernel: Kernel, memory: Memory, first: int, last: int, y: np.ndarray) -> None:
        """Run from step ``first`` to ``last``; where ``y`` has room for it, its last row is at step ``last``."""
        checkpoint()
        times, n = self.times, last - first
        final = len(y) > n // times.every
        steps = Steps(times.start, times.h, first, n, final, self.hits, times.every)
        kernel.advance(memory, self.rows[first : last + 1], y, steps)


def prepare(
    name: str,
    record: Record,
    diagram: Diagram,
    eq: Equations,
    *,
    outputs: Sequence[str],
    rule: Method,
    step: float,
    hold: Hold,
    window: Window,
    backend: str,
) -> Experiment:
    """Make a recording ready for a diagram. Raises DataError for signals or samples that are missing."""
    cut = span(name, record, window)
    times, even = _time_grid(name, record, cut, step)
    t, start, h = record.t[cut], times.start, times.h
    exact = (t - start) / h
    place = np.arange(cut.start, cut.stop) if even else np.minimum(exact.astype(int), times.steps - 1)
    refuse_missing(record, diagram)
    holds = resolved_holds(record, diagram.inports, hold, eq.orders)
    units = tuple(port.unit for port in diagram.inports.values())
    wanted = tuple((k, diagram.unit(k)) for k in outputs)
    given = inputs(record, diagram, holds, times.grid[-1])
    in_run = functools.cache(lambda: for_inputs(eq, diagram, gather_signals(eq, given, times.grid, holds), start, h))

    def rows() -> np.ndarray:
        return input_rows(in_run()[1], start, h, 0, times.steps, rule.instants)

    def measured() -> np.ndarray:
        return np.stack([signal_of(name, record, k, unit)[cut] for k, unit in wanted], axis=1)

    # Tapes belong to one diagram; what was recorded is the same for every candidate of a search.
    kind = repr((eq.u, sorted(eq.delayed_inputs), tuple(diagram.inports), units, holds, times, rule.instants))
    return Experiment(
        name,
        record,
        in_run()[0] if eq.delayed_inputs else eq,
        rule,
        tuple(eq.y.index(eq.aliases[k]) for k in outputs),
        times,
        rows() if eq.tapes else _shared(record, kind, rows),
        steps_per_period(eq, h),
        t,
        _shared(record, repr((wanted, cut)), measured),
        place,
        None if even else exact - place,
        holds,
        backend,
        _counted(record, outputs, cut),
    )


def _time_grid(name: str, record: Record, cut: slice, step: float) -> tuple[TimeGrid, bool]:
    """The steps of the simulation of a recording, and whether its samples lie on them."""
    t, start, own = record.t[cut], float(record.t[0]), grid_step(record.t)
    every = max(1, round(own / step))
    even = lies_on_grid(record.t, own) and abs(own / step / every - 1) < UNEVEN
    h = own / every if even else step
    steps = (cut.stop - 1) * every if even else math.ceil((t[-1] - start) / h - UNEVEN)
    times = TimeGrid(start, h, max(steps, 1), every if even else 1)
    if times.steps > MOST_STEPS:
        raise RunError(
            f"experiment '{name}': a step of {h:g} s makes {times.steps:.3g} steps of its {t[-1] - start:g} "
            f"s; {MOST_STEPS:.0e} are the most."
        )
    if h > t[-1] - start:
        raise RunError(f"experiment '{name}': the step of {h:g} s is longer than the run of {t[-1] - start:g} s.")
    return times, even


def _shared(record: Record, kind: str, make: Callable[[], np.ndarray]) -> np.ndarray:
    """An array made from a recording, which all diagrams share for as long as the recording lives."""
    known = _SHARED.setdefault(record, {})
    if kind not in known:
        while len(known) >= MOST_SHARED:
            known.pop(next(iter(known)))
        known[kind] = make()
        known[kind].setflags(write=False)
    return known[kind]


def _counted(record: Record, outputs: Sequence[str], cut: slice) -> np.ndarray | None:
    """1 for each sample of the outputs that was measured, 0 for one that was interpolated; None where all were."""
    if not any(record.filled[k][cut].any() for k in outputs if k in record.filled):
        return None
    gone = [record.filled.get(k, np.zeros(len(record), dtype=bool))[cut] for k in outputs]
    return 1.0 - np.stack(gone, axis=1)


def refuse_missing(record: Record, diagram: Diagram) -> None:
    """Raise DataError for an input of the diagram that was not recorded."""
    missing = [k for k in diagram.inports if k not in record]
    if missing:
        way = how_to_map(missing[0], bare=not record.units, known=record.names, unit=diagram.unit(missing[0]))
        raise DataError(
            f"{record.called}: '{diagram.title}' needs its input '{missing[0]}', and the "
            f"recording has no such signal.{near(missing[0], record.names)} "
            f"If it has another name there, map it when reading: {way}."
        )


def inputs(record: Record, diagram: Diagram, hold: Hold, until: float = -math.inf) -> dict[str, Any]:
    """The diagram's inputs from a recording, extrapolated to the end of a step at ``until`` [s].

    Raises DataError for one that is not there.
    """
    refuse_missing(record, diagram)
    wanted, holds = diagram.inports, hold_of_each(hold, list(diagram.inports))
    own = grid_step(record.t)  # times kept with few digits: a held value must not come a step late
    t = record.t[0] + own * np.arange(len(record)) if lies_on_grid(record.t, own) else record.t
    beyond = until - float(t[-1]) if until > t[-1] + 1e-9 * own else 0.0
    made = {}
    for k, port in wanted.items():
        y = signal_of(record.name, record, k, port.unit)
        if not beyond:
            made[k] = Samples(t, y, holds[k])
            continue
        more = 0.0 if holds[k] == "zero" else beyond * (y[-1] - y[-2]) / (t[-1] - t[-2])
        made[k] = Samples(np.append(t, until), np.append(y, y[-1] + more), holds[k])
    return made


def signal_of(name: str, record: Record, k: str, unit: str) -> np.ndarray:
    """A signal in a unit. Raises DataError for samples that are not finite."""
    y = record.values(k, unit)
    bad = np.flatnonzero(~np.isfinite(y))
    if len(bad):
        raise DataError(
            f"experiment '{name}': sample {bad[0]} of {k} is not finite (t = {record.t[bad[0]]:g} s, "
            f"value = {y[bad[0]]:g})."
        )
    return y


def compared(records: Mapping[str, Record], diagram: Diagram, given: Sequence[str] | None) -> tuple[str, ...]:
    """Outputs that are compared: those given, or all that every recording has. Raises DataError for none."""
    for name in given or ():
        if name not in diagram.outputs:
            raise DataError(f"diagram '{diagram.title}' has no output '{name}'.{near(name, diagram.outputs)}")
    for record in records.values():
        gone = [k for k in given or () if k not in record]
        if gone:
            raise DataError(
                f"{record.called}: there is no signal '{gone[0]}' to compare with.{near(gone[0], record.names)}"
            )
    found = tuple(given or (k for k in diagram.outputs if all(k in r for r in records.values())))
    if not found:
        bare = [r for r in records.values() if not any(k in r for k in diagram.outputs)]
        if diagram.outputs and not bare:
            each = "; ".join(
                f"{name}: {', '.join(k for k in diagram.outputs if k in r)}" for name, r in records.items()
            )
            raise DataError(
                f"no output of '{diagram.title}' was measured in all experiments ({clip(each)}). Give "
                "those together that have an output in common."
            )
        some = next(iter(bare or records.values()))
        known = [k for k in some.names if k not in diagram.inputs]
        name = next((k for k in diagram.outputs if nearest(k, known)), next(iter(diagram.outputs), "x_out"))
        way = how_to_map(
            name, bare=not some.units, known=known, unit=diagram.unit(name) if name in diagram.outputs else ""
        )
        raise DataError(
            f"{some.called}: none of the outputs of '{diagram.title}' "
            f"({', '.join(diagram.outputs) or 'it has none'}) was measured; the recording has {', '.join(some.names)}. "
            f"Map one when reading: {way}; or give the diagram an output of that name."
        )
    return found


def span(name: str, record: Record, window: Window) -> slice:
    """The samples from ``window[0]`` to ``window[1]`` [s]. Raises DataError for fewer than ``MIN_RECORD_SAMPLES``."""
    low, high = (-math.inf if window[0] is None else window[0]), (math.inf if window[1] is None else window[1])
    first, last = np.searchsorted(record.t, low), int(np.searchsorted(record.t, high, side="right"))
    if last - first < MIN_RECORD_SAMPLES:
        count = max(last - int(first), 0)
        raise DataError(
            f"experiment '{name}': the window{_ends(window)} holds {count} "
            f"sample{'s' if count != 1 else ''}, and at least {MIN_RECORD_SAMPLES} are needed; it was recorded from "
            f"{record.t[0]:g} to {record.t[-1]:g} s."
        )
    return slice(int(first), last)


def _ends(window: Window) -> str:
    """`` from 1 to 5 s``; ends that are open are left out."""
    words = [f" {word} {end:g}" for word, end in zip(("from", "to"), window, strict=True) if end is not None]
    return f"{''.join(words)} s{' on' if window[1] is None else ''}" if words else ""


def grid_step(t: np.ndarray) -> float:
    """The step of an even grid from its ends, else the median step [s]."""
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    return _roundest(t, mean) if lies_on_grid(t, mean) else float(np.median(np.diff(t)))


def _roundest(t: np.ndarray, step: float) -> float:
    """The step of fewest digits on whose grid the instants lie as closely: rounded times blur the mean step.

    A sample period must divide the step exactly, and 0.001 s in single precision has a mean of 0.00100000001 s.
    """
    most = 2 * _off(t, step) + 4 * np.finfo(float).eps * float(np.abs(t[[0, -1]]).max())
    for digits in range(1, 13):
        rounded = float(f"{step:.{digits}g}")
        if abs(rounded - step) * (len(t) - 1) <= most and _off(t, rounded) <= most:
            return rounded
    return step


def _off(t: np.ndarray, step: float) -> float:
    """The largest deviation of the instants from an even grid [s]."""
    return float(np.abs(t - t[0] - step * np.arange(len(t))).max())


def lies_on_grid(t: np.ndarray, step: float) -> bool:
    """Whether the instants lie on an even grid, up to rounding."""
    return _off(t, step) <= UNEVEN * step
