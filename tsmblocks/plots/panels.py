"""What all figures share: colours, panels, units as people read them."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from typing import Any

import numpy as np

from tsmblocks.common import units
from tsmblocks.common.errors import TsmError

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Lines stay apart for colour-blind readers and in print (Okabe and Ito)."""
INK, PALE = "#222222", "#d9d9d9"

QUANTITY = {"deg": "angle", "deg/s": "speed", "V": "voltage", "s": "time", "N": "force", "A": "current"}
"""Label of an axis shared by several signals of a unit."""
FEW, MANY = 20.0, 2000.0
"""Ranges of a logarithmic axis: below, more ticks between powers of ten are needed; above, they would be too many."""
INSIDE: dict[str, Any] = {"frameon": False, "fontsize": 9}
SMALL: dict[str, Any] = {"frameon": False, "fontsize": 8}
LEGEND: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), **INSIDE}
"""Arguments of legends: inside a panel, in a small one, and beside it."""


def shown(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Return a signal as a figure shows it: angles and their rates in degrees, anything else as it is."""
    k, wanted = units.display_unit(unit)
    return (values if wanted == unit else k * values), wanted


def axes(ax: Any, count: int, *, height: float, width: float = 8.0) -> list[Any]:
    """Return the axes to draw on: those given, or ``count`` panels of a new figure over one time axis."""
    if ax is not None:
        return _given(ax, count)
    return list(_figure((width, height * count)).subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def _given(ax: Any, count: int) -> list[Any]:
    given = list(np.ravel(np.array(ax, dtype=object)))
    if len(given) != count:
        raise TsmError(f"ax must be {count} axes here, got {len(given)}.")
    return given


def sheet(
    ax: Any, rows: int, columns: int, *, width: float, height: float, widths: Sequence[float] | None = None
) -> tuple[Any, Any]:
    """``rows`` by ``columns`` panels: the axes given, row by row, or those of a new figure; figure and panels.

    ``widths`` are those of the columns of a new figure, relative to each other. Raises TsmError for another number
    of axes.
    """
    if ax is not None:
        given = _given(ax, rows * columns)
        return given[0].figure, np.array(given, dtype=object).reshape(rows, columns)
    figure = _figure((width, height * rows))
    return figure, figure.subplots(rows, columns, squeeze=False, width_ratios=widths)


def need_matplotlib() -> None:
    """Raise TsmError, with the way out, where figures cannot be drawn; before long work rather than after it."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise TsmError('Plots need matplotlib: pip install "tsmblocks[plots]"') from None


_OF_A_SCRIPT: ContextVar[bool] = ContextVar("of_a_script", default=False)
"""Whether figures are made by ``value.plot()``, so that ``plt.show()`` must find them."""


def usual(make: Callable[..., Any]) -> Callable[..., Any]:
    """The function of ``value.plot()``: figures that it makes are pyplot's, which a script can show."""

    @functools.wraps(make)
    def made(*args: Any, **options: Any) -> Any:
        token = _OF_A_SCRIPT.set(True)
        try:
            return make(*args, **options)
        finally:
            _OF_A_SCRIPT.reset(token)

    return made


def _figure(size: tuple[float, float]) -> Any:
    need_matplotlib()
    from matplotlib.figure import Figure

    made = {"figsize": size, "layout": "constrained"}
    if "matplotlib.pyplot" in sys.modules:  # someone works with pyplot: plt.show() must find this figure
        return sys.modules["matplotlib.pyplot"].figure(**made)
    if _OF_A_SCRIPT.get() and "ipykernel" not in sys.modules:  # a notebook shows a figure that is returned
        try:
            import matplotlib.pyplot as plt

            return plt.figure(**made)  # type: ignore[arg-type]
        except ImportError:  # the backend that is set needs a screen, and there is none
            return Figure(**made)  # type: ignore[arg-type]
    return Figure(**made)  # type: ignore[arg-type]


def dress(
    panel: Any, xlabel: str = "", ylabel: str = "", *, legend: Mapping[str, Any] | None = None, margin: float = 0.01
) -> None:
    """Name the axes of a panel, give it its grid, without a frame, and a legend with these arguments if there are."""
    if xlabel:
        panel.set_xlabel(xlabel)
    if ylabel:
        panel.set_ylabel(ylabel)
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(color=PALE, lw=0.5)
    panel.set_axisbelow(True)
    panel.margins(x=margin)
    if legend is not None:
        panel.legend(**legend)


def head(panel: Any, text: str, size: float = 10, *, weight: str = "normal") -> None:
    """Write a title above the left end of a panel."""
    panel.set_title(text, loc="left", fontsize=size, fontweight=weight)


def decimal(axis: Any) -> None:
    """Name ticks of a logarithmic axis 0.2, 0.5, 1 rather than by powers of ten, as far as there is room."""
    from matplotlib.ticker import LogLocator

    low, high = axis.get_view_interval()
    if low > 0 and high / low < MANY:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if high / low > FEW else (2.0, 3.0, 4.0, 5.0, 7.0)))
        axis.set_minor_formatter("{x:g}")
        axis.set_major_formatter("{x:g}")


def timed(panels: list[Any], title: str) -> None:
    """Name the time axis under the last panel, and the figure above the first."""
    panels[-1].set_xlabel("t [s]")
    if title:
        head(panels[0], title, 11)
