"""Panels of figures: where they stand, their names, legends and ticks, and units as people read them."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tsmblocks.common import displayed_units, headings
from tsmblocks.common.errors import TsmError
from tsmblocks.plots.style import NARROW, fix_ticks, is_own, new_figure, width_of

QUANTITY = {
    "deg": "angle",
    **dict.fromkeys(("rad/s", "deg/s", "rpm"), "speed"),
    "V": "voltage",
    "s": "time",
    "N": "force",
    "A": "current",
}
"""Label of an axis shared by several signals of a unit."""
MANY = 2000.0
"""Range of a logarithmic axis above which ticks with names between powers of ten would be too many."""
LEAST_NAMES = 3
"""Ticks with names that an axis needs at least. Chosen: two do not show that it is logarithmic."""
DIGITS = range(1, 10)
"""First digits that a number can have."""
FINE = 0.5
"""Width of the lines of a grid between powers of ten, as a share of that of the others. Chosen."""
SEVERAL_SIGNS = 3.6
"""Width of the signs of a legend in which a label has several [font sizes]. Chosen: three fit in it."""
LETTER, HANDLE = 0.075, 0.42
"""Widths of a letter and of a line with its space in a legend [in]. Measured at 8 pt."""
LINE, PAD = 12.0, 7.0
"""Height of a line of a legend, and space above it [pt]. Measured at 8 pt."""
MARGIN = 0.6
"""Width of a y axis with its numbers and label [in]."""
ABOVE: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
"""Place of a legend above a panel."""
PHASE_TICKS = ((90.0, 15.0), (270.0, 45.0), (720.0, 90.0), (math.inf, 180.0))
"""Range of a phase [deg] up to which ticks stand so many degrees apart."""
LOG_RANGE = 10.0
"""Least ratio of the largest to the smallest value on a logarithmic axis. Chosen: below, a linear one reads as well."""


# ---- values as people read them -----------------------------------------------------------------


def shown(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Return a signal as tables show it: angles and their rates in degrees, anything else as it is."""
    k, wanted = displayed_units.display_unit(unit)
    return (values if wanted == unit else k * values), wanted


def scaled(unit: str, *signals: Any) -> tuple[list[np.ndarray], str]:
    """Return signals of one unit as an axis shows them: angles in degrees, small or large ones with a prefix (mV)."""
    arrays = [np.asarray(values, dtype=float) for values in signals]
    size = max((float(np.abs(v[np.isfinite(v)]).max(initial=0.0)) for v in arrays), default=0.0)
    k, label = displayed_units.axis_unit(unit, size)
    return [k * v if k != 1.0 else v for v in arrays], label


def in_time(t: np.ndarray) -> tuple[np.ndarray, str]:
    """Return instants in s as an axis shows them, and the label of the axis."""
    (t,), unit = scaled("s", t)
    return t, headings.heading("t", unit)


# ---- where panels stand -------------------------------------------------------------------------


def axes(ax: Any, count: int, *, height: float, width: float | None = None) -> list[Any]:
    """Return the axes to draw on: those given, or ``count`` panels of a new figure over one time axis."""
    if ax is not None:
        return _given(ax, count)
    figure = new_figure(width_of(width), height * count)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for panel in panels:
        fix_ticks(panel)
    figure.align_ylabels(panels)
    return panels


def _given(ax: Any, count: int) -> list[Any]:
    given = list(np.ravel(np.array(ax, dtype=object)))
    if len(given) != count:
        raise TsmError(f"ax must be {count} axes here, got {len(given)}.")
    return given


def sheet(
    ax: Any, rows: int, layout: str, *, height: float, width: float | None = None, widths: Sequence[float] | None = None
) -> tuple[Any, Any]:
    """Panels of several ``rows``, each arranged as ``layout``: the axes given, or those of a new figure.

    Parameters
    ----------
    ax : axes or None
        As many as the layout has letters, in their order, for each row.
    rows : int
        How often the layout is repeated.
    layout : str
        Letters of the panels by their place, such as ``"AC/BD"``; A is the first. In a figure narrower than
        ``NARROW`` they stand below each other.
    height : float
        Height of one line of panels [in].
    width : float, optional
        Width of the figure [in].
    widths : sequence of float, optional
        Widths of the columns, relative to each other.

    Returns
    -------
    tuple of Figure and ndarray
        The figure, and its panels, a row each.
    """
    letters = sorted(set(layout) - {"/"})
    if ax is not None:
        given = _given(ax, rows * len(letters))
        return given[0].figure, np.array(given, dtype=object).reshape(rows, len(letters))
    wide = width_of(width)
    lines = layout.split("/") if wide >= NARROW else letters
    figure = new_figure(wide, height * len(lines) * rows)
    spec = figure.add_gridspec(rows * len(lines), len(lines[0]), width_ratios=widths if wide >= NARROW else None)
    panels = np.empty((rows, len(letters)), dtype=object)
    for row in range(rows):
        for k, letter in enumerate(letters):
            down = [row * len(lines) + j for j, line in enumerate(lines) if letter in line]
            across = [j for line in lines for j, one in enumerate(line) if one == letter]
            place = spec[min(down) : max(down) + 1, min(across) : max(across) + 1]
            panels[row, k] = figure.add_subplot(place)
            fix_ticks(panels[row, k])
    return figure, panels


def aligned(figure: Any, panels: Iterable[Any], *, own: bool) -> None:
    """Set the labels of y axes in one line, of panels that stand below each other in a figure of our own.

    Panels without such a label are left out: names beside their bars would push the others' labels away.
    """
    if own:
        figure.align_ylabels([panel for panel in panels if panel.get_ylabel()])


# ---- names, legends, ticks ----------------------------------------------------------------------


def dress(panel: Any, xlabel: str = "", ylabel: str = "", *, margin: float = 0.01) -> None:
    """Name the axes of a panel, and leave that share of its width free beside the data."""
    if xlabel:
        panel.set_xlabel(xlabel)
    if ylabel:
        panel.set_ylabel(ylabel)
    panel.margins(x=margin)


def key(panel: Any, title: str = "", *, over: str = "") -> None:
    """A legend of what has a label, in as many columns as fit: above a panel of a figure made here, else inside.

    ``title`` is that of the legend, and ``over`` a title of the panel that stands over both.
    """
    labels = [label for label in panel.get_legend_handles_labels()[1] if label]
    lines = 0
    if labels and is_own(panel):
        columns = columns_of(labels, _share(panel) * panel.figure.get_figwidth() - MARGIN)
        lines = math.ceil(len(labels) / columns) + bool(title)
        panel.legend(**ABOVE, ncols=columns, title=title or None, alignment="left")
    elif labels:
        panel.legend(title=title or None)
    if over:
        head(panel, over, lines=lines)


def shared_key(figure: Any, panels: Any, *, own: bool) -> None:
    """One legend below all panels, each label once; on a figure of the caller one in each panel.

    A label of bars as well as of lines or dots has each of these signs.
    """
    from matplotlib.legend_handler import HandlerTuple

    named: dict[str, dict[type, Any]] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            named.setdefault(label, {}).setdefault(type(handle), handle)
        if not own:
            key(panel)
    if own:
        signs = [tuple(kinds.values()) for kinds in named.values()]
        several = {"handlelength": SEVERAL_SIGNS} if any(len(one) > 1 for one in signs) else {}
        extra = LETTER * 2 * (SEVERAL_SIGNS - 1.6) if several else 0.0
        columns = columns_of(list(named), figure.get_figwidth() - 0.2, HANDLE + extra)
        spread = {tuple: HandlerTuple(ndivide=None, pad=0.3)}
        figure.legend(signs, named, ncols=columns, loc="outside lower left", handler_map=spread, **several)


def _share(panel: Any) -> float:
    """The share of the figure's width that a panel has."""
    place = panel.get_subplotspec()
    grid = place.get_gridspec()
    ratios = np.array(grid.get_width_ratios(), dtype=float)
    return float(ratios[place.colspan.start : place.colspan.stop].sum() / ratios.sum())


def columns_of(labels: Sequence[str], room: float, sign: float = HANDLE) -> int:
    """Columns of a legend that is no wider than ``room`` [in]; matplotlib fills one column after the other.

    ``sign`` is the width of a line with its space [in].
    """
    for columns in range(len(labels), 1, -1):
        parts = np.array_split([LETTER * len(label) + sign for label in labels], columns)
        if sum(float(part.max()) for part in parts) <= room:
            return columns
    return 1


def head(panel: Any, text: str, *, weight: str = "normal", lines: int = 0) -> None:
    """Write a title above the left end of a panel, and above so many lines of a legend."""
    panel.set_title(text, loc="left", fontweight=weight, pad=LINE * lines + PAD if lines else None)


def entitle(figure: Any, text: str) -> None:
    """Write the title of a figure of our own above its left end."""
    if text:
        figure.suptitle(folded(text, figure.get_figwidth()), x=0.01, ha="left")


def folded(text: str, room: float) -> str:
    """A text in lines that are no wider than ``room`` [in]."""
    return textwrap.fill(text, max(int(room / LETTER), 1), break_on_hyphens=False)


def decimal(axis: Any) -> None:
    """Name ticks of a logarithmic axis 0.2, 0.5, 1 rather than by powers of ten, as far as there is room.

    Names stand at 1, 2 and 5 of each decade, or at every digit where fewer than three of these are in sight; there is
    a fine line of the grid at every digit.
    """
    from matplotlib import rcParams
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

    low, high = axis.get_view_interval()
    if low <= 0 or high / low >= MANY:
        return
    if _in_sight(low, high, DIGITS) < LEAST_NAMES - 1:  # so short that it is as good as linear
        axis.set_major_locator(MaxNLocator(5))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())
        return
    named = (1, 2, 5) if _in_sight(low, high, (1, 2, 5)) >= LEAST_NAMES else DIGITS
    plain = StrMethodFormatter("{x:g}")
    axis.set_minor_locator(LogLocator(subs=DIGITS[1:]))
    axis.set_minor_formatter(FuncFormatter(lambda x, _: plain(x) if _digit(x) in named else ""))
    axis.set_major_formatter(plain)
    major, minor = (axis.get_tick_params(which) for which in ("major", "minor"))
    prefix = f"{axis.axis_name}tick"
    out = major.get("length", rcParams[f"{prefix}.major.size"]) + major.get("pad", rcParams[f"{prefix}.major.pad"])
    pad = out - minor.get("length", rcParams[f"{prefix}.minor.size"])
    axis.set_tick_params(which="minor", pad=pad, labelsize=major.get("labelsize"))
    if is_own(axis.axes) and rcParams["axes.grid"]:
        axis.grid(which="minor", color=rcParams["grid.color"], lw=FINE * rcParams["grid.linewidth"])


def _digit(x: float) -> int:
    """The first digit of a number that has one."""
    return round(x / 10.0 ** math.floor(math.log10(x) + 1e-9))


def _in_sight(low: float, high: float, digits: Iterable[int]) -> int:
    """How many numbers of one of these digits, times a power of ten, lie from ``low`` to ``high``."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return sum(low <= digit * 10.0**k <= high for k in decades for digit in digits)


def phase_ticks(panel: Any) -> None:
    """A y axis of degrees from one multiple of 45 to another, with ticks at these, or at a part where it is short."""
    from matplotlib.ticker import MultipleLocator

    low, high = sorted(panel.get_ylim())
    low, high = 45.0 * math.floor(low / 45.0), 45.0 * math.ceil(high / 45.0)
    panel.set_ylim(low, high)
    panel.yaxis.set_major_locator(MultipleLocator(next(step for most, step in PHASE_TICKS if high - low <= most)))


def log_spaced(values: np.ndarray) -> bool:
    """Whether values are spread more evenly in their logarithm: those of a plan with ``scale = "log"``."""
    values = values[np.isfinite(values)]
    if not len(values) or values.min() <= 0 or values.max() < LOG_RANGE * values.min():
        return False
    evenness = []
    for v in (np.unique(values), np.log(np.unique(values))):
        place = (v - v[0]) / (v[-1] - v[0])
        evenness.append(float(np.abs(place - np.linspace(0.0, 1.0, len(v))).max()))
    return evenness[1] < evenness[0]


def scale_as(panel: Any, values: np.ndarray, direction: str = "x") -> None:
    """A logarithmic axis where its values are spread that way."""
    if log_spaced(values):
        getattr(panel, f"set_{direction}scale")("log")
        decimal(getattr(panel, f"{direction}axis"))
