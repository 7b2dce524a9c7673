"""Figures. Every function draws on the axes it is given, or makes a figure, and returns the figure.

Angles are stored in rad and shown in deg, as the paper shows them. Needs matplotlib, imported when a figure is made.
Figures of ``value.plot()`` are those of pyplot, so that ``plt.show()`` in a script shows them. ``style`` has what they
look like, which holds for them alone and gives way to the user's own ``rcParams``; ``panels`` where panels stand.
"""

import functools

from tsmblocks.analysis.frequency_response import FrequencyResponse
from tsmblocks.common.views import no_view
from tsmblocks.data.record import Record
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.fitting.comparison import Comparison
from tsmblocks.fitting.result import Fit
from tsmblocks.fitting.score import Differences
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
from tsmblocks.plots.style import usual
from tsmblocks.plots.tuning import plot_tuned
from tsmblocks.simulation.run import Run
from tsmblocks.studies.responses import Responses
from tsmblocks.studies.results import Results
from tsmblocks.tuning.result import Tuned

view = functools.singledispatch(no_view)
"""The usual figure of a value; ``value.plot()`` calls it by ``common.views``."""
view.register(Comparison, usual(plot_comparison))
view.register(Diagnosis, usual(plot_diagnosis))
view.register(Differences, usual(plot_fit))
view.register(Fit, usual(plot_fit))
view.register(FrequencyResponse, usual(plot_frequency_response))
view.register(Record, usual(plot_record))
view.register(Responses, usual(plot_envelope))
view.register(Results, usual(plot_study))
view.register(Run, usual(plot_run))
view.register(Tuned, usual(plot_tuned))

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
