"""Compensators built on a model of the mechanism, and the tracking error of the true mechanism behind them."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.blocks import ElasticBacklash, FeedforwardCompensator, Play, Recorded
from tsmblocks.common.errors import TsmError
from tsmblocks.demo.mechanism import STEP, STOP, behind_the_motor, references
from tsmblocks.diagnosis.consequence import inverse
from tsmblocks.metrics.tracking import TrackingError, tracking_error
from tsmblocks.model.diagram import Diagram
from tsmblocks.optimal.control import optimal_control
from tsmblocks.simulation.run import Run
from tsmblocks.simulation.simulate import simulate

REFERENCE = "large"
"""The experiment whose reference is tracked."""
FEEDFORWARD, LOOP, PLANNED = "feedforward, Eq. 11", "loop around the model", "planned"
"""Names of the compensators."""
GAIN = 200.0
"""Gain of the fast loop around a model that approximates its inverse [1/s]. Chosen: well below 1 / ``LOOP_STEP``.

With it the loop hunts about the upper reversal, and the third digit of its error depends on rounding; with a gain of 50
it does not, and its error is larger."""
LOOP_STEP = STEP / 2
"""Step of the mechanism behind a compensator [s]. Chosen: half of it moves the errors by no more than rounding does;
with twice of it the peaks of the loop around a model are up to 20 % too low."""
SPEED = 3.0
"""Limit of the planned command's rate [rad/s]."""
PERIOD, GRID = 5.0, 0.02
"""Period of the reference, and interval between samples of a plan [s]."""
ROUNDED = {"alpha_x": 1.0, "rho": 1.0, "roundness": 0.1, "growth_up": 0.0, "growth_down": 0.0}
"""With these an ElasticBacklash is a gap whose corners are rounded a little: a plan needs states that move smoothly."""
SETTLED = STOP / 2
"""From when on the error counts [s]."""


@attrs.frozen(eq=False)
class Tracked:
    """The mechanism behind one compensator: the run, and its tracking error."""

    words: str
    model: str
    run: Run = attrs.field(repr=False)

    @property
    def error(self) -> TrackingError:
        """Tracking error in deg, the start left out."""
        return tracking_error(self.run, after=SETTLED).to("deg")


def uncompensated(sheath: Diagram) -> Tracked:
    """The reference as the command."""
    return _tracked("no compensation", "", _loop(sheath))


def compensated(sheath: Diagram, model: Diagram, words: str) -> list[Tracked]:
    """Each compensator that can be built on a model, which is called ``words``."""
    loop = _loop(sheath)
    built = {FEEDFORWARD: _feedforward(loop, model), LOOP: _around(loop, model), PLANNED: _planned(loop, model)}
    return [_tracked(name, words, made) for name, made in built.items() if made is not None]


def _feedforward(loop: Diagram, model: Diagram) -> Diagram:
    """The paper's (11) with the parameters of a model, of which it takes those of the Bouc-Wen block only."""
    numbers = {k: model.parameters[f"tsm.{k}"] for k in ("alpha1", "alpha2", "A", "theta", "delta")}
    return loop.insert("compensator", FeedforwardCompensator(**numbers), before="error.plus")


def _around(loop: Diagram, model: Diagram) -> Diagram:
    """A fast loop around a model: the command with which the model follows the reference."""
    return loop.insert("compensator", inverse(model, "x_in", "x_out", GAIN), before="error.plus")


def _planned(loop: Diagram, model: Diagram) -> Diagram | None:
    """The optimal command for a model that knows the whole reference; None where the search found none."""
    t = np.arange(0.0, PERIOD + GRID / 2, GRID)
    x_ref = np.asarray(simulate(loop, stop=PERIOD, step=GRID / 4, log="outputs", check_step=False)["x_ref"])[::4]
    try:
        best = optimal_control(
            plannable(model),
            {"x_in": (None, None)},
            "x_ref - x_out",
            rates={"x_in": (-SPEED, SPEED)},
            references={"x_ref": (t, x_ref)},
            step=GRID,
            periodic=True,
            guess={"x_in": 1.25 * x_ref},
        )
    except TsmError:
        return None
    command = best.inputs(STOP + PERIOD)["x_in"]
    plan = Recorded(times=tuple(command.t), values=tuple(command.y), unit="rad")
    return loop.rewire(blocks={**loop.blocks, "plan": plan}, cut=["ref -> error.plus"], add=["plan -> error.plus"])


def plannable(model: Diagram) -> Diagram:
    """The same model with its gaps rounded off."""
    made = model
    for name, block in model.blocks.items():
        if isinstance(block, Play):
            rounded = ElasticBacklash(half_width=model.parameters[f"{name}.half_width"], **ROUNDED)
            made = made.replace(name, rounded, ports={"u": "x"})
    return made


def _loop(sheath: Diagram) -> Diagram:
    return behind_the_motor(sheath, references()[REFERENCE])


def _tracked(words: str, model: str, loop: Diagram) -> Tracked:
    return Tracked(words, model, simulate(loop, stop=STOP, step=LOOP_STEP, log="outputs", check_step=False))
