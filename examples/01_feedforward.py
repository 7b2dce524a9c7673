"""How much does feedforward alone reduce the tracking error?  (Figs 9 and 13b)"""

import numpy as np

import tsmblocks as tsm

plain = tsm.simulate(tsm.load("fig09a_without_feedforward"), stop=20.0, step=1e-3)
helped = tsm.simulate(tsm.load("fig09b_feedforward"), stop=20.0, step=1e-3)

for name, run in {"without": plain, "feedforward": helped}.items():
    error = np.rad2deg(run["x_ref"] - run["x_out"])[run.t >= 10.0]
    print(f"{name:12} {np.ptp(error):5.2f} deg peak to peak")
