"""Fig 9(b) in PathSim, with its RK4 at a fixed step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pathsim import Connection, Simulation
from pathsim.blocks import ODE, PID, PT1, Adder, Clip, Function, Integrator, Scope, SinusoidalSource
from pathsim.solvers import RK4
from peers_common import Formulas

TOLERANCE = 1e-8
METHOD = "RK4, fixed step"


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The diagram, wired; each call runs it from the start."""
    f, n = Formulas(numbers), numbers
    x_ref = SinusoidalSource(n["frequency"], n["amplitude"])
    v_ref = SinusoidalSource(n["frequency"], n["amplitude"] * f.w, np.pi / 2)
    observer = ODE(lambda z, v, t: f.zeta_rate(v[0], z), 0.0)
    plant = ODE(lambda z, v, t: f.zeta_rate(v[0], z), 0.0)
    compensator = Function(lambda x, z, v: (x - z) / f.slope(v))
    output = Function(lambda x, z, v: f.slope(v) * x + z)
    error, tracking = Adder("+-"), Adder("+-")
    controller = PID(n["kp"], n["ki"], n["kd"], f_max=1 / n["tau"])
    drive, motor, angle, scope = Clip(n["low"], n["high"]), PT1(n["K"], n["motor_tau"]), Integrator(), Scope()
    blocks = [
        x_ref,
        v_ref,
        observer,
        compensator,
        error,
        controller,
        drive,
        motor,
        angle,
        plant,
        output,
        tracking,
        scope,
    ]
    wires = [
        Connection(v_ref, observer, compensator[2]),
        Connection(x_ref, compensator[0], tracking[0]),
        Connection(observer, compensator[1]),
        Connection(compensator, error[0]),
        Connection(error, controller),
        Connection(controller, drive),
        Connection(drive, motor),
        Connection(motor, angle, plant, output[2]),
        Connection(angle, error[1], output[0]),
        Connection(plant, output[1]),
        Connection(output, tracking[1]),
        Connection(tracking, scope),
    ]
    simulation = Simulation(blocks, wires, dt=step, Solver=RK4, log=False)

    def run() -> np.ndarray:
        simulation.reset()
        simulation.run(stop, adaptive=False)
        return np.asarray(scope.read()[1][0])

    return run
