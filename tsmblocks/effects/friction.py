"""Effects of friction: a force that resists the motion, subtracted from the force or voltage that drives it."""

from __future__ import annotations

from collections.abc import Callable

import attrs

from tsmblocks.blocks import Abs, CoulombFriction, DahlFriction, Derivative, Gain, QuadraticDrag, StribeckFriction, Sum
from tsmblocks.effects.effect import Effect, Scales, Span, Trials
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

SMOOTHING_SHARE = 0.02
"""Speed over which the sign of a dry friction changes, as a share of the rms speed. Chosen: too small to matter, large
enough for the step of the simulation."""
FRICTION_SHARE = 0.05
"""Trial friction, as a share of the rms drive. Chosen."""


@attrs.frozen
class Motion:
    """How friction obtains the speed: as the derivative of a measured position, or from a measured speed."""

    place: str
    variant: str
    rate: Block
    scales: Callable[[Scales], Scales]

    def resisting(self, title: str, law: dict[str, Block], wires: list[str]) -> Diagram:
        """Drive ``u`` less a force that a chain of blocks computes from the speed of motion ``x``."""
        return Diagram(
            title=title,
            blocks={"rate": self.rate, **law, "left": Sum(signs="+-")},
            wires=wires,
            inputs={"u": "left.plus", "x": "rate.u"},
            outputs={"y": "left"},
        )

    def along(self, title: str, block: Block) -> Diagram:
        """As ``resisting``, for a law in one block, ``friction``."""
        return self.resisting(title, {"friction": block}, ["rate -> friction -> left.minus"])

    def adapted(self, trials: Callable[[Scales], Trials]) -> Callable[[Scales], Trials]:
        """``trials`` with the scales of the motion converted to those of a position, for which they are written."""
        return lambda scales: trials(self.scales(scales))


def _as_of_position(scales: Scales) -> Scales:
    """Scales with the second signal, a speed, replaced by the position that moves with it."""
    speed = scales.other
    travel = speed.rms**2 / max(speed.speed, 1e-12)  # the amplitude of a sine: speed squared over acceleration
    fastest = max(abs(speed.low), abs(speed.high))
    return attrs.evolve(scales, other=Span(-travel, travel, travel, speed.rms, fastest))


MOTIONS = (Motion("load", "", Derivative(), lambda scales: scales), Motion("brake", "speed", Gain(), _as_of_position))
"""A position, which is differentiated exactly, and a speed."""


def _trial_force(scales: Scales) -> float:
    return FRICTION_SHARE * scales.wire.rms


def _coulomb_trials(scales: Scales) -> Trials:
    speed = scales.other.speed
    shapes = tuple({"friction.smoothing": share * speed} for share in (SMOOTHING_SHARE, SMOOTHING_SHARE / 5))
    return Trials(
        {"friction.level": _trial_force(scales)}, shapes, bounds={"friction.smoothing": (1e-3 * speed, 0.1 * speed)}
    )


def _drag_trials(scales: Scales) -> Trials:
    return Trials({"friction.coefficient": _trial_force(scales) / max(scales.other.speed, 1e-12) ** 2})


def _asymmetric_trials(scales: Scales) -> Trials:
    return Trials({"difference.gain": _trial_force(scales) / max(scales.other.speed, 1e-12)})


def _stribeck_trials(scales: Scales) -> Trials:
    speed = scales.other.speed
    return Trials(
        {"friction.static": 2 * _trial_force(scales)},
        tuple({"friction.stribeck": share * speed} for share in (0.1, 0.3, 0.8)),
        {"friction.smoothing": SMOOTHING_SHARE * speed},
        {"friction.stribeck": (3 * SMOOTHING_SHARE * speed, 0.8 * speed)},  # small at working speed
    )


def _presliding_trials(scales: Scales) -> Trials:
    travel = scales.other.reach
    return Trials(
        {"level.gain": _trial_force(scales)},
        tuple({"friction.sigma0": 1 / (share * travel)} for share in (0.005, 0.02, 0.08)),
        bounds={"friction.sigma0": (2 / travel, 1e4 / travel), "level.gain": (0.0, None)},  # type: ignore[dict-item]
    )


def _friction_effects(motion: Motion) -> tuple[Effect, ...]:
    """Every friction effect, for one kind of motion."""
    return (_coulomb(motion), _asymmetric(motion), *_sticking(motion), _drag(motion))


def _coulomb(motion: Motion) -> Effect:
    """Coulomb friction."""
    return Effect(
        "coulomb_friction",
        "friction",
        "Coulomb friction",
        motion.place,
        motion.along("Coulomb friction", CoulombFriction(level=0.0)),
        {"friction.level": 0.0},
        ("friction.level", "friction.smoothing"),
        motion.adapted(_coulomb_trials),
        excites="reversals of the motion",
        confused=("presliding_friction", "asymmetric_friction", "stribeck_friction"),
        separates="slow triangles in both directions at two speeds",
        variant=motion.variant,
    )


def _asymmetric(motion: Motion) -> Effect:
    """Viscous friction that differs with the direction."""
    return Effect(
        "asymmetric_friction",
        "friction",
        "viscous friction that differs with the direction",
        motion.place,
        motion.resisting(
            "asymmetric friction",
            {"size": Abs(), "difference": Gain(gain=0.0)},
            ["rate -> size -> difference -> left.minus"],
        ),
        {"difference.gain": 0.0},
        ("difference.gain",),
        motion.adapted(_asymmetric_trials),
        excites="two speeds or more in each direction",
        confused=("load_offset", "drift", "even_nonlinearity"),
        separates="two speeds in each direction: an offset does not grow with the speed",
        variant=motion.variant,
    )


def _drag(motion: Motion) -> Effect:
    """Quadratic drag."""
    return Effect(
        "quadratic_drag",
        "friction",
        "drag that grows with the square of the speed",
        motion.place,
        motion.along("quadratic drag", QuadraticDrag(coefficient=0.0)),
        {"friction.coefficient": 0.0},
        ("friction.coefficient",),
        motion.adapted(_drag_trials),
        excites="slow and fast motion",
        confused=("coulomb_friction", "odd_nonlinearity"),
        separates="constant speeds at three levels or more",
        variant=motion.variant,
    )


def _sticking(motion: Motion) -> tuple[Effect, ...]:
    """Friction at low speed, and before sliding."""
    place, variant, along, adapted = motion.place, motion.variant, motion.along, motion.adapted
    return (
        Effect(
            "stribeck_friction",
            "friction",
            "Stribeck friction (more friction at low speed)",
            place,
            along("Stribeck friction", StribeckFriction(coulomb=0.0, static=0.0, viscous=0.0)),
            {"friction.static": 0.0},
            ("friction.static", "friction.stribeck"),
            adapted(_stribeck_trials),
            excites="very slow motion beside fast motion",
            confused=("coulomb_friction", "nonlocal_memory"),
            separates="very slow ramps and fast sweeps",
            variant=variant,
        ),
        Effect(
            "presliding_friction",
            "friction",
            "friction that yields before it slides (presliding)",
            place,
            motion.resisting(
                "presliding friction",
                {"friction": DahlFriction(sigma0=1.0, coulomb=1.0), "level": Gain(gain=0.0)},
                ["rate -> friction -> level -> left.minus"],
            ),
            {"level.gain": 0.0},
            ("level.gain", "friction.sigma0"),
            adapted(_presliding_trials),
            excites="reversals with small motion between them",
            confused=("coulomb_friction", "nonlocal_memory", "backlash"),
            separates="tiny amplitudes, below five times the presliding distance",
            variant=variant,
        ),
    )


EFFECTS = tuple(effect for group in zip(*map(_friction_effects, MOTIONS), strict=True) for effect in group)
"""All friction effects, each for a position and then for a speed, so that variants of one name are neighbours."""
