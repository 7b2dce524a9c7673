"""Figures of runs: signals over time, tracking with its error, changes from a baseline, hysteresis loops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from tsmblocks.common.arguments import as_number
from tsmblocks.common.errors import TsmError, in_words
from tsmblocks.data import Record, heading
from tsmblocks.metrics.metrics import expression_samples
from tsmblocks.metrics.tracking import tracking_error
from tsmblocks.plots.panels import QUANTITY, axes, dress, entitle, head, in_time, key, scaled, shown
from tsmblocks.plots.style import INK, MEASURED, MODEL, NARROW, series, styled, width_of
from tsmblocks.simulation.run import Run

ROUNDED = 1e-5
"""Difference, as a share of a signal's size, below which it is that of the digits that a baseline keeps."""
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))
"""Dashes of signals beyond the number of colours."""


@styled
def plot_run(
    run: Run, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None, width: float | None = None
) -> Any:
    """Signals of a run over time in s, the diagram's outputs unless named; ``"x_ref - x_out"`` is a signal too.

    Signals of one unit share a panel; all are drawn on ``ax`` where that is one, else it holds one for each unit. With
    ``after`` [s], what comes before is left out; ``width`` [in] is that of a new figure. Raises RunError for an
    unknown name, ParameterError for a faulty expression.
    """
    return _over_time(run, run.title, "run", list(names) or list(run.aliases) or run.keys(), ax, after, width)


@styled
def plot_record(
    record: Record, names: Iterable[str] = (), ax: Any = None, *, after: float | None = None, width: float | None = None
) -> Any:
    """Signals of a recording over time in s, all unless named, as plot_run draws them."""
    return _over_time(record, record.name, "recording", list(names) or list(record), ax, after, width)


def _over_time(
    run: Run | Record, title: str, what: str, chosen: list[str], ax: Any, after: float | None, width: float | None
) -> Any:
    kept = run.t >= (run.t[0] if after is None else as_number("after", after))
    if kept.sum() < 2:
        raise TsmError(f"after={after:g} s leaves nothing of the {what}, which ends at {run.t[-1]:g} s.")
    groups: dict[str, list[tuple[str, np.ndarray]]] = {}
    for name in chosen:
        if not isinstance(name, str):
            raise TsmError(f"a signal is given by its name, as in plot('x_ref', 'x_out'), got {in_words(name)}.")
        values, unit = shown(*expression_samples(run, name))
        groups.setdefault(unit, []).append((name, values[kept]))
    one = hasattr(ax, "plot")
    height = 1.75 if len(groups) > 1 else 2.2
    panels = [ax] * len(groups) if one else axes(ax, len(groups), height=height, width=width)
    t, t_label = in_time(run.t[kept])
    looks, labels = _looks(), list[str]()
    for panel, (unit, lines) in zip(panels, groups.items(), strict=True):
        curves, prefixed = scaled(unit, *(values for _, values in lines))
        for (name, _), curve in zip(lines, curves, strict=True):
            panel.plot(t, curve, label=name, **next(looks))
        alone = len(lines) == 1 and not (one and len(groups) > 1)
        labels.append(heading(lines[0][0] if alone else QUANTITY.get(unit, ""), prefixed).strip())
        dress(panel, ylabel=labels[-1])
        if not alone:
            key(panel)
    if one and len(groups) > 1:
        dress(ax, ylabel=", ".join(filter(None, labels)))
    return _timed(panels, t_label, title if ax is None else "")


def _looks() -> Iterator[dict[str, Any]]:
    """Colours, and dashes once they are used up."""
    colours = series()
    return ({"color": colour, "ls": dash} for dash in cycle(DASHES) for colour in colours)


def _timed(panels: Sequence[Any], label: str, title: str) -> Any:
    """Name the time axis under the last panel, and a figure of our own; the figure."""
    panels[-1].set_xlabel(label)
    entitle(panels[0].figure, title)
    return panels[0].figure


@styled
def plot_tracking(
    runs: Mapping[str, Run],
    ax: Sequence[Any] | None = None,
    *,
    title: str = "",
    after: float | None = None,
    reference: str = "x_ref",
    output: str = "x_out",
    width: float | None = None,
) -> Any:
    """Draw reference and outputs of several runs over time, by label, and below them the errors.

    ``ax`` may be two axes, for the signals and the errors. With ``after`` [s], what comes before is left
    out. The legend gives the peak-to-peak error from there on, by default over the second half of each run.
    """
    if not runs:
        raise TsmError("plot_tracking needs at least one run.")
    panels = axes(ax, 2, height=2.1, width=width)
    unit, t_label = "", ""
    for k, ((label, run), look) in enumerate(zip(runs.items(), _looks(), strict=False)):
        kept = run.t >= (run.t[0] if after is None else after)
        late = (run.t[0] + run.t[-1]) / 2 if after is None else after
        t, t_label = in_time(run.t[kept])
        (wanted, unit), (reached, _) = (shown(run[name][kept], run.unit(reference)) for name in (reference, output))
        if k == 0:
            panels[0].plot(t, wanted, color=INK, ls=(0, (4, 2)), label="reference")
        error = tracking_error(wanted, reached, t=run.t[kept], unit=unit, after=late)
        panels[0].plot(t, reached, label=label, **look)
        panels[1].plot(t, wanted - reached, label=f"{label}: {error.peak_to_peak:.3g} {unit}".strip(), **look)
    panels[1].axhline(0.0, color=INK, lw=0.6)
    dress(panels[0], ylabel=heading(QUANTITY.get(unit, output), unit))
    dress(panels[1], ylabel=heading("error", unit))
    key(panels[0])
    key(panels[1], title="peak-to-peak error")
    if ax is not None and title:
        head(panels[0], title)
    return _timed(panels, t_label, title if ax is None else "")


@styled
def plot_tracking_changes(before: Any, now: Any, title: str, ax: Any = None, *, width: float | None = None) -> Any:
    """Signals that differ between a baseline and a new run, over time, each with its difference below.

    ``before`` and ``now`` have ``t`` [s], ``signals`` and ``signal_units``.
    """
    both = [name for name in now.signals if name in before.signals]
    names = [name for name in both if _differs(before, now, name)] or both
    panels = axes(ax, 2 * len(names), height=1.4, width=width)
    t, t_label = in_time(now.t)
    for name, above, below in zip(names, panels[::2], panels[1::2], strict=True):
        old = np.interp(now.t, before.t, before.signals[name])
        (old, new), unit = scaled(now.signal_units[name], old, now.signals[name])
        above.plot(t, old, color=MEASURED, lw=2.5, label="baseline")
        above.plot(t, new, color=MODEL, label="now")
        dress(above, ylabel=heading(name, unit))
        key(above)
        below.plot(t, new - old, color=MODEL)
        dress(below, ylabel=heading("change", unit))
    return _timed(panels, t_label, title if ax is None else "")


def _differs(before: Any, now: Any, name: str) -> bool:
    old = np.interp(now.t, before.t, before.signals[name])
    return not np.allclose(now.signals[name], old, rtol=0.0, atol=ROUNDED * float(np.abs(old).max(initial=1e-12)))


@styled
def plot_loop(
    x: Any,
    y: Any,
    ax: Any = None,
    *,
    unit: str = "rad",
    label: str = "",
    names: tuple[str, str] = ("x_in", "x_out"),
    width: float | None = None,
) -> Any:
    """One signal over another, both in ``unit``: the loop of a hysteresis."""
    wide = min(width_of(width), NARROW)
    (panel,) = axes(ax, 1, height=0.7 * wide, width=wide)
    (across, up), label_unit = scaled(unit, x, y)
    colours = series()
    panel.plot(across, up, label=label or None, color=colours[len(panel.lines) % len(colours)])
    dress(panel, *(heading(name, label_unit) for name in names), margin=0.03)
    key(panel)
    return panel.figure
