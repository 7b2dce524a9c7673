"""Which gains should the tip's PID have? Tuned on the paper's three signals, and tried on a thousand plants.

The plants are those that a noisy recording leaves possible: drawn from the covariance of a fit. The compensator keeps
the numbers it was built with.
"""

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

fig16 = tsm.load("fig16_feedforward_feedback")
loops = {
    name: fig16.replace("ref", MultiSine(amplitudes=sizes, frequencies=rates, phases=(0.0,) * len(sizes)))
    for name, (sizes, rates) in SIGNALS.items()
}
tuned = tsm.tune(
    loops,
    {"pid.kp": (0.1, 5.0), "pid.ki": (0.0, 20.0), "pid.kd": (0.0, 0.1)},
    ERROR,
    subject_to=["largest(u) <= 12"],
    stop=20.0,
    step=2e-3,
    starts=2,
)
print("tuned: " + ", ".join(f"{name} {value:.3f}" for name, value in tuned.values.items()))
for name in loops:
    before, after = (np.rad2deg(side[name][ERROR]) for side in (tuned.before, tuned.after))
    print(f"{name:17} {before:5.2f} -> {after:5.2f} deg peak to peak")

# What a recording of 20 s with noise of 0.3 deg leaves possible.
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

print("over 1000 plants  paper's gains: median, 95 %   tuned: median, 95 %")
for name, loop in loops.items():
    cells = []
    for diagram in (loop, loop.with_parameters(tuned.values)):
        found = tsm.study(diagram, plants, {"error [deg]": ERROR}, stop=20.0, step=2e-3)
        spread = found.quantiles("error")
        cells += [spread["median"], spread["95 %"]]
    print(f"{name:17} {cells[0]:20.2f} {cells[1]:8.2f} {cells[2]:14.2f} {cells[3]:7.2f}")
