"""What are the mass and the friction of a ball-screw axis?  Measured in closed loop, identified in two ways.

First as published: the force is a sum of terms linear in the unknowns, all filtered alike. Then by simulation of
the whole loop, sampled controller included, compared with the raw force. Measured data: EMPS of Janot, Gautier and
Brunot (nonlinearbenchmark.org), in the folder emps/ of the one that TSMBLOCKS_DATA names.
"""

import os
import sys
from pathlib import Path

import numpy as np
from scipy import signal

import tsmblocks as tsm
from tsmblocks.blocks import Bias, Gain, Sum

if "TSMBLOCKS_DATA" not in os.environ:
    sys.exit("Set TSMBLOCKS_DATA to a folder that holds emps/ with the files of nonlinearbenchmark.org.")


def recorded(name):
    """Reference and position [m], force [N], and the pulses of 5 V added to the controller's output."""
    record = tsm.read(Path(os.environ["TSMBLOCKS_DATA"]) / "emps" / name)
    pulse = 5.0 * (record["pulses_N"] > 0) if "pulses_N" in record else np.zeros(len(record))
    return record.with_signal("force", 35.15065 * record["vir"], "N").with_signal("pulse", pulse)


def regressors(record):
    """Terms of the force, by the published procedure: 100 samples a second."""
    q = signal.filtfilt(*signal.butter(4, 100.0, fs=1000.0), record["qm"], padlen=12)
    v = np.gradient(q, 1e-3)
    terms = {
        "acceleration": np.gradient(v, 1e-3),
        "v_forwards": np.maximum(v, 0.0),
        "v_backwards": np.minimum(v, 0.0),
        "direction": np.sign(v),
        "force": record["force"],
    }
    b, a = signal.cheby1(8, 0.05, 0.08)
    b *= 10 ** (0.05 / 20)  # of even order, it would lower a constant by its ripple
    decimated = {k: signal.filtfilt(b, a, x[49:], padlen=24)[::-10][::-1] for k, x in terms.items()}
    return tsm.Record(record.name, 0.01 * np.arange(len(decimated["force"])), decimated, {"force": "N"})


terms = tsm.Diagram(
    title="force of the axis, term by term",
    blocks={
        "mass": Gain(gain=100.0),
        "forwards": Gain(gain=200.0),
        "backwards": Gain(gain=200.0),
        "dry": Gain(gain=20.0),
        "sum": Sum(signs="++++"),
        "offset": Bias(bias=-3.0),
    },
    wires=["mass -> sum.plus1", "forwards -> sum.plus2", "backwards -> sum.plus3", "dry -> sum.plus4", "sum -> offset"],
    inputs={"acceleration": "mass.u", "v_forwards": "forwards.u", "v_backwards": "backwards.u", "direction": "dry.u"},
    outputs={"force": "offset"},
)
loop = tsm.load(Path(__file__).with_suffix(".toml"))
raw = [recorded("DATA_EMPS.mat"), recorded("DATA_EMPS_PULSES.mat")]
decimated = [regressors(record) for record in raw]

one_level = tsm.fit(terms, decimated[0], ties={"backwards.gain": "forwards.gain"})
two_levels = tsm.fit(terms, decimated[0])
sampled = {"hold": "zero", "step": 1e-3, "window": (0.05, None)}
names = ["mass.value", "viscous.coefficient", "dry.level", "offset.value"]
simulated = tsm.fit(loop, raw[0], free=names, **sampled)


def row(title, fit, names, errors):
    """The four parameters, half of their intervals in percent, and the error of the force in both records."""
    estimates = [f"{e.value:7.2f} ±{50 * (e.high - e.low) / abs(e.value):3.0f}%" for e in map(fit.__getitem__, names)]
    print(f"{title:10}", *estimates, *(f"{100 * d.relative:5.2f}%" for d in errors))


print(f"{'':10}", *(f"{k:>13}" for k in ("M [kg]", "Fv [N s/m]", "Fc [N]", "offset [N]")), "fitted pulses")
print(f"{'published':10}", *(f"{x:7.1f}      " for x in (95.1, 203.5, 20.4, -3.2)), f"{4.08:5}% {5.98:5}%")
linear = ["mass.gain", "forwards.gain", "dry.gain", "offset.bias"]
row("by terms", one_level, linear, tsm.score(one_level.diagram, decimated))
row("simulated", simulated, names, tsm.score(simulated.diagram, raw, **sampled))
forth, back = two_levels["forwards.gain"].value, two_levels["backwards.gain"].value
print(
    f"with two viscous levels, {forth:.1f} and {back:.1f} N s/m, the error is\n"
    f"{100 * two_levels.differences['force'].relative:.2f} % (published: 3.11 %)"
)
