"""What a missing effect means for control: a compensator built on the base and on the augmented model, compared."""

from __future__ import annotations

import numpy as np

from tsmblocks.blocks import FirstOrderLag, Integrator, Sum
from tsmblocks.data import Record
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.result import Consequence
from tsmblocks.diagram import Diagram, Inlet
from tsmblocks.errors import TsmError
from tsmblocks.measures import peak_to_peak, rms
from tsmblocks.simulate import simulate

FAST = 0.25
"""Gain of the loop around a model, over one step: as fast as the step can follow."""
SETTLING = 0.1
"""Share of a motion, from its start, in which the loop catches up; errors count after it."""
SUBSTEPS = 5
"""Steps between two samples."""


def consequence(base: Model, augmented: Model) -> Consequence | None:
    """Track a recorded motion with the augmented model as the plant; None where input and output are not one motion.

    A compensator is a fast loop around a model: the command that makes the model do what is wanted. The motion is
    the input of the first experiment, taken as what the output should do.
    """
    trial, outputs = base.setup.trials[0], base.setup.outputs
    inputs = list(base.diagram.inputs)
    if len(inputs) != 1 or len(outputs) != 1:
        return None
    unit = augmented.diagram.unit(outputs[0])
    if not unit or augmented.diagram.inports[inputs[0]].unit != unit:
        return None
    record = trial.record
    h = record.step / SUBSTEPS
    try:
        errors = [_errors(model, augmented.fitted, inputs[0], outputs[0], record, unit, h)
                  for model in (None, base.fitted, augmented.fitted)]  # fmt: skip
    except TsmError:
        return None
    if not np.isfinite(errors).all():
        return None
    return Consequence(unit, trial.name, *errors)


def _errors(
    model: Diagram | None, plant: Diagram, inlet: str, outlet: str, record: Record, unit: str, h: float
) -> tuple[float, float]:  # fmt: skip
    """Peak-to-peak and rms tracking error of a plant behind the compensator built on a model."""
    wanted = record.values(inlet, unit)
    blocks: dict = {"plant": plant}
    wires, ports = [], [f"plant.{inlet}"]
    if model is not None:
        blocks["compensator"] = inverse(model, inlet, outlet, gain=FAST / h)
        wires, ports = [f"compensator -> plant.{inlet}"], ["compensator.wanted"]
    loop = Diagram(title="consequence", blocks=blocks, wires=wires, inputs={"wanted": Inlet(ports, unit)},
                   outputs={"x_out": f"plant.{outlet}"})  # fmt: skip
    start = float(record.t[0])
    run = simulate(loop, start=start, stop=float(record.t[-1]), step=h, inputs={"wanted": (record.t, wanted)},
                   hold="cubic", log="outputs")  # fmt: skip
    error = run["x_out"] - np.interp(run.t, record.t, wanted)
    late = error[run.t >= start + SETTLING * (record.t[-1] - start)]
    return peak_to_peak(late), rms(late)


def inverse(model: Diagram, inlet: str, outlet: str, gain: float) -> Diagram:
    r"""A compensator for any model: the command that makes the model's output follow ``wanted``, by a loop around it.

    .. math:: x' = \tfrac{1}{\tau}(c - x), \qquad c' = K (w - \hat y(x)), \qquad \tau = \tfrac{1}{4 K}

    ``gain`` is K [1/s]. The lag damps the loop critically where the model's slope is 1, and lets it stand around models
    that answer to the rate of their input too, as the paper's slope does: without it their output would depend on
    itself at the same instant. Output ``command``, in the unit of the model's input.
    """
    unit = model.inports[inlet].unit
    blocks = {
        "miss": Sum(signs="+-"),
        "fast": Integrator(gain=gain, unit=unit),
        "soft": FirstOrderLag(time_constant=1 / (4 * gain)),
        "model": model,
    }
    wires = [f"miss -> fast -> soft -> model.{inlet}", f"model.{outlet} -> miss.minus"]
    return Diagram(
        title="inverse by a loop around the model",
        blocks=blocks,
        wires=wires,
        inputs={"wanted": Inlet(["miss.plus"], model.unit(outlet))},
        outputs={"command": "soft"},
    )
