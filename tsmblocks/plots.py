"""Figures of runs: signals over time, tracking with its error, hysteresis loops.

Angles are stored in rad and shown in deg, as the paper shows them. Every function draws on the axes it
is given, or makes a figure, and returns the figure. Needs matplotlib, imported when a figure is made.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tsmblocks import units
from tsmblocks.data import heading
from tsmblocks.errors import TsmError
from tsmblocks.measures import tracking_error
from tsmblocks.run import Run

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Lines stay apart for colour-blind readers and in print (Okabe and Ito)."""
INK, PALE = "#222222", "#d9d9d9"


def plot_run(run: Run, names: Iterable[str] = (), ax: Any = None) -> Any:
    """Signals of a run over time in s, the diagram's outputs unless named.

    Signals of one unit share a panel; with ``ax``, all are drawn on that one. Returns the figure.
    Raises RunError for an unknown name.
    """
    chosen = list(names) or list(run.aliases) or run.keys()
    groups: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name in chosen:
        values, unit = _shown(run[name], run.unit(name))
        groups.setdefault(unit, []).append((name, values))
    panels = _axes(None, len(groups), height=2.4) if ax is None else [ax] * len(groups)
    count = 0
    for panel, (unit, lines) in zip(panels, groups.items(), strict=True):
        for name, values in lines:
            panel.plot(run.t, values, color=COLOURS[count % len(COLOURS)], lw=1.4, label=name)
            count += 1
        alone = lines[0][0] if len(lines) == 1 else ""
        panel.set_ylabel(heading(alone or _QUANTITY.get(unit, ""), unit).strip())
        _dress(panel, legend=len(lines) > 1)
    if ax is not None and len(groups) > 1:
        panels[0].set_ylabel(", ".join(heading(_QUANTITY.get(u, ""), u).strip() for u in groups if u))
        _dress(panels[0], legend=True)
    _timed(panels, run.title if ax is None else "")
    return panels[0].figure


def plot_tracking(
    runs: Mapping[str, Run], ax: Sequence[Any] | None = None, *, title: str = "", after: float | None = None,
    reference: str = "x_ref", output: str = "x_out",
) -> Any:  # fmt: skip
    """Draw reference and outputs of several runs over time, by label, and below them the errors.

    ``ax`` may be two axes, for the signals and the errors. With ``after`` [s], what comes before is left
    out. The legend gives the peak-to-peak error from there on, by default over the second half of each run.
    Returns the figure.
    """
    if not runs:
        raise TsmError("plot_tracking needs at least one run.")
    above, below = _axes(ax, 2, height=2.9)
    for k, (label, run) in enumerate(runs.items()):
        kept = run.t >= (run.t[0] if after is None else after)
        t, unit = run.t[kept], run.unit(reference)
        wanted, reached = (_shown(run[name][kept], unit) for name in (reference, output))
        unit = wanted[1]
        if k == 0:
            above.plot(t, wanted[0], color=INK, lw=1.2, ls=(0, (4, 2)), label="reference")
        error = tracking_error(wanted[0], reached[0], t=t, unit=unit,
                               after=(run.t[0] + run.t[-1]) / 2 if after is None else after)  # fmt: skip
        colour = COLOURS[k % len(COLOURS)]
        above.plot(t, reached[0], color=colour, lw=1.4, label=label)
        below.plot(t, wanted[0] - reached[0], color=colour, lw=1.2, label=f"{error.peak_to_peak:.3g} {unit}".strip())
    above.set_ylabel(heading(_QUANTITY.get(unit, output), unit))
    below.set_ylabel(heading("error", unit))
    below.axhline(0.0, color=INK, lw=0.6)
    for panel in (above, below):
        _dress(panel, legend=True)
    below.legend(title="peak to peak", **_LEGEND)
    _timed([above, below], title)
    return above.figure


def plot_loop(
    x: Any, y: Any, ax: Any = None, *, unit: str = "rad", label: str = "",
    names: tuple[str, str] = ("x_in", "x_out"),
) -> Any:  # fmt: skip
    """One signal over another, both in ``unit``: the loop of a hysteresis. Returns the figure."""
    (panel,) = _axes(ax, 1, height=4.6, width=6.6)
    (across, shown), (up, _) = (
        _shown(np.asarray(x, dtype=float), unit),
        _shown(np.asarray(y, dtype=float), unit),
    )
    panel.plot(across, up, lw=1.4, label=label or None, color=COLOURS[len(panel.lines) % len(COLOURS)])
    panel.set_xlabel(heading(names[0], shown))
    panel.set_ylabel(heading(names[1], shown))
    _dress(panel, legend=bool(label))
    return panel.figure


_QUANTITY = {"deg": "angle", "deg/s": "speed", "V": "voltage", "s": "time", "N": "force", "A": "current"}
"""What an axis shared by several signals of a unit is called."""
_LEGEND: dict[str, Any] = {
    "loc": "center left",
    "bbox_to_anchor": (1.0, 0.5),
    "frameon": False,
    "fontsize": 9,
}


def _shown(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Return a signal as a figure shows it: angles and their rates in degrees, anything else as it is."""
    for own, shown in (("rad", "deg"), ("rad/s", "deg/s")):
        if unit == own:
            return values * units.factor(own, shown), shown
    return values, unit


def _axes(ax: Any, count: int, *, height: float, width: float = 8.0) -> list[Any]:
    """Return the axes to draw on: those given, or ``count`` panels of a new figure over one time axis."""
    if ax is not None:
        given = list(np.ravel(ax))
        if len(given) != count:
            raise TsmError(f"ax must be {count} axes here, got {len(given)}.")
        return given
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise TsmError('Plots need matplotlib: pip install "tsmblocks[plots]"') from None
    size, shape = (width, height * count), {"sharex": True, "squeeze": False}
    if "matplotlib.pyplot" in sys.modules:  # someone works with pyplot: plt.show() must find this figure
        figure = sys.modules["matplotlib.pyplot"].figure(figsize=size, layout="constrained")
    else:
        figure = Figure(figsize=size, layout="constrained")
    return list(figure.subplots(count, 1, **shape)[:, 0])


def _dress(panel: Any, *, legend: bool) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(color=PALE, lw=0.5)
    panel.set_axisbelow(True)
    panel.margins(x=0.01)
    if legend:
        panel.legend(**_LEGEND)


def _timed(panels: list[Any], title: str) -> None:
    panels[-1].set_xlabel("t [s]")
    if title:
        panels[0].set_title(title, loc="left", fontsize=11)
