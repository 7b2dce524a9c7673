"""The figure of a tuning: each metric in each case, with the parameters before and after."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from tsmblocks.common.displayed_units import display_unit
from tsmblocks.common.errors import RunError, near
from tsmblocks.common.rounding import to_digits
from tsmblocks.data import heading
from tsmblocks.metrics.metrics import named
from tsmblocks.plots.panels import MARGIN, dress, folded, in_time, key, scaled, sheet
from tsmblocks.plots.style import BEFORE, INK, MODEL, styled
from tsmblocks.tuning.result import Oscillation, Tuned

MAX_BARS = 12
"""Cases that are drawn as bars, at most; more are drawn as a histogram. Chosen."""
CASE_WIDTH = 20
"""Letters of a line of the name of a case beside its bars. Chosen."""
PERIODS = 12
"""Periods of an oscillation that are drawn. Chosen: they can still be counted."""


@styled
def plot_tuned(tuned: Tuned, metrics: Sequence[str] = (), ax: Any = None, *, width: float | None = None) -> Any:
    """Each metric in each case, before and tuned, with the limits it is to keep; one axes per metric.

    Below them a new figure has the signal that oscillates far more than before, where there is one. ``metrics`` are
    all unless named. Of more than ``MAX_BARS`` cases there is a histogram. Raises RunError for an unknown metric.
    """
    known = list(next(iter(tuned.after.values())))
    short = {named(name)[0]: name for name in known}
    chosen = [short.get(name, name) for name in metrics] or known
    for name in chosen:
        if name not in known:
            raise RunError(f"the tuning has no metric '{name}'.{near(name, short)}")
    cases = list(tuned.after)
    swings = tuned.oscillation if ax is None else None
    height = max(0.75 + 0.3 * min(len(cases), 5), 1.5 if swings else 0.0)
    panels = sheet(ax, len(chosen) + bool(swings), "A", width=width, height=height)[1][:, 0]
    for panel, name in zip(panels, chosen, strict=False):
        _panel(panel, tuned, name, cases)
    key(panels[0])
    if swings:
        _swings(panels[-1], swings, f" in case '{swings.case}'" if len(cases) > 1 else "")
    return panels[0].figure


def _panel(panel: Any, tuned: Tuned, name: str, cases: Sequence[str]) -> None:
    k = display_unit(tuned.units[name])[0]
    sides = {"before": (tuned.before, BEFORE), "tuned": (tuned.after, MODEL)}
    for step, (label, (side, colour)) in enumerate(sides.items()):
        values = k * np.array([side[case][name] for case in cases])
        if len(cases) > MAX_BARS:
            panel.hist(values[np.isfinite(values)], bins=30, color=colour, alpha=0.6, label=label)
        else:
            panel.barh(np.arange(len(cases)) + 0.2 * (2 * step - 1), values, height=0.36, color=colour, label=label)
    for one in tuned.limits:
        if one.name == name:
            panel.axvline(k * one.most, color=INK, ls="--", label="limit")
    if len(cases) > MAX_BARS:
        panel.set_ylabel("cases")
    else:
        panel.set_yticks(range(len(cases)), labels=[textwrap.fill(case, CASE_WIDTH) for case in cases])
        panel.invert_yaxis()
        panel.tick_params(axis="y", length=0)
        panel.grid(axis="y", visible=False)
    dress(panel, folded(tuned.title(name), panel.figure.get_figwidth() - 2 * MARGIN), margin=0.05)


def _swings(panel: Any, one: Oscillation, where: str) -> None:
    """Some periods of an oscillation, before and tuned: those in which it swings most."""
    here = _liveliest(one)
    (before, after), unit = scaled(one.unit, one.before[here], one.tuned[here])
    t, label = in_time(one.t[here])
    panel.plot(t, before, color=BEFORE, label="before")
    panel.plot(t, after, color=MODEL, label="tuned")
    dress(panel, label, heading(one.name, unit))
    swings = f", swings at about {to_digits(one.frequency)} Hz" if one.frequency else ""
    key(panel, over=f"the loop hunts{swings}{where}")


def _liveliest(one: Oscillation) -> slice:
    """The samples of ``PERIODS`` periods in which the tuned signal varies most."""
    step = float(np.median(np.diff(one.t)))
    count = round(PERIODS / one.frequency / step) if one.frequency else len(one.t)
    if count >= len(one.t):
        return slice(None)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(one.tuned)))])
    first = int(np.argmax(way[count:] - way[: len(way) - count]))
    return slice(first, first + count + 1)
