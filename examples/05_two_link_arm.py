"""A rigid-body mechanism: how far from its reference does dry friction move a two-link arm?

The arm is one block, with its mass matrix inside; friction and control are blocks around it. Computed torque
compensates the masses, and none, a part or all of the friction. The energy balance is a check: the work of the motors
is kinetic and potential energy, and heat. A folder given as an argument receives the picture.
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import tsmblocks as tsm
from tsmblocks.blocks import CoulombFriction, Sine, Sum

M1, M2, L1, L2, G = 1.0, 0.5, 0.3, 0.25, 9.81  # masses at elbow and tip [kg], rods [m], gravity [m/s^2]
FRICTION, SMOOTHING = 0.3, 0.02  # dry friction of a joint [N m], and the speed over which it changes sign [rad/s]


def dynamics(q1, q2, v1, v2):
    """Mass matrix [m11, m12, m22], and the torques that hold the arm at constant speed."""
    a, b = M2 * L1 * L2 * ca.cos(q2), M2 * L1 * L2 * ca.sin(q2)
    tip = M2 * G * L2 * ca.cos(q1 + q2)
    mass = ((M1 + M2) * L1**2 + M2 * L2**2 + 2 * a, M2 * L2**2 + a, M2 * L2**2)
    return mass, (tip + (M1 + M2) * G * L1 * ca.cos(q1) - b * (2 * v1 + v2) * v2, tip + b * v1**2)


@tsm.block
class TwoLinkArm(tsm.Block):
    r"""Two rods in a vertical plane, a mass at the end of each; angles from the horizontal, and from the first rod.

    .. math:: M(q)\,\ddot q + n(q, \dot q) = \tau
    """

    source = "Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, section 7.4"
    symbol = "2 links"

    u1 = tsm.Input("torque on joint 1", unit="N*m")
    u2 = tsm.Input("torque on joint 2", unit="N*m")
    q1 = tsm.Output("angle of joint 1", unit="rad")
    q2 = tsm.Output("angle of joint 2", unit="rad")
    v1 = tsm.Output("speed of joint 1", unit="rad/s")
    v2 = tsm.Output("speed of joint 2", unit="rad/s")
    energy = tsm.Output("kinetic and potential energy", unit="J")
    angle1: float = tsm.state(default=-1.2, about="angle of joint 1", unit="rad")
    angle2: float = tsm.state(default=0.9, about="angle of joint 2", unit="rad")
    speed1: float = tsm.state(default=0.0, about="speed of joint 1", unit="rad/s")
    speed2: float = tsm.state(default=0.0, about="speed of joint 2", unit="rad/s")

    def derivatives(self, t, x, u):
        (m11, m12, m22), (n1, n2) = dynamics(*x)
        f1, f2 = u.u1 - n1, u.u2 - n2
        det = m11 * m22 - m12 * m12
        return dict(
            angle1=x.speed1, angle2=x.speed2, speed1=(m22 * f1 - m12 * f2) / det, speed2=(m11 * f2 - m12 * f1) / det
        )

    def outputs(self, t, x, u):
        (m11, m12, m22), _ = dynamics(*x)
        kinetic = (m11 * x.speed1**2 + 2 * m12 * x.speed1 * x.speed2 + m22 * x.speed2**2) / 2
        height = (M1 + M2) * L1 * ca.sin(x.angle1) + M2 * L2 * ca.sin(x.angle1 + x.angle2)
        return dict(q1=x.angle1, q2=x.angle2, v1=x.speed1, v2=x.speed2, energy=kinetic + G * height)


@tsm.block
class ComputedTorque(tsm.Block):
    r"""Torques with which the errors of an arm without friction decay like those of a damped spring.

    .. math:: \tau = M(q)\,(\ddot r + k_d (\dot r - \dot q) + k_p (r - q)) + n(q, \dot q) + F \tanh(\dot r / v_0)
    """

    source = "Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, section 8.3"
    symbol = "M(q)a + n"

    kp: float = tsm.parameter(default=100.0, about="stiffness per inertia", unit="1/s^2", at_least=0.0)
    kd: float = tsm.parameter(default=20.0, about="damping per inertia", unit="1/s", at_least=0.0)
    level: float = tsm.parameter(default=0.0, about="dry friction that it compensates", unit="N*m", at_least=0.0)

    r1 = tsm.Input("reference angle of joint 1", unit="rad")
    r2 = tsm.Input("reference angle of joint 2", unit="rad")
    rv1 = tsm.Input("its rate", unit="rad/s", rate_of="r1")
    rv2 = tsm.Input("its rate", unit="rad/s", rate_of="r2")
    ra1 = tsm.Input("its acceleration", unit="rad/s^2", rate_of="rv1")
    ra2 = tsm.Input("its acceleration", unit="rad/s^2", rate_of="rv2")
    q1 = tsm.Input("angle of joint 1", unit="rad")
    q2 = tsm.Input("angle of joint 2", unit="rad")
    v1 = tsm.Input("speed of joint 1", unit="rad/s")
    v2 = tsm.Input("speed of joint 2", unit="rad/s")
    u1 = tsm.Output("torque on joint 1", unit="N*m")
    u2 = tsm.Output("torque on joint 2", unit="N*m")

    def outputs(self, t, x, u):
        (m11, m12, m22), (n1, n2) = dynamics(u.q1, u.q2, u.v1, u.v2)
        a1 = u.ra1 + self.kd * (u.rv1 - u.v1) + self.kp * (u.r1 - u.q1)
        a2 = u.ra2 + self.kd * (u.rv2 - u.v2) + self.kp * (u.r2 - u.q2)
        dry1, dry2 = (self.level * ca.tanh(v / SMOOTHING) for v in (u.rv1, u.rv2))
        return dict(u1=m11 * a1 + m12 * a2 + n1 + dry1, u2=m12 * a1 + m22 * a2 + n2 + dry2)


arm = tsm.Diagram(
    title="two-link arm under computed torque",
    blocks={
        "ref1": Sine(offset=-1.2, amplitude=0.6, frequency=0.5, unit="rad"),
        "ref2": Sine(offset=0.9, amplitude=0.5, frequency=0.8, unit="rad"),
        "control": ComputedTorque(),
        "net1": Sum(),
        "net2": Sum(),
        "dry1": CoulombFriction(level=FRICTION, smoothing=SMOOTHING),
        "dry2": CoulombFriction(level=FRICTION, smoothing=SMOOTHING),
        "arm": TwoLinkArm(),
    },
    wires=[
        "ref1 -> control.r1",
        "ref2 -> control.r2",
        "control.u1 -> net1.plus",
        "net1 -> arm.u1",
        "control.u2 -> net2.plus",
        "net2 -> arm.u2",
        "arm.v1 -> dry1 -> net1.minus",
        "arm.v2 -> dry2 -> net2.minus",
        *(f"arm.{port} -> control.{port}" for port in ("q1", "q2", "v1", "v2")),
    ],
    outputs={"q1": "arm.q1", "q2": "arm.q2"},
)


METRICS = {
    "joint 1 [deg]": "rms(ref1.y - q1, after=1)",
    "joint 2 [deg]": "rms(ref2.y - q2, after=1)",
    "work": "integral(control.u1 * arm.v1 + control.u2 * arm.v2)",
    "heat": "integral(dry1.y * arm.v1 + dry2.y * arm.v2)",
    "gained": "final(arm.energy) - final(arm.energy, before=0)",
}
CASES = {  # friction in the joints, and what control compensates of it
    "no friction": (0.0, 0.0),
    "friction, none known": (FRICTION, 0.0),
    "friction, 2/3 known": (FRICTION, 2 / 3 * FRICTION),
    "friction, all known": (FRICTION, FRICTION),
}

print(f"{'':22} {'rms error [deg]':>15}   energy [J]")
print(f"{'':22} joint 1 joint 2      work    heat  gained  balance")
runs = {}
for name, (friction, known) in CASES.items():
    numbers = {"dry1.level": friction, "dry2.level": friction, "control.level": known}
    runs[name] = tsm.simulate(arm.with_parameters(numbers), stop=9.7, step=1e-3)
    one, two, work, heat, gained = tsm.measure(runs[name], METRICS).values()
    print(f"{name:22} {one:7.3f} {two:7.3f}   {work:7.3f} {heat:7.3f} {gained:7.3f} {work - heat - gained:8.0e}")

if len(sys.argv) > 1:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure

    looks = ("#bbbbbb", 4.0, "-"), ("#b84a06", 1.2, "-"), ("#0a5fd0", 1.2, "-"), ("#1b1b1b", 1.2, "--")
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for k, panel in enumerate(panels, 1):
        for (name, run), (colour, width, dashes) in zip(runs.items(), looks, strict=True):
            error = np.rad2deg(run[f"ref{k}.y"] - run[f"q{k}"])
            panel.plot(run.t, error, dashes, color=colour, lw=width, label=name)
        panel.set_ylabel(f"error of joint {k} [deg]")
        panel.margins(x=0)
        panel.grid(color="#dddddd", lw=0.5)
        panel.spines[["top", "right"]].set_visible(False)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
    panels[1].set_xlabel("t [s]")
    figure.savefig(folder / "two_link_arm.png", dpi=144)
