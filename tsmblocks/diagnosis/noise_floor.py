"""The noise floor of every measured output, given or found in the recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.common.errors import DataError
from tsmblocks.data import Record
from tsmblocks.data.conditioning import conditioned
from tsmblocks.data.filters import white_noise_power
from tsmblocks.data.noise_floor import HIGH_FREQUENCIES, fast_noise_of_recordings, noise_of_recordings
from tsmblocks.data.resampling import evenly_sampled
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.fitting.experiments import prepare
from tsmblocks.model.diagram import Diagram

GIVEN = "given"
"""The way of a floor that the user knows."""
MAX_FLOOR_RATIO = 1.5
"""How many times what the base leaves a floor must be to be doubted: noise alone is about once that."""
DRAWS = 1
"""Draws of input noise for each experiment; thousands of samples make one enough."""


@attrs.frozen
class NoiseFloors:
    """Noise of each output, in the diagram's unit, and how it was found; ``reliable`` unless only fast noise was seen.

    ``given`` says it in the words of the user, where it was given.
    """

    sigma: Mapping[str, float]
    method: Mapping[str, str]
    reliable: bool
    given: Mapping[str, str] = attrs.field(factory=dict)


def noise_floors(
    records: Mapping[str, Record], diagram: Diagram, outputs: Sequence[str], asked: Mapping[str, tuple[float, str]]
) -> NoiseFloors:
    """The noise floors: those that were asked for (see asked_floors), and for the other outputs those found.

    Raises DataError where an output shows no noise at all.
    """
    sigma, method = dict[str, float](), dict[str, str]()
    for name in outputs:
        if name in asked:
            sigma[name], method[name] = asked[name][0], GIVEN
        else:
            sigma[name], method[name] = _found(records, diagram, name)
    return NoiseFloors(
        sigma,
        method,
        all(m != HIGH_FREQUENCIES for m in method.values()),
        {k: words for k, (_, words) in asked.items()},
    )


def _found(records: Mapping[str, Record], diagram: Diagram, name: str) -> tuple[float, str]:
    """The noise that the recordings show. Raises DataError where they show none."""
    middle, method = noise_of_recordings(records, name, diagram.unit(name), diagram.inports)
    if not middle > 0:
        raise DataError(
            f"no noise was found in {name}, so nothing says what counts as a difference. Give the noise "
            f"floor with its unit: noise_floor=…{diagram.unit(name)}."
        )
    return middle, method


def lowered_noise_floors(
    found: NoiseFloors, left: Mapping[str, float], records: Mapping[str, Record], diagram: Diagram
) -> tuple[NoiseFloors, list[str]]:
    """Floors that are none above what a model leaves, and what was done about it in words.

    ``left`` is the rms that the model leaves of each output, in units of its floor. A floor that was looked for gives
    way to the fast noise, where that is less; one that was given stays, and is doubted.
    """
    sigma, method, words = dict(found.sigma), dict(found.method), list[str]()
    for name, share in left.items():
        unit = diagram.unit(name)
        if share * MAX_FLOOR_RATIO >= 1:
            continue
        floor, rms = (in_display_units(k * sigma[name], unit) for k in (1.0, share))
        if method[name] == GIVEN:
            meant = f" ({unit})" if unit else ""
            words.append(
                f"the noise floor given for {name} ({floor}) is above all that the base leaves ({rms} rms), "
                f"so nothing can be found: is it in the right unit{meant}?"
            )
            continue
        middle = fast_noise_of_recordings(records, name, diagram.unit(name))
        if 0 < middle < sigma[name]:
            taken = f"{in_display_units(middle, unit)} of fast noise is taken instead"
            words.append(
                f"the noise floor of {name} found in {method[name]} ({floor}) is above all that the base "
                f"leaves ({rms} rms); {taken}."
            )
            sigma[name], method[name] = middle, HIGH_FREQUENCIES
    return attrs.evolve(
        found, sigma=sigma, method=method, reliable=all(m != HIGH_FREQUENCIES for m in method.values())
    ), words


def propagated_input_noise(model: Model, raw: Mapping[str, Record], inputs: Iterable[str], seed: int) -> float:
    """Mean square, in variances of the outputs' noise, of what the noise of measured inputs does to the outputs.

    The conditioned inputs are taken for the true motion; noise as strong as that which was filtered out, and as white,
    is put on them, they are conditioned again, and the model is simulated with both.
    """
    names, draw = tuple(inputs), np.random.default_rng(seed)
    total = count = 0.0
    for e, trial in enumerate(model.setup.trials):
        clean = trial.record
        noisy = _noisy(clean, raw[trial.name], names, draw)
        if noisy is None:
            continue
        again = conditioned(noisy, names)
        other = prepare(
            trial.name,
            again,
            model.diagram,
            model.setup.eq,
            outputs=model.setup.outputs,
            rule=trial.rule,
            step=trial.times.h,
            hold=trial.hold,
            window=(trial.t[0], trial.t[-1]),
            backend=trial.backend,
        )
        p = model.problem.unknowns.parameters(model.theta, e)
        change = (other.outputs(p) - trial.outputs(p)) * model.problem.weights
        total += float(np.sum(np.where(np.isfinite(change), change, 0.0) ** 2))
        count += change.size
    return total / count if count else 0.0


def _noisy(clean: Record, raw: Record, names: tuple[str, ...], draw: np.random.Generator) -> Record | None:
    """A conditioned record with fresh noise on its inputs; None where nothing was filtered out."""
    raw = evenly_sampled(raw)
    signals, found = dict(clean.signals), False
    for name in names:
        if name not in clean or len(raw) != len(clean):
            continue
        size = _white(raw[name] - clean[name])
        if size > 0:
            signals[name] = clean[name] + size * draw.standard_normal(len(clean))
            found = True
    return attrs.evolve(clean, signals=signals) if found else None


def _white(removed: np.ndarray) -> float:
    """Rms of white noise whose fast part is as strong as what a filter removed: from the upper half of the spectrum."""
    power = np.abs(np.fft.rfft(removed - removed.mean())) ** 2 / len(removed)
    return float(np.sqrt(white_noise_power(power, np.log(2.0))))
