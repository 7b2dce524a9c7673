"""Fig 9(b) in Drake: C++ blocks, symbolic blocks for the hysteresis, RK3 (it has no RK4 at a fixed step)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from peers_common import Formulas
from pydrake.symbolic import Variable, tanh
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    Gain,
    LinearSystem,
    LogVectorOutput,
    Multiplexer,
    Saturation,
    Sine,
    SymbolicVectorSystem,
)

TOLERANCE = 1e-6
METHOD = "RK3, fixed step"


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """The diagram, built; each call runs it from a fresh context."""
    f, n = Formulas(numbers), numbers
    x, v, z = Variable("x"), Variable("v"), Variable("z")
    slope = f.mean + f.half * tanh(v)
    rate = n["A"] * v - n["theta"] * abs(v) * z + n["delta"] * abs(v)
    corner = 1 / n["tau"]
    b = DiagramBuilder()
    add = b.AddNamedSystem
    ref = add("ref", Sine(n["amplitude"], f.w, 0.0, 1))  # ports: value, first and second derivative
    both = add("both", Multiplexer(2))
    compensator = add(
        "compensator", SymbolicVectorSystem(state=[z], input=[x, v], dynamics=[rate], output=[(x - z) / slope])
    )
    error, tracking = add("error", Adder(2, 1)), add("tracking", Adder(2, 1))
    minus_angle, minus_out = add("minus_angle", Gain(-1.0, 1)), add("minus_out", Gain(-1.0, 1))
    kp, ki, kd = n["kp"], n["ki"], n["kd"]
    pid = LinearSystem([[0, 0], [0, -corner]], [[1], [corner]], [[ki, -kd * corner]], [[kp + kd * corner]])
    controller = add("controller", pid)
    drive = add("drive", Saturation([n["low"]], [n["high"]]))
    lag = 1 / n["motor_tau"]
    motor = add("motor", LinearSystem([[0, 1], [0, -lag]], [[0], [n["K"] * lag]], np.eye(2), np.zeros((2, 1))))
    split = add("split", Demultiplexer(2))
    plant = add("plant", SymbolicVectorSystem(state=[z], input=[x, v], dynamics=[rate], output=[slope * x + z]))
    for source, port, sink, number in [
        (ref, 0, both, 0),
        (ref, 1, both, 1),
        (both, 0, compensator, 0),
        (compensator, 0, error, 0),
        (minus_angle, 0, error, 1),
        (error, 0, controller, 0),
        (controller, 0, drive, 0),
        (drive, 0, motor, 0),
        (motor, 0, split, 0),
        (motor, 0, plant, 0),
        (split, 0, minus_angle, 0),
        (plant, 0, minus_out, 0),
        (ref, 0, tracking, 0),
        (minus_out, 0, tracking, 1),
    ]:
        b.Connect(source.get_output_port(port), sink.get_input_port(number))
    log = LogVectorOutput(tracking.get_output_port(), b, step)
    diagram = b.Build()

    def run() -> np.ndarray:
        simulator = Simulator(diagram)
        config = SimulatorConfig(integration_scheme="runge_kutta3", max_step_size=step, use_error_control=False)
        ApplySimulatorConfig(config, simulator)
        simulator.AdvanceTo(stop)
        return np.asarray(log.FindLog(simulator.get_context()).data()[0])

    return run
