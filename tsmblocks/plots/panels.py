"""What all figures share: colours, panels, units as people read them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from tsmblocks import units
from tsmblocks.errors import TsmError

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Lines stay apart for colour-blind readers and in print (Okabe and Ito)."""
INK, PALE = "#222222", "#d9d9d9"

QUANTITY = {"deg": "angle", "deg/s": "speed", "V": "voltage", "s": "time", "N": "force", "A": "current"}
"""What an axis shared by several signals of a unit is called."""
LEGEND: dict[str, Any] = {
    "loc": "center left",
    "bbox_to_anchor": (1.0, 0.5),
    "frameon": False,
    "fontsize": 9,
}


def shown(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Return a signal as a figure shows it: angles and their rates in degrees, anything else as it is."""
    k, wanted = units.for_people(unit)
    return (values if wanted == unit else k * values), wanted


def axes(ax: Any, count: int, *, height: float, width: float = 8.0) -> list[Any]:
    """Return the axes to draw on: those given, or ``count`` panels of a new figure over one time axis."""
    if ax is not None:
        given = list(np.ravel(ax))
        if len(given) != count:
            raise TsmError(f"ax must be {count} axes here, got {len(given)}.")
        return given
    figure = _figure((width, height * count))
    return list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def sheet(rows: int, columns: int, *, width: float, height: float, widths: Sequence[float]) -> tuple[Any, Any]:
    """A new figure with ``rows`` by ``columns`` panels, columns as wide as ``widths`` says; figure and panels."""
    figure = _figure((width, height * rows))
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw={"width_ratios": list(widths)})


def need_matplotlib() -> None:
    """Raise TsmError, with the way out, where figures cannot be drawn; before long work rather than after it."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise TsmError('Plots need matplotlib: pip install "tsmblocks[plots]"') from None


def _figure(size: tuple[float, float]) -> Any:
    need_matplotlib()
    from matplotlib.figure import Figure

    if "matplotlib.pyplot" in sys.modules:  # someone works with pyplot: plt.show() must find this figure
        return sys.modules["matplotlib.pyplot"].figure(figsize=size, layout="constrained")
    return Figure(figsize=size, layout="constrained")


def dress(panel: Any, *, legend: bool) -> None:
    """Give a panel its grid, without a frame, and a legend beside it where asked."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(color=PALE, lw=0.5)
    panel.set_axisbelow(True)
    panel.margins(x=0.01)
    if legend:
        panel.legend(**LEGEND)


def timed(panels: list[Any], title: str) -> None:
    """Name the time axis under the last panel, and the figure above the first."""
    panels[-1].set_xlabel("t [s]")
    if title:
        panels[0].set_title(title, loc="left", fontsize=11)
