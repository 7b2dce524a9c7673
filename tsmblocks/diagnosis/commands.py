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
from tsmblocks.diagnosis.model import Model, optimized
from tsmblocks.fitting.held_inputs import (
    CLEAR,
    MAX_DISTANCE,
    Alternative,
    alternative,
    residuals_held,
    resolving_holds,
    setup_held,
)
from tsmblocks.fitting.setup import Setup

ROUGH_DISTANCE = 0.7
"""Distance from 1 of the share of an alternative up to which a base is fitted with it, to see whether it is right: the
share is of first order, and the base may be far from its best parameters. Chosen."""
LIKELY_CLEAR = 1.5
"""Share of the hold of an input that is held in some recordings, in its standard deviations, from which it is clear of
0. Chosen: one converter holds an input in all of them."""
MAX_RISE = 0.05
"""Relative rise of the mean square up to which a hold explains as much as a named delay. Chosen: a delay that is no
hold leaves several times as much, and the effect has one parameter more."""

TIME = "time"
"""Parameter of a dead time that is its length."""


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
            *(
                f"{k} is held between samples (hold='zero'), which the outputs show. To fit or compare models in the "
                "same way, give --hold zero."
                for k in self.held
            ),
            *(f"{k} was not filtered: the outputs follow its fast part, so that is no noise." for k in self.exact),
        ]


class OtherCommands(Exception):
    """A model with effects shows inputs to be commands: what was found beside other inputs may be wrong."""

    def __init__(self, found: Commands) -> None:
        super().__init__()
        self.found = found


NO_COMMANDS = Commands()
"""No input is known to be a command."""


def found_commands(
    model: Model,
    raw: Mapping[str, Record],
    filtered: Collection[str],
    may_be_held: Collection[str],
    distance: float = MAX_DISTANCE,
    likely: Collection[str] = (),
    clear: float = CLEAR,
) -> Commands:
    """The inputs of a model that its outputs show to be commands, of the alternatives the one with the least residual.

    ``raw`` are the recordings (or their pieces) before filtering, ``filtered`` the inputs whose noise was filtered out,
    and ``may_be_held`` those whose hold was not given. The share of an alternative is within ``distance`` of 1, and
    ``clear`` of 0 by so many standard deviations; for inputs that are ``likely`` to be held, since they are in some
    recordings, less evidence is enough.
    """
    found = Commands()
    for name in model.diagram.inputs:
        right = list[tuple[float, Commands]]()
        if name in may_be_held:
            model = _resolving_holds(model, name)
        near, least = (max(distance, ROUGH_DISTANCE), LIKELY_CLEAR) if name in likely else (distance, clear)
        for commands in _alternatives(name, filtered, may_be_held):
            one = _beside(model, _residuals(model, raw, name, commands))
            right += [(one.rest, commands)] if one is not None and one.is_near(near, least) else []
        if right:
            found = found.joined(min(right, key=lambda pair: pair[0])[1])
    return found


def confirmed(model: Model, before: Setup) -> bool:
    """Whether the outputs do not ask for the way back, of a model fitted with some commands.

    Beside a lag or a dead time that is longer than half a sample they ask for more of the same instead. ``before`` is
    the setup without them.
    """
    made = attrs.evolve(model.problem, experiments=before.experiments)
    if made.samples != model.problem.samples or len(made.experiments) != len(model.problem.experiments):
        return True  # its pieces are others
    one = _beside(model, made.residuals(model.theta))
    return one is None or not one.is_refuted(MAX_DISTANCE)


def confirmed_by_fit(model: Model, found: Commands) -> Commands:
    """The commands without those held inputs with which a fit of the model does not leave clearly less.

    A share is of first order, and where a model lacks something of the form of an effect, that may look like half a
    sample of delay.
    """
    held = list[str]()
    for name in found.held:
        finer = _resolving_holds(model, name)
        with_hold = _fitted_held(finer, name)
        if with_hold is not None and with_hold.mean_square <= (1 - CLEAR**2 / len(model.r)) * finer.mean_square:
            held.append(name)
    return Commands(tuple(held), found.exact)


def commands_instead(base: Model, named: Model, may_be_held: Collection[str]) -> Commands:
    """The input whose hold explains as much as a delay that was named: half a sample of it is the delay of a hold.

    ``named`` is the model with that effect, ``base`` the one without.
    """
    for name in may_be_held:
        held = _fitted_held(base, name)
        if held is not None and held.mean_square <= (1 + MAX_RISE) * named.mean_square:
            return Commands(held=(name,))
    return NO_COMMANDS


@attrs.frozen
class HeldDelay:
    """The dead time [s] of a block with an input held between samples, which the outputs do not exclude."""

    block: str
    input: str
    time: float


def delays_if_held(final: Model, blocks: Collection[str], may_be_held: Collection[str]) -> list[HeldDelay]:
    """The dead times of some blocks with an input held that is not, where the outputs agree with that as well.

    A hold is half a sample of dead time, and beside another dead time recordings seldom tell them apart.
    """
    found = list[HeldDelay]()
    for name in may_be_held if blocks else ():
        held = _fitted_held(final, name)
        if held is not None and held.mean_square <= (1 + CLEAR**2 / len(final.r)) * final.mean_square:
            times = {block: held.values.get(f"{block}.{TIME}") for block in blocks}
            found += [HeldDelay(block, name, time) for block, time in times.items() if time is not None]
    return found


def _fitted_held(model: Model, name: str) -> Model | None:
    """The model fitted with an input held between samples; None where it is no other, or not one of its inputs."""
    held = setup_held(model.setup, name) if name in model.diagram.inputs else None
    if held is None:
        return None
    return optimized(attrs.evolve(model.problem, experiments=held.experiments), held, model.theta)


def _resolving_holds(model: Model, name: str) -> Model:
    """The model at a step at which its residuals tell whether an input is held."""
    finer = resolving_holds(model.problem, model.setup, name)
    if finer is None:
        return model
    problem, setup = finer
    return attrs.evolve(model, problem=problem, setup=setup, r=problem.residuals(model.theta))


def _beside(model: Model, other: np.ndarray | None) -> Alternative | None:
    """An alternative beside a model, whose residuals are ``other``."""
    if other is None:
        return None
    bounds = np.eye(model.J.shape[1])[model.at_bound]
    held, count = bounds if len(bounds) else None, len(model.setup.outputs)
    return alternative(model.J, model.r, other, model.problem.segments, held, count)


def _alternatives(name: str, filtered: Collection[str], may_be_held: Collection[str]) -> Iterator[Commands]:
    """The other ways to simulate an input."""
    if name in may_be_held:
        yield Commands(held=(name,))
    if name in filtered:
        yield Commands(exact=(name,))
    if name in may_be_held and name in filtered:
        yield Commands(held=(name,), exact=(name,))


def _residuals(model: Model, raw: Mapping[str, Record], name: str, as_command: Commands) -> np.ndarray | None:
    """The residuals of a model with an alternative for an input; None where it is the same, or there is none."""
    setup = model.setup
    if name in as_command.exact:
        records = [evenly_sampled(raw[one.name]) for one in setup.experiments]
        if any(len(a) != len(b.record) for a, b in zip(records, setup.experiments, strict=True)):
            return None
        made = (
            setup.prepared(e, record=attrs.evolve(b.record, signals={**b.record.signals, name: a[name]}))
            for e, (a, b) in enumerate(zip(records, setup.experiments, strict=True))
        )
        setup = attrs.evolve(setup, experiments=tuple(made))
    problem = attrs.evolve(model.problem, experiments=setup.experiments)
    if name in as_command.held:
        return residuals_held(problem, setup, model.theta, name)
    return problem.residuals(model.theta)
