"""How slow may a sampled PID be on a continuous motor?"""

import numpy as np

import tsmblocks as tsm

loop = tsm.load("sampled_position_loop")

for rate in (1000, 500, 200, 100):
    run = tsm.simulate(loop, stop=10.0, step=1e-3, parameters={"controller.period": 1 / rate})
    error = np.rad2deg(run["x_ref"] - run["x_out"])[run.t >= 5.0]
    print(f"{rate:5} Hz  {np.ptp(error):7.3f} deg peak to peak")
