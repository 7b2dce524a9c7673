"""Figures of differences between a baseline and a new run. Needs matplotlib, imported when a figure is made."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.data import heading
from tsmblocks.plots.panels import COLOURS, PALE, axes, dress, shown, timed

ROUNDED = 1e-5
"""Difference, as a share of a signal's size, below which it is that of the digits that a baseline keeps."""


def plot_tracking_changes(before: Any, now: Any, title: str, ax: Any = None) -> Any:
    """Signals that differ between a baseline and a new run, over time, each with its difference below.

    ``before`` and ``now`` have ``t`` [s], ``signals`` and ``signal_units``. Returns the figure.
    """
    both = [name for name in now.signals if name in before.signals]
    names = [name for name in both if _differs(before, now, name)] or both
    panels = axes(ax, 2 * len(names), height=1.7)
    for k, name in enumerate(names):
        above, below = panels[2 * k : 2 * k + 2]
        old, unit = shown(np.interp(now.t, before.t, before.signals[name]), now.signal_units[name])
        new, _ = shown(now.signals[name], now.signal_units[name])
        above.plot(now.t, old, color=PALE, lw=3.0, label="baseline")
        above.plot(now.t, new, color=COLOURS[0], lw=1.2, label="now")
        above.set_ylabel(heading(name, unit))
        dress(above, legend=True)
        below.plot(now.t, new - old, color=COLOURS[1], lw=1.2)
        below.set_ylabel("moved by")
        dress(below, legend=False)
    timed(panels, title)
    return panels[0].figure


def _differs(before: Any, now: Any, name: str) -> bool:
    old = np.interp(now.t, before.t, before.signals[name])
    return not np.allclose(now.signals[name], old, rtol=0.0, atol=ROUNDED * float(np.abs(old).max(initial=1e-12)))
