"""Blocks of the drive: the motor as a transfer function, and as an electrical and mechanical model.

The paper names its motor (Faulhaber 2642W024CR, 24 V) and gives no data for it. The defaults are
typical of ironless 24 V, 23 W motors behind a 14:1 gear; they are not data of that motor.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.model.block import Block, Input, Output, block, option, parameter, state


@block
class MotorTransferFunction(Block):
    r"""Motor with gear as a lag from voltage to speed, and an integrator to the angle.

    .. math:: \frac{Y(s)}{U(s)} = \frac{K}{s\,(\tau s + 1)}

    The defaults are taken from the class of motor, not from the paper, which prints none: 28 rad/s
    per volt at the rotor over a 14:1 gear, and a rotor's 5 ms raised for gear, pulley and tendon.
    """

    source = "Paper, section 5.1 and Fig. 9 (motor transfer function); numbers typical of the class"
    symbol = "K/s(τs+1)"
    symbol_with_values = "{K}/(s({tau:s}+1))"

    K: float = parameter(default=2.0, about="speed per volt at the output shaft", unit="rad/(s*V)", above=0.0)
    tau: float = parameter(default=0.02, about="time constant of the speed", unit="s", above=0.0)

    u = Input("voltage at the motor", unit="V")
    y = Output("angle of the output shaft", unit="rad")
    v = Output("speed of the output shaft", unit="rad/s")
    angle: float = state(default=0.0, about="angle of the output shaft", unit="rad")
    speed: float = state(default=0.0, about="speed of the output shaft", unit="rad/s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(angle=x.speed, speed=(self.K * u.u - x.speed) / self.tau)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.angle, v=x.speed)


@block
class DCMotor(Block):
    r"""Direct-current motor with winding, rotor, gear, dry friction and brush drop.

    .. math::

        L \frac{di}{dt} &= u - R i - k_t \omega - U_b \tanh(i / i_0) \\
        J \frac{d\omega}{dt} &= k_t i - b \omega - M_c \tanh(\omega / \omega_0) - M_{load} / N \\
        \dot y &= v = \omega / N

    :math:`\omega` is the rotor's speed and N the ``gear``; one constant :math:`k_t` serves torque and back-EMF, as
    conservation of energy requires. The dry friction :math:`M_c` (``coulomb``) changes sign over the speed
    :math:`\omega_0` (``smoothing``), and the brushes lose :math:`U_b` (``voltage_drop``), which builds up over the
    current :math:`i_0` (``drop_current``). With ``load=True`` a port takes the torque that the output shaft has to
    overcome. The numbers are typical of the class of motor.

    The winding's time constant L/R of some 0.1 ms is far below a usual step. At 1 ms use an implicit method
    (``method="sdirk2"``): angle and speed are then accurate, and the peak of the current after a step is not. An
    explicit method needs a step below some 0.2 ms, or a choke in the line: with L = 5 mH rk4 is stable at 1 ms. In a
    file without L, L is 5 mH, which keeps the meaning of earlier files.
    """

    source = "Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems, section 2.3"
    symbol = "DC motor"

    R: float = parameter(default=5.8, about="resistance of the winding", unit="ohm", above=0.0)
    L: float = parameter(
        default=0.00055, about="inductance of the winding, and of a choke", unit="H", above=0.0, omitted=0.005
    )
    kt: float = parameter(default=0.035, about="torque per current, and back-EMF per speed", unit="N*m/A", above=0.0)
    J: float = parameter(default=1.1e-6, about="inertia at the rotor, load included", unit="kg*m^2", above=0.0)
    b: float = parameter(default=2e-7, about="viscous friction at the rotor", unit="N*m*s/rad", at_least=0.0)
    gear: float = parameter(default=14.0, about="turns of the rotor per turn of the output shaft", above=0.0)
    coulomb: float = parameter(default=1e-3, about="dry friction at the rotor", unit="N*m", at_least=0.0)
    smoothing: float = parameter(default=2.0, about="rotor speed over which that changes sign", unit="rad/s", above=0.0)
    voltage_drop: float = parameter(default=0.3, about="voltage lost at the brushes", unit="V", at_least=0.0)
    drop_current: float = parameter(default=0.1, about="current over which that voltage builds up", unit="A", above=0.0)
    load: bool = option(default=False, about="whether there is a port for the load's torque")

    u = Input("voltage at the motor", unit="V")
    y = Output("angle of the output shaft", unit="rad")
    v = Output("speed of the output shaft", unit="rad/s")
    i = Output("current", unit="A")
    current: float = state(default=0.0, about="current", unit="A")
    speed: float = state(default=0.0, about="speed of the rotor", unit="rad/s")
    angle: float = state(default=0.0, about="angle of the output shaft", unit="rad")

    @property
    def inports(self) -> dict[str, Input]:
        load = {"load": Input("torque the output shaft has to overcome", unit="N*m")} if self.load else {}
        return {**super().inports, **load}

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        brushes = self.voltage_drop * ca.tanh(x.current / self.drop_current)
        dry = self.coulomb * ca.tanh(x.speed / self.smoothing)
        load = u.load / self.gear if self.load else 0.0
        return dict(
            current=(u.u - self.R * x.current - self.kt * x.speed - brushes) / self.L,
            speed=(self.kt * x.current - self.b * x.speed - dry - load) / self.J,
            angle=x.speed / self.gear,
        )

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=x.angle, v=x.speed / self.gear, i=x.current)
