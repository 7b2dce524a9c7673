"""Why a simulation inside a fit went away: the run is made again where every signal can be looked at."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.fitting.experiments import Trial, inputs
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate


def raise_cause(diagram: Diagram, trial: Trial, p: np.ndarray) -> NoReturn:
    """Raise NotFinite with the block and the time at which the simulation of an experiment stopped being finite."""
    times, title = trial.times, f"experiment '{trial.name}' cannot be simulated"
    settings = dict(zip(trial.eq.p, map(float, p), strict=True))
    try:
        simulate(
            diagram.with_parameters(settings),
            start=times.start,
            stop=times.grid[-1],
            step=times.h,
            method=trial.rule.name,
            inputs=inputs(trial.record, diagram, trial.hold, times.grid[-1]),
            log="outputs",
            backend=trial.backend,
        )
    except NotFinite as error:
        fault = NotFinite(f"{title}: {error}")
        fault.run, fault.block, fault.time = error.run, error.block, error.time
        raise fault from None
    raise RunError(f"{title}: its outputs are not finite.")
