"""What does feedback of the tip add to the feedforward?  (Figs 16 and 17)

With the second set of parameters and the gains printed in the paper; then the effect of each part alone. A folder
given as an argument receives the picture.
"""

import sys
from pathlib import Path

import tsmblocks as tsm

both = tsm.load("fig16_feedforward_feedback")
loops = {
    "feedforward": both.with_parameters({"pid.kp": 0.0, "pid.ki": 0.0}),
    "feedforward + PID": both,
    "feedforward + P": both.with_parameters({"pid.ki": 0.0}),
    "feedforward + I": both.with_parameters({"pid.kp": 0.0}),
    "PID without feedforward": both.rewire(cut=["compensator -> total.plus1"], add=["ref -> total.plus1"]),
}
runs = {name: tsm.simulate(loop, stop=20.0) for name, loop in loops.items()}
ours = [tsm.tracking_error(run, after=10.0).to("deg").peak_to_peak for run in runs.values()]
paper = [8.0, 5.8, "", "", ""]
reasons = ["Eq (14), as in Figs 13 to 15", "feedforward leaves more to it", "", "", ""]

print(f"{'peak to peak, x_ref - x_out [deg]':34} {'paper':>6} {'ours':>6}  why they differ")
for name, measured, error, reason in zip(runs, paper, ours, reasons, strict=True):
    print(f"{name:34} {measured:>6} {error:6.1f}  {reason}".rstrip())
print(f"{'removed by the PID':34} {100 * (1 - 5.8 / 8.0):4.0f} % {100 * (1 - ours[1] / ours[0]):4.0f} %")

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure

    from tsmblocks.plots import plot_loop, plot_tracking

    sheet = Figure(figsize=(11.0, 5.5), layout="constrained")
    left, right = sheet.subfigures(1, 2, width_ratios=(1.0, 1.3))
    shown = {name: runs[name] for name in ("feedforward", "feedforward + PID")}
    loop = left.subplots()
    for name, run in shown.items():
        plot_loop(run["x_ref"][10001:], run["x_out"][10001:], loop, label=name, names=("x_ref", "x_out"))
    upper, lower = right.subplots(2, 1, sharex=True)
    plot_tracking(shown, (upper, lower), after=10.0)
    for panel in (loop, upper, lower):
        title = "peak-to-peak error" if panel is lower else None
        panel.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, title=title, alignment="left")
    sheet.savefig(folder / "fig_17.png")
