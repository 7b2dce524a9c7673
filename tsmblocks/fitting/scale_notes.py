"""Recordings in another unit than the model takes them to be in: outputs of its shape and not its size, and times."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import TsmError
from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import listed
from tsmblocks.data import Record
from tsmblocks.data.missing_units import map_argument, other_units
from tsmblocks.fitting.divergence import growth_text
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.setup import Setup, set_up
from tsmblocks.fitting.time_scale import time_text
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import parameter_vector

MIN_CORRELATION = 0.95
"""Correlation of a measured output with the simulated one from which their shapes agree. Chosen."""
LARGE = 100.0
"""Factor between two units from which parameters that are somewhat wrong do not hide it. Chosen."""
OFF_OF_LARGE, OFF_OF_SMALL = 1.4, 1.2
"""Deviation, as a factor, from a large factor between two units, and from a smaller one. Chosen: parameters before a
fit are often wrong by a third, and gains of 10 or 60 are common; that of 57.3 or 9.55 by chance is not."""
FEW_SAMPLES = 20
"""Samples from which the shape of an output is compared. Chosen: few samples are alike by chance."""


class _Scale(NamedTuple):
    """An output, how many times as large as the model's it is, and the unit that this may come from, or ``""``."""

    output: str
    ratio: float
    recorded_in: str


def scale_notes(setup: Setup, growth: bool = True) -> list[str]:
    """Notes on units of outputs and times, as the model with its own parameters shows them, and on its ``growth``."""
    found: dict[str, list[str]] = {}
    p = parameter_vector(setup.eq, setup.diagram)
    for experiment in setup.experiments:
        with np.errstate(over="ignore", invalid="ignore"):
            y = experiment.outputs(p)
        text = time_text(experiment, p) or (growth_text(setup, experiment, p, y) if growth else "")
        if text := text or _output_text(setup, experiment, y):
            found.setdefault(text, []).append(experiment.name)
    return [f"{listed(names, 4)}: {text}" for text, names in found.items()]


def scale_notes_before(diagram: Diagram, records: Mapping[str, Record], **options: Any) -> list[str]:
    """The same before a fit, with the ``options`` of ``set_up``; none where the diagram cannot be simulated."""
    with suppress(TsmError):
        return scale_notes(set_up(diagram, records, **options))
    return []


def _output_text(setup: Setup, experiment: Experiment, y: np.ndarray) -> str:
    """A sentence on outputs of an experiment that are of another scale than the model's, ``y``; ``""`` for none."""
    if len(experiment.t) < FEW_SAMPLES:
        return ""
    with np.errstate(over="ignore", invalid="ignore"):
        ratios = [_ratio(*pair) for pair in zip(y.T, experiment.measured.T, strict=True)]
    labels = [setup.diagram.unit(name) for name in setup.outputs]
    scales = [
        _Scale(name, ratio, _other_unit(unit, ratio))
        for name, unit, ratio in zip(setup.outputs, labels, ratios, strict=True)
    ]
    off = [one for one in scales if one.recorded_in]
    if not off:
        return ""
    inputs, ways = setup.diagram.inports, [(one.output, one.recorded_in) for one in off]
    spread = max(one.ratio for one in off) / min(one.ratio for one in off)
    if len(off) == len(scales) and spread < OFF_OF_SMALL and len(inputs) == 1:  # or the input is
        name, port = next(iter(inputs.items()))
        own = [(name, unit)] if (unit := _other_unit(port.unit, 1 / off[0].ratio)) else []
        ways = own if own and len(off) > 1 else [*ways, *own]
    return (
        f"{listed([one.output for one in off])} {'is' if len(off) == 1 else 'are'} about "
        f"{to_digits(off[0].ratio)} times as large as the model gives before the fit, and of the same shape. If "
        f"{' or '.join(f'{name} was recorded in {unit}' for name, unit in ways)}, give the unit: "
        f"{map_argument(f'{ways[0][0]} [{ways[0][1]}]', ways[0][0])}."
    )


def _ratio(simulated: np.ndarray, measured: np.ndarray) -> float:
    """How many times as large the measured motion is, where it has the shape of the simulated one; else NaN."""
    x, y = simulated - simulated.mean(), measured - measured.mean()
    size = float(x @ x) * float(y @ y)
    if not (np.isfinite(size) and size > 0 and float(x @ y) >= MIN_CORRELATION * np.sqrt(size)):
        return float("nan")
    return float(np.sqrt((y @ y) / (x @ x)))


def _other_unit(unit: str, ratio: float) -> str:
    """The unit of which there are ``ratio`` in one of ``unit``; ``""`` where there is none, or the unit is right."""
    if not unit or not units.is_unit(unit) or not units.parse(unit).dimension:
        return ""
    for other in other_units(unit):
        factor = units.factor(unit, other)
        most = OFF_OF_LARGE if not 1 / LARGE < factor < LARGE else OFF_OF_SMALL
        if factor != 1 and factor / most <= ratio <= factor * most:
            return other
    return ""
