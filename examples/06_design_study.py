"""Which gain is best not only for the nominal plant, but for all variants of it?  A study over gains and plants.

In the loop of Fig. 16 the compensator was built for one sheath. When the sheath is bent or wears, the size of its
hysteresis and the length of its reversals change, and the compensator stays the same. Every gain is simulated with
every plant, side by side. Above a gain of 2 the loop cycles irregularly, so the last digits hang on rounding there. A
folder given as an argument receives the picture.
"""

import sys
from pathlib import Path

import numpy as np

import tsmblocks as tsm

loop = tsm.load("fig16_feedforward_feedback")
gains = np.arange(0.0, 6.5, 0.5)
sizes, bends = [-0.9, loop.parameters["A"], -0.7], [3.0, loop.parameters["theta"], 6.0]
found = tsm.study(
    loop,
    {"pid.kp": gains, "tsm.A": sizes, "tsm.theta": bends},
    {"error [deg]": "peak_to_peak(x_ref - x_out, after=5)", "voltage [V]": "largest(u, after=5)"},
    stop=10.0,
)

error, voltage = (found[name].reshape(len(gains), 9) for name in ("error", "voltage"))
nominal, worst = error[:, 4], error.max(axis=1)
print(f"{len(found)} runs: {loop.title}\n")
print("peak-to-peak error [deg]                        largest")
print("  kp    nominal sheath   best and worst of all  voltage")
for k, kp in enumerate(gains):
    mark = {nominal.argmin(): "  <- best, nominal", worst.argmin(): "  <- best for all"}.get(k, "")
    print(f"{kp:4.1f} {nominal[k]:17.2f} {error[k].min():10.2f} {worst[k]:12.2f} {voltage[k].max():8.1f}{mark}")

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    panel = figure.subplots()
    for line in error.T:
        panel.plot(gains, line, color="#bbbbbb", lw=1.0, label="_one plant")
    panel.plot([], [], color="#bbbbbb", lw=1.0, label="each of the nine sheaths")
    for name, line, colour in (("worst of them", worst, "#b84a06"), ("nominal sheath", nominal, "#0a5fd0")):
        panel.plot(gains, line, "o-", ms=3, color=colour, label=name)
        panel.plot(gains[line.argmin()], line.min(), "o", ms=9, mfc="none", color=colour, label="_its best gain")
    panel.plot([], [], "o", ms=9, mfc="none", color="#5b5b5b", label="best gain")
    panel.set(xlabel="pid.kp", ylabel="peak-to-peak error [deg]", ylim=(0, None))
    panel.grid(color="#dddddd", lw=0.5)
    panel.spines[["top", "right"]].set_visible(False)
    panel.legend(frameon=False)
    figure.savefig(folder / "design_study.png", dpi=144)
