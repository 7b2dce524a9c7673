"""Shared by text, page and figures of a diagnosis: display units, traces of outputs, errors along a coordinate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import attrs
import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.headings import heading
from tsmblocks.common.rounding import LARGEST_PLAIN, plus_minus, significant
from tsmblocks.common.tables import listed
from tsmblocks.data.noise_floor import CONTENT, method_text
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.diagnosis.residual_location import BIN_COUNT, axis_title, binned, coordinate_unit, coordinates
from tsmblocks.diagnosis.segment import Gap, NamedEffect, Quantity, RankedCandidate, Segment, Trace
from tsmblocks.effects.sizes import MILLISECONDS, UNTIL
from tsmblocks.fitting.parameters import numbers
from tsmblocks.model import parameter_units
from tsmblocks.model.diagram import Diagram

MIN_BIN_BLOCKS = 3
"""Time blocks of a bin from which the standard error of its mean is estimated. Chosen."""
IN_PROPORTION = 0.5
"""Change of a parameter, over the largest along a combination, from which it is in proportion to that. Chosen."""
MAX_SIZES = 2
"""Sizes of an effect that are reported in a sentence. Chosen: all of them are in the tables."""
LOWERED = 0.99
"""Noise floor over the estimate of its parts from which it counts as lowered. Chosen: beyond rounding."""
DARKEST = 4.0
"""Excess, in variances of the noise, at which a block of a strip is as dark as it gets. Chosen."""


def with_interval(q: Quantity) -> str:
    """An estimate with half its interval: ``0.157 ± 0.011 deg``; marked where it has none."""
    half = (q.high - q.low) / 2
    if not np.isfinite(half) or half == 0:
        return in_display_units(q.value, q.unit) + (" (not determined)" if half else "")
    k, unit = _of_size(q.value, q.unit)
    return plus_minus(k * q.value, k * half, unit)


def _of_size(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a number has few digits: a time of a second or more is in seconds."""
    in_seconds = unit == "ms" and abs(value) >= MILLISECONDS
    return (1 / MILLISECONDS, "s") if in_seconds else (1.0, unit)


def digits(value: float) -> str:
    """A number with three digits, trailing zeros included."""
    return _plain(significant(value, 3))


def _plain(text: str) -> str:
    """A number as engineers write it: 2980 and not 2.98e+03; powers of ten from ``LARGEST_PLAIN``."""
    return f"{float(text):.0f}" if "e+" in text and abs(float(text)) < LARGEST_PLAIN else text


def in_display_units(value: float, unit: str) -> str:
    """A number with its unit for display: three digits, in the unit of a recording, angles in degrees."""
    factor, unit = _of_size(value, unit)
    k, shown = display_unit(unit)
    return f"{_plain(f'{k * factor * value:.3g}')} {shown}".rstrip()


def unit_of(diagram: Diagram, parameter: str) -> str:
    """The unit of a parameter of a diagram, ``"tsm.theta"``; empty where none is known."""
    fields = numbers(diagram).get(parameter)
    return parameter_units.unit_of(parameter, diagram, fields) if fields else ""


def main_parameter(effect: NamedEffect, segment: Segment) -> str:
    """The parameter that gives the size of an effect: that of its detection limit, else the first.

    Where each experiment has a separate value, the largest one.
    """
    wanted, known = next((m.parameter for m in segment.limits if m.name == effect.name), ""), effect.parameters
    main = wanted if wanted in known else next(iter(known), "")
    name, _, experiment = main.partition("@")
    same = [one for one in known if one.partition("@")[0] == name]
    return max(same, key=lambda one: abs(known[one].value)) if experiment else main


def main_sizes(effect: NamedEffect, segment: Segment) -> list[str]:
    """The measurable size of an effect in words: ``gap width 3.01 ± 0.02 deg``.

    At most ``MAX_SIZES``, of which the instants from which until which a change lasts are one. Where each experiment
    has separate values, those of the one in which the first size is the largest of those that are clear of zero; of an
    effect that defines no sizes its main parameter.
    """
    if not effect.sizes:
        main = main_parameter(effect, segment)
        name, _, experiment = main.partition("@")
        where = _in_experiment(experiment) if experiment else ""
        return [f"{name.rpartition('.')[2]} {with_interval(effect.parameters[main])}{where}"] if main else []
    parts = {key: key.partition("@") for key in effect.sizes}
    first = next((name for name, at, _ in parts.values() if at), "")
    local = [key for key, (name, at, _) in parts.items() if at and name == first]
    clear = [key for key in local if effect.sizes[key].low > 0 or effect.sizes[key].high < 0]
    largest = parts[max(clear or local, key=lambda key: abs(effect.sizes[key].value))][2] if local else ""
    shown = [key for key, (_, _, experiment) in parts.items() if experiment in ("", largest)]
    texts = list[str]()
    for key in shown:
        text = f"{parts[key][0]} {size_text(effect, key)}"
        if parts[key][0] == UNTIL and texts:
            texts[-1] += f" {text}"
        else:
            texts.append(text)
    texts = texts[:MAX_SIZES]
    if largest and any(parts[key][2] for key in shown[:MAX_SIZES]):
        texts[-1] += _in_experiment(largest, len(local) - len(effect.absent_in) == 1, effect.relative_to)
    return texts


def open_scale(effect: NamedEffect, segment: Segment) -> str:
    """The parameter of the diagram to which the size of an effect is in proportion, where the data determine neither.

    Empty where they determine the size.
    """
    added = {one.block for one in segment.effects}
    for one in segment.fit.undetermined if segment.fit is not None else ():
        moved = [name for name, by in zip(one.names, one.changes, strict=True) if abs(by) >= IN_PROPORTION]
        own = [name for name in moved if name.partition(".")[0] == effect.block]
        others = [name for name in moved if name.partition(".")[0] not in added and "@" not in name]
        if one.exact and own and others:
            return others[0]
    return ""


def size_rows(effect: NamedEffect) -> list[tuple[str, str]]:
    """Names and texts of the sizes of an effect, without those of experiments in which it is absent."""
    return [(name, size_text(effect, name)) for name in effect.sizes if not effect.is_absent(name)]


def block_title(effect: NamedEffect) -> str:
    """The block of an effect, and the effect where its name is another."""
    return effect.block if effect.block == effect.name else f"{effect.block} ({effect.name})"


def absence_text(effect: NamedEffect) -> str:
    """In words the experiments in which an effect with separate sizes is not detectable; empty where there are none.

    Of one that is counted from an experiment, that is named as well.
    """
    others = [name for name in effect.absent_in if name != effect.relative_to]
    absent = [f"not detectable in {listed(others, 6)}"] if others else []
    return "; ".join([*([f"relative to {effect.relative_to}"] if effect.relative_to else []), *absent])


def size_text(effect: NamedEffect, name: str) -> str:
    """A size of an effect with its interval; of an acceleration also what it is as a force."""
    text, force = with_interval(effect.sizes[name]), effect.as_force.get(name, "")
    return f"{text}, {force}" if force else text


def _in_experiment(experiment: str, only: bool = False, reference: str = "") -> str:
    """Where a size is the largest one, and from which experiment it is counted."""
    if reference:
        return f" in {experiment} relative to {reference}{'' if only else ', where it is largest'}"
    return f", in {experiment} only" if only else f" in {experiment}, where it is largest"


def output_traces(segment: Segment, output: str) -> tuple[Trace, ...]:
    """The traces of one output, one for each experiment; pieces of an experiment are joined."""
    groups: dict[str, list[Trace]] = {}
    for trace in segment.traces:
        if trace.output == output:
            groups.setdefault(experiment_of(trace.experiment), []).append(trace)
    return tuple(parts[0] if len(parts) == 1 else _joined(name, parts) for name, parts in groups.items())


def _joined(name: str, parts: Sequence[Trace]) -> Trace:
    joined = ("t", "measured", "before", "after", "drive", "excess")
    whole: dict[str, Any] = {key: np.concatenate([getattr(one, key) for one in parts]) for key in joined}
    return attrs.evolve(parts[0], experiment=name, **whole)


def fitted_rms(trace: Trace) -> tuple[float, float]:
    """Residual rms of base and final model, as fitted, in the unit of the trace."""
    before, after = (float(np.sqrt(np.mean((y - trace.measured) ** 2))) for y in (trace.before, trace.after))
    return before, after


def strips(trace: Trace) -> np.ndarray:
    """Start, stop [s], and mean squares before and after [noise variances], shape (blocks, 4)."""
    rows = []
    for start, stop, square in trace.excess:
        here = (trace.t >= start) & (trace.t <= stop)
        before, after = (np.mean((y - trace.measured)[here] ** 2) for y in (trace.before, trace.after))
        rows.append((start, stop, square, square * after / before if before > 0 else 0.0))
    return np.array(rows)


def darkness(square: float) -> float:
    """How dark a block of time is in a strip, 0 to 1, given its mean square [noise variances]."""
    return float(np.clip((square - 1) / (DARKEST - 1), 0.0, 1.0))


def gap_rows(segment: Segment, gap: Gap) -> list[tuple[str, tuple[float, ...], tuple[float, float]]]:
    """Rows of a chart of rms errors, ``all`` first: name, errors on held-out data, first and last on fitted data."""
    rows = [("all", gap.held_out, (gap.train[0], gap.train[-1]))]
    if len(gap.experiments) > 1:
        fitted = {t.experiment: fitted_rms(t) for t in output_traces(segment, gap.output)}
        rows += [(name, values, fitted[name]) for name, values in gap.experiments.items()]
    return rows


def floor_text(gap: Gap) -> str:
    """Where the noise floor comes from, and what it contains: ``from high frequencies: a lower limit, …``."""
    return gap.given or method_text(gap.method)


def floor_sentence(gap: Gap) -> str:
    """Where the noise floor comes from: the noise of the output with its interval, and what inputs add."""
    parts = gap.parts
    if parts is None:
        return f"noise floor {floor_text(gap)}."
    own = f"{_rms(parts.value, gap.unit)} ({interval_text(parts.low, parts.high, gap.unit)})"
    text = f"noise floor {own}, {floor_text(gap)}."
    if parts.from_inputs:
        text += (
            f" The noise of the inputs adds {_rms(parts.from_inputs, gap.unit)} to the simulated {gap.output}: "
            f"{_rms(float(np.hypot(parts.value, parts.from_inputs)), gap.unit)} together."
        )
    if gap.noise_floor < LOWERED * np.hypot(parts.value, parts.from_inputs):
        least = _rms(gap.noise_floor, gap.unit)
        text += f" It was lowered to {least}, the part of the residual that the recorded signals do not predict."
    return text


def _rms(value: float, unit: str) -> str:
    k, shown = display_unit(unit)
    return " ".join(filter(None, [digits(k * value), shown, "rms"]))


def interval_text(low: float, high: float, unit: str) -> str:
    """A 95 % interval of an rms value, which may have no upper end: ``95 %: 0.11 to 0.15``."""
    k, _ = display_unit(unit)
    return f"95 %: {digits(k * low)} {f'to {digits(k * high)}' if np.isfinite(high) else 'or more'}"


def floor_rows(gap: Gap) -> list[tuple[str, ...]]:
    """The noise that each recording alone shows, the heading first; empty for a single recording."""
    recordings = {} if gap.parts is None else gap.parts.recordings
    if len(recordings) < 2:
        return []
    k, unit = display_unit(gap.unit)
    rows: list[tuple[str, ...]] = [(heading(f"noise of {gap.output} alone", unit), "rms", "95 % low", "high", "method")]
    for name, one in recordings.items():
        high = digits(k * one.high) if np.isfinite(one.high) else "-"
        rows.append((name, digits(k * one.floor), digits(k * one.low), high, one.method))
    return rows


def floor_methods(gap: Gap) -> list[str]:
    """What the methods contain by which recordings alone were estimated, beside that of the floor."""
    recordings = {} if gap.parts is None or not floor_rows(gap) else gap.parts.recordings
    used = dict.fromkeys(one.method for one in recordings.values() if one.method != gap.method)
    return [f"{method}: {CONTENT[method]}" for method in used]


def by_removed(rows: Iterable[RankedCandidate]) -> list[RankedCandidate]:
    """Candidates from the one that removes most of the error to the one that removes least.

    Of those that remove as many per cent the one that was named comes first. Differences that may be rounding do not
    count: the order is then that of the names.
    """
    rows = list(rows)
    best = max((one.gain for one in rows if np.isfinite(one.gain)), default=1.0)

    def place(one: RankedCandidate) -> tuple[float, bool, float, str, str]:
        gain = one.gain if np.isfinite(one.gain) else -np.inf
        share = gain / best if best > 0 and gain > 0 else gain
        percent = round(share, 2) if share > 0 else gain
        return -percent, not one.named, -round(share, 4), one.name, one.variant

    return sorted(rows, key=place)


def by_excess(traces: Sequence[Trace]) -> list[Trace]:
    """Traces from the one with the largest error above the noise to the one with the smallest."""
    return sorted(traces, key=lambda one: -float(np.mean(one.excess[:, 2])) if len(one.excess) else 0.0)


@attrs.frozen(eq=False)
class Profile:
    """The mean residual along a coordinate, in bins at ``x`` (bins,), before and after the effects were added.

    ``explained`` (bins,) is the change of the simulation by the named effects: where they are right, the residual
    before lies on it. ``error_before`` and ``error_after`` are standard errors from the time blocks.
    """

    coordinate: str
    unit: str
    error_unit: str
    x: np.ndarray
    before: np.ndarray
    error_before: np.ndarray
    after: np.ndarray
    error_after: np.ndarray
    explained: np.ndarray


def profile(segment: Segment, output: str, coordinate: str) -> Profile | None:
    """The mean residual of one output along a coordinate; None where the coordinate does not vary."""
    traces = output_traces(segment, output)
    parts, count = [], 0
    for number, one in enumerate(traces):
        motion = one.drive if len(one.drive) else one.measured
        block = count + np.searchsorted(one.excess[:, 0], one.t, side="right")
        count += len(one.excess) + 1
        residuals = (one.measured - one.before, one.measured - one.after, one.after - one.before)
        parts.append((coordinates(one.t, motion, number)[coordinate], block, *residuals))
    if not traces:
        return None
    x, blocks, before, after, explained = map(np.concatenate, zip(*parts, strict=True))
    place = binned(x, BIN_COUNT)
    bins = [place == k for k in np.unique(place)]
    if len(bins) < 2:
        return None
    rows = [(x[b].mean(), *_mean(before[b], blocks[b]), *_mean(after[b], blocks[b]), explained[b].mean()) for b in bins]
    table = np.array(rows).T
    first = traces[0]
    moving, own = (first.drive_name, first.drive_unit) if len(first.drive) else (output, first.unit)
    return Profile(axis_title(coordinate, moving, own), coordinate_unit(coordinate, own), first.unit, *table)


def _mean(values: np.ndarray, blocks: np.ndarray) -> tuple[float, float]:
    """Mean, and its standard error from the scatter of the time blocks; NaN where there are too few."""
    _, place = np.unique(blocks, return_inverse=True)
    total, number = np.bincount(place, values), np.bincount(place)
    middle = float(values.mean())
    off = total - middle * number
    count = len(number)
    if count < MIN_BIN_BLOCKS:
        return middle, float("nan")
    return middle, float(np.sqrt(np.sum(off**2) * count / (count - 1)) / number.sum())
