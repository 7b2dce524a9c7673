"""Figures of analysis: the frequency response of a diagram to sines of several amplitudes."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.common.displayed_units import times
from tsmblocks.common.units import same
from tsmblocks.data import heading
from tsmblocks.plots.panels import axes, decimal, dress, entitle, key, phase_ticks, shown
from tsmblocks.plots.style import series, styled

LEAST_DISTORTION = 0.1
"""Top of the axis of the distortion at least [%]. Chosen: less is as good as none, and may be rounding."""


@styled
def plot_frequency_response(response: FrequencyResponse, ax: Any = None, *, width: float | None = None) -> Any:
    """Gain in dB, phase in deg and distortion over frequency, a line for each amplitude (angles in deg).

    Where the output is constant, or never becomes periodic, there is a cross below the gain. ``ax`` may be three axes;
    ``width`` [in] is that of a new figure.
    """
    panels = axes(ax, 3, height=1.8, width=width)
    sizes, unit = shown(response.amplitudes, response.unit)
    gain = np.where(response.gain > 0, response.gain, np.nan)  # zero has no decibels
    rows = (
        (20.0 * np.log10(gain), f"gain [{_decibels(response)}]"),
        (response.phase, "phase [deg]"),
        (100 * response.distortion, "distortion [%]"),
    )
    for panel, (values, label) in zip(panels, rows, strict=True):
        for amplitude, line, colour in zip(sizes, values, cycle(series()), strict=False):
            panel.semilogx(response.frequencies, line, "o-", color=colour, label=f"{amplitude:.3g}")
        dress(panel, ylabel=label, margin=0.03)
    for line, colour in zip(gain, cycle(series()), strict=False):
        undefined = response.frequencies[np.isnan(line)]
        if len(undefined):
            across = panels[0].get_xaxis_transform()
            mark: dict[str, Any] = dict(ms=5, color=colour, clip_on=False, transform=across, label="_no answer")
            panels[0].plot(undefined, np.zeros(len(undefined)), "x", **mark)
    phase_ticks(panels[1])
    panels[2].set_ylim(0.0, max(panels[2].get_ylim()[1], LEAST_DISTORTION))
    for panel in panels:
        decimal(panel.xaxis)
    panels[-1].set_xlabel("frequency [Hz]")
    key(panels[0], title=heading(f"amplitude of {response.driven}", unit))
    if ax is None:
        entitle(panels[0].figure, f"{response.title}: {response.output} / {response.driven}")
    return panels[0].figure


def _decibels(response: FrequencyResponse) -> str:
    """The unit of the gain: what 0 dB is, where input and output have different units."""
    one, other = response.output_unit, response.unit
    return "dB" if not one or not other or same(one, other) else f"dB re 1 {times(one, other, -1)}"
