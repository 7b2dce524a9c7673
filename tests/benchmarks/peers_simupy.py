"""Fig 9(b) in SimuPy, which has no fixed step: dopri5 with the step as its longest.

The tool stopped in 2022; two names that NumPy 2 dropped are put back for it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

vars(np).update({"Inf": np.inf, "float_": np.float64})

from peers_common import Formulas  # noqa: E402 - SimuPy reads the two names when it is imported
from simupy.block_diagram import BlockDiagram  # noqa: E402
from simupy.systems import DynamicalSystem, SystemFromCallable  # noqa: E402

TOLERANCE = 1e-5
METHOD = "dopri5, steps of at most 1 ms"


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The diagram, wired; each call runs it. Blocks with a state have no feedthrough, so two are split."""
    f, n = Formulas(numbers), numbers
    corner = 1 / n["tau"]

    def static(function: Callable, inputs: int) -> SystemFromCallable:
        return SystemFromCallable(lambda t, u: np.array([function(*u)]), inputs, 1)

    def dynamic(function: Callable, states: int) -> DynamicalSystem:
        return DynamicalSystem(
            lambda t, x, u: np.array(function(*x, *u)), lambda t, x: x, dim_state=states, dim_input=1, dim_output=states
        )

    reference = SystemFromCallable(lambda t: np.array([f.x_ref(t), f.v_ref(t)]), 0, 2)
    observer, plant = (dynamic(lambda z, v: [f.zeta_rate(v, z)], 1) for _ in range(2))
    memory = dynamic(lambda integral, smooth, e: [e, (e - smooth) * corner], 2)
    motor = dynamic(lambda angle, v, u: [v, (n["K"] * u - v) / n["motor_tau"]], 2)
    compensator = static(lambda x, z, v: (x - z) / f.slope(v), 3)
    error = static(lambda wanted, x: wanted - x, 2)
    controller = static(lambda e, i, s: n["kp"] * e + n["ki"] * i + n["kd"] * (e - s) * corner, 3)
    drive = static(lambda u: min(max(u, n["low"]), n["high"]), 1)
    output = static(lambda x, v, z: f.slope(v) * x + z, 3)
    tracking = static(lambda wanted, x: wanted - x, 2)
    # stateless blocks from last to first: SimuPy evaluates them in the reverse of this order, unsorted
    bd = BlockDiagram(
        tracking, output, drive, controller, error, compensator, reference, observer, memory, motor, plant
    )
    for source, sink, outputs, inputs in [
        (reference, observer, [1], [0]),
        (reference, compensator, [0], [0]),
        (observer, compensator, [0], [1]),
        (reference, compensator, [1], [2]),
        (compensator, error, [0], [0]),
        (motor, error, [0], [1]),
        (error, memory, [0], [0]),
        (error, controller, [0], [0]),
        (memory, controller, [0, 1], [1, 2]),
        (controller, drive, [0], [0]),
        (drive, motor, [0], [0]),
        (motor, plant, [1], [0]),
        (motor, output, [0, 1], [0, 1]),
        (plant, output, [0], [2]),
        (reference, tracking, [0], [0]),
        (output, tracking, [0], [1]),
    ]:
        bd.connect(source, sink, outputs=outputs, inputs=inputs)
    options = dict(name="dopri5", max_step=step, first_step=step, rtol=1e-6, atol=1e-12, nsteps=100_000)
    t = step * np.arange(round(stop / step) + 1)

    def run() -> np.ndarray:
        result = bd.simulate(stop, integrator_options=options)
        return np.interp(t, result.t, result.y[:, 0])  # the first block is the tracking error

    return run
