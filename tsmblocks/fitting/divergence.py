"""The cause of a diverged simulation in a fit: the run is repeated with a check of every signal."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np

from tsmblocks.common.errors import NotFinite, RunError
from tsmblocks.fitting.experiments import Experiment, inputs
from tsmblocks.fitting.time_scale import time_text
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate
from tsmblocks.simulation.stability import growing_pole, no_step_warnings

if TYPE_CHECKING:
    from tsmblocks.fitting.setup import Setup

FAR = 1000.0
"""Measured ranges beyond which an output has grown without bound. Chosen: no stable model goes there."""
MIN_GROWTH = 5.0
"""Growth of a pole over a recording, as an exponent, from which it shows. Chosen: to 150 times."""
ADVICE = (
    "Correct the parameters that it starts from, or fit short pieces (method='ipopt', segments=20, or --method ipopt "
    "--segments 20)."
)


def raise_cause(diagram: Diagram, experiment: Experiment, p: np.ndarray) -> NoReturn:
    """Raise NotFinite with the block and the time at which the simulation of an experiment stopped being finite."""
    title, error = f"experiment '{experiment.name}' cannot be simulated", _cause(diagram, experiment, p)
    if error is None:
        raise RunError(f"{title}: its outputs are not finite.")
    doubt = time_text(experiment, p)
    fault = NotFinite(f"{title}: {error}{f' In {experiment.name} {doubt}' if doubt else ''}")
    fault.run, fault.block, fault.time = error.run, error.block, error.time
    raise fault from None


def growth_text(setup: Setup, experiment: Experiment, p: np.ndarray, y: np.ndarray) -> str:
    """What grows, and when, if the outputs ``y`` that are simulated with the parameters ``p`` diverge; else ``""``."""
    begins = "with its parameters before the fit the model diverges"
    if not np.isfinite(y).all():
        with no_step_warnings():
            error = _cause(setup.diagram, experiment, p)
        return f"{begins}: {error} {ADVICE}" if error is not None else ""
    pole, measured = growing_pole(experiment.eq, p), experiment.measured
    beyond = np.abs(y - measured) > FAR * np.ptp(measured, axis=0)
    if pole is None or pole[0] * (experiment.t[-1] - experiment.t[0]) < MIN_GROWTH or not beyond.any():
        return ""
    first = int(np.argmax(beyond.any(axis=1)))
    return (
        f"{begins}: from t = {experiment.t[first]:.3g} s on {setup.outputs[int(np.argmax(beyond[first]))]} is beyond "
        f"{FAR:g} times its measured range, since {pole[1]} grows by a pole of {pole[0]:.3g} 1/s. {ADVICE}"
    )


def _cause(diagram: Diagram, experiment: Experiment, p: np.ndarray) -> NotFinite | None:
    """The error of the run of an experiment that is repeated with a check of every signal; None where it is finite."""
    times = experiment.times
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
        return error
    return None
