"""The noise floor of every measured output, given or estimated from the recordings; noise of inputs propagated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data import Record
from tsmblocks.data.noise_floor import HIGH_FREQUENCIES, Noise, fast_noise_of_recordings, noise_over_recordings
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.fitting.above_noise import MAX_FLOOR_RATIO, contains_jumps, fast_noise
from tsmblocks.fitting.recordings import as_recorded
from tsmblocks.model.diagram import Diagram

GIVEN = "given"
"""The method of a noise floor that the user gave."""
MIN_UPPER_RATIO = 1.4
"""The largest noise that is plausible over an estimated floor, at least. Chosen: noise during a motion may exceed that
of rests, and the residual of a model that of differences between periods."""
MAX_SLOW_RATIO = 10.0
"""The same over a floor that is the fast noise alone. Chosen: slow noise of a sensor is a few times its fast noise; an
error that is larger, and not predicted, is not called noise."""
BURST_RATIO = 2.0
"""Mean square of a noise over that of its median time block, at most. Source: 1.4 at most on independent benches whose
noise comes in bursts, and 1.9 to 3.4 with disturbances that come and go."""
MAX_FINAL_FLOOR_RATIO = 1.15
"""Noise floor over the residual rms of the final model from which the floor is too high. Chosen: the error of a good
estimate, and the part of the noise that fitted parameters absorb."""

ROUNDING_SHARE = 0.8
"""Rms of rounding over the noise floor from which a note names the step. Chosen: two thirds of the variance."""


@attrs.frozen
class NoiseLevel:
    """Mean square of the noise [noise variances]: the least and the largest that are plausible.

    ``unpredicted`` is the mean square of the residual that nothing recorded predicts: the noise, and model errors that
    are not functions of what was recorded. ``is_given`` is True where the user gave it,
    ``from_inputs`` the part that noise of the inputs causes and whitening does not account for.
    """

    low: float
    high: float
    unpredicted: float
    is_given: bool = False
    from_inputs: float = 0.0

    def largest(self, typical: float) -> float:
        """The largest mean square of noise that is plausible, with the loss ``typical`` in the median time block.

        Noise does not come and go by more than ``BURST_RATIO``, so what is above that is no noise.
        """
        return max(self.low, self.high if self.is_given else min(self.high, BURST_RATIO * typical))

    def attained(self, loss: float, typical: float) -> float:
        """The mean square of the noise by what is not predicted, or a model with these losses leaves."""
        return float(np.clip(min(self.unpredicted, loss), self.least(loss), self.largest(typical)))

    def least(self, loss: float) -> float:
        """The least mean square of noise that is plausible beside a model with this loss.

        An estimated floor may hold what an effect does, such as a disturbance that differs from period to period.
        """
        return self.low if self.is_given else min(self.low, loss + self.from_inputs)


@attrs.frozen
class NoiseFloors:
    """Rms noise of each output, in the diagram's unit, and the method of its estimate.

    ``given`` holds the text that the user gave, ``low`` and ``high`` the 95 % interval of an estimate, ``doubt``
    doubts about it, ``recordings`` what each recording alone shows, by output and experiment, and ``rounding`` notes on
    outputs whose noise is the rounding of their readings.
    """

    sigma: Mapping[str, float]
    method: Mapping[str, str]
    given: Mapping[str, str] = attrs.field(factory=dict)
    high: Mapping[str, float] = attrs.field(factory=dict)
    doubt: Mapping[str, str] = attrs.field(factory=dict)
    low: Mapping[str, float] = attrs.field(factory=dict)
    recordings: Mapping[str, Mapping[str, Noise]] = attrs.field(factory=dict)
    rounding: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """Doubts about the noise floors, and where they are from rounding."""
        doubts = [
            f"the noise floor of {name} is taken from {self.method[name]}. A better estimate failed: {text}."
            for name, text in self.doubt.items()
        ]
        return [*doubts, *self.rounding]

    def largest_ratio(self, output: str) -> float:
        """The largest noise of an output that is plausible, over its floor."""
        if self.method[output] == GIVEN:
            return 1.0
        if self.method[output] == HIGH_FREQUENCIES:
            return MAX_SLOW_RATIO
        return max(MIN_UPPER_RATIO, self.high.get(output, 0.0) / self.sigma[output])

    @property
    def is_given(self) -> bool:
        """Whether the floors of all outputs were given."""
        return set(self.method.values()) == {GIVEN}


def noise_level(floors: NoiseFloors, input_noise: float, unpredicted: float) -> NoiseLevel:
    """How large the noise may be, by its floors and by what is not predicted of the residual.

    ``input_noise`` is the variance that noise of the inputs causes and whitening does not account for. What was given
    is right; an estimated floor misses noise that is slow, and is no higher than what is not predicted.
    """
    ratios = [floors.largest_ratio(name) ** 2 for name in floors.sigma]
    low, high = 1 + input_noise, float(np.mean(ratios)) + input_noise
    if not floors.is_given:
        low = min(low, unpredicted)
    return NoiseLevel(low, high, unpredicted, floors.is_given, input_noise)


def noise_floors(
    records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str], given: Mapping[str, tuple[float, str]]
) -> NoiseFloors:
    """The noise floors of the outputs: those given as (rms, text), the others estimated.

    Raises DataError where an output shows no noise at all.
    """
    given = {k: v for k, v in given.items() if k in outputs}
    found = {name: _estimated(records, diagram, name) for name in outputs if name not in given}
    return NoiseFloors(
        {name: given[name][0] if name in given else found[name].floor for name in outputs},
        {name: GIVEN if name in given else found[name].method for name in outputs},
        {k: text for k, (_, text) in given.items()},
        {k: one.high for k, one in found.items()},
        {k: one.doubt for k, one in found.items() if one.doubt},
        {k: one.low for k, one in found.items()},
        {name: _by_recording(records, diagram, name) for name in found},
        tuple(filter(None, (_rounding(one, as_recorded(diagram, k, [*records.values()])) for k, one in found.items()))),
    )


def _rounding(found: Noise, unit: str) -> str:
    """A note where most of the noise of an output is the rounding of its reading; empty for others."""
    step = found.quantum or 0.0
    rms = step / math.sqrt(12.0)
    if rms < ROUNDING_SHARE * found.floor:
        return ""
    return (
        f"{found.name} is quantised in steps of {in_display_units(step, unit)}: rounding, "
        f"{in_display_units(rms, unit)} rms, is most of its noise from sample to sample. Finer steps would show "
        "smaller effects."
    )


def _by_recording(records: Mapping[str, Record], diagram: Diagram, name: str) -> dict[str, Noise]:
    """The noise that each recording alone shows, of those with enough samples."""
    result = {}
    for key, record in records.items():
        try:
            result[key] = noise_over_recordings({key: record}, name, diagram.unit(name), diagram.inports)
        except DataError:  # too few samples
            continue
    return result


def _estimated(records: Mapping[str, Record], diagram: Diagram, name: str) -> Noise:
    """The noise estimated from the recordings. Raises DataError where there is none."""
    found = noise_over_recordings(records, name, diagram.unit(name), diagram.inports)
    if not found.floor > 0:
        raise DataError(
            f"no noise was found in {name}, so the residual has no scale. Give the noise "
            f"floor with its unit: noise_floor=…{diagram.unit(name)}."
        )
    return found


def fast_noise_of_residuals(model: Model) -> dict[str, float]:
    """The noise from sample to sample in the residuals of each output [its floor], the median over experiments."""
    outputs, parts = model.setup.outputs, model.problem.segments
    return {
        name: fast_noise(
            (one.t, model.r[rows]) for one, rows in zip(model.setup.experiments, parts[k :: len(outputs)], strict=True)
        )
        for k, name in enumerate(outputs)
    }


def lowered_noise_floors(
    found: NoiseFloors,
    residual_rms: Mapping[str, float],
    fast_residual: Mapping[str, float],
    records: Mapping[str, Record],
    diagram: Diagram,
) -> tuple[NoiseFloors, list[str]]:
    """Noise floors no higher than the residual of a model, and notes on those that changed.

    ``residual_rms`` is that of each output, divided by its floor, and ``fast_residual`` its fast noise. An estimated
    floor is replaced by the fast noise, where that is lower; a given one stays, with a warning.
    """
    sigma, method, more_notes = dict(found.sigma), dict(found.method), list[str]()
    low, high, recordings = dict(found.low), dict(found.high), dict(found.recordings)
    for name, share in residual_rms.items():
        with_jumps = contains_jumps(1.0, method[name], fast_residual[name])
        if share * MAX_FLOOR_RATIO >= 1 and not with_jumps:
            continue
        unit = as_recorded(diagram, name, records.values())
        floor, rms = (in_display_units(k * sigma[name], unit) for k in (1.0, share))
        if method[name] == GIVEN:
            meant = f" ({unit})" if unit else ""
            more_notes.append(
                f"the noise floor given for {name} ({floor}) is above the residual of the base ({rms} rms), "
                f"so no effect can be found: is it in the right unit{meant}?"
            )
            continue
        fast = min(fast_noise_of_recordings(records, name, unit), fast_residual[name] * sigma[name])
        if 0 < fast < sigma[name]:
            why = "contains jumps that the base model simulates" if with_jumps else ""
            why = why or f"is not all noise: the residual of the base model, which contains all of it, is {rms} rms"
            more_notes.append(
                f"the noise of {name} estimated from {method[name]}, {floor} rms, {why}. Taken for the noise floor "
                f"instead: the fast noise, {in_display_units(fast, unit)} rms."
            )
            sigma[name], method[name] = fast, HIGH_FREQUENCIES
            low[name], high[name] = fast, np.inf
            recordings.pop(name, None)
    return attrs.evolve(found, sigma=sigma, method=method, low=low, high=high, recordings=recordings), more_notes


def doubtful_floors(found: NoiseFloors, residual_rms: Mapping[str, float], units: Mapping[str, str]) -> list[str]:
    """Notes on estimated floors that are above the residual of the last model, which holds all of the noise.

    ``residual_rms`` is that of each output, divided by its floor; ``units`` are those of the outputs.
    """
    notes = list[str]()
    for name, share in residual_rms.items():
        if found.method[name] in (GIVEN, HIGH_FREQUENCIES) or share * MAX_FINAL_FLOOR_RATIO >= 1:
            continue
        floor, rms = (in_display_units(k * found.sigma[name], units[name]) for k in (1.0, share))
        notes.append(
            f"the noise floor of {name} estimated from {found.method[name]}, {floor} rms, is too high: the residual of "
            f"the final model, which contains all noise, is smaller ({rms} rms). Small effects may be missed. Give the "
            "noise if you know it."
        )
    return notes
