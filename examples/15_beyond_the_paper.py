"""How much better than the paper's compensator can a feedforward be, with no sensor at the tip?

Every row of the tables drives the same motor, in its position loop and with a limit of 24 V, and assumes set 1; the
plant may be another. The last two rows are planned on the model for a motor of at most 3 rad/s: with 0.8 s of
preview, sample by sample, and with the whole future known, which gives the smallest error possible. In brackets: the
excess over that.
"""

import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import AsymmetricBoucWen, GeneralizedBoucWen, Integrator, Recorded

STOP, AFTER, STEP, PREVIEW = 7.0, 2.0, 0.01, 0.8
SET_1 = dict(alpha1=0.8972, alpha2=0.9487, A=-0.8745, theta=5.034, delta=0.14522)
BENT = {"tsm.alpha1": 0.9477, "tsm.alpha2": 0.9333, "tsm.A": -0.8130, "tsm.theta": 4.3820, "tsm.delta": -0.0570}
HALF, WHOLE = np.deg2rad(28.0), np.deg2rad(55.0)
ERROR = "x_ref - x_out"

t = STEP * np.arange(round((STOP + PREVIEW) / STEP) + 1)
counts = np.where(t < AFTER - 0.1, 0.2, 1.0)  # the transient has less weight


def sines(*parts):
    return sum(size * np.sin(2 * np.pi * f * t) for size, f in parts)


def hand(seed=1):
    """Motion of a surgeon: from place to place with minimum jerk, and rests in between."""
    rng, angle, now, there = np.random.default_rng(seed), np.zeros_like(t), 0.0, 0.0
    while now < t[-1]:
        goal, takes = rng.uniform(-WHOLE, WHOLE), rng.uniform(0.8, 2.0)
        s = np.clip((t - now) / takes, 0.0, 1.0)
        angle += (goal - there) * s**3 * (10 - 15 * s + 6 * s**2)
        now, there = now + takes + rng.exponential(0.4), goal
    return angle


SIGNALS = {
    "55 at 0.2": sines((WHOLE, 0.2)),
    "0.2 and 0.5": sines((HALF, 0.2), (HALF, 0.5)),
    "0.25 and 0.43": sines((HALF, 0.25), (HALF, 0.25 * 3**0.5)),
    "a hand": hand(),
}
PLANTS = {
    "the plant is the model": lambda loop: loop,
    "the plant is the generalised model": lambda loop: loop.replace("tsm", GeneralizedBoucWen()),
    "the sheath has been bent (set 2)": lambda loop: loop.with_parameters(BENT),
}
LOOPS = {
    "no compensation": tsm.load("fig09a_without_feedforward"),
    "(11), as the paper": tsm.load("fig09b_feedforward"),
    "observer on the motor": tsm.load("observer_on_motor"),
    "loop around the model": tsm.load("loop_around_model"),
}
MOTOR = {f"controller.{k}": LOOPS["observer on the motor"].parameters[f"controller.{k}"] for k in ("kp", "ki", "kd")}
sheath = tsm.load("tendon_sheath_asymmetric").with_parameters({f"tsm.{k}": v for k, v in SET_1.items()})
driven_by_speed = tsm.Diagram(
    title="the sheath, driven by a speed",
    blocks={"turn": Integrator(), "tsm": AsymmetricBoucWen(**SET_1)},
    wires=["turn -> tsm"],
    inputs={"v": tsm.Inlet("turn", unit="rad/s")},
    outputs={"x_in": "turn", "x_out": "tsm"},
)


def driven(loop, times, samples, hold):
    """A loop with samples as its reference, and the same motor loop in all."""
    source = Recorded(times=tuple(times), values=tuple(samples), hold=hold, unit="rad")
    return loop.replace("ref", source).with_parameters(MOTOR)


print("the smallest peak-to-peak error, 55 deg at 0.2 Hz, periodic, ideal motor")
period = np.linspace(0.0, 5.0, 501)
sine = WHOLE * np.sin(0.4 * np.pi * period)
for fastest in (1.5, 3.0, 6.0):
    found = tsm.optimal_control(
        sheath,
        {"x_in": (None, None)},
        ERROR,
        rates={"x_in": (-fastest, fastest)},
        references={"x_ref": (period, sine)},
        guess={"x_in": 1.25 * sine},
        step=STEP,
        periodic=True,
    )
    print(f"{fastest:5.1f} rad/s: {np.rad2deg(found.peak_to_peak):.2f} deg")

tables = {}
for signal, x_ref in SIGNALS.items():
    problem = dict(error=f"counts * ({ERROR})", references={"x_ref": (t, x_ref), "counts": (t, counts)}, stop=STOP)
    receding = tsm.receding_horizon(
        driven_by_speed,
        {"v": (-3.0, 3.0)},
        rates={"v": (-120.0, 120.0)},
        smallest="peak",
        preview=round(PREVIEW / (2 * STEP)),
        step=2 * STEP,
        **problem,
    )
    optimal = tsm.optimal_control(
        sheath,
        {"x_in": (None, None)},
        rates={"x_in": (-3.0, 3.0)},
        step=STEP,
        guess={"x_in": 1.25 * x_ref[: round(STOP / STEP) + 1]},
        **problem,
    )
    print(f"{signal}: {1e3 * np.median(receding.seconds):.0f} ms to plan each {2e3 * STEP:.0f} ms")
    for plant, changed in PLANTS.items():
        loops = {name: driven(changed(loop), t, x_ref, "cubic") for name, loop in LOOPS.items()}
        for name, run in (("receding horizon", receding.run), ("optimal", optimal.run)):
            loops[name] = driven(changed(LOOPS["no compensation"]), run.t, run["x_in"], "linear")
        for name, loop in loops.items():
            run = tsm.simulate(loop, stop=STOP, step=1e-3)
            error = np.rad2deg(np.interp(run.t, t, x_ref) - run["x_out"])[run.t >= AFTER]
            tables.setdefault(plant, {}).setdefault(name, []).append(np.ptp(error))

for plant, table in tables.items():
    print(f"\n{plant}\npeak to peak [deg]    " + "".join(f"{name:>14}" for name in SIGNALS))
    for name, errors in table.items():
        cells = [f"{e:.2f} ({e - best:+.2f})" for e, best in zip(errors, table["optimal"], strict=True)]
        print(f"{name:22}" + "".join(f"{cell:>14}" for cell in cells))
