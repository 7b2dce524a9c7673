"""Recordings in another unit than the model takes them to be in: outputs of its shape and not its size, and times."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import TsmError
from tsmblocks.common.tables import listed
from tsmblocks.data import Record
from tsmblocks.data.missing_units import map_argument
from tsmblocks.fitting.experiments import Experiment, grid_step
from tsmblocks.fitting.setup import Setup, set_up
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.compiled import parameter_vector
from tsmblocks.simulation.stability import poles

MIN_CORRELATION = 0.95
"""Correlation of a measured output with the simulated one from which their shapes agree. Chosen."""
LARGE = 100.0
"""Factor between two units from which parameters that are somewhat wrong do not hide it. Chosen."""
OFF_OF_LARGE, OFF_OF_SMALL = 1.4, 1.2
"""Deviation, as a factor, from a large factor between two units, and from a smaller one. Chosen: parameters before a
fit are often wrong by a third, and gains of 10 or 60 are common; that of 57.3 or 9.55 by chance is not."""
FEW_SAMPLES = 20
"""Samples from which the shape of an output is compared. Chosen: few samples are alike by chance."""
UNSEEN = 3.0
"""Slowest time constants in a step, or lengths of a recording in the fastest one, from which times are in doubt."""
STILL = 1e-9
"""Rate of a pole relative to the fastest up to which it is one of an integrator. Chosen: beyond rounding."""
MOST_STATES = 100
"""States up to which poles are computed. Chosen: for the run time."""
IN_MS = 1e-3
"""The factor from s that is looked for in times."""


class _Scale(NamedTuple):
    """An output, how many times as large as the model's it is, and the unit that this may come from, or ``""``."""

    output: str
    ratio: float
    recorded_in: str


def scale_notes(setup: Setup) -> list[str]:
    """Notes on outputs and times that are recorded in another unit, as the model with its own parameters tells."""
    found: dict[str, list[str]] = {}
    p = parameter_vector(setup.eq, setup.diagram)
    for experiment in setup.experiments:
        for text in filter(None, (_output_text(setup, experiment, p), time_text(experiment, p))):
            found.setdefault(text, []).append(experiment.name)
    return [f"{listed(names, 4)}: {text}" for text, names in found.items()]


def scale_notes_before(diagram: Diagram, records: Mapping[str, Record], **options: Any) -> list[str]:
    """The same before a fit, with the options of ``set_up``; none where the diagram cannot be simulated."""
    with suppress(TsmError):
        return scale_notes(set_up(diagram, records, **options))
    return []


def _output_text(setup: Setup, experiment: Experiment, p: np.ndarray) -> str:
    """A sentence on the outputs of an experiment that are of another scale than the model's; ``""`` for none."""
    if len(experiment.t) < FEW_SAMPLES:
        return ""
    with np.errstate(over="ignore", invalid="ignore"):
        ratios = [_ratio(*pair) for pair in zip(experiment.outputs(p).T, experiment.measured.T, strict=True)]
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
        f"{float(f'{off[0].ratio:.2g}'):g} times as large as the model gives before the fit, and of the same shape. If "
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
    candidates = [f"{prefix}{unit}" for prefix in "mkuM"]
    candidates += [unit.replace("rad", "deg")] if "rad" in unit else []
    candidates += ["rpm"] if units.same(unit, "rad/s") else []
    for other in candidates:
        if other == unit or not units.is_unit(other) or units.parse(other).dimension != units.parse(unit).dimension:
            continue
        factor = units.factor(unit, other)
        most = OFF_OF_LARGE if not 1 / LARGE < factor < LARGE else OFF_OF_SMALL
        if factor != 1 and factor / most <= ratio <= factor * most:
            return other
    return ""


def time_text(experiment: Experiment, p: np.ndarray) -> str:
    """A sentence on times that make all dynamics of the model far too fast to be seen, or far too slow; else ``""``."""
    rates = np.abs(poles(experiment.eq, p)) if len(experiment.eq.x) <= MOST_STATES else np.empty(0)
    rates = rates[rates > STILL * rates.max(initial=0.0)]
    if not len(rates):
        return ""
    fast, slow, t = 1 / rates.max(), 1 / rates.min(), experiment.record.t
    step, length = grid_step(t), float(t[-1] - t[0])
    if step > UNSEEN * slow and step * IN_MS < slow:
        seen = f"the samples are {step:.3g} s apart, and the slowest time constant of the model is {slow:.2g} s"
        unit = "ms"
    elif UNSEEN * length < fast and length / IN_MS > slow:
        seen = f"the recording lasts {length:.2g} s, and the fastest time constant of the model is {fast:.2g} s"
        unit = "s"
    else:
        return ""
    return f"{seen}. If its times are in {unit}, give the unit: {map_argument(f't [{unit}]', 't')}."
