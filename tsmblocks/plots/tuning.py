"""The figure of a tuning: each metric in each case, with the parameters before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tsmblocks.common.errors import RunError, near
from tsmblocks.metrics.metrics import named
from tsmblocks.plots.panels import COLOURS, INK, INSIDE, dress, sheet, shown
from tsmblocks.tuning.result import Tuned

MAX_BARS = 12
"""Cases that are drawn as bars, at most; more are drawn as a histogram. Chosen."""


def plot_tuned(tuned: Tuned, metrics: Sequence[str] = (), ax: Any = None) -> Any:
    """Each metric in each case, before (pale) and tuned (dark), with the limits it is to keep; one axes per metric.

    ``metrics`` are all unless named. Of more than ``MAX_BARS`` cases there is a histogram. Raises RunError for an
    unknown metric.
    """
    known = list(next(iter(tuned.after.values())))
    short = {named(name)[0]: name for name in known}
    chosen = [short.get(name, name) for name in metrics] or known
    for name in chosen:
        if name not in known:
            raise RunError(f"the tuning has no metric '{name}'.{near(name, short)}")
    cases = list(tuned.after)
    height = 1.0 + 0.4 * min(len(cases), 5)
    panels = sheet(ax, len(chosen), 1, width=8.0, height=height)[1][:, 0]
    for panel, name in zip(panels, chosen, strict=True):
        _panel(panel, tuned, name, cases)
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, **INSIDE)
    return panels[0].figure


def _panel(panel: Any, tuned: Tuned, name: str, cases: Sequence[str]) -> None:
    unit = tuned.units[name]
    sides = {"before": (tuned.before, COLOURS[5]), "tuned": (tuned.after, COLOURS[0])}
    for k, (label, (side, colour)) in enumerate(sides.items()):
        values, _ = shown(np.array([side[case][name] for case in cases]), unit)
        if len(cases) > MAX_BARS:
            panel.hist(values[np.isfinite(values)], bins=30, color=colour, alpha=0.6, label=label)
        else:
            panel.barh(np.arange(len(cases)) + 0.2 * (2 * k - 1), values, height=0.4, color=colour, label=label)
    for one in tuned.limits:
        if one.name == name:
            panel.axvline(float(shown(np.array(one.most), unit)[0]), color=INK, lw=1.0, ls="--", label="limit")
    if len(cases) > MAX_BARS:
        panel.set_ylabel("cases")
    else:
        panel.set_yticks(range(len(cases)), labels=cases)
        panel.invert_yaxis()
    dress(panel, tuned.title(name), margin=0.05)
