"""Effects of time: drift, jumps, creep, periodic disturbances; and limits of the rate."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import attrs

from tsmblocks import blocks
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.friction import CHANGES
from tsmblocks.effects.gain_changes import GAIN_CHANGES
from tsmblocks.effects.over_time import (
    AT,
    FROM_AND_UNTIL,
    INTERVAL,
    TIME_CONSTANT,
    duration,
    settling_trials,
    time_origin,
)
from tsmblocks.effects.sizes import MINUTE, PERCENT, Size, in_proportion, wave
from tsmblocks.effects.trials import Scales, Trials, instant_trials, interval_trials
from tsmblocks.effects.variants import in_front, separate

NO_LIMIT = 1e12
"""A rate that no signal reaches. Chosen: finite, since an infinite rate times a step of zero is NaN."""

LEAST_PERIODS = 2
"""Periods of a disturbance that a session holds, at least. Derived: a longer period and a drift are
indistinguishable."""


def _drift_trials(scales: Scales) -> Trials:
    length, size = duration(scales), 0.02 * scales.wire.reach
    return Trials({"rate": size / length, "curve": size / length**2}, fixed=time_origin(scales))


def _creep_trials(scales: Scales) -> Trials | None:
    longest, least = scales.shortest, max(1.0, 40 * scales.step)  # slower creep acts as an offset of each experiment
    times = [least * times for times in (1.0, 3.0, 10.0, 30.0) if least * times < longest]
    bounds = {"time_constant": (20 * scales.step, longest), "share": (-0.9, 0.9)}
    return Trials({"share": 0.05}, tuple({"time_constant": time} for time in times), bounds=bounds) if times else None


def _broad_creep_trials(scales: Scales) -> Trials | None:
    least, most = 10 * scales.step, scales.shortest / 50
    if least >= most:
        return None
    bounds = {"fastest": (least, most), "share": (-0.9, 0.9)}
    slowest = {"slowest": 2 * scales.shortest}  # slower creep is indistinguishable from an offset
    return Trials({"share": 0.05}, ({"fastest": math.sqrt(least * most)},), slowest, bounds)


def _periodic_trials(scales: Scales) -> Trials | None:
    slowest = LEAST_PERIODS / duration(scales)
    frequencies = tuple({"frequency": f} for f in scales.lines if slowest <= f)
    if not frequencies:
        return None
    fastest = max(scales.lines) + slowest  # clear of a line at half of the sampling rate
    size, bounds = 0.01 * (scales.wire.reach or 1.0), {"frequency": (slowest, fastest)}
    return Trials({"cosine": size, "sine": size}, frequencies, time_origin(scales), bounds)


def _rate_limit_trials(scales: Scales) -> Trials:
    fastest = scales.wire.fastest
    limits = [share * fastest for share in (0.9, 0.7, 0.5, 0.35, 0.25, 0.15)]
    bounds = {"rising": (0.02 * fastest, 3 * fastest), "falling": (-3 * fastest, -0.02 * fastest)}
    return Trials({}, tuple({"rising": limit, "falling": -limit} for limit in limits), bounds=bounds)


def _soft_rate_limit_trials(scales: Scales) -> Trials:
    hard, fastest = _rate_limit_trials(scales), scales.wire.fastest
    shapes = tuple({**shape, "softness": 0.1 * fastest, "lag": 3 * scales.step} for shape in hard.shapes)
    soft = {"softness": (1e-3 * fastest, 0.5 * fastest), "lag": (0.3 * scales.step, 30 * scales.step)}
    return Trials({}, shapes, bounds={**hard.bounds, **soft})


def _whole_drift(p: Mapping[str, float], scales: Scales) -> float:
    """The drift from the first sample to the last."""
    length = duration(scales)
    return p["rate"] * length + p["curve"] * length**2


CREPT = in_proportion("share of creep", "share", "%", PERCENT)
DRIFT = Effect(
    "drift",
    "time",
    "a drift",
    "output",
    blocks.Drift(),
    {"rate": 0.0, "curve": 0.0},
    ("rate", "curve"),
    _drift_trials,
    excites="a long session on one clock",
    confused=("jump", "creep", "parameter_change"),
    separates="the first experiment repeated at the end",
    sizes=(Size("total drift", _whole_drift), in_proportion("initial drift rate", "rate", "{u}/min", MINUTE)),
)
STEADY_DRIFT = attrs.evolve(
    DRIFT,
    null={"rate": 0.0},
    free=("rate",),
    trials=lambda scales: Trials({"rate": 0.02 * scales.wire.reach / duration(scales)}, fixed=time_origin(scales)),
    variant="steady",
)
SETTLING_OFFSET = attrs.evolve(
    DRIFT,
    words="a drift that settles (warm-up)",
    block=blocks.SettlingOffset(),
    null={"size": 0.0},
    free=("size", "time_constant"),
    trials=functools.partial(settling_trials, lambda scales: {"size": 0.02 * scales.wire.reach}),
    variant="settling",
    within=("time_constant",),
    sizes=(in_proportion("offset in the end", "size"), TIME_CONSTANT),
)
JUMP = Effect(
    "jump",
    "time",
    "a jump (lost counts)",
    "output",
    blocks.Jump(),
    {"size": 0.0},
    ("size", "time"),
    lambda scales: instant_trials(scales, {"size": 0.02 * scales.wire.reach}, {}),
    excites="samples before and after it",
    confused=("drift", "parameter_change"),
    separates="a reference mark passed again",
    sizes=(in_proportion("jump", "size"), AT),
)
LOAD_STEP = attrs.evolve(
    JUMP,
    words="a step of the load",
    other_words=dict.fromkeys(("position", "speed"), "a step of the command"),
    place="drive",
    confused=("load_offset", "periodic_disturbance"),
    separates="the same inputs without the load",
    variant="drive",
)
FLOW_STEP = attrs.evolve(
    LOAD_STEP,
    words="a flow (or a force) that begins, or ends",
    other_words={},
    place="balance",
    separates="the same inputs again, without it",
    variant="balance",
)
TEMPORARY_OFFSET = attrs.evolve(
    JUMP,
    words="a temporary offset",
    block=blocks.TemporaryOffset(),
    free=("size", *INTERVAL),
    trials=lambda scales: interval_trials(scales, {"size": 0.02 * scales.wire.reach}),
    separates="the same inputs again: it does not come back",
    variant="temporary",
    sizes=(in_proportion("offset", "size"), *FROM_AND_UNTIL),
)
TEMPORARY_LOAD = attrs.evolve(TEMPORARY_OFFSET, words="a temporary load", place="drive", variant="drive, temporary")
TEMPORARY_FLOW = attrs.evolve(
    TEMPORARY_OFFSET, words="a temporary flow (or force)", place="balance", variant="balance, temporary"
)
CREEP = Effect(
    "creep",
    "time",
    "creep",
    "output",
    blocks.Creep(),
    {"share": 0.0},
    ("share", "time_constant"),
    _creep_trials,
    excites="pauses after motion, or an offset",
    confused=("rate_dependence", "drift", "nonlocal_memory"),
    separates="a staircase with pauses of 30 s",
    settled=("late",),
    within=("time_constant",),
    sizes=(CREPT, TIME_CONSTANT),
)
DISTURBANCE = Effect(
    "periodic_disturbance",
    "time",
    "a disturbance at a fixed frequency",
    "output",
    blocks.Disturbance(),
    {"cosine": 0.0, "sine": 0.0},
    ("cosine", "sine", "frequency"),
    _periodic_trials,
    excites="a long record",
    confused=("position_ripple",),
    separates="other input frequencies: the frequency of a disturbance stays the same",
    variant="output",
    within=("frequency",),
    sizes=(wave(), in_proportion("frequency", "frequency", "Hz")),
)
DRIVE_DISTURBANCE = attrs.evolve(DISTURBANCE, place="drive", variant="drive")
RATE_LIMIT = Effect(
    "rate_limit",
    "limit",
    "a rate limit",
    "output",
    blocks.RateLimit(rising=NO_LIMIT, falling=-NO_LIMIT),
    {"rising": NO_LIMIT, "falling": -NO_LIMIT},
    ("rising", "falling"),
    _rate_limit_trials,
    excites="fast motion",
    confused=("saturation", "rate_dependence"),
    separates="one amplitude at rising frequencies",
    variant="output",
    sizes=(in_proportion("fastest rise", "rising", "{u}/s"), in_proportion("fastest fall", "falling", "{u}/s", -1.0)),
)
SOFT_RATE_LIMIT = attrs.evolve(
    RATE_LIMIT,
    words="a soft rate limit",
    block=blocks.SoftRateLimit(rising=NO_LIMIT, falling=-NO_LIMIT),
    free=("rising", "falling", "softness", "lag"),
    trials=_soft_rate_limit_trials,
    variant="soft",
    below=("softness",),
)
EFFECTS = (
    DRIFT,
    attrs.evolve(separate(DRIFT), sizes=DRIFT.sizes[1:]),  # no total: each recording has its length
    STEADY_DRIFT,
    SETTLING_OFFSET,
    separate(SETTLING_OFFSET),
    JUMP,
    separate(JUMP, "time"),
    LOAD_STEP,
    separate(LOAD_STEP, "time"),
    FLOW_STEP,
    separate(FLOW_STEP, "time"),
    TEMPORARY_OFFSET,
    separate(TEMPORARY_OFFSET, *INTERVAL),
    TEMPORARY_LOAD,
    separate(TEMPORARY_LOAD, *INTERVAL),
    TEMPORARY_FLOW,
    separate(TEMPORARY_FLOW, *INTERVAL),
    *GAIN_CHANGES,
    *CHANGES,
    CREEP,
    attrs.evolve(
        CREEP,
        words="creep over decades of time",
        block=blocks.BroadCreep(),
        free=("share", "fastest"),
        trials=_broad_creep_trials,
        variant="broad",
        settled=("late1", "late2", "late3", "late4"),
        within=(),
        sizes=(CREPT, in_proportion("shortest time constant", "fastest", "s")),
    ),
    DISTURBANCE,
    separate(DISTURBANCE),
    DRIVE_DISTURBANCE,
    attrs.evolve(DRIVE_DISTURBANCE, place="balance", variant="balance"),
    separate(DRIVE_DISTURBANCE),
    RATE_LIMIT,
    attrs.evolve(RATE_LIMIT, place="drive", variant="drive"),
    SOFT_RATE_LIMIT,
    in_front(SOFT_RATE_LIMIT, "a soft rate limit in front of the model"),
)
