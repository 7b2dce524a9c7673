"""A candidate of a round, fitted together with the base."""

from __future__ import annotations

import attrs
import numpy as np

from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.model import Model

BOUND_TOLERANCE = 1e-3
"""Relative distance from a bound within which a parameter is reported at it. Chosen: below any interval."""
MAX_FINITE_NULL = 1e9
"""Magnitude from which a null value counts as infinite (a limit that never acts), in the parameter's unit. Chosen."""
FROM_INPUTS = "noise of the inputs explains as much"
"""Why a candidate may not be named."""
NO_INSTANTS = "its instants are not determined"
"""The same, of a sudden change that may not begin, or end, within the recording: it is then another effect."""


@attrs.frozen(eq=False)
class FittedCandidate:
    """A candidate fitted together with the base, and its held-out losses [noise variances].

    ``losses`` (B,) are the held-out losses by time blocks, ``experiment_losses`` (B,) those with whole experiments held
    out; ``loss`` is the mean of ``losses`` over all samples. ``untenable`` says why it may not be named, however much
    it removes; empty where it may.
    """

    candidate: Candidate
    model: Model
    losses: np.ndarray = attrs.field(repr=False)
    experiment_losses: np.ndarray = attrs.field(repr=False)
    loss: float
    untenable: str = ""

    @property
    def tenable(self) -> bool:
        """Whether it may be named."""
        return not self.untenable

    @property
    def disqualifying_bounds(self) -> tuple[str, ...]:
        """Parameters at a bound beyond which the effect is a different one, so that its name does not hold."""
        effect = self.candidate.effect
        return tuple(k for k in self.at_bounds if k in effect.within or (k in effect.below and k in self._at_bounds(1)))

    @property
    def is_another(self) -> bool:
        """Whether it is not the effect that its name says, though it may explain the residual best."""
        return bool(self.disqualifying_bounds) or self.untenable == NO_INSTANTS

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters of the effect that lie at a bound."""
        return self._at_bounds(0, 1)

    @property
    def at_limit_of_form(self) -> bool:
        """Whether a parameter lies at a bound beyond which the form is another one, and not just a sharp corner."""
        return any(k not in self.candidate.effect.sharp or k in self._at_bounds(1) for k in self.at_bounds)

    def _at_bounds(self, *sides: int) -> tuple[str, ...]:
        """Parameters of the effect that lie at a lower bound (0) or at an upper one (1)."""
        unknowns, block, names = self.model.problem.unknowns, self.candidate.block, list[str]()
        for item, value in zip(unknowns.items, self.model.theta, strict=True):
            if item.parameter in self.candidate.free:
                low = abs(item.low) if abs(item.low) < MAX_FINITE_NULL else 0.0
                tolerance = BOUND_TOLERANCE * max(low, abs(value), 1e-12)
                away = abs(value - item.low), abs(item.high - value)
                if min(away[side] for side in sides) <= tolerance:
                    names.append(item.parameter.removeprefix(f"{block}."))
        return tuple(names)

    @property
    def parameter_count(self) -> int:
        """Parameters without initial states, which make an effect no more complex."""
        items = self.model.problem.unknowns.items
        return sum(not item.experiment or item.parameter in self.candidate.local for item in items)
