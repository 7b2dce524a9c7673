"""What if the observer follows the measured motor velocity instead of the reference?

The motor has an encoder already, so this needs no sensor at the tip. One edit of the diagram: the compensator is
replaced by its parts, and its observer is wired to the motor.
"""

import tsmblocks as tsm
from tsmblocks.blocks import Derivative, Divide, HysteresisObserver, SmoothSlope, Sum

before = tsm.load("fig09b_feedforward")
numbers = {k: f"${k}" for k in ("A", "theta", "delta")}
after = before.rewire(
    cut=["ref -> compensator", "compensator -> error.plus"],
    add=[
        "motor.v -> observer",
        "ref -> rate -> slope",
        "ref -> inverse.plus",
        "observer -> inverse.minus",
        "inverse -> quotient.num",
        "slope -> quotient.den",
        "quotient -> error.plus",
    ],
    blocks={
        **{k: b for k, b in before.blocks.items() if k != "compensator"},
        "observer": HysteresisObserver(**numbers),
        "rate": Derivative(),
        "slope": SmoothSlope(alpha1="$alpha1", alpha2="$alpha2"),
        "inverse": Sum(),
        "quotient": Divide(),
    },
)

for name, diagram in {"on the reference": before, "on the motor": after}.items():
    run = tsm.simulate(diagram, stop=20.0, step=1e-3)
    error = tsm.tracking_error(run, after=10.0).to("deg")
    print(f"observer {name:17} {error.peak_to_peak:5.2f} deg peak to peak, {error.rms:4.2f} deg rms")
