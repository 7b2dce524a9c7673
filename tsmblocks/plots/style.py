"""The one style of all figures: sizes, fonts and colours, in force while a figure is made, and never after it."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any
from weakref import WeakSet

import numpy as np

from tsmblocks.common.errors import TsmError, in_words
from tsmblocks.common.palette import LIGHT, NOISE_OPACITY, SERIES

INK, RULE, MEASURED = LIGHT["ink"], LIGHT["rule"], LIGHT["measured"]
BEFORE, MODEL, PALE, NOISE = LIGHT["before"], LIGHT["after"], LIGHT["between"], LIGHT["floor"]
"""Text and zero lines, grid, a measurement; a model before a change, the model, what is paler than it, the noise."""
RESIDUAL = LIGHT["soft"]
"""A residual of a fit. Figures have no small print, whose colour it is on pages."""
WIDE, COLUMN = 7.0, 3.4
"""Widths of a figure [in]: both columns of a paper, the default, and one column."""
NARROW = 5.0
"""Width [in] below which panels stand below each other. Chosen: two panels of one column need no less."""
LEAST, MOST = 2.0, 40.0
"""Widths [in] that can be asked for. Chosen: less has no room for an axis, more is a unit mistaken."""
STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelpad": 4.0,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": "medium",
    "axes.titlepad": 4.0,
    "errorbar.capsize": 0.0,
    "figure.titlesize": "large",
    "font.size": 8.0,
    "grid.color": RULE,
    "grid.linewidth": 0.4,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.4,
    "legend.frameon": False,
    "legend.fontsize": "medium",
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}
"""Settings of matplotlib, except those that the user has changed. Texts are 8 pt, as a journal's captions are."""
LAZY = {"labelsize": "tick.labelsize", "width": "tick.major.width"}
"""Settings that matplotlib reads when a tick is first drawn, which is after the style is in force."""
_OF_A_SCRIPT: ContextVar[bool] = ContextVar("of_a_script", default=False)
"""Whether figures are made by ``value.plot()``, so that ``plt.show()`` must find them."""
_MADE: WeakSet[Any] = WeakSet()
"""Figures that were made here."""


def need_matplotlib() -> None:
    """Raise TsmError, with the way out, where figures cannot be drawn; before long work rather than after it."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise TsmError('Plots need matplotlib: pip install "tsmblocks[plots]"') from None


def styled(make: Callable[..., Any]) -> Callable[..., Any]:
    """A function that draws in the style of all figures where it makes one; on axes of the caller, in theirs."""
    signature = inspect.signature(make)

    @functools.wraps(make)
    def made(*args: Any, **options: Any) -> Any:
        need_matplotlib()
        ax = signature.bind(*args, **options).arguments.get("ax")
        if ax is not None and not all(is_own(panel) for panel in np.ravel(np.array(ax, dtype=object))):
            return make(*args, **options)
        with _in_force():
            return make(*args, **options)

    return made


@contextmanager
def _in_force() -> Iterator[None]:
    """The style, but for settings that the user has changed."""
    from matplotlib import rc_context, rcParams, rcParamsDefault

    with rc_context({k: v for k, v in STYLE.items() if rcParams[k] == rcParamsDefault[k]}):
        yield


def is_own(panel: Any) -> bool:
    """Whether axes are those of a figure that was made here, which has the style."""
    return getattr(panel, "figure", None) in _MADE


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


def width_of(width: float | None) -> float:
    """The width of a new figure [in]. Raises TsmError for one that no figure can have."""
    if width is None:
        return WIDE
    if isinstance(width, bool) or not isinstance(width, (int, float)) or not LEAST <= width <= MOST:
        raise TsmError(f"width must be a number of inches from {LEAST:g} to {MOST:g}, got {in_words(width)}.")
    return float(width)


def new_figure(width: float, height: float) -> Any:
    """A figure of a size [in]: of pyplot in a script, so that ``plt.show()`` finds it, else of its own."""
    from tsmblocks.plots.notebook import NotebookFigure

    made: dict[str, Any] = {"figsize": (width, height), "layout": "constrained"}
    figure = None
    notebook = "ipykernel" in sys.modules  # it shows a figure that is returned, and would show one of pyplot twice
    if not notebook and ("matplotlib.pyplot" in sys.modules or _OF_A_SCRIPT.get()):
        with suppress(ImportError):  # the backend that is set needs a screen, and there is none
            import matplotlib.pyplot as plt

            figure = plt.figure(**made)
    figure = figure or NotebookFigure(**made)
    _MADE.add(figure)
    return figure


def fix_ticks(panel: Any) -> None:
    """Give a new panel those settings that matplotlib reads later, when the style is no longer in force."""
    from matplotlib import rcParams

    for axis in ("x", "y"):
        panel.tick_params(axis=axis, **{name: rcParams[f"{axis}{setting}"] for name, setting in LAZY.items()})
        if rcParams["axes.grid"]:
            panel.grid(axis=axis, color=rcParams["grid.color"], lw=rcParams["grid.linewidth"])


def series() -> list[str]:
    """Colours that tell signals apart: those of the user where they have changed them."""
    from matplotlib import rcParams, rcParamsDefault

    own = rcParams["axes.prop_cycle"]
    return own.by_key().get("color", []) if own != rcParamsDefault["axes.prop_cycle"] else [LIGHT[k] for k in SERIES]


NOISE_BAND: dict[str, Any] = {"color": NOISE, "alpha": NOISE_OPACITY, "lw": 0}
"""Arguments of the band of the noise."""
WHITE_BAND: dict[str, Any] = {"color": RESIDUAL, "alpha": NOISE_OPACITY, "lw": 0}
"""Arguments of the band in which the autocorrelation of a residual without structure lies."""
