"""The result of a diagnosis for one segment: effects named, errors before and after, candidates, detection limits."""

from __future__ import annotations

from collections.abc import Mapping

import attrs
import numpy as np

from tsmblocks.diagnosis.cautions import FAR_ABOVE, MAYBE, cautions, without
from tsmblocks.diagnosis.commands import HeldDelay
from tsmblocks.diagnosis.settings import FloorParts, Simulated
from tsmblocks.fitting.result import Fit
from tsmblocks.model.diagram import Diagram


@attrs.frozen
class Quantity:
    """An estimate with its 95 % confidence interval, given this model structure."""

    value: float
    low: float
    high: float
    unit: str = ""


@attrs.frozen
class NamedEffect:
    """An effect that the model lacks.

    ``wire`` is where ``block`` was inserted, in wire notation; ``share_removed`` the share of the error above the noise
    floor that it removes on held-out blocks, with the effects before it in the model; ``across`` the same with whole
    experiments held out (None with a single one). ``also_possible`` are effects indistinguishable from it with these
    data, and ``separating_experiment`` is one that separates them. ``code`` is the line that adds the block. ``sizes``
    are measurable quantities (an amplitude, a gap, a frequency), derived from ``parameters``, the most informative
    first; empty for an effect that defines none. ``other_places`` are the insertion points at which the same effect is
    indistinguishable from this one, ``other_forms`` its indistinguishable variants, and ``why_named`` why it is named
    rather than those. ``as_force`` says of sizes that are accelerations what they are as forces. ``absent_in`` are the
    experiments in which no size is clear of zero, of an effect with separate sizes in each; ``relative_to`` is the
    experiment from which these are counted, where a common part of them is not determined.
    """

    name: str
    family: str
    words: str
    segment: str
    wire: str
    block: str
    parameters: Mapping[str, Quantity]
    share_removed: float
    across: float | None
    also_possible: tuple[str, ...]
    separating_experiment: str
    code: str
    sizes: Mapping[str, Quantity] = attrs.field(factory=dict)
    other_places: tuple[str, ...] = ()
    other_forms: tuple[str, ...] = ()
    why_named: str = ""
    as_force: Mapping[str, str] = attrs.field(factory=dict)
    absent_in: tuple[str, ...] = ()
    relative_to: str = ""

    def is_absent(self, name: str) -> bool:
        """Whether a size or a parameter, ``size@r1``, is that of an experiment in which the effect is absent."""
        return name.partition("@")[2] in self.absent_in


@attrs.frozen
class RankedCandidate:
    """A candidate: its reduction of the held-out loss [noise variances], t-statistic and critical value ``line``.

    ``round`` counts from 1; ``gain`` is the predicted reduction where a candidate was screened out (``fitted`` False).
    ``share`` is the gain over the error above the noise, at most 1 (a model may leave less than the noise was estimated
    to be), NaN where next to nothing is above it; ``across`` and ``new`` are gain and share with whole experiments held
    out (NaN with a single one, or without a fit). ``in_set`` is True for the candidate named and those that are
    indistinguishable from it; ``why_not`` is why a fitted candidate was not named; ``words`` says what the effect is.
    """

    round: int
    segment: str
    name: str
    variant: str
    family: str
    wire: str
    gain: float
    share: float
    across: float = float("nan")
    new: float = attrs.field(default=float("nan"), kw_only=True)
    t: float = float("nan")
    line: float = float("nan")
    in_set: bool = False
    named: bool = False
    fitted: bool = False
    at_bound: tuple[str, ...] = ()
    parameters: Mapping[str, float] = attrs.field(factory=dict)
    units: Mapping[str, str] = attrs.field(factory=dict)
    why_not: str = ""
    words: str = ""


@attrs.frozen
class Gap:
    """Residual rms of one output, before and after each effect that was named.

    ``train`` and ``held_out`` hold that of the base and then one for each effect, ``experiments`` those held out by
    experiment. ``noise_floor`` is the noise of the output together with that caused by measured inputs. ``method`` is
    how it was estimated, ``given`` the text it was given by, if it was, ``parts`` what an estimate consists of.
    ``outliers`` is the share of the last residual's mean square that outliers hold, 0 where they are not reported.
    Where noise of the inputs makes residuals that are whitened, ``whitened`` holds the rms of these, held out, and
    ``sensor_floor`` is the noise of the output alone.
    """

    output: str
    unit: str
    noise_floor: float
    method: str
    train: tuple[float, ...]
    held_out: tuple[float, ...]
    experiments: Mapping[str, tuple[float, ...]]
    given: str = ""
    parts: FloorParts | None = None
    outliers: float = 0.0
    whitened: tuple[float, ...] = ()
    sensor_floor: float = 0.0

    @property
    def judged(self) -> tuple[float, ...]:
        """The rms on held-out data that verdicts are about: without what noise of the inputs adds."""
        return self.whitened or self.held_out

    @property
    def judged_floor(self) -> float:
        """The noise floor of that."""
        return self.sensor_floor if self.whitened else self.noise_floor

    @property
    def rest(self) -> float:
        """The rms of the last residual on held-out data, without outliers."""
        return self.judged[-1] * (1 - self.outliers) ** 0.5


@attrs.frozen
class InputNoiseRms:
    """Noise of an input that would cause what a model leaves: its rms [unit], and that over the input's deviation."""

    input: str
    rms: float
    unit: str
    share: float


@attrs.frozen
class ResidualCoordinate:
    """A coordinate of the motion, and the share of the excess that it predicts on held-out blocks."""

    coordinate: str
    share: float
    words: str


@attrs.frozen
class DetectionLimit:
    """The smallest detectable size of an effect in these experiments; None where no size is.

    ``value`` is that of ``parameter`` of the effect on a ``wire``; ``size`` [``size_unit``] the same as the measurable
    quantity ``size_name``, where the effect defines one that is proportional to it. ``cause`` says why there is no
    limit, ``absorbed_by`` which parameters of the model have the same effect, and by how much where it is one.
    """

    name: str
    parameter: str
    value: float | None
    unit: str
    excites: str
    size_name: str = ""
    size: float = 0.0
    size_unit: str = ""
    cause: str = ""
    absorbed_by: Mapping[str, str] = attrs.field(factory=dict)
    wire: str = ""


@attrs.frozen
class Consequence:
    """Tracking of a recorded motion [unit]: without compensation, and with one built on the base and on the new model.

    Each pair is peak-to-peak and rms error. The plant is the augmented model. ``words`` comment on a compensator that
    is no better than the one on the base.
    """

    unit: str
    reference: str
    none: tuple[float, float]
    base: tuple[float, float]
    augmented: tuple[float, float]
    words: str = ""


@attrs.frozen(eq=False)
class Trace:
    """One output of one experiment: instants [s], and in ``unit`` measured, simulated before, simulated after.

    ``drive`` is the input in ``drive_unit`` (empty where there is none), ``excess`` (blocks, 3) start, stop [s] and
    mean squared residual of the base in each time block [noise variances].
    """

    experiment: str
    output: str
    unit: str
    t: np.ndarray = attrs.field(repr=False)
    measured: np.ndarray = attrs.field(repr=False)
    before: np.ndarray = attrs.field(repr=False)
    after: np.ndarray = attrs.field(repr=False)
    drive: np.ndarray = attrs.field(repr=False)
    drive_name: str
    excess: np.ndarray = attrs.field(repr=False)
    drive_unit: str = ""


@attrs.frozen(eq=False)
class Segment:
    """The result for one part of the diagram, between measured signals.

    ``excess`` is the base's held-out loss above the noise [noise variances], ``ceiling`` the share of it that two
    coordinates predict. ``fit`` is the last model as ``tsm.fit`` would return it. ``predictable`` are the shares of the
    residual of the base, and of the last model, that are predicted on held-out data from what was recorded;
    ``complete`` is False where the last model leaves more than noise, ``irregular`` True where that is no function of
    what was recorded, ``stopped`` True where the search was stopped before that was examined; ``varies_with`` is the
    coordinate to which it is proportional by a factor that varies, if it is.
    ``largest_noise`` is the largest rms noise of each output that is plausible; ``filtered`` are the inputs out of
    which noise was filtered, ``noise_of_inputs`` is the noise of inputs that may cause what the last model leaves.
    ``augmented`` is the diagram of the last model, ``simulated`` how it was simulated;
    ``in_doubt`` are its parameters that compensate for what is missing, with fitted and given values;
    ``delays_if_held`` are the dead times that were named, with an input held that may be.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    verdict: str
    excess: float
    noise_floor: Mapping[str, float]
    effects: tuple[NamedEffect, ...]
    gaps: tuple[Gap, ...]
    where: tuple[ResidualCoordinate, ...]
    ranking: tuple[RankedCandidate, ...]
    limits: tuple[DetectionLimit, ...]
    traces: tuple[Trace, ...] = attrs.field(repr=False)
    ceiling: float
    sentence: str
    fit: Fit | None = attrs.field(default=None, repr=False)
    complete: bool = True
    irregular: bool = False
    stopped: bool = False
    varies_with: str = ""
    predictable: tuple[float, float] = (0.0, 0.0)
    largest_noise: Mapping[str, float] = attrs.field(factory=dict)
    filtered: tuple[str, ...] = ()
    noise_of_inputs: tuple[InputNoiseRms, ...] = ()
    augmented: Diagram | None = attrs.field(default=None, repr=False)
    simulated: Simulated | None = attrs.field(default=None, repr=False)
    in_doubt: tuple[str, ...] = ()
    delays_if_held: tuple[HeldDelay, ...] = ()

    @property
    def effects_tried(self) -> tuple[str, ...]:
        """Names of the effects that had an admissible signal and that these data excite."""
        return tuple(dict.fromkeys(r.name for r in self.ranking))

    @property
    def cautions(self) -> tuple[str, ...]:
        """Warnings on the effects and on the parameters of the last model, the latter as a fit of it would give."""
        across = {e.block: e.across for e in self.effects}
        far = self.verdict == "none" and any(g.judged[0] > FAR_ABOVE * g.judged_floor > 0 for g in self.gaps)
        if self.fit is None:
            return ()
        absent = {f"{e.block}.{name}" for e in self.effects for name in e.parameters if e.is_absent(name)}
        seen = without(self.fit, absent)
        return (*[MAYBE] * far, *cautions(seen, across, complete=self.complete))
