"""What if the effect is in no catalogue?  A block and a description of it make a candidate of the diagnosis.

Here a tool loses stroke as work warms it, and recovers at rest; that is hidden in a recording of a gear with play.
Registered, it competes with the whole catalogue, whose nearest effect would explain a part; it is named, with its
parameters.
"""

import numpy as np

import tsmblocks as tsm
from tsmblocks.effects import Effect, Trials, registered


@tsm.block
class Warming(tsm.Block):
    r"""A signal that shrinks as motion warms what carries it, and recovers with time.

    .. math:: T \dot h = u^2 - h, \qquad y = u\,(1 - s h)
    """

    source = "First-order heating, as of any resistor or tendon"
    symbol = "warm"

    softening: float = tsm.parameter(default=0.0, about="loss per heat", at_least=0.0)
    time: float = tsm.parameter(default=5.0, about="time of warming and cooling", unit="s", above=0.0)

    u = tsm.Input("motion", unit="?u")
    y = tsm.Output("motion that remains", unit="?u")
    heat: float = tsm.state(default=0.0, about="heat, as the mean square of the motion")

    def derivatives(self, t, x, u):
        return dict(heat=(u.u**2 - x.heat) / self.time)

    def outputs(self, t, x, u):
        return dict(y=u.u * (1 - self.softening * x.heat))


def initial_values(scales):
    """A loss of some percent, with time constants that the recording can resolve."""
    times = [share * scales.shortest for share in (0.02, 0.1, 0.3)]
    return Trials(
        {"softening": 0.05 / scales.wire.rms**2},
        tuple({"time": time} for time in times),
        bounds={"time": (10 * scales.step, scales.shortest)},
    )


warming = Effect(
    name="warming",
    family="heat",
    words="stroke lost to warmth",
    place="output",  # on the wires of measured outputs
    block=Warming(),
    null={"softening": 0.0},  # with this it changes nothing
    free=("softening", "time"),
    trials=initial_values,
)

NOISE = 0.003  # rad
t = np.arange(0.0, 60.0, 0.02)
work = 0.65 + 0.35 * np.tanh(4 * np.sin(0.3 * t))  # alternately hard and light
x_in = work * (0.7 * np.sin(2.1 * t) + 0.2 * np.sin(5.3 * t))
model = tsm.load("tendon_sheath_play")
tool = model.insert("warm", Warming(softening=0.25, time=8.0), after="play")
x_out = tsm.simulate(tool, inputs={"x_in": (t, x_in)}, stop=t[-1], step=0.02, hold="cubic")["x_out"]
x_out = x_out + np.random.default_rng(1).normal(0.0, NOISE, t.size)
record = tsm.Record("tool", t, {"x_in": x_in, "x_out": x_out}, {"x_in": "rad", "x_out": "rad"})

with registered(warming):
    found = tsm.diagnose(model, record, noise_floor=NOISE)

(gap,) = found.worst.gaps
before, after, floor = np.rad2deg([gap.held_out[0], gap.held_out[-1], gap.noise_floor])
print(f"held-out rms {before:.3f} -> {after:.3f} deg, noise {floor:.3f}")
print("share of the variance above the noise floor that is removed:")
for one in [one for one in found.worst.ranking if one.round == 1][:4]:
    print(f"  {one.name + ' ' + one.variant:24} {100 * one.share:4.0f} %" + "  <- named" * one.named)
(effect,) = found.effects
for name, hidden in {"softening": 0.25, "time": 8.0}.items():
    estimate = effect.parameters[name]
    print(
        f"{name:9} {estimate.value:.3f} ± {(estimate.high - estimate.low) / 2:.3f} {estimate.unit:2} hidden: {hidden}"
    )
