"""Parameters and sizes of effects with confidence intervals, from the last model of a diagnosis."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType

import attrs
import numpy as np

from tsmblocks.blocks import Gain
from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.tables import listed
from tsmblocks.common.units import is_unit, parse
from tsmblocks.diagnosis.candidate_units import displayed_unit, units_on_wire
from tsmblocks.diagnosis.candidates import Candidate, unit_of_signal
from tsmblocks.diagnosis.control_loops import in_front
from tsmblocks.diagnosis.determined import directions_without_effect, uncertainty_of_effects
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.plain_values import limit_quantity
from tsmblocks.diagnosis.presentation import with_interval
from tsmblocks.diagnosis.segment import DetectionLimit, Quantity
from tsmblocks.effects import catalogue
from tsmblocks.effects.effect import sizes_of
from tsmblocks.effects.sizes import PERCENT
from tsmblocks.fitting.identifiability import SMALL
from tsmblocks.fitting.inner_products import square
from tsmblocks.fitting.parameters import numbers
from tsmblocks.fitting.recordings import as_recorded
from tsmblocks.fitting.setup import Setup
from tsmblocks.fitting.statistics import intervals, moved
from tsmblocks.fitting.summary import unknown_sizes
from tsmblocks.model.diagram import Diagram

LEVEL = 0.95
"""Confidence level of intervals. Source: convention."""
DIFFERENCE = 1e-3
"""Step of the derivatives of sizes [standard errors]. Chosen: sizes are smooth over it, and rounding is not seen."""
MAX_OWN_SHARE = 0.01
"""Share of what a common change of separate sizes does to the outputs that nothing else does, up to which other
parameters absorb it. Chosen: a tenth of the change."""
MIN_CUT = 0.002
"""Part of the range of a signal that a limit cuts off, from which it is reported. Chosen: less is next to nothing."""

NUMBERED = re.compile(r"_\d+$")
"""The number of a block that has the name of an effect: the second of one effect has it."""
OF_ACCELERATIONS = (("m", "mass", "force"), ("rad", "inertia", "torque"))
FORCES = {parse(f"{unit}/s^2").dimension: (by, force) for unit, by, force in OF_ACCELERATIONS}
"""By what an acceleration is multiplied for a force, and what force that is."""


@attrs.frozen(eq=False)
class _Size:
    """A function of the parameters in columns ``at``, with its ``gradient`` by them."""

    value: float
    unit: str
    gradient: np.ndarray
    at: tuple[int, ...]

    @property
    def of(self) -> set[int]:
        """The columns that it depends on."""
        return {self.at[k] for k in np.flatnonzero(self.gradient)}

    def relative_to(self, other: _Size, of_gain: bool) -> _Size:
        """The difference from another one; of errors of gains in per cent that of the ratio of these gains."""
        ratio = (PERCENT + self.value) / (PERCENT + other.value) if of_gain else 1.0
        scale = PERCENT / (PERCENT + other.value) if of_gain else 1.0
        gradient = scale * np.append(self.gradient, -ratio * other.gradient)
        return _Size(scale * (self.value - other.value), self.unit, gradient, self.at + other.at)


@attrs.frozen(eq=False)
class Estimate:
    """The parameters of the last model, with covariance (p, p) and degrees of freedom (p,).

    ``recorded`` are the units of the recorded signals, in which quantities are displayed.
    """

    model: Model
    covariance: np.ndarray
    freedom: np.ndarray
    recorded: Mapping[str, str] = attrs.field(factory=dict)

    @classmethod
    def of(cls, models: Sequence[Model]) -> Estimate:
        """The estimate of the last of some models; the first one has no effects."""
        model = models[-1]
        found = uncertainty_of_effects(model, models[0])
        freedom = np.broadcast_to(found.freedom, len(model.theta))
        return cls(model, found.covariance, freedom, recorded_units(model.setup))

    def parameters(self, candidate: Candidate) -> dict[str, Quantity]:
        """The fitted parameters of an effect; those with a value in each experiment come last."""
        theta = self.model.theta
        low, high = intervals(theta, self.covariance, self.freedom)
        every = zip(self.model.problem.unknowns.items, theta, low, high, strict=True)
        found = {}
        for item, value, below, above in sorted(every, key=lambda one: bool(one[0].experiment)):
            if item.parameter in candidate.free:
                unit = displayed_unit(item, candidate, self.recorded)
                found[candidate.name_in_block(item.name)] = Quantity(float(value), float(below), float(above), unit)
        return found

    def sizes(self, candidate: Candidate, reference: str | None = None) -> dict[str, Quantity]:
        """The sizes of an effect, those with a value in each experiment under ``name@experiment``.

        Intervals are those of the delta method: the size is linear in the parameters within their uncertainty. Where
        there is a ``reference`` (by default the one that is needed), they are relative to its size.
        """
        items = [(k, one) for k, one in enumerate(self.model.problem.unknowns.items) if one.parameter in candidate.free]
        experiments = list(dict.fromkeys(one.experiment for _, one in items if one.experiment))
        reference = self.reference(candidate) if reference is None else reference
        own = dict[str, _Size]()
        for experiment in experiments or [""]:
            columns = {
                candidate.name_in_block(one.parameter): k for k, one in items if one.experiment in ("", experiment)
            }
            local = {k for k, one in items if one.experiment == experiment}
            for name, size in self._sizes(candidate, columns).items():
                is_local = bool(experiment) and bool(size.of & local)
                own[f"{name}@{experiment}" if is_local else name] = size
        found = {}
        for key, size in own.items():
            name, at, _ = key.partition("@")
            if not self._is_reached(candidate, size):
                continue
            if at and reference and (base := own.get(f"{name}@{reference}")) is not None:
                size = size.relative_to(base, candidate.effect.of_gain)
            found[key] = self._of_instant(self._quantity(size), candidate, size)
        return dict(sorted(found.items(), key=lambda one: "@" in one[0]))

    def _of_instant(self, found: Quantity, candidate: Candidate, size: _Size) -> Quantity:
        """The size, without an interval where it is an instant that may be any: one within a rest."""
        items = self.model.problem.unknowns.items
        of = {candidate.name_in_block(items[k].parameter) for k in size.of}
        if not of or not of <= set(candidate.trials.refine):
            return found
        longest = max(float(np.ptp(one.t)) for one in self.model.setup.experiments)
        return attrs.evolve(found, low=-np.inf, high=np.inf) if found.high - found.low > 2 * longest else found

    def _is_reached(self, candidate: Candidate, size: _Size) -> bool:
        """Whether the signal reaches a size that is a limit; a fit leaves others at the edge of its range."""
        of, block, scales = size.of, candidate.effect.block, candidate.scales
        if len(of) != 1 or scales is None:
            return True
        (column,) = of
        name = candidate.name_in_block(self.model.problem.unknowns.items[column].parameter)
        wire = scales.other if isinstance(block, Diagram) else scales.wire
        fields = numbers(block).get(name, []) if isinstance(block, Diagram) else [block.fields().get(name)]
        if not any(one is not None and one.opposite and one.acts_at for one in fields):
            return True
        limit = self.model.theta[column]
        margin = MIN_CUT * (wire.high - wire.low)
        return bool(wire.low + margin < limit < wire.high - margin)

    def reference(self, candidate: Candidate) -> str:
        """The experiment from which the separate sizes of an effect are counted; empty where none is needed.

        A change of all of them by as much may be absorbed by parameters of the model, such as the gain of the diagram
        beside gains that differ between recordings. The one nearest to the median counts as zero: most recordings then
        have no effect, where one of them has another gain.
        """
        local = {
            one.experiment: k
            for k, one in enumerate(self.model.problem.unknowns.items)
            if one.experiment and one.parameter in candidate.free
        }
        if len(candidate.local) != 1 or len(local) < 2:
            return ""
        at, J = list(local.values()), self.model.J
        common = J @ np.isin(np.arange(J.shape[1]), at).astype(float)
        rest = common + J @ moved(J, common, held=np.eye(J.shape[1])[at])
        if square(rest) > MAX_OWN_SHARE * square(common):
            return ""
        values = self.model.theta[at]
        return list(local)[int(np.argmin(np.abs(values - np.median(values))))]

    def is_clear_of_zero(self, candidate: Candidate) -> bool:
        """Whether a size of an effect that is zero without it is determined; True where it has no such size.

        The confidence interval of at least one excludes zero, at a level that allows for the largest of q (Sidak).
        """
        own = self._zero_without(candidate, self.sizes(candidate))
        return not own or _any_clear(own.values())

    def absent_in(self, candidate: Candidate, sizes: Mapping[str, Quantity]) -> tuple[str, ...]:
        """The experiments in which none of the ``sizes`` that are zero without the effect is clear of zero."""
        by_experiment = dict[str, list[Quantity]]()
        for key, one in self._zero_without(candidate, sizes).items():
            by_experiment.setdefault(key.partition("@")[2], []).append(one)
        absent = [name for name, own in by_experiment.items() if name and not _any_clear(own)]
        return tuple(absent) if len(absent) < len(by_experiment) else ()

    def _zero_without(self, candidate: Candidate, sizes: Mapping[str, Quantity]) -> dict[str, Quantity]:
        """Those of the sizes of an effect that are zero without it."""
        values = {candidate.name_in_block(k): v for k, v in self.model.values.items()}
        null = _sizes_with(candidate, {**values, **candidate.effect.null}, units_on_wire(candidate, self.recorded))
        return {key: one for key, one in sizes.items() if null.get(key.partition("@")[0], (1.0, ""))[0] == 0}

    def forces(self, candidate: Candidate, sizes: Mapping[str, Quantity]) -> dict[str, str]:
        """In phrases what ``sizes`` of an effect that are accelerations are as forces, by the name of the size."""
        diagram, found = self.model.fitted_diagram, {}
        own = {one: k for k, one in enumerate(self.model.problem.unknowns.names) if "@" not in one}
        for name, size in sizes.items():
            gain = _gain_of_force(size, candidate.point.signal, diagram)
            if gain and gain in own and "@" not in name:
                over = self._over(candidate, name, own[gain], own)
                if over is None:
                    continue
                size = over
            elif gain:
                size = _divided(size, abs(diagram.parameters[gain]))
            if text := as_force(size, candidate.point.signal, diagram):
                found[name] = text
        return found

    def _over(self, candidate: Candidate, name: str, gain: int, own: Mapping[str, int]) -> Quantity | None:
        """A size over the gain in a column, with its interval; None where values that fit as well give another one.

        Of all forces in a model only the ratios may be determined, as where no force is measured.
        """
        columns = {candidate.name_in_block(k): own[k] for k in candidate.free if k in own}
        value, unit, gradient = self._gradients(candidate, columns)[name]
        by, at = self.model.theta[gain], [*columns.values(), gain]
        found = _Size(value / abs(by), unit, np.append(gradient, -value / by) / abs(by), tuple(at))
        lengths = unknown_sizes(self.model.problem, self.model.theta, self.model.J)
        moves = (lengths[:, None] * directions_without_effect(self.model))[at]
        if np.abs(found.gradient @ moves).max(initial=0.0) > SMALL * abs(found.value):
            return None
        return self._quantity(found)

    def _sizes(self, candidate: Candidate, columns: Mapping[str, int]) -> dict[str, _Size]:
        """Sizes with the parameters in some columns."""
        at = tuple(columns.values())
        return {
            name: _Size(value, unit, gradient, at)
            for name, (value, unit, gradient) in self._gradients(candidate, columns).items()
        }

    def _gradients(self, candidate: Candidate, columns: Mapping[str, int]) -> dict[str, tuple[float, str, np.ndarray]]:
        """Sizes with the parameters in some columns, with their units and gradients by these parameters."""
        at, units = list(columns.values()), units_on_wire(candidate, self.recorded)
        theta, wide = self.model.theta[at], np.sqrt(np.diag(self.covariance)[at])
        values = _sizes(candidate, columns, theta, units)
        steps = np.where(np.isfinite(wide) & (wide > 0), DIFFERENCE * wide, 1e-6 * np.maximum(np.abs(theta), 1e-6))
        sides = [
            [_sizes(candidate, columns, theta + sign * step * row, units) for sign in (1, -1)]
            for row, step in zip(np.eye(len(at)), steps, strict=True)
        ]
        found = {}
        for name, (value, unit) in values.items():
            if not all(name in side for both in sides for side in both):
                continue
            gradient = np.array([(up[name][0] - down[name][0]) for up, down in sides]) / (2 * steps)
            found[name] = value, unit, gradient
        return found

    def _quantity(self, size: _Size) -> Quantity:
        """A size with its interval."""
        moved_by = np.flatnonzero(size.gradient)
        rows, gradient = np.asarray(size.at)[moved_by], size.gradient[moved_by]
        variance = gradient @ self.covariance[np.ix_(rows, rows)] @ gradient
        freedom = self.freedom[rows].min(initial=np.inf)  # the least of those it depends on is on the safe side
        low, high = intervals(np.array([size.value]), np.array([[max(variance, 0.0)]]), np.array([freedom]))
        return Quantity(size.value, float(low[0]), float(high[0]), size.unit)


def _any_clear(sizes: Collection[Quantity]) -> bool:
    """Whether the interval of at least one size excludes zero, at a level that allows for the largest of q (Sidak)."""
    from scipy.special import ndtri

    wider = ndtri((1 + LEVEL ** (1 / max(len(sizes), 1))) / 2) / ndtri((1 + LEVEL) / 2)
    return any(abs(one.value) > wider * (one.high - one.low) / 2 for one in sizes)


def detectable_size(
    candidate: Candidate,
    parameter: str,
    limit: float,
    shape: Mapping[str, float],
    recorded: Mapping[str, str] = MappingProxyType({}),
) -> tuple[str, float, str]:
    """The size, with its name and unit, that an effect has at the detection limit of a parameter.

    ``recorded`` are the units of the recorded signals.

    It is the first that is in proportion to this parameter whatever the others are, at all shapes of the trials; else
    the first that is so for the ``shape`` that has this limit; else, where the size is part of the shape, the first of
    this shape. Empty where there is none.
    """
    units, null, shapes = units_on_wire(candidate, recorded), dict(candidate.effect.null), candidate.trials.shapes
    lowest = min((one.get(parameter, 0.0) for one in shapes), default=0.0)
    negative = shape.get(parameter, lowest) < 0  # a lower limit; a strength has no sign
    values = (-abs(limit), -2 * abs(limit)) if negative else (limit, 2 * limit)
    for some in (shapes, [dict(shape)]):
        at = [[_sizes_with(candidate, {**null, **one, parameter: value}, units) for one in some] for value in values]
        for name, (value, unit) in at[0][0].items():
            ratios = [one.get(name, (np.nan, ""))[0] / value for row in at for one in row] if value else []
            if ratios and np.allclose(ratios, [1.0] * len(some) + [2.0] * len(some)):
                return name, value if negative else abs(value), unit
    whole = {} if candidate.trials.strengths else _sizes_with(candidate, {**null, **shape}, units)
    return next(((name, value, unit) for name, (value, unit) in whole.items() if value), ("", 0.0, ""))


def _sizes(
    candidate: Candidate, columns: Mapping[str, int], theta: np.ndarray, units: tuple[str, str]
) -> dict[str, tuple[float, str]]:
    """The sizes of an effect with these values of its fitted parameters, the others as in the candidate."""
    return _sizes_with(candidate, dict(zip(columns, theta.tolist(), strict=True)), units)


def _sizes_with(
    candidate: Candidate, given: Mapping[str, float], units: tuple[str, str]
) -> dict[str, tuple[float, str]]:
    """The sizes of an effect with some values of its parameters, the others as in the candidate."""
    if candidate.scales is None:
        return {}
    head = f"{candidate.block}."
    fixed = {k.removeprefix(head): v for k, v in candidate.diagram.parameters.items() if k.startswith(head)}
    return sizes_of(candidate.effect, {**fixed, **given}, candidate.scales, units)


def recorded_units(setup: Setup) -> dict[str, str]:
    """The units of the outputs and inputs of a model, displayed in those of the recordings."""
    records = [one.record for one in setup.experiments]
    return {name: as_recorded(setup.diagram, name, records) for name in (*setup.outputs, *setup.diagram.inports)}


def as_force(size: Quantity, signal: str, diagram: Diagram) -> str:
    """What a size on a signal that is an acceleration is as a force, in a phrase; empty for any other.

    Behind a gain, as that of 1/m, ``size`` is that over the gain, at the input of its block.
    """
    if gain := _gain_of_force(size, signal, diagram):
        name = gain.rpartition(".")[0]
        unit = unit_of_signal(diagram, f"{name}.u")
        return f"{with_interval(attrs.evolve(size, unit=unit))} at the input of {name}"
    if not _is_acceleration(size, signal, diagram):
        return ""
    by, force = FORCES[parse(size.unit).dimension]
    return f"an acceleration: times the {by}, a {force}"


def _is_acceleration(size: Quantity, signal: str, diagram: Diagram) -> bool:
    """Whether a size on a signal is an acceleration, as the signal is."""
    dimensions = [parse(unit).dimension for unit in (size.unit, unit_of_signal(diagram, signal)) if is_unit(unit)]
    return len(dimensions) == 2 and dimensions[0] == dimensions[1] and dimensions[0] in FORCES


def _gain_of_force(size: Quantity, signal: str, diagram: Diagram) -> str:
    """The parameter by which a force becomes the acceleration that a size is; empty where there is none."""
    effects = {one.name for one in catalogue()}
    added = {name for name in diagram.blocks if NUMBERED.sub("", name) in effects}  # they act on the same wire
    name = in_front(diagram, signal, added)[0].rpartition(".")[0]
    gain, unit = diagram.blocks.get(name), unit_of_signal(diagram, f"{name}.u")
    behind = isinstance(gain, Gain) and gain.gain and is_unit(unit) and parse(unit).dimension not in FORCES
    return f"{name}.gain" if behind and _is_acceleration(size, signal, diagram) else ""


def _divided(size: Quantity, by: float) -> Quantity:
    return attrs.evolve(size, value=size.value / by, low=size.low / by, high=size.high / by)


def acceleration_note(limits: Iterable[DetectionLimit]) -> str:
    """A remark on detection limits that are accelerations; empty where none is."""
    labels = (display_unit(limit_quantity(one)[2])[1] for one in limits if one.value is not None)
    found = dict[tuple[str, str], dict[str, None]]()
    for unit in labels:
        if is_unit(unit) and parse(unit).dimension in FORCES:
            found.setdefault(FORCES[parse(unit).dimension], {})[unit] = None
    return " ".join(
        f"Sizes in {listed(list(units), 3)} are accelerations: times the {by}, {force}s."
        for (by, force), units in found.items()
    )
