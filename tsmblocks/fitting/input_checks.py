"""Outputs that lead the input: where no model does so, columns were exchanged, or one was recorded late."""

from __future__ import annotations

import numpy as np

from tsmblocks.common.rounding import to_digits

PLAIN = 0.25
"""Share of the residual of a proportional model that the rate of the input has to explain. Chosen."""
MOSTLY = 0.5
"""Share of an output that has to be in proportion to the input, and of the lead that a model has to show. Chosen."""
PARTS = 4
"""Parts of a recording that have to show the same lead. Chosen."""
SAME = 2.0
"""Ratio of two leads up to which they are the same. Chosen."""


def runs_ahead(names: tuple[str, str], t: np.ndarray, x: np.ndarray, y: np.ndarray, simulated: np.ndarray) -> str:
    """A warning if a measured output ``y`` leads the input ``x`` and ``simulated`` does not; ``""`` otherwise.

    ``names`` are those of input and output; all arrays have one value for each of the times ``t`` [s].
    """
    if len(t) < 4 or not np.ptp(x) > 0:
        return ""
    lead = _lead(t, x, y)
    if lead <= 0 or _lead(t, x, simulated) > MOSTLY * lead or not _throughout(lead, t, x, y):
        return ""
    if np.ptp(simulated) > 0 and not lead / SAME <= _lead(t, simulated, y) <= SAME * lead:
        return ""  # the simulation, earlier by the lead, would not agree either
    return (
        f"{names[1]} leads {names[0]} by {to_digits(lead)} s, and the model has no such lead: were the two exchanged, "
        "or was one recorded late?"
    )


def _throughout(lead: float, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> bool:
    """Whether every part in which the input moves shows the same lead: where it integrates, each has its own."""
    cuts = np.array_split(np.arange(len(t)), PARTS)
    shown = [_lead(t[k], x[k], y[k]) for k in cuts if len(k) >= 4 and np.std(x[k]) >= MOSTLY * np.std(x)]
    return all(lead / SAME <= one <= SAME * lead for one in shown)


def _lead(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Time [s] by which ``y`` leads ``x``, as its rate and its value explain ``y``; 0.0 where unclear."""
    x, y = x - x.mean(), y - y.mean()
    rate = np.gradient(x, t)
    rate = rate - rate.mean()
    slope = float(x @ y) / float(x @ x)
    along = rate - x * (float(x @ rate) / float(x @ x))
    rest = y - slope * x
    size, unexplained = float(along @ along), float(rest @ rest)
    if not (size > 0 and unexplained > 0):
        return 0.0
    gain = float(along @ rest) / size
    plain = gain**2 * size >= PLAIN * unexplained and abs(slope) * float(np.std(x)) >= MOSTLY * float(np.std(y))
    proportion = slope - gain * float(x @ rate) / float(x @ x)
    return gain / proportion if plain and proportion != 0 else 0.0
