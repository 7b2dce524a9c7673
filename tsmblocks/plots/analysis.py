"""Figures of analysis: the frequency response of a diagram to sines of several amplitudes."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.data import heading
from tsmblocks.plots.panels import COLOURS, LEGEND, axes, decimal, dress, head, shown


def plot_frequency_response(response: FrequencyResponse, ax: Any = None) -> Any:
    """Gain, phase and distortion over frequency, a line for each amplitude (angles in deg).

    Where the output is constant, or never becomes periodic, there is a cross below the gain. ``ax`` may be three axes.
    """
    panels = axes(ax, 3, height=2.2)
    sizes, unit = shown(response.amplitudes, response.unit)
    gain = np.where(response.gain > 0, response.gain, np.nan)  # there is no zero on an axis of decades
    rows = ((gain, "gain"), (response.phase, "phase [deg]"), (100 * response.distortion, "distortion [%]"))
    for panel, (values, label) in zip(panels, rows, strict=True):
        for amplitude, line, colour in zip(sizes, values, cycle(COLOURS), strict=False):
            panel.semilogx(response.frequencies, line, "o-", ms=3, lw=1.2, color=colour, label=f"{amplitude:.3g}")
        dress(panel, ylabel=label)
    for line, colour in zip(gain, cycle(COLOURS), strict=False):
        undefined = response.frequencies[np.isnan(line)]
        if len(undefined):
            across = panels[0].get_xaxis_transform()
            mark: dict[str, Any] = dict(ms=5, color=colour, clip_on=False, transform=across, label="_no answer")
            panels[0].plot(undefined, np.zeros(len(undefined)), "x", **mark)
    panels[0].set_yscale("log")
    for axis in (panels[0].yaxis, *(panel.xaxis for panel in panels)):
        decimal(axis)
    panels[-1].set_xlabel("frequency [Hz]")
    panels[0].legend(title=heading(f"size of {response.driven}", unit), **LEGEND)
    head(panels[0], f"{response.title}: {response.output} over {response.driven}", 11)
    return panels[0].figure
