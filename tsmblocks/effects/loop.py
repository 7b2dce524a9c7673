"""Effects of hysteresis: play and loops that a model lacks, or has with another shape."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tsmblocks.blocks import (
    CapstanFriction,
    LoopAsymmetry,
    NonlocalMemory,
    Play,
    PositionDependentLoop,
    Stretch,
    StribeckStretch,
)
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import across, in_front, on_branch, on_input, on_loop

PLAY_WIDTHS = (0.04, 0.15, 0.45)
"""Starting half widths of the plays of a nonlocal memory [half the range]. Chosen: a factor of three apart."""
MAX_PRETENSION = 10.0
"""Tension at the slack end of the motion, at most [half the range]. Chosen: the band is then as wide everywhere."""
_PLAYS = NonlocalMemory(weights=(0.0,) * len(PLAY_WIDTHS), radii=PLAY_WIDTHS)
_WEIGHTS, _RADII = (tuple(f"{name}[{k}]" for k in range(len(PLAY_WIDTHS))) for name in ("weights", "radii"))


def _backlash_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    widths = tuple({"half_width": share * reach} for share in (0.001, 0.003, 0.01, 0.03, 0.08, 0.2, 0.4))
    return Trials({}, widths, bounds={"half_width": (0.0, 5 * reach)})


def _capstan_trials(scales: Scales) -> Trials:
    """The tendon is slack at one end of the motion, or far from slack: then the band is as wide everywhere."""
    low, reach = scales.wire.low, scales.wire.reach
    shapes = tuple(
        {"pretension": tension * reach - low, "mu": width / (tension + 1)}
        for tension in (0.05, 0.4, 1.5)
        for width in (0.003, 0.01, 0.03, 0.08, 0.2)
    )
    bounds = {"mu": (0.0, 1.5), "pretension": (-0.5 * reach - low, MAX_PRETENSION * reach - low)}
    return Trials({}, shapes, bounds=bounds)


def _hysteresis_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    bounds = {"half_width": (0.0, reach), "distance": (3e-3 * reach, 2 * reach), "z": (-1.0, 1.0)}
    shapes = tuple({"distance": share * reach} for share in (0.03, 0.12, 0.4))
    return Trials({"half_width": 0.03 * reach}, shapes, bounds=bounds)


def _stribeck_trials(scales: Scales) -> Trials:
    plain, speed = _hysteresis_trials(scales), scales.wire.speed
    shapes = tuple({**shape, "speed": share * speed} for shape in plain.shapes for share in (0.1, 0.3, 0.8))
    size = plain.strengths["half_width"]
    bounds = {**plain.bounds, "breakaway": (0.0, scales.wire.reach), "speed": (0.02 * speed, 1.5 * speed)}
    return Trials({"half_width": size, "breakaway": size}, shapes, bounds=bounds)


def _asymmetry_trials(scales: Scales) -> Trials:
    wire, other = scales.wire, scales.other
    share = wire.reach / max(other.reach, 1e-12)
    shapes = tuple({"theta": bends / other.reach, "speed": 0.15 * other.speed} for bends in (1.5, 4.0, 10.0))
    bounds = {
        "theta": (0.3 / other.reach, 60 / other.reach),
        "speed": (0.01 * other.speed, 0.7 * other.speed),
        "z": (-wire.reach, wire.reach),
    }
    return Trials({"slope_difference": 0.03 * share, "delta": 0.05 * share}, shapes, bounds=bounds)


def _memory_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    wider, closer = (
        {name: factor * share * reach for name, share in zip(_RADII, PLAY_WIDTHS, strict=True)} for factor in (1.0, 0.5)
    )
    bounds = dict.fromkeys(_RADII, (0.003 * reach, 1.5 * reach))
    return Trials(dict.fromkeys(_WEIGHTS, 0.05), (wider, closer), bounds=bounds)


def _position_dependence_trials(scales: Scales) -> Trials:
    other = scales.other
    farthest = max(abs(other.low), abs(other.high))
    shapes = tuple({"distance": share * other.reach} for share in (0.03, 0.12, 0.4))
    bounds = {"distance": (3e-3 * other.reach, 2 * other.reach), "z": (-farthest, farthest)}
    return Trials({"gain": 0.03 * (scales.wire.reach / max(other.reach, 1e-12))}, shapes, bounds=bounds)


def _width_of_plays(parameters: Mapping[str, float], _: Scales) -> float:
    """The width that the plays give to a loop after long travel."""
    return 2 * sum(parameters[w] * parameters[r] for w, r in zip(_WEIGHTS, _RADII, strict=True))


def _capstan_width(parameters: Mapping[str, float], scales: Scales) -> float:
    """The width of the band in which friction holds the tendon in the middle of the motion."""
    return 2 * math.sinh(parameters["mu"] * parameters["angle"]) * (scales.wire.middle + parameters["pretension"])


LOOP_WIDTH = in_proportion("loop width", "half_width", factor=2.0)
"""The width of a loop after long travel, from its half."""
BACKLASH = Effect(
    "backlash",
    "loop",
    "a backlash gap",
    "output",
    Play(half_width=0.0),
    {"half_width": 0.0},
    ("half_width",),
    _backlash_trials,
    excites="reversals at two amplitudes or more",
    settled=("m",),
    confused=("nonlocal_memory", "hysteresis", "presliding_friction"),
    separates="two amplitudes, minor loops, or an odd multisine",
    sizes=(in_proportion("gap width", "half_width", factor=2.0),),
)
CAPSTAN = Effect(
    "capstan_friction",
    "loop",
    "friction in proportion to the tension (a tendon in its sheath)",
    "output",
    CapstanFriction(mu=0.0, angle=1.0),
    {"mu": 0.0},
    ("mu", "pretension"),
    _capstan_trials,
    excites="reversals at several positions, at two amplitudes or more",
    settled=("m",),
    confused=("position_dependent_friction", "backlash", "hysteresis"),
    separates="small reversals at several positions",
    within=("mu", "pretension"),
    contains=("backlash",),
    mechanical=True,
    sizes=(
        in_proportion("coefficient of friction times bend angle", "mu", ""),
        in_proportion("pretension", "pretension"),
        Size("loop width in the middle of the motion", _capstan_width),
    ),
)
MEMORY = Effect(
    "nonlocal_memory",
    "loop",
    "memory of earlier reversals (another shape of the loop)",
    "output",
    _PLAYS,
    dict.fromkeys(_WEIGHTS, 0.0),
    (*_WEIGHTS, *_RADII),
    _memory_trials,
    excites="small loops inside large ones",
    confused=("backlash", "creep", "asymmetric_hysteresis"),
    separates="a decaying triangle, or first-order reversal curves",
    variant="output",
    contains=("backlash",),
    sizes=(Size("loop width", _width_of_plays),),
)
ASYMMETRY = Effect(
    "asymmetric_hysteresis",
    "loop",
    "hysteresis that differs between loading and unloading",
    "across",
    LoopAsymmetry(),
    {"slope_difference": 0.0, "delta": 0.0},
    ("slope_difference", "delta", "theta", "speed"),
    _asymmetry_trials,
    excites="full loops to both ends",
    confused=("even_nonlinearity", "position_dependent_friction"),
    separates="full loops to both ends and small loops at several positions",
    within=("speed",),
    sizes=(
        in_proportion("slope difference", "slope_difference", "{u}/{x}"),
        Size("shift after long travel", lambda p, _: p["delta"] / p["theta"]),
    ),
)
POSITION_DEPENDENCE = Effect(
    "position_dependent_friction",
    "loop",
    "hysteresis whose width depends on the position",
    "across",
    PositionDependentLoop(),
    {"gain": 0.0},
    ("gain", "distance"),
    _position_dependence_trials,
    excites="small reversals at several positions",
    confused=("asymmetric_hysteresis", "even_nonlinearity"),
    separates="a staircase with small reversals at several positions",
    within=("distance",),
    sizes=(
        in_proportion("loop width per position", "gain", "{u}/{x}", -2.0),  # of a loop that trails, as friction does
        in_proportion("travel over which the loop reverses", "distance", "{x}"),
    ),
)
HYSTERESIS = Effect(
    "hysteresis",
    "loop",
    "hysteresis",
    "output",
    Stretch(),
    {"half_width": 0.0},
    ("half_width", "distance"),
    _hysteresis_trials,
    excites="reversals",
    confused=("backlash", "nonlocal_memory"),
    separates="minor loops of several sizes: a gap has a plateau of one width, hysteresis bends",
    within=("distance",),
    sizes=(LOOP_WIDTH, in_proportion("travel over which the loop reverses", "distance")),
)
STRIBECK = Effect(
    "stribeck_friction",
    "friction",
    "hysteresis that narrows with the speed (Stribeck friction)",
    "output",
    StribeckStretch(),
    {"half_width": 0.0, "breakaway": 0.0},
    ("half_width", "breakaway", "speed", "distance"),
    _stribeck_trials,
    excites="reversals, and very slow motion beside fast motion",
    confused=("hysteresis", "rate_dependence"),
    separates="the same loop at three speeds or more",
    variant="transmission",
    within=("distance", "speed"),
    contains=("hysteresis",),
    mechanical=True,
    sizes=(
        LOOP_WIDTH,
        in_proportion("additional width at low speed", "breakaway", factor=2.0),
        in_proportion("Stribeck speed", "speed", "{u}/s"),
    ),
)
EFFECTS = (
    BACKLASH,
    in_front(BACKLASH, "a backlash gap in front of the model"),
    on_loop(BACKLASH),
    HYSTERESIS,
    in_front(HYSTERESIS, "hysteresis in front of the model"),
    on_branch(HYSTERESIS),
    on_loop(HYSTERESIS),
    STRIBECK,
    in_front(STRIBECK, "hysteresis that narrows with the speed, in front of the model"),
    ASYMMETRY,
    on_input(ASYMMETRY, "loop"),
    CAPSTAN,
    in_front(CAPSTAN, "friction in proportion to the tension (a tendon in its sheath), in front of the model"),
    MEMORY,
    in_front(MEMORY, "hysteresis with memory of earlier reversals (plays of several widths), in front of the model"),
    across(MEMORY, "memory", "by the input"),
    POSITION_DEPENDENCE,
    on_input(POSITION_DEPENDENCE, "loop"),
)
