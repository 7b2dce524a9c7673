"""The verdict of a diagnosis in a sentence or two."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import listed
from tsmblocks.diagnosis.decision import MIN_VARIANCE_REDUCTION
from tsmblocks.diagnosis.noise_floor import MAX_FINAL_FLOOR_RATIO
from tsmblocks.diagnosis.presentation import (
    by_removed,
    digits,
    display_unit,
    floor_text,
    in_display_units,
    main_sizes,
    open_scale,
    output_traces,
)
from tsmblocks.diagnosis.rejection import LEAVES_MORE, NOT_ACCEPTED
from tsmblocks.diagnosis.reported_gap import most_reduced, share_removed, variance_above_floor, worst_gap
from tsmblocks.diagnosis.result import Diagnosis
from tsmblocks.diagnosis.segment import Gap, NamedEffect, RankedCandidate, Segment
from tsmblocks.effects.sizes import MILLISECONDS
from tsmblocks.fitting.above_noise import MAX_FLOOR_RATIO
from tsmblocks.fitting.input_checks import runs_ahead

REMAINING_ERROR_RATIO = 1.1
"""Held-out rms over the noise floor from which a remaining error is reported. Chosen."""
MIN_UNEXPLAINED = 1.5
"""Rms of what named effects leave [noise floors], from which the verdict itself says so. Chosen: the half of its mean
square is slow noise, or a model error."""
NEARLY_ALL = 0.98
"""Share of the reduction by an effect that was named from which one that leaves more error explains nearly as much.
Chosen: no block has quite the form of a real mechanism."""
UNPREDICTED = "no function of the recorded signals that was tried predicts it"
LARGE_SHARE = 0.5
"""Share of the variance above the noise floor that an effect removes which was not named, from which a residual is not
called irregular. Chosen: the larger part of it."""
NOTHING_TO_REMOVE = "The error is within the noise: there is nothing above the noise floor to remove."
BESIDE = ", beside what noise of the inputs adds,"
"""What an error of whitened residuals is about."""
ALL_SHARE = 0.995
"""Share from which it is printed as 100 %."""


def verdict_sentence(segment: Segment) -> str:
    """The verdict on a segment in a sentence or two: sizes with confidence intervals, angles in degrees."""
    between = f"between {', '.join(segment.inputs) or 'the start'} and {', '.join(segment.outputs)}"
    ahead = _ahead(segment)
    if segment.verdict == "named":
        named = [f"{e.words} ({_size(e, segment)})" for e in segment.effects]
        effects = f"Unmodelled effect{'s' if len(named) > 1 else ''}"
        possible = _also_possible(segment)
        first = "" if segment.complete else "The named effects do not explain the whole residual. "
        possible += _nearly_as_good(segment) + _other_places(segment.effects) + _in_proportion(segment)
        doubt = _in_doubt(segment)
        return (
            f"{first}{effects} {between}: {listed(named, len(named))}.{_if_held(segment)} {possible} "
            f"{_reduction(segment)}{doubt}{ahead}"
        )
    if segment.verdict == "unknown":
        return (
            f"Unmodelled effect {between} that {_none_tried(segment)}: {_best(segment)}. {_error(segment)} "
            f"{_shape(segment)}{_in_doubt(segment)}{ahead}"
        )
    weak = (
        " There is a small residual above the noise floor, too small to name an effect with these data."
        if segment.excess > MIN_VARIANCE_REDUCTION
        else ""
    )
    noise = noise_or_model_error(segment)
    known = ", but not all of the residual is known to be noise" if noise else ""
    none = f"No unmodelled effect {between} is detectable with these data{known}."
    return f"{none} {_error(segment)}{noise or _outliers(worst_gap(segment)) or weak}{_implausible_floor(segment)}"


def alternatives(effect: NamedEffect) -> list[str]:
    """The effects, and the other forms of the same effect, that are indistinguishable from the one named."""
    return [
        *effect.also_possible,
        *(f"{effect.name} ({form})" if form else f"plain {effect.name}" for form in effect.other_forms),
    ]


def _also_possible(segment: Segment) -> str:
    """The sentence on effects that explain the residual as well; of several effects on each of them."""
    found = {e.block: alternatives(e) for e in segment.effects if alternatives(e)}
    if not found:
        return _no_other(segment)
    if len(segment.effects) == 1:
        return f"Also possible: {listed(next(iter(found.values())), 9)}."
    return f"Also possible: {'; '.join(f'{listed(names, 9)} instead of {block}' for block, names in found.items())}."


def _nearly_as_good(segment: Segment) -> str:
    """A sentence on effects that leave more error than one that was named, but little more."""
    found: list[str] = []
    for named in (one for one in segment.ranking if one.named):
        most = len(named.parameters) + 1  # what has more, such as many plays, comes near to anything
        others = (one for one in segment.ranking if one.round == named.round and one.why_not == LEAVES_MORE)
        found += [one.name for one in others if one.gain >= NEARLY_ALL * named.gain and len(one.parameters) <= most]
    known = {name for effect in segment.effects for name in (effect.name, *effect.also_possible)}
    names = [name for name in dict.fromkeys(found) if name not in known]
    return f" Nearly as good: {listed(names, 4)}." if names else ""


def _if_held(segment: Segment) -> str:
    """A sentence on each dead time that is another, beyond its interval, if an input is held between samples."""
    found = {effect.block: effect.parameters.get("time") for effect in segment.effects}
    return "".join(
        f" If {one.input} is held between samples (--hold {one.input}=zero), which fits as well, {one.block} is "
        f"{in_display_units(MILLISECONDS * one.time, 'ms')}."
        for one in segment.delays_if_held
        if not ((time := found.get(one.block)) and time.low <= one.time <= time.high)
    )


def _in_proportion(segment: Segment) -> str:
    """A sentence on each effect whose size is known in proportion to a parameter that is not determined."""
    found = {effect.block: open_scale(effect, segment) for effect in segment.effects}
    return "".join(
        f" The size of {block} is known in proportion to {scale} only, which these data do not determine."
        for block, scale in found.items()
        if scale
    )


def _best(segment: Segment) -> str:
    """The candidate that removes most, and why it was not named."""
    fitted = by_removed(r for r in segment.ranking if r.fitted and r.round == 1)
    if not fitted or not fitted[0].gain > 0:
        return "none removes any of the variance above the noise floor"
    first = fitted[0]
    share, reason = percent(first.share), f" ({first.why_not})" if first.why_not else ""
    return (
        f"the best, {candidate_title(first)}, removes {share or 'a part'} of the variance above the noise floor{reason}"
    )


def candidate_title(one: RankedCandidate) -> str:
    """Name and variant of a candidate."""
    return f"{one.name} ({one.variant})" if one.variant else one.name


def _other_places(effects: Sequence[NamedEffect]) -> str:
    """A sentence where some effects explain as much at another insertion point."""
    some = [e for e in effects if e.other_places]
    if not some:
        return ""
    if len(some) > 1:
        names = listed([e.block for e in some], len(some))
        return f" The places of {names} are not determined: they explain as much on other wires."
    (one,) = some
    return f" The place of {one.name} is not determined: it explains as much on {listed(one.other_places, 3)}."


def verdict_word(segment: Segment) -> str:
    """The verdict on a segment in a word or two: the same on a terminal, on pages and in files."""
    if segment.verdict != "named":
        return segment.verdict.capitalize()
    if not segment.complete:
        return "Named, incomplete"
    return "Named, rest unexplained" if leaves_unexplained(segment) else "Named"


def leaves_unexplained(segment: Segment) -> bool:
    """Whether the residual with the named effects is far above the noise floor and may be slow noise."""
    gap = most_reduced(segment)
    if gap.given or _outliers(gap) or _cause_at_inputs(segment):
        return False
    return bool(gap.rest >= MIN_UNEXPLAINED * gap.judged_floor > 0)


def _no_other(segment: Segment) -> str:
    """The sentence that no other effect explains the residual as well, with the number of effects tried."""
    count = len(set(segment.effects_tried) - {e.name for e in segment.effects})
    if count > 1:
        return f"None of the {count} other effects tried fits as well."
    return "The one other effect tried does not fit as well." if count else "No other effect was tried."


def _that(gap: Gap) -> str:
    """How a sentence on the size of the last residual begins."""
    share = percent(gap.outliers)
    return f"Without outliers, which hold {share} of its mean square, it is" if gap.outliers else "That is"


def _outliers(gap: Gap) -> str:
    """A remark on a residual above the noise floor that is within it without its outliers."""
    if not gap.outliers or not gap.judged[-1] > REMAINING_ERROR_RATIO * gap.judged_floor >= gap.rest:
        return ""
    return f" Outliers hold {percent(gap.outliers)} of its mean square; the rest is within the noise."


def _none_tried(segment: Segment) -> str:
    """The statement that no effect explains a residual, with the number of effects tried."""
    count = len(segment.effects_tried)
    return f"none of the {count} effects tried explains" if count > 1 else "the one effect tried does not explain"


def _shape(segment: Segment) -> str:
    """The signals that predict the residual, and the share that they predict."""
    if segment.varies_with:
        return f"The residual has a part in proportion to {segment.varies_with}."
    if segment.irregular:
        fitted = (r.share for r in segment.ranking if r.fitted and r.round == 1)
        if max(fitted, default=0.0) > LARGE_SHARE:  # one that could not be named does predict it
            return "The residual is too large for noise."
        cause = _cause_at_inputs(segment)
        large = f"it is too large for noise of the output; {cause}" if cause else "it is too large for noise"
        return f"The residual is irregular: {UNPREDICTED}, and {large}."
    gap = worst_gap(segment)
    share = percent(min(segment.predictable[1] * gap.judged[0] ** 2 / variance_above_floor(gap), 1.0))
    return f"Of the variance above the noise floor, {share} is predicted from the recorded signals on held-out data."


def noise_or_model_error(segment: Segment) -> str:
    """A remark on a residual above the noise floor that is not predicted: noise of its spectrum, or a model error."""
    gap = worst_gap(segment)
    if gap.given or not gap.rest > REMAINING_ERROR_RATIO * gap.judged_floor > 0:
        return ""
    ratio = to_digits(gap.rest / gap.judged_floor)
    if cause := _cause_at_inputs(segment):
        return f" {_that(gap)} {ratio} times the noise floor ({floor_text(gap)}): {cause}."
    return (
        f" {_that(gap)} {ratio} times the noise floor ({floor_text(gap)}), but "
        f"{UNPREDICTED} on held-out data: noise of that size and spectrum and a model error of a form that was not "
        "tried are indistinguishable."
    )


def _cause_at_inputs(segment: Segment) -> str:
    """Noise of the inputs that may be the cause of the residual; empty for none."""
    noise = [
        f"{in_display_units(one.rms, one.unit)} rms in {one.input}"
        + (f" ({100 * one.share:.2g} % of its deviation)" if np.isfinite(one.share) else "")
        for one in segment.noise_of_inputs
    ]
    if not noise:
        return ""
    return f"noise of {listed(noise, 3)} would cause as much. A model error of a form that was not tried might as well"


def _implausible_floor(segment: Segment) -> str:
    """A warning of a noise floor above the residual."""
    high = [g.output for g in segment.gaps if g.given and g.judged[0] * MAX_FLOOR_RATIO < g.judged_floor]
    return f" But the noise floor given for {listed(high, 3)} is implausible: the residual is smaller." if high else ""


def _ahead(segment: Segment) -> str:
    """A warning of an output that leads the input, from the first experiment where it does."""
    traces = (trace for output in segment.outputs for trace in output_traces(segment, output))
    warnings = (
        runs_ahead((t.drive_name, t.output), t.t, t.drive, t.measured, t.before) for t in traces if t.drive_name
    )
    words = next(filter(None, warnings), "")
    return f" But {words}" if words else ""


def _size(effect: NamedEffect, segment: Segment) -> str:
    block = "" if effect.block == effect.name else f" as block {effect.block}"
    return ", ".join([f"{effect.name}{block} on {effect.wire.strip()}", *main_sizes(effect, segment)])


def _reduction(segment: Segment) -> str:
    gap = most_reduced(segment)
    k, unit = display_unit(gap.unit)
    share = share_removed(gap)
    them = "it" if len(segment.effects) == 1 else "them"
    falls = (
        f"With {them}, the {_error_of(gap)} {_goes(gap)} from {digits(k * gap.judged[0])} to "
        f"{_rms(k * gap.judged[-1], unit)}"
    )
    floor, others = digits(k * gap.judged_floor), _other_outputs(segment, gap)
    if gap.judged[-1] * MAX_FINAL_FLOOR_RATIO < gap.judged_floor and not gap.given:
        return f"{falls}, below the noise floor estimated from {gap.method}, {floor}, which is too high.{others}"
    if gap.judged[-1] < REMAINING_ERROR_RATIO * gap.judged_floor or not gap.judged_floor > 0:
        # Else there is nothing that a share could be of; where more than noise is left, the floor does not measure it.
        above = segment.complete and gap.judged[0] > gap.judged_floor
        by = f", by {percent(share)} of the variance above the noise floor" if above else ""
        return f"{falls} (noise floor {floor}){by}.{others}"
    if segment.complete:
        # A share of what is above the floor would contradict it.
        return f"{falls}. {_noise_that_remains(gap, segment)}{others}"
    by = f", by {percent(share)} of the variance above the noise floor" if share < ALL_SHARE else ""
    return f"{falls} (noise floor {floor}){by}. {_remaining(segment, gap)}{others}"


def _other_outputs(segment: Segment, reported: Gap) -> str:
    """A sentence on the errors of the other outputs that were above their noise floor."""
    found = list[str]()
    for gap in segment.gaps:
        if gap is reported or not gap.judged[0] > REMAINING_ERROR_RATIO * gap.judged_floor > 0:
            continue
        k, unit = display_unit(gap.unit)
        before, floor = digits(k * gap.judged[0]), digits(k * gap.judged_floor)
        after = _rms(k * gap.judged[-1], unit)
        if after.partition(" ")[0] == before:
            continue
        error = f"error of {gap.output}{BESIDE if gap.whitened else ''}"
        found.append(f" The {error} {_goes(gap)} from {before} to {after} (noise floor {floor}).")
    return "".join(found)


def _goes(gap: Gap) -> str:
    """Whether the error of an output falls with the effects."""
    return "falls" if gap.judged[-1] <= gap.judged[0] else "grows"


def _error_of(gap: Gap) -> str:
    """The error of an output that a verdict is about, in words."""
    return f"error of {gap.output} on held-out data{BESIDE if gap.whitened else ''}"


def _noise_that_remains(gap: Gap, segment: Segment) -> str:
    """Why a model is complete that leaves more than the noise floor."""
    k, unit = display_unit(gap.unit)
    floor = f"{digits(k * gap.judged_floor)} {unit}".rstrip()
    if within := _outliers(gap):
        return within.lstrip()
    ratio = gap.rest / gap.judged_floor
    if cause := _cause_at_inputs(segment):
        return f"{_that(gap)} {ratio:.1f} times the noise floor of {floor} ({floor_text(gap)}): {cause}."
    return (
        f"{_that(gap)} {ratio:.1f} times the noise floor of {floor} ({floor_text(gap)}), but {UNPREDICTED} on "
        "held-out data: it is noise of that spectrum, or a model error of a form that was not tried."
    )


def _remaining(segment: Segment, gap: Gap) -> str:
    """A sentence on a residual above the noise floor that the effects do not explain."""
    further = by_removed(r for r in segment.ranking if r.round > len(segment.effects))
    still = f"That is still {gap.judged[-1] / gap.judged_floor:.1f} times the noise floor"
    if segment.stopped:
        return f"{still}: the search was stopped before every effect had been tried beside the named ones."
    small = next((r for r in further if r.why_not == NOT_ACCEPTED), None)
    if small is not None:
        one = len(segment.effects) == 1
        form = f"a slightly wrong form of {segment.effects[0].block}" if one else "slightly wrong forms of those named"
        removed = f"{percent(small.share) or 'a part'} of the rest"
        return (
            f"{still}. {candidate_title(small)} would remove {removed}; it is not named, since {form} may "
            "leave as much."
        )
    why = f"that {_none_tried(segment)}" if further else "that was not examined further"
    share = percent(segment.predictable[1])
    known = "" if segment.irregular else f", though the recorded signals predict {share} of its mean square"
    return f"{still}: a residual {why}{known}."


def _rms(value: float, unit: str) -> str:
    return " ".join(filter(None, (digits(value), unit, "rms")))


def _in_doubt(segment: Segment) -> str:
    """A sentence on parameters that were fitted far from the diagram's, beside a large error that is left."""
    if not segment.in_doubt:
        return ""
    one = ("was", "it", "its value there was a guess")
    verb, them, guess = one if len(segment.in_doubt) == 1 else ("were", "they", "their values there were guesses")
    sizes = ", and so may the sizes reported" if segment.effects else ""
    return (
        f" Beside this error, {listed(segment.in_doubt, 4)} {verb} fitted far from the diagram: unless {guess}, "
        f"{them} may compensate for what is missing{sizes}."
    )


def _error(segment: Segment) -> str:
    gap = worst_gap(segment)
    k, unit = display_unit(gap.unit)
    return f"The {_error_of(gap)} is {_rms(k * gap.judged[0], unit)}, its noise floor {digits(k * gap.judged_floor)}."


def segments_by_verdict(diagnosis: Diagnosis) -> list[Segment]:
    """The segments, those with effects first, then unknown ones."""
    order = {"named": 0, "unknown": 1, "none": 2}
    return sorted(diagnosis.segments, key=lambda s: order.get(s.verdict, 3))


def percent(share: float) -> str:
    """A share in percent, at most 100 %; empty where it has no meaning, and only its sign where the error grew."""
    if not np.isfinite(share):
        return ""
    return "< 0 %" if share < -0.005 else f"{100 * min(max(share, 0.0), 1.0):z.0f} %"


def in_table(share: float) -> str:
    """A share in percent in a table, where a dash means that it has no meaning."""
    return percent(share) or "-"


def nothing_to_remove(rows: Iterable[RankedCandidate]) -> str:
    """The remark on fitted candidates of a round none of whose shares has a meaning; empty for others."""
    return "" if any(np.isfinite(one.share) for one in rows) else NOTHING_TO_REMOVE
