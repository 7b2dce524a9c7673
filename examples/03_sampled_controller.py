"""How slow may a sampled PID be on a continuous motor?  A file's diagram, with one of its numbers changed."""

import tsmblocks as tsm

loop = tsm.load("sampled_position_loop")

for rate in (1000, 500, 200, 100):
    run = tsm.simulate(loop, stop=10.0, step=1e-3, parameters={"controller.period": 1 / rate})
    error = tsm.tracking_error(run, after=5.0).to("deg")
    print(f"{rate:5} Hz  {error.peak_to_peak:7.3f} deg peak to peak")
