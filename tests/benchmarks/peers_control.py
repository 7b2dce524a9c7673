"""Fig 9(b) in python-control, its solver replaced by RK4 at a fixed step (it has none of its own)."""

from __future__ import annotations

from collections.abc import Callable

import control as ct
import numpy as np
from peers_common import Formulas, fixed_step_rk4

TOLERANCE = 1e-5  # inputs are samples, linear in between
METHOD = "RK4 given to solve_ivp"


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The interconnected system; each call simulates it."""
    f, n = Formulas(numbers), numbers
    observer = ct.nlsys(
        lambda t, x, u, p: [f.zeta_rate(u[0], x[0])],
        lambda t, x, u, p: x,
        states=1,
        inputs="v_ref",
        outputs="zeta",
        name="observer",
    )
    compensator = ct.nlsys(
        None,
        lambda t, x, u, p: [(u[0] - u[1]) / f.slope(u[2])],
        inputs=["x_ref", "zeta", "v_ref"],
        outputs="x_ff",
        name="compensator",
    )
    error = ct.summing_junction(["x_ff", "-x_in"], "e", name="error")
    tracking = ct.summing_junction(["x_ref", "-x_out"], "miss", name="tracking")
    controller = ct.ss(ct.tf(*f.pid_polynomials()), inputs="e", outputs="wanted", name="controller")
    drive = ct.nlsys(
        None, lambda t, x, u, p: np.clip(u, n["low"], n["high"]), inputs="wanted", outputs="u", name="drive"
    )
    motor = ct.ss(ct.tf([n["K"]], [n["motor_tau"], 1]), inputs="u", outputs="v", name="motor")
    angle = ct.ss(ct.tf([1], [1, 0]), inputs="v", outputs="x_in", name="angle")
    plant = ct.nlsys(
        lambda t, z, u, p: [f.zeta_rate(u[1], z[0])],
        lambda t, z, u, p: [f.slope(u[1]) * u[0] + z[0]],
        states=1,
        inputs=["x_in", "v"],
        outputs="x_out",
        name="plant",
    )
    parts = [observer, compensator, error, controller, drive, motor, angle, plant, tracking]
    system = ct.interconnect(parts, inputs=["x_ref", "v_ref"], outputs=["miss"])
    t = step * np.arange(round(stop / step) + 1)
    inputs = [n["amplitude"] * np.sin(f.w * t), n["amplitude"] * f.w * np.cos(f.w * t)]
    solver = fixed_step_rk4(step)

    def run() -> np.ndarray:
        return np.asarray(ct.input_output_response(system, t, inputs, solve_ivp_method=solver).outputs)

    return run
