"""A mechanism to be identified: a tendon sheath behind a motor loop, with a hidden effect, and its recordings."""

from __future__ import annotations

import math
from typing import Any

import attrs
import numpy as np

from tsmblocks.blocks import AsymmetricBoucWen, Bow, MultiSine, Play, Ripple, Sine
from tsmblocks.data import Record
from tsmblocks.files import load
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate

DEG = math.pi / 180
NUMBERS = {"alpha1": 0.91, "alpha2": 0.94, "A": -0.82, "theta": 4.6, "delta": 0.08}
"""True parameters of the sheath; the paper's, from which a model starts, are others."""
STEP, SAMPLE, STOP = 1e-3, 0.01, 20.0
"""Step of the simulation, interval between samples, and duration of an experiment [s]."""
COUNTS = 14 * 4096
"""Encoder counts in a turn of the sheath's input: 1024 lines, counted four times, before a gear of 14:1."""
NOISE, INTERVAL = 0.1 * DEG, 0.05 * DEG
"""Rms noise and quantisation interval of the sensor at the tip [rad]."""


@attrs.frozen
class Hidden:
    """An effect that a mechanism has and its model has not: a block on the wire before a port."""

    words: str
    block: Block | None = None
    before: str = ""


HIDDEN = {
    "backlash": Hidden("a worn coupling between motor and tendon, a gap 3 deg wide", Play(half_width=1.5 * DEG), "tsm"),
    "odd_nonlinearity": Hidden(
        "a lever at the tip that moves up to 20 % faster about its middle", Bow(size=0.06, width=0.3), "x_out"
    ),
    "position_ripple": Hidden(
        "an eccentric pulley at the tip, ±0.6 deg every 45 deg",
        Ripple(cosine=0.36 * DEG, sine=0.48 * DEG, cycles=8.0),
        "x_out",
    ),
    "none": Hidden("nothing; the structure of the model is exact"),
}
"""Effects that may be hidden, by the name that a diagnosis should report."""


def model() -> Diagram:
    """The engineer's model of the sheath: the paper's proposed model with the paper's parameters."""
    return Diagram(
        title="Tendon sheath, proposed model",
        source="Paper, Eqs (8)-(9), set 1",
        blocks={"tsm": AsymmetricBoucWen()},
        inputs={"x_in": "tsm.x"},
        outputs={"x_out": "tsm"},
    )


def truth(hidden: Hidden) -> Diagram:
    """The true sheath: the same equations with parameters of its own, and the hidden effect."""
    sheath = model().with_parameters({f"tsm.{k}": v for k, v in NUMBERS.items()}).rewire(title="The true mechanism")
    return sheath if hidden.block is None else sheath.insert("hidden", hidden.block, before=hidden.before)


def behind_the_motor(sheath: Diagram, reference: Block) -> Diagram:
    """The paper's Fig. 9(a) with this sheath and this reference; the motor's angle is ``x_in``, its voltage ``u``."""
    loop = load("fig09a_without_feedforward").replace("ref", reference)
    return loop.replace("tsm", sheath, ports={"x": "x_in", "y": "x_out"})


def references() -> dict[str, Block]:
    """The references of the experiments, by name."""
    tones: dict[str, Any] = dict(phases=(0.0, 0.0), unit="rad")
    return {
        "large": Sine(amplitude=55.0 * DEG, frequency=0.2, unit="rad"),
        "two_tones": MultiSine(amplitudes=(DEG * 28.0, DEG * 28.0), frequencies=(0.2, 0.5), **tones),
        "small": MultiSine(amplitudes=(DEG * 12.0, DEG * 8.0), frequencies=(0.25, 0.25 * math.sqrt(3)), **tones),
    }


def measured(sheath: Diagram, seed: int) -> dict[str, Record]:
    """Recordings of each experiment: encoder counts at the motor, noise and quantisation at the tip."""
    noise = np.random.default_rng(seed)
    every = round(SAMPLE / STEP)
    found = {}
    for name, reference in references().items():
        run = simulate(behind_the_motor(sheath, reference), stop=STOP, step=STEP, log="outputs")
        x_in, x_out = run["x_in"][::every], run["x_out"][::every]
        signals = {
            "x_in": _rounded(x_in, 2 * math.pi / COUNTS),
            "x_out": _rounded(x_out + noise.normal(0.0, NOISE, x_out.size), INTERVAL),
        }
        found[name] = Record(name, run.t[::every], signals, {"x_in": "rad", "x_out": "rad"})
    return found


def _rounded(x: np.ndarray, interval: float) -> np.ndarray:
    return np.round(x / interval) * interval
