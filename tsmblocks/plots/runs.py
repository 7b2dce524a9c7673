"""Figures of runs: signals over time, tracking with its error, hysteresis loops.

Angles are stored in rad and shown in deg, as the paper shows them. Every function draws on the axes it
is given, or makes a figure, and returns the figure. Needs matplotlib, imported when a figure is made.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import TsmError
from tsmblocks.data import Record, heading
from tsmblocks.metrics.metrics import expression_samples
from tsmblocks.metrics.tracking import tracking_error
from tsmblocks.plots.panels import COLOURS, INK, LEGEND, QUANTITY, axes, dress, shown, timed
from tsmblocks.simulation.run import Run


def plot_run(run: Run, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None) -> Any:
    """Signals of a run over time in s, the diagram's outputs unless named; ``"x_ref - x_out"`` is a signal too.

    Signals of one unit share a panel; all are drawn on ``ax`` where that is one, else it holds one for each unit. With
    ``after`` [s], what comes before is left out. Returns the figure. Raises RunError for an unknown name,
    ParameterError for a faulty expression.
    """
    return _over_time(run, run.title, "run", list(names) or list(run.aliases) or run.keys(), ax, after)


def plot_record(record: Record, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None) -> Any:
    """Signals of a recording over time in s, all unless named, as plot_run draws them. Returns the figure."""
    return _over_time(record, record.name, "recording", list(names) or list(record), ax, after)


def _over_time(run: Run | Record, title: str, what: str, chosen: list[str], ax: Any, after: float | None) -> Any:
    kept = run.t >= (run.t[0] if after is None else as_number("after", after))
    if kept.sum() < 2:
        raise TsmError(f"after={after:g} s leaves nothing of the {what}, which ends at {run.t[-1]:g} s.")
    groups: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name in chosen:
        values, unit = shown(*expression_samples(run, name))
        groups.setdefault(unit, []).append((name, values))
    one = hasattr(ax, "plot")
    panels = [ax] * len(groups) if one else axes(ax, len(groups), height=2.4)
    count = 0
    for panel, (unit, lines) in zip(panels, groups.items(), strict=True):
        for name, values in lines:
            panel.plot(run.t[kept], values[kept], color=COLOURS[count % len(COLOURS)], lw=1.4, label=name)
            count += 1
        alone = lines[0][0] if len(lines) == 1 else ""
        panel.set_ylabel(heading(alone or QUANTITY.get(unit, ""), unit).strip())
        dress(panel, legend=len(lines) > 1)
    if one and len(groups) > 1:
        panels[0].set_ylabel(", ".join(heading(QUANTITY.get(u, ""), u).strip() for u in groups if u))
        dress(panels[0], legend=True)
    timed(panels, title if ax is None else "")
    return panels[0].figure


def plot_tracking(
    runs: Mapping[str, Run],
    ax: Sequence[Any] | None = None,
    *,
    title: str = "",
    after: float | None = None,
    reference: str = "x_ref",
    output: str = "x_out",
) -> Any:
    """Draw reference and outputs of several runs over time, by label, and below them the errors.

    ``ax`` may be two axes, for the signals and the errors. With ``after`` [s], what comes before is left
    out. The legend gives the peak-to-peak error from there on, by default over the second half of each run.
    Returns the figure.
    """
    if not runs:
        raise TsmError("plot_tracking needs at least one run.")
    above, below = axes(ax, 2, height=2.9)
    for k, (label, run) in enumerate(runs.items()):
        kept = run.t >= (run.t[0] if after is None else after)
        t, unit = run.t[kept], run.unit(reference)
        wanted, reached = (shown(run[name][kept], unit) for name in (reference, output))
        unit = wanted[1]
        if k == 0:
            above.plot(t, wanted[0], color=INK, lw=1.2, ls=(0, (4, 2)), label="reference")
        error = tracking_error(
            wanted[0], reached[0], t=t, unit=unit, after=(run.t[0] + run.t[-1]) / 2 if after is None else after
        )
        colour = COLOURS[k % len(COLOURS)]
        above.plot(t, reached[0], color=colour, lw=1.4, label=label)
        below.plot(t, wanted[0] - reached[0], color=colour, lw=1.2, label=f"{error.peak_to_peak:.3g} {unit}".strip())
    above.set_ylabel(heading(QUANTITY.get(unit, output), unit))
    below.set_ylabel(heading("error", unit))
    below.axhline(0.0, color=INK, lw=0.6)
    for panel in (above, below):
        dress(panel, legend=True)
    below.legend(title="peak to peak", **LEGEND)
    timed([above, below], title)
    return above.figure


def plot_loop(
    x: Any, y: Any, ax: Any = None, *, unit: str = "rad", label: str = "", names: tuple[str, str] = ("x_in", "x_out")
) -> Any:
    """One signal over another, both in ``unit``: the loop of a hysteresis. Returns the figure."""
    (panel,) = axes(ax, 1, height=4.6, width=6.6)
    (across, label_unit), (up, _) = (shown(np.asarray(v, dtype=float), unit) for v in (x, y))
    panel.plot(across, up, lw=1.4, label=label or None, color=COLOURS[len(panel.lines) % len(COLOURS)])
    panel.set_xlabel(heading(names[0], label_unit))
    panel.set_ylabel(heading(names[1], label_unit))
    dress(panel, legend=bool(label))
    return panel.figure
