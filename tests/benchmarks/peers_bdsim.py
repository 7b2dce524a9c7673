"""Fig 9(b) in bdsim, its solver replaced by RK4 at a fixed step (it has none of its own)."""

from __future__ import annotations

from collections.abc import Callable

import bdsim
import numpy as np
from peers_common import Formulas, fixed_step_rk4

TOLERANCE = 1e-8
METHOD = "RK4 given to solve_ivp"


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The diagram, compiled; each call runs it."""
    f, n = Formulas(numbers), numbers
    simulator = bdsim.BDSim(graphics=False, sysargs=False, progress=False, quiet=True)
    bd = simulator.blockdiagram()
    clock, x_ref, v_ref = bd.TIME(), bd.FUNCTION(f.x_ref), bd.FUNCTION(f.v_ref)
    estimate_rate, estimate = bd.FUNCTION(f.zeta_rate, nin=2), bd.INTEGRATOR()
    zeta_rate, zeta = bd.FUNCTION(f.zeta_rate, nin=2), bd.INTEGRATOR()
    compensator = bd.FUNCTION(lambda x, z, v: (x - z) / f.slope(v), nin=3)
    output = bd.FUNCTION(lambda x, z, v: f.slope(v) * x + z, nin=3)
    error, tracking, drive = bd.SUM("+-"), bd.SUM("+-"), bd.CLIP(min=n["low"], max=n["high"])
    controller = bd.LTI_SISO(*f.pid_polynomials())
    motor, angle, end = bd.LTI_SISO([n["K"]], [n["motor_tau"], 1]), bd.INTEGRATOR(), bd.NULL(1)
    bd.connect(clock, x_ref, v_ref)
    bd.connect(v_ref, estimate_rate[0], compensator[2])
    bd.connect(estimate, estimate_rate[1], compensator[1])
    bd.connect(estimate_rate, estimate)
    bd.connect(x_ref, compensator[0], tracking[0])
    bd.connect(compensator, error[0])
    bd.connect(error, controller)
    bd.connect(controller, drive)
    bd.connect(drive, motor)
    bd.connect(motor, angle, zeta_rate[0], output[2])
    bd.connect(angle, error[1], output[0])
    bd.connect(zeta, zeta_rate[1], output[1])
    bd.connect(zeta_rate, zeta)
    bd.connect(output, tracking[1])
    bd.connect(tracking, end)
    bd.compile()
    solver = fixed_step_rk4(step)

    def run() -> np.ndarray:
        result = simulator.run(bd, T=stop, dt=step, solver_args={"method": solver}, max_step=step, watch=[tracking])
        return np.asarray(result.y0)

    return run
