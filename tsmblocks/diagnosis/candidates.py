"""Candidates: every effect on every admissible signal, as a diagram with one more block, and its trial values."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import AlgebraicLoop, DiagramError, TsmError
from tsmblocks.common.interpolation import ORDERS
from tsmblocks.common.interrupt import checkpoint
from tsmblocks.common.tables import unique_names
from tsmblocks.common.units import is_one_of, parse
from tsmblocks.diagnosis.insertion_point import InsertionPoint
from tsmblocks.diagnosis.insertion_points import is_no_motion, is_not_mechanical, is_speed
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.diagnosis.replacements import ReplacementPoint, replacements
from tsmblocks.effects import Effect, Replacement, Scales, Span, Trials, span_of
from tsmblocks.effects.variants import with_opposite_motion
from tsmblocks.model.diagram import Diagram
from tsmblocks.model.wires import end_text
from tsmblocks.simulation.compiled import equations

SPECTRAL_LINE_COUNT = 6
"""Frequencies passed to effects that have a frequency. Chosen: an effect tries four to six of them."""
MAX_SPECTRUM_SAMPLES = 4_000_000
"""Samples of the whole session from which its spectrum is not computed. Chosen: for memory, 32 MB a row."""
REST_HALF_RANGE = 1e-12
"""Half range of a signal, in its unit, up to which it is at rest. Chosen: rounding."""


def unit_of_signal(diagram: Diagram, signal: str) -> str:
    """The unit of a signal; empty where none is known, or the signal is not in this part of a diagram."""
    try:
        return diagram.unit(signal)
    except (TsmError, KeyError):
        return ""


def whole_turn(unit: str) -> float:
    """A whole turn in a unit; zero where that is not known, or is not one of an angle."""
    return 2 * math.pi / parse(unit).factor if is_one_of(unit, {parse("rad").dimension}) else 0.0


@attrs.frozen(eq=False)
class Candidate:
    """An effect at an insertion point: ``diagram`` is the model's with ``block`` added, at the null of the effect.

    Of a replacement, ``block`` is the name of the block that is replaced, and the parameters are its starting values.
    """

    effect: Effect
    point: InsertionPoint
    block: str
    diagram: Diagram
    trials: Trials
    scales: Scales | None = None
    """The scales of the signals it acts on, in which its sizes are reported; None where these are not needed."""

    @property
    def words(self) -> str:
        """The effect in words that fit the quantity of the signal on which it acts."""
        return self.effect.words_on(unit_of_signal(self.diagram, self.point.signal))

    @property
    def free(self) -> tuple[str, ...]:
        """Full names of the fitted parameters of the effect."""
        return tuple(f"{self.block}.{k}" for k in self.effect.free)

    @property
    def local(self) -> tuple[str, ...]:
        """Full names of those with a separate value in each experiment."""
        return tuple(f"{self.block}.{k}" for k in self.effect.local)

    @property
    def corners(self) -> tuple[str, ...]:
        """Full names of its parameters that smooth a corner: at their lower bound it is sharp."""
        return tuple(f"{self.block}.{k}" for k in self.effect.sharp)

    @property
    def rounding(self) -> tuple[str, ...]:
        """Full names of its parameters at whose lower bound a corner is sharp enough."""
        return (*self.corners, *(f"{self.block}.{k}" for k in self.effect.rounds))

    @property
    def replaced(self) -> str:
        """The name of the block that is replaced; empty for an effect that adds a block."""
        return self.block if isinstance(self.effect, Replacement) else ""

    def name_in_block(self, parameter: str) -> str:
        """The name that a parameter has in the block of the effect: ``time`` of ``dead_time.time``."""
        return parameter.removeprefix(f"{self.block}.")

    def owns(self, parameter: str) -> bool:
        """Whether a parameter is one of the block that replaces another."""
        return bool(self.replaced) and parameter.startswith(f"{self.replaced}.")

    @property
    def initialised_states(self) -> tuple[str, ...]:
        """Full names of the states whose initial value is that of the wire."""
        return tuple(f"{self.block}.{k}" for k in self.effect.settled)

    @property
    def states_before(self) -> dict[str, str]:
        """Full names of states of a replacement, and those that they have in the block that it replaces."""
        pairs = self.effect.relative.states if isinstance(self.effect, Replacement) else {}
        return {f"{self.block}.{new}": f"{self.block}.{old}" for new, old in pairs.items()}

    @property
    def has_own_instants(self) -> bool:
        """Whether it is a sudden change at a separate instant in each experiment."""
        return any(name in self.effect.local for name in self.trials.refine)

    @property
    def transition_time(self) -> float:
        """Transition time [s] of a change at one instant."""
        prefix = self.trials.refine[0].rpartition(".")[0]
        return self.diagram.parameters[".".join(filter(None, (self.block, prefix, "width")))]

    @property
    def key(self) -> tuple[str, str, str]:
        """The key of a candidate within a round."""
        return self.effect.name, self.effect.variant, f"{self.point.after}>{self.point.before}"


@attrs.frozen(eq=False)
class WireSignals:
    """The signals of a fitted model by name, one array for each experiment, and their sampling steps [s].

    ``units`` are those of the signals, empty where one is not known. ``scales_of`` makes ``Scales`` of two spans.
    ``ranges`` are those of the signals that are outputs, as measured: a model without an end stop moves far beyond it.
    """

    signals: dict[str, list[np.ndarray]]
    steps: list[float]
    units: Mapping[str, str]
    scales_of: Callable[[Span, Span], Scales]
    ranges: Mapping[str, tuple[float, float]] = attrs.field(factory=dict)

    def scales(self, point: InsertionPoint) -> Scales:
        """The scales that an effect at an insertion point has to do with."""
        return self.scales_of(self.span(point.signal), self.span(point.other or point.signal))

    def span(self, signal: str) -> Span:
        """Range and rate of a signal; the range as measured where it is an output that moves."""
        span = attrs.evolve(span_of(self.signals[signal], self.steps), turn=whole_turn(self.units[signal]))
        if signal not in self.ranges or not _moves(span):
            return span
        low, high = self.ranges[signal]
        return attrs.evolve(span, low=low, high=high)

    def initial_values(self, signal: str) -> list[float]:
        """The initial value of a signal in each experiment."""
        return [float(y[0]) for y in self.signals[signal]]


def wire_signals(model: Model, points: Sequence[InsertionPoint]) -> WireSignals:
    """The signals at the insertion points of a model, simulated once more."""
    names = dict.fromkeys(k for point in points for k in (point.signal, point.other) if k)
    runs = model.signals(inner_signal(model.diagram, k) for k in names)
    signals = {k: [y[:, i] for y in runs] for i, k in enumerate(names)}
    times = [experiment.t for experiment in model.setup.experiments]
    steps = [experiment.record.step for experiment in model.setup.experiments]
    session = functools.partial(
        Scales,
        start=min(float(t[0]) for t in times),
        stop=max(float(t[-1]) for t in times),
        step=max(steps),
        shortest=min(float(t[-1] - t[0]) for t in times),
        lines=spectral_lines(model),
        one_clock=not _overlap(model),
    )
    units = {k: unit_of_signal(model.diagram, k) for k in names}
    return WireSignals(signals, steps, units, session, measured_ranges(model))


def with_scales_in(model: Model, some: Sequence[Candidate]) -> list[Candidate]:
    """Candidates with the scales of their signals in a model that has them all.

    Without them a signal in front of an output has the range of the measurement: a bent sensor shows another one.
    """
    wires = wire_signals(model, [one.point for one in some])
    return [attrs.evolve(one, scales=wires.scales(one.point)) for one in some]


def measured_ranges(model: Model) -> dict[str, tuple[float, float]]:
    """The range in which each output was measured, by the name of the signal that it shows."""
    found, experiments = dict[str, tuple[float, float]](), model.setup.experiments
    for i, name in enumerate(model.setup.outputs):
        parts = [x.measured[:, i] if x.counted is None else x.measured[x.counted[:, i] > 0, i] for x in experiments]
        values = np.concatenate(parts)
        if values.size:
            found[end_text(model.diagram.shown[name])] = float(values.min()), float(values.max())
    return found


def inner_signal(diagram: Diagram, signal: str) -> str:
    """The name of a signal in the equations: that of the inner block, where a diagram is used as a block."""
    head, _, port = signal.partition(".")
    block = diagram.blocks.get(head)
    if not isinstance(block, Diagram):
        return signal
    return f"{head}.{inner_signal(block, '.'.join(filter(None, block.shown[port])))}"


def spectral_lines(model: Model) -> tuple[float, ...]:
    """Frequencies [Hz] of the strongest lines in the residual, over the whole session, strongest first.

    Recordings that overlap in time have no common clock: their power spectra are added.
    """
    experiments, segments = model.setup.experiments, model.problem.segments
    count, step = experiments[0].measured.shape[1], min(one.record.step for one in experiments)
    start, end = min(float(one.t[0]) for one in experiments), max(float(one.t[-1]) for one in experiments)
    size = int((end - start) / step) + 1
    if size > MAX_SPECTRUM_SAMPLES:
        return ()
    power, padded = np.zeros(1), 1 << int(4 * size - 1).bit_length()
    alone = _overlap(model)
    for k in range(count):
        sessions = dict[str, np.ndarray]()
        for experiment, rows in zip(experiments, segments[k::count], strict=True):
            row = sessions.setdefault(experiment_of(experiment.name) if alone else "", np.zeros(size))
            part = model.r[rows]
            row[np.minimum(((experiment.t - start) / step + 0.5).astype(int), size - 1)] = part - part.mean()
        power = power + sum(np.abs(np.fft.rfft(row, padded)) ** 2 for row in sessions.values())
    frequency = np.arange(len(power)) / (padded * step)
    resolution = 2 / (end - start)
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    peaks = peaks[frequency[peaks] > resolution]
    chosen: list[float] = []
    for f in frequency[peaks[np.argsort(-power[peaks], kind="stable")]].tolist():
        if len(chosen) < SPECTRAL_LINE_COUNT and all(abs(f - other) > resolution for other in chosen):
            chosen.append(f)
    return tuple(chosen)


def _overlap(model: Model) -> bool:
    """Whether recordings overlap in time, so that their times are not those of one clock."""
    spans = dict[str, tuple[float, float]]()
    for one in model.setup.experiments:
        name, first, last = experiment_of(one.name), float(one.t[0]), float(one.t[-1])
        low, high = spans.get(name, (first, last))
        spans[name] = min(low, first), max(high, last)
    ordered = sorted(spans.values())
    return any(after[0] < before[1] for before, after in itertools.pairwise(ordered))


def candidates(
    model: Model, effects: Sequence[Effect], wires: WireSignals, points: Sequence[InsertionPoint]
) -> list[Candidate]:
    """Every effect on every admissible signal at which these data excite it.

    Left out are edits that make an algebraic loop, and those that differentiate inputs with a zero-order hold.
    """
    found: list[Candidate] = []
    base, orders = model.fitted_diagram, _available_orders(model)
    recorded = {name: unit for one in model.setup.experiments for name, unit in one.record.units.items()}
    pieces = any(experiment_of(one.name) != one.name for one in model.setup.experiments)
    for effect in effects:
        for point in points:
            if (point.place, point.adds) != (effect.place, effect.adds) or (pieces and effect.local):
                continue
            unit = base.unit(point.signal) or recorded.get(point.signal, "")
            if not acts_on(effect, unit):
                continue
            scales = wires.scales(point)
            trials = _trials(effect, scales)
            if trials is None:
                continue
            effect.accepts(trials, scales)
            name = unique_names([*base.blocks, effect.name])[-1]
            checkpoint()
            placed = with_opposite_motion(effect) if point.opposite else effect
            edited = _with_effect(base, name, placed, point, trials, orders)
            if edited is not None:
                found.append(Candidate(placed, point, name, edited, trials, scales))
    return found


def acts_on(effect: Effect, unit: str) -> bool:
    """Whether an effect is one of signals of this unit; of those without a unit each is."""
    if effect.mechanical and is_not_mechanical(unit):
        return False
    return not effect.of_motion or not (is_no_motion(unit) or is_speed(unit))


def _available_orders(model: Model) -> dict[str, float]:
    """The highest time derivative of each input that exists in all experiments."""
    orders: dict[str, float] = {}
    for experiment in model.setup.experiments:
        for name, hold in experiment.hold.items():
            orders[name] = min(orders.get(name, math.inf), ORDERS.get(hold, math.inf))
    return orders


def replacement_candidates(model: Model, wires: WireSignals, points: Sequence[ReplacementPoint]) -> list[Candidate]:
    """Every replacement of a block of the model by a relative, where its signals are not at rest."""
    found: list[Candidate] = []
    base, orders = model.fitted_diagram, _available_orders(model)
    moving = [p for p in points if _moves(wires.span(p.signal)) and _moves(wires.span(p.other))]
    for effect, point in replacements(base, moving, wires.scales):
        scales = wires.scales(point)
        trials = effect.trials(scales)
        if trials is None:
            continue
        effect.accepts(trials, scales)
        checkpoint()
        edited = _with_effect(base, point.replaced, effect, point, trials, orders)
        if edited is not None:
            found.append(Candidate(effect, point, point.replaced, edited, trials, scales))
    return found


def _moves(span: Span) -> bool:
    return span.reach > REST_HALF_RANGE and span.fastest > 0


def _trials(effect: Effect, scales: Scales) -> Trials | None:
    """The trial values of an effect; None where signals at rest do not excite it (but for effects of time)."""
    if _moves(scales.wire) and _moves(scales.other):
        return effect.trials(scales)
    trials = effect.trials(scales) if effect.family == "time" else None
    sized = trials is not None and all(abs(size) > REST_HALF_RANGE for size in trials.strengths.values())
    return trials if sized else None


def _clipped_to_bounds(edited: Diagram, name: str, effect: Effect, trials: Trials) -> dict[str, float]:
    """Parameters of an effect outside its bounds, moved to the nearest bound, such as an initial state of zero where
    the signal never is zero. The null stays.
    """
    result = {}
    for key, (low, high) in trials.bounds.items():
        value = edited.parameters[f"{name}.{key}"]
        nearest = min(max(value, -math.inf if low is None else low), math.inf if high is None else high)
        if key not in effect.null and nearest != value:
            result[f"{name}.{key}"] = nearest
    return result


def _with_effect(
    base: Diagram, name: str, effect: Effect, point: InsertionPoint, trials: Trials, orders: Mapping[str, float]
) -> Diagram | None:
    """The base with an effect; None where it is not admissible, or takes derivatives of inputs above ``orders``."""
    try:
        edited = point.put(base, name, effect.block)
        numbers = {**trials.fixed, **trials.shapes[0]}  # shapes that have no strength are fitted from here
        edited = edited.with_parameters({f"{name}.{k}": v for k, v in numbers.items()})
        edited = edited.with_parameters(_clipped_to_bounds(edited, name, effect, trials))
        eq = equations(edited)
        if len(eq.loops) > len(equations(base).loops):
            return None  # it closes an algebraic loop
    except (AlgebraicLoop, DiagramError):  # this block is not admissible on this wire
        return None
    same = all(edited.unit(k) == base.unit(k) for k in (*base.inputs, *base.outputs))
    had = all(order <= orders.get(name, math.inf) for name, order in eq.orders.items())
    return edited if same and had else None  # a block for angles would change the unit of a voltage
