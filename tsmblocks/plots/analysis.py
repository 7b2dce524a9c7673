"""Figures of analysis: the frequency response of a diagram to sines of several amplitudes.

Needs matplotlib, imported when a figure is made.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.data import heading
from tsmblocks.plots.panels import COLOURS, axes, decimal, dress, shown


def plot_frequency_response(response: FrequencyResponse, ax: Any = None) -> Any:
    """Gain, phase and distortion over frequency, a line for each amplitude (angles in deg).

    Where the output is constant, or never becomes periodic, there is a cross below the gain. ``ax`` may be three axes.
    Returns the figure.
    """
    panels = axes(ax, 3, height=2.2)
    sizes, unit = shown(response.amplitudes, response.unit)
    gain = np.where(response.gain > 0, response.gain, np.nan)  # there is no zero on an axis of decades
    rows = ((gain, "gain"), (response.phase, "phase [deg]"), (100 * response.distortion, "distortion [%]"))
    for panel, (values, label) in zip(panels, rows, strict=True):
        for k, (amplitude, line) in enumerate(zip(sizes, values, strict=True)):
            panel.semilogx(
                response.frequencies,
                line,
                "o-",
                ms=3,
                lw=1.2,
                color=COLOURS[k % len(COLOURS)],
                label=f"{amplitude:.3g}",
            )
        panel.set_ylabel(label)
        dress(panel, legend=False)
    _mark_undefined(panels[0], response.frequencies, gain)
    panels[0].set_yscale("log")
    decimal(panels[0].yaxis)
    for panel in panels:
        decimal(panel.xaxis)
    panels[-1].set_xlabel("frequency [Hz]")
    panels[0].legend(
        title=heading(f"size of {response.driven}", unit),
        frameon=False,
        fontsize=9,
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
    panels[0].set_title(f"{response.title}: {response.output} over {response.driven}", loc="left", fontsize=11)
    return panels[0].figure


def _mark_undefined(panel: Any, frequencies: np.ndarray, gain: np.ndarray) -> None:
    """A cross at each frequency without a gain (amplitudes by frequencies), at the lower edge of the panel."""
    for k, line in enumerate(gain):
        none = frequencies[np.isnan(line)]
        if len(none):
            panel.plot(
                none,
                np.zeros(len(none)),
                "x",
                ms=5,
                color=COLOURS[k % len(COLOURS)],
                clip_on=False,
                transform=panel.get_xaxis_transform(),
                label="_no answer",
            )
