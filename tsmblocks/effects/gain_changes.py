"""Changes of a gain over time: sudden ones, drifts, those that settle or end again, and by heat."""

from __future__ import annotations

import functools

import attrs

from tsmblocks import blocks
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.over_time import (
    AT,
    FROM_AND_UNTIL,
    INTERVAL,
    TIME_CONSTANT,
    duration,
    settling_trials,
    time_origin,
)
from tsmblocks.effects.sizes import MINUTE, PERCENT, Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials, instant_trials, interval_trials
from tsmblocks.effects.variants import across, in_front, of_element, on_branch, separate

CHANGE_OF_GAIN = in_proportion("change of the gain", "change", "%", PERCENT)


_CHANGE_OF_GAIN_TOO = in_proportion("change of the gain", "gain", "%", PERCENT)


def _heating_trials(scales: Scales) -> Trials | None:
    """Trial values of a change by heat, which is 1 where the signal stays at its rms value."""
    settling = settling_trials(lambda _: {"change": 0.05}, scales)
    if settling is None or scales.wire.rms == 0:
        return None
    bounds = {**settling.bounds, "heat": (0.0, None)}
    return Trials(settling.strengths, settling.shapes, {"scale": scales.wire.rms}, bounds)


def _loop_change_trials(scales: Scales) -> Trials:
    size = {"change": 0.03 * scales.wire.reach, "gain": 0.03}
    result = instant_trials(scales, size, {"distance": 0.15 * scales.wire.reach})
    return result.with_bounds({"distance": (0.01 * scales.wire.reach, scales.wire.reach), "z": (-1.0, 1.0)})


GAIN_CHANGE = Effect(
    "parameter_change",
    "time",
    "a sudden change of the gain",
    "output",
    blocks.GainChange(),
    {"change": 0.0},
    ("change", "time"),
    lambda scales: instant_trials(scales, {"change": 0.05}, {}),
    excites="the same inputs before and after it",
    confused=("drift", "jump", "creep"),
    separates="the same experiment before and after",
    variant="gain",
    sizes=(CHANGE_OF_GAIN, AT),
)
GAIN_DRIFT = attrs.evolve(
    GAIN_CHANGE,
    words="a gain that drifts",
    block=blocks.GainDrift(),
    null={"rate": 0.0},
    free=("rate",),
    trials=lambda scales: Trials({"rate": 0.05 / duration(scales)}, fixed=time_origin(scales)),
    variant="drift",
    sizes=(
        in_proportion("drift of the gain", "rate", "%/min", PERCENT * MINUTE),
        Size("over the shortest recording", lambda p, scales: PERCENT * p["rate"] * scales.shortest, "%"),
    ),
)
TEMPORARY_GAIN = attrs.evolve(
    GAIN_CHANGE,
    words="a temporary change of the gain",
    block=blocks.TemporaryGain(),
    free=("change", *INTERVAL),
    trials=lambda scales: interval_trials(scales, {"change": 0.05}),
    variant="temporary",
    sizes=(CHANGE_OF_GAIN, *FROM_AND_UNTIL),
)
GAIN_SETTLING = attrs.evolve(
    GAIN_CHANGE,
    words="a gain that changes and settles (warm-up)",
    block=blocks.SettlingGain(),
    free=("change", "time_constant"),
    trials=functools.partial(settling_trials, lambda _: {"change": 0.05}),
    variant="settling",
    within=("time_constant",),
    sizes=(CHANGE_OF_GAIN, TIME_CONSTANT),
)
GAIN_HEATED = attrs.evolve(
    GAIN_SETTLING,
    words="a gain that changes with self-heating",
    block=blocks.HeatedGain(),
    trials=_heating_trials,
    excites="high power for longer than the warm-up takes, after a start from cold",
    variant="heated",
    sizes=(in_proportion("change of the gain at the rms of its signal", "change", "%", PERCENT), TIME_CONSTANT),
)
GAIN_CHANGE_OF_INPUT = attrs.evolve(in_front(GAIN_CHANGE), variant="input, gain")
GAIN_CHANGE_OF_DRIVE = attrs.evolve(
    GAIN_CHANGE, words="a sudden change of the drive, or of the mass that it moves", place="drive", variant="drive"
)
LOOP_CHANGE = attrs.evolve(
    GAIN_CHANGE,
    words="a sudden change of the gain and the hysteresis",
    block=blocks.LoopChange(),
    null={"change": 0.0, "gain": 0.0},
    free=("change", "gain", "distance", "time"),
    trials=_loop_change_trials,
    variant="hysteresis",
    sizes=(Size("change of the loop's width", lambda p, _: -2 * p["change"]), _CHANGE_OF_GAIN_TOO, AT),
)
LOOP_CHANGE_OF_INPUT = across(LOOP_CHANGE, "loop", "hysteresis, by the input")
GAIN_CHANGES = (
    GAIN_CHANGE,
    separate(GAIN_CHANGE, "time"),
    GAIN_CHANGE_OF_INPUT,
    separate(GAIN_CHANGE_OF_INPUT, "time"),
    GAIN_CHANGE_OF_DRIVE,
    separate(GAIN_CHANGE_OF_DRIVE, "time"),
    on_branch(GAIN_CHANGE),
    separate(on_branch(GAIN_CHANGE), "time"),
    of_element(GAIN_CHANGE),
    separate(of_element(GAIN_CHANGE), "time"),
    of_element(GAIN_DRIFT),
    separate(of_element(GAIN_DRIFT)),
    of_element(GAIN_SETTLING),
    of_element(GAIN_HEATED),
    attrs.evolve(GAIN_HEATED, place="drive", variant="drive, heated"),
    on_branch(GAIN_HEATED),
    GAIN_DRIFT,
    separate(GAIN_DRIFT),
    attrs.evolve(in_front(GAIN_DRIFT), variant="input, drift"),
    on_branch(GAIN_DRIFT),
    separate(on_branch(GAIN_DRIFT)),
    TEMPORARY_GAIN,
    separate(TEMPORARY_GAIN, *INTERVAL),
    on_branch(TEMPORARY_GAIN),
    separate(on_branch(TEMPORARY_GAIN), *INTERVAL),
    GAIN_SETTLING,
    separate(GAIN_SETTLING),
    attrs.evolve(in_front(GAIN_SETTLING), variant="input, settling"),
    on_branch(GAIN_SETTLING),
    LOOP_CHANGE,
    separate(LOOP_CHANGE, "time"),
    LOOP_CHANGE_OF_INPUT,
    separate(LOOP_CHANGE_OF_INPUT, "loop.time"),
)
