"""Detection limits: the smallest size of each effect that the experiments reveal, or why they reveal none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import attrs
import numpy as np

from tsmblocks.blocks import Bias
from tsmblocks.common.displayed_units import display_unit
from tsmblocks.diagnosis.acceptance import MIN_EXCESS_SHARE
from tsmblocks.diagnosis.candidate_units import displayed_unit
from tsmblocks.diagnosis.candidates import Candidate, acts_on
from tsmblocks.diagnosis.critical_gains import critical_gains
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.diagnosed_part import DiagnosedPart
from tsmblocks.diagnosis.insertion_points import insertion_points
from tsmblocks.diagnosis.model import Model
from tsmblocks.diagnosis.presentation import in_display_units, unit_of
from tsmblocks.diagnosis.quantities import detectable_size, recorded_units
from tsmblocks.diagnosis.screening import MIN_SENSITIVITY, absorbing
from tsmblocks.diagnosis.screening_score import ScreeningScore
from tsmblocks.diagnosis.search_rounds import SearchContext, SearchRound
from tsmblocks.diagnosis.segment import DetectionLimit
from tsmblocks.effects import Effect, Relative, Replacement
from tsmblocks.effects.sizes import MILLISECONDS
from tsmblocks.fitting.column_space import SQUARED_EFFECT_TOLERANCE, column_space
from tsmblocks.fitting.inner_products import square

MAX_RANGES = 3.0
"""Size of an effect, over the range of the signal on which it acts, from which it makes no sense. Chosen."""
MAX_CREST = 10.0
"""Range of a signal, and peak of its rate, over the rms, up to which they are taken as they are. Chosen: a larger one
is that of a transient."""
MAX_PERCENT = 100.0
"""The same of a share [%]."""
CAUSES = {
    "absorbed": "absorbed by parameters of the model",
    "beyond range": "detectable only beyond the range of the signals",
    "not excited": "not excited by these experiments",
    "no insertion point": "no place for it in this diagram",
    "replaces a block": "tried in place of a block, where it has no size",
}
"""Why an effect has no detection limit, and in words."""
ABSORBED, BEYOND, NOT_EXCITED, NO_PLACE, REPLACES = CAUSES


def detection_limits(diagnosed: DiagnosedPart) -> tuple[DetectionLimit, ...]:
    """For each effect the smallest size detectable in these experiments, given the residual of the last model.

    It is that of the first of its forms, in the order of the catalogue, that has one that makes sense, at the place
    where these data show it best.
    """
    found: dict[str, DetectionLimit] = {}
    last = diagnosed.rounds[diagnosed.count]
    screened = last if last.screening_scores else diagnosed.rounds[0]
    scores, noise = screened.screening_scores, diagnosed.noise_variance
    by_noise = critical_gains(scores, screened.multiplicity)
    excess = max(diagnosed.losses[-1] - noise, 0.0)  # an effect has to remove its share of this as well
    material = max(MIN_VARIANCE_REDUCTION * noise, excess * MIN_EXCESS_SHARE / (1 - MIN_EXCESS_SHARE))
    recorded = recorded_units(last.base.setup)
    detectable = {p: max(material * len(last.base.r), by_noise[p]) for p in scores}
    for p in _simplest_first(detectable, diagnosed.search):
        name = p.candidate.effect.name
        if name not in found and (limit := _limit(p, detectable[p], recorded)):
            found[name] = attrs.evolve(limit, wire=p.candidate.point.words(last.base.diagram))
    placed = _names_with_a_place(diagnosed, screened)
    for one in diagnosed.search.effects:
        own = [p for p in scores if p.candidate.effect.name == one.name]
        found.setdefault(one.name, _without_limit(one, own, diagnosed, one.name in placed))
    order: dict[str, int] = {}
    for k, one in enumerate(diagnosed.search.effects):
        if isinstance(one, Effect) or one.name not in order:
            order[one.name] = k
    return tuple(sorted(found.values(), key=lambda m: order[m.name]))


def _simplest_first(detectable: Mapping[ScreeningScore, float], search: SearchContext) -> list[ScreeningScore]:
    """The candidates by their forms in the order of the catalogue, of each form those first that are seen best.

    ``detectable`` are the changes of the sum of squares from which they are seen.
    """

    def order(one: ScreeningScore) -> tuple[int, float]:
        most = max((shape.sensitivity for shape in one.shapes), default=0.0)
        return search.rank(one.candidate), -most / detectable[one]

    return sorted(detectable, key=order)


def _limit(score: ScreeningScore, detectable: float, recorded: Mapping[str, str]) -> DetectionLimit | None:
    """The smallest detectable size of a candidate that makes sense; None where there is none.

    A replacement has none: it begins at no null.
    """
    candidate = score.candidate
    for one in [] if isinstance(candidate.effect, Replacement) else score.limits(detectable):
        name, size, unit = detectable_size(candidate, one.parameter, one.value, one.shape, recorded)
        if not _is_beyond(candidate, one.parameter, name, size):
            effect = candidate.effect
            size = size if np.isinf(effect.null.get(one.parameter, 0.0)) else abs(size)
            value, own = abs(one.value), _unit(score, one.parameter, recorded)
            return DetectionLimit(effect.name, one.parameter, value, own, effect.excites, name, size, unit)
    return None


def _unit(score: ScreeningScore, parameter: str, recorded: Mapping[str, str]) -> str:
    full = f"{score.candidate.block}.{parameter}"
    items = (one for one in score.problem.unknowns.items if one.parameter == full)
    return next((displayed_unit(one, score.candidate, recorded) for one in items), "")


def _is_beyond(candidate: Candidate, parameter: str, name: str, size: float) -> bool:
    """Whether a size is far beyond what it is measured by: the range or rate of its signal, a recording, the whole.

    A level at which something is limited is beyond its signal where that does not reach it: a soft limit acts there
    too, but a reader takes it for a hard one.
    """
    scales, of = candidate.scales, next((one for one in candidate.effect.sizes if one.name == name), None)
    if scales is None or of is None:
        return False
    wire = scales.wire
    whole = {
        "{u}": MAX_RANGES * min(2 * wire.reach, MAX_CREST * wire.rms),
        "{x}": MAX_RANGES * min(2 * scales.other.reach, MAX_CREST * scales.other.rms),
        "{u}/s": min(wire.fastest, MAX_CREST * wire.speed),
        "s": scales.shortest,
        "ms": MILLISECONDS * scales.shortest,
    }
    if np.isinf(candidate.effect.null.get(parameter, 0.0)) and of.unit == "{u}":
        return not wire.low <= size <= wire.high
    return abs(size) > (MAX_PERCENT if of.unit == "%" else whole.get(of.unit, np.inf))


def _without_limit(
    effect: Effect | Relative, scores: Sequence[ScreeningScore], diagnosed: DiagnosedPart, placed: bool
) -> DetectionLimit:
    """An effect without a limit, and why: ``scores`` are those of its candidates."""
    added = [p for p in scores if not isinstance(p.candidate.effect, Replacement)]
    absorbed = [p for p in added if any(s.absorbed_by for s in p.shapes) and not any(s.sensitivity for s in p.shapes)]
    words = dict[str, str]()
    if absorbed:
        search = diagnosed.search
        first = min(absorbed, key=lambda p: search.rank(p.candidate))
        cause, words = ABSORBED, _of_sensor(first, diagnosed.models[0]) or _absorbed_by(first, diagnosed.models[0])
    elif any(s.sensitivity for p in added for s in p.shapes):
        cause = BEYOND
    elif scores and not added:
        cause = REPLACES
    else:
        cause = NOT_EXCITED if placed or added else NO_PLACE
    return DetectionLimit(effect.name, effect.free[0], None, "", effect.excites, cause=cause, absorbed_by=words)


def _absorbed_by(score: ScreeningScore, base: Model) -> dict[str, str]:
    """The parameters of the base that have the effect of a candidate; where it is one, by how much for its size."""
    shape, candidate = next(s for s in score.shapes if s.absorbed_by), score.candidate
    sizes = candidate.trials.strengths or {"": 0.0}
    parameter, trial = next(iter(sizes.items()))
    size, unit = 0.0, ""
    if trial:
        _, size, unit = detectable_size(candidate, parameter, abs(trial), shape.shape, recorded_units(base.setup))
    return _in_words(shape.absorbed_by, base, size, unit)


def _of_sensor(score: ScreeningScore, base: Model) -> dict[str, str]:
    """The same for an offset of the measured output alone, which no block behind its signal reads."""
    output, effect = score.candidate.point.output, score.candidate.effect
    if not isinstance(effect.block, Bias) or effect.place != "output":
        return {}
    i, count = base.setup.outputs.index(output), len(base.setup.outputs)
    change = np.zeros(len(base.r))
    for rows in base.problem.segments[i::count]:
        change[rows] = base.problem.weights[i]
    change = base.problem.whitened(change)
    space = column_space(base.J, SQUARED_EFFECT_TOLERANCE)
    components = space.basis.transposed_times(change[:, None])[:, 0]
    if square(change) - square(components) > MIN_SENSITIVITY * square(change):
        return {}
    moves = absorbing(space, components, base.problem.unknowns.names)
    return _in_words(moves, base, 1.0, recorded_units(base.setup)[output])


def _in_words(moves: Mapping[str, float], base: Model, size: float, unit: str) -> dict[str, str]:
    """Parameters that move for an effect of a size [unit]; where it is one, by how much for each unit of it."""
    names = dict.fromkeys((name.partition("@")[0] for name in moves), "")
    if len(moves) == 1 and size:
        (name, move), (k, shown) = next(iter(moves.items())), display_unit(unit)
        if (own := unit_of(base.diagram, name)) and shown:
            names[name] = f"{in_display_units(abs(move) / (k * size), own)} per {shown}"
    return names


def _names_with_a_place(diagnosed: DiagnosedPart, screened: SearchRound) -> set[str]:
    """The effects that have an insertion point in the model of a round."""
    settings, diagram = diagnosed.search.settings, screened.base.fitted_diagram
    effects = [one for one in diagnosed.search.effects if isinstance(one, Effect)]
    measured = next(iter(diagnosed.search.records.values())).units
    points = insertion_points(
        diagram, settings.outputs, effects, {one.candidate.block for one in diagnosed.named}, measured
    )
    units = {point: diagram.unit(point.signal) or measured.get(point.signal, "") for point in points}
    return {
        one.name
        for one in effects
        for point in points
        if (one.place, one.adds) == (point.place, point.adds) and acts_on(one, units[point])
    }
