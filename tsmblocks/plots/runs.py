"""Figures of runs: signals over time, tracking with its error, changes from a baseline, hysteresis loops."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import TsmError
from tsmblocks.data import Record, heading
from tsmblocks.metrics.metrics import expression_samples
from tsmblocks.metrics.tracking import tracking_error
from tsmblocks.plots.panels import COLOURS, INK, LEGEND, PALE, QUANTITY, axes, dress, shown, timed
from tsmblocks.simulation.run import Run

ROUNDED = 1e-5
"""Difference, as a share of a signal's size, below which it is that of the digits that a baseline keeps."""


def plot_run(run: Run, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None) -> Any:
    """Signals of a run over time in s, the diagram's outputs unless named; ``"x_ref - x_out"`` is a signal too.

    Signals of one unit share a panel; all are drawn on ``ax`` where that is one, else it holds one for each unit. With
    ``after`` [s], what comes before is left out. Raises RunError for an unknown name,
    ParameterError for a faulty expression.
    """
    return _over_time(run, run.title, "run", list(names) or list(run.aliases) or run.keys(), ax, after)


def plot_record(record: Record, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None) -> Any:
    """Signals of a recording over time in s, all unless named, as plot_run draws them."""
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
    colours = cycle(COLOURS)
    for panel, (unit, lines) in zip(panels, groups.items(), strict=True):
        for name, values in lines:
            panel.plot(run.t[kept], values[kept], color=next(colours), lw=1.4, label=name)
        alone = lines[0][0] if len(lines) == 1 else ""
        label = heading(alone or QUANTITY.get(unit, ""), unit).strip()
        dress(panel, ylabel=label, legend=LEGEND if len(lines) > 1 else None)
    if one and len(groups) > 1:
        label = ", ".join(heading(QUANTITY.get(u, ""), u).strip() for u in groups if u)
        dress(panels[0], ylabel=label, legend=LEGEND)
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
    """
    if not runs:
        raise TsmError("plot_tracking needs at least one run.")
    above, below = axes(ax, 2, height=2.9)
    for k, (label, run) in enumerate(runs.items()):
        colour = COLOURS[k % len(COLOURS)]
        kept = run.t >= (run.t[0] if after is None else after)
        late = (run.t[0] + run.t[-1]) / 2 if after is None else after
        t = run.t[kept]
        (wanted, unit), (reached, _) = (shown(run[name][kept], run.unit(reference)) for name in (reference, output))
        if k == 0:
            above.plot(t, wanted, color=INK, lw=1.2, ls=(0, (4, 2)), label="reference")
        error = tracking_error(wanted, reached, t=t, unit=unit, after=late)
        above.plot(t, reached, color=colour, lw=1.4, label=label)
        below.plot(t, wanted - reached, color=colour, lw=1.2, label=f"{error.peak_to_peak:.3g} {unit}".strip())
    below.axhline(0.0, color=INK, lw=0.6)
    dress(above, ylabel=heading(QUANTITY.get(unit, output), unit), legend=LEGEND)
    dress(below, ylabel=heading("error", unit), legend={"title": "peak to peak", **LEGEND})
    timed([above, below], title)
    return above.figure


def plot_tracking_changes(before: Any, now: Any, title: str, ax: Any = None) -> Any:
    """Signals that differ between a baseline and a new run, over time, each with its difference below.

    ``before`` and ``now`` have ``t`` [s], ``signals`` and ``signal_units``.
    """
    both = [name for name in now.signals if name in before.signals]
    names = [name for name in both if _differs(before, now, name)] or both
    panels = axes(ax, 2 * len(names), height=1.7)
    for name, above, below in zip(names, panels[::2], panels[1::2], strict=True):
        old, unit = shown(np.interp(now.t, before.t, before.signals[name]), now.signal_units[name])
        new, _ = shown(now.signals[name], now.signal_units[name])
        above.plot(now.t, old, color=PALE, lw=3.0, label="baseline")
        above.plot(now.t, new, color=COLOURS[0], lw=1.2, label="now")
        dress(above, ylabel=heading(name, unit), legend=LEGEND)
        below.plot(now.t, new - old, color=COLOURS[1], lw=1.2)
        dress(below, ylabel="moved by")
    timed(panels, title)
    return panels[0].figure


def _differs(before: Any, now: Any, name: str) -> bool:
    old = np.interp(now.t, before.t, before.signals[name])
    return not np.allclose(now.signals[name], old, rtol=0.0, atol=ROUNDED * float(np.abs(old).max(initial=1e-12)))


def plot_loop(
    x: Any, y: Any, ax: Any = None, *, unit: str = "rad", label: str = "", names: tuple[str, str] = ("x_in", "x_out")
) -> Any:
    """One signal over another, both in ``unit``: the loop of a hysteresis."""
    (panel,) = axes(ax, 1, height=4.6, width=6.6)
    (across, label_unit), (up, _) = (shown(np.asarray(v, dtype=float), unit) for v in (x, y))
    panel.plot(across, up, lw=1.4, label=label or None, color=COLOURS[len(panel.lines) % len(COLOURS)])
    dress(panel, *(heading(name, label_unit) for name in names), legend=LEGEND if label else None)
    return panel.figure
