"""What is the friction of the axis?  A diagnosis of a ball-screw drive that is modelled without dry friction.

The position loop suppresses friction in the position, and friction appears in the force, so both are compared. Only
the first of two equal strokes is fitted; the second, and a recording with pulses of 5 V, are held out.
Measured data: EMPS of Janot, Gautier and Brunot (nonlinearbenchmark.org), in the folder emps/ of the one that
TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path
from textwrap import fill

import numpy as np

import tsmblocks as tsm
from tsmblocks.data import noise

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit("Set TSMBLOCKS_DATA to a folder that holds emps/ with the files of nonlinearbenchmark.org.")


def recorded(name):
    """Reference and position [m], force [N], and the pulses of 5 V added to the controller's output."""
    record = tsm.read(Path(os.environ["TSMBLOCKS_DATA"]) / "emps" / name)
    pulse = 5.0 * (record["pulses_N"] > 0) if "pulses_N" in record else np.zeros(len(record))
    return record.with_signal("force", 35.15065 * record["vir"], "N").with_signal("pulse", pulse)


loop = tsm.load(Path(__file__).with_suffix(".toml"))
strokes, pulses = recorded("DATA_EMPS.mat"), recorded("DATA_EMPS_PULSES.mat")
numbers = ["mass.value", "viscous.coefficient", "offset.value"]
sampled = {"hold": "zero", "step": 1e-3}
force_noise = noise(strokes, "force", inputs="qg").floor  # N, differences from stroke to stroke
floor = {"force": force_noise, "qm": 4e-6}  # the position [m] differs between strokes by as much as its reference does
first = strokes.part(0.0, 12.36)
found = tsm.diagnose(loop, first, free=numbers, outputs=[*floor], noise_floor=floor, condition=False, **sampled)

print(fill(found.sentence, 79))
for effect in found.effects:
    values = ", ".join(f"{name} {one.value:.3g} {one.unit}".strip() for name, one in effect.parameters.items())
    print(f"  {effect.block}: {values}")
print("error of the force       both strokes  second stroke  pulses")
for title, diagram in {"base": found.base, "augmented": found.augmented}.items():
    both = tsm.score(diagram, strokes, window=(0.05, None), outputs=["force"], **sampled)["force"].relative
    second = tsm.score(diagram, strokes, window=(12.42, None), outputs=["force"], **sampled)["force"].relative
    other = tsm.score(diagram, pulses, window=(0.05, None), outputs=["force"], **sampled)["force"].relative
    print(f"{title:24} {100 * both:11.2f} % {100 * second:12.2f} % {100 * other:6.2f} %")
print("published, symmetric            4.08 %                  5.98 %\npublished, asymmetric           3.11 %")
