"""Static effects: slack, saturation, nonlinear characteristics, ripple, an offset of the load."""

from __future__ import annotations

import math

from tsmblocks.blocks import Bend, Bias, Bow, DeadZone, Gain, Ripple, Saturation, Slack, SoftSaturation, Sum
from tsmblocks.effects.effect import Effect, Scales, Trials
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

CURVATURE_SHARE = 0.02
"""Trial deviation from a straight line at the ends, as a share of half the range. Chosen."""

MIN_PERIODS = 1.15
"""Periods of a ripple in the range of motion, at least. Chosen: less is a nonlinear characteristic."""

ONE_HARMONIC, TWO_HARMONICS = ("cosine", "sine"), ("cosine", "sine", "cosine2", "sine2")
"""Names of the amplitudes of a ripple with one harmonic, and with two."""


def _slack(side: str) -> Effect:
    def trials(scales: Scales) -> Trials:
        low, reach, sign = scales.wire.low, scales.wire.reach, 1 if side == "low" else -1
        end = low if side == "low" else scales.wire.high
        edges = tuple({"edge": end + sign * share * reach} for share in (0.2, 0.5, 0.8, 1.1, 1.5))
        return Trials({"share": 0.1}, edges, bounds={"edge": (low, scales.wire.high)})

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
        separates="a slow ramp over the full range, at two pretensions",
        variant=side,
    )


def _dead_zone_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    shapes = tuple({"low": -share * reach, "high": share * reach} for share in (0.01, 0.03, 0.1, 0.25))
    return Trials({}, shapes, bounds={"low": (-reach, 0.0), "high": (0.0, reach)})


def _saturation_trials(scales: Scales) -> Trials:
    wire = scales.wire
    margin = 0.02 * wire.reach
    sides = [(a, b) for share in (0.98, 0.9, 0.75, 0.55) for a, b in ((share, share), (share, 1.02), (1.02, share))]
    shapes = tuple({"low": wire.middle - a * wire.reach, "high": wire.middle + b * wire.reach} for a, b in sides)
    return Trials(
        {}, shapes, bounds={"low": (wire.low - 2 * margin, wire.middle), "high": (wire.middle, wire.high + 2 * margin)}
    )


def _soft_saturation_trials(scales: Scales) -> Trials:
    hard, reach = _saturation_trials(scales), scales.wire.reach
    shapes = tuple({**shape, "softness": share * reach} for shape in hard.shapes for share in (0.03, 0.12))
    return Trials(
        {},
        shapes,
        bounds={
            "low": (scales.wire.low - reach, scales.wire.middle),
            "high": (scales.wire.middle, scales.wire.high + reach),
            "softness": (1e-3 * reach, reach),
        },
    )


def _even_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    return Trials(
        {"quadratic": CURVATURE_SHARE / reach, "quartic": CURVATURE_SHARE / reach**3},
        fixed={"centre": scales.wire.middle},
    )


def _odd_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    return Trials(
        {"cubic": CURVATURE_SHARE / reach**2, "quintic": CURVATURE_SHARE / reach**4},
        _centres(scales),
        bounds=_centre_bounds(scales),
    )


def _centres(scales: Scales) -> tuple[dict[str, float], ...]:
    """Centres of a characteristic: the middle of the range, and zero where the signal passes it."""
    middle = {"centre": scales.wire.middle}
    passes = scales.wire.low < 0 < scales.wire.high and abs(scales.wire.middle) > 0.02 * scales.wire.reach
    return (middle, {"centre": 0.0}) if passes else (middle,)


def _centre_bounds(scales: Scales) -> dict[str, tuple[float | None, float | None]]:
    return {"centre": (scales.wire.low, scales.wire.high)}


def _bow_trials(scales: Scales) -> Trials:
    reach = scales.wire.reach
    shapes = tuple({"width": share * reach, **centre} for share in (0.12, 0.3, 0.7) for centre in _centres(scales))
    return Trials(
        {"size": CURVATURE_SHARE * reach}, shapes, bounds={"width": (0.03 * reach, 2 * reach), **_centre_bounds(scales)}
    )


def _ripple_shapes(reach: float, size: float, names: tuple[str, ...], prefix: str = "") -> Trials:
    """Trial values of a ripple with more than one period in the range: less is a nonlinear characteristic."""
    periods = (1.2, 1.35, 1.5, 1.75, 2.0, 2.4, 2.8, 3.3, 3.9, 4.6, 5.4, 6.3, 7.3, 8.4, 9.6, 11.0, 13.0, 15.0)
    shapes = tuple({f"{prefix}cycles": math.pi * n / reach} for n in periods)
    return Trials(
        {f"{prefix}{k}": size for k in names},
        shapes,
        bounds={f"{prefix}cycles": (MIN_PERIODS * math.pi / reach, 40 * math.pi / reach)},
    )


def _ripple_trials(scales: Scales) -> Trials:
    return _ripple_shapes(scales.wire.reach, CURVATURE_SHARE * scales.wire.reach, ONE_HARMONIC)


def _two_harmonic_trials(scales: Scales) -> Trials:
    return _ripple_shapes(scales.wire.reach, CURVATURE_SHARE * scales.wire.reach, TWO_HARMONICS)


def _cogging_trials(scales: Scales) -> Trials:
    return _ripple_shapes(scales.other.reach, CURVATURE_SHARE * scales.wire.rms, ONE_HARMONIC, "force.")


def _spring(part: str, power: int) -> Effect:
    name, words = {
        2: ("even_nonlinearity", "a spring that differs between the two sides"),
        3: ("odd_nonlinearity", "a cubic spring"),
    }[power]

    def trials(scales: Scales) -> Trials:
        other = "force.cubic" if part == "quadratic" else "force.quadratic"
        return Trials(
            {f"force.{part}": CURVATURE_SHARE * scales.wire.rms / max(scales.other.rms, 1e-300) ** power},
            fixed={other: 0.0},
        )

    return Effect(
        name,
        "map",
        words,
        "load",
        _subtracted_force("spring", Bend()),
        {f"force.{part}": 0.0},
        (f"force.{part}",),
        trials,
        excites="large and small motion",
        confused=("position_ripple", "saturation"),
        separates="two amplitudes",
        variant="spring",
    )


def _subtracted_force(title: str, law: Block) -> Diagram:
    """Drive ``u`` less the change that a block makes to motion ``x``; a gain of 1 converts between their units."""
    return Diagram(
        title=title,
        blocks={"force": law, "added": Sum(signs="+-"), "pull": Gain(), "left": Sum(signs="+-")},
        wires=["force -> added.plus", "added -> pull -> left.minus"],
        inputs={"u": "left.plus", "x": ["force.u", "added.minus"]},
        outputs={"y": "left"},
    )


def _offset_trials(scales: Scales) -> Trials:
    return Trials({"bias": 0.05 * scales.wire.rms})


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
    ),
    *(
        Effect(
            "saturation",
            "map",
            "a saturation",
            place,
            Saturation(low=-math.inf, high=math.inf),
            {"low": -math.inf, "high": math.inf},
            ("low", "high"),
            _saturation_trials,
            excites="large amplitudes",
            confused=("odd_nonlinearity", "rate_limit", "dead_zone"),
            separates="two amplitudes",
            variant=place,
        )
        for place in ("output", "drive")
    ),
    Effect(
        "saturation",
        "map",
        "a soft saturation",
        "output",
        SoftSaturation(low=-math.inf, high=math.inf),
        {"low": -math.inf, "high": math.inf},
        ("low", "high", "softness"),
        _soft_saturation_trials,
        excites="large amplitudes",
        confused=("odd_nonlinearity", "rate_limit", "dead_zone"),
        separates="two amplitudes",
        variant="soft",
    ),
    Effect(
        "even_nonlinearity",
        "map",
        "a characteristic bent the same way at both ends",
        "output",
        Bend(),
        {"quadratic": 0.0, "quartic": 0.0},
        ("quadratic", "quartic"),
        _even_trials,
        excites="the full range",
        confused=("dead_zone", "asymmetric_hysteresis", "position_ripple"),
        separates="a slow ramp over the full range",
    ),
    Effect(
        "odd_nonlinearity",
        "map",
        "a characteristic that bends opposite ways at the ends",
        "output",
        Bend(),
        {"cubic": 0.0, "quintic": 0.0},
        ("cubic", "quintic", "centre"),
        _odd_trials,
        excites="large and small amplitudes",
        confused=("saturation", "position_ripple"),
        separates="a slow ramp over the full range",
    ),
    Effect(
        "odd_nonlinearity",
        "map",
        "a characteristic with another slope in the middle than at the ends",
        "output",
        Bow(),
        {"size": 0.0},
        ("size", "width", "centre"),
        _bow_trials,
        excites="large and small amplitudes",
        confused=("saturation", "position_ripple"),
        separates="a slow ramp over the full range",
        variant="bow",
    ),
    _spring("quadratic", 2),
    _spring("cubic", 3),
    *(
        Effect(
            "position_ripple",
            "map",
            "a ripple over the position (eccentricity)",
            "output",
            Ripple(),
            dict.fromkeys(names, 0.0),
            (*names, "cycles"),
            trials,
            excites="slow motion over several periods",
            confused=("dead_zone", "even_nonlinearity", "odd_nonlinearity"),
            separates="slow constant speed over three periods or more",
            variant=variant,
            within=("cycles",),
        )
        for names, trials, variant in (
            (ONE_HARMONIC, _ripple_trials, ""),
            (TWO_HARMONICS, _two_harmonic_trials, "two harmonics"),
        )
    ),
    Effect(
        "position_ripple",
        "map",
        "a ripple of the force over the position (cogging)",
        "load",
        _subtracted_force("cogging", Ripple()),
        {"force.cosine": 0.0, "force.sine": 0.0},
        ("force.cosine", "force.sine", "force.cycles"),
        _cogging_trials,
        excites="slow motion over several periods",
        confused=("coulomb_friction", "odd_nonlinearity"),
        separates="slow constant speed over three periods or more",
        variant="force",
        within=("force.cycles",),
    ),
    Effect(
        "load_offset",
        "load",
        "an offset of the load",
        "drive",
        Bias(bias=0.0),
        {"bias": 0.0},
        ("bias",),
        _offset_trials,
        excites="motion both ways",
        confused=("asymmetric_friction", "drift"),
        separates="the mechanism turned over, or unloaded",
    ),
)
