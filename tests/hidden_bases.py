"""Cases of the generator as a user of the package meets them: a diagram to start from, recordings, what is known."""

from __future__ import annotations

import tsmblocks as tsm
from tsmblocks.blocks import PID, Bias, BoucWen, CoulombFriction, Derivative, MotorTransferFunction, Saturation, Sum

SLIDING = 0.02
"""Speed over which the dry friction of a motor's base changes sign [rad/s]."""
SHEATH = {"tsm": BoucWen(), "offset": Bias(bias=0.0)}
LOOP = {
    "error": Sum(signs="+-"),
    "controller": PID(kp=60.0, ki=0.0, kd=1.0, tau=0.002),
    "drive": Saturation(low=-24.0, high=24.0),
}
"""The position controller, whose numbers are known."""


def base_of(case):
    """The diagram that a case's `base` names."""
    name, _, dry = case.base.partition("_coulomb")
    if name == "motor_linear":
        return _motor(bool(dry or case.base.endswith("_coulomb")))
    if name == "motor_closed":
        return _looped(case.base.endswith("_coulomb"), False)
    if name == "chain":
        return _looped(case.base.endswith("_coulomb"), True)
    return tsm.load(case.base)


def _dry(dry):
    """Blocks and wires of the motor behind its voltage: (blocks, wires, port of the voltage)."""
    blocks = {"motor": MotorTransferFunction()}
    if not dry:
        return blocks, [], "motor.u"
    blocks |= {"push": Sum(signs="+-"), "rate": Derivative(), "friction": CoulombFriction(level=0.3, smoothing=SLIDING)}
    return blocks, ["push -> motor", "motor.y -> rate -> friction -> push.minus"], "push.plus"


def _motor(dry):
    blocks, wires, into = _dry(dry)
    return tsm.Diagram(
        title="motor", blocks=blocks, wires=wires, inputs={"u": tsm.Inlet(into, unit="V")}, outputs={"x_in": "motor.y"}
    )


def _looped(dry, sheath):
    blocks, wires, into = _dry(dry)
    wires = ["error -> controller -> drive", f"drive -> {into}", "motor.y -> error.minus", *wires]
    outputs = {"u": "drive", "x_in": "motor.y"}
    if sheath:
        blocks, wires, outputs = (
            blocks | SHEATH,
            [*wires, "motor.y -> tsm.x", "tsm -> offset"],
            outputs | {"x_out": "offset"},
        )
    return tsm.Diagram(
        title="chain" if sheath else "motor in its position loop",
        blocks=LOOP | blocks,
        wires=wires,
        inputs={"r": tsm.Inlet("error.plus", unit="rad")},
        outputs=outputs,
    )


def recordings(case, signals=None):
    """The experiments, with units; `signals` leaves out the others."""
    made = {}
    for name, e in case.experiments.items():
        kept = {k: v for k, v in e.items() if k != "t" and (signals is None or k in signals)}
        made[name] = tsm.Record(name, e["t"], kept, {k: case.units[k] for k in kept})
    return made


def floor_of(case):
    """The noise of each output as one who knows his sensors would give it, with its unit."""
    each = case.floor if isinstance(case.floor, dict) else {"x_out": case.floor}
    return {k: f"{float(v)!r} {case.units[k]}" for k, v in each.items()}


def free_of(case):
    """What may be fitted: of a chain or a loop, all but the controller; None for everything."""
    if case.base.startswith("motor"):
        return ["motor.K", "motor.tau"] + ["friction.level"] * case.base.endswith("_coulomb")
    if case.base.startswith("chain"):
        return ["motor.K", "motor.tau", "tsm.*", "offset.*"] + ["friction.level"] * case.base.endswith("_coulomb")
    return None


def diagnosed(case, *, noise_floor="given", **more):
    """`tsm.diagnose` of a case as its user would ask; `noise_floor=None` has the floor looked for."""
    floor = floor_of(case) if noise_floor == "given" else noise_floor
    return tsm.diagnose(base_of(case), recordings(case), free=free_of(case), noise_floor=floor, **more)
