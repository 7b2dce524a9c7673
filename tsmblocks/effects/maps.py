"""Static effects of a signal: slack, saturation, nonlinear characteristics, ripple."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from types import SimpleNamespace

import attrs
import numpy as np

from tsmblocks.blocks import (
    AsymmetricGain,
    Bend,
    Bow,
    DeadZone,
    Ripple,
    Saturation,
    Slack,
    SoftDeadZone,
    SoftSaturation,
)
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import PERCENT, Size, in_proportion, wave
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import in_front, on_branch

CURVATURE_SHARE = 0.02
"""Trial deviation from a straight line at the ends, as a share of half the range. Chosen."""

FARTHEST_CENTRE = 4.0
"""Distance of the centre of a curve from the range, at most [half the range]. Chosen: farther off it is a slope."""
MIN_PERIODS = 1.15
"""Periods of a ripple in the range of motion, at least. Chosen: fewer are a nonlinear characteristic."""
MAX_PERIODS = {2: 40.0, 4: 20.0}
"""The same at most, by the number of amplitudes. Chosen: 80 simulations for each of two."""
PER_TURN = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 16, 18, 20, 21, 22, 24, 28, 30, 36)
"""Periods of a ripple in a turn that are tried over a motion of many turns, where the position is an angle: pole pairs,
slots, commutations. Chosen."""
ONE_HARMONIC, TWO_HARMONICS = ("cosine", "sine"), ("cosine", "sine", "cosine2", "sine2")
"""Names of the amplitudes of a ripple with one harmonic, and with two."""
MIN_SHARE_OF_SIGN = 0.1
"""Least extent of a signal to either side of zero for a gain that differs by sign [half the range]. Chosen: less is an
end of the range."""


PERIOD_OF_RIPPLE = Size("period", lambda p, _: 2 * math.pi / p["cycles"])
"""The distance from crest to crest."""
LIMITS = (in_proportion("lower limit", "low"), in_proportion("upper limit", "high"))
"""The ends of a saturation."""


def _slope_lost(side: float, p: Mapping[str, float], scales: Scales) -> float:
    """By how much a soft saturation is flatter in the outer half than in the inner one [%], to one side of the middle.

    NaN where its limits cross, as they may within the interval of limits that are hardly determined.
    """
    if not p["low"] < p["high"]:
        return math.nan
    block = SoftSaturation(low=p["low"], high=p["high"], softness=p["softness"])
    none, half, whole = (
        float(block.outputs(0.0, None, SimpleNamespace(u=scales.wire.middle + side * share * scales.wire.reach))["y"])
        for share in (0.0, 0.5, 1.0)
    )
    return PERCENT * (1 - (whole - half) / (half - none))


SLOPES_LOST = tuple(
    Size(f"slope lost at the {end} end", functools.partial(_slope_lost, side), "%")
    for end, side in (("upper", 1.0), ("lower", -1.0))
)
"""How far a soft saturation bends at the ends of the range."""


def _polynomial(p: Mapping[str, float], away: float) -> float:
    """The deviation of a nonlinear characteristic at a distance from its centre; missing powers are zero."""
    powers = (("quadratic", 2), ("cubic", 3), ("quartic", 4), ("quintic", 5))
    return sum(p.get(name, 0.0) * away**power for name, power in powers)


BENT_AT_ENDS = Size("added at the ends", lambda p, scales: _polynomial(p, scales.wire.reach))
BENT_AT_UPPER_END = Size("added at the upper end", lambda p, scales: _polynomial(p, scales.wire.high - p["centre"]))
BENT_AT_LOWER_END = Size("added at the lower end", lambda p, scales: _polynomial(p, scales.wire.low - p["centre"]))


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


def _even_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    size = {"quadratic": CURVATURE_SHARE / reach, "quartic": CURVATURE_SHARE / reach**3}
    return Trials(size, fixed={"centre": scales.wire.middle})


def _curved_trials(scales: Scales) -> Trials:
    low, high, reach = scales.wire.low, scales.wire.high, scales.wire.reach
    shapes = tuple({"centre": low + share * (high - low)} for share in (0.0, 0.5, 1.0))
    farthest = FARTHEST_CENTRE * reach
    return Trials({"quadratic": CURVATURE_SHARE / reach}, shapes, bounds={"centre": (low - farthest, high + farthest)})


def _odd_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    size = {"cubic": CURVATURE_SHARE / reach**2, "quintic": CURVATURE_SHARE / reach**4}
    return Trials(size, centres(scales), bounds={"centre": (scales.wire.low, scales.wire.high)})


def centres(scales: Scales) -> tuple[dict[str, float], ...]:
    """Centres of a characteristic: the middle of the range, and zero where the signal passes it."""
    middle = {"centre": scales.wire.middle}
    passes = scales.wire.low < 0 < scales.wire.high and abs(scales.wire.middle) > 0.02 * scales.wire.reach
    return (middle, {"centre": 0.0}) if passes else (middle,)


def _bow_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    shapes = tuple({"width": share * reach, **centre} for share in (0.12, 0.3, 0.7) for centre in centres(scales))
    bounds = {"width": (0.03 * reach, 2 * reach), "centre": (scales.wire.low, scales.wire.high)}
    return Trials({"size": CURVATURE_SHARE * reach}, shapes, bounds=bounds)


def ripple_trials(reach: float, size: float, names: tuple[str, ...]) -> Trials:
    """Trial values of a ripple with more than one period in the range: less is a nonlinear characteristic."""
    # A start that is off by a quarter of a period over the whole range converges to the right one.
    periods = (1.2, 1.35, 1.5, 1.75, *np.arange(2.0, MAX_PERIODS[len(names)], 0.5).tolist())
    shapes = tuple({"cycles": math.pi * n / reach} for n in periods)
    most = max(MAX_PERIODS.values()) * math.pi / reach
    turns = tuple({"cycles": float(n)} for n in PER_TURN if n > most)  # over many turns of a motor
    bounds = {"cycles": (MIN_PERIODS * math.pi / reach, max(most, 1.1 * PER_TURN[-1] if turns else 0.0))}
    return Trials(dict.fromkeys(names, size), (*shapes, *turns), bounds=bounds, held_first=("cycles",))


def _position_ripple_trials(scales: Scales, names: tuple[str, ...]) -> Trials:
    return ripple_trials(scales.wire.reach, CURVATURE_SHARE * scales.wire.reach, names)


def _asymmetric_gain_trials(scales: Scales) -> Trials | None:
    """None where the signal has hardly one of the two signs."""
    least = MIN_SHARE_OF_SIGN * scales.wire.reach
    return Trials({"difference": 0.05}) if min(scales.wire.high, -scales.wire.low) > least else None


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


ASYMMETRIC_GAIN = Effect(
    "asymmetric_gain",
    "map",
    "a gain that differs between positive and negative values",
    "output",
    AsymmetricGain(),
    {"difference": 0.0},
    ("difference",),
    _asymmetric_gain_trials,
    excites="motion to both sides of zero",
    confused=("even_nonlinearity", "dead_zone"),
    separates="slow ramps to both sides of zero",
    variant="output",
    sizes=(in_proportion("gain above zero less that below", "difference", "%", PERCENT),),
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
ODD = Effect(
    "odd_nonlinearity",
    "map",
    "an odd nonlinear characteristic (the ends bend opposite ways)",
    "output",
    Bend(),
    {"cubic": 0.0, "quintic": 0.0},
    ("cubic", "quintic", "centre"),
    _odd_trials,
    excites="large and small amplitudes",
    confused=("saturation", "position_ripple"),
    separates="a slow ramp over the full range",
    sizes=(BENT_AT_UPPER_END, BENT_AT_LOWER_END),
)
EVEN = Effect(
    "even_nonlinearity",
    "map",
    "an even nonlinear characteristic (both ends bend the same way)",
    "output",
    Bend(),
    {"quadratic": 0.0, "quartic": 0.0},
    ("quadratic", "quartic"),
    _even_trials,
    excites="the full range",
    confused=("dead_zone", "asymmetric_hysteresis", "position_ripple"),
    separates="a slow ramp over the full range",
    sizes=(BENT_AT_ENDS,),
)
CURVED = attrs.evolve(
    EVEN,
    words="a characteristic whose slope changes steadily over the range",
    null={"quadratic": 0.0},
    free=("quadratic", "centre"),
    trials=_curved_trials,
    variant="free centre",
    sizes=(
        BENT_AT_ENDS,
        Size(
            "slope at the upper end less that at the lower",
            lambda p, scales: PERCENT * 2 * p["quadratic"] * (scales.wire.high - scales.wire.low),
            "%",
        ),
        in_proportion("value at which it adds nothing", "centre"),
    ),
)
RIPPLE = Effect(
    "position_ripple",
    "map",
    "a ripple over the position (eccentricity)",
    "output",
    Ripple(),
    dict.fromkeys(ONE_HARMONIC, 0.0),
    (*ONE_HARMONIC, "cycles"),
    lambda scales: _position_ripple_trials(scales, ONE_HARMONIC),
    excites="slow motion over several periods",
    confused=("dead_zone", "even_nonlinearity", "odd_nonlinearity"),
    separates="slow constant speed over three periods or more",
    within=("cycles",),
    sizes=(
        wave(),
        PERIOD_OF_RIPPLE,
        Size("position of a crest", lambda p, _: math.atan2(p["sine"], p["cosine"]) / p["cycles"]),
    ),
    other_words=dict.fromkeys(("speed", "other"), "a ripple over the value of the signal"),
    of_motion=True,
)
EFFECTS = (
    _slack("low"),
    _slack("high"),
    ASYMMETRIC_GAIN,
    in_front(ASYMMETRIC_GAIN),
    on_branch(ASYMMETRIC_GAIN),
    attrs.evolve(ASYMMETRIC_GAIN, place="drive", variant="drive"),
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
    EVEN,
    in_front(EVEN),
    on_branch(EVEN),
    CURVED,
    on_branch(CURVED),
    ODD,
    in_front(ODD),
    on_branch(ODD),
    attrs.evolve(
        ODD,
        words="a characteristic whose slope differs between the middle and the ends",
        block=Bow(),
        null={"size": 0.0},
        free=("size", "width", "centre"),
        trials=_bow_trials,
        variant="middle and ends",
        sizes=(
            Size("slope added in the middle", lambda p, _: PERCENT * p["size"] / p["width"], "%"),
            in_proportion("half width of the middle", "width"),
        ),
    ),
    RIPPLE,
    in_front(RIPPLE),
    attrs.evolve(
        RIPPLE,
        null=dict.fromkeys(TWO_HARMONICS, 0.0),
        free=(*TWO_HARMONICS, "cycles"),
        trials=lambda scales: _position_ripple_trials(scales, TWO_HARMONICS),
        variant="two harmonics",
        sizes=(wave(), PERIOD_OF_RIPPLE, wave("cosine2", "sine2", "amplitude of the second harmonic")),
    ),
)
