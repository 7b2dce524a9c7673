"""Reductions of a signal over time to one number, of which metrics are made. Pure functions of arrays."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common import units

Array = np.ndarray
DIMENSIONLESS = "1"
"""The unit of a share or a count."""


def _peak_to_peak(e: Array, _: Array) -> Array:
    return e.max(axis=0) - e.min(axis=0)


def _rms(e: Array, _: Array) -> Array:
    return np.sqrt(np.mean(e * e, axis=0))


def _largest(e: Array, _: Array) -> Array:
    return np.abs(e).max(axis=0)


def _highest(e: Array, _: Array) -> Array:
    return e.max(axis=0)


def _lowest(e: Array, _: Array) -> Array:
    return e.min(axis=0)


def _mean(e: Array, _: Array) -> Array:
    return e.mean(axis=0)


def _final(e: Array, _: Array) -> Array:
    return e[-1]


def _integral(e: Array, t: Array) -> Array:
    return np.sum(0.5 * (e[1:] + e[:-1]) * np.diff(t)[:, None], axis=0)


def _variation(e: Array, _: Array) -> Array:
    return np.abs(np.diff(e, axis=0)).sum(axis=0)


def _share(e: Array, _: Array) -> Array:
    """Share of the instants at which a comparison holds, whose margin ``e`` is then above zero."""
    return np.mean(e > 0, axis=0)


def _settling_time(e: Array, t: Array, band: float) -> Array:
    """Time to the instant after the last one outside the band; infinite where the run ends outside."""
    outside = np.abs(e) > band
    last = len(t) - 1 - np.argmax(outside[::-1], axis=0)  # where none is outside, of no meaning
    settled = np.where(outside.any(axis=0), np.append(t, np.inf)[last + 1], t[0])
    return settled - t[0]


def _rise_time(e: Array, t: Array, target: float) -> Array:
    """Time from 10 % to 90 % of a step, each when it is first passed; infinite where it never is."""
    done = _step_share(e, target)
    passed = [done >= share for share in (0.1, 0.9)]
    # ``argmax`` is 0 where no instant passes, too; inf - inf would be NaN, hence the two choices below.
    first, last = (np.where(p.any(axis=0), t[np.argmax(p, axis=0)], np.inf) for p in passed)
    return np.where(np.isfinite(last), last - np.where(np.isfinite(first), first, 0.0), np.inf)


def _overshoot(e: Array, _: Array, target: float) -> Array:
    return np.maximum(_step_share(e, target).max(axis=0) - 1.0, 0.0)


def _step_share(e: Array, target: float) -> Array:
    """Share of the step from the first value to the target that is done."""
    return (e - e[0]) / (target - e[0])


@attrs.frozen
class Reduction:
    """A reduction of a signal to one number.

    ``run(e, t, *numbers)`` takes a signal (N, runs) and the instants (N,) in s and gives (runs,); ``numbers`` are the
    names of what else it takes, in the unit of the signal. ``unit`` gives the unit of the number from the signal's.
    """

    about: str
    run: Callable[..., Array]
    numbers: tuple[str, ...] = ()
    unit: Callable[[str], str] = lambda label: label


REDUCTIONS = {
    "peak_to_peak": Reduction("largest minus smallest value", _peak_to_peak),
    "rms": Reduction("root mean square", _rms),
    "largest": Reduction("largest magnitude", _largest),
    "highest": Reduction("highest value", _highest),
    "lowest": Reduction("lowest value", _lowest),
    "mean": Reduction("mean", _mean),
    "final": Reduction("last value", _final),
    "integral": Reduction("integral over time, by trapezoids", _integral, unit=lambda label: units.times(label, "s")),
    "variation": Reduction("total variation: the sum of the magnitudes of all changes", _variation),
    "share": Reduction("share of the instants at which a comparison holds", _share, unit=lambda _: DIMENSIONLESS),
    "settling_time": Reduction(
        "time until the magnitude stays within a band; infinite where it never does",
        _settling_time,
        ("band",),
        lambda _: "s",
    ),
    "rise_time": Reduction(
        "time from 10 % to 90 % of the step to a target; infinite where it is never reached",
        _rise_time,
        ("target",),
        lambda _: "s",
    ),
    "overshoot": Reduction(
        "largest excess over a target, as a share of the step to it", _overshoot, ("target",), lambda _: DIMENSIONLESS
    ),
}
"""Reductions by name. ``share`` is given a comparison; all others a signal."""

OTHER_NAMES = {
    "travel": "variation",
    "total_variation": "variation",
    "tv": "variation",
    "ptp": "peak_to_peak",
    "std": "rms",
    "maximum": "highest",
    "minimum": "lowest",
    "average": "mean",
}
"""Names of reductions in other programs, for messages."""
