"""How slow may a sampled PID be on a continuous motor, and does it bear a bus that is late?

A file's diagram, with one of its numbers changed, and with a delay put behind the controller: continuous, sampled and
delayed parts run in one diagram.
"""

import tsmblocks as tsm
from tsmblocks.blocks import Delay

at_once = tsm.load("sampled_position_loop")
late = at_once.insert("bus", Delay(time=0.002), after="controller")

print("rms error [deg]  at once  2 ms late")
for rate in (1000, 500, 200, 100):
    errors = []
    for loop in (at_once, late):
        run = tsm.simulate(loop, stop=10.0, step=1e-3, parameters={"controller.period": 1 / rate})
        errors.append(tsm.tracking_error(run, after=5.0).to("deg").rms)
    print(f"PID at {rate:4} Hz {errors[0]:9.3f} {errors[1]:10.3f}")
