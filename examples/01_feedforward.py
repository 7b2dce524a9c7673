"""How much does feedforward alone reduce the tracking error?  Two of the paper's diagrams, run.  (Fig 9)"""

import tsmblocks as tsm

for name in ("fig09a_without_feedforward", "fig09b_feedforward"):
    run = tsm.simulate(tsm.load(name), stop=20.0, step=1e-3)
    error = tsm.tracking_error(run, after=10.0).to("deg")  # after the transient
    print(f"{name:27} {error.peak_to_peak:5.2f} deg peak to peak, {error.rms:5.2f} deg rms")
