"""Cards of fits: parameters with their intervals, residuals, models ranked."""

from __future__ import annotations

import functools

import numpy as np

from tsmblocks.common import displayed_units
from tsmblocks.common.views import no_view
from tsmblocks.data import heading
from tsmblocks.fitting.comparison import Comparison
from tsmblocks.fitting.result import STATUS, Fit
from tsmblocks.fitting.score import Difference, Differences
from tsmblocks.fitting.text import cautions, estimate_rows, ranking_rows, residual_rows, row_doubts
from tsmblocks.html.card import card, listed, table_of, time_chart
from tsmblocks.html.pages import part

view = functools.singledispatch(no_view)
MOST = 40
"""Rows of a table at most."""


@view.register
def fit_card(fit: Fit) -> str:
    """A fit: the parameters with intervals, the experiment with the largest residual, and cautions."""
    tried = len(fit.searches)
    agree = f"; {fit.agreeing} of {tried} starts ended at this optimum" if tried > 1 else ""
    return card(
        fit.diagram.title or "Fit",
        f"{fit.method}: {STATUS[fit.status]}{agree}",
        table_of(estimate_rows(fit), {0, 4, 6}, "Parameters", MOST),
        *_residuals(fit.differences),
        listed(cautions(fit), "beware"),
    )


@view.register
def differences_card(differences: Differences) -> str:
    """The residuals of one diagram on some recordings."""
    return card(differences.title, "", *_residuals(differences))


@view.register
def comparison_card(comparison: Comparison) -> str:
    """Models from best to worst, those that could not be fitted, and the largest residual of the best one."""
    faults = [f"{row.name}: {row.fault}" for row in comparison if row.fit is None]
    warnings = [f"{row.name}: {text}" for row in comparison for text in row_doubts(row)]
    best = comparison.best.held_out or comparison.best.train
    shown = _chart(_worst(best), f"{comparison.best.name}: ") if best is not None and len(best) else ""
    about = "interrupted; these are the models that were reached" if comparison.interrupted else ""
    return card(
        f"{len(comparison)} models compared",
        about,
        table_of(ranking_rows(comparison), {0}, "Models, the best first", MOST),
        shown,
        listed(faults, "could not be fitted"),
        listed(warnings, "beware"),
    )


def _residuals(differences: Differences) -> tuple[str, str]:
    if not len(differences):
        return "", ""
    return table_of(residual_rows(differences), {0, 3}, "Residuals", MOST), _chart(_worst(differences))


def _worst(differences: Differences) -> Difference:
    return max(differences, key=lambda one: one.rms)


def _chart(one: Difference, before: str = "") -> str:
    """One output of one experiment over time: measured, simulated, and the residual."""
    k, unit = displayed_units.display_unit(one.unit)
    measured, simulated, residual = (k * np.asarray(y) for y in (one.measured, one.simulated, one.residual))
    title = heading(f"{before}{one.experiment}, {one.output}", unit)
    words = f"{one.output} of {one.experiment} over time, measured and simulated"
    above = time_chart(one.t, [("measured", measured), ("c0", simulated)], title, words)
    words = f"residual of {one.output} in {one.experiment} over time"
    below = time_chart(one.t, [("c0", residual)], heading("residual", unit), words, zero=True)
    return part("charts", (above, below)) + part("key", [("measured", "measured"), ("c0", "simulated")])
