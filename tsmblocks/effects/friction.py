"""Effects of friction: a force that resists the motion, subtracted from the force or voltage that drives it."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping

import attrs

from tsmblocks.blocks import (
    Abs,
    CoulombFriction,
    DahlFriction,
    Derivative,
    Gain,
    GainChange,
    QuadraticDrag,
    StribeckFriction,
    Sum,
)
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.sizes import Size, in_proportion
from tsmblocks.effects.trials import Scales, Span, Trials, instant_trials
from tsmblocks.effects.variants import resisting, separate
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

SMOOTHING_SHARE = 0.02
"""Speed over which dry friction changes sign [rms speed]. Chosen: too small to matter, large enough for the step."""
FRICTION_SHARE = 0.05
"""Trial friction, as a share of the rms drive. Chosen."""


def _resisting(title: str, law: Mapping[str, Block | Diagram]) -> Diagram:
    """Drive ``u`` less a force that a chain of blocks computes from the speed of the position ``x``."""
    return resisting(title, {"rate": Derivative(), **law})


def _of_speed(effect: Effect) -> Effect:
    """The same effect where a speed is measured, which is not differentiated."""
    assert isinstance(effect.block, Diagram)
    block = effect.block.rewire(blocks={**effect.block.blocks, "rate": Gain()})
    return attrs.evolve(
        effect,
        place="brake",
        block=block,
        trials=lambda scales: effect.trials(_as_of_position(scales)),
        variant=", ".join(filter(None, (effect.variant, "speed"))),
        sizes=tuple(map(_size_of_speed, effect.sizes)),
    )


def _and_of_speed(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Each effect, and behind it the same where a speed is measured."""
    return tuple(variant for effect in effects for variant in (effect, _of_speed(effect)))


def _size_of_speed(size: Size) -> Size:
    """The same size where the second signal is a speed: its unit is that of a position over a second."""
    units = {"{x}/s": "{x}", "{x}": "{x}*s"}
    return Size(size.name, lambda p, scales: size.value(p, _as_of_position(scales)), units.get(size.unit, size.unit))


def _as_of_position(scales: Scales) -> Scales:
    """Scales with the second signal, a speed, replaced by the position that moves with it."""
    speed = scales.other
    travel = speed.rms**2 / max(speed.speed, 1e-12)  # the amplitude of a sine: speed squared over acceleration
    fastest = max(abs(speed.low), abs(speed.high))
    return attrs.evolve(scales, other=Span(-travel, travel, travel, speed.rms, fastest))


def _dry_trials(level: str, smoothing: str, shares: tuple[float, ...], scales: Scales) -> Trials:
    """Trial values of a dry friction whose sign changes within one of some speeds [rms speed]."""
    speed = scales.other.speed
    shapes = tuple({smoothing: share * speed} for share in shares)
    bounds = {smoothing: (1e-3 * speed, 0.1 * speed)}
    return Trials({level: FRICTION_SHARE * scales.wire.rms}, shapes, bounds=bounds)


def _trials(name: str, power: int, scales: Scales) -> Trials:
    """Trial values of a friction that grows with a power of the speed."""
    return Trials({name: FRICTION_SHARE * scales.wire.rms / max(scales.other.speed, 1e-12) ** power})


def _stribeck_trials(scales: Scales) -> Trials:
    speed = scales.other.speed
    return Trials(
        {"friction.static": 2 * FRICTION_SHARE * scales.wire.rms},
        tuple({"friction.stribeck": share * speed} for share in (0.1, 0.3, 0.8)),
        {"friction.smoothing": SMOOTHING_SHARE * speed},
        {"friction.stribeck": (3 * SMOOTHING_SHARE * speed, 0.8 * speed)},  # small at working speed
    )


def _presliding_trials(scales: Scales) -> Trials:
    travel = scales.other.reach
    return Trials(
        {"level.gain": FRICTION_SHARE * scales.wire.rms},
        tuple({"friction.sigma0": 1 / (share * travel)} for share in (0.005, 0.02, 0.08)),
        bounds={"friction.sigma0": (2 / travel, 1e4 / travel), "level.gain": (0.0, None)},  # type: ignore[dict-item]
    )


def _trials_of_both_directions(scales: Scales) -> Trials:
    level, difference, smoothing = "friction.level.gain", "friction.difference.gain", "friction.sign.smoothing"
    one = _dry_trials(level, smoothing, (SMOOTHING_SHARE, SMOOTHING_SHARE / 5), scales)
    return attrs.evolve(one, strengths={**one.strengths, difference: 0.3 * one.strengths[level]})


TWO_LEVELS = Diagram(
    title="dry friction with a level for each direction",
    blocks={
        "sign": CoulombFriction(level=1.0),
        "level": Gain(gain=0.0),
        "moving": Abs(),
        "difference": Gain(gain=0.0),
        "both": Sum(signs="++"),
    },
    wires=["sign -> level -> both.plus1", "sign -> moving -> difference -> both.plus2"],
    inputs={"v": "sign"},
    outputs={"force": "both"},
)
POSITION_EFFECTS = (
    Effect(
        "coulomb_friction",
        "friction",
        "Coulomb friction",
        "load",
        _resisting("Coulomb friction", {"friction": CoulombFriction(level=0.0)}),
        {"friction.level": 0.0},
        ("friction.level", "friction.smoothing"),
        functools.partial(_dry_trials, "friction.level", "friction.smoothing", (SMOOTHING_SHARE, SMOOTHING_SHARE / 5)),
        excites="reversals of the motion",
        confused=("presliding_friction", "asymmetric_friction", "stribeck_friction"),
        separates="slow triangles in both directions at two speeds",
        sizes=(in_proportion("friction", "friction.level"),),
        sharp=("friction.smoothing",),
    ),
    Effect(
        "viscous_friction",
        "friction",
        "viscous friction",
        "load",
        _resisting("viscous friction", {"friction": Gain(gain=0.0)}),
        {"friction.gain": 0.0},
        ("friction.gain",),
        functools.partial(_trials, "friction.gain", 1),
        excites="slow and fast motion",
        confused=("coulomb_friction", "quadratic_drag", "stiffness"),
        separates="constant speeds at three levels or more",
        sizes=(Size("friction at the rms speed", lambda p, scales: p["friction.gain"] * scales.other.speed),),
    ),
    Effect(
        "asymmetric_friction",
        "friction",
        "viscous friction that differs with the direction",
        "load",
        _resisting("asymmetric friction", {"size": Abs(), "difference": Gain(gain=0.0)}),
        {"difference.gain": 0.0},
        ("difference.gain",),
        functools.partial(_trials, "difference.gain", 1),
        excites="two speeds or more in each direction",
        confused=("load_offset", "drift", "even_nonlinearity"),
        separates="two speeds in each direction: an offset does not grow with the speed",
        sizes=(
            Size(
                "difference between the directions at the rms speed",
                lambda p, scales: 2 * p["difference.gain"] * scales.other.speed,
            ),
        ),
    ),
    Effect(
        "asymmetric_friction",
        "friction",
        "dry friction that differs with the direction",
        "load",
        _resisting(
            "asymmetric friction", {"sign": CoulombFriction(level=1.0), "moving": Abs(), "difference": Gain(gain=0.0)}
        ),
        {"difference.gain": 0.0},
        ("difference.gain", "sign.smoothing"),
        functools.partial(_dry_trials, "difference.gain", "sign.smoothing", (SMOOTHING_SHARE,)),
        excites="motion in both directions, with rests",
        confused=("load_offset", "drift", "even_nonlinearity"),
        separates="a rest of the drive: an offset of the load pulls at rest, friction does not",
        variant="dry",
        sizes=(in_proportion("difference between the directions", "difference.gain", factor=2.0),),
        sharp=("sign.smoothing",),
    ),
    Effect(
        "asymmetric_friction",
        "friction",
        "dry friction that differs with the direction",
        "load",
        _resisting("asymmetric friction", {"friction": TWO_LEVELS}),
        {"friction.level.gain": 0.0, "friction.difference.gain": 0.0},
        ("friction.level.gain", "friction.difference.gain", "friction.sign.smoothing"),
        _trials_of_both_directions,
        excites="motion in both directions, with rests",
        confused=("coulomb_friction", "load_offset", "drift"),
        separates="a rest of the drive: an offset of the load pulls at rest, friction does not",
        contains=("coulomb_friction",),
        variant="dry, two levels",
        sizes=(
            Size("friction forwards", lambda p, _: p["friction.level.gain"] + p["friction.difference.gain"]),
            Size("friction backwards", lambda p, _: p["friction.level.gain"] - p["friction.difference.gain"]),
        ),
        sharp=("friction.sign.smoothing",),
    ),
    Effect(
        "stribeck_friction",
        "friction",
        "Stribeck friction (more friction at low speed)",
        "load",
        _resisting("Stribeck friction", {"friction": StribeckFriction(coulomb=0.0, static=0.0, viscous=0.0)}),
        {"friction.static": 0.0},
        ("friction.static", "friction.stribeck"),
        _stribeck_trials,
        excites="very slow motion beside fast motion",
        confused=("coulomb_friction", "nonlocal_memory"),
        separates="very slow ramps and fast sweeps",
        sizes=(
            in_proportion("additional friction at rest", "friction.static"),
            in_proportion("Stribeck speed", "friction.stribeck", "{x}/s"),
        ),
    ),
    Effect(
        "presliding_friction",
        "friction",
        "presliding friction (elastic before it slides)",
        "load",
        _resisting("presliding friction", {"friction": DahlFriction(sigma0=1.0, coulomb=1.0), "level": Gain(gain=0.0)}),
        {"level.gain": 0.0},
        ("level.gain", "friction.sigma0"),
        _presliding_trials,
        excites="reversals with a small motion between them",
        confused=("coulomb_friction", "nonlocal_memory", "backlash"),
        separates="tiny amplitudes, below five times the presliding distance",
        sizes=(
            in_proportion("friction", "level.gain"),
            Size("presliding distance", lambda p, _: 1 / p["friction.sigma0"], "{x}"),
        ),
    ),
    Effect(
        "quadratic_drag",
        "friction",
        "drag that grows with the square of the speed",
        "load",
        _resisting("quadratic drag", {"friction": QuadraticDrag(coefficient=0.0)}),
        {"friction.coefficient": 0.0},
        ("friction.coefficient",),
        functools.partial(_trials, "friction.coefficient", 2),
        excites="slow and fast motion",
        confused=("coulomb_friction", "odd_nonlinearity"),
        separates="constant speeds at three levels or more",
        sizes=(Size("drag at the rms speed", lambda p, scales: p["friction.coefficient"] * scales.other.speed**2),),
    ),
)
FROM_AN_INSTANT = Diagram(
    title="the input from an instant on",
    blocks={"change": GainChange(change=1.0), "later": Sum(signs="+-")},
    wires=["change -> later.plus"],
    inputs={"u": ["change", "later.minus"]},
    outputs={"y": "later"},
)
FRICTION_CHANGE = Effect(
    "parameter_change",
    "time",
    "a sudden change of the viscous friction",
    "load",
    _resisting("changed friction", {"friction": Gain(gain=0.0), "from": FROM_AN_INSTANT}),
    {"friction.gain": 0.0},
    ("friction.gain", "from.change.time"),
    lambda scales: instant_trials(scales, _trials("friction.gain", 1, scales).strengths, {}, "from.change."),
    excites="the same inputs before and after it",
    confused=("viscous_friction", "drift", "jump"),
    separates="the same experiment before and after",
    variant="friction",
    sizes=(
        Size("change of the friction at the rms speed", lambda p, scales: p["friction.gain"] * scales.other.speed),
        in_proportion("time", "from.change.time", "s"),
    ),
)
EFFECTS = _and_of_speed(POSITION_EFFECTS)
"""All friction effects, each for a position and then for a speed, so that variants of one name are neighbours."""
CHANGES = _and_of_speed((FRICTION_CHANGE, separate(FRICTION_CHANGE, "from.change.time")))
"""Frictions that change at an instant."""
