"""The consequence for control: tracking with compensators built on the base and on the augmented model."""

from __future__ import annotations

import warnings

import numpy as np

from tsmblocks.blocks import FirstOrderLag, Integrator, Sum
from tsmblocks.common.errors import TsmError
from tsmblocks.common.rounding import to_digits
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.diagnosis.quantities import recorded_units
from tsmblocks.diagnosis.segment import Consequence
from tsmblocks.fitting.experiments import grid_step
from tsmblocks.metrics.tracking import peak_to_peak, rms
from tsmblocks.model.diagram import Diagram, Inlet
from tsmblocks.simulation.simulate import simulate

LOOP_GAIN_PER_STEP = 0.25
"""Gain of the loop around a model times its step. Chosen: critically damped with the lag, the fastest for the step."""
SETTLING_SHARE = 0.1
"""Share of a motion, from its start, without error count. Chosen: the loop settles in it."""
LOOP_SUBSTEPS = (80, 40, 20, 10, 5)
"""Steps of the loop between two samples, the fastest loop first; the first stable one is used. Chosen."""
STEPS_PER_LOOP_STEP = 4
"""Steps of the simulation for each step of the loop. Chosen: the lag is resolved."""
NO_TRACKING = 0.1
"""Tracking error over the spread of the reference [rms] from which a compensator that does worse than none does not
follow its model. Chosen: the inverse of a small gap has an error of some per cent."""
DIVERGENCE_RATIO = 100.0
"""Tracking error over the largest reference from which a loop has diverged. Chosen."""
MAX_STEPS = 2_000_000
"""Steps of one simulation at most. Chosen: for the run time, about a second."""

NOT_TRACKED = (
    "Tracking was not simulated: the compensator, a fast feedback loop around the model that finds the command for a "
    "wanted motion,"
)
"""Why there is no consequence, up to the fault of the compensator."""
UNSTABLE = "is unstable with this model, as with most that have an inertia"
NAMES_HOLD = "That is a limit of this compensator, not of the mechanism; the verdict does not depend on it."
Errors = tuple[float, float]


def consequence(base: Model, augmented: Model) -> Consequence | str:
    """Track a recorded motion with the augmented model as the plant; a sentence where that fails.

    A compensator is a fast loop around a model: the command with which the model tracks the reference. The reference is
    the input of the first experiment; plant and models have the initial states estimated for it. Where a command and
    the motion are two things, since their units differ, or there are several, no compensator is meant: the sentence is
    empty.
    """
    experiment, outputs, inputs = base.setup.experiments[0], base.setup.outputs, list(base.diagram.inputs)
    if len(inputs) != 1 or len(outputs) != 1:
        return ""
    (inlet,), (outlet,) = inputs, outputs
    unit = augmented.diagram.unit(outlet)
    if not unit or augmented.diagram.inports[inlet].unit != unit:
        return ""
    record, unit = experiment.record, recorded_units(base.setup)[outlet]
    wanted, plant = record.values(inlet, unit), _of_first_experiment(augmented)
    models = [None, _of_first_experiment(base), plant]
    step, fault = grid_step(record.t), UNSTABLE  # the median is robust to rounded time stamps
    for substeps in LOOP_SUBSTEPS:
        if len(record) * substeps * STEPS_PER_LOOP_STEP > MAX_STEPS:
            continue
        loop = step / substeps
        try:
            errors = [_errors(model, plant, inlet, outlet, record.t, wanted, loop) for model in models]
        except TsmError:
            continue
        if np.isfinite(errors).all():
            none, before, after = errors
            if after[1] > max(none[1], NO_TRACKING * float(np.std(wanted))):  # it does not follow; a slower one may
                fault = "does worse than none"
                continue
            words = _words(before, after, unit, 4 * loop / LOOP_GAIN_PER_STEP)
            return Consequence(unit, experiment.name, none, before, after, words)
    return f"{NOT_TRACKED} {fault}. {NAMES_HOLD}"


def _of_first_experiment(model: Model) -> Diagram:
    """The diagram with the parameters and initial states of the first experiment."""
    return model.diagram.with_parameters(model.problem.unknowns.settings(model.theta, 0))


def _words(base: Errors, augmented: Errors, unit: str, delay: float) -> str:
    """A comment on a compensator on the new model that is no better than that on the base."""
    kinds = zip(("peak to peak", "rms"), base, augmented, strict=True)
    worse = [(name, before, after) for name, before, after in kinds if after > before]
    if not worse:
        return ""
    sizes = [
        f"{name}, {in_display_units(after, unit)} against {in_display_units(before, unit)}"
        for name, before, after in worse
    ]
    return (
        f"The compensator built on the augmented model tracks no better ({'; '.join(sizes)}). This is no evidence "
        "against the model, which is the plant itself: the inverse of one with a gap or hysteresis has to jump at "
        f"reversals, and the compensator takes some {to_digits(1000 * delay)} ms for it."
    )


def _errors(
    model: Diagram | None, plant: Diagram, inlet: str, outlet: str, t: np.ndarray, wanted: np.ndarray, step: float
) -> Errors:
    """Peak-to-peak and rms tracking error of a plant behind a model's compensator; infinite if the loop diverges."""
    blocks, wires, ports = {"plant": plant}, [], [f"plant.{inlet}"]
    if model is not None:
        blocks["compensator"] = inverse(model, inlet, outlet, gain=LOOP_GAIN_PER_STEP / step, start=float(wanted[0]))
        wires, ports = [f"compensator -> plant.{inlet}"], ["compensator.wanted"]
    wanted_inlet, outputs = Inlet(ports, plant.unit(outlet)), {"x_out": f"plant.{outlet}"}
    loop = Diagram(title="consequence", blocks=blocks, wires=wires, inputs={"wanted": wanted_inlet}, outputs=outputs)
    start, stop = float(t[0]), float(t[-1])
    with warnings.catch_warnings():  # a step that is too long shows in the errors
        warnings.simplefilter("ignore")
        inputs, fine_step = {"wanted": (t, wanted)}, step / STEPS_PER_LOOP_STEP
        run = simulate(
            loop, start=start, stop=stop, step=fine_step, inputs=inputs, hold="cubic", log="outputs", check_step=False
        )
    error = run["x_out"] - np.interp(run.t, t, wanted)
    late = error[run.t >= start + SETTLING_SHARE * (stop - start)]
    if np.abs(late).max() > DIVERGENCE_RATIO * np.abs(wanted).max():
        return np.inf, np.inf
    return peak_to_peak(late), rms(late)


def inverse(model: Diagram, inlet: str, outlet: str, gain: float, start: float = 0.0) -> Diagram:
    r"""A compensator for any model: the command that makes the model's output follow ``wanted``, by a loop around it.

    .. math:: x' = \tfrac{1}{\tau}(c - x), \qquad c' = K (w - \hat y(x)), \qquad \tau = \tfrac{1}{4 K}

    ``gain`` is K [1/s]; the command starts at ``start``. The lag damps the loop critically where the model's gain is
    1, and avoids an algebraic loop with models that depend on the rate of their input, as the paper's does. Output
    ``command``, in the unit of the model's input.
    """
    unit = model.inports[inlet].unit
    blocks = {
        "miss": Sum(signs="+-"),
        "fast": Integrator(gain=gain, unit=unit, integral=start),
        "soft": FirstOrderLag(time_constant=1 / (4 * gain), value=start),
        "model": model,
    }
    return Diagram(
        title="inverse by a loop around the model",
        blocks=blocks,
        wires=[f"miss -> fast -> soft -> model.{inlet}", f"model.{outlet} -> miss.minus"],
        inputs={"wanted": Inlet(["miss.plus"], model.unit(outlet))},
        outputs={"command": "soft"},
    )
