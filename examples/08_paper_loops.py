"""Which hysteresis loops have the paper's three models?  (Figs 3, 5 and 6)

Fig. 3 is a measurement of the instrument. Its data were not published, so the models, with the parameters printed in
the paper, are compared with what its text reports. A folder given as an argument receives the picture.
"""

import sys
from pathlib import Path

import numpy as np

import tsmblocks as tsm

SIGNALS = {
    "55 deg at 0.2 Hz": (55, [0.2], 27),
    "28 deg at 0.2 and 0.5 Hz": (28, [0.2, 0.5], 27),
    "28 deg at 0.25 and 0.43 Hz": (28, [0.25, 0.25 * 3**0.5], 28),
}
MODELS = {"symmetric": "Fig 5 left", "generalized": "Fig 5 right", "asymmetric": "Fig 6"}
t = np.linspace(0.0, 40.0, 40001)
settled = t >= 20.0  # after the transient


def simulated(model, signal, **numbers):
    """A model driven by a signal."""
    size, tones, _ = SIGNALS[signal]
    x_in = sum(np.deg2rad(size) * np.sin(2 * np.pi * f * t) for f in tones)
    sheath = tsm.load(f"tendon_sheath_{model}").with_parameters(numbers)
    return tsm.simulate(sheath, inputs={"x_in": (t, x_in)}, step=1e-3, hold="cubic")


def loop(run):
    """Angles at both ends, in degrees."""
    return np.rad2deg(run["x_in"][settled]), np.rad2deg(run["x_out"][settled])


def width(x, y, share):
    """Distance of the two branches, at a share of the range from the middle to the upper end."""
    level = (y.max() + y.min()) / 2 + share * np.ptp(y) / 2
    up = np.gradient(x) > 0
    there = [np.interp(level, *np.array(sorted(zip(y[part], x[part], strict=True))).T) for part in (up, ~up)]
    return there[0] - there[1]


def slope(x, y, direction):
    """Slope of the straight part of a branch."""
    part = (np.gradient(x) * direction > 0) & (np.abs(x) < 30.0)
    return np.polyfit(x[part], y[part], 1)[0]


runs = {(model, signal): simulated(model, signal) for model in MODELS for signal in SIGNALS}
loops = {key: loop(run) for key, run in runs.items()}
sine = next(iter(SIGNALS))
sines = [loops[model, sine] for model in MODELS]


def row(title, paper, ours, digits=1):
    print(f"{title:34} {paper:>7}", *(f"{x:11.{digits}f}" for x in ours))


print(f"{'peak to peak of x_in - x_out [deg]':34} {'paper':>7}", *(f"{model:>11}" for model in MODELS))
print(f"{'':34} {'Fig 3':>7}", *(f"{figure:>11}" for figure in MODELS.values()))
for signal, (_, _, measured) in SIGNALS.items():
    row(signal, measured, [np.ptp(np.subtract(*loops[model, signal])) for model in MODELS])
print("width of the loop [deg]")
row("near the upper reversal", "bigger", [width(x, y, 0.75) for x, y in sines])
row("near the lower reversal", "smaller", [width(x, y, -0.75) for x, y in sines])
print("slope of the loop")
row("loading", "differ", [slope(x, y, 1) for x, y in sines], 2)
row("unloading", "", [slope(x, y, -1) for x, y in sines], 2)
print("rms difference to the generalized model [deg]")
errors = np.rad2deg(np.sqrt([1.34e-2, 1.89e-3, 7.84e-3]))  # the mean square errors of Table 1, if they are in rad^2
row("these loops", "", [tsm.rms(y - sines[1][1]) for _, y in sines])
row("lower bound, Table 1 in rad^2", "", np.abs(errors - errors[1]))

as_printed = np.ptp(np.subtract(*loop(simulated("symmetric", sine, **{"tsm.gamma": 2.272}))))
print(f"""
Why they differ: the paper measured an instrument; these are its models of it.
The symmetric one has gamma = -2.272; with the printed sign: {as_printed:.1f} deg.
Table 1 gives no unit of its errors; these results exclude rad^2.""")

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure

    from tsmblocks.plots import plot_loop

    figure = Figure(figsize=(11.0, 10.0), layout="constrained")
    for signal, (left, right) in zip(SIGNALS, figure.subplots(3, 2, width_ratios=(2, 1)), strict=True):
        runs["generalized", signal].plot("x_in", "x_out", ax=left)
        left.set_xlim(20.0, 40.0)
        left.set_title(f"{signal}, generalized model", loc="left", fontsize=11)
        for model in MODELS:
            plot_loop(*loops[model, signal], right, unit="deg", label=model)
        left.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)
        right.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False, columnspacing=1, handlelength=1)
    figure.savefig(folder / "figs_3_5_6.png")
