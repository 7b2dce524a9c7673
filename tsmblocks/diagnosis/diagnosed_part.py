"""The search for one part of a diagram, with the effects that it accepted: what a result is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.diagnosis.acceptance import attained_noise
from tsmblocks.diagnosis.commands import HeldDelay
from tsmblocks.diagnosis.credibility import parameters_in_doubt
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import mean_loss
from tsmblocks.diagnosis.evidence import MIN_PREDICTED_EXCESS, Evidence, is_material
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.input_spectrum import Likelihood
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.noise_floor import NoiseFloors
from tsmblocks.diagnosis.outliers import share_of_outliers
from tsmblocks.diagnosis.partition import Part, experiment_of
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.diagnosis.varying_factor import VaryingFactor

UNKNOWN_EXCESS = 0.2
"""Excess over a given noise floor, or over the largest noise that is plausible where nothing predicts the residual
[noise variances], from which the verdict is "unknown". Source: set on the prototype's development seeds."""
CLEARLY_PREDICTED = 0.5
"""Share of a residual that is predicted on held-out data, or proportional to the motion by a factor that varies, from
which noise of the inputs is not its cause. Chosen: the recorded inputs hold their own noise, which predicts a part of
what it causes."""


@attrs.frozen(eq=False)
class Omission:
    """An effect that was accepted and then left out: the index of its round, its search, and the reason in words."""

    index: int
    searched: SearchRound
    effect: FittedCandidate
    reason: str

    @classmethod
    def of(cls, rounds: Sequence[SearchRound], effect: FittedCandidate, reason: str) -> Omission:
        """The omission of an effect that was named in one of some rounds."""
        index, searched = next((k, one) for k, one in enumerate(rounds) if one.verdict.named is effect)
        return cls(index, searched, effect, reason)


@attrs.frozen(eq=False)
class DiagnosedPart:
    """The search for one part of a diagram: its rounds, how many effects are accepted, and the final model."""

    part: Part
    search: SearchContext
    floors: NoiseFloors
    rounds: Sequence[SearchRound]
    count: int
    final: Model
    """The last accepted model, at a step that its intervals cover."""
    predicted: Evidence
    """The predictable part of the base's residual."""
    left: Evidence
    """The predictable part of the final model's residual."""
    varying: VaryingFactor | None = None
    """The coordinate to which the final model's residual is proportional by a factor that varies."""
    omitted: Sequence[Omission] = ()
    """The effects that were accepted at first and then left out."""
    filtered: tuple[str, ...] = ()
    """The inputs whose noise was filtered out."""
    delays_if_held: tuple[HeldDelay, ...] = ()
    """The dead times that were named, with an input held that may be."""
    stopped: bool = False
    """Whether the search was stopped before it was over."""
    correlated_noise: Mapping[str, float] = attrs.field(factory=dict)
    """Mean square by output [noise variances] of errors that noise of the inputs causes and that are whitened."""
    input_factor: float = 1.0
    """The share of the noise of the inputs that is taken for possible which is likely beside the last model."""
    beside_inputs: Likelihood | None = None
    """What noise of the inputs explains of the final model's residual; None where no input is seen to be noisy."""

    def with_input_noise(self, output: str, variance: float) -> float:
        """Rms noise of an output in its unit, of a variance [noise variances] and the errors that are whitened."""
        return self.floors.sigma[output] * float(np.sqrt(variance + self.correlated_noise.get(output, 0.0)))

    def sensor_noise(self, output: str) -> float:
        """Rms noise of an output in its unit without the errors that are whitened, beside the last model."""
        noise = self.search.noise
        surplus = (1 - self.input_factor**2) * noise.from_inputs
        return self.floors.sigma[output] * float(np.sqrt(max(noise.low - surplus, 0.0)))

    def from_inputs(self, output: str) -> float:
        """Mean square [noise variances] that noise of the inputs adds to an output."""
        return self.search.noise.from_inputs + self.correlated_noise.get(output, 0.0)

    @property
    def blocks(self) -> TimeBlocks:
        """The time blocks of the search."""
        return self.search.blocks

    @property
    def has_several_experiments(self) -> bool:
        """Whether there is more than one experiment, so that whole ones can be held out."""
        return len({experiment_of(t.name) for t in self.models[0].setup.experiments}) > 1

    @property
    def losses(self) -> list[float]:
        """Held-out loss of the base, and after each accepted effect [noise variances]."""
        return [mean_loss(one.losses, self.blocks) for one in self.rounds[: self.count + 1]]

    @property
    def noise_variance(self) -> float:
        """Mean square of the noise [output noise variances]."""
        noise = attained_noise(self.rounds[: self.count + 1], self.search)
        if self.varying is None or not self.varies:
            return noise
        return min(noise, (1 - self.varying.share) * self.losses[-1])  # the rest of it is a model error

    @property
    def is_irregular(self) -> bool:
        """Whether the last model leaves more than noise and outliers may be, and no function of what was recorded."""
        loss = (1 - share_of_outliers([self.final.r[rows] for rows in self.final.problem.segments])) * self.losses[-1]
        large = loss > (1 + UNKNOWN_EXCESS) * self.largest_noise or self.varies
        from_inputs = self.is_noise_of_inputs and not self.varies
        return large and not self.leaves_predictable and not from_inputs

    @property
    def is_noise_of_inputs(self) -> bool:
        """Whether noise of the inputs is taken for the cause of what the last model leaves.

        Where the noise of the outputs is known, what is above it is reported all the same.
        """
        return self.may_be_noise_of_inputs and not self.search.noise.is_given

    @property
    def may_be_noise_of_inputs(self) -> bool:
        """Whether noise of the inputs may be the cause of what the last model leaves above the noise of the outputs."""
        return self.beside_inputs is not None and self.beside_inputs.explains

    @property
    def leaves_unexamined(self) -> bool:
        """Whether effects were named, more than noise is left, and the search was stopped before it was over."""
        return self.stopped and self.count > 0 and self.losses[-1] > (1 + UNKNOWN_EXCESS) * self.search.noise.low

    @property
    def varies(self) -> bool:
        """Whether what the last model leaves is proportional to the motion by a factor that varies, materially."""
        large = self.losses[-1] > (1 + UNKNOWN_EXCESS) * self.search.noise.low  # else it may be noise of an input
        if self.varying is None or not self.varying.material:
            return False
        return large and (not self.is_noise_of_inputs or self.varying.share >= CLEARLY_PREDICTED)

    @property
    def _is_within_given_noise(self) -> bool:
        """Whether the last model leaves no more than the noise that the user gave."""
        noise = self.search.noise
        return noise.is_given and self.losses[-1] <= (1 + UNKNOWN_EXCESS) * noise.low

    @property
    def largest_noise(self) -> float:
        """The largest mean square of noise that is plausible in the residual of the last model [noise variances]."""
        last = self.rounds[self.count]
        return self.search.noise.largest(float(np.median(last.losses)))

    @property
    def leaves_predictable(self) -> bool:
        """Whether what the last model leaves is predicted, and material beside the noise."""
        if self._is_within_given_noise:
            return False
        material = self.left.material and self.left.predicted >= MIN_PREDICTED_EXCESS * self.search.noise.low
        if self.is_noise_of_inputs:
            material = material and self.left.share >= CLEARLY_PREDICTED
        return material or is_material(self.rejected_share)

    @property
    def rejected_share(self) -> float:
        """Share of the base's mean square that the best effect removes, where it removes too little to be accepted."""
        rejected = None if self.count else self.rounds[0].verdict.named
        return 0.0 if rejected is None else max(1 - rejected.loss / self.losses[0], 0.0)

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Parameters of the final model that compensate for what is missing, in words."""
        error = self.losses[-1] / self.search.noise_variance
        return parameters_in_doubt(self.final, self.part.diagram.parameters, error)

    @property
    def models(self) -> list[Model]:
        """The base, and the model after each accepted effect."""
        return [*(one.base for one in self.rounds[: self.count]), self.final]

    @property
    def named(self) -> list[FittedCandidate]:
        """The accepted effects."""
        return [one.verdict.named for one in self.rounds[: self.count] if one.verdict.named is not None]

    @property
    def corners(self) -> list[str]:
        """Full names of the parameters of accepted effects that smooth a corner."""
        return [name for one in self.named for name in one.candidate.rounding]
