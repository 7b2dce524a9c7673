"""Times of a recording that are far from the time constants of a model."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.rounding import to_digits
from tsmblocks.data.missing_units import map_argument
from tsmblocks.fitting.experiments import Experiment, grid_step
from tsmblocks.simulation.stability import MOST_STATES, poles

UNSEEN = 3.0
"""Slowest time constants in a step, or lengths of a recording in the fastest one, from which times are in doubt."""
STILL = 1e-9
"""Rate of a pole relative to the fastest up to which it is one of an integrator. Chosen: beyond rounding."""
IN_MS = 1e-3
"""The factor from s that is looked for in times."""


def time_text(experiment: Experiment, p: np.ndarray) -> str:
    """A sentence on times that make all dynamics of the model far too fast to be seen, or far too slow; else ``""``.

    None on a model with a pole that grows: its parameters are in doubt and not the times.
    """
    values = poles(experiment.eq, p) if len(experiment.eq.x) <= MOST_STATES else np.empty(0)
    largest = float(np.abs(values).max(initial=0.0))
    rates = np.abs(values)[np.abs(values) > STILL * largest]
    if not len(rates) or values.real.max() > STILL * largest:
        return ""
    fast, slow, t = 1 / rates.max(), 1 / rates.min(), experiment.record.t
    step, length = grid_step(t), float(t[-1] - t[0])
    if step > UNSEEN * slow and step * IN_MS < slow:
        seen = f"the samples are {step:.3g} s apart, and the slowest time constant of the model is {to_digits(slow)} s"
        unit = "ms"
    elif UNSEEN * length < fast and length / IN_MS > slow:
        seen = (
            f"the recording lasts {to_digits(length)} s, and the fastest time constant of the model is "
            f"{to_digits(fast)} s"
        )
        unit = "s"
    else:
        return ""
    return f"{seen}. If its times are in {unit}, give the unit: {map_argument(f't [{unit}]', 't')}."
