"""tsmblocks as a contestant: its run end to end, its kernel alone, and the same as a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import llvmlite.binding  # noqa: F401 - the engine imports it at the first compile; here it counts as import
import numpy as np

import tsmblocks as tsm
from tsmblocks import blocks, load, simulate  # noqa: F401 - parts that are imported when first asked for; the same
from tsmblocks.engine.inputs import input_rows
from tsmblocks.engine.kernel import Kernel, Steps
from tsmblocks.engine.methods import method_named
from tsmblocks.engine.session import gather_signals, single_kernel, start_memory, steps_per_period
from tsmblocks.simulation.compiled import equations, parameter_vector

TOLERANCE = 0.0
METHOD = "RK4, fixed step"
COMPILES = True
FIGURES = {"fig09b": "fig09b_feedforward", "fig16": "fig16_feedforward_feedback", "plant": "tendon_sheath_asymmetric"}


def build(numbers: dict[str, float], stop: float, step: float) -> Callable[[], np.ndarray]:
    """Fig 9(b) from its file; each call runs it (for ``peer_worker``)."""
    diagram = tsm.load(FIGURES["fig09b"])

    def run() -> np.ndarray:
        made = tsm.simulate(diagram, stop=stop, step=step)
        return made["x_ref"] - made["x_out"]

    return run


def peer_numbers(diagram: Any) -> dict[str, float]:
    """The numbers of Fig 9(b) under the names that the other tools' modules use."""
    values = {**diagram.values, **diagram.parameters}
    named = {k: f"ref.{k}" for k in ("amplitude", "frequency")} | {
        k: f"controller.{k}" for k in ("kp", "ki", "kd", "tau")
    }
    named |= {"low": "drive.low", "high": "drive.high", "K": "motor.K", "motor_tau": "motor.tau"}
    named |= {k: f"tsm.{k}" if f"tsm.{k}" in values else k for k in ("alpha1", "alpha2", "A", "theta", "delta")}
    return {k: float(values[name]) for k, name in named.items()}


class KernelRun:
    """The compiled loop alone, into memory that is there already: no checks, no units, no new arrays."""

    def __init__(
        self,
        diagram: Any,
        stop: float,
        step: float = 1e-3,
        inputs: Mapping[str, Any] | None = None,
        outputs: bool = False,
    ) -> None:
        eq = equations(diagram)
        shown = tuple(dict.fromkeys(eq.y.index(v) for v in eq.aliases.values())) if outputs else tuple(range(len(eq.y)))
        self.kernel: Kernel = single_kernel(eq, method_named("rk4"), shown, "")
        self.names = tuple(eq.y[k] for k in shown)
        self.step, self.steps = step, round(stop / step)
        p, grid = parameter_vector(eq, diagram), step * np.arange(self.steps + 1)
        self.memory = start_memory(eq, self.kernel, p, step)
        instants = self.kernel.plan.method.instants
        self.u = input_rows(gather_signals(eq, dict(inputs or {}), grid, "linear"), 0.0, step, 0, self.steps, instants)
        self.hits = steps_per_period(eq, step)
        self.y = np.zeros((self.steps + 1, self.kernel.layout_y.size))

    def __call__(self) -> None:
        self.kernel.advance(self.memory.copy(), self.u, self.y, Steps(0.0, self.step, 0, self.steps, True, self.hits))

    def signals(self) -> dict[str, np.ndarray]:
        """What the last call logged."""
        return {name: self.y[:, k] for k, name in enumerate(self.names)}


def signals(run: Any) -> dict[str, np.ndarray]:
    """All signals of a run by their own names."""
    return {name: run[name] for name in run.names}


def tracking(run: Any) -> np.ndarray:
    """x_ref - x_out."""
    return np.asarray(run["x_ref"] - run["x_out"])
