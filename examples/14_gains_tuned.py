"""Which gains should the PID of the tip have? Tuned on the paper's three signals, tested on a thousand plants.

A limit on the voltage alone is not enough: at each reversal the loop then hunts at 25 Hz, which makes the error small
and the drive hot, and no linear margin indicates it. So the total variation of the voltage is limited too.

The plants are those that agree with a noisy recording: drawn from the covariance of a fit. The compensator keeps its
parameters.
"""

import textwrap

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import MultiSine
from tsmblocks.studies import monte_carlo, table

HALF, WHOLE = np.deg2rad(28.0), np.deg2rad(55.0)
SIGNALS = {
    "55 deg at 0.2 Hz": ((WHOLE,), (0.2,)),
    "0.2 and 0.5 Hz": ((HALF, HALF), (0.2, 0.5)),
    "0.25 and 0.43 Hz": ((HALF, HALF), (0.25, 0.25 * 3**0.5)),
}
ERROR = "peak_to_peak(x_ref - x_out, after=10)"
VARIATION = "variation(u, after=10)"
METRICS = {"error [deg]": ERROR, "variation of u": VARIATION}

fig16 = tsm.load("fig16_feedforward_feedback")
loops = {
    name: fig16.replace("ref", MultiSine(amplitudes=sizes, frequencies=rates, phases=(0.0,) * len(sizes)))
    for name, (sizes, rates) in SIGNALS.items()
}


def tuned(*limits):
    """The gains with the smallest error for the worst of the signals."""
    free = {"pid.kp": (0.1, 5.0), "pid.ki": (0.0, 20.0), "pid.kd": (0.0, 0.1)}
    return tsm.tune(loops, free, {"error [deg]": ERROR}, subject_to=limits, stop=20.0, step=2e-3, starts=2)


aggressive = tuned("largest(u) <= 12")
before, after = aggressive.worst
print(f"With a limit of 12 V, {before:.2f} -> {after:.2f} deg, but")
print(textwrap.fill(aggressive.hunting[0], 80))
calm = tuned("largest(u) <= 12", f"{VARIATION} <= 50")
print(f"\nWith a variation of 50 V in 10 s at most as well:\n{calm}\n")

# Plants that agree with a recording of 20 s with noise of 0.3 deg.
rng = np.random.default_rng(0)
t = np.arange(0.0, 20.0, 0.01)
x_in = sum(HALF * np.sin(2 * np.pi * f * t) for f in (0.2, 0.45))
numbers = {f"tsm.{name}": fig16.parameters[name] for name in ("alpha1", "alpha2", "A", "theta", "delta")}
plant = tsm.load("tendon_sheath_asymmetric").with_parameters(numbers)
x_out = tsm.simulate(plant, inputs={"x_in": (t, x_in)}, stop=t[-1], step=0.01)["x_out"]
x_out = x_out + rng.normal(0.0, np.deg2rad(0.3), t.size)
record = tsm.Record("sheath", t, {"x_in": x_in, "x_out": x_out}, {"x_in": "rad", "x_out": "rad"})
fit = tsm.fit(plant, record)
draws = monte_carlo(fit, runs=1000, seed=1)
plants = table({name: draws[name] for name in draws.names if name.startswith("tsm.")})

print(f"{'over 1000 plants,':16} {'error [deg]':>27}  {'variation of u [V]':>29}")
print(f"{'median and 95 %':16} {'untuned':>13} {'tuned':>13}  {'untuned':>15} {'tuned':>13}")
for name, loop in loops.items():
    cells = []
    for metric in ("error", "variation of u"):
        for gains in ({}, calm.values):
            found = tsm.study(loop.with_parameters(gains), plants, METRICS, stop=20.0, step=2e-3)
            spread = found.quantiles(metric)
            cells.append(f"{spread['median']:.2f} {spread['95 %']:.2f}")
    print(f"{name:17} {cells[0]:>12} {cells[1]:>13}  {cells[2]:>15} {cells[3]:>13}")
