"""Why does a compensator with perfect parameters leave 13 degrees?  (Eq 14)

It takes the observer's state for the plant's. The observer follows the reference, the plant the
motor, and around a reversal the motor moves much more than the reference: the states part.
"""

import numpy as np

import tsmblocks as tsm

run = tsm.simulate(tsm.load("fig09b_feedforward"), stop=20.0, step=1e-3)
late = run.t >= 10.0
states = np.rad2deg(run["compensator.zeta"] - run["tsm.zeta"])[late]
motor = np.rad2deg(run["compensator.y"] - run["x_in"])[late]
print(f"observer minus plant state {np.ptp(states):5.2f} deg peak to peak")
print(f"motor loop error           {np.ptp(motor):5.2f} deg peak to peak")
