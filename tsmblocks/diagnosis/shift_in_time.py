"""A change in proportion to the speed, which is a shift in time and no transmission that depends on the speed."""

from __future__ import annotations

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import Model

RATE_DEPENDENCE, COEFFICIENT, EXPONENT = "rate_dependence", "coefficient", "exponent"
"""The effect that changes a signal by a power of its speed, and its parameters."""
SHIFT_IN_TIME = "in proportion to the speed: a shift in time"
"""Why it is not named where that power is one."""
MIN_DISTANCE = 0.07
"""Distance of the exponent from 1 below which the change is a shift in time. Chosen: half of that of a stretch that
grows a little slower than the speed; a power of 0.93 or 1.07 is within 10 % of a line over a decade of speeds."""


def is_shift_in_time(model: Model, candidate: Candidate) -> bool:
    """Whether a transmission that depends on the speed does so in proportion: a dead time or a lag, or their lack.

    What a further mode, a wrong hold or a delay elsewhere leaves looks like that.
    """
    if candidate.effect.name != RATE_DEPENDENCE:
        return False
    exponents = [v for k, v in model.values.items() if k in candidate.free and k.rpartition(".")[2] == EXPONENT]
    return any(abs(one - 1) < MIN_DISTANCE for one in exponents)
