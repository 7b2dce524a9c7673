"""How slow may a sampled PID be on a continuous motor, and how does a delayed bus change that?

A diagram from a file, with one parameter changed, and with a delay inserted behind the controller: continuous,
sampled and delayed parts run in one diagram.
"""

import tsmblocks as tsm
from tsmblocks.blocks import Delay

undelayed = tsm.load("sampled_position_loop")
delayed = undelayed.insert("bus", Delay(time=0.002), after="controller")

print("rms error [deg]  no delay  2 ms delay")
for rate in (1000, 500, 200, 100):
    errors = []
    for loop in (undelayed, delayed):
        # The current in the winding is faster than this step, the angle is not: no check of the step.
        run = tsm.simulate(loop, stop=10.0, step=1e-3, parameters={"controller.period": 1 / rate}, check_step=False)
        errors.append(tsm.tracking_error(run, after=5.0).to("deg").rms)
    print(f"PID at {rate:4} Hz {errors[0]:9.3f} {errors[1]:10.3f}")
