"""Which spring is missing?  An electronic oscillator, its linear model, and the block that the diagnosis adds.

The Silverbox is a circuit that acts like a mass on a spring and a damper. The residual of a linear model is 6.7 mV
for a noise of one size; the diagnosis names the missing effect, and another recording, the arrow, whose amplitude
grows beyond everything that was fitted, validates it. Measured data: Wigren and Schoukens (nonlinearbenchmark.org),
in the folder silverbox/ of the one that TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path
from textwrap import fill

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Gain, Integrator, Sum, ViscousFriction

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit("Set TSMBLOCKS_DATA to a folder that holds silverbox/ with SNLS80mV.csv of nonlinearbenchmark.org.")


def recorded(first, last):
    """Rows of the file, the first below the header being 2."""
    path = Path(os.environ["TSMBLOCKS_DATA"]) / "silverbox/SNLS80mV.csv"
    record = tsm.read(path, step=1 / 610.35, rows=(first, last), units={"V1": "V", "V2": "V"})
    return record.renamed({"V1": "drive", "V2": "place"})


oscillator = tsm.Diagram(
    title="mass, spring and damper",
    blocks={
        "push": Gain(gain=1.9e5),
        "force": Sum(signs="+--"),
        "speed": Integrator(),
        "position": Integrator(),
        "damper": ViscousFriction(coefficient=40.0),
        "spring": Gain(gain=1.9e5),
        "gauge": Bias(),
    },
    wires=[
        "push -> force.plus",
        "force -> speed -> position -> gauge",
        "speed -> damper -> force.minus1",
        "position -> spring -> force.minus2",
    ],
    inputs={"drive": "push"},
    outputs={"place": "gauge"},
)
noise, arrow = recorded(40652, 60651), recorded(102, 40577)
sampled = {"hold": "cubic", "step": 1 / 610.35}
numbers = ["push.gain", "damper.coefficient", "spring.gain", "gauge.bias"]
found = tsm.diagnose(oscillator, noise, free=numbers, noise_floor=3e-4, **sampled)

print(fill(found.sentence, 79))
for effect in found.effects:
    print(f"share of the error removed by {effect.words}: {100 * effect.share_removed:.2f} %")
(gap,) = found.worst.gaps
print("mV, fitted  ", *(f"{1e3 * rms:8.3f}" for rms in gap.train))
print("mV, held out", *(f"{1e3 * rms:8.3f}" for rms in gap.held_out))
at_rest = {"speed.integral": 0.0, "position.integral": 0.0}  # not where the recording of the fit began
models = (found.base, found.augmented)
before, after = (tsm.score(d, arrow, parameters=at_rest, **sampled)["place"].rms for d in models)
print(f"mV, arrow    {1e3 * before:8.3f} {1e3 * after:8.3f} (published: 2.4 to 2.8; a hand-made model: 0.96)")
