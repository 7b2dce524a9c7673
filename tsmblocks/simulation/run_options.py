"""How diagrams are run: the options that single runs, batches, sensitivities, studies and tuning share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import attrs

from tsmblocks.engine.equations import Equations
from tsmblocks.engine.inputs import Signal
from tsmblocks.engine.methods import Method, method_named
from tsmblocks.engine.session import gather_signals
from tsmblocks.simulation.arguments import TimeGrid, as_inputs, run_times


@attrs.frozen(eq=False)
class RunOptions:
    """Arguments of ``simulate`` by the same names; inputs are checked here, the others where they are first used."""

    stop: float | None = None
    step: float = 1e-3
    start: float = 0.0
    method: str = "rk4"
    inputs: Mapping[str, Any] = attrs.field(default=None, converter=as_inputs)
    hold: str = "linear"
    every: int = 1
    backend: str = ""

    @property
    def times(self) -> TimeGrid:
        """The instants of the run. Raises RunError."""
        return run_times(self.inputs, self.start, self.stop, self.step, self.every)

    @property
    def rule(self) -> Method:
        """The integration method. Raises RunError for an unknown name."""
        return method_named(self.method)

    @property
    def arguments(self) -> dict[str, Any]:
        """The options as keyword arguments of ``simulate`` and ``study``, which keep every instant."""
        return {k: v for k, v in attrs.asdict(self, recurse=False).items() if k != "every"}

    def signals(self, eq: Equations) -> list[tuple[Signal, int]]:
        """The signal behind each sampled input of the equations, with the order of its derivative. Raises DataError."""
        return gather_signals(eq, self.inputs, self.times.grid, self.hold)
