"""Inputs that are commands: held from sample to sample, or with fast parts that drive the plant and are no noise.

A command with a new value at each sample, held until the next, has the samples of a smooth motion, and what a feedback
loop adds to its command from the noise of a sensor looks like noise. The outputs tell: the simulation agrees with them
for one of the alternatives.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.data.resampling import evenly_sampled
from tsmblocks.diagnosis.model import Model
from tsmblocks.fitting.experiments import Experiment
from tsmblocks.fitting.statistics import moved, uncertainty

MAX_DISTANCE = 0.4
"""Distance of the estimated share of an alternative from 1 up to which it is taken. Chosen: a lag or a dead time that
is longer than the half sample by which a hold delays is no hold."""
CLEAR = 4.0
"""Share of an alternative, in its standard deviations, from which it is clear of 0. Chosen: recordings are not read
otherwise on a doubt."""


@attrs.frozen
class Commands:
    """Inputs that are simulated otherwise than their samples alone suggest.

    Those in ``held`` are held between samples, those in ``exact`` are not filtered.
    """

    held: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.held or self.exact)

    def joined(self, other: Commands) -> Commands:
        """The inputs of both."""
        held, exact = (tuple(dict.fromkeys(a + b)) for a, b in ((self.held, other.held), (self.exact, other.exact)))
        return Commands(held, exact)

    @property
    def notes(self) -> list[str]:
        """A note on each of the inputs."""
        return [
            *(f"{k} is held between samples (hold='zero'), which the outputs show." for k in self.held),
            *(f"{k} was not filtered: its fast part, which looks like noise, drives the outputs." for k in self.exact),
        ]


NO_COMMANDS = Commands()
"""No input is known to be a command."""


def found_commands(
    model: Model, raw: Mapping[str, Record], filtered: Collection[str], may_be_held: Collection[str]
) -> Commands:
    r"""The inputs of a model that its outputs show to be commands.

    ``raw`` are the recordings (or their pieces) before filtering, ``filtered`` the inputs whose noise was filtered out,
    and ``may_be_held`` those whose hold was not given. An alternative is added to the residual with a share
    :math:`\alpha` beside the parameters of the model, to first order:

    .. math:: r + \alpha (r_\mathrm{alternative} - r) + J \, \Delta\theta

    It is right where :math:`\alpha` is 1. Of those near 1 and clear of 0, the one with the least residual is taken.
    """
    found = Commands()
    for name in model.diagram.inputs:
        tried = [(one, _residual_with(model, raw, name, one)) for one in _alternatives(name, filtered, may_be_held)]
        right = [(rest, one) for one, r in tried if r is not None and (rest := _rest(model, r)) is not None]
        if right:
            found = found.joined(min(right, key=lambda pair: pair[0])[1])
    return found


def _alternatives(name: str, filtered: Collection[str], may_be_held: Collection[str]) -> Iterator[Commands]:
    """The other ways to simulate an input."""
    if name in may_be_held:
        yield Commands(held=(name,))
    if name in filtered:
        yield Commands(exact=(name,))
    if name in may_be_held and name in filtered:
        yield Commands(held=(name,), exact=(name,))


def _residual_with(model: Model, raw: Mapping[str, Record], name: str, as_command: Commands) -> np.ndarray | None:
    """The residual of a model with an alternative for an input; None where it is the same, or there is none."""
    made = list[Experiment]()
    for e, one in enumerate(model.setup.experiments):
        record, hold = one.record, dict(one.hold)
        if name in as_command.exact:
            recorded = evenly_sampled(raw[one.name])
            if len(recorded) != len(record):
                return None
            record = attrs.evolve(record, signals={**record.signals, name: recorded[name]})
        if name in as_command.held:
            if model.setup.eq.orders.get(name, 0):  # its rate drives the model
                return None
            hold[name] = "zero"
        made.append(model.setup.prepared(e, record=record, hold=hold))
    r: np.ndarray = attrs.evolve(model.problem, experiments=tuple(made)).residuals(model.theta)
    return r if np.isfinite(r).all() and not np.array_equal(r, model.r) else None


def _rest(model: Model, r: np.ndarray) -> float | None:
    """The sum of squares that is left with an alternative, whose residual is ``r``; None where it is not right."""
    J, n, change = model.J, model.J.shape[1], r - model.r
    with_change = attrs.evolve(
        J, common=np.column_stack([J.common, change]), common_columns=np.append(J.common_columns, n)
    )
    held = np.eye(n + 1)[:-1][model.at_bound]
    bounds = held if len(held) else None
    share = moved(with_change, model.r, held=bounds)[-1]
    if abs(share - 1) > MAX_DISTANCE:
        return None
    error = uncertainty(with_change, model.r, model.problem.segments, held=bounds).errors[-1]
    if not share > CLEAR * error:
        return None
    left = r + J @ moved(J, r, held=held[:, :-1] if len(held) else None)
    return float(np.sum(left**2))
