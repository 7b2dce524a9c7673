"""Relatives of blocks of dry friction: friction that yields before it slides, and that falls with the speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsmblocks.blocks import (
    CoulombFriction,
    DahlFriction,
    Derivative,
    Gain,
    LuGreFriction,
    PrandtlIshlinskii,
    Sign,
    StribeckFriction,
)
from tsmblocks.effects.relative import Relative
from tsmblocks.effects.sizes import Size, in_proportion
from tsmblocks.effects.trials import Scales, Trials
from tsmblocks.model.block import Block
from tsmblocks.model.diagram import Diagram

RATE_BLOCK = Derivative
"""The block in front of a friction that a relative which reads the position replaces as well."""
PRESLIDING_SHARES = (0.005, 0.02, 0.08, 0.3)
"""Trial presliding distances [half the travel]. Chosen: a factor of four apart, up to a loop."""
PLAY_SHARES = (0.02, 0.045, 0.1, 0.22, 0.45, 0.9)
"""Half widths of the plays of a friction [half the travel]. Chosen: a factor of 2.2 apart over the travel."""
PLAY_DECAY = 0.6
"""Friction of each play at the start of a fit, as a share of the next narrower one. Chosen: near dry friction."""
MIN_FRICTION_SHARE = 0.01
"""Friction from which the fit of a relative starts at least [rms force]. Chosen: a base may have lost its friction."""


def _travel(scales: Scales) -> float:
    """Half the travel of the position whose rate is read, as that of a sine of the same speed and acceleration."""
    rate = scales.other
    return math.sqrt(2) * rate.rms**2 / max(rate.speed, 1e-300)


def _level(old: Any, scales: Scales) -> float:
    """Friction of the old block while it slides."""
    if isinstance(old, Sign):
        return 1.0
    given = old.level if isinstance(old, CoulombFriction) else old.coulomb
    return max(float(given), MIN_FRICTION_SHARE * scales.wire.rms, 1e-12)


def _dahl(old: Any, scales: Scales) -> Block:
    level = _level(old, scales)
    return DahlFriction(sigma0=level / (PRESLIDING_SHARES[1] * _travel(scales)), coulomb=level)


def _dahl_trials(old: Any, scales: Scales) -> Trials:
    level, travel = _level(old, scales), _travel(scales)
    shapes = tuple({"sigma0": level / (share * travel)} for share in PRESLIDING_SHARES)
    if not isinstance(old, Sign):  # a gain behind a sign is its level
        shapes = tuple({**one, "coulomb": level} for one in shapes)
    return Trials({}, shapes, bounds={"sigma0": (0.5 * level / travel, 1e4 * level / travel)})


def _stribeck(old: Any, scales: Scales) -> Block:
    level, smoothing = _level(old, scales), float(old.smoothing)
    return StribeckFriction(
        coulomb=level, static=level, stribeck=0.3 * scales.other.rms, viscous=0.0, smoothing=smoothing
    )


def _stribeck_trials(old: Any, scales: Scales) -> Trials:
    level, speed = _level(old, scales), scales.other.rms
    start = {"coulomb": level, "viscous": 0.0, "smoothing": float(old.smoothing)}
    shapes = tuple({**start, "static": 1.5 * level, "stribeck": share * speed} for share in (0.1, 0.3, 0.8))
    return Trials({}, shapes, bounds={"stribeck": (0.02 * speed, 0.8 * speed), "smoothing": (1e-3 * speed, speed)})


def _lugre(old: Any, scales: Scales) -> Block:
    level = _level(old, scales)
    static = max(float(getattr(old, "static", level)), level)
    stribeck = float(getattr(old, "stribeck", 0.3 * scales.other.rms))
    sigma0 = float(getattr(old, "sigma0", level / (PRESLIDING_SHARES[1] * _travel(scales))))
    viscous = float(getattr(old, "viscous", 0.0))
    return LuGreFriction(sigma0=sigma0, sigma1=0.0, sigma2=viscous, coulomb=level, static=static, stribeck=stribeck)


def _lugre_trials(old: Any, scales: Scales) -> Trials:
    made, level, travel, speed = _lugre(old, scales), _level(old, scales), _travel(scales), scales.other.rms
    assert isinstance(made, LuGreFriction)
    start = {"sigma2": float(made.sigma2), "coulomb": level, "static": float(made.static)}
    stiff = [float(old.sigma0)] if hasattr(old, "sigma0") else [level / (k * travel) for k in PRESLIDING_SHARES]
    shapes = tuple({**start, "sigma0": k, "stribeck": share * speed} for k in stiff for share in (0.1, 0.5))
    bounds = {"sigma0": (0.5 * level / travel, 1e4 * level / travel), "stribeck": (0.02 * speed, 0.8 * speed)}
    return Trials({}, shapes, bounds=bounds)


def _contacts(old: Any, scales: Scales) -> PrandtlIshlinskii:
    """Elastic contacts that yield one after another: a stiffness less plays, of the old friction together."""
    radii = tuple(share * scales.other.reach for share in PLAY_SHARES)
    shares = np.array([PLAY_DECAY**k for k in range(len(radii))])
    forces = _level(old, scales) * shares / shares.sum()
    weights = tuple(float(-force / radius) for force, radius in zip(forces, radii, strict=True))
    return PrandtlIshlinskii(weight0=-sum(weights), radii=radii, weights=weights)


def _friction_plays(old: Any, scales: Scales) -> Diagram:
    return Diagram(
        title="contacts that yield one after another",
        blocks={"plays": _contacts(old, scales), "force": Gain()},  # a gain of 1 converts between their units
        wires=["plays -> force"],
        inputs={"u": "plays"},
        outputs={"y": "force"},
    )


def _friction_plays_trials(old: Any, scales: Scales) -> Trials:
    made = _contacts(old, scales)
    weights = {f"weights[{k}]": weight for k, weight in enumerate(made.weights)}
    return Trials({}, ({"weight0": made.weight0, **weights},)).under("plays")


DRY_FRICTION: dict[type[Block], str] = {
    CoulombFriction: "Coulomb friction",
    StribeckFriction: "Stribeck friction",
    DahlFriction: "Dahl friction",
    Sign: "a sign",
}
"""Blocks of dry friction that have relatives, in words."""


SLIDING = in_proportion("friction while sliding", "coulomb")
AT_REST = in_proportion("friction at rest", "static")
PRESLIDING_DISTANCE = Size("presliding distance", lambda p, _: p["coulomb"] / p["sigma0"], "{x}*s")
"""Travel in which dry friction builds up; the second signal of these blocks is a speed."""


def _presliding(of: type[Block], **more: Any) -> Relative:
    """A relative of dry friction that yields before it slides."""
    return Relative(
        of=of,
        name="presliding_friction",
        family="friction",
        excites="reversals with a small motion between them",
        confused=("coulomb_friction", "nonlocal_memory", "backlash", "dead_time"),
        separates="the same motion at a second frequency, and tiny amplitudes",
        **more,
    )


def _to_dahl(of: type[Block], words: str) -> Relative:
    return _presliding(
        of,
        words=f"{words} replaced by Dahl friction (presliding)",
        block=_dahl,
        trials=_dahl_trials,
        free=("sigma0",) if of is Sign else ("sigma0", "coulomb"),
        ports={"u": "v"} if of is Sign else {},
        within=("sigma0",),
        variant="Dahl",
        sizes=(PRESLIDING_DISTANCE, *(() if of is Sign else (SLIDING,))),
    )


def _to_plays(of: type[Block], words: str) -> Relative:
    return _presliding(
        of,
        words=f"{words} replaced by contacts that yield one after another (Prandtl-Ishlinskii)",
        block=_friction_plays,
        trials=_friction_plays_trials,
        free=("plays.weight0", *(f"plays.weights[{k}]" for k in range(len(PLAY_SHARES)))),
        ports={} if of is Sign else {"v": "u"},
        instead_of_rate=True,
        variant="plays",
    )


def _to_lugre(of: type[Block], words: str) -> Relative:
    return _presliding(
        of,
        words=f"{words} replaced by LuGre friction (presliding and Stribeck effect)",
        block=_lugre,
        trials=_lugre_trials,
        free=("sigma0", "static", "stribeck", "coulomb", "sigma2"),
        within=("sigma0",),
        variant="LuGre",
        sizes=(PRESLIDING_DISTANCE, SLIDING, AT_REST),
    )


TO_STRIBECK = Relative(
    of=CoulombFriction,
    name="stribeck_friction",
    family="friction",
    words="Coulomb friction replaced by Stribeck friction (more friction at low speed)",
    block=_stribeck,
    trials=_stribeck_trials,
    free=("static", "stribeck", "coulomb", "viscous", "smoothing"),
    excites="very slow motion beside fast motion",
    separates="very slow ramps and fast sweeps",
    variant="Stribeck",
    sizes=(AT_REST, SLIDING, in_proportion("Stribeck speed", "stribeck", "{x}")),
    confused=("presliding_friction", "nonlocal_memory"),
)
FRICTION: tuple[Relative, ...] = (
    *(_to_dahl(of, words) for of, words in DRY_FRICTION.items() if of is not DahlFriction),
    *(_to_plays(of, words) for of, words in DRY_FRICTION.items()),
    TO_STRIBECK,
    *(_to_lugre(of, words) for of, words in DRY_FRICTION.items() if of is not Sign),
)
"""Relatives of dry friction."""
