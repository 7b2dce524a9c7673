"""Effects of the load: springs, cogging, a constant force."""

from __future__ import annotations

import math
from collections.abc import Mapping

import attrs

from tsmblocks.blocks import Bend, Bias, Gain, Ripple, Sum
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.maps import CURVATURE_SHARE, ONE_HARMONIC, PERIOD_OF_RIPPLE, RIPPLE, centres, ripple_trials
from tsmblocks.effects.sizes import Size, in_proportion, wave
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.effects.variants import LEFT, resisting
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

PULL_SHARE = 0.05
"""Trial force of a stiffness or an end stop, as a share of the rms drive. Chosen: that of the other forces."""
REST_REACH = 5.0
"""Rest position of a spring, from the middle of the motion [half its range]. Chosen: farther off it pulls evenly."""


def _cogging_trials(scales: Scales) -> Trials:
    return ripple_trials(scales.other, CURVATURE_SHARE * scales.wire.rms, ONE_HARMONIC).under("force")


def _weight_trials(scales: Scales) -> Trials | None:
    """None where the motion is no angle."""
    if not scales.other.turn:
        return None
    once, size = 2 * math.pi / scales.other.turn, PULL_SHARE * scales.wire.rms
    return Trials(dict.fromkeys(ONE_HARMONIC, size), fixed={"cycles": once}).under("force")


def _steepest(p: Mapping[str, float], scales: Scales) -> float:
    """The angle at which a weight pulls backwards most."""
    return math.atan2(p["force.sine"], p["force.cosine"]) / (2 * math.pi) * scales.other.turn


def _subtracted_force(title: str, law: Block) -> Diagram:
    """Drive ``u`` less the change that a block makes to motion ``x``; a gain of 1 converts between their units."""
    return Diagram(
        title=title,
        blocks={"force": law, "added": Sum(signs="+-"), "pull": Gain(), LEFT: Sum(signs="+-")},
        wires=["force -> added.plus", f"added -> pull -> {LEFT}.minus"],
        inputs={"u": f"{LEFT}.plus", "x": ["force.u", "added.minus"]},
        outputs={"y": LEFT},
    )


def _stiffness_trials(scales: Scales) -> Trials:
    wire, other = scales.wire, scales.other
    rests = tuple({"away.bias": -one["centre"]} for one in centres(scales.of_other))
    farthest = REST_REACH * other.reach
    bounds = {"away.bias": (-other.middle - farthest, farthest - other.middle)}
    return Trials({"force.gain": PULL_SHARE * wire.rms / max(other.rms, 1e-300)}, rests, bounds=bounds)


def _spring(name: str, words: str, part: str, other: str, power: int) -> Effect:
    def trials(scales: Scales) -> Trials:
        size = CURVATURE_SHARE * scales.wire.rms / max(scales.other.rms, 1e-300) ** power
        return Trials({part: size}, fixed={other: 0.0})

    return Effect(
        name,
        "map",
        words,
        "load",
        _subtracted_force("spring", Bend()),
        {part: 0.0},
        (part,),
        trials,
        excites="large and small motion",
        confused=("position_ripple", "saturation"),
        separates="two amplitudes",
        variant="spring",
        sizes=(Size("force at half the range of the motion", lambda p, scales: p[part] * scales.other.reach**power),),
    )


EFFECTS = (
    _spring("even_nonlinearity", "an asymmetric spring (stiffer on one side)", "force.quadratic", "force.cubic", 2),
    _spring("odd_nonlinearity", "a cubic spring", "force.cubic", "force.quadratic", 3),
    Effect(
        "stiffness",
        "load",
        "a force proportional to the position (a spring, a leak; negative for an unstable load)",
        "load",
        resisting("stiffness", {"away": Bias(bias=0.0), "force": Gain(gain=0.0)}),
        {"force.gain": 0.0},
        ("force.gain", "away.bias"),
        _stiffness_trials,
        excites="motion over the whole range, slow and fast",
        confused=("viscous_friction", "load_offset", "drift"),
        separates="slow motion to both ends: the force remains where the motion stops",
        sizes=(
            in_proportion("stiffness", "force.gain", "{u}/{x}"),
            in_proportion("position without force", "away.bias", "{x}", -1.0),
        ),
    ),
    attrs.evolve(
        RIPPLE,
        words="a ripple of the force over the position (cogging)",
        other_words={},
        place="load",
        block=_subtracted_force("cogging", Ripple()),
        null={"force.cosine": 0.0, "force.sine": 0.0},
        free=("force.cosine", "force.sine", "force.cycles"),
        trials=_cogging_trials,
        confused=("coulomb_friction", "odd_nonlinearity"),
        variant="force",
        within=("force.cycles",),
        sizes=(wave(), attrs.evolve(PERIOD_OF_RIPPLE, unit="{x}")),
    ),
    Effect(
        "gravity",
        "load",
        "the weight of a link or an arm (a torque that follows its angle)",
        "load",
        _subtracted_force("weight", Ripple()),
        {"force.cosine": 0.0, "force.sine": 0.0},
        ("force.cosine", "force.sine"),
        _weight_trials,
        excites="slow motion over a large angle",
        confused=("stiffness", "load_offset", "even_nonlinearity", "odd_nonlinearity"),
        separates="the axis of the joint upright: a spring still acts, a weight does not",
        sizes=(wave(), Size("angle of the largest pull", _steepest, "{x}")),
    ),
    Effect(
        "load_offset",
        "load",
        "an offset of the load",
        "drive",
        Bias(bias=0.0),
        {"bias": 0.0},
        ("bias",),
        lambda scales: Trials({"bias": 0.05 * scales.wire.rms}),
        excites="motion in both directions",
        confused=("asymmetric_friction", "drift"),
        separates="the mechanism upside down, or unloaded",
        sizes=(in_proportion("offset", "bias"),),
        other_words=dict.fromkeys(("position", "speed"), "an offset of the command"),
    ),
)
