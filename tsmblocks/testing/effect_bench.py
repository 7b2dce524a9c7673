"""The bench on which an effect is checked: alone, driven by test signals."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from tsmblocks.effects import Effect, Scales, Trials, span_of
from tsmblocks.model.block import Samples
from tsmblocks.model.diagram import Diagram
from tsmblocks.simulation.simulate import simulate

STEP, DURATION = 0.01, 6.0
"""Step and length [s] of the runs. Chosen: some cycles of the signals, slow and fast."""


@attrs.frozen(eq=False)
class Bench:
    """An effect alone, driven by test signals, scaled in ``size`` and drawn out in time by ``slow``."""

    effect: Effect
    size: float = 1.0
    slow: float = 1.0
    finer: int = 5

    @cached_property
    def t(self) -> np.ndarray:
        """Instants of the samples."""
        return self.slow * np.arange(0.0, DURATION + STEP / 2, STEP)

    def wave(self, k: int) -> np.ndarray:
        """The k-th input: slow and fast, of either sign, at rest at its beginning."""
        t, shift = self.t / self.slow, 0.7 * k
        begun = np.minimum(t, 1.0) ** 3
        made = 0.5 * np.sin(1.3 * t + shift) + 0.3 * np.sin(3.7 * t + 0.4 + shift) + 0.1 * np.sin(11 * t)
        return np.asarray(self.size * begun * made)

    @cached_property
    def driven(self) -> tuple[str, ...]:
        """Inputs of the block that are driven, u first."""
        return tuple(k for k, port in self.effect.block.inports.items() if not getattr(port, "rate_of", ""))

    @cached_property
    def diagram(self) -> Diagram:
        """The block alone."""
        inputs = {name: f"effect.{name}" for name in self.driven}
        outputs = {"out": "effect.y"}
        return Diagram(title=self.effect.name, blocks={"effect": self.effect.block}, inputs=inputs, outputs=outputs)

    @cached_property
    def waves(self) -> dict[str, np.ndarray]:
        """The inputs."""
        return {name: self.wave(k) for k, name in enumerate(self.driven)}

    @cached_property
    def scales(self) -> Scales:
        """The scales of these signals, as a diagnosis would give them."""
        step = STEP * self.slow
        spans = {name: attrs.evolve(span_of([x], [step]), turn=2 * math.pi) for name, x in self.waves.items()}  # angles
        wire, other = spans["u"], spans.get("x", spans["u"])
        end, lines = float(self.t[-1]), (0.7 / self.slow, 3.1 / self.slow)
        return Scales(wire, other, 0.0, end, step, end, lines, one_clock=not self.effect.local)

    def trials(self) -> Trials | None:
        """The trials at these scales."""
        made = self.effect.trials(self.scales)
        if made is not None:
            self.effect.accepts(made, self.scales)
        return made

    def run(
        self,
        parameters: Mapping[str, float],
        *,
        backend: str = "",
        method: str = "rk4",
        waves: Any = None,
        initial: Mapping[str, float] | None = None,
    ) -> np.ndarray:
        """The output at the instants of the samples."""
        given = self.waves if waves is None else waves
        named = {f"effect.{k}": v for k, v in parameters.items()}
        inputs = {name: Samples(self.t, values, "cubic") for name, values in given.items()}
        step = STEP * self.slow / self.finer
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            options: dict[str, Any] = dict(
                stop=float(self.t[-1]), step=step, every=self.finer, check_step=False, log="outputs"
            )
            done = simulate(
                self.diagram,
                inputs=inputs,
                parameters=named,
                backend=backend,
                method=method,
                initial=initial,
                **options,
            )
        return np.asarray(done["out"])

    def change(self, parameters: Mapping[str, float]) -> np.ndarray:
        """The change of the signal by the effect."""
        return self.run(parameters) - self.waves["u"]
