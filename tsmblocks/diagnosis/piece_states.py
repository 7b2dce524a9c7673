"""Initial states of pieces of recordings, such as a mechanism has them.

A piece begins before the part of it that is compared. States that decay until then may begin anywhere, and imitate a
missing effect from speeds and pressures that the mechanism never has: from there a fit of a nonlinear effect does not
arrive at its optimum.
"""

from __future__ import annotations

import itertools

import numpy as np

from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.partition import experiment_of
from tsmblocks.engine.session import start_memory


def continued(model: Model) -> np.ndarray:
    """The unknowns (n,) with the continuous states of each piece as the piece before it has them at that instant.

    The first piece of a recording begins as it is where its comparison begins. Without pieces all stays as it is.
    """
    theta, unknowns = model.theta.copy(), model.problem.unknowns
    experiments = list(enumerate(model.setup.experiments))
    groups = itertools.groupby(experiments, lambda one: experiment_of(one[1].name))
    for name, group in groups:
        pieces = list(group)
        if pieces[0][1].name == name:  # a whole recording
            continue
        for before, (e, piece) in zip([pieces[0], *pieces], pieces, strict=False):
            begin = float(piece.record.t[0]) if e != before[0] else float(piece.t[0])
            states = _states_at(model, before[0], begin)
            for k in unknowns.columns(e):
                item = unknowns.items[k]
                if item.experiment and item.parameter in states:
                    theta[k] = min(max(states[item.parameter], item.low), item.high)
    return theta


def _states_at(model: Model, e: int, time: float) -> dict[str, float]:
    """The continuous states of an experiment at the first of its samples from an instant [s] on."""
    experiment = model.setup.experiments[e]
    kernel, every = experiment.kernel, experiment.times.every
    p = model.problem.unknowns.parameters(model.theta, e)
    memory = start_memory(experiment.eq, kernel, p, experiment.times.h)
    sample = min(int(np.searchsorted(experiment.t, time - experiment.times.h / 2)), len(experiment.place) - 1)
    if (steps := int(experiment.place[sample]) * every) > 0:
        experiment.run(kernel, memory, 0, steps)
    places = kernel.layout_x.offset
    return {name: float(memory.x[places[k]]) for k, name in enumerate(experiment.eq.x)}
