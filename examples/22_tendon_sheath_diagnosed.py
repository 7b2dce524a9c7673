"""What does a model of a real instrument lack?  Five bends of a measured tendon sheath, two models.

A straight line lacks a backlash, on every bend. The paper's model has a hysteresis loop, but without the flat parts
of a backlash; what it lacks resembles a backlash, a saturation or a memory, which one slow sine cannot distinguish.
The diagnosis uses cross-validation blocks of time. For the line there is a stronger test: all parameters, those of
the new blocks too, are fitted again to the first of two cycles, and the second is predicted. Measured data: the
repository nhoyh/hysteresis_compensation_ROS (Nho, Baek and others, IEEE RA-L 2021), in the folder tendon_sheath/ of
the one that TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path

import tsmblocks as tsm

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit("Set TSMBLOCKS_DATA to a folder that holds tendon_sheath/ (of nhoyh/hysteresis_compensation_ROS).")
folder = Path(os.environ["TSMBLOCKS_DATA"]) / "tendon_sheath/calib"
bends = {"tendon_sheath_linear": (0, 60, 120, 180, 240), "tendon_sheath_asymmetric": (0, 120)}


def predicted_rms(diagram, record):
    """Rms [deg] in the second cycle, all parameters fitted to the first."""
    middle = (record.t[0] + record.t[-1]) / 2
    fitted = tsm.fit(diagram, record, window=(None, middle)).diagram
    return 57.29578 * tsm.score(fitted, record, window=(middle, None))["x_out"].rms


for model, chosen in bends.items():
    predicts = model == "tendon_sheath_linear"
    print(f"\n{model}\n{'rms [deg]':10} {'fitted':^16}   {'held out':^16}" + "   second cycle" * predicts)
    for bend in chosen:
        record = tsm.read(folder / f"{bend}.txt", columns="t, x_in [deg],, x_out [deg],,,,")
        found = tsm.diagnose(tsm.load(model), record)
        (gap,) = found.worst.gaps
        pairs = [[57.29578 * rms[0], 57.29578 * rms[-1]] for rms in (gap.train, gap.held_out)]
        if predicts:
            pairs.append([predicted_rms(diagram, record) for diagram in (found.base, found.augmented)])
        print(f"{bend:4} deg   ", "     ".join(f"{before:5.2f} -> {after:5.2f}" for before, after in pairs))
        print("  missing:", ", ".join(effect.name for effect in found.effects) or found.verdict)
        for effect in found.effects[:1]:
            print("  the first may also be:", ", ".join(effect.also_possible) or "nothing else")
