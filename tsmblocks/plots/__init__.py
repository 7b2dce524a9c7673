"""Figures. Angles are stored in rad and shown in deg, as the paper shows them.

Every function draws on the axes it is given, or makes a figure, and returns the figure. Needs
matplotlib, imported when a figure is made.
"""

from tsmblocks.plots.analysis import plot_frequency_response
from tsmblocks.plots.diagnosis import plot_coordinate, plot_diagnosis, plot_disagreement, plot_gap
from tsmblocks.plots.fits import (
    plot_autocorrelation,
    plot_comparison,
    plot_each,
    plot_fit,
    plot_fitted_loop,
    plot_history,
    plot_residual,
)
from tsmblocks.plots.runs import plot_loop, plot_record, plot_run, plot_tracking
from tsmblocks.plots.studies import (
    plot_distribution,
    plot_envelope,
    plot_heat_map,
    plot_pareto,
    plot_scatter,
    plot_study,
    plot_tornado,
)
from tsmblocks.plots.tuned import plot_tuned

__all__ = [
    "plot_autocorrelation",
    "plot_comparison",
    "plot_coordinate",
    "plot_diagnosis",
    "plot_disagreement",
    "plot_distribution",
    "plot_each",
    "plot_envelope",
    "plot_fit",
    "plot_fitted_loop",
    "plot_gap",
    "plot_frequency_response",
    "plot_heat_map",
    "plot_history",
    "plot_loop",
    "plot_pareto",
    "plot_residual",
    "plot_record",
    "plot_run",
    "plot_scatter",
    "plot_study",
    "plot_tornado",
    "plot_tracking",
    "plot_tuned",
]
