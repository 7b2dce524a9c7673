"""Static effects of a signal: nonlinear characteristics, ripple."""

from __future__ import annotations

import math
from collections.abc import Mapping

import attrs
import numpy as np

from tsmblocks.blocks import AsymmetricGain, Bend, Bow, Ripple
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import PERCENT, Size, in_proportion, wave
from tsmblocks.effects.trials import Scales, Span, Trials
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


def _polynomial(p: Mapping[str, float], away: float) -> float:
    """The deviation of a nonlinear characteristic at a distance from its centre; missing powers are zero."""
    powers = (("quadratic", 2), ("cubic", 3), ("quartic", 4), ("quintic", 5))
    return sum(p.get(name, 0.0) * away**power for name, power in powers)


BENT_AT_ENDS = Size("added at the ends", lambda p, scales: _polynomial(p, scales.wire.reach))
BENT_AT_UPPER_END = Size("added at the upper end", lambda p, scales: _polynomial(p, scales.wire.high - p["centre"]))
BENT_AT_LOWER_END = Size("added at the lower end", lambda p, scales: _polynomial(p, scales.wire.low - p["centre"]))


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


def ripple_trials(span: Span, size: float, names: tuple[str, ...]) -> Trials:
    """Trial values of a ripple with more than one period in the range: less is a nonlinear characteristic.

    A signal whose unit is not known may be an angle in rad.
    """
    reach, once = span.reach, 2 * math.pi / (span.turn or 2 * math.pi)
    # A start that is off by a quarter of a period over the whole range converges to the right one.
    periods = (1.2, 1.35, 1.5, 1.75, *np.arange(2.0, MAX_PERIODS[len(names)], 0.5).tolist())
    shapes = tuple({"cycles": math.pi * n / reach} for n in periods)
    most = max(MAX_PERIODS.values()) * math.pi / reach
    turns = tuple({"cycles": n * once} for n in PER_TURN if n * once > most)  # over many turns of a motor
    bounds = {"cycles": (MIN_PERIODS * math.pi / reach, max(most, 1.1 * PER_TURN[-1] * once if turns else 0.0))}
    return Trials(dict.fromkeys(names, size), (*shapes, *turns), bounds=bounds, held_first=("cycles",))


def _position_ripple_trials(scales: Scales, names: tuple[str, ...]) -> Trials:
    return ripple_trials(scales.wire, CURVATURE_SHARE * scales.wire.reach, names)


def _asymmetric_gain_trials(scales: Scales) -> Trials | None:
    """None where the signal has hardly one of the two signs."""
    least = MIN_SHARE_OF_SIGN * scales.wire.reach
    return Trials({"difference": 0.05}) if min(scales.wire.high, -scales.wire.low) > least else None


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
    ASYMMETRIC_GAIN,
    in_front(ASYMMETRIC_GAIN),
    on_branch(ASYMMETRIC_GAIN),
    attrs.evolve(ASYMMETRIC_GAIN, place="drive", variant="drive"),
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
