"""What to do next where a residual is not explained, or where noise and a model error are indistinguishable."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsmblocks.common.rounding import to_digits
from tsmblocks.common.tables import listed
from tsmblocks.data.noise_methods import REPEATS
from tsmblocks.diagnosis.concentration import concentrations
from tsmblocks.diagnosis.insertion_points import is_speed
from tsmblocks.diagnosis.limits import NO_PLACE, NOT_EXCITED
from tsmblocks.diagnosis.presentation import in_display_units
from tsmblocks.diagnosis.segment import Gap, Segment
from tsmblocks.diagnosis.shift_in_time import COEFFICIENT, SHIFT_IN_TIME
from tsmblocks.diagnosis.verdict_text import leaves_unexplained, noise_or_model_error, percent
from tsmblocks.effects import catalogue
from tsmblocks.effects.maps import RIPPLE
from tsmblocks.effects.sizes import MILLISECONDS

MIN_OTHERS, ODD_RATIO = 2, 1.5
"""Number of other experiments at least, and error over the largest of theirs, from which one stands out. Chosen: noise
of one sensor varies by less."""
COMPARE_STRUCTURES = "Compare other structures of the model on these recordings: tsm.compare, or tsmblocks compare."
NOISE_RATIO = 5.0
"""Residual over the noise floor up to which the noise itself is worth knowing. Chosen: slow noise is rarely more."""
MIN_SHIFT_SHARE = 0.5
"""Share of the variance above the noise that a shift in time removes, from which it is named. Chosen: most of it."""
MAINLY_PREDICTED = 0.5
"""Share of a residual's mean square that is predicted from what was recorded, from which it is no disturbance. Chosen:
most of it."""
RECORD_CAUSES = (
    "If it does not repeat: record other possible causes (a load, a second input, the temperature, a supply)."
)
"""The next step where a disturbance that was not recorded may be the cause."""
REPEAT_BESIDE_DISTURBANCES = (
    "Record twice with the same inputs: a model error repeats, a disturbance that was not recorded does not."
)
"""The next step where a residual is too large for noise, and nothing predicts it."""
SHOW_SHAPE = "Record more data over the full range of the signals that predict the residual, to show its shape."
"""The next step where a coordinate of the motion predicts the residual."""

SEARCH_TO_THE_END = (
    "Let the search run to its end, or make it shorter: fewer effects (--effects), a part of the data (--window)."
)
"""The next step where the search was stopped before it was over."""


def next_steps(segment: Segment) -> list[str]:
    """Next steps where a residual is not explained, or where noise and a model error are indistinguishable.

    Empty where nothing is left to explain.
    """
    given = all(gap.given for gap in segment.gaps)
    repeat = "Record twice with the same inputs: a model error repeats, noise does not."
    floor = (
        "Give the noise of the sensor (--noise-floor, in Python noise_floor), from a recording at rest or from its "
        "data sheet."
    )
    alone = [] if segment.verdict == "named" and segment.complete else _odd_experiments(segment)
    alone += [] if segment.verdict == "none" or segment.complete else _short_parts(segment)
    if segment.verdict == "none":
        noise = _noise_of_inputs(segment) or ([] if given else [floor])
        repeated = any(gap.method == REPEATS for gap in segment.gaps)
        steps = [*([] if repeated else [repeat]), *noise, *_integrate_a_speed(segment)]
        return [*alone, *(steps if noise_or_model_error(segment) else [])]
    near = any(_remaining_ratio(gap) < NOISE_RATIO for gap in segment.gaps)
    if segment.complete:
        return [repeat, *([] if given else [floor])] if leaves_unexplained(segment) else []
    if segment.stopped:
        return [SEARCH_TO_THE_END, *([floor] if near and not given else [])]
    if segment.varies_with:
        return [*alone, *_where_a_factor_varies(segment)]
    if segment.irregular:
        noise = _noise_of_inputs(segment) or ([floor] if near and not given else [])
        return [*alone, REPEAT_BESIDE_DISTURBANCES, *noise, *_integrate_a_speed(segment), RECORD_CAUSES]
    return [
        *alone,
        *_others_to_try(segment),
        *_check_time_stamps(segment),
        *_integrate_a_speed(segment),
        COMPARE_STRUCTURES,
        *([SHOW_SHAPE] if segment.where else []),
        *([repeat, RECORD_CAUSES] if segment.predictable[-1] < MAINLY_PREDICTED else []),
        "Add an effect of your own to the catalogue (tsmblocks.effects.Effect), if its shape suggests one.",
    ]


def _noise_of_inputs(segment: Segment) -> list[str]:
    """What separates noise of the inputs from a model error; nothing where no input is noisy."""
    return [
        f"Measure the noise of {one.input}, at rest or with a second sensor: if it is less than "
        f"{in_display_units(one.rms, one.unit)} rms, the model lacks an effect."
        for one in segment.noise_of_inputs
    ]


def _where_a_factor_varies(segment: Segment) -> list[str]:
    """What is measured of a residual in proportion to the motion by a factor that varies, and what may be its cause."""
    gap = max(segment.gaps, key=_remaining_ratio)
    beside = f" ({_remaining_ratio(gap):.3g} times the noise floor)" if gap.judged_floor > 0 else ""
    return [
        f"The residual of {gap.output}{beside} has a part in proportion to {segment.varies_with}. Either a parameter "
        "varies over that time, or the model lacks a nonlinearity or has one of another form.",
        "Record what may make a parameter vary (a temperature, a preload, a supply), or repeat one motion without a "
        "pause.",
        COMPARE_STRUCTURES,
        *_filtering(segment),
    ]


def _filtering(segment: Segment) -> list[str]:
    """A remark on inputs out of which noise was filtered."""
    if not segment.filtered:
        return []
    return [
        f"Filtering of {listed(segment.filtered)} may leave a residual of that size as well: compare with "
        "--no-condition, in Python condition=False."
    ]


def _remaining_ratio(gap: Gap) -> float:
    """The held-out error of the last model [noise floors]."""
    return gap.judged[-1] / gap.judged_floor if gap.judged_floor > 0 else 0.0


def _others_to_try(segment: Segment) -> list[str]:
    """The effects of the catalogue that were not requested."""
    others = {one.name for one in catalogue()} - {m.name for m in segment.limits} - set(segment.effects_tried)
    if not others or not segment.limits:
        return []
    return [f"Try the other {len(others)} effects of the catalogue as well: diagnose without the option --effects."]


def _integrate_a_speed(segment: Segment) -> list[str]:
    """Where a speed is measured and the diagram has no position: what depends on the position was not tried."""
    speeds = [gap.output for gap in segment.gaps if is_speed(gap.unit)]
    missing = [one.name for one in segment.limits if one.name == RIPPLE.name and one.cause in (NO_PLACE, NOT_EXCITED)]
    if not speeds or not missing:
        return []
    return [
        f"Put an Integrator behind {speeds[0]} in the diagram: without a position, a ripple of the force over the "
        "position (cogging, torque ripple) was not tried."
    ]


def _check_time_stamps(segment: Segment) -> list[str]:
    """Where the residual is in proportion to the speed of a signal: the times of the recording may be wrong."""
    last = max((one.round for one in segment.ranking), default=0)
    shifted = [one for one in segment.ranking if one.round == last and one.why_not == SHIFT_IN_TIME]
    best = max(shifted, key=lambda one: one.share, default=None)
    if best is None or not best.share >= MIN_SHIFT_SHARE:
        return []
    shift, signal = best.parameters[COEFFICIENT], best.wire.rpartition(" ")[2]
    by = f"{to_digits(abs(shift) * MILLISECONDS, 2)} ms"
    way, cause = ("leads", "too long") if shift > 0 else ("lags behind", "missing or too short")
    return [
        f"Check the time stamps, and the delays of the diagram: {signal} {way} the model by about "
        f"{by} ({percent(best.share)} of the variance above the noise floor), as where channels are not sampled at "
        f"one instant, or a delay or a lag of the diagram is {cause}."
    ]


def _odd_experiments(segment: Segment) -> list[str]:
    """Experiments whose error is far from that of all others: something may have changed in one of them only."""
    found = dict[tuple[str, str], dict[str, float]]()
    for gap in segment.gaps:
        if gap.whitened:  # errors by noise of the inputs differ from experiment to experiment by chance
            continue
        rms = {name: errors[-1] for name, errors in gap.experiments.items()}
        odd = max(rms, key=lambda name: rms[name], default="")
        others = [value for name, value in rms.items() if name != odd]
        if len(others) >= MIN_OTHERS and rms[odd] > ODD_RATIO * max(others):
            # beside a large error of all, it is the motion of this one that excites what is missing
            known = max(others) <= ODD_RATIO * gap.judged_floor or not gap.judged_floor > 0
            why = "something may have changed in it" if known else "it excites most of what is missing, or it differs"
            found.setdefault((odd, why), {})[gap.output] = float(rms[odd] / np.median(others))
    return [_examine(odd, why, ratios) for (odd, why), ratios in found.items()]


def _short_parts(segment: Segment) -> list[str]:
    """Parts of recordings in which most of a residual lies: something may have acted only then."""
    floors = {gap.output: gap.judged_floor for gap in segment.gaps}
    return [
        f"Examine {one.experiment} between {to_digits(one.start, 4)} and {to_digits(one.stop, 4)} s: "
        f"{percent(one.share)} of the variance of {one.output} above the noise floor lies there. Something may have "
        "acted in that time only (a load, a contact, a parameter that changed and came back). Record it, or diagnose "
        "the data before it alone (--window)."
        for one in concentrations(segment.traces, floors)
    ]


def _examine(odd: str, why: str, ratios: Mapping[str, float]) -> str:
    """The step to examine an experiment: ``ratios`` are its errors over those of the others, by output."""
    outputs, times = listed(list(ratios)), listed([f"{one:.1f}" for one in ratios.values()])
    one, several = f"its error of {outputs} is {times} times that", f"its errors of {outputs} are {times} times those"
    errors = one if len(ratios) == 1 else several
    return f"Examine {odd} separately: {errors} of the other experiments, so {why} (a parameter, a load, a sensor)."
