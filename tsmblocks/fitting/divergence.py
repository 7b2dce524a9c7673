"""The cause of a diverged simulation in a fit: the run is repeated with a check of every signal."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.fitting.experiments import Experiment, inputs
from tsmblocks.fitting.scale_notes import time_text
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate


def raise_cause(diagram: Diagram, experiment: Experiment, p: np.ndarray) -> NoReturn:
    """Raise NotFinite with the block and the time at which the simulation of an experiment stopped being finite."""
    times, title = experiment.times, f"experiment '{experiment.name}' cannot be simulated"
    settings = dict(zip(experiment.eq.p, map(float, p), strict=True))
    try:
        simulate(
            diagram.with_parameters(settings),
            start=times.start,
            stop=times.grid[-1],
            step=times.h,
            method=experiment.rule.name,
            inputs=inputs(experiment.record, diagram, experiment.hold, times.grid[-1]),
            log="outputs",
            backend=experiment.backend,
            check_step=False,
        )
    except NotFinite as error:
        doubt = time_text(experiment, p)
        fault = NotFinite(f"{title}: {error}{f' In {experiment.name} {doubt}' if doubt else ''}")
        fault.run, fault.block, fault.time = error.run, error.block, error.time
        raise fault from None
    raise RunError(f"{title}: its outputs are not finite.")
