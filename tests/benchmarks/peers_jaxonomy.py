"""Fig 9(b) in Jaxonomy, with its RK4 at a fixed step."""

from __future__ import annotations

import logging
from collections.abc import Callable

import jax
import jax.numpy as jnp
import jaxonomy
import numpy as np
from jaxonomy.library import PID, Adder, Integrator, Saturate, Sine, TransferFunction
from peers_common import Formulas

TOLERANCE = 1e-8
METHOD = "RK4, fixed step"
COMPILES = True


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The diagram, built; each call runs it (repeated calls share one compiled kernel)."""
    logging.getLogger("jaxonomy").setLevel(logging.ERROR)
    jax.config.update("jax_enable_x64", True)
    f, n = Formulas(numbers), numbers

    def slope(v):
        return f.mean + f.half * jnp.tanh(v)

    def zeta_rate(v, zeta):
        return n["A"] * v - n["theta"] * jnp.abs(v) * zeta + n["delta"] * jnp.abs(v)

    class Hysteresis(jaxonomy.LeafSystem):
        """Inputs: an angle, its rate; output ``make(angle, rate, zeta)``."""

        def __init__(self, make: Callable, name: str) -> None:
            super().__init__(name=name)
            self.declare_input_port()
            self.declare_input_port()
            self.declare_continuous_state(
                default_value=jnp.array(0.0), ode=lambda t, s, *u, **p: zeta_rate(u[1], s.continuous_state)
            )
            self.declare_output_port(
                lambda t, s, *u, **p: make(u[0], u[1], s.continuous_state),
                prerequisites_of_calc=[p.ticket for p in self.input_ports],
                requires_inputs=True,
            )

    b = jaxonomy.DiagramBuilder()
    x_ref = b.add(Sine(amplitude=n["amplitude"], frequency=f.w, name="x_ref"))
    v_ref = b.add(Sine(amplitude=n["amplitude"] * f.w, frequency=f.w, phase=np.pi / 2, name="v_ref"))
    compensator = b.add(Hysteresis(lambda x, v, z: (x - z) / slope(v), "compensator"))
    error = b.add(Adder(2, operators="+-", name="error"))
    controller = b.add(PID(n["kp"], n["ki"], n["kd"], 1 / n["tau"], name="controller"))
    drive = b.add(Saturate(upper_limit=n["high"], lower_limit=n["low"], name="drive"))
    motor = b.add(TransferFunction([n["K"]], [n["motor_tau"], 1.0], name="motor"))
    angle = b.add(Integrator(0.0, name="angle"))
    plant = b.add(Hysteresis(lambda x, v, z: slope(v) * x + z, "plant"))
    tracking = b.add(Adder(2, operators="+-", name="tracking"))
    for source, sink, port in [
        (x_ref, compensator, 0),
        (v_ref, compensator, 1),
        (compensator, error, 0),
        (angle, error, 1),
        (error, controller, 0),
        (controller, drive, 0),
        (drive, motor, 0),
        (motor, angle, 0),
        (angle, plant, 0),
        (motor, plant, 1),
        (x_ref, tracking, 0),
        (plant, tracking, 1),
    ]:
        b.connect(source.output_ports[0], sink.input_ports[port])
    diagram = b.build()
    context = diagram.create_context()
    steps = round(stop / step)
    options = jaxonomy.SimulatorOptions(
        math_backend="jax",
        ode_solver_method="rk4",
        max_minor_step_size=step,
        max_major_step_length=stop,
        buffer_length=2 * steps + 10,
        return_context=False,
    )

    def run() -> np.ndarray:
        result = jaxonomy.simulate(
            diagram, context, (0.0, stop), options=options, recorded_signals={"e": tracking.output_ports[0]}
        )
        new = np.append(True, np.diff(np.asarray(result.time)) > step / 2)  # start and end are recorded twice
        return np.asarray(result.outputs["e"])[new]

    return run
