"""How is an unstable plant fitted?  By multiple shooting: in segments that must join.

An inverted pendulum was recorded while a controller balanced it; the plant alone is identified. With initial
parameters that are far off, a simulation of the whole record diverges, and no search converges from there. Twenty
segments, each with its own initial state, stay near the measurement until they join.
"""

import tsmblocks as tsm
from tsmblocks.blocks import PID, Gain, Integrator, MultiSine, SensorNoise, Sum, ViscousFriction

pendulum = tsm.Diagram(
    title="inverted pendulum near the top",
    blocks={
        "motor": Gain(gain=4.0),
        "gravity": Gain(gain=4.0),
        "friction": ViscousFriction(coefficient=0.5),
        "torque": Sum(signs="++-"),
        "rate": Integrator(),
        "angle": Integrator(integral=0.1),
    },
    wires=[
        "motor -> torque.plus1",
        "gravity -> torque.plus2",
        "friction -> torque.minus",
        "torque -> rate -> angle -> gravity",
        "rate -> friction",
    ],
    inputs={"u": "motor.u"},
    outputs={"x": "angle"},
)
balanced = tsm.Diagram(
    title="balanced",
    blocks={
        "sway": MultiSine(amplitudes=[0.2, 0.1], frequencies=[0.3, 0.8], phases=[0.0, 0.0]),
        "error": Sum(),
        "pid": PID(kp=3.0, ki=0.0, kd=1.5, tau=0.05),
        "pendulum": pendulum,
        "noise": SensorNoise(std=0.002),
    },
    wires=["sway -> error.plus", "error -> pid -> pendulum -> error.minus", "pendulum -> noise"],
    outputs={"u": "pid", "x": "noise"},
)
run = tsm.simulate(balanced, stop=6.0, step=0.01)
record = run.record("u", "x")

truth = {"motor.gain": 4.0, "gravity.gain": 4.0, "friction.coefficient": 0.5}
methods = {
    "whole record, one start": {"starts": 1},
    "whole record, genetic": {"method": "ga"},
    "twenty segments": {"method": "ipopt", "segments": 20},
}
for title, options in methods.items():
    fit = tsm.fit(
        pendulum,
        record,
        free=[*truth, "rate.integral", "angle.integral"],
        start={"motor.gain": 1.5, "gravity.gain": 9.0, "friction.coefficient": 2.0, "angle.integral": 0.0},
        **options,
    )
    print(f"{title:26} residual {fit.rms / 0.002:3.0f} times the noise")
print(f"{'':26}  true   fit   95 % interval")
for name, true in truth.items():
    estimate = fit[name]
    print(f"{name:26} {true:5.2f} {estimate.value:6.3f}  {estimate.low:.3f} to {estimate.high:.3f}")
