"""Reductions of a signal over time to one number, of which metrics are made. Pure functions of arrays."""

from __future__ import annotations

from collections.abc import Callable

import attrs
import numpy as np

from tsmblocks.common import displayed_units

Array = np.ndarray
DIMENSIONLESS = "1"
"""The unit of a share or a count."""


def _integral(e: Array, t: Array) -> Array:
    return np.sum(0.5 * (e[1:] + e[:-1]) * np.diff(t)[:, None], axis=0)


def _settling_time(e: Array, t: Array, band: float) -> Array:
    """Time to the instant after the last one outside the band; infinite where the run ends outside."""
    outside = np.abs(e) > band
    last = len(t) - 1 - np.argmax(outside[::-1], axis=0)  # meaningless where none is outside
    return np.where(outside.any(axis=0), np.append(t, np.inf)[last + 1], t[0]) - t[0]


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
    names of what else it takes, in the unit of the signal. ``unit`` is the unit of the number, by default the signal's.
    """

    about: str
    run: Callable[..., Array]
    numbers: tuple[str, ...] = ()
    unit: str = ""
    integrates: bool = False

    def unit_of(self, signal: str) -> str:
        """The unit of the number for a signal in this unit; ``""`` where it is not known."""
        return displayed_units.times(signal, "s") if self.integrates and signal else self.unit or signal


REDUCTIONS = {
    "peak_to_peak": Reduction("largest minus smallest value", lambda e, _: np.ptp(e, axis=0)),
    "rms": Reduction("root mean square", lambda e, _: np.sqrt(np.mean(e * e, axis=0))),
    "largest": Reduction("largest magnitude", lambda e, _: np.abs(e).max(axis=0)),
    "highest": Reduction("highest value", lambda e, _: e.max(axis=0)),
    "lowest": Reduction("lowest value", lambda e, _: e.min(axis=0)),
    "mean": Reduction("mean", lambda e, _: e.mean(axis=0)),
    "final": Reduction("last value", lambda e, _: e[-1]),
    "integral": Reduction("integral over time, by trapezoids", _integral, integrates=True),
    "variation": Reduction("sum of the magnitudes of all changes", lambda e, _: np.abs(np.diff(e, axis=0)).sum(axis=0)),
    # A comparison is given as its margin, which is above zero where it holds.
    "share": Reduction("share of the instants where it holds", lambda e, _: np.mean(e > 0, axis=0), (), DIMENSIONLESS),
    "settling_time": Reduction("time until the magnitude stays within a band", _settling_time, ("band",), "s"),
    "rise_time": Reduction("time from 10 % to 90 % of the step to a target", _rise_time, ("target",), "s"),
    "overshoot": Reduction(
        "largest excess, as a share of the step (0.12: 12 %)", _overshoot, ("target",), DIMENSIONLESS
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
RECIPES = {
    "ise": "integral(e**2)",
    "iae": "integral(abs(e))",
    "itae": "integral(t * abs(e))",
    "itse": "integral(t * e**2)",
}
"""Metrics that have a name elsewhere, as they are written here for an error e."""
