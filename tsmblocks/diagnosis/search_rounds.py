"""What a search for effects works with, and what one round of it found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.data import Record
from tsmblocks.diagnosis.candidates import Candidate
from tsmblocks.diagnosis.cross_validation import TimeBlocks
from tsmblocks.diagnosis.decision import Verdict
from tsmblocks.diagnosis.fitted_candidate import FittedCandidate
from tsmblocks.diagnosis.model import Model, ModelSettings, ProgressCallback
from tsmblocks.diagnosis.noise_floor import NoiseLevel
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.effects import Effect, Relative, Replacement

LIKELY_NOISE = 10.0
"""Mean square of noise [noise variances] that is likely, where the floor may be that of the fast noise alone. Chosen:
three times the floor."""


@attrs.frozen(eq=False)
class SearchRound:
    """One search for an effect: the base of the round, its held-out losses, screening scores and verdict.

    ``losses`` (B,) and ``experiment_losses`` (B,) are those of the base, by folds and by whole experiments.
    ``repeated`` is the same search repeated with all effects that were named later in the model. ``single_effect`` is
    True where the round searched for one given effect only; ``repeated`` then is the search that named it.
    ``multiplicity`` is how many times its own critical gain the best of all candidates of a family reaches in noise, as
    ``critical_multiplicity``.
    """

    base: Model
    losses: np.ndarray
    experiment_losses: np.ndarray
    screening_scores: tuple[ScreeningScore, ...]
    verdict: Verdict
    repeated: SearchRound | None = None
    single_effect: bool = False
    multiplicity: Mapping[str, float] = attrs.field(factory=dict)

    @property
    def most_complete(self) -> SearchRound:
        """The search with most candidates: this one, or the repeated one."""
        return self.repeated if self.single_effect and self.repeated is not None else self

    @property
    def indistinguishable(self) -> tuple[FittedCandidate, ...]:
        """The effect named and those indistinguishable from it, given all other effects that were named."""
        return (self.repeated or self).verdict.indistinguishable


@attrs.frozen(eq=False)
class SearchContext:
    """Shared by all rounds: recordings, model settings, effects, time blocks, noise.

    ``noise`` is how large the noise may be. ``progress(stage, done, of)`` is the progress callback. ``only_frequency``
    is the one frequency [Hz] of all recordings, None where there are several. ``input_noise`` is the rms noise that was
    filtered out of each input, ``noise_left`` that of inputs out of which none was. ``check`` raises OtherCommands
    where a model with effects shows inputs to be commands, and ``check_named`` where a command explains as much as an
    effect that was named. ``exceeds_noise`` is whether an effect that was chosen among so many candidates, beside the
    model before it, is more than noise of the inputs explains. ``given`` are the parameters of the diagram.
    """

    records: Mapping[str, Record]
    settings: ModelSettings
    effects: Sequence[Effect | Relative]
    blocks: TimeBlocks
    noise: NoiseLevel
    progress: ProgressCallback
    only_frequency: float | None = None
    input_noise: Mapping[str, float] = attrs.field(factory=dict)
    noise_left: Mapping[str, float] = attrs.field(factory=dict)
    check: Callable[[Model], None] = lambda _: None
    check_named: Callable[[Model, FittedCandidate], None] = lambda *_: None
    exceeds_noise: Callable[[Model, FittedCandidate, int], bool] = lambda *_: True
    given: Mapping[str, float] = attrs.field(factory=dict)

    def tried_as(self, candidate: Candidate) -> Effect | Relative:
        """The effect that was searched for, from which a candidate was made: of a replacement, the relative."""
        effect = candidate.effect
        if isinstance(effect, Replacement):
            return effect.relative
        tried = (one for one in self.effects if isinstance(one, Effect))
        return next((one for one in tried if (one.name, one.variant) == (effect.name, effect.variant)), effect)

    def rank(self, candidate: Candidate) -> int:
        """The place in the order of the effects of the one from which a candidate was made."""
        return self.effects.index(self.tried_as(candidate))

    @property
    def likely_noise(self) -> float:
        """The largest mean square of noise that is likely [noise variances]; more is possible."""
        return min(self.noise.high, LIKELY_NOISE)

    @property
    def noise_variance(self) -> float:
        """Mean square of the noise, in the variances that residuals are counted in: the least that is plausible."""
        return self.noise.low
