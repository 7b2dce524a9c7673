"""What changes over time have in common: their trial values, and their sizes in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tsmblocks.effects.sizes import UNTIL, in_proportion
from tsmblocks.effects.trials import Scales, Trials

SLOWEST_SETTLING = 1.5
"""Longest time constant of a change that settles [duration]. Derived: 51 % of it is left to come at the end; the
quadratic part of a slower one is small, and it is indistinguishable from a steady drift."""
TIME_CONSTANT = in_proportion("time constant", "time_constant", "s")
FROM_AND_UNTIL = in_proportion("from", "time", "s"), in_proportion(UNTIL, "until", "s")
INTERVAL = ("time", "until")
"""The instants of a change that ends again."""
AT = in_proportion("time", "time", "s")


def time_origin(scales: Scales) -> dict[str, float]:
    """Time counted from the first sample: from an earlier origin, a drift would include an offset."""
    return {"since": scales.start}


def duration(scales: Scales) -> float:
    """Time from the first sample to the last."""
    return max(scales.stop - scales.start, scales.step)


def settling_trials(size: Callable[[Scales], Mapping[str, float]], scales: Scales) -> Trials | None:
    """Trial values of a change that settles within the recording, or within each where they share no clock."""
    length = duration(scales) if scales.one_clock else scales.shortest
    fastest, slowest = 20 * scales.step, SLOWEST_SETTLING * length
    times = [time for time in (0.03 * length, 0.1 * length, 0.3 * length) if fastest <= time]
    if not times:
        return None
    shapes = tuple({"time_constant": time} for time in times)
    return Trials(size(scales), shapes, time_origin(scales), {"time_constant": (fastest, slowest)})
