"""Limits of a signal: slack, dead zones, saturations."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from types import SimpleNamespace

import attrs

from tsmblocks.blocks import DeadZone, Saturation, Slack, SoftDeadZone, SoftSaturation
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.maps import centres
from tsmblocks.effects.sizes import PERCENT, Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import in_front, on_branch

LIMITS = (in_proportion("lower limit", "low"), in_proportion("upper limit", "high"))
"""The ends of a saturation."""


def _behind(p: Mapping[str, float], u: float) -> float:
    """A value behind a soft saturation."""
    block = SoftSaturation(low=p["low"], high=p["high"], softness=p["softness"])
    return float(block.outputs(0.0, None, SimpleNamespace(u=u))["y"])


def _slope_lost(side: float, p: Mapping[str, float], scales: Scales) -> float:
    """By how much a soft saturation is flatter in the outer half than in the inner one [%], to one side of the middle.

    NaN where its limits cross, as they may within the interval of limits that are hardly determined.
    """
    if not p["low"] < p["high"]:
        return math.nan
    reach = side * scales.wire.reach
    none, half, whole = (_behind(p, scales.wire.middle + share * reach) for share in (0.0, 0.5, 1.0))
    return PERCENT * (1 - (whole - half) / (half - none))


def _cut_off(end: str, p: Mapping[str, float], scales: Scales) -> float:
    """By how much a soft saturation takes the end of the range back."""
    at = scales.wire.high if end == "high" else scales.wire.low
    return abs(at - _behind(p, at))


SLOPES_LOST = tuple(
    Size(f"slope lost towards the {end} end", functools.partial(_slope_lost, side), "%")
    for end, side in (("upper", 1.0), ("lower", -1.0))
)
"""How far a soft saturation bends at the ends of the range."""

ENDS = {"high": ("upper", LIMITS[1], SLOPES_LOST[0]), "low": ("lower", LIMITS[0], SLOPES_LOST[1])}
"""Limit -> the word for its end, it as a size, and the slope lost there."""


def _dead_zone_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    shapes = tuple({"low": -share * reach, "high": share * reach} for share in (0.01, 0.03, 0.1, 0.25))
    return Trials({}, shapes, bounds={"low": (-reach, 0.0), "high": (0.0, reach)})


def _soft_dead_zone_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    quarters = ({"centre": scales.wire.middle - reach / 2}, {"centre": scales.wire.middle + reach / 2})
    shapes = tuple(
        {"half_width": share * reach, "softness": 0.3 * share * reach, **centre}
        for shares, places in (((0.01, 0.03, 0.1, 0.25), centres(scales)), ((0.01, 0.1), quarters))
        for centre in places
        for share in shares
    )
    bounds = {
        "half_width": (0.0, reach),
        "softness": (1e-4 * reach, 0.5 * reach),
        "centre": (scales.wire.low, scales.wire.high),
    }
    return Trials({}, shapes, bounds=bounds)


def _saturation_trials(scales: Scales) -> Trials:
    wire = scales.wire
    margin = 0.02 * wire.reach
    sides = [(a, b) for share in (0.98, 0.9, 0.75, 0.55) for a, b in ((share, share), (share, 1.02), (1.02, share))]
    shapes = tuple({"low": wire.middle - a * wire.reach, "high": wire.middle + b * wire.reach} for a, b in sides)
    bounds = {"low": (wire.low - 2 * margin, wire.middle), "high": (wire.middle, wire.high + 2 * margin)}
    return Trials({}, shapes, bounds=bounds)


def _soft_saturation_trials(scales: Scales) -> Trials:
    wire, hard = scales.wire, _saturation_trials(scales)
    shapes = tuple({**shape, "softness": share * wire.reach} for shape in hard.shapes for share in (0.03, 0.12))
    limits = {"low": (wire.low - wire.reach, wire.middle), "high": (wire.middle, wire.high + wire.reach)}
    return Trials({}, shapes, bounds={**limits, "softness": (1e-3 * wire.reach, wire.reach)})


def _one_end_trials(end: str, scales: Scales) -> Trials:
    both, span = _soft_saturation_trials(scales), scales.wire
    limits = [span.middle + (1 if end == "high" else -1) * share * span.reach for share in (1.2, 0.98, 0.8, 0.6)]
    shapes = tuple({end: limit, "softness": share * span.reach} for limit in limits for share in (0.03, 0.12, 0.3))
    return Trials({}, shapes, bounds={name: both.bounds[name] for name in (end, "softness")})


def _slack(side: str) -> Effect:
    def trials(scales: Scales) -> Trials:
        low, high, reach = scales.wire.low, scales.wire.high, scales.wire.reach
        end, inwards = (low, reach) if side == "low" else (high, -reach)
        edges = tuple({"edge": end + share * inwards} for share in (0.2, 0.5, 0.8, 1.1, 1.5))
        return Trials({"share": 0.1}, edges, bounds={"edge": (low, high)})

    return Effect(
        "dead_zone",
        "map",
        f"slack at the {side} end",
        "output",
        Slack(side=side),
        {"share": 0.0},
        ("share", "edge"),
        trials,
        excites="motion into the slack range",
        confused=("even_nonlinearity", "position_ripple"),
        separates="a slow ramp over the full range; of a tendon, at two pretensions",
        variant=f"{side} end",
        contains=("asymmetric_gain",),
        sizes=(in_proportion("slope lost", "share", "%", PERCENT), in_proportion("edge", "edge")),
    )


SATURATION = Effect(
    "saturation",
    "map",
    "a saturation",
    "output",
    Saturation(low=-math.inf, high=math.inf),
    {"low": -math.inf, "high": math.inf},
    ("low", "high"),
    _saturation_trials,
    excites="large amplitudes",
    confused=("odd_nonlinearity", "rate_limit", "dead_zone"),
    separates="two amplitudes",
    variant="output",
    sizes=LIMITS,
)

SOFT_SATURATION = attrs.evolve(
    SATURATION,
    words="a soft saturation",
    block=SoftSaturation(low=-math.inf, high=math.inf),
    free=("low", "high", "softness"),
    trials=_soft_saturation_trials,
    variant="soft",
    sizes=(*SLOPES_LOST, *LIMITS),
)


def _soft_at(end: str, place: str) -> Effect:
    """A soft saturation at one end: of an amplifier, a pump or a spring that gives less and less."""
    word, limit, slope = ENDS[end]
    effect = attrs.evolve(
        SOFT_SATURATION,
        words=f"a soft saturation at the {word} end",
        null={end: SOFT_SATURATION.null[end]},
        free=(end, "softness"),
        trials=functools.partial(_one_end_trials, end),
        sizes=(Size(f"cut off at the {word} end", functools.partial(_cut_off, end)), limit, slope),
    )
    placed = in_front(effect) if place == "input" else effect
    return attrs.evolve(placed, place=place, variant=f"{place}, soft, {word} end".removeprefix("output, "))


SOFT_DEAD_ZONE = Effect(
    "dead_zone",
    "map",
    "a dead zone with rounded edges",
    "output",
    SoftDeadZone(half_width=0.0),
    {"half_width": 0.0},
    ("half_width", "centre", "softness"),
    _soft_dead_zone_trials,
    excites="motion through the zone and beyond it",
    confused=("odd_nonlinearity", "backlash"),
    separates="a slow ramp over the full range: a dead zone takes the same way back",
    variant="soft",
    below=("softness",),  # one as soft as that is a smooth characteristic
    within=("centre",),  # one that is half outside of the range is a saturation
    sharp=("softness",),
    sizes=(in_proportion("width", "half_width", factor=2.0), in_proportion("middle", "centre")),
)
EFFECTS = (
    _slack("low"),
    _slack("high"),
    Effect(
        "dead_zone",
        "map",
        "a dead zone",
        "drive",
        DeadZone(low=0.0, high=0.0),
        {"low": 0.0, "high": 0.0},
        ("low", "high"),
        _dead_zone_trials,
        excites="small and large drive",
        confused=("coulomb_friction",),
        separates="a slow ramp of the drive through zero",
        variant="drive",
        sizes=(
            Size("width", lambda p, _: p["high"] - p["low"]),
            Size("middle", lambda p, _: (p["high"] + p["low"]) / 2),
        ),
    ),
    SOFT_DEAD_ZONE,
    in_front(SOFT_DEAD_ZONE, "a dead zone in front of the model"),
    on_branch(SOFT_DEAD_ZONE),
    SATURATION,
    in_front(SATURATION),
    on_branch(SATURATION),
    attrs.evolve(SATURATION, place="drive", variant="drive"),
    SOFT_SATURATION,
    attrs.evolve(in_front(SOFT_SATURATION), variant="input, soft"),
    attrs.evolve(SOFT_SATURATION, place="drive", variant="soft drive"),
    *(_soft_at(end, place) for place in ("output", "input", "drive") for end in ENDS),
)
