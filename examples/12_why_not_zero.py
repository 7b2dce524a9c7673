"""Why is an error of 13 degrees left by a compensator with perfect parameters?  (Eq 14)

It uses the observer's state instead of the plant's. The observer follows the reference, the plant the motor, and
around a reversal the motor moves much more than the reference: the states differ.
"""

import numpy as np

import tsmblocks as tsm

run = tsm.simulate(tsm.load("fig09b_feedforward"), stop=20.0, step=1e-3)
settled = run.t >= 10.0
states = np.rad2deg(run["compensator.zeta"] - run["tsm.zeta"])[settled]
motor = np.rad2deg(run["compensator.y"] - run["x_in"])[settled]
print(f"observer minus plant state {np.ptp(states):5.2f} deg peak to peak")
print(f"motor loop error           {np.ptp(motor):5.2f} deg peak to peak")
